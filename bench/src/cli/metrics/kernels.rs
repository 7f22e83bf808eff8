//! What the numbers of learned metrics are computed with.

use anyhow::anyhow;
use clap::{Args, ValueEnum};
use sharp_metrics::{Algorithm, InstructionSet, ScorerOptions, Simd};

/// Choices of arithmetic: they change learned metrics in the last digits of f32, and how long they take.
#[derive(Debug, Args)]
pub(super) struct KernelArgs {
    /// Instruction set of the networks' kernels on the CPU
    #[arg(long, value_enum, default_value_t = Choice::Auto)]
    simd: Choice,
    /// Convolve directly instead of by Winograd: slower, rounds less
    #[arg(long)]
    exact: bool,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
enum Choice {
    /// The fastest that this machine has
    Auto,
    /// AVX-512 (F, VL, BW, DQ)
    Avx512,
    /// AVX2 with FMA
    Avx2,
    /// Plain Rust
    Portable,
}

impl KernelArgs {
    /// The options with these choices; a device other than the CPU has no use for them.
    pub(super) fn applied_to(&self, options: ScorerOptions) -> anyhow::Result<ScorerOptions> {
        let level = match self.simd {
            Choice::Auto => Simd::detect().instruction_set(),
            Choice::Avx512 => InstructionSet::Avx512,
            Choice::Avx2 => InstructionSet::Avx2,
            Choice::Portable => InstructionSet::Portable,
        };
        let simd = Simd::new(level).ok_or_else(|| {
            let available = Simd::available()
                .into_iter()
                .map(|simd| simd.instruction_set().name());
            let available: Vec<&str> = available.collect();
            anyhow!(
                "--simd {level}: this machine does not have it; it has {}",
                available.join(", ")
            )
        })?;
        Ok(ScorerOptions {
            simd,
            algorithm: if self.exact {
                Algorithm::Direct
            } else {
                Algorithm::Winograd
            },
            ..options
        })
    }
}
