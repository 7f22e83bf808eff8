//! Finds the colour with which a renderer filled a picture where it drew nothing: holes, or a background.
//!
//! Such pixels show nothing of how the picture was stored, so the tests of levels and channels leave them out.

use std::ops::RangeInclusive;

use image::RgbImage;

/// A colour counts as filled in only if this share of the pixels has exactly this colour, as have the pixels to the
/// right and below. With a larger share, too little of the picture is left to examine.
const SHARE: RangeInclusive<f64> = 0.02..=0.9;
/// A filled pixel differs from the photograph if some channel differs by more than this, in levels.
const MIN_OFF: u8 = 16;
/// A colour counts as filled in only if at least this share of its pixels differ from the photograph.
const MIN_SHARE_OFF: f64 = 0.8;
/// Pixels at most this far from a filled one are left out as well, because antialiasing blends them with its colour.
const REACH: u32 = 2;
/// Pixels are left out only if at least this share of the picture remains.
const MIN_REMAINING: f64 = 0.1;

/// The commonest of the exactly constant colours in a picture; `None` unless it fills enough of the picture where the
/// photograph clearly has other colours.
pub(super) fn filled_colour(photograph: &RgbImage, picture: &RgbImage) -> Option<[u8; 3]> {
    if photograph.dimensions() != picture.dimensions() {
        return None;
    }
    let mut flat: Vec<([u8; 3], bool)> = Vec::new();
    for (x, y, pixel) in picture.enumerate_pixels() {
        let is_equal = |x, y| picture.get_pixel_checked(x, y) == Some(pixel);
        if is_equal(x + 1, y) && is_equal(x, y + 1) {
            let seen = photograph.get_pixel(x, y).0.into_iter().zip(pixel.0);
            let mut off = seen.map(|(seen, shown)| seen.abs_diff(shown));
            flat.push((pixel.0, off.any(|off| off > MIN_OFF)));
        }
    }
    flat.sort_unstable();
    let of_colour = flat.chunk_by(|a, b| a.0 == b.0).max_by_key(|of| of.len())?;
    let off = of_colour.iter().filter(|(_, is_off)| *is_off).count() as f64;
    let share = of_colour.len() as f64 / picture.pixels().len() as f64;
    let is_filled = SHARE.contains(&share) && off >= MIN_SHARE_OFF * of_colour.len() as f64;
    is_filled.then_some(of_colour[0].0)
}

/// A photograph and a picture of its size without the pixels near those of a colour in the picture. The other pixels
/// follow one another in rows of the same width. `None` if too few remain.
pub(super) fn without(
    colour: [u8; 3],
    [photograph, picture]: [&RgbImage; 2],
) -> Option<[RgbImage; 2]> {
    let (width, height) = picture.dimensions();
    let mut is_near = vec![false; picture.pixels().len()];
    for (x, y, _) in picture.enumerate_pixels().filter(|(.., p)| p.0 == colour) {
        for y in y.saturating_sub(REACH)..(y + REACH + 1).min(height) {
            let row = (y * width) as usize;
            let (left, right) = (x.saturating_sub(REACH), (x + REACH + 1).min(width));
            is_near[row + left as usize..row + right as usize].fill(true);
        }
    }
    let kept: Vec<u32> = (0..width * height)
        .filter(|at| !is_near[*at as usize])
        .collect();
    let rows = kept.len() as u32 / width;
    let is_enough = rows > 0 && kept.len() as f64 >= MIN_REMAINING * is_near.len() as f64;
    is_enough.then(|| {
        [photograph, picture].map(|of| {
            RgbImage::from_fn(width, rows, |x, y| {
                let at = kept[(y * width + x) as usize];
                *of.get_pixel(at % width, at / width)
            })
        })
    })
}

#[cfg(test)]
mod tests {
    use image::Rgb;

    use super::super::change::{is_unlike, likely_change};
    use super::super::finding::PictureChange;
    use super::*;

    /// Waves below a bright sky with clouds, or below a sky of one colour.
    fn view(by: f64, sky: Option<[u8; 3]>) -> RgbImage {
        RgbImage::from_fn(96, 96, |x, y| {
            let (u, v) = ((f64::from(x) + by) / 7.0, f64::from(y) / 9.0);
            let wave = |phase: f64| (u + phase).sin() + (v + 0.3 * u + 2.0 * phase).cos();
            let land = [0.0, 0.9, 2.4].map(|phase| (90.0 + 40.0 * wave(phase)) as u8);
            let clouds = [165.0, 195.0, 235.0].map(|level| (level + 9.0 * wave(0.0)) as u8);
            Rgb(match sky {
                _ if 5 * y + x / 8 > 200 => land,
                Some(colour) => colour,
                None => clouds,
            })
        })
    }

    #[test]
    fn a_background_of_one_colour_is_no_other_change() {
        let photograph = view(0.0, None);
        for colour in [[127; 3], [0; 3], [255, 0, 255], [0, 255, 0], [49, 77, 121]] {
            let shown = view(1.0, Some(colour));
            assert_eq!(filled_colour(&photograph, &shown), Some(colour));
            assert_eq!(likely_change(&photograph, &shown), None, "{colour:?}");
            assert!(!is_unlike(&photograph, &shown), "{colour:?}");
            // Changes of the rest are still told.
            let mut swapped = shown.clone();
            swapped.pixels_mut().for_each(|pixel| pixel.0.swap(0, 2));
            let found = likely_change(&photograph, &swapped);
            assert_eq!(found, Some(PictureChange::Bgr), "{colour:?}");
        }
        // Proper pictures, and a sky of its mean colour.
        for proper in [view(1.0, None), view(1.0, Some([165, 195, 235]))] {
            assert_eq!(filled_colour(&photograph, &proper), None);
            assert_eq!(likely_change(&photograph, &proper), None);
        }
    }
}
