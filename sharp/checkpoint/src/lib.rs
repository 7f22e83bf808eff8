//! Checkpoints: PyTorch's `.pt` / `.pth` (zip files and the older bare pickles) and `.safetensors`.
//!
//! The table of contents is read and checked against the file's length; tensor data is read on demand. Pickles are run
//! by an interpreter that supports only what a state dict needs. Nothing is called. Unknown functions and classes
//! become placeholders; entries that depend on them do not count as tensors. No allocation exceeds a small multiple of
//! the file's length.
//!
//! # Contents
//! * [`checkpoint`]: [`Checkpoint`], the type for all formats.
//! * [`completeness`]: two-way comparison of a checkpoint's tensors with those of a model.
//! * [`convert`]: writing safetensors.
//! * [`deterministic`]: weights as a pure function of names, for tests and golden data.
//! * `download`: resumable, size-checked download of a file (feature `download`).
//! * [`error`]: errors of opening and reading checkpoints.
//! * [`hash`]: SHA-256 as text.
//! * [`tensor`]: element types and strided layouts.
//!
//! Private: `prefix` (strips prefixes that wrappers add to names), `zip` and `legacy` (PyTorch's two containers),
//! `pickle` (the interpreter), `safetensors`, `bytes` (random access to a file).

mod bytes;
pub mod checkpoint;
pub mod completeness;
pub mod convert;
pub mod deterministic;
#[cfg(any(feature = "download", test))]
pub mod download;
pub mod error;
pub mod hash;
mod legacy;
mod pickle;
mod prefix;
mod safetensors;
pub mod tensor;
mod zip;

pub use checkpoint::Checkpoint;
pub use completeness::{Expected, Incomplete};
pub use convert::{OutTensor, write_safetensors};
pub use error::CheckpointError;
pub use tensor::DType;
