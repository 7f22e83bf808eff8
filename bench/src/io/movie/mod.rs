//! Pictures in a row, as files that move.
//!
//! * [`gif`]: animated GIF, by ourselves; `palette`: its 256 colours a frame.
//! * [`mp4`]: MP4, through an installed ffmpeg.

pub mod gif;
pub mod mp4;
mod palette;

use std::path::{Path, PathBuf};

use image::RgbImage;

use crate::io::atomic_files::FileError;

/// Why a movie could not be written; names the file.
#[derive(Debug, thiserror::Error)]
pub enum MovieError {
    /// The file itself.
    #[error(transparent)]
    File(#[from] FileError),
    /// ffmpeg is not installed.
    #[error(
        "{}: MP4 needs ffmpeg, which is not in PATH: install it (Debian: apt-get install ffmpeg), or write a .gif or \
         a folder of PNG frames", path.display()
    )]
    NoFfmpeg {
        /// The file.
        path: PathBuf,
    },
    /// ffmpeg refused or died.
    #[error("{}: ffmpeg: {reason}", path.display())]
    Ffmpeg {
        /// The file.
        path: PathBuf,
        /// What it said last.
        reason: String,
    },
    /// A frame of another size than the first.
    #[error("{}: a frame is {}x{}, the movie {}x{}", path.display(), found.0, found.1, expected.0, expected.1)]
    Size {
        /// The file.
        path: PathBuf,
        /// Of the frame, pixels.
        found: (u32, u32),
        /// Of the movie, pixels.
        expected: (u32, u32),
    },
    /// A size or rate that the format cannot hold.
    #[error("{}: {reason}", path.display())]
    Format {
        /// The file.
        path: PathBuf,
        /// Which, and the bounds.
        reason: String,
    },
}

/// A movie in the making; the file appears when it is finished.
pub trait Movie: Send {
    /// Appends a frame.
    ///
    /// # Errors
    /// Names the file and the reason.
    fn push(&mut self, frame: &RgbImage) -> Result<(), MovieError>;

    /// Writes what is left and gives the file its name.
    ///
    /// # Errors
    /// Names the file and the reason.
    fn finish(self: Box<Self>) -> Result<(), MovieError>;
}

/// Refuses a frame of another size.
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
