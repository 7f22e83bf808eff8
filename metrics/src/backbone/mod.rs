//! The networks whose features LPIPS and DISTS compare, run over pictures in row strips.
//!
//! # Contents
//! * [`architecture`]: the three networks as lists of layers; names and shapes of their tensors.
//! * [`extractor`]: a network on our kernels or on a device of candle's.
//! * [`network`]: a network with its weights.
//! * [`rows`]: rows of a feature map held for the next layer.
//! * [`stream`]: pictures through a network, strip by strip, in lockstep.
//! * `tensors`: the same by candle's tensors (feature `tensors`).

pub(crate) mod architecture;
mod extractor;
mod network;
mod rows;
mod stream;
#[cfg(feature = "tensors")]
mod tensors;

pub(crate) use extractor::Extractor;
pub(crate) use network::Kernels;
pub(crate) use stream::Taps;

#[cfg(test)]
pub(crate) use network::Network;
#[cfg(test)]
pub(crate) use stream::stream;

#[cfg(test)]
mod tests;
