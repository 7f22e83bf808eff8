//! Cases of gaussians.
