//! PIL's `Image.resize` (version 13): antialiased by widening the filter, along one axis after the
//! other.
//!
//! 8-bit pictures use PIL's fixed-point arithmetic (22-bit weights, rounded to 8 bits after each pass) and are
//! bit-identical. Floats use PIL's 32-bit path (mode `F`: f64 weights and sums, f32 after each pass).

use rayon::prelude::*;

use super::Size;

/// A filter and its radius at scale 1, in pixels.
pub(super) struct Filter {
    value: fn(f64) -> f64,
    support: f64,
}

/// The triangle filter.
pub(super) const BILINEAR: Filter = Filter {
    value: |x| (1.0 - x.abs()).max(0.0),
    support: 1.0,
};

/// Keys' cubic filter with a = −0.5.
pub(super) const BICUBIC: Filter = Filter {
    value: cubic,
    support: 2.0,
};

/// A sinc, windowed by the central lobe of a sinc that is three times as wide.
pub(super) const LANCZOS: Filter = Filter {
    value: lanczos,
    support: 3.0,
};

fn cubic(x: f64) -> f64 {
    const A: f64 = -0.5;
    let x = x.abs();
    if x < 1.0 {
        ((A + 2.0) * x - (A + 3.0)) * x * x + 1.0
    } else if x < 2.0 {
        (((x - 5.0) * x + 8.0) * x - 4.0) * A
    } else {
        0.0
    }
}

fn lanczos(x: f64) -> f64 {
    let sinc = |x: f64| {
        if x == 0.0 {
            return 1.0;
        }
        let x = x * std::f64::consts::PI;
        x.sin() / x
    };
    if (-3.0..3.0).contains(&x) {
        sinc(x) * sinc(x / 3.0)
    } else {
        0.0
    }
}

/// Value type of a channel, with PIL's arithmetic for it.
pub(super) trait PillowSample: Copy + Default + Send + Sync {
    type Weight: Send + Sync;

    /// Converts a weight; the weights sum to one.
    fn weight(value: f64) -> Self::Weight;

    fn sum<'a>(weights: &[Self::Weight], values: impl Iterator<Item = &'a Self>) -> Self
    where
        Self: 'a;
}

/// Fractional bits of the fixed-point weights.
const BITS: u32 = 22;

impl PillowSample for u8 {
    type Weight = i32;

    fn weight(value: f64) -> i32 {
        (value * f64::from(1_u32 << BITS) + 0.5_f64.copysign(value)) as i32
    }

    fn sum<'a>(weights: &[i32], values: impl Iterator<Item = &'a Self>) -> Self {
        let half = 1 << (BITS - 1);
        let terms = weights.iter().zip(values);
        let sum = terms.fold(half, |sum: i32, (weight, &value)| {
            sum + weight * i32::from(value)
        });
        (sum >> BITS).clamp(0, 255) as Self
    }
}

impl PillowSample for f32 {
    type Weight = f64;

    fn weight(value: f64) -> f64 {
        value
    }

    fn sum<'a>(weights: &[f64], values: impl Iterator<Item = &'a Self>) -> Self {
        let terms = weights.iter().zip(values);
        terms.fold(0.0, |sum, (weight, &value)| sum + f64::from(value) * weight) as Self
    }
}

/// Resizes interleaved RGB to `to`. A side whose length does not change is not filtered.
pub(super) fn resize<T: PillowSample>(
    picture: &[T],
    from: Size,
    to: Size,
    filter: &Filter,
) -> Vec<T> {
    let between = if vertical_first(from, to) {
        Size {
            width: from.width,
            height: to.height,
        }
    } else {
        Size {
            width: to.width,
            height: from.height,
        }
    };
    [between, to]
        .into_iter()
        .scan(from, |now, next| Some((std::mem::replace(now, next), next)))
        .fold(picture.to_vec(), |picture, (now, next)| {
            if now.width != next.width {
                along_x(&picture, now, next.width, filter)
            } else if now.height != next.height {
                along_y(&picture, now.height, next, filter)
            } else {
                picture
            }
        })
}

/// Since version 13, PIL filters along y first if the height loses more than twice as many pixels as the width. The
/// order affects 8-bit pictures, which are rounded between the passes. Pictures at most twice as tall as wide give the
/// same result in every version if their aspect ratio is preserved.
fn vertical_first(from: Size, to: Size) -> bool {
    let lost = |from: usize, to: usize| from as i64 - to as i64;
    let (rows, columns) = (lost(from.height, to.height), lost(from.width, to.width));
    rows > 0 && rows > 2 * columns
}

fn along_x<T: PillowSample>(picture: &[T], from: Size, width: usize, filter: &Filter) -> Vec<T> {
    let columns = taps::<T>(from.width, width, filter);
    let mut out = vec![T::default(); 3 * width * from.height];
    out.par_chunks_exact_mut(3 * width)
        .zip(picture.par_chunks_exact(3 * from.width))
        .for_each(|(out, row)| {
            for (out, (first, weights)) in out.as_chunks_mut::<3>().0.iter_mut().zip(&columns) {
                *out = std::array::from_fn(|c| {
                    T::sum(weights, row[3 * first + c..].iter().step_by(3))
                });
            }
        });
    out
}

fn along_y<T: PillowSample>(
    picture: &[T],
    from_height: usize,
    to: Size,
    filter: &Filter,
) -> Vec<T> {
    let stride = 3 * to.width;
    let mut out = vec![T::default(); stride * to.height];
    out.par_chunks_exact_mut(stride)
        .zip(taps::<T>(from_height, to.height, filter))
        .for_each(|(out, (first, weights))| {
            for (i, out) in out.iter_mut().enumerate() {
                *out = T::sum(
                    &weights,
                    picture[stride * first + i..].iter().step_by(stride),
                );
            }
        });
    out
}

/// For each output pixel, its first input pixel and the weights starting there.
fn taps<T: PillowSample>(
    inputs: usize,
    outputs: usize,
    filter: &Filter,
) -> Vec<(usize, Vec<T::Weight>)> {
    let scale = inputs as f64 / outputs as f64;
    let widening = scale.max(1.0);
    let (support, narrowing) = (filter.support * widening, 1.0 / widening);
    (0..outputs)
        .map(|i| {
            let center = (i as f64 + 0.5) * scale;
            let first = (center - support + 0.5).max(0.0) as usize;
            let end = ((center + support + 0.5) as usize).min(inputs);
            let weights: Vec<f64> = (first..end)
                .map(|at| (filter.value)((at as f64 - center + 0.5) * narrowing))
                .collect();
            let sum: f64 = weights.iter().sum();
            (
                first,
                weights
                    .iter()
                    .map(|weight| T::weight(weight / sum))
                    .collect(),
            )
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn filters_have_their_values() {
        for (filter, points) in [
            (
                BILINEAR,
                [(0.0, 1.0), (0.5, 0.5), (-0.25, 0.75), (1.0, 0.0)],
            ),
            (
                BICUBIC,
                [(0.0, 1.0), (0.5, 0.5625), (-1.5, -0.0625), (2.0, 0.0)],
            ),
            (
                LANCZOS,
                [
                    (0.0, 1.0),
                    (0.5, 0.607_927_1),
                    (-1.5, -0.135_094_9),
                    (3.0, 0.0),
                ],
            ),
        ] {
            for (x, expected) in points {
                let value = (filter.value)(x);
                assert!(
                    (value - expected).abs() < 1e-7,
                    "{value} at {x}, not {expected}"
                );
            }
        }
    }

    #[test]
    fn weights_are_rounded_away_from_zero() {
        assert_eq!(u8::weight(0.25 / f64::from(1 << BITS)), 0);
        assert_eq!(u8::weight(0.5 / f64::from(1 << BITS)), 1);
        assert_eq!(u8::weight(-0.5 / f64::from(1 << BITS)), -1);
    }

    #[test]
    fn tall_losses_go_first() {
        for (from, to, expected) in [
            ((64, 300), (128, 150), true),
            ((36, 80), (18, 43), true),
            ((196, 100), (192, 92), false),
            ((1024, 768), (341, 256), false),
            ((42, 163), (86, 167), false),
        ] {
            assert_eq!(
                vertical_first(from.into(), to.into()),
                expected,
                "{from:?} {to:?}"
            );
        }
    }

    #[test]
    fn a_swing_beyond_white_is_clamped_in_bytes_only() {
        let row = [0_u8, 0, 0, 255, 255, 255, 255, 255, 255];
        let (from, to) = (
            Size {
                width: 3,
                height: 1,
            },
            Size {
                width: 6,
                height: 1,
            },
        );
        let bytes = resize(&row, from, to, &BICUBIC);
        assert_eq!(bytes.iter().max(), Some(&255));
        let floats = resize(&row.map(|v| f32::from(v) / 255.0), from, to, &BICUBIC);
        assert!(floats.iter().any(|&v| v > 1.01) && floats.iter().any(|&v| v < -0.01));
    }
}
