//! The content of views whose pixels lie in files.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use image::{GrayImage, RgbImage};

use crate::depth::DepthSource;
use crate::format::picture;
use crate::undistort::Undistortion;
use crate::{DatasetError, DepthMap, ViewContent, files};

/// A photograph in a file, resampled to a pinhole camera where its lens asks for it.
#[derive(Debug)]
pub(crate) struct FileContent {
    /// The photograph.
    pub(crate) image: PathBuf,
    /// Its size as stored, according to the camera.
    pub(crate) size: (u32, u32),
    /// Pixels to black out.
    pub(crate) mask: Option<Mask>,
    /// From the lens to the pinhole camera of the view.
    pub(crate) undistortion: Option<Undistortion>,
    /// Depth, where the dataset has it.
    pub(crate) depth: Option<Arc<dyn DepthSource>>,
    /// The files that the camera was read from.
    pub(crate) cameras: Vec<PathBuf>,
}

impl ViewContent for FileContent {
    fn image(&self) -> Result<RgbImage, DatasetError> {
        let mut image = picture::read(&self.image)?;
        check_size(&self.image, image.dimensions(), self.size)?;
        if let Some(mask) = &self.mask {
            mask.blacken(&mut image)?;
        }
        Ok(match &self.undistortion {
            Some(undistortion) => undistortion.image(&image),
            None => image,
        })
    }

    fn depth(&self) -> Result<Option<DepthMap>, DatasetError> {
        self.depth.as_ref().map(|depth| depth.load()).transpose()
    }

    fn image_file(&self) -> Option<&Path> {
        Some(&self.image)
    }

    fn files(&self) -> Vec<PathBuf> {
        let mut files = vec![self.image.clone()];
        files.extend(self.mask.iter().map(|mask| mask.file.clone()));
        files.extend(self.depth.iter().flat_map(|depth| depth.files()));
        files.extend(self.cameras.iter().cloned());
        files.sort();
        files.dedup();
        files
    }

    fn image_sha256(&self) -> Result<String, DatasetError> {
        files::sha256(&self.image)
    }
}

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

    fn blacken(&self, image: &mut RgbImage) -> Result<(), DatasetError> {
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
