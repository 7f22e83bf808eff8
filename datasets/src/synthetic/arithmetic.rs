//! Replacements for libm functions whose last bits differ between machines.

use std::f64::consts::FRAC_PI_2;
use std::sync::LazyLock;

/// Cosine and sine of an angle given in turns, by a Taylor series on an eighth of a turn; exact to about 1e-16.
pub(super) fn unit_circle(turns: f64) -> (f64, f64) {
    let quarter = (turns * 4.0 + 0.5).floor();
    let x = (turns * 4.0 - quarter) * FRAC_PI_2;
    let x2 = x * x;
    // Coefficients ±1/n!, innermost first.
    let cosine = series(x2, 16.0);
    let sine = x * series(x2, 17.0);
    match quarter.rem_euclid(4.0) as u8 {
        0 => (cosine, sine),
        1 => (-sine, cosine),
        2 => (-cosine, -sine),
        _ => (sine, -cosine),
    }
}

/// Horner form of 1 − x²/(n−1)n·(1 − …): the series of the cosine if `highest` is even, the series
/// of the sine divided by x if it is odd.
fn series(x2: f64, highest: f64) -> f64 {
    let mut sum = 1.0;
    let mut n = highest;
    while n > 1.5 {
        sum = 1.0 - x2 / (n * (n - 1.0)) * sum;
        n -= 2.0;
    }
    sum
}

/// The largest integer not above `x`, for |x| < 2⁶³. On processors with only SSE2, `f64::floor`
/// would be a function call.
pub(super) fn floor(x: f64) -> f64 {
    let towards_zero = x as i64 as f64;
    towards_zero - f64::from(u8::from(towards_zero > x))
}

/// sRGB code, 0 to 255, of linear light (clamped to 0..1), rounded to nearest.
pub(super) fn srgb_level(linear: f64) -> u8 {
    const CELLS: usize = 16_384;
    // The code at the lower end of each cell, and at the upper end of the last one.
    static ENDS: LazyLock<Vec<u8>> = LazyLock::new(|| {
        let ends = 0..=CELLS;
        ends.map(|i| computed_level(i as f64 / CELLS as f64))
            .collect()
    });
    let x = linear.clamp(0.0, 1.0);
    let cell = ((x * CELLS as f64) as usize).min(CELLS - 1);
    if ENDS[cell] == ENDS[cell + 1] {
        ENDS[cell]
    } else {
        computed_level(x)
    }
}

/// sRGB code of linear light in 0..1. The power 5/12 is computed as two square roots and a cube root.
fn computed_level(x: f64) -> u8 {
    let encoded = if x <= 0.003_130_8 {
        12.92 * x
    } else {
        let fourth_root = x.sqrt().sqrt();
        let squared = fourth_root * fourth_root;
        1.055 * cube_root(squared * squared * fourth_root) - 0.055
    };
    (encoded * 255.0 + 0.5).floor() as u8
}

/// Newton's iteration for positive numbers, from an initial guess that divides the exponent by three.
fn cube_root(a: f64) -> f64 {
    // 2/3 of the exponent's bias, in the exponent's bit position.
    const TWO_THIRDS_OF_BIAS: u64 = (1023_u64 << 52) / 3 * 2;
    let mut y = f64::from_bits(a.to_bits() / 3 + TWO_THIRDS_OF_BIAS);
    for _ in 0..5 {
        y = (2.0 * y + a / (y * y)) / 3.0;
    }
    y
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_circle_agrees_with_libm() {
        for i in -50..150 {
            let turns = f64::from(i) / 37.0;
            let (c, s) = unit_circle(turns);
            let angle = turns * std::f64::consts::TAU;
            assert!((c - angle.cos()).abs() < 1e-14, "{turns}");
            assert!((s - angle.sin()).abs() < 1e-14, "{turns}");
        }
    }

    #[test]
    fn encoding_agrees_with_the_projects_own() {
        use sharp::color::{Quantization, linear_from_srgb, quantize, srgb_from_linear};
        for level in 0..=255_u8 {
            let linear = linear_from_srgb(f32::from(level) / 255.0);
            assert_eq!(srgb_level(f64::from(linear)), level);
        }
        for i in 0..10_000 {
            let x = f64::from(i) / 9_999.0;
            let other = quantize(srgb_from_linear(x as f32), Quantization::Round);
            assert!(srgb_level(x).abs_diff(other) <= 1, "{x}");
            assert_eq!(srgb_level(x), computed_level(x));
        }
    }

    #[test]
    fn floors_agree_with_the_standard_library() {
        for i in -4_000..4_000 {
            let x = f64::from(i) * 0.125;
            assert_eq!(floor(x), x.floor());
            assert_eq!(floor(x * 1e9), (x * 1e9).floor());
        }
    }

    #[test]
    fn cube_roots_are_exact_to_rounding() {
        for i in 1..1000 {
            let x = f64::from(i) / 1000.0;
            assert!((cube_root(x * x * x) - x).abs() < 1e-15, "{x}");
        }
    }
}
