//! Windows, shifts and the mean image.

use std::str::FromStr;

use image::{Rgb, RgbImage, imageops};

/// Shifts in per cent of the width, ascending.
#[derive(Debug, Clone, PartialEq)]
pub struct Shifts(Vec<f64>);

/// Why a list of shifts cannot be used.
#[derive(Debug, Clone, PartialEq, thiserror::Error)]
pub enum ShiftsError {
    /// The text is not a list of numbers.
    #[error("'{0}' is not a list of percentages; try 0.1,1,5")]
    Text(String),
    /// A shift is out of range.
    #[error("{0} %: expected a shift above 0 and up to 50 per cent")]
    Range(f64),
    /// The picture is too small for the window to move.
    #[error("the picture is only {0} pixels wide, so the window would be narrower than two pixels")]
    Small(u32),
}

impl Shifts {
    /// The shifts in the paper.
    pub const PAPER: [f64; 3] = [0.1, 1.0, 5.0];

    pub fn percent(&self) -> &[f64] {
        &self.0
    }

    pub fn are_the_papers(&self) -> bool {
        self.0 == Self::PAPER
    }
}

impl FromStr for Shifts {
    type Err = ShiftsError;

    fn from_str(text: &str) -> Result<Self, ShiftsError> {
        let number = |part: &str| {
            let value: Result<f64, _> = part.trim().trim_end_matches('%').trim().parse();
            value.map_err(|_| ShiftsError::Text(text.to_owned()))
        };
        let mut shifts: Vec<f64> = text.split(',').map(number).collect::<Result<_, _>>()?;
        if let Some(&wrong) = shifts.iter().find(|s| !(**s > 0.0 && **s <= 50.0)) {
            return Err(ShiftsError::Range(wrong));
        }
        shifts.sort_by(f64::total_cmp);
        shifts.dedup();
        Ok(Self(shifts))
    }
}

/// A picture and a window that moves to the right over it.
#[derive(Debug)]
pub struct Windows<'a> {
    picture: &'a RgbImage,
    /// Width and height of the window, in pixels.
    pub size: (u32, u32),
}

impl<'a> Windows<'a> {
    /// The largest window that can be moved by each of the shifts.
    ///
    /// # Errors
    /// If the window would be narrower than two pixels.
    pub fn new(picture: &'a RgbImage, shifts: &Shifts) -> Result<Self, ShiftsError> {
        let (width, height) = picture.dimensions();
        let largest = shifts.0.last().copied().unwrap_or(0.0);
        let margin = (largest * f64::from(width) / 100.0).ceil() as u32;
        if width < margin + 2 {
            return Err(ShiftsError::Small(width));
        }
        Ok(Self {
            picture,
            size: (width - margin, height),
        })
    }

    /// Converts a shift to pixels.
    pub fn pixels(&self, percent: f64) -> f64 {
        percent * f64::from(self.picture.width()) / 100.0
    }

    /// The window at the picture's left edge.
    pub fn reference(&self) -> RgbImage {
        imageops::crop_imm(self.picture, 0, 0, self.size.0, self.size.1).to_image()
    }

    /// The window moved by `pixels`, linearly interpolated between pixels and rounded to 8 bits.
    pub fn shifted(&self, pixels: f64) -> RgbImage {
        let whole = pixels.floor();
        let share = pixels - whole;
        let first = whole as u32;
        RgbImage::from_fn(self.size.0, self.size.1, |x, y| {
            let at = |step: u32| self.picture.get_pixel(x + step, y).0;
            let near = at(first);
            if share == 0.0 {
                return Rgb(near);
            }
            let far = at(first + 1);
            Rgb(std::array::from_fn(|c| {
                let value = f64::from(near[c]) * (1.0 - share) + f64::from(far[c]) * share;
                value.round() as u8
            }))
        })
    }
}

/// A picture of one colour: the mean of each channel's sRGB levels, rounded.
pub fn mean_image(picture: &RgbImage) -> RgbImage {
    let mut sums = [0_u64; 3];
    for pixel in picture.pixels() {
        for (sum, level) in sums.iter_mut().zip(pixel.0) {
            *sum += u64::from(level);
        }
    }
    let count = f64::from(picture.width()) * f64::from(picture.height());
    let mean = sums.map(|sum| (sum as f64 / count).round() as u8);
    RgbImage::from_pixel(picture.width(), picture.height(), Rgb(mean))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn ramp(width: u32, height: u32) -> RgbImage {
        RgbImage::from_fn(width, height, |x, y| Rgb([x as u8, y as u8, (x + y) as u8]))
    }

    #[test]
    fn a_shift_on_a_ramp_adds_itself() {
        let picture = ramp(200, 50);
        let shifts: Shifts = "5, 0.1,1%".parse().unwrap();
        assert!(shifts.are_the_papers());
        let windows = Windows::new(&picture, &shifts).unwrap();
        assert_eq!(windows.size, (190, 50));
        assert_eq!(windows.pixels(0.1), 0.2);
        assert_eq!(windows.reference().get_pixel(189, 7), &Rgb([189, 7, 196]));
        assert_eq!(windows.shifted(10.0).get_pixel(189, 7), &Rgb([199, 7, 206]));
        // 0.2 of a level rounds to zero, 0.6 does not.
        assert_eq!(windows.shifted(0.2), windows.reference());
        assert_eq!(windows.shifted(2.6).get_pixel(0, 0), &Rgb([3, 0, 3]));
    }

    #[test]
    fn means_are_rounded_and_cover_the_picture() {
        let mut picture = RgbImage::from_pixel(2, 2, Rgb([10, 0, 255]));
        picture.put_pixel(0, 0, Rgb([13, 1, 255]));
        let mean = mean_image(&picture);
        assert!(mean.pixels().all(|p| *p == Rgb([11, 0, 255])));
        assert_eq!(mean.dimensions(), (2, 2));
    }

    #[test]
    fn shifts_without_sense_are_refused() {
        for text in ["", "a", "0", "-1", "51", "nan", "1,,2"] {
            assert!(text.parse::<Shifts>().is_err(), "{text}");
        }
        let shifts: Shifts = "50".parse().unwrap();
        assert!(Windows::new(&ramp(3, 9), &shifts).is_err());
        assert!(Windows::new(&ramp(4, 9), &shifts).is_ok());
    }
}
