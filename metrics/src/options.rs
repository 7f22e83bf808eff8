//! How a scorer computes.

use std::num::NonZeroUsize;

use sharp_kernels::{Algorithm, Simd};

use crate::device::Device;

/// How the networks are computed. All but `strip_rows` change values, in the last digits of f32.
#[derive(Debug, Clone, Copy)]
pub struct ScorerOptions {
    /// Where; the next two count on the CPU's kernels only.
    pub device: Device,
    /// Instruction set; by default the fastest of the machine.
    pub simd: Simd,
    /// Winograd (the default) or direct convolution, which takes longer and rounds less.
    pub algorithm: Algorithm,
    /// Picture rows taken at once; by default as many as fit into a fixed amount of memory.
    pub strip_rows: Option<NonZeroUsize>,
}

impl ScorerOptions {
    /// What the networks' features depend on besides weights and pictures, for records: `avx512,
    /// winograd` on the CPU, `candle on cuda` elsewhere. The number of threads changes no bit, nor does the height of
    /// strips on the CPU's kernels.
    pub fn arithmetic(&self) -> String {
        match self.device {
            Device::Cpu => {}
            Device::CandleCpu => return "candle on cpu".to_owned(),
            Device::Cuda | Device::Metal => return format!("candle on {}", self.device),
        }
        let algorithm = match self.algorithm {
            Algorithm::Winograd => "winograd",
            Algorithm::Direct => "direct",
        };
        format!("{}, {algorithm}", self.simd.level())
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
