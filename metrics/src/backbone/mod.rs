//! The networks whose features LPIPS and DISTS compare, run over two pictures in row strips.
//!
//! # Contents
//! * [`architecture`]: the three networks as lists of steps; names and shapes of their tensors.
//! * [`expand`]: SqueezeNet's two convolutions side by side.
//! * [`network`]: a network with its weights.
//! * [`rows`]: rows of a feature map held for the next layer.
//! * [`stream`]: both pictures through a network, strip by strip, in lockstep.

pub(crate) mod architecture;
mod expand;
mod network;
mod rows;
mod stream;

pub(crate) use network::{Kernels, Network};
pub(crate) use stream::{Taps, stream};

#[cfg(test)]
mod tests;
