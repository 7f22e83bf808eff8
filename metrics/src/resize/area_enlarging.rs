//! OpenCV's `resize` with `INTER_AREA` where a side grows: two neighbours a side, the second of which
//! counts only for the part of the output pixel that lies on it.
//!
//! Bytes go through OpenCV's fixed point: 11-bit weights a side, truncated between the sides.

use rayon::prelude::*;

use super::Size;
use super::area::scale;

/// Two neighbours and their weights.
struct AreaNeighbours {
    at: [usize; 2],
    weight: [f32; 2],
}

fn neighbours(inputs: usize, outputs: usize) -> Vec<AreaNeighbours> {
    let (scale, inverse) = (scale(inputs, outputs), outputs as f64 / inputs as f64);
    (0..outputs)
        .map(|i| {
            let first = (i as f64 * scale).floor();
            let over = ((i + 1) as f64 - (first + 1.0) * inverse) as f32;
            let second = if over <= 0.0 {
                0.0
            } else {
                over - over.floor()
            };
            let first = (first as usize).min(inputs - 1);
            AreaNeighbours {
                at: [first, (first + 1).min(inputs - 1)],
                weight: [1.0 - second, second],
            }
        })
        .collect()
}

/// Interleaved RGB of floats.
pub(super) fn of_f32(picture: &[f32], from: Size, to: Size) -> Vec<f32> {
    each(picture, from, to, |[[a, b], [c, d]], column, row| {
        (a * column[0] + b * column[1]) * row[0] + (c * column[0] + d * column[1]) * row[1]
    })
}

/// Interleaved RGB of bytes.
pub(super) fn of_u8(picture: &[u8], from: Size, to: Size) -> Vec<u8> {
    let fixed = |weight: [f32; 2]| weight.map(|w| (w * 2048.0).round_ties_even() as i32);
    each(picture, from, to, |pixels, column, row| {
        let (column, row) = (fixed(column), fixed(row));
        let [top, bottom] = pixels.map(|pair| {
            let [left, right] = pair.map(i32::from);
            left * column[0] + right * column[1]
        });
        let part = |sum: i32, weight: i32| (weight * (sum >> 4)) >> 16;
        ((part(top, row[0]) + part(bottom, row[1]) + 2) >> 2) as u8
    })
}

/// Each output value from its four neighbours, row by row, and the weights along x and y.
fn each<T: Copy + Default + Send + Sync>(
    picture: &[T],
    from: Size,
    to: Size,
    blend: impl Fn([[T; 2]; 2], [f32; 2], [f32; 2]) -> T + Sync,
) -> Vec<T> {
    let columns = neighbours(from.width, to.width);
    let mut out = vec![T::default(); 3 * to.width * to.height];
    out.par_chunks_exact_mut(3 * to.width)
        .zip(neighbours(from.height, to.height))
        .for_each(|(out, row)| {
            let rows = row
                .at
                .map(|y| &picture[3 * from.width * y..][..3 * from.width]);
            for (out, column) in out.as_chunks_mut::<3>().0.iter_mut().zip(&columns) {
                *out = std::array::from_fn(|c| {
                    let pixels = rows.map(|row| column.at.map(|x| row[3 * x + c]));
                    blend(pixels, column.weight, row.weight)
                });
            }
        });
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn whole_factors_repeat_pixels() {
        let (from, to) = (
            Size {
                width: 2,
                height: 1,
            },
            Size {
                width: 6,
                height: 2,
            },
        );
        let out = of_u8(&[7, 8, 9, 200, 100, 50], from, to);
        let row = [
            [7, 8, 9],
            [7, 8, 9],
            [7, 8, 9],
            [200, 100, 50],
            [200, 100, 50],
            [200, 100, 50],
        ];
        assert_eq!(out, [row, row].concat().concat());
    }

    #[test]
    fn an_output_pixel_over_two_is_shared_between_them() {
        let (from, to) = (
            Size {
                width: 2,
                height: 1,
            },
            Size {
                width: 3,
                height: 1,
            },
        );
        let out = of_f32(&[0.0, 0.0, 0.0, 1.0, 1.0, 1.0], from, to);
        // The middle pixel covers 1/3 of the way to either side: half of it lies on the second.
        assert_eq!(out, [[0.0; 3], [0.5; 3], [1.0; 3]].concat());
    }
}
