//! OpenCV's `resize` with `INTER_AREA`, if neither side grows: each output pixel is the mean over the area that it
//! covers, in f32; bytes are rounded half to even.

use rayon::prelude::*;

use super::Size;

/// Value type of a channel, with OpenCV's rounding.
pub(super) trait AreaSample: Copy + Default + Send + Sync {
    fn to_f32(self) -> f32;

    fn of(mean: f32) -> Self;

    /// Mean of two by two pixels, for which OpenCV has special code.
    fn mean_of_four(of: [Self; 4]) -> Self;
}

impl AreaSample for u8 {
    fn to_f32(self) -> f32 {
        f32::from(self)
    }

    fn of(mean: f32) -> Self {
        mean.round_ties_even() as Self
    }

    fn mean_of_four(of: [Self; 4]) -> Self {
        ((of.iter().map(|&v| u32::from(v)).sum::<u32>() + 2) >> 2) as Self
    }
}

impl AreaSample for f32 {
    fn to_f32(self) -> f32 {
        self
    }

    fn of(mean: f32) -> Self {
        mean
    }

    fn mean_of_four([a, b, c, d]: [Self; 4]) -> Self {
        (a + b + c + d) * 0.25
    }
}

/// Reduces interleaved RGB from size `from` to size `to`; neither side of `to` may exceed that of
/// `from`.
pub(super) fn shrink<T: AreaSample>(picture: &[T], from: Size, to: Size) -> Vec<T> {
    let mut out = vec![T::default(); 3 * to.width * to.height];
    let (scale_x, scale_y) = (scale(from.width, to.width), scale(from.height, to.height));
    if let (Some(cell_x), Some(cell_y)) = (whole(scale_x), whole(scale_y)) {
        out.par_chunks_exact_mut(3 * to.width)
            .enumerate()
            .for_each(|(y, out)| cells(picture, from.width, (cell_x, cell_y), y, out));
        return out;
    }
    let columns = shares(from.width, to.width, scale_x);
    out.par_chunks_exact_mut(3 * to.width)
        .zip(shares(from.height, to.height, scale_y))
        .for_each(|(out, rows)| {
            let mut sums = vec![0.0_f32; out.len()];
            let mut line = vec![0.0_f32; out.len()];
            for (y, share) in rows {
                let row = &picture[3 * from.width * y..][..3 * from.width];
                across(row, &columns, &mut line);
                for (sum, value) in sums.iter_mut().zip(&line) {
                    *sum += share * value;
                }
            }
            for (out, sum) in out.iter_mut().zip(sums) {
                *out = T::of(sum);
            }
        });
    out
}

/// Input pixels per output pixel, rounded as in OpenCV, which chooses its code path by this value.
fn scale(inputs: usize, outputs: usize) -> f64 {
    1.0 / (outputs as f64 / inputs as f64)
}

/// The scale as an integer; `None` if it is not whole.
fn whole(scale: f64) -> Option<usize> {
    let nearest = scale.round_ties_even();
    ((scale - nearest).abs() < f64::EPSILON).then_some(nearest as usize)
}

/// Computes row `y` of the output if each output pixel covers a cell of whole input pixels.
fn cells<T: AreaSample>(
    picture: &[T],
    width: usize,
    (cell_x, cell_y): (usize, usize),
    y: usize,
    out: &mut [T],
) {
    let share = 1.0 / (cell_x * cell_y) as f32;
    for (i, out) in out.iter_mut().enumerate() {
        let (x, c) = (i / 3 * cell_x, i % 3);
        let at = |dx: usize, dy: usize| picture[3 * (width * (y * cell_y + dy) + x + dx) + c];
        *out = if (cell_x, cell_y) == (2, 2) {
            T::mean_of_four([at(0, 0), at(1, 0), at(0, 1), at(1, 1)])
        } else {
            let cell = (0..cell_y).flat_map(|dy| (0..cell_x).map(move |dx| (dx, dy)));
            T::of(cell.map(|(dx, dy)| at(dx, dy).to_f32()).sum::<f32>() * share)
        };
    }
}

/// For each output pixel, the input pixels that it covers, with their shares of its width. As in
/// OpenCV, shares are computed in f64, rounded to f32, and ignored if below a thousandth of a
/// pixel.
fn shares(inputs: usize, outputs: usize, scale: f64) -> Vec<Vec<(usize, f32)>> {
    const NOTHING: f64 = 1e-3;
    (0..outputs)
        .map(|i| {
            let start = i as f64 * scale;
            let end = start + scale;
            let width = scale.min(inputs as f64 - start);
            let last = (end.floor() as usize).min(inputs - 1);
            let first = (start.ceil() as usize).min(last);
            let mut shares = Vec::with_capacity(last - first + 2);
            if first as f64 - start > NOTHING {
                shares.push((first - 1, ((first as f64 - start) / width) as f32));
            }
            shares.extend((first..last).map(|at| (at, (1.0 / width) as f32)));
            if end - last as f64 > NOTHING {
                let rest = (end - last as f64).min(1.0).min(width);
                shares.push((last, (rest / width) as f32));
            }
            shares
        })
        .collect()
}

fn across<T: AreaSample>(row: &[T], columns: &[Vec<(usize, f32)>], line: &mut [f32]) {
    for (out, shares) in line.as_chunks_mut::<3>().0.iter_mut().zip(columns) {
        *out = [0.0; 3];
        for &(x, share) in shares {
            for (c, out) in out.iter_mut().enumerate() {
                *out += row[3 * x + c].to_f32() * share;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn gray(values: &[u8]) -> Vec<u8> {
        values.iter().flat_map(|&v| [v; 3]).collect()
    }

    const fn row(width: usize) -> Size {
        Size { width, height: 1 }
    }

    #[test]
    fn whole_cells_are_means_rounded_to_even() {
        let out = shrink(&gray(&[1, 2, 2, 3, 10, 20]), row(6), row(3));
        // 1.5 → 2, 2.5 → 2, 15.
        assert_eq!(out, gray(&[2, 2, 15]));
    }

    #[test]
    fn two_by_two_rounds_halves_up() {
        let picture = gray(&[1, 2, 2, 3, 0, 0, 1, 1]);
        let (from, to) = (
            Size {
                width: 4,
                height: 2,
            },
            Size {
                width: 2,
                height: 1,
            },
        );
        // (1+2+0+0)/4 = 0.75, (2+3+1+1)/4 = 1.75.
        assert_eq!(shrink(&picture, from, to), gray(&[1, 2]));
        let half = gray(&[1, 1, 0, 0, 2, 1, 2, 1]);
        let square = Size {
            width: 2,
            height: 4,
        };
        // Rows (1 1 / 0 0) → 0.5 → 1; (2 1 / 2 1) → 1.5 → 2.
        assert_eq!(
            shrink(
                &half,
                square,
                Size {
                    width: 1,
                    height: 2
                }
            ),
            gray(&[1, 2])
        );
    }

    #[test]
    fn fractions_weigh_by_area() {
        let values = [0.0_f32, 0.3, 0.6, 0.9, 0.6].map(|v| [v; 3]).concat();
        let out = shrink(&values, row(5), row(2));
        // 2.5 pixels each: (0 + 0.3 + 0.6/2)/2.5 and (0.6/2 + 0.9 + 0.6)/2.5.
        for (value, expected) in out.iter().step_by(3).zip([0.24, 0.72]) {
            assert!((value - expected).abs() < 1e-6, "{out:?}");
        }
    }
}
