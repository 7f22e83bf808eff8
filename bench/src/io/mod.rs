//! Files: atomic writes, hashes, pictures, renderings, Gaussians, checkpoints.
//!
//! * [`atomic_files`]: files that are written whole or not at all; [`hash`]: sha256 of bytes and files.
//! * [`fingerprints`]: hashes of the sources and dependencies that decide a result, by stage.
//! * [`observer`]: how the library reports warnings and progress without printing.
//! * [`pictures`]: pictures in PNG, JPEG, EXR and float arrays; [`rendering_files`]: renderings as PNG, EXR, safetensors.
//! * [`gaussian_files`]: Gaussians as PLY or safetensors; [`masks`]: masks as files.
//! * [`movie`]: sequences of pictures as GIF and MP4.
//! * [`checkpoint`]: SHARP's official checkpoint: finding it, recognising it, fetching it.
//! * [`machine`]: what this process runs on, and how much memory it has used; [`text`]: text from outside, made harmless; `calendar`: days
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
