//! Losses of a rendered picture and its depth (paper, objectives: color, alpha, depth).

use super::{Channels, InverseDepthUnits, Loss, LossOptions, MaskNormalization, sign, sum_over};
use rayon::prelude::*;

impl LossOptions {
    /// Weight of each kept pixel of a picture.
    fn share(&self, pixels: usize, mask: Option<&[bool]>) -> f64 {
        let counted = match (self.mask_normalization, mask) {
            (MaskNormalization::MaskedPixels, Some(mask)) => mask.iter().filter(|m| **m).count(),
            _ => pixels,
        };
        1.0 / (counted.max(1) as f64)
    }
}

/// E_p |Î − I| over channels of sRGB-encoded pictures, restricted to `mask`; gradient with respect to Î.
///
/// # Panics
/// If lengths differ.
pub fn color(
    predicted: &[[f32; 3]],
    target: &[[f32; 3]],
    mask: Option<&[bool]>,
    options: &LossOptions,
) -> Loss<[f32; 3]> {
    let pixels = predicted.len();
    assert_eq!(target.len(), pixels, "pixels of the target");
    assert!(
        mask.is_none_or(|mask| mask.len() == pixels),
        "pixels of the mask"
    );
    let share = options.share(pixels, mask)
        * match options.color_channels {
            Channels::Mean => 1.0 / 3.0,
            Channels::Sum => 1.0,
        };
    sum_over(pixels, |p| {
        if mask.is_some_and(|mask| !mask[p]) {
            return (0.0, [0.0; 3]);
        }
        let d = [0, 1, 2].map(|c: usize| f64::from(predicted[p][c]) - f64::from(target[p][c]));
        let value = d.iter().map(|d| d.abs()).sum::<f64>() * share;
        (value, d.map(|d| (sign(d) * share) as f32))
    })
}

/// E_p of the cross-entropy between the rendered alpha (0..1) and 1, i.e. −log Â, restricted to `mask`.
///
/// # Panics
/// If lengths differ.
pub fn alpha(alpha: &[f32], mask: Option<&[bool]>, options: &LossOptions) -> Loss<f32> {
    assert!(
        mask.is_none_or(|mask| mask.len() == alpha.len()),
        "pixels of the mask"
    );
    let share = options.share(alpha.len(), mask);
    sum_over(alpha.len(), |p| {
        if mask.is_some_and(|mask| !mask[p]) {
            return (0.0, 0.0);
        }
        let a = f64::from(alpha[p]);
        if a < options.alpha_floor {
            return (-options.alpha_floor.ln() * share, 0.0);
        }
        (-a.ln() * share, (-share / a) as f32)
    })
}

/// E_p |1/D̄₁ − 1/D|; gradient with respect to D̄₁, the predicted first layer after alignment.
/// Depths are in metres.
///
/// A true depth of +∞ has inverse 0. A true depth of 0 is unknown and counts as a difference of
/// zero. `nearest` is the depth in metres that [`InverseDepthUnits::Normalized`] maps to 1.
///
/// # Panics
/// If lengths differ.
pub fn depth(predicted: &[f32], truth: &[f32], nearest: f64, options: &LossOptions) -> Loss<f32> {
    assert_eq!(truth.len(), predicted.len(), "pixels of the true depth");
    let unit = match options.depth_units {
        InverseDepthUnits::Metric => 1.0,
        InverseDepthUnits::Normalized => nearest,
    };
    let share = unit / predicted.len().max(1) as f64;
    sum_over(predicted.len(), |p| {
        let known = truth[p] > 0.0;
        if !known {
            return (0.0, 0.0);
        }
        let inverse = 1.0 / f64::from(predicted[p]);
        let d = inverse - 1.0 / f64::from(truth[p]);
        let gradient = -inverse * inverse * sign(d) * share;
        (d.abs() * share, gradient as f32)
    })
}

/// Converts the gradient with respect to an sRGB-encoded picture to the gradient with respect to
/// its linear values, which [`sharp::color::srgb_from_linear`] encoded. The slope is finite
/// everywhere: 12.92 below 0.0031308, including negative values.
///
/// # Panics
/// If lengths differ.
pub fn linear_from_srgb_gradient(linear: &[[f32; 3]], gradient: &[[f32; 3]]) -> Vec<[f32; 3]> {
    assert_eq!(gradient.len(), linear.len(), "pixels of the gradient");
    let slope = |x: f32| {
        if x <= 0.003_130_8 {
            12.92
        } else {
            1.055 / 2.4 * x.powf(1.0 / 2.4 - 1.0)
        }
    };
    let pixels = linear.par_iter().zip(gradient).with_min_len(super::CHUNK);
    pixels
        .map(|(linear, gradient)| [0, 1, 2].map(|c: usize| slope(linear[c]) * gradient[c]))
        .collect()
}

#[cfg(test)]
mod tests {
    use super::super::testing::{check, noise, pixels};
    use super::*;
    use sharp::color::srgb_from_linear;

    #[test]
    fn hand_cases_of_colour() {
        let (a, b) = ([[0.5, 0.25, 1.0], [0.0; 3]], [[0.25, 0.25, 0.0], [1.0; 3]]);
        let options = LossOptions::default();
        let all = color(&a, &b, None, &options);
        assert!((all.value - (1.25 + 3.0) / 6.0).abs() < 1e-15);
        let sixth = 1.0 / 6.0;
        assert_eq!(all.gradient, [[sixth, 0.0, sixth], [-sixth; 3]]);
        let mask = [true, false];
        let masked = color(&a, &b, Some(&mask), &options);
        assert!((masked.value - 1.25 / 6.0).abs() < 1e-15);
        assert_eq!(masked.gradient[1], [0.0; 3]);
        let options = LossOptions {
            color_channels: Channels::Sum,
            mask_normalization: MaskNormalization::MaskedPixels,
            ..options
        };
        assert_eq!(color(&a, &b, Some(&mask), &options).value, 1.25);
        let nothing = color(&a, &b, Some(&[false; 2]), &options);
        assert_eq!((nothing.value, nothing.gradient), (0.0, vec![[0.0; 3]; 2]));
    }

    #[test]
    fn holes_of_alpha_have_a_value_and_no_gradient() {
        let loss = alpha(&[1.0, 0.5, 0.0], None, &LossOptions::default());
        assert!((loss.value - (2.0_f64.ln() + 6.0 * 10.0_f64.ln()) / 3.0).abs() < 1e-12);
        assert_eq!(loss.gradient, [-1.0 / 3.0, -2.0 / 3.0, 0.0]);
    }

    #[test]
    fn unknown_depth_is_left_out_and_sky_has_inverse_zero() {
        let loss = depth(
            &[2.0, 2.0, 4.0, 1.0],
            &[0.0, f32::INFINITY, 2.0, 1.0],
            3.0,
            &LossOptions::default(),
        );
        assert_eq!(loss.value, (0.5 + 0.25) / 4.0);
        assert_eq!(loss.gradient, [0.0, -0.25 / 4.0, 1.0 / 64.0, 0.0]);
        let options = LossOptions {
            depth_units: InverseDepthUnits::Normalized,
            ..LossOptions::default()
        };
        assert_eq!(depth(&[4.0], &[2.0], 3.0, &options).value, 0.75);
    }

    #[test]
    fn gradients_are_those_of_the_definitions() {
        let options = LossOptions::default();
        let mask: Vec<bool> = noise(3, 60).iter().map(|v| *v > 0.3).collect();
        let (a, b) = (noise(1, 180), noise(2, 180));
        let of = |x: &[f64]| {
            let each = x.iter().zip(&b).enumerate();
            let kept = each.filter(|(i, _)| mask[i / 3]);
            kept.map(|(_, (x, b))| (x - f64::from(*b)).abs())
                .sum::<f64>()
                / 180.0
        };
        let loss = color(&pixels(&a), &pixels(&b), Some(&mask), &options);
        check(&a, loss.value, loss.gradient.as_flattened(), of);

        let a = noise(4, 60);
        let of = |x: &[f64]| {
            let kept = x.iter().zip(&mask).filter(|(_, m)| **m);
            kept.map(|(x, _)| -x.ln()).sum::<f64>() / 60.0
        };
        let loss = alpha(&a, Some(&mask), &options);
        check(&a, loss.value, &loss.gradient, of);

        let of = |x: &[f64]| {
            let each = x.iter().zip(&b);
            each.map(|(x, b)| (1.0 / x - 1.0 / f64::from(*b)).abs())
                .sum::<f64>()
                / 60.0
        };
        let loss = depth(&a, &b[..60], 1.0, &options);
        check(&a, loss.value, &loss.gradient, of);
    }

    #[test]
    fn the_slope_is_the_encodings_and_finite_for_every_light() {
        let ones = [[1.0; 3]];
        for x in [-2.0_f32, -0.01, 0.0, 0.002, 0.01, 0.3, 1.0, 1.7, 40.0] {
            let h = 1e-3 * x.abs().max(0.01);
            let difference = (srgb_from_linear(x + h) - srgb_from_linear(x - h)) / (2.0 * h);
            let slope = linear_from_srgb_gradient(&[[x; 3]], &ones)[0][1];
            assert!(
                (slope / difference - 1.0).abs() < 2e-3,
                "{x}: {slope} {difference}"
            );
        }
        for x in [f32::MIN, f32::MAX, f32::INFINITY, f32::NEG_INFINITY] {
            assert!(linear_from_srgb_gradient(&[[x; 3]], &ones)[0][0].is_finite());
        }
    }
}
