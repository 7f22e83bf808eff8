//! Commands for the network and its Gaussians.

pub(super) mod args;
mod depth_only;
pub(super) mod gaussians;
pub(super) mod parity;
mod photographs;
pub(super) mod predict;
pub(super) mod record;
