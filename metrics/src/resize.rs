//! Reduction to a shorter side of 256 pixels, equal to PIL's to the last bit.

use std::borrow::Cow;

use image::{Rgb, RgbImage};

use crate::picture::Picture;

/// The side that `dists[resize256]` reduces to.
const SIDE: u32 = 256;

/// The picture with its shorter side reduced to 256 (the longer one rounded down), 8 bits; itself
/// if it is not larger. Floating-point pictures are rounded to 8 bits first, as PIL would need.
pub(crate) fn to_shorter_side_256(picture: &Picture) -> Cow<'_, Picture> {
    let (width, height) = picture.dimensions();
    if width.min(height) <= SIDE {
        return Cow::Borrowed(picture);
    }
    let longer =
        |long: u32, short: u32| (u64::from(SIDE) * u64::from(long) / u64::from(short)) as u32;
    let size = if width <= height {
        (SIDE, longer(height, width))
    } else {
        (longer(width, height), SIDE)
    };
    let resized = match picture {
        Picture::Rgb8(picture) => resize(picture, size),
        Picture::RgbF32(picture) => {
            let levels = RgbImage::from_fn(width, height, |x, y| {
                Rgb(picture.get_pixel(x, y).0.map(|v| (v * 255.0).round() as u8))
            });
            resize(&levels, size)
        }
    };
    Cow::Owned(resized.into())
}

/// Bilinear with antialiasing: a triangle as wide as the reduction, first along x, then along y,
/// each pass in 22-bit fixed point and rounded to 8 bits.
fn resize(picture: &RgbImage, (width, height): (u32, u32)) -> RgbImage {
    let (in_width, in_height) = (picture.width() as usize, picture.height() as usize);
    let (width, height) = (width as usize, height as usize);
    let columns = taps(in_width, width);
    let mut narrow = vec![0_u8; 3 * width * in_height];
    for (row, out) in picture
        .as_raw()
        .chunks_exact(3 * in_width)
        .zip(narrow.chunks_exact_mut(3 * width))
    {
        for (x, (first, weights)) in columns.iter().enumerate() {
            for c in 0..3 {
                let values = row[3 * first + c..].iter().step_by(3);
                out[3 * x + c] = weigh(weights, values);
            }
        }
    }
    let mut out = RgbImage::new(width as u32, height as u32);
    for (row, (first, weights)) in out.chunks_exact_mut(3 * width).zip(taps(in_height, height)) {
        for (i, out) in row.iter_mut().enumerate() {
            let values = narrow[3 * width * first + i..].iter().step_by(3 * width);
            *out = weigh(&weights, values);
        }
    }
    out
}

/// Bits after the point of the fixed-point weights.
const BITS: u32 = 22;

/// For each output pixel its first input pixel and the weights from there on.
fn taps(inputs: usize, outputs: usize) -> Vec<(usize, Vec<i32>)> {
    let scale = inputs as f64 / outputs as f64;
    let support = scale.max(1.0);
    (0..outputs)
        .map(|i| {
            let center = (i as f64 + 0.5) * scale;
            let first = (center - support + 0.5).max(0.0) as usize;
            let end = ((center + support + 0.5) as usize).min(inputs);
            let weights: Vec<f64> = (first..end)
                .map(|at| (1.0 - ((at as f64 - center + 0.5) / support).abs()).max(0.0))
                .collect();
            let sum: f64 = weights.iter().sum();
            let fixed = |weight: &f64| (0.5 + weight / sum * f64::from(1_u32 << BITS)) as i32;
            (first, weights.iter().map(fixed).collect())
        })
        .collect()
}

fn weigh<'a>(weights: &[i32], values: impl Iterator<Item = &'a u8>) -> u8 {
    let half = 1 << (BITS - 1);
    let sum = weights
        .iter()
        .zip(values)
        .fold(half, |sum, (&weight, &value)| {
            sum + weight * i32::from(value)
        });
    (sum >> BITS).clamp(0, 255) as u8
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_pictures_stay_as_they_are() {
        let small = Picture::from(RgbImage::new(300, 256));
        assert!(matches!(to_shorter_side_256(&small), Cow::Borrowed(_)));
    }

    #[test]
    fn sizes_follow_the_shorter_side() {
        for (size, expected) in [((1024, 768), (341, 256)), ((257, 600), (256, 597))] {
            let picture = Picture::from(RgbImage::new(size.0, size.1));
            assert_eq!(to_shorter_side_256(&picture).dimensions(), expected);
        }
    }

    #[test]
    fn the_same_bytes_as_pil() {
        let folder = concat!(
            env!("CARGO_MANIFEST_DIR"),
            "/../tests/golden/metrics/images/"
        );
        for which in ["ref", "dist"] {
            let open = |name: String| image::open(folder.to_owned() + &name).unwrap().to_rgb8();
            let full = open(format!("large1024x768_{which}.png"));
            let pil = open(format!("large1024x768_resize256_{which}.png"));
            assert!(*to_shorter_side_256(&full.into()) == Picture::from(pil));
        }
    }
}
