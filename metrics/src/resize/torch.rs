//! `torch.nn.functional.interpolate(mode="bilinear", align_corners=False)` of f32 tensors.
//!
//! Positions and weights are f32 as in torch: f64 would shift the sampling positions of a wide picture by up to 2e-4
//! pixels.

use rayon::prelude::*;

use super::Size;

/// Source positions of one output coordinate: two neighbours and their weights.
struct LinearNeighbours {
    at: [usize; 2],
    weight: [f32; 2],
}

fn neighbours(inputs: usize, outputs: usize) -> Vec<LinearNeighbours> {
    let scale = inputs as f32 / outputs as f32;
    (0..outputs)
        .map(|i| {
            if inputs == outputs {
                return LinearNeighbours {
                    at: [i; 2],
                    weight: [1.0, 0.0],
                };
            }
            let position = (scale * (i as f32 + 0.5) - 0.5).max(0.0);
            let first = (position as usize).min(inputs - 1);
            let second = (position - first as f32).clamp(0.0, 1.0);
            LinearNeighbours {
                at: [first, (first + 1).min(inputs - 1)],
                weight: [1.0 - second, second],
            }
        })
        .collect()
}

/// Resizes interleaved RGB without antialiasing: uses four neighbours even when reducing.
pub(super) fn bilinear(picture: &[f32], from: Size, to: Size) -> Vec<f32> {
    let columns = neighbours(from.width, to.width);
    let rows = neighbours(from.height, to.height);
    let mut out = vec![0.0; 3 * to.width * to.height];
    out.par_chunks_exact_mut(3 * to.width)
        .zip(rows)
        .for_each(|(out, row)| {
            let [top, bottom] = row
                .at
                .map(|y| &picture[3 * from.width * y..][..3 * from.width]);
            for (out, column) in out.as_chunks_mut::<3>().0.iter_mut().zip(&columns) {
                *out = std::array::from_fn(|c| {
                    let [left, right] = column.at.map(|x| 3 * x + c);
                    let across =
                        |row: &[f32]| row[left] * column.weight[0] + row[right] * column.weight[1];
                    across(top) * row.weight[0] + across(bottom) * row.weight[1]
                });
            }
        });
    out
}

/// For each output coordinate, its first input coordinate and the weights starting there: a triangle as wide as the
/// reduction, or two pixels wide when enlarging.
fn triangles(inputs: usize, outputs: usize) -> Vec<(usize, Vec<f32>)> {
    let scale = inputs as f32 / outputs as f32;
    let support = scale.max(1.0);
    let inverse = if scale >= 1.0 { 1.0 / scale } else { 1.0 };
    (0..outputs)
        .map(|i| {
            let center = scale * (i as f32 + 0.5);
            let first = (center - support + 0.5).max(0.0) as usize;
            let end = ((center + support + 0.5) as usize).min(inputs);
            let mut weights: Vec<f32> = (first..end)
                .map(|at| (1.0 - ((at as f32 - center + 0.5) * inverse).abs()).max(0.0))
                .collect();
            let sum: f32 = weights.iter().sum();
            for weight in &mut weights {
                *weight /= sum;
            }
            (first, weights)
        })
        .collect()
}

/// Resizes interleaved RGB with antialiasing: first along x, then along y, with f32 in between.
pub(super) fn bilinear_antialias(picture: &[f32], from: Size, to: Size) -> Vec<f32> {
    let columns = triangles(from.width, to.width);
    let mut narrow = vec![0.0; 3 * to.width * from.height];
    narrow
        .par_chunks_exact_mut(3 * to.width)
        .zip(picture.par_chunks_exact(3 * from.width))
        .for_each(|(out, row)| {
            for (out, (first, weights)) in out.as_chunks_mut::<3>().0.iter_mut().zip(&columns) {
                let pixels = row[3 * first..].as_chunks::<3>().0;
                *out = std::array::from_fn(|c| {
                    let terms = pixels.iter().zip(weights);
                    terms.fold(0.0, |sum, (pixel, weight)| sum + pixel[c] * weight)
                });
            }
        });
    let mut out = vec![0.0; 3 * to.width * to.height];
    out.par_chunks_exact_mut(3 * to.width)
        .zip(triangles(from.height, to.height))
        .for_each(|(out, (first, weights))| {
            let rows = narrow[3 * to.width * first..].chunks_exact(3 * to.width);
            for (row, weight) in rows.zip(weights) {
                for (out, value) in out.iter_mut().zip(row) {
                    *out += value * weight;
                }
            }
        });
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    const fn size(width: usize, height: usize) -> Size {
        Size { width, height }
    }

    /// One row of grey as interleaved RGB.
    fn gray(values: &[f32]) -> Vec<f32> {
        values.iter().flat_map(|&v| [v; 3]).collect()
    }

    fn red(values: &[f32]) -> Vec<f32> {
        values.iter().step_by(3).copied().collect()
    }

    #[test]
    fn doubling_takes_quarters_and_repeats_the_border() {
        let out = bilinear(&gray(&[0.0, 1.0]), size(2, 1), size(4, 1));
        assert_eq!(red(&out), [0.0, 0.25, 0.75, 1.0]);
    }

    #[test]
    fn only_the_antialiased_one_sees_every_pixel_when_it_reduces() {
        // Nine pixels to three, whose centres are on pixels 1, 4 and 7. Four neighbours miss a
        // single bright pixel between them.
        let mut row = [0.0; 9];
        row[2] = 1.0;
        let plain = bilinear(&gray(&row), size(9, 1), size(3, 1));
        assert_eq!(red(&plain), [0.0; 3]);
        let filtered = red(&bilinear_antialias(&gray(&row), size(9, 1), size(3, 1)));
        // Triangles three pixels wide on each side: weights 2 3 2 1 (cut at the border) and 1 2 3 2 1.
        for (value, expected) in filtered.iter().zip([2.0 / 8.0, 1.0 / 9.0, 0.0]) {
            assert!((value - expected).abs() < 1e-6, "{filtered:?}");
        }
    }
}
