//! User-supplied mask pictures, white for pixels that count.

use std::path::{Path, PathBuf};

use sharp_metrics::Mask;

use sharp::image_file::{ExrTransfer, PictureRules};

use crate::io::pictures::{self, PictureReading, ReadError, ReadPicture};

/// Why a file cannot be used as a mask; names the file.
#[derive(Debug, thiserror::Error)]
pub enum MaskError {
    #[error(transparent)]
    Read(#[from] ReadError),
    #[error("{}: {reason}", path.display())]
    NoMask { path: PathBuf, reason: String },
}

/// A mask, and the number of pixels that were neither black nor white.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct ReadMask {
    pub mask: Mask,
    /// Number of pixels between black and white. Of these, levels of 128 and more count as white.
    pub between: usize,
}

/// Reads a mask: a gray picture in any format of [`pictures`]. Levels of 128 and more (floats of 0.5 and more) count.
///
/// # Errors
/// If the file cannot be read, is not gray, or contains 0 and 1 where 0 and 255 were meant.
pub fn read(path: &Path) -> Result<ReadMask, MaskError> {
    let as_stored = PictureReading {
        rules: PictureRules::AS_STORED,
        exr: Some(ExrTransfer::Srgb),
    };
    let ReadPicture {
        picture,
        dropped_alpha,
        ..
    } = pictures::read_as(path, &as_stored)?;
    let refused = |reason: String| MaskError::NoMask {
        path: path.to_owned(),
        reason,
    };
    if dropped_alpha {
        let reason = "it has an alpha channel, but masks are read from grey levels; save the alpha channel as a grey \
                      picture";
        return Err(refused(reason.to_owned()));
    }
    let (width, height) = picture.dimensions();
    let (mut inside, mut between, mut highest) = (Vec::new(), 0, 0.0_f64);
    for y in 0..height {
        for x in 0..width {
            let [r, g, b] = [0, 1, 2].map(|channel| picture.value(x, y, channel));
            if r != g || g != b {
                return Err(refused(format!(
                    "coloured at x {x}, y {y}; a mask is white for scored pixels and black for the \
                     others"
                )));
            }
            // Levels of 128 and more, or floats of 0.5 and more, count.
            inside.push(r >= 0.5);
            between += usize::from(r > 0.0 && r < 1.0);
            highest = highest.max(r);
        }
    }
    if highest > 0.0 && highest < 0.5 {
        let levels = if highest == 1.0 / 255.0 {
            "its levels are 0 and 1".to_owned()
        } else {
            format!("its highest level is {:.0}", highest * 255.0)
        };
        return Err(refused(format!(
            "{levels}; a mask is 255 where pixels count"
        )));
    }
    let count = inside.len();
    let mask = Mask::new(width, height, inside)
        .ok_or_else(|| refused(format!("{count} values for {width}x{height} pixels")))?;
    Ok(ReadMask { mask, between })
}

#[cfg(test)]
mod tests {
    use image::{GrayImage, Luma, Rgb, RgbImage};

    use super::*;

    #[test]
    fn white_counts_and_what_is_no_mask_is_refused() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("m.png");
        let write = |levels: [u8; 4]| {
            GrayImage::from_raw(2, 2, levels.to_vec())
                .unwrap()
                .save(&path)
                .unwrap();
            read(&path)
        };
        let found = write([0, 127, 128, 255]).unwrap();
        assert_eq!(found.mask.values(), [false, false, true, true]);
        assert_eq!(found.between, 2);
        assert_eq!(write([0; 4]).unwrap().mask.count(), 0);
        let error = write([0, 1, 1, 0]).unwrap_err().to_string();
        assert!(
            error.contains("m.png") && error.contains("0 and 1"),
            "{error}"
        );
        let mut coloured = RgbImage::from_pixel(2, 2, Rgb([255; 3]));
        coloured.put_pixel(1, 0, Rgb([255, 0, 0]));
        coloured.save(&path).unwrap();
        let error = read(&path).unwrap_err().to_string();
        assert!(error.contains("x 1, y 0"), "{error}");
        let one = GrayImage::from_pixel(3, 1, Luma([255]));
        one.save(&path).unwrap();
        assert_eq!(read(&path).unwrap().mask.dimensions(), (3, 1));
    }
}
