//! Local values of a metric, which show where two pictures differ.

use image::{ImageBuffer, Luma};
use rayon::prelude::*;

/// Value of a metric at each pixel.
#[derive(Debug, Clone, PartialEq)]
pub struct ScoreMap {
    /// Local values of the metric, one per pixel.
    pub values: ImageBuffer<Luma<f32>, Vec<f32>>,
    /// Column and row of the picture's pixel to which the first value belongs: 0 if the map covers
    /// the whole picture, larger if the metric has no values near the border.
    pub origin: u32,
}

/// Local values of one layer, row-major.
#[derive(Debug, Clone, Default, PartialEq)]
pub(crate) struct TapMap {
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) values: Vec<f32>,
}

/// Position of an output pixel between two input pixels: index of the first, index of the second, weight of the second.
type Position = (usize, usize, f64);

/// Bilinear positions with pixel centres at halves (PyTorch's `align_corners=False`).
fn positions(inputs: usize, outputs: usize) -> Vec<Position> {
    let scale = inputs as f64 / outputs as f64;
    (0..outputs)
        .map(|i| {
            let at = ((i as f64 + 0.5) * scale - 0.5).max(0.0);
            let first = (at as usize).min(inputs - 1);
            (first, (first + 1).min(inputs - 1), at - first as f64)
        })
        .collect()
}

/// Resizes the maps to `width` × `height`, adds them, and applies `each` to every row of the sum; results are in row
/// order.
pub(crate) fn summed_rows<T: Send>(
    maps: &[TapMap],
    (width, height): (usize, usize),
    each: impl Fn(usize, &[f64]) -> T + Sync,
) -> Vec<T> {
    let axes: Vec<(Vec<Position>, Vec<Position>)> = maps
        .iter()
        .map(|map| (positions(map.width, width), positions(map.height, height)))
        .collect();
    (0..height)
        .into_par_iter()
        .map_init(
            || vec![0.0; width],
            |sum, y| {
                sum.fill(0.0);
                for (map, (columns, rows)) in maps.iter().zip(&axes) {
                    let (first, second, share) = rows[y];
                    let row = |y: usize| &map.values[y * map.width..][..map.width];
                    let (upper, lower) = (row(first), row(second));
                    for (sum, &(left, right, across)) in sum.iter_mut().zip(columns) {
                        let mix = |row: &[f32]| {
                            let (l, r) = (f64::from(row[left]), f64::from(row[right]));
                            l * (1.0 - across) + r * across
                        };
                        *sum += mix(upper) * (1.0 - share) + mix(lower) * share;
                    }
                }
                each(y, sum)
            },
        )
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn halves_and_borders() {
        // Two columns enlarged to four: the outer ones equal the edges, the inner ones are mixed 3
        // : 1.
        let map = TapMap {
            width: 2,
            height: 1,
            values: vec![0.0, 4.0],
        };
        let rows = summed_rows(&[map.clone(), map], (4, 3), |_, row| row.to_vec());
        assert_eq!(rows, vec![vec![0.0, 2.0, 6.0, 8.0]; 3]);
    }
}
