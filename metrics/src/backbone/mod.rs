//! The networks whose features LPIPS and DISTS compare, applied to pictures in strips of rows.
//!
//! # Contents
//! * [`architecture`]: layers of the three networks; names and shapes of their tensors.
//! * [`extractor`]: a network on this project's CPU kernels or on a candle device.
//! * [`network`]: a network with its weights.
//! * [`rows`]: rows of a feature map buffered for the next layer.
//! * [`stream`]: runs pictures through a network strip by strip, in lockstep.
//! * `tensors`: the networks on candle's tensors, on a GPU or the CPU (feature `tensors`).

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
