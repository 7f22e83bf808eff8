//! The reference, the shifted pictures and the mean image side by side, their scores below: what the numbers are of.

use image::{Rgb, RgbImage, imageops};

use super::experiment::Experiment;
use crate::report::column::Column;
use crate::report::pictures::{fitted, reduced};
use sharp_plots::ink::{INK, MUTED};
use sharp_plots::text::{Weight, write};

/// Longest side of a picture, pixels.
const TILE: u32 = 440;
const GAP: u32 = 12;
const SIZE: f64 = 23.0;
const LINE: u32 = 30;

/// One row of pictures; the reference first.
pub fn strip(experiment: &Experiment) -> RgbImage {
    let (width, height) = fitted(experiment.reference.dimensions(), TILE);
    let keys = experiment.keys();
    let columns = 1 + experiment.comparisons.len() as u32;
    let text_lines = 1 + keys.len() as u32;
    let mut sheet = RgbImage::from_pixel(
        GAP + columns * (width + GAP),
        GAP + height + (LINE * text_lines).max(LINE) + GAP,
        Rgb([255; 3]),
    );
    let mut place = |column: u32, picture: &RgbImage, lines: &[String]| {
        let left = GAP + column * (width + GAP);
        let small = reduced(picture, TILE);
        imageops::replace(&mut sheet, &small, i64::from(left), i64::from(GAP));
        for (i, line) in lines.iter().enumerate() {
            let at = (left, GAP + height + LINE * (i as u32 + 1) - 6);
            let (weight, ink) = if i == 0 {
                (Weight::Bold, INK)
            } else {
                (Weight::Regular, MUTED)
            };
            write(&mut sheet, line, at, SIZE, weight, ink);
        }
    };
    place(0, &experiment.reference, &["Reference".to_owned()]);
    for (i, comparison) in experiment.comparisons.iter().enumerate() {
        let mut lines = vec![comparison.label()];
        lines.extend(keys.iter().map(|key| {
            let column = Column::from(*key);
            let value = comparison.score(*key).map(|v| column.shown(v));
            let value = value.unwrap_or_else(|| "unavailable".to_owned());
            format!("{} {value}", column.label)
        }));
        place(i as u32 + 1, &comparison.picture, &lines);
    }
    sheet
}
