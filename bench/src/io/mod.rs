//! Files: atomic writes, hashes, pictures, renderings, Gaussians, checkpoints.
//!
//! * [`atomic_files`]: files that appear complete or not at all; [`hash`]: SHA-256 of bytes and
//!   files.
//! * [`fingerprints`]: for each stage, a hash of the sources and dependencies that determine its
//!   results.
//! * [`observer`]: reports warnings and progress without printing.
//! * [`pictures`]: pictures in PNG, JPEG, EXR and float arrays; [`rendering_files`]: renderings as
//!   PNG, EXR, safetensors.
//! * [`gaussian_files`]: Gaussians as PLY or safetensors; [`masks`]: masks as files.
//! * [`movie`]: picture sequences as GIF and MP4.
//! * [`checkpoint`]: SHARP's official checkpoint: location, integrity, download.
//! * [`machine`]: processor and peak memory; [`text`]: escaping of untrusted text; `calendar`: days
//!   and minutes.

pub mod atomic_files;
pub(crate) mod calendar;
pub mod checkpoint;
pub(crate) mod counts;
pub mod fingerprints;
pub mod gaussian_files;
pub mod hash;
pub mod machine;
pub mod masks;
pub mod movie;
pub mod observer;
pub mod pictures;
pub mod rendering_files;
pub mod text;
pub(crate) mod view_hashes;
