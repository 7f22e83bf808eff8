//! Maps of a metric over a picture, as false-colour PNG and as EXR.

use std::path::{Path, PathBuf};

use image::{ImageBuffer, Luma, RgbImage};
use sharp_metrics::{Family, MetricKey, Picture, ScoreMap};

use crate::io::atomic_files::FileError;
use crate::io::rendering_files::{write_exr_channels, write_png};
use crate::report::error_map::false_colours;

/// One value per pixel; NaN where the metric is undefined.
pub type Values = ImageBuffer<Luma<f32>, Vec<f32>>;

/// Values at the two ends of the colour scale. The dark end always means "alike", the bright end "different".
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ColourScale {
    pub alike: f64,
    pub different: f64,
}

impl ColourScale {
    /// A scale from 0 to the smallest number of the form 1, 2 or 5 × 10ⁿ that no value exceeds; from 0 to 1 if all
    /// values are 0.
    pub fn from_zero(values: &Values) -> Self {
        let largest = values
            .as_raw()
            .iter()
            .filter(|v| v.is_finite())
            .fold(0.0_f64, |max, v| max.max(f64::from(*v)));
        Self {
            alike: 0.0,
            different: round_up(largest),
        }
    }

    /// SSIM's scale: 1 is alike, 0 and below is different.
    pub const SSIM: Self = Self {
        alike: 1.0,
        different: 0.0,
    };

    /// Position of a value on the scale: 0 at the dark end, 1 at the bright end; below 0 or above 1 if the value lies
    /// beyond the ends.
    pub fn share(&self, value: f32) -> f32 {
        ((f64::from(value) - self.alike) / (self.different - self.alike)) as f32
    }
}

/// The smallest 1, 2 or 5 × 10ⁿ that is at least `value`; 1 for 0.
fn round_up(value: f64) -> f64 {
    if value <= 0.0 {
        return 1.0;
    }
    let power = 10_f64.powi(value.log10().floor() as i32);
    let candidates = [power, 2.0 * power, 5.0 * power, 10.0 * power];
    let enough = candidates.into_iter().find(|top| *top >= value);
    enough.unwrap_or(10.0 * power)
}

/// Local values of a metric over a whole picture.
#[derive(Debug, Clone, PartialEq)]
pub struct LocalMap {
    /// The metric's key, or `difference`.
    pub key: String,
    /// Part of the file name that stands for the metric.
    pub alias: String,
    /// One value per pixel of the picture.
    pub values: Values,
    /// Meaning of the colours.
    pub scale: ColourScale,
}

impl LocalMap {
    /// |prediction − target|, averaged over the channels, 0..1. The pictures must have the same size.
    pub fn difference(prediction: &Picture, target: &Picture) -> Self {
        let (width, height) = target.dimensions();
        let values = Values::from_fn(width, height, |x, y| {
            let of = |c| (prediction.value(x, y, c) - target.value(x, y, c)).abs();
            Luma([((of(0) + of(1) + of(2)) / 3.0) as f32])
        });
        Self {
            key: "difference".to_owned(),
            alias: "difference".to_owned(),
            scale: ColourScale::from_zero(&values),
            values,
        }
    }

    /// The map of a metric at the picture's size: NaN where a window would extend beyond the border.
    pub fn of_metric(key: MetricKey, map: &ScoreMap, (width, height): (u32, u32)) -> Self {
        let (w, h) = map.values.dimensions();
        let values = if (w, h) == (width, height) {
            map.values.clone()
        } else {
            Values::from_fn(width, height, |x, y| {
                let at = |i: u32, n: u32| i.checked_sub(map.origin).filter(|i| *i < n);
                match (at(x, w), at(y, h)) {
                    (Some(x), Some(y)) => *map.values.get_pixel(x, y),
                    _ => Luma([f32::NAN]),
                }
            })
        };
        let ssim = key.family() == Family::Ssim;
        Self {
            key: key.to_string(),
            alias: key.alias(),
            scale: if ssim {
                ColourScale::SSIM
            } else {
                ColourScale::from_zero(&values)
            },
            values,
        }
    }

    /// The map in inferno colours, grey for NaN. Lightness grows in equal steps with the difference, so that the order
    /// of values is still visible in grey and to people with any form of colour blindness.
    fn picture(&self) -> RgbImage {
        false_colours(&self.values, |value| {
            (!value.is_nan()).then(|| self.scale.share(value))
        })
    }
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MapFiles {
    /// Path of the false-colour picture.
    pub png: PathBuf,
    /// Path of the file with the values, one f32 channel `Y` at the picture's size; NaN where the metric is undefined.
    pub exr: PathBuf,
}

/// Writes `FOLDER/NAME.<alias>.png` and `.exr`.
///
/// # Errors
/// The error names the file and the reason.
pub fn write_map(folder: &Path, name: &str, map: &LocalMap) -> Result<MapFiles, FileError> {
    let path = |extension| folder.join(format!("{name}.{}.{extension}", map.alias));
    let files = MapFiles {
        png: path("png"),
        exr: path("exr"),
    };
    write_png(&files.png, &map.picture())?;
    let (width, height) = map.values.dimensions();
    let size = (width as usize, height as usize);
    let channel = ("Y".to_owned(), map.values.as_raw().as_slice());
    write_exr_channels(&files.exr, size, &[channel])?;
    Ok(files)
}

#[cfg(test)]
mod tests {
    use sharp_metrics::{Scorer, Selection, Weights};

    use image::Rgb;

    use super::*;

    fn mean(map: &LocalMap) -> f64 {
        let known = map.values.as_raw().iter().filter(|v| !v.is_nan());
        let known: Vec<f64> = known.map(|v| f64::from(*v)).collect();
        known.iter().sum::<f64>() / known.len() as f64
    }

    #[test]
    fn scales_end_at_round_numbers() {
        for (value, top) in [
            (0.0, 1.0),
            (0.2, 0.2),
            (0.21, 0.5),
            (0.003, 0.005),
            (7.0, 10.0),
            (1.0, 1.0),
        ] {
            assert!((round_up(value) - top).abs() < 1e-12 * top, "{value}");
        }
        assert_eq!(ColourScale::SSIM.share(1.0), 0.0);
        assert_eq!(ColourScale::SSIM.share(0.25), 0.75);
    }

    #[test]
    fn differences_are_means_over_the_channels() {
        let picture = |rgb| Picture::from(RgbImage::from_pixel(3, 2, Rgb(rgb)));
        let map = LocalMap::difference(&picture([0, 51, 255]), &picture([102, 51, 204]));
        assert!((mean(&map) - 0.2).abs() < 1e-7);
        assert_eq!(map.values.dimensions(), (3, 2));
        assert!((map.scale.different - 0.2).abs() < 1e-7 || map.scale.different == 0.5);
    }

    #[test]
    fn a_map_without_border_lies_where_its_windows_do_and_averages_to_the_score() {
        let picture = |seed: u32| {
            Picture::from(RgbImage::from_fn(40, 30, |x, y| {
                Rgb([(x * 7 + y * seed) as u8, (x * y) as u8, (x + seed) as u8])
            }))
        };
        let (a, b) = (picture(3), picture(11));
        let selection = Selection::parse("ssim-all").unwrap();
        let scorer = Scorer::new(&selection, &Weights::none()).unwrap();
        let all = scorer.examine(&a, &b, None, true).unwrap();
        for ((key, score), (_, map)) in all.scores.iter().zip(&all.maps) {
            let map = LocalMap::of_metric(*key, map.as_ref().unwrap(), (40, 30));
            assert_eq!(map.values.dimensions(), (40, 30));
            assert!((mean(&map) - score.clone().unwrap()).abs() < 1e-6, "{key}");
            let corner = map.values.get_pixel(0, 0).0[0].is_nan();
            assert_eq!(
                map.picture().get_pixel(0, 0).0 == [0xB8, 0xBE, 0xC6],
                corner,
                "{key}"
            );
            let inner = key.alias().contains("valid") || key.alias().contains("uniform7");
            assert_eq!(corner, inner, "{key}");
        }
    }
}
