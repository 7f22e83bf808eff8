//! Masks of photographs, and the rule that what belongs to a camera has its size.

use std::path::{Path, PathBuf};

use image::{GrayImage, RgbImage};

use crate::DatasetError;
use crate::format::picture;

/// A gray picture that says which pixels count: those at full brightness.
#[derive(Debug, Clone)]
pub(crate) struct Mask {
    pub(crate) file: PathBuf,
}

impl Mask {
    /// Reads it; it must have the stored picture's size.
    pub(crate) fn read(&self, size: (u32, u32)) -> Result<GrayImage, DatasetError> {
        let mask = picture::read_mask(&self.file)?;
        check_size(&self.file, mask.dimensions(), size)?;
        Ok(mask)
    }

    /// Makes the pixels that do not count black.
    pub(crate) fn blacken(&self, image: &mut RgbImage) -> Result<(), DatasetError> {
        let mask = self.read(image.dimensions())?;
        for (pixel, keep) in image.chunks_exact_mut(3).zip(mask.iter()) {
            if *keep < 255 {
                pixel.fill(0);
            }
        }
        Ok(())
    }
}

/// Refuses a picture or map whose size is not the camera's.
pub(crate) fn check_size(
    path: &Path,
    found: (u32, u32),
    expected: (u32, u32),
) -> Result<(), DatasetError> {
    if found == expected {
        return Ok(());
    }
    Err(DatasetError::malformed(
        path,
        format!(
            "is {}x{}, but its camera is for {}x{}",
            found.0, found.1, expected.0, expected.1
        ),
    ))
}
