//! Masks of photographs, and the check that a picture or map has the size of its camera.

use std::path::{Path, PathBuf};

use image::GrayImage;

use crate::DatasetError;
use crate::format::picture;
use crate::undistort::Undistortion;

/// The lowest level that counts as white in a mask whose format does not define a threshold; lower
/// levels count as black. Masks consist of 0 and 255, but JPEG and resizing add levels between
/// them.
pub(crate) const WHITE: u8 = 128;

/// Valid pixels of a mask: the white or the black ones.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Keep {
    White,
    Black,
}

/// A grey picture in which white or black pixels are valid.
#[derive(Debug, Clone)]
pub(crate) struct MaskFile {
    pub(crate) file: PathBuf,
    pub(crate) keep: Keep,
    /// The lowest level that counts as white.
    pub(crate) white: u8,
}

impl MaskFile {
    /// Reads the mask for a view: 255 for valid pixels, 0 for others. `size` is the size of the stored picture, which
    /// the mask must have, too; `undistortion` is the mapping to apply to picture and mask.
    pub(crate) fn read(
        &self,
        size: (u32, u32),
        undistortion: Option<&Undistortion>,
    ) -> Result<GrayImage, DatasetError> {
        check_size(&self.file, picture::dimensions(&self.file)?, size)?;
        let mut mask = picture::read_mask(&self.file, self.white)?;
        let kept_is_white = self.keep == Keep::White;
        for value in mask.iter_mut() {
            let is_kept = (*value >= self.white) == kept_is_white;
            *value = if is_kept { 255 } else { 0 };
        }
        Ok(undistortion.map_or_else(|| mask.clone(), |lens| lens.mask(&mask)))
    }
}

/// Rejects a picture or map whose size differs from its camera's.
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
            "is {}x{}, but its camera is for {}x{} pixels",
            found.0, found.1, expected.0, expected.1
        ),
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_between_black_and_white_count_as_the_nearer() {
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("m.png");
        let levels = |keep, stored: [u8; 4]| {
            let mask = GrayImage::from_raw(4, 1, stored.to_vec()).unwrap();
            mask.save(&file).unwrap();
            let mask = MaskFile {
                file: file.clone(),
                keep,
                white: WHITE,
            };
            mask.read((4, 1), None)
                .map(|mask| mask.into_raw())
                .map_err(|e| e.to_string())
        };
        let read = levels(Keep::White, [0, 127, 128, 255]).unwrap();
        assert_eq!(read, [0, 0, 255, 255]);
        let read = levels(Keep::Black, [0, 127, 128, 255]).unwrap();
        assert_eq!(read, [255, 255, 0, 0]);
        let refused = levels(Keep::White, [0, 1, 1, 127]).unwrap_err();
        assert!(refused.contains("maximum level is 127"), "{refused}");
    }

    /// The error must not advise to multiply numbers of objects.
    #[test]
    fn maps_of_objects_are_refused_by_name() {
        let of = |level: fn(u32, u32) -> u8| {
            GrayImage::from_fn(96, 64, |x, y| image::Luma([level(x, y)]))
        };
        let folder = tempfile::tempdir().unwrap();
        let file = folder.path().join("m.png");
        of(|x, _| (x / 24) as u8).save(&file).unwrap();
        let refused = picture::read_mask(&file, WHITE).unwrap_err().to_string();
        assert!(
            refused.contains("levels 0, 1, 2, … like a map of objects"),
            "{refused}"
        );
    }
}
