//! CPU kernels over plain `f32` slices, for the network and for the metrics' backbones.
//!
//! Images are NHWC with N = 1 (`[row][column][channel]`); weights are passed in PyTorch's layouts and packed once. The
//! crate depends on no tensor library.
//!
//! Every kernel gives bit-identical results for any number of threads, and every image kernel for any partition of the
//! image into strips of rows. The last bits differ between instruction sets; [`Simd`] identifies the one in use, and
//! any supported one can be forced.
//!
//! Shapes are the caller's responsibility: a slice of the wrong length panics.
//!
//! # Contents
//! * [`simd`]: instruction sets.
//! * [`rows`]: strips of an image; [`RowOp`], the interface shared by all image kernels.
//! * [`gemm`]: matrix products with packed weights and fused epilogues.
//! * [`conv`]: convolutions: direct, Winograd, transposed.
//! * [`pool`]: max pooling and the L2 pooling of DISTS.
//! * [`norm`]: layer and group normalisation.
//! * [`attention`](mod@attention): multi-head self-attention.
//! * [`activation`]: GELU of a slice.
//!
//! Private: `math` (vectorised exp and GELU), `workspace` (reused scratch memory, distribution of tasks over threads).

pub mod activation;
pub mod attention;
pub mod conv;
pub mod gemm;
mod math;
pub mod norm;
pub mod pool;
pub mod rows;
pub mod simd;
#[cfg(test)]
mod testing;
mod workspace;

pub use attention::{AttentionShape, attention};
pub use conv::{Algorithm, Conv2d, ConvOptions, ConvSpec, TransposedConv2x2};
pub use gemm::{Epilogue, PackedMatrix, matmul};
pub use norm::{GroupNorm, NormGradient, layer_norm};
pub use pool::{L2Pool, MaxPool};
pub use rows::{RowOp, RowWindow};
pub use simd::{InstructionSet, PinError, Simd, UnknownInstructionSet};
