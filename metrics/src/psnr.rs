//! Peak signal-to-noise ratio of one picture.

use rayon::prelude::*;

use crate::picture::{Mask, Picture};
use crate::unavailable::Unavailable;

/// Limits a PSNR (dB) to 80, which corresponds to a mean squared error of at least 1e-8.
pub fn floored(psnr: f64) -> f64 {
    psnr.min(80.0)
}

/// PSNR in dB: −10 log₁₀ of the mean squared error over all pixels and channels, for values in 0..1; infinite for
/// identical pictures. With a mask, only pixels inside it are evaluated.
///
/// For two 8-bit pictures, the squared error is an exact integer; otherwise rows are summed in f64 and added in order.
/// The pictures (and the mask) must have the same size.
///
/// # Errors
/// If the mask is empty.
pub fn psnr(
    prediction: &Picture,
    target: &Picture,
    mask: Option<&Mask>,
) -> Result<f64, Unavailable> {
    let (width, height) = prediction.dimensions();
    let pixels = match mask {
        Some(mask) => mask.count(),
        None => width as usize * height as usize,
    };
    if pixels == 0 {
        return Err(Unavailable::EmptyMask);
    }
    let samples = 3.0 * pixels as f64;
    let mse = match (prediction, target) {
        (Picture::Rgb8(a), Picture::Rgb8(b)) => {
            let sse = squared_error_8bit(a.as_raw(), b.as_raw(), width as usize, mask);
            sse as f64 / (samples * 255.0 * 255.0)
        }
        _ => squared_error(prediction, target, mask) / samples,
    };
    // The subtraction gives +inf for identical pictures, and avoids -0 for black against white.
    Ok(0.0 - 10.0 * mse.log10())
}

fn squared_error_8bit(a: &[u8], b: &[u8], width: usize, mask: Option<&Mask>) -> u64 {
    let row = 3 * width;
    a.par_chunks(row)
        .zip(b.par_chunks(row))
        .enumerate()
        .with_min_len(16)
        .map(|(y, (a, b))| match mask {
            None => a
                .chunks(8192)
                .zip(b.chunks(8192))
                .map(|(a, b)| u64::from(sum_of_squares(a, b)))
                .sum::<u64>(),
            Some(mask) => a
                .chunks_exact(3)
                .zip(b.chunks_exact(3))
                .zip(mask.row(y))
                .filter(|(_, inside)| **inside)
                .map(|((a, b), _)| u64::from(sum_of_squares(a, b)))
                .sum(),
        })
        .sum()
}

/// Sum of the squared differences of two slices of 8-bit levels. More than 66,000 levels could overflow.
fn sum_of_squares(a: &[u8], b: &[u8]) -> u32 {
    a.iter()
        .zip(b)
        .map(|(&a, &b)| {
            let difference = u32::from(a.abs_diff(b));
            difference * difference
        })
        .sum()
}

fn squared_error(prediction: &Picture, target: &Picture, mask: Option<&Mask>) -> f64 {
    let (width, height) = prediction.dimensions();
    let row_sums: Vec<f64> = (0..height as usize)
        .into_par_iter()
        .map_init(
            || (vec![0.0; 3 * width as usize], vec![0.0; 3 * width as usize]),
            |(a, b), y| {
                prediction.row_f64(0, y, a);
                target.row_f64(0, y, b);
                let squares = a.iter().zip(b.iter()).map(|(a, b)| (a - b) * (a - b));
                match mask {
                    None => squares.sum::<f64>(),
                    Some(mask) => squares
                        .enumerate()
                        .filter(|(i, _)| mask.row(y)[i / 3])
                        .map(|(_, square)| square)
                        .sum(),
                }
            },
        )
        .collect();
    row_sums.iter().sum()
}

#[cfg(test)]
mod tests {
    use image::{Rgb, Rgb32FImage, RgbImage};

    use super::*;

    fn noise(seed: u32) -> RgbImage {
        RgbImage::from_fn(37, 29, |x, y| {
            let v = (x * 7919 + y * 104_729 + seed).wrapping_mul(2_654_435_761) >> 16;
            Rgb([v as u8, (v >> 3) as u8, (v >> 5) as u8])
        })
    }

    fn float(picture: &RgbImage) -> Rgb32FImage {
        Rgb32FImage::from_fn(picture.width(), picture.height(), |x, y| {
            Rgb(picture.get_pixel(x, y).0.map(|v| f32::from(v) / 255.0))
        })
    }

    #[test]
    fn one_level_everywhere_is_48_13_db() {
        let a = Picture::from(RgbImage::from_pixel(9, 4, Rgb([10, 20, 30])));
        let b = Picture::from(RgbImage::from_pixel(9, 4, Rgb([11, 21, 29])));
        let expected = 20.0 * 255.0_f64.log10();
        assert!((psnr(&a, &b, None).unwrap() - expected).abs() < 1e-12);
        assert_eq!(psnr(&a, &a, None), Ok(f64::INFINITY));
    }

    #[test]
    fn the_floor_is_80_db() {
        use crate::{Scorer, Selection, Weights};
        let selection = Selection::parse("psnr[floor=1e-8],psnr").unwrap();
        let scorer = Scorer::new(&selection, &Weights::none()).unwrap();
        let flat = |value: f32| Picture::from(Rgb32FImage::from_pixel(4, 4, Rgb([value; 3])));
        let scores = |a: f32, b: f32| {
            let scores = scorer.score(&flat(a), &flat(b), None).unwrap();
            [0, 1].map(|i: usize| scores[i].1.clone().unwrap())
        };
        assert_eq!(scores(0.5, 0.5), [80.0, f64::INFINITY]);
        // A difference of 2^-14: an error of 3.7e-9, 84.3 dB.
        let [floored, plain] = scores(0.5, 0.500_061_04);
        assert!(floored == 80.0 && (plain - 84.288).abs() < 1e-3, "{plain}");
        let [floored, plain] = scores(0.5, 0.75);
        assert!(floored == plain && (plain - 12.0412).abs() < 1e-4);
    }

    #[test]
    fn bytes_and_floats_agree() {
        let (a, b) = (noise(1), noise(2));
        let bytes = psnr(&a.clone().into(), &b.clone().into(), None).unwrap();
        let floats = psnr(&float(&a).into(), &float(&b).into(), None).unwrap();
        let mixed = psnr(&a.into(), &float(&b).into(), None).unwrap();
        assert!((bytes - floats).abs() < 1e-6 && (bytes - mixed).abs() < 1e-6);
    }

    #[test]
    fn a_mask_counts_its_pixels_only() {
        let (a, b) = (noise(1), noise(2));
        let left = |picture: &RgbImage| {
            Picture::from(image::imageops::crop_imm(picture, 0, 0, 10, 29).to_image())
        };
        let expected = psnr(&left(&a), &left(&b), None).unwrap();
        let inside = (0..37 * 29).map(|i| i % 37 < 10).collect();
        let mask = Mask::new(37, 29, inside).unwrap();
        let (fa, fb) = (float(&a), float(&b));
        let masked = psnr(&a.into(), &b.into(), Some(&mask)).unwrap();
        assert_eq!(masked, expected);
        let masked = psnr(&fa.into(), &fb.into(), Some(&mask)).unwrap();
        assert!((masked - expected).abs() < 1e-6);
        let empty = Mask::new(37, 29, vec![false; 37 * 29]).unwrap();
        let picture = Picture::from(noise(1));
        assert_eq!(
            psnr(&picture, &picture, Some(&empty)),
            Err(Unavailable::EmptyMask)
        );
    }
}
