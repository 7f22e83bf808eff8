//! Device and kernels of a scorer.

use std::fmt;
use std::num::NonZeroUsize;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use sharp_kernels::{Algorithm, InstructionSet, Simd};

/// Options of the networks' computation. All except `strip_rows` affect values, but only in the
/// last digits of f32.
#[derive(Debug, Clone, Copy)]
pub struct ScorerOptions {
    /// The device. `simd` and `algorithm` only apply to the CPU kernels.
    pub device: Device,
    /// Instruction set; the default is the machine's fastest.
    pub simd: Simd,
    /// Winograd (the default) or direct convolution, which is slower but has smaller rounding errors.
    pub algorithm: Algorithm,
    /// Picture rows processed at once; the default is as many as fit into a fixed amount of memory.
    pub strip_rows: Option<NonZeroUsize>,
}

/// Everything other than weights and pictures that affects the networks' features, for records. Features are
/// bit-identical for any number of threads and, with the CPU kernels, any height of strips.
///
/// Features from different devices, instruction sets or algorithms differ in the last digits of
/// f32. In JSON, `{"device": "cpu", "instruction_set": "avx512", "algorithm": "winograd"}` or
/// `{"device": "cuda"}`; displayed as `avx512, winograd` or `candle on cuda`.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct Arithmetic {
    #[schemars(with = "String")]
    pub device: Device,
    /// Instruction set of the CPU kernels; `None` on other devices.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Option<String>")]
    pub instruction_set: Option<InstructionSet>,
    /// Algorithm of the CPU kernels; `None` on other devices.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    #[schemars(with = "Option<String>")]
    pub algorithm: Option<Algorithm>,
}

impl ScorerOptions {
    pub fn arithmetic(&self) -> Arithmetic {
        let on_kernels = self.device == Device::Cpu;
        Arithmetic {
            device: self.device,
            instruction_set: on_kernels.then_some(self.simd.instruction_set()),
            algorithm: on_kernels.then_some(self.algorithm),
        }
    }
}

impl fmt::Display for Arithmetic {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match (self.instruction_set, self.algorithm) {
            (Some(set), Some(algorithm)) => write!(f, "{set}, {algorithm}"),
            _ if self.device == Device::CandleCpu => f.write_str("candle on cpu"),
            _ => write!(f, "candle on {}", self.device),
        }
    }
}

impl Default for ScorerOptions {
    fn default() -> Self {
        Self {
            device: Device::Cpu,
            simd: Simd::detect(),
            algorithm: Algorithm::Winograd,
            strip_rows: None,
        }
    }
}

/// Device that computes the networks. Everything after their features is the same f64 code on the
/// CPU.
///
/// Devices differ in the last digits of f32, so a record states which one was used.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Device {
    /// This project's CPU kernels: the fastest choice on a CPU. All published tolerances were
    /// tested with them.
    #[default]
    Cpu,
    /// Runs the GPU code path (candle) on the CPU: slow, for testing.
    CandleCpu,
    /// candle's tensors on the first NVIDIA GPU (feature `cuda`). Tested on an H200.
    Cuda,
    /// candle's tensors on an Apple GPU (feature `metal`). Untested: no such GPU was available.
    Metal,
}

#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("unknown device '{0}'; known: cpu, candle-cpu, cuda, metal")]
pub struct UnknownDevice(String);

impl Device {
    pub const ALL: [Self; 4] = [Self::Cpu, Self::CandleCpu, Self::Cuda, Self::Metal];

    /// Name on the command line: `cpu`, `candle-cpu`, `cuda`, `metal`.
    pub fn name(self) -> &'static str {
        match self {
            Self::Cpu => "cpu",
            Self::CandleCpu => "candle-cpu",
            Self::Cuda => "cuda",
            Self::Metal => "metal",
        }
    }

    /// True if this build supports the device, even if the machine does not have it.
    pub fn is_built(self) -> bool {
        match self {
            Self::Cpu => true,
            Self::CandleCpu => cfg!(feature = "tensors"),
            Self::Cuda => cfg!(feature = "cuda"),
            Self::Metal => cfg!(feature = "metal"),
        }
    }

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
        format!("not supported by this build: build with `--features {feature}`")
    }
}

by_name!(Device, UnknownDevice);

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

    #[test]
    fn arithmetic_reads_back_and_is_shown_in_short() {
        let shown = |device| {
            let options = ScorerOptions {
                device,
                simd: Simd::new(InstructionSet::Portable).unwrap(),
                ..ScorerOptions::default()
            };
            let arithmetic = options.arithmetic();
            let json = serde_json::to_string(&arithmetic).unwrap();
            assert_eq!(
                serde_json::from_str::<Arithmetic>(&json).unwrap(),
                arithmetic
            );
            (arithmetic.to_string(), json)
        };
        let kernels = r#"{"device":"cpu","instruction_set":"portable","algorithm":"winograd"}"#;
        assert_eq!(
            shown(Device::Cpu),
            ("portable, winograd".into(), kernels.into())
        );
        let tensors = r#"{"device":"candle-cpu"}"#;
        assert_eq!(
            shown(Device::CandleCpu),
            ("candle on cpu".into(), tensors.into())
        );
        assert_eq!(shown(Device::Cuda).0, "candle on cuda");
    }
}
