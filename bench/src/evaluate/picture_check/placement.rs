//! Detects pictures that show the photograph at another size, or several times: crops and padding that were resized to
//! the target's size, and panels side by side.
//!
//! Only another size along one axis, or with the upper left corner in place, is evidence. If a method ignores motion
//! along the optical axis, its pictures have another size along both axes, about the middle.

use image::imageops::thumbnail;
use image::{GenericImageView, RgbImage};

use super::finding::PictureChange;
use crate::evaluate::gaussians::likeness::Likeness;
use crate::scoring::Region;

/// Width at which the place is searched, in pixels.
const SEARCH_WIDTH: u32 = 48;
/// Sizes of the photograph, relative to the picture, from which the search starts.
const STARTS: [f64; 9] = [0.5, 0.5625, 0.67, 0.75, 0.87, 1.0, 1.15, 1.33, 1.78];
/// Step sizes of the search, as fractions of the picture's size.
const STEPS: [f64; 6] = [0.04, 0.02, 0.01, 0.005, 0.0025, 0.001];
/// A place is compared only if the photograph then covers at least this share of the picture.
const MIN_COVERED: f64 = 0.5;
/// A picture counts as resized if its width or height changes by at least this fraction.
const MIN_RESIZED: f64 = 0.018;
/// Maximum offset of an edge that counts as unmoved, as a fraction of the picture's size.
const MAX_UNMOVED: f64 = 0.009;
/// Another place of the photograph in the picture is reported only if comparing them at this place, instead of unmoved,
/// gains at least this much, in dB.
const MIN_PLACE_GAIN_DB: f64 = 1.5;
/// Panels are reported only if a part of the picture is closer to the whole photograph than to the same part of the
/// photograph by at least this, in dB.
const MIN_PANEL_GAIN_DB: f64 = 3.0;

/// How the picture `shown` was altered, if it consists of panels, is a stretched crop or has been padded. It must have the
/// size of the photograph `seen`.
pub(super) fn placement_change(seen: &RgbImage, shown: &RgbImage) -> Option<PictureChange> {
    if seen.width() < SEARCH_WIDTH / 2 || seen.height() < SEARCH_WIDTH / 4 {
        return None;
    }
    if has_panels(seen, shown) {
        return Some(PictureChange::Panels);
    }
    let place = Place::of(seen, shown);
    place.change().filter(|_| place.is_significant(seen, shown))
}

/// Whether a half or a third of the picture shows the whole photograph.
fn has_panels(seen: &RgbImage, shown: &RgbImage) -> bool {
    let (width, height) = seen.dimensions();
    [(2, 1), (1, 2), (3, 1), (1, 3)]
        .into_iter()
        .any(|(across, down)| {
            let size = (width / across, height / down);
            let whole = Region::whole(size);
            let squeezed = thumbnail(seen, size.0, size.1);
            (0..across * down).any(|at| {
                let (x, y) = (at % across * size.0, at / across * size.1);
                let part = |of: &RgbImage| of.view(x, y, size.0, size.1).to_image();
                let panel = part(shown);
                let [as_panel, as_read] =
                    [squeezed.clone(), part(seen)].map(|seen| Likeness::of(&seen, whole, &panel));
                as_panel.is_better_than(&as_read)
                    && as_panel.gain_over(&as_read) >= MIN_PANEL_GAIN_DB
            })
        })
}

/// Where a picture shows the photograph. Per axis: the photograph's coordinate at the picture's middle, and the
/// difference of its coordinates between the picture's ends. The photograph's coordinates are −0.5..0.5.
#[derive(Debug, Clone, Copy, PartialEq)]
struct Place([[f64; 2]; 2]);

impl Place {
    const WHOLE: Self = Self([[0.0, 1.0]; 2]);

    fn of(seen: &RgbImage, shown: &RgbImage) -> Self {
        let (width, height) = seen.dimensions();
        let height = (SEARCH_WIDTH * height / width).max(1);
        let [seen, shown] = [seen, shown].map(|p| Grey::of(&thumbnail(p, SEARCH_WIDTH, height)));
        let error = |place: &Self| place.error(&seen, &shown).unwrap_or(f64::INFINITY);
        let better = |best: (f64, Self), place: Self| {
            let found = error(&place);
            if found < best.0 { (found, place) } else { best }
        };
        let starts = STARTS.iter().flat_map(|x| STARTS.map(|y| [*x, y]));
        let starts = starts.flat_map(|sizes| {
            let in_corner = sizes.map(|size| [(size - 1.0) / 2.0, size]);
            [Self(sizes.map(|size| [0.0, size])), Self(in_corner)]
        });
        let mut best = starts.fold((error(&Self::WHOLE), Self::WHOLE), better);
        for step in STEPS {
            loop {
                let before = best.0;
                for at in 0..4 {
                    for by in [-step, step] {
                        let mut place = best.1;
                        place.0[at / 2][at % 2] += by;
                        best = better(best, place);
                    }
                }
                if best.0 >= 0.999 * before {
                    break;
                }
            }
        }
        best.1
    }

    /// The photograph's pixel that a pixel of a picture shows, if any.
    fn source(&self, (x, y): (u32, u32), (width, height): (u32, u32)) -> Option<(f64, f64)> {
        let along = |[middle, across]: [f64; 2], at: u32, size: u32| {
            let size = f64::from(size);
            let place = middle + across * ((f64::from(at) + 0.5) / size - 0.5) + 0.5;
            (0.0..=1.0)
                .contains(&place)
                .then(|| (place * size - 0.5).clamp(0.0, size - 1.0))
        };
        Some((along(self.0[0], x, width)?, along(self.0[1], y, height)?))
    }

    /// The mean squared difference where picture and photograph overlap; `None` if they overlap too little.
    fn error(&self, seen: &Grey, shown: &Grey) -> Option<f64> {
        let (width, height) = shown.size;
        let [mut count, mut sum] = [0.0; 2];
        for y in 0..height {
            for x in 0..width {
                if let Some(at) = self.source((x, y), shown.size) {
                    count += 1.0;
                    sum += (seen.at(at) - shown.levels[(y * width + x) as usize]).powi(2);
                }
            }
        }
        (count >= MIN_COVERED * f64::from(width * height)).then(|| sum / count)
    }

    /// Whether `shown` is significantly closer to the photograph `seen` at this place than unmoved.
    fn is_significant(&self, seen: &RgbImage, shown: &RgbImage) -> bool {
        let whole = Region::whole(seen.dimensions());
        let (mut placed, mut as_read) = (shown.clone(), shown.clone());
        for (x, y, pixel) in placed.enumerate_pixels_mut() {
            if let Some((u, v)) = self.source((x, y), seen.dimensions()) {
                as_read.put_pixel(x, y, *seen.get_pixel(x, y));
                *pixel = *seen.get_pixel(u.round() as u32, v.round() as u32);
            }
        }
        let [placed, as_read] = [placed, as_read].map(|seen| Likeness::of(&seen, whole, shown));
        placed.is_better_than(&as_read) && placed.gain_over(&as_read) >= MIN_PLACE_GAIN_DB
    }

    /// The change that the place indicates. If the photograph is smaller along one axis, or towards the upper left
    /// corner, the picture was padded; if larger along one axis, cropped. `None` for a shift, or for another size along
    /// both axes about the middle, which motion along the optical axis also causes.
    fn change(&self) -> Option<PictureChange> {
        use PictureChange::{Cropped, Padded};
        let [x, y] = self.0.map(|axis| {
            let [first, last] = [-0.5, 0.5].map(|side| (side - axis[0]) / axis[1] - side);
            let is_kept = [first, last].map(|off| off.abs() < MAX_UNMOVED);
            let size = last - first;
            let change = if size < 0.0 { Padded } else { Cropped };
            let is_centred = axis[0].abs() < MAX_UNMOVED && size.abs() >= MIN_RESIZED;
            (is_kept, is_centred.then_some(change), size)
        });
        match [x, y] {
            [(_, change, _), ([true, true], ..)] | [([true, true], ..), (_, change, _)]
                if change.is_some() =>
            {
                change
            }
            [(a, _, width), (b, _, height)]
                if a[0]
                    && b[0]
                    && width.min(height) <= -MIN_RESIZED
                    && width.max(height) < MAX_UNMOVED =>
            {
                Some(Padded)
            }
            _ => None,
        }
    }
}

/// Green levels, normalised to mean 0 and standard deviation 1.
struct Grey {
    size: (u32, u32),
    levels: Vec<f64>,
}

impl Grey {
    fn of(picture: &RgbImage) -> Self {
        let levels: Vec<f64> = picture
            .pixels()
            .map(|pixel| f64::from(pixel.0[1]))
            .collect();
        let count = levels.len() as f64;
        let mean = levels.iter().sum::<f64>() / count;
        let variance = levels.iter().map(|v| (v - mean).powi(2)).sum::<f64>() / count;
        let deviation = variance.sqrt().max(1.0);
        Self {
            size: picture.dimensions(),
            levels: levels.iter().map(|v| (v - mean) / deviation).collect(),
        }
    }

    /// The level at a position, interpolated bilinearly.
    fn at(&self, (x, y): (f64, f64)) -> f64 {
        let (width, height) = self.size;
        let (left, top) = (x as u32, y as u32);
        let (right, bottom) = ((left + 1).min(width - 1), (top + 1).min(height - 1));
        let level = |x: u32, y: u32| self.levels[(y * width + x) as usize];
        let row =
            |y: u32| level(left, y) + (x - f64::from(left)) * (level(right, y) - level(left, y));
        row(top) + (y - f64::from(top)) * (row(bottom) - row(top))
    }
}

#[cfg(test)]
mod tests {
    use image::Rgb;
    use image::imageops::{FilterType, crop_imm, replace, resize};

    use super::*;

    /// Waves of several directions, shifted by `by`, with some noise.
    fn photograph(by: f64) -> RgbImage {
        RgbImage::from_fn(160, 96, |x, y| {
            let (u, v) = (f64::from(x) + by, f64::from(y));
            let wave =
                (u / 11.0 + v / 23.0).sin() + (u / 19.0 - v / 5.0).cos() + (u * v / 1500.0).sin();
            let hash = f64::from((x * 7919 + y * 104_729) % 17) * by.min(1.0);
            Rgb([0.0, 1.0, 2.0].map(|c| (120.0 + 25.0 * wave + hash + c) as u8))
        })
    }

    fn told(shown: &RgbImage) -> Option<PictureChange> {
        placement_change(&photograph(0.0), shown)
    }

    /// A part of a picture, resized to the size of all of it.
    fn stretched(picture: &RgbImage, [x, y, width, height]: [u32; 4]) -> RgbImage {
        let part = crop_imm(picture, x, y, width, height).to_image();
        resize(&part, 160, 96, FilterType::Triangle)
    }

    /// Pads a picture by its own mirror images before resizing it.
    fn padded(picture: &RgbImage, [left, right, top, bottom]: [u32; 4]) -> RgbImage {
        let mirrored = |at: u32, before: u32, size: u32| {
            let at = at.abs_diff(before);
            if at < size { at } else { 2 * size - 1 - at }
        };
        let (width, height) = (160 + left + right, 96 + top + bottom);
        let padded = RgbImage::from_fn(width, height, |x, y| {
            *picture.get_pixel(mirrored(x, left, 160), mirrored(y, top, 96))
        });
        resize(&padded, 160, 96, FilterType::Triangle)
    }

    #[test]
    fn crops_and_padding_that_were_resized_are_told() {
        let proper = photograph(0.5);
        assert_eq!(
            told(&stretched(&proper, [32, 0, 96, 96])),
            Some(PictureChange::Cropped)
        );
        for padding in [[6, 6, 0, 0], [0, 0, 12, 12], [0, 32, 0, 0], [0, 20, 0, 24]] {
            assert_eq!(
                told(&padded(&proper, padding)),
                Some(PictureChange::Padded),
                "{padding:?}"
            );
        }
    }

    #[test]
    fn panels_are_told() {
        let (proper, other) = (photograph(0.5), photograph(70.0));
        let mut beside = RgbImage::new(320, 96);
        replace(&mut beside, &other, 0, 0);
        replace(&mut beside, &proper, 160, 0);
        let mut above = RgbImage::new(160, 288);
        for (place, part) in [&other, &proper, &other].into_iter().enumerate() {
            replace(&mut above, part, 0, 96 * place as i64);
        }
        for panels in [beside, above] {
            let squeezed = resize(&panels, 160, 96, FilterType::Triangle);
            assert_eq!(told(&squeezed), Some(PictureChange::Panels));
        }
    }

    #[test]
    fn parallax_and_motion_along_the_axis_are_not() {
        let proper = photograph(0.5);
        let moved = stretched(&proper, [10, 6, 140, 84]);
        let away = padded(&proper, [10, 10, 6, 6]);
        let blurred = image::imageops::fast_blur(&proper, 4.0);
        let one_colour = RgbImage::from_pixel(160, 96, Rgb([90; 3]));
        for shown in [
            proper,
            photograph(7.0),
            photograph(40.0),
            moved,
            away,
            blurred,
            one_colour,
        ] {
            assert_eq!(told(&shown), None);
        }
    }
}
