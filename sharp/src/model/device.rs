//! Devices that run the network.

use candle_core::Device;

use super::engine::Engine;
use super::{Algorithm, ModelError};

#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum DeviceChoice {
    /// The first GPU that this build supports and that answers, else the CPU.
    #[default]
    Auto,
    Cpu,
    /// The first CUDA device; needs a build with feature `cuda`.
    Cuda,
    /// The Metal device; needs a build with feature `metal`.
    Metal,
}

impl DeviceChoice {
    /// Opens the device; `convolution` matters on the CPU.
    ///
    /// # Errors
    /// [`ModelError::Device`] when a GPU was asked for by name and is not there.
    pub fn open(self, convolution: Algorithm) -> Result<Engine, ModelError> {
        let cuda = || Device::new_cuda(0);
        let metal = || Device::new_metal(0);
        let named = |device: candle_core::Result<Device>, name: &str, built: bool| {
            device.map(Engine::Tensors).map_err(|e| {
                ModelError::Device(if built {
                    format!("no {name} device: {e}")
                } else {
                    format!("this build has no {name}: build with `--features {name}`")
                })
            })
        };
        match self {
            Self::Cpu => Ok(Engine::cpu(convolution)),
            Self::Cuda => named(cuda(), "cuda", cfg!(feature = "cuda")),
            Self::Metal => named(metal(), "metal", cfg!(feature = "metal")),
            Self::Auto => Ok(cuda()
                .or_else(|_| metal())
                .map_or_else(|_| Engine::cpu(convolution), Engine::Tensors)),
        }
    }
}

impl std::str::FromStr for DeviceChoice {
    type Err = ModelError;

    fn from_str(text: &str) -> Result<Self, ModelError> {
        match text {
            "auto" => Ok(Self::Auto),
            "cpu" => Ok(Self::Cpu),
            "cuda" => Ok(Self::Cuda),
            "metal" => Ok(Self::Metal),
            _ => Err(ModelError::Device(format!(
                "unknown device `{text}`: auto, cpu, cuda or metal"
            ))),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_parsed_and_absent_devices_are_errors() {
        assert_eq!("auto".parse::<DeviceChoice>().unwrap(), DeviceChoice::Auto);
        assert!("gpu".parse::<DeviceChoice>().is_err());
        assert!(DeviceChoice::Auto.open(Algorithm::Winograd).is_ok());
        if !cfg!(feature = "cuda") {
            let refused = DeviceChoice::Cuda.open(Algorithm::Winograd).err().unwrap();
            assert!(refused.to_string().contains("--features cuda"), "{refused}");
        }
    }

    #[test]
    fn engines_say_what_they_are() {
        let name = DeviceChoice::Cpu.open(Algorithm::Direct).unwrap().name();
        assert!(name.starts_with("cpu-"), "{name}");
        assert_eq!(Engine::Tensors(Device::Cpu).name(), "candle-cpu");
    }
}
