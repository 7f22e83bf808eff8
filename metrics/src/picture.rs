//! Pictures and masks, the inputs of metrics.

use image::{Rgb, Rgb32FImage, RgbImage};

/// A three-channel, sRGB-encoded picture with values in 0..1.
#[derive(Debug, Clone, PartialEq)]
pub enum Picture {
    /// 8-bit levels; level v represents v / 255.
    Rgb8(RgbImage),
    /// Floating-point values in 0..1.
    RgbF32(Rgb32FImage),
}

/// Invalid pixels or an invalid size of a picture.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum PictureError {
    #[error(
        "the kernel area only reduces pictures; use bilinear, bilinear-antialias, bicubic or lanczos to enlarge them"
    )]
    AreaEnlarges,
    #[error("the picture is {width}x{height}: it has no pixels")]
    Empty {
        /// Width in pixels.
        width: u32,
        /// Height in pixels.
        height: u32,
    },
    #[error("{value} at x {x}, y {y}, channel {channel}: pixels must be finite")]
    NotFinite {
        value: f32,
        /// Column of the first pixel that is not finite.
        x: u32,
        /// Row of the first pixel that is not finite.
        y: u32,
        /// Channel of the pixel: 0 red, 1 green, 2 blue.
        channel: usize,
    },
    #[error(
        "{value} at x {x}, y {y}, channel {channel}: pixels must lie in 0..1 (a picture in \
         -1..1, 0..255 or of linear light must be converted first)"
    )]
    OutOfRange {
        value: f32,
        /// Column of the first pixel out of range.
        x: u32,
        /// Row of the first pixel out of range.
        y: u32,
        /// Channel of the pixel: 0 red, 1 green, 2 blue.
        channel: usize,
    },
}

impl Picture {
    /// Width and height in pixels.
    pub fn dimensions(&self) -> (u32, u32) {
        match self {
            Self::Rgb8(picture) => picture.dimensions(),
            Self::RgbF32(picture) => picture.dimensions(),
        }
    }

    /// Value of a pixel's channel in 0..1; 8-bit levels are divided by 255 in f64.
    ///
    /// # Panics
    /// If the position is outside the picture.
    pub fn value(&self, x: u32, y: u32, channel: usize) -> f64 {
        match self {
            Self::Rgb8(picture) => f64::from(picture.get_pixel(x, y).0[channel]) / 255.0,
            Self::RgbF32(picture) => f64::from(picture.get_pixel(x, y).0[channel]),
        }
    }

    /// Crops to a box (left, top, right, bottom) and replaces pixels where the mask is false with
    /// the pixels of `other`. Both pictures and the mask must have the same size.
    pub(crate) fn pasted(&self, other: &Self, mask: &Mask, [l, t, r, b]: [u32; 4]) -> Self {
        let inside = |x: u32, y: u32| mask.row((y + t) as usize)[(x + l) as usize];
        match (self, other) {
            (Self::Rgb8(own), Self::Rgb8(others)) => {
                Self::Rgb8(RgbImage::from_fn(r - l, b - t, |x, y| {
                    *if inside(x, y) { own } else { others }.get_pixel(x + l, y + t)
                }))
            }
            _ => Self::RgbF32(Rgb32FImage::from_fn(r - l, b - t, |x, y| {
                let picture = if inside(x, y) { self } else { other };
                Rgb([0, 1, 2].map(|c| picture.value(x + l, y + t, c) as f32))
            })),
        }
    }

    /// Checks that the picture is not empty and that all values are finite and in 0..1.
    ///
    /// # Errors
    /// [`PictureError`] with the position of the first invalid value.
    pub fn check(&self) -> Result<(), PictureError> {
        let (width, height) = self.dimensions();
        if width == 0 || height == 0 {
            return Err(PictureError::Empty { width, height });
        }
        let Self::RgbF32(picture) = self else {
            return Ok(());
        };
        let offender = picture
            .as_raw()
            .iter()
            .position(|value| !(0.0..=1.0).contains(value));
        let Some(index) = offender else {
            return Ok(());
        };
        let value = picture.as_raw()[index];
        let (pixel, channel) = ((index / 3) as u32, index % 3);
        let (x, y) = (pixel % width, pixel / width);
        Err(if value.is_finite() {
            PictureError::OutOfRange {
                value,
                x,
                y,
                channel,
            }
        } else {
            PictureError::NotFinite {
                value,
                x,
                y,
                channel,
            }
        })
    }

    /// Writes the pixels of row `y`, starting at column `x`, to `out` as interleaved values in 0..1.
    pub(crate) fn row_f64(&self, x: usize, y: usize, out: &mut [f64]) {
        let n = out.len();
        let start = 3 * (y * self.dimensions().0 as usize + x);
        match self {
            Self::Rgb8(picture) => {
                let row = &picture.as_raw()[start..][..n];
                for (out, &level) in out.iter_mut().zip(row) {
                    *out = LEVELS[usize::from(level)];
                }
            }
            Self::RgbF32(picture) => {
                let row = &picture.as_raw()[start..][..n];
                for (out, &value) in out.iter_mut().zip(row) {
                    *out = f64::from(value);
                }
            }
        }
    }
}

/// A network's per-channel normalisation of its input: `factor × value + offset` of a value in 0..1, computed in f64
/// and rounded once.
#[derive(Debug, Clone)]
pub(crate) struct Normalization {
    factor: [f64; 3],
    offset: [f64; 3],
    /// Normalised value of every 8-bit level, per channel.
    levels: [[f32; 3]; 256],
}

impl Normalization {
    /// Normalises by `((stretch × value + start) − mean) / deviation` for each channel.
    pub(crate) fn new(stretch: f64, start: f64, mean: [f32; 3], deviation: [f32; 3]) -> Self {
        let factor = deviation.map(|deviation| stretch / f64::from(deviation));
        let offset =
            std::array::from_fn(|c| (start - f64::from(mean[c])) / f64::from(deviation[c]));
        let at = |value: f64, c: usize| (factor[c] * value + offset[c]) as f32;
        Self {
            factor,
            offset,
            levels: std::array::from_fn(|level| std::array::from_fn(|c| at(LEVELS[level], c))),
        }
    }

    /// Writes row `y` of a picture as the network's input (3 × width values).
    pub(crate) fn row(&self, picture: &Picture, y: usize, out: &mut [f32]) {
        let n = out.len();
        let (out, _) = out.as_chunks_mut::<3>();
        match picture {
            Picture::Rgb8(picture) => {
                let (row, _) = picture.as_raw()[y * n..][..n].as_chunks::<3>();
                for (out, levels) in out.iter_mut().zip(row) {
                    *out = std::array::from_fn(|c| self.levels[usize::from(levels[c])][c]);
                }
            }
            Picture::RgbF32(picture) => {
                let (row, _) = picture.as_raw()[y * n..][..n].as_chunks::<3>();
                for (out, values) in out.iter_mut().zip(row) {
                    let at = |c: usize| self.factor[c] * f64::from(values[c]) + self.offset[c];
                    *out = std::array::from_fn(|c| at(c) as f32);
                }
            }
        }
    }
}

/// Element v is v / 255 in f64. A division per pixel would cost more than the rest of a metric.
const LEVELS: [f64; 256] = {
    let mut levels = [0.0; 256];
    let mut v = 0;
    while v < 256 {
        levels[v] = v as f64 / 255.0;
        v += 1;
    }
    levels
};

impl From<RgbImage> for Picture {
    fn from(picture: RgbImage) -> Self {
        Self::Rgb8(picture)
    }
}

impl From<Rgb32FImage> for Picture {
    fn from(picture: Rgb32FImage) -> Self {
        Self::RgbF32(picture)
    }
}

/// The pixels that are scored; row-major, top row first.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Mask {
    width: u32,
    height: u32,
    inside: Vec<bool>,
}

impl Mask {
    /// Creates a mask from row-major values; `None` if their number is not width × height.
    pub fn new(width: u32, height: u32, inside: Vec<bool>) -> Option<Self> {
        (inside.len() as u64 == u64::from(width) * u64::from(height)).then_some(Self {
            width,
            height,
            inside,
        })
    }

    /// Width and height in pixels.
    pub fn dimensions(&self) -> (u32, u32) {
        (self.width, self.height)
    }

    /// One value per pixel, row-major, top row first.
    pub fn values(&self) -> &[bool] {
        &self.inside
    }

    /// Number of pixels inside the mask.
    pub fn count(&self) -> usize {
        self.inside.iter().filter(|&&inside| inside).count()
    }

    /// Pixels around which a square with sides of 2 × `radius` + 1 pixels is inside the mask. If `beyond`, pixels
    /// beyond the picture's border count as inside.
    pub(crate) fn eroded(&self, radius: usize, beyond: bool) -> Self {
        let (width, height) = (self.width as usize, self.height as usize);
        // Filter one axis, then the other: a pixel is kept if no pixel within its radius is outside
        // the mask.
        let along = |values: &[bool], n: usize, stride: usize, lines: usize, step: usize| {
            let mut out = vec![false; values.len()];
            for line in 0..lines {
                let at = |i: usize| line * step + i * stride;
                let mut outside = vec![0_usize; n + 1];
                for i in 0..n {
                    outside[i + 1] = outside[i] + usize::from(!values[at(i)]);
                }
                for i in 0..n {
                    let (first, end) = (i.saturating_sub(radius), (i + radius + 1).min(n));
                    let reaches_beyond = i < radius || i + radius >= n;
                    out[at(i)] = outside[end] == outside[first] && (beyond || !reaches_beyond);
                }
            }
            out
        };
        let across = along(&self.inside, width, 1, height, width);
        Self {
            inside: along(&across, height, width, width, 1),
            ..*self
        }
    }

    /// Reduces the mask to half its size, rounded down. A pixel is inside if all four of its source
    /// pixels are inside.
    pub(crate) fn halved(&self) -> Self {
        let (width, height) = (self.width / 2, self.height / 2);
        let rows = (0..height as usize).flat_map(|y| {
            let (upper, lower) = (self.row(2 * y), self.row(2 * y + 1));
            (0..2 * width as usize)
                .step_by(2)
                .map(|x| upper[x] && upper[x + 1] && lower[x] && lower[x + 1])
        });
        Self {
            inside: rows.collect(),
            width,
            height,
        }
    }

    /// Left, top, right and bottom (the last two exclusive) of the bounding box of the pixels
    /// inside; `None` if no pixel is inside.
    pub(crate) fn bounds(&self) -> Option<[u32; 4]> {
        let rows = (0..self.height).filter(|&y| self.row(y as usize).contains(&true));
        let (top, bottom) = (rows.clone().min()?, rows.max()? + 1);
        let columns = |y: u32| {
            let inside = self.row(y as usize).iter().enumerate();
            inside.filter(|(_, inside)| **inside).map(|(x, _)| x as u32)
        };
        let columns = (top..bottom).flat_map(columns);
        let (left, right) = columns.fold((u32::MAX, 0), |(l, r), x| (l.min(x), r.max(x + 1)));
        Some([left, top, right, bottom])
    }

    /// Values of row `y`.
    pub(crate) fn row(&self, y: usize) -> &[bool] {
        let width = self.width as usize;
        &self.inside[y * width..][..width]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn levels_are_divided_in_f64() {
        let picture = Picture::Rgb8(RgbImage::from_pixel(1, 1, Rgb([0, 77, 255])));
        assert_eq!(picture.value(0, 0, 1), 77.0 / 255.0);
        let mut row = [0.0; 3];
        picture.row_f64(0, 0, &mut row);
        assert_eq!(row, [0.0, 77.0 / 255.0, 1.0]);
    }

    #[test]
    fn bad_pixels_are_named() {
        let mut image = Rgb32FImage::from_pixel(4, 3, Rgb([0.5; 3]));
        assert_eq!(Picture::from(image.clone()).check(), Ok(()));
        image.get_pixel_mut(3, 2).0[1] = 1.5;
        let error = Picture::from(image.clone()).check().unwrap_err();
        assert!(error.to_string().starts_with("1.5 at x 3, y 2, channel 1"));
        image.get_pixel_mut(1, 2).0[2] = f32::NAN;
        let error = Picture::from(image).check().unwrap_err();
        assert!(error.to_string().starts_with("NaN at x 1, y 2, channel 2"));
        let empty = Picture::from(RgbImage::new(0, 5)).check();
        assert!(matches!(empty, Err(PictureError::Empty { .. })));
    }

    #[test]
    fn masks_shrink_by_whole_squares() {
        let mask = |rows: [&str; 4]| {
            let inside = rows.iter().flat_map(|row| row.bytes().map(|b| b == b'#'));
            Mask::new(6, 4, inside.collect()).unwrap()
        };
        let one_hole = mask(["######", "######", "####.#", "######"]);
        let within = mask(["......", ".##...", ".##...", "......"]);
        assert_eq!(one_hole.eroded(1, false), within);
        let beyond = mask(["######", "###...", "###...", "###..."]);
        assert_eq!(one_hole.eroded(1, true), beyond);
        assert_eq!(
            one_hole.halved().values(),
            [true, true, true, true, true, false]
        );
        assert_eq!(within.bounds(), Some([1, 1, 3, 3]));
        assert_eq!(within.eroded(1, false).bounds(), None);
        assert_eq!(within.eroded(9, true).count(), 0);
    }

    #[test]
    fn masks_need_a_value_a_pixel() {
        assert!(Mask::new(2, 2, vec![true; 3]).is_none());
        let mask = Mask::new(2, 1, vec![false, true]).unwrap();
        assert_eq!((mask.values(), mask.count()), ([false, true].as_slice(), 1));
    }
}
