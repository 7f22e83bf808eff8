//! Methods without prediction, as reference points: `target` is perfect, `copy` and `mean` are poor.

use image::{Rgb, RgbImage};

use super::method::{
    Approach, Closure, Method, MethodError, MethodIdentity, PicturePrediction, SourceView,
    TargetCamera,
};
use super::spec::MethodSpec;
use crate::io::fingerprints;

/// Returns the ground truth, which must be perfect under every metric: a self-test of the whole pipeline.
#[derive(Debug, Clone)]
pub struct Target {
    pub label: String,
}

impl Method for Target {
    fn label(&self) -> &str {
        &self.label
    }

    fn identity(&self) -> MethodIdentity {
        MethodIdentity::new("target", [])
    }

    fn sources(&self) -> &'static str {
        fingerprints::TRIVIAL
    }

    fn approach(&self) -> Approach<'_> {
        Approach::Target
    }
}

/// Returns the source photograph unchanged. Any method that models the camera's motion must score better.
pub(super) fn copy(spec: &MethodSpec) -> Box<dyn Method> {
    let identity = MethodIdentity::new("copy", []);
    Box::new(Closure::built_in(
        spec,
        identity,
        fingerprints::TRIVIAL,
        copied,
    ))
}

fn copied(source: &SourceView, target: &TargetCamera) -> Result<PicturePrediction, MethodError> {
    let (own, wanted) = (source.image().dimensions(), target.size());
    if own != wanted {
        let reason = format!(
            "the source is {own:?} pixels and the target {wanted:?}, but copy never resizes"
        );
        return Err(MethodError::unsuitable(&source.camera().id, reason));
    }
    Ok(source.image().clone().into())
}

/// A single colour: the mean of the source's 8-bit sRGB values, rounded to nearest.
///
/// The paper's sensitivity table uses the mean of the *target*, which a method must not see.
pub(super) fn mean(spec: &MethodSpec) -> Box<dyn Method> {
    let identity = MethodIdentity::new("mean", [("of", "source".to_owned())]);
    Box::new(Closure::built_in(
        spec,
        identity,
        fingerprints::TRIVIAL,
        averaged,
    ))
}

fn averaged(source: &SourceView, target: &TargetCamera) -> Result<PicturePrediction, MethodError> {
    let (width, height) = target.size();
    Ok(RgbImage::from_pixel(width, height, mean_color(source.image())).into())
}

fn mean_color(image: &RgbImage) -> Rgb<u8> {
    let mut sums = [0_u64; 3];
    for pixel in image.pixels() {
        for (sum, value) in sums.iter_mut().zip(pixel.0) {
            *sum += u64::from(value);
        }
    }
    let n = u64::from(image.width()) * u64::from(image.height());
    // The mean of bytes fits into a byte, and no picture here is empty.
    Rgb(sums.map(|sum| ((sum + n / 2) / n.max(1)) as u8))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mean_is_rounded_to_nearest_per_channel() {
        let image = RgbImage::from_raw(2, 1, vec![0, 10, 255, 1, 20, 255]).unwrap();
        assert_eq!(mean_color(&image), Rgb([1, 15, 255]));
    }
}
