//! Where the networks behind LPIPS and DISTS are computed.

use std::fmt;
use std::str::FromStr;

/// What computes the networks. Everything after their features is the same code in f64 on the CPU.
///
/// The classes round differently in the last digits of f32, so a record says which one a number comes from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Device {
    /// Our kernels on the CPU: the fastest there, and what all published tolerances were tested with.
    #[default]
    Cpu,
    /// candle's tensors on the CPU: slow; it tests the code that GPUs run.
    CandleCpu,
    /// candle's tensors on the first NVIDIA GPU (feature `cuda`). Untested on a real one.
    Cuda,
    /// candle's tensors on an Apple GPU (feature `metal`). Untested on a real one.
    Metal,
}

/// No device of that name.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("unknown device '{0}'; known: cpu, candle-cpu, cuda, metal")]
pub struct UnknownDevice(String);

impl Device {
    /// All of them.
    pub const ALL: [Self; 4] = [Self::Cpu, Self::CandleCpu, Self::Cuda, Self::Metal];

    /// On the command line: `cpu`, `candle-cpu`, `cuda`, `metal`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Cpu => "cpu",
            Self::CandleCpu => "candle-cpu",
            Self::Cuda => "cuda",
            Self::Metal => "metal",
        }
    }

    /// Whether this build can use it at all, be it there or not.
    pub fn is_built(self) -> bool {
        match self {
            Self::Cpu => true,
            Self::CandleCpu => cfg!(feature = "tensors"),
            Self::Cuda => cfg!(feature = "cuda"),
            Self::Metal => cfg!(feature = "metal"),
        }
    }

    /// Opens the tensors' device.
    #[cfg(feature = "tensors")]
    pub(crate) fn open(self) -> Result<candle_core::Device, String> {
        if !self.is_built() {
            return Err(self.how_to_build());
        }
        match self {
            Self::Cpu | Self::CandleCpu => Ok(candle_core::Device::Cpu),
            Self::Cuda => candle_core::Device::new_cuda(0).map_err(|error| error.to_string()),
            Self::Metal => candle_core::Device::new_metal(0).map_err(|error| error.to_string()),
        }
    }

    pub(crate) fn how_to_build(self) -> String {
        let feature = match self {
            Self::Cpu | Self::CandleCpu => "tensors",
            Self::Cuda | Self::Metal => self.name(),
        };
        format!("this build cannot: build with `--features {feature}`")
    }
}

impl fmt::Display for Device {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

impl FromStr for Device {
    type Err = UnknownDevice;

    fn from_str(name: &str) -> Result<Self, UnknownDevice> {
        Self::ALL
            .into_iter()
            .find(|device| device.name() == name)
            .ok_or_else(|| UnknownDevice(name.to_owned()))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_read_back_and_absent_devices_say_how_to_get_them() {
        for device in Device::ALL {
            assert_eq!(device.to_string().parse(), Ok(device));
        }
        assert!("tpu".parse::<Device>().is_err());
        assert!(Device::Cuda.how_to_build().contains("--features cuda"));
    }
}
