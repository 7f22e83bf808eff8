//! Picture sequences as movies.
//!
//! * [`gif`]: animated GIF, encoded in-process.
//! * [`mp4`]: MP4, through an installed ffmpeg.

pub mod gif;
pub mod mp4;

use std::path::{Path, PathBuf};

use image::RgbImage;

use crate::io::atomic_files::FileError;

/// Why a movie could not be written; names the file.
#[derive(Debug, thiserror::Error)]
pub enum MovieError {
    #[error(transparent)]
    File(#[from] FileError),
    #[error(
        "{}: MP4 needs ffmpeg, which is not in PATH; install it (Debian: apt-get install ffmpeg), or write a .gif or \
         a folder of PNG frames", path.display()
    )]
    NoFfmpeg { path: PathBuf },
    #[error("{}: ffmpeg: {reason}", path.display())]
    Ffmpeg { path: PathBuf, reason: String },
    #[error("{}: a frame is {}x{}, but the movie is {}x{}", path.display(), found.0, found.1, expected.0, expected.1)]
    Size {
        path: PathBuf,
        found: (u32, u32),
        expected: (u32, u32),
    },
    #[error("{}: {reason}", path.display())]
    Format { path: PathBuf, reason: String },
}

/// A movie under construction; the file appears when it is finished.
pub trait Movie: Send {
    fn push(&mut self, frame: &RgbImage) -> Result<(), MovieError>;

    /// Writes the remaining frames and gives the file its final name.
    fn finish(self: Box<Self>) -> Result<(), MovieError>;
}

fn check_size(path: &Path, frame: &RgbImage, expected: (u32, u32)) -> Result<(), MovieError> {
    if frame.dimensions() == expected {
        return Ok(());
    }
    Err(MovieError::Size {
        path: path.to_owned(),
        found: frame.dimensions(),
        expected,
    })
}
