//! Max pooling and DISTS's L2 pooling over a range of rows.

use std::ops::Range;

use rayon::prelude::*;

use super::rows::{Rows, Size};

/// Max pooling of size `kernel`, stride 2: output rows `rows` into `out`. Windows are cut at the
/// lower and right border.
pub(crate) fn max_pool(
    kernel: usize,
    input: Rows,
    rows: Range<usize>,
    output: Size,
    out: &mut [f32],
) {
    let channels = output.channels;
    par_rows(rows, output, out, |y, out| {
        let last = (2 * y + kernel).min(input.size.height);
        for ky in 2 * y..last {
            let row = input.row(ky);
            for (x, out) in out.chunks_exact_mut(channels).enumerate() {
                let end = (2 * x + kernel).min(input.size.width);
                for kx in 2 * x..end {
                    let values = &row[kx * channels..][..channels];
                    if ky == 2 * y && kx == 2 * x {
                        out.copy_from_slice(values);
                    } else {
                        maximum(out, values);
                    }
                }
            }
        }
    });
}

fn maximum(out: &mut [f32], values: &[f32]) {
    for (out, &value) in out.iter_mut().zip(values) {
        // Plain comparison: features are never NaN, and it is one instruction.
        *out = if value > *out { value } else { *out };
    }
}

/// DISTS's pooling: the root of 1e-12 plus the squares under a 3×3 Hann window ([1 2 1] ⊗ [1 2 1]
/// / 16), stride 2, zero padding 1.
pub(crate) fn l2_pool(input: Rows, rows: Range<usize>, output: Size, out: &mut [f32]) {
    let channels = output.channels;
    let inside = |center: usize, n: usize| {
        (0..3_usize).filter_map(move |k| {
            let at = (center + k).checked_sub(1)?;
            (at < n).then_some((at, if k == 1 { 2.0_f32 } else { 1.0 }))
        })
    };
    par_rows(rows, output, out, |y, out| {
        out.fill(0.0);
        for (ky, vertical) in inside(2 * y, input.size.height) {
            let row = input.row(ky);
            for (x, out) in out.chunks_exact_mut(channels).enumerate() {
                for (kx, horizontal) in inside(2 * x, input.size.width) {
                    let weight = vertical * horizontal / 16.0;
                    add_squares(weight, &row[kx * channels..][..channels], out);
                }
            }
        }
        for out in out {
            *out = (*out + 1e-12).sqrt();
        }
    });
}

fn add_squares(weight: f32, values: &[f32], out: &mut [f32]) {
    for (out, &value) in out.iter_mut().zip(values) {
        *out += weight * (value * value);
    }
}

/// Runs `each(y, row of out)` for all rows in parallel.
fn par_rows(
    rows: Range<usize>,
    output: Size,
    out: &mut [f32],
    each: impl Fn(usize, &mut [f32]) + Sync,
) {
    out.par_chunks_mut(output.row_len())
        .zip(rows)
        .for_each(|(out, y)| each(y, out));
}
