//! Checkpoints: PyTorch's `.pt` / `.pth` (zip files and the older bare pickles) and `.safetensors`.
//!
//! The table of contents is read and checked against the file's length; a tensor is read only when
//! it is asked for. Pickles are run by an interpreter that knows only what a state dict needs:
//! nothing is called, and other names in the file are ignored unless a tensor needs them.
//! Nothing allocates more than a small multiple of the file's own length.
//!
//! # Contents
//! * [`checkpoint`]: [`Checkpoint`], the one type for all formats.
//! * [`completeness`]: every tensor expected is there, every tensor there is expected.
//! * [`convert`]: writing safetensors.
//! * [`deterministic`]: weights as a pure function of names, for tests and golden data.
//! * `download`: fetching a file, resumed and bounded (feature `download`).
//! * [`error`]: why a file was refused.
//! * [`hash`]: SHA-256 as text.
//! * [`tensor`]: element types and strided layouts.
//!
//! Private: `prefix` (names without what wrappers add), `zip` and `legacy` (PyTorch's two containers), `pickle` (the interpreter),
//! `safetensors`, `bytes` (reading parts of a file).

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
