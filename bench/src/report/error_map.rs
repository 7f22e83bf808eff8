//! Prediction errors as pictures: mean absolute error over the channels, in false colour.
//!
//! The colours are matplotlib's *inferno* (S. van der Walt and N. Smith, CC0), approximated by the sixth-degree
//! polynomials that M. Zucker fitted to them (CC0). Equal steps of error look like equal steps, and larger errors stay
//! brighter if the picture is converted to grey.

use image::{ImageBuffer, Luma, Rgb, RgbImage};

use super::error::MissingPicture;
use super::pictures::reduced;

/// Polynomial coefficients, in ascending order of power, each for red, green and blue.
const INFERNO: [[f64; 3]; 7] = [
    [
        0.0002189403691192265,
        0.001651004631001012,
        -0.01948089843709184,
    ],
    [0.1065134194856116, 0.5639564367884091, 3.932712388889277],
    [11.60249308247187, -3.972853965665698, -15.9423941062914],
    [-41.70399613139459, 17.43639888205313, 44.35414519872813],
    [77.162935699427, -33.40235894210092, -81.80730925738993],
    [-71.31942824499214, 32.62606426397723, 73.20951985803202],
    [25.13112622477341, -12.24266895238567, -23.07032500287172],
];

/// The colour at `share` of the scale's range, clamped to 0..1; NaN has the brightest colour.
pub fn colour(share: f32) -> Rgb<u8> {
    let t = if share.is_nan() {
        1.0
    } else {
        f64::from(share).clamp(0.0, 1.0)
    };
    let mut rgb = [0_u8; 3];
    for (c, value) in rgb.iter_mut().enumerate() {
        let sum = INFERNO
            .iter()
            .rev()
            .fold(0.0, |sum, power| sum * t + power[c]);
        *value = (sum.clamp(0.0, 1.0) * 255.0).round() as u8;
    }
    Rgb(rgb)
}

/// Colours a map. `share` returns a value's position in the range of the scale, or `None` for values to show in grey.
pub fn false_colours(
    map: &ImageBuffer<Luma<f32>, Vec<f32>>,
    share: impl Fn(f32) -> Option<f32>,
) -> RgbImage {
    RgbImage::from_fn(map.width(), map.height(), |x, y| {
        match share(map.get_pixel(x, y).0[0]) {
            Some(share) => colour(share),
            None => Rgb([0xB8, 0xBE, 0xC6]),
        }
    })
}

/// The scale as a CSS gradient, dark on the left.
pub fn css_gradient() -> String {
    let stops: Vec<String> = (0..=16)
        .map(|i| {
            let Rgb([r, g, b]) = colour(i as f32 / 16.0);
            format!("#{r:02x}{g:02x}{b:02x}")
        })
        .collect();
    format!("linear-gradient(to right,{})", stops.join(","))
}

/// |prediction − target| per pixel in 0..1, averaged over the three channels.
///
/// # Errors
/// If the sizes differ.
pub fn absolute_error(
    prediction: &RgbImage,
    target: &RgbImage,
) -> Result<ImageBuffer<Luma<f32>, Vec<f32>>, MissingPicture> {
    if prediction.dimensions() != target.dimensions() {
        return Err(MissingPicture::Sizes {
            prediction: prediction.dimensions(),
            target: target.dimensions(),
        });
    }
    let (width, height) = target.dimensions();
    Ok(ImageBuffer::from_fn(width, height, |x, y| {
        let (p, t) = (prediction.get_pixel(x, y).0, target.get_pixel(x, y).0);
        let differences = p.into_iter().zip(t).map(|(a, b)| u16::from(a.abs_diff(b)));
        Luma([f32::from(differences.sum::<u16>()) / 765.0])
    }))
}

/// The error in colour, with `max` at the top of the scale, reduced to fit `side` pixels. Before colouring, errors are
/// averaged over those pixels that are `scored`. A reduced pixel is [`hatched`] if it covers mostly pixels that are not
/// scored.
///
/// # Errors
/// If the sizes differ.
pub fn picture(
    prediction: &RgbImage,
    target: &RgbImage,
    scored: impl Fn(u32, u32) -> bool,
    max: f32,
    side: u32,
) -> Result<RgbImage, MissingPicture> {
    let error = absolute_error(prediction, target)?;
    Ok(averaged(error, scored, MIN_SCORED, side, |error| {
        colour(error / max)
    }))
}

/// A reduced pixel is hatched if less than this share of the pixels that it covers is scored.
const MIN_SCORED: f32 = 0.5;

/// Values in colour, reduced to fit `side` pixels by averaging over scored pixels. A reduced pixel is [`hatched`] if
/// the share of scored pixels that it covers is below `min_scored`.
pub(super) fn averaged(
    mut error: ImageBuffer<Luma<f32>, Vec<f32>>,
    scored: impl Fn(u32, u32) -> bool,
    min_scored: f32,
    side: u32,
    colour: impl Fn(f32) -> Rgb<u8>,
) -> RgbImage {
    let (width, height) = error.dimensions();
    let weight = ImageBuffer::from_fn(width, height, |x, y| {
        Luma([f32::from(u8::from(scored(x, y)))])
    });
    for (error, weight) in error.iter_mut().zip(weight.iter()) {
        *error *= weight;
    }
    let (error, weight) = (reduced(&error, side), reduced(&weight, side));
    let (width, height) = error.dimensions();
    RgbImage::from_fn(width, height, |x, y| {
        let (error, weight) = (error.get_pixel(x, y).0[0], weight.get_pixel(x, y).0[0]);
        if weight < min_scored {
            hatched(x, y)
        } else {
            colour(error / weight)
        }
    })
}

/// How the error changed between two predictions: vermilion where it grew, blue where it shrank, grey where it is
/// equal. The scale ends at ±`max`. Like [`picture`], the result is reduced to fit `side` pixels, and hatched where
/// pixels are not scored.
///
/// # Errors
/// If the sizes differ.
pub fn change(
    [before, after]: [&RgbImage; 2],
    target: &RgbImage,
    scored: impl Fn(u32, u32) -> bool,
    max: f32,
    side: u32,
) -> Result<RgbImage, MissingPicture> {
    let before = absolute_error(before, target)?;
    let mut change = absolute_error(after, target)?;
    for (change, before) in change.iter_mut().zip(before.iter()) {
        *change -= before;
    }
    Ok(averaged(change, scored, MIN_SCORED, side, |grown| {
        diverging(grown / max)
    }))
}

/// Okabe and Ito's vermilion for 1 and above, their blue for −1 and below, and mixtures with grey in between.
fn diverging(share: f32) -> Rgb<u8> {
    let end = if share > 0.0 {
        [0xD5, 0x5E, 0x00]
    } else {
        [0x00, 0x72, 0xB2]
    };
    let share = share.abs().min(1.0);
    Rgb(end.map(|end| (240.0 + (f32::from(end as u8) - 240.0) * share).round() as u8))
}

/// The scale of [`change`] as a CSS gradient, blue on the left.
pub fn change_gradient() -> String {
    let stops = [-1.0, 0.0, 1.0].map(|share| {
        let Rgb([r, g, b]) = diverging(share);
        format!("#{r:02x}{g:02x}{b:02x}")
    });
    format!("linear-gradient(to right,{})", stops.join(","))
}

/// Grey stripes for pixels that are not scored; no colour scale contains them.
pub fn hatched(x: u32, y: u32) -> Rgb<u8> {
    if ((x + y) / 4).is_multiple_of(2) {
        Rgb([104; 3])
    } else {
        Rgb([148; 3])
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_scale_runs_from_black_to_pale_yellow_and_grows_lighter() {
        // The ends of inferno are (0.001, 0.000, 0.014) and (0.988, 0.998, 0.645); the polynomials differ by up to
        // 4/255.
        assert!(colour(0.0).0.iter().all(|c| *c <= 2), "{:?}", colour(0.0));
        let Rgb([r, g, b]) = colour(1.0);
        assert!(r.abs_diff(252) <= 4 && g.abs_diff(255) <= 4 && b.abs_diff(164) <= 4);
        let light = |i: i32| {
            let Rgb([r, g, b]) = colour(i as f32 / 64.0);
            0.2126 * f64::from(r) + 0.7152 * f64::from(g) + 0.0722 * f64::from(b)
        };
        for i in 1..=64 {
            assert!(light(i) > light(i - 1) - 0.3, "{i}");
        }
        assert_eq!(colour(f32::NAN), colour(1.0));
        assert_eq!(colour(-1.0), colour(0.0));
    }

    #[test]
    fn errors_are_means_over_the_channels() {
        let a = RgbImage::from_pixel(2, 1, Rgb([10, 20, 30]));
        let b = RgbImage::from_pixel(2, 1, Rgb([40, 20, 0]));
        let error = absolute_error(&a, &b).unwrap();
        assert_eq!(error.get_pixel(1, 0).0[0], 60.0 / 765.0);
        assert_eq!(
            picture(&a, &a, |_, _| true, 0.5, 100)
                .unwrap()
                .get_pixel(0, 0),
            &colour(0.0)
        );
        // At any size, unscored pixels do not affect the error of their neighbours.
        let half = picture(&a, &b, |x, _| x == 1, 60.0 / 765.0, 100).unwrap();
        assert_eq!(
            (half.get_pixel(0, 0), half.get_pixel(1, 0)),
            (&hatched(0, 0), &colour(1.0))
        );
        // b is better than a by the full scale at one pixel; the unchanged pixel is grey.
        let target = RgbImage::from_fn(2, 1, |x, _| {
            if x == 0 {
                Rgb([40, 20, 0])
            } else {
                Rgb([25, 20, 15])
            }
        });
        let grown = change([&a, &b], &target, |_, _| true, 60.0 / 765.0, 100).unwrap();
        assert_eq!(
            (grown.get_pixel(0, 0), grown.get_pixel(1, 0)),
            (&Rgb([0, 0x72, 0xB2]), &Rgb([240; 3]))
        );
        let back = change([&b, &a], &target, |_, _| true, 60.0 / 765.0, 100).unwrap();
        assert_eq!(back.get_pixel(0, 0), &Rgb([0xD5, 0x5E, 0]));
        let other = RgbImage::new(1, 1);
        let error = absolute_error(&a, &other).unwrap_err();
        assert!(error.to_string().contains("2 × 1"));
    }
}
