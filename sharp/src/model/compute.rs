//! Devices on which the network runs, and the implementations of its operations.

use candle_core::Device;
use sharp_kernels::{Algorithm, Conv2d, ConvSpec, Simd};

use super::ModelError;

#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum DeviceChoice {
    /// The first available GPU that this build supports, else the CPU.
    #[default]
    Auto,
    /// This project's CPU kernels.
    Cpu,
    /// Candle's own operations on the CPU: a reference for the kernels; slower, and needs more memory.
    CandleCpu,
    /// The first CUDA device; needs a build with feature `cuda`.
    Cuda,
    /// The Metal device; needs a build with feature `metal`.
    Metal,
}

impl DeviceChoice {
    const NAMES: [(&str, Self); 5] = [
        ("auto", Self::Auto),
        ("cpu", Self::Cpu),
        ("candle-cpu", Self::CandleCpu),
        ("cuda", Self::Cuda),
        ("metal", Self::Metal),
    ];

    /// Opens the device; `convolution` only affects this project's kernels.
    ///
    /// # Errors
    /// [`ModelError::Device`] if an explicitly requested GPU is not available.
    pub fn open(self, convolution: Algorithm) -> Result<Compute, ModelError> {
        let cuda = || Device::new_cuda(0);
        let metal = || Device::new_metal(0);
        let named = |device: candle_core::Result<Device>, name: &str, built: bool| {
            device.map(Compute::candle).map_err(|e| {
                ModelError::Device(if built {
                    format!("no {name} device: {e}")
                } else {
                    format!("this build does not include {name}; build with `--features {name}`")
                })
            })
        };
        match self {
            Self::Cpu => Ok(Compute::cpu(convolution)),
            Self::CandleCpu => Ok(Compute::candle(Device::Cpu)),
            Self::Cuda => named(cuda(), "cuda", cfg!(feature = "cuda")),
            Self::Metal => named(metal(), "metal", cfg!(feature = "metal")),
            Self::Auto => Ok(cuda()
                .or_else(|_| metal())
                .map_or_else(|_| Compute::cpu(convolution), Compute::candle)),
        }
    }
}

impl std::str::FromStr for DeviceChoice {
    type Err = ModelError;

    fn from_str(text: &str) -> Result<Self, ModelError> {
        let found = Self::NAMES.iter().find(|(name, _)| *name == text);
        found.map(|(_, choice)| *choice).ok_or_else(|| {
            ModelError::Device(format!(
                "unknown device `{text}`; expected auto, cpu, candle-cpu, cuda or metal"
            ))
        })
    }
}

/// A device and the implementation of operations on it.
#[derive(Debug, Clone)]
pub struct Compute {
    pub(super) device: Device,
    /// Kernels that replace candle's operations; CPU only.
    pub(super) kernels: Option<Kernels>,
}

/// This project's kernels and their settings.
#[derive(Debug, Clone, Copy)]
pub(super) struct Kernels {
    pub(super) simd: Simd,
    pub(super) convolution: Algorithm,
    /// True if gradients are needed, so that operations must not overwrite their inputs.
    pub(super) learning: bool,
}

impl Kernels {
    pub(super) fn conv2d(&self, spec: ConvSpec, weight: &[f32], bias: Option<&[f32]>) -> Conv2d {
        Conv2d::new(self.simd, spec, weight, bias, false, self.convolution)
    }
}

impl Compute {
    /// Kernels for this CPU; `convolution` applies to 3×3 convolutions.
    pub fn cpu(convolution: Algorithm) -> Self {
        Self {
            device: Device::Cpu,
            kernels: Some(Kernels {
                simd: Simd::detect(),
                convolution,
                learning: false,
            }),
        }
    }

    /// Configures the device for training.
    pub(super) fn learning(mut self) -> Self {
        if let Some(kernels) = &mut self.kernels {
            kernels.learning = true;
        }
        self
    }

    /// Candle's own operations on any device.
    pub fn candle(device: Device) -> Self {
        Self {
            device,
            kernels: None,
        }
    }

    pub fn device(&self) -> &Device {
        &self.device
    }

    /// Name for records: `cpu-avx2`, `cpu-avx2-exact` ([`Algorithm::Direct`]), `candle-cpu`, `candle-cuda…`.
    pub fn name(&self) -> String {
        match &self.kernels {
            Some(kernels) => {
                let set = kernels.simd.instruction_set();
                match kernels.convolution {
                    Algorithm::Winograd => format!("cpu-{set}"),
                    Algorithm::Direct => format!("cpu-{set}-exact"),
                }
            }
            None => format!("candle-{:?}", self.device.location()).to_lowercase(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_parsed_and_absent_devices_are_errors() {
        for (name, choice) in DeviceChoice::NAMES {
            assert_eq!(name.parse::<DeviceChoice>().unwrap(), choice);
            let error = "gpu".parse::<DeviceChoice>().unwrap_err().to_string();
            assert!(error.contains(name), "{error}");
        }
        assert!(DeviceChoice::Auto.open(Algorithm::Winograd).is_ok());
        if !cfg!(feature = "cuda") {
            let refused = DeviceChoice::Cuda.open(Algorithm::Winograd).err().unwrap();
            assert!(refused.to_string().contains("--features cuda"), "{refused}");
        }
    }

    #[test]
    fn names_of_records() {
        let name = |choice: DeviceChoice| choice.open(Algorithm::Direct).unwrap().name();
        assert!(name(DeviceChoice::Cpu).starts_with("cpu-"));
        assert_eq!(name(DeviceChoice::CandleCpu), "candle-cpu");
    }
}
