//! The networks whose features LPIPS and DISTS compare, run over two pictures in row strips.
//!
//! # Contents
//! * [`architecture`]: the three networks as lists of steps; names and shapes of their tensors.
//! * [`convolution`]: convolutions over a range of rows.
//! * [`network`]: a network with its weights.
//! * [`pool`]: max pooling and DISTS's L2 pooling over a range of rows.
//! * [`rows`]: some rows of a feature map.
//! * [`stream`]: both pictures through a network, strip by strip, in lockstep.

pub(crate) mod architecture;
mod convolution;
mod network;
mod pool;
mod rows;
mod stream;

pub(crate) use network::Network;
pub(crate) use stream::{Taps, stream};
