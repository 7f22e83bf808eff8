//! The map of local similarities, computed row by row and never stored as a whole.

use rayon::prelude::*;

use super::filter::Constants;
use super::spec::SsimSpec;
use super::strip::Strip;
use super::variant::SsimCovariance;
use crate::picture::Picture;
use crate::unavailable::Unavailable;

/// Rows of the map per task; each task filters 2 × radius additional rows.
const ROWS_PER_TASK: usize = 64;
/// Number of values of a row computed at a time, chosen so that the filtered rows under their windows stay in the L2
/// cache.
const VALUES_AT_A_TIME: usize = 512;

/// Applies `each` to every row of the map (interleaved channels); results are in row order.
pub(super) fn map_rows<T: Send>(
    form: &SsimSpec,
    prediction: &Picture,
    target: &Picture,
    each: impl Fn(usize, &[f64]) -> T + Sync,
) -> Result<Vec<T>, Unavailable> {
    let (map_width, map_height) = form.map_size(prediction.dimensions())?;
    let range = if form.form.range_of_data {
        let range = data_range(prediction).max(data_range(target));
        if range == 0.0 {
            let [a, b] = [prediction, target].map(|picture| picture.value(0, 0, 0));
            if (a == 0.0) == (b == 0.0) {
                return Err(Unavailable::NoRange);
            }
            // One picture is black, so the luminance factor is 0. The other factors are 0 / 0, but never above 1, so
            // the product counts as 0.
            let zeros = vec![0.0; map_width * form.channels()];
            return Ok((0..map_height).map(|y| each(y, &zeros)).collect());
        }
        range
    } else {
        1.0
    };
    let constants = Constants {
        c1: (form.k1 * range) * (form.k1 * range),
        c2: (0.03 * range) * (0.03 * range),
        covariance: form.covariance(),
        bounded: form.form.covariance == SsimCovariance::Bounded,
        guard: if form.form.guarded { 1e-8 } else { 0.0 },
    };
    let tasks: Vec<usize> = (0..map_height).step_by(ROWS_PER_TASK).collect();
    let results: Vec<Vec<T>> = tasks
        .into_par_iter()
        .map(|first| {
            let rows = first..(first + ROWS_PER_TASK).min(map_height);
            let (channels, length) = (form.channels(), map_width * form.channels());
            let mut map = vec![0.0; rows.len() * length];
            for left in (0..map_width).step_by(VALUES_AT_A_TIME / channels) {
                let columns = left..(left + VALUES_AT_A_TIME / channels).min(map_width);
                let mut strip = Strip::new(form, prediction, target, columns.clone());
                for y in 0..2 * form.radius {
                    strip.push(first + y);
                }
                for (y, row) in rows.clone().zip(map.chunks_exact_mut(length)) {
                    strip.push(y + 2 * form.radius);
                    let values = strip.map_row(y, constants);
                    row[columns.start * channels..columns.end * channels].copy_from_slice(values);
                }
            }
            let rows = rows.zip(map.chunks_exact(length));
            rows.map(|(y, row)| each(y, row)).collect()
        })
        .collect();
    Ok(results.into_iter().flatten().collect())
}

/// Maximum minus minimum over all pixels and channels.
fn data_range(picture: &Picture) -> f64 {
    let (width, height) = picture.dimensions();
    let mut row = vec![0.0; 3 * width as usize];
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for y in 0..height as usize {
        picture.row_f64(0, y, &mut row);
        for &value in &row {
            low = low.min(value);
            high = high.max(value);
        }
    }
    high - low
}
