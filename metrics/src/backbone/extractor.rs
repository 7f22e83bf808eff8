//! A network on this project's CPU kernels or on a candle device.

use super::network::{Kernels, Network};
use super::rows::MapSize;
use super::stream::{Taps, memory, stream};
#[cfg(feature = "tensors")]
use super::tensors::TensorNetwork;
use crate::options::Device;
use crate::unavailable::Unavailable;
use crate::weights::{Backbone, Tensors, WeightsError};

/// A network with its weights, on this project's CPU kernels or on a candle device.
#[derive(Debug)]
pub(crate) enum Extractor {
    Kernels(Network, Kernels),
    #[cfg(feature = "tensors")]
    Tensors(TensorNetwork, Device),
}

impl Extractor {
    /// Builds the network as trained; `kernels` is used only by the CPU kernels.
    pub(crate) fn new(
        backbone: Backbone,
        tensors: &Tensors,
        device: Device,
        kernels: Kernels,
    ) -> Result<Self, WeightsError> {
        if device == Device::Cpu {
            return Ok(Self::Kernels(
                Network::new(backbone, tensors, kernels),
                kernels,
            ));
        }
        let refused = |reason: String| WeightsError::Device { device, reason };
        #[cfg(feature = "tensors")]
        {
            let place = device.open().map_err(refused)?;
            let network = TensorNetwork::new(backbone, tensors, &place)
                .map_err(|error| refused(error.to_string()))?;
            Ok(Self::Tensors(network, device))
        }
        #[cfg(not(feature = "tensors"))]
        Err(refused(device.how_to_build()))
    }

    /// The same network with DISTS's L2 pooling instead of max pooling; both share the weights.
    pub(crate) fn with_l2_pooling(&self) -> Result<Self, WeightsError> {
        match self {
            Self::Kernels(network, kernels) => {
                Ok(Self::Kernels(network.with_l2_pooling(*kernels), *kernels))
            }
            #[cfg(feature = "tensors")]
            Self::Tensors(network, device) => network
                .with_l2_pooling()
                .map(|network| Self::Tensors(network, *device))
                .map_err(|error| WeightsError::Device {
                    device: *device,
                    reason: error.to_string(),
                }),
        }
    }

    fn smallest_side(&self) -> usize {
        match self {
            Self::Kernels(network, _) => network.smallest_side(),
            #[cfg(feature = "tensors")]
            Self::Tensors(network, _) => network.smallest_side(),
        }
    }

    /// Approximate memory in bytes used by [`stream`](Self::stream) on the CPU kernels; device memory is not included.
    pub(crate) fn memory(
        &self,
        size: (usize, usize),
        pictures: usize,
        strip: Option<usize>,
    ) -> usize {
        match self {
            Self::Kernels(network, _) => memory(network, size, pictures, strip),
            #[cfg(feature = "tensors")]
            Self::Tensors(..) => 0,
        }
    }

    /// Runs the network on `pictures` pictures of `size`; see [`stream`].
    pub(crate) fn stream(
        &self,
        size: (usize, usize),
        pictures: usize,
        strip: Option<usize>,
        input: impl Fn(usize, usize, &mut [f32]) + Sync,
        each: impl FnMut(Taps),
    ) -> Result<Vec<MapSize>, Unavailable> {
        let smallest = self.smallest_side();
        let too_small = || Unavailable::TooSmall {
            width: size.0 as u32,
            height: size.1 as u32,
            smallest: smallest as u32,
        };
        if size.0.min(size.1) < smallest {
            return Err(too_small());
        }
        match self {
            Self::Kernels(network, _) => {
                stream(network, size, pictures, strip, input, each).ok_or_else(too_small)
            }
            #[cfg(feature = "tensors")]
            Self::Tensors(network, device) => network
                .stream(size, pictures, strip, input, each)
                .map_err(|error| Unavailable::Device {
                    device: *device,
                    reason: error.to_string(),
                }),
        }
    }
}
