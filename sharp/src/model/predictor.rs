//! The complete prediction: from an image and its focal length to Gaussians.

use std::cell::RefCell;

use candle_nn::Module;
use image::RgbImage;

use super::config::LAYERS;
use super::inventory::CheckpointSource;
use super::network::SharpNetwork;
use super::network_spec::NetworkSpec;
use super::observer::{Silent, StageObserver, StageValue};
use super::ops::{from_planes, to_planes};
use super::params::{Params, WeightSource, Weights};
use super::{Compute, ModelConfig, ModelError};
use crate::composer::{ATTRIBUTES, compose};
use crate::gaussians::Gaussians;
use crate::initializer::{BaseGaussians, InvalidDepth, NormalizedDepth};
use crate::resize::bilinear_align_corners;

/// An sRGB-encoded image as planes.
#[derive(Debug, Clone, Copy)]
pub struct Planes<'a> {
    /// Values, `[3, height, width]` in 0..1.
    pub values: &'a [f32],
    pub width: usize,
    pub height: usize,
}

/// Converts interleaved RGB to planes `[3, height, width]`.
pub fn planes_of<T: Copy>(rgb: &[T], value: impl Fn(T) -> f32) -> Vec<f32> {
    let mut out = Vec::with_capacity(rgb.len());
    for channel in 0..3 {
        out.extend(rgb.iter().skip(channel).step_by(3).map(|&v| value(v)));
    }
    out
}

/// The network's outputs for an image.
#[derive(Debug, Clone)]
pub struct NetworkOutput {
    /// Gaussians, sorted by layer, then row by row, in normalised space: x/z and y/z over [−1, 1] across the image, z
    /// in metres.
    pub gaussians: Gaussians,
    /// Depth layers `[2, R, R]` in metres.
    pub depth: Vec<f32>,
    /// R, the internal resolution of the network.
    pub resolution: usize,
}

impl NetworkOutput {
    /// The nearer of the two depth layers, `[R, R]`, in metres.
    pub fn first_layer(&self) -> &[f32] {
        &self.depth[..self.resolution * self.resolution]
    }
}

/// A network with its weights, on a device.
pub struct Predictor {
    config: ModelConfig,
    network: SharpNetwork,
    compute: Compute,
}

/// Lower bound of disparities before conversion to depth.
pub(super) const MIN_DISPARITY: f32 = 1e-4;
/// Upper bound of disparities before conversion to depth.
pub(super) const MAX_DISPARITY: f32 = 1e4;

impl Predictor {
    /// Builds the network with any source of weights.
    ///
    /// # Errors
    /// [`ModelError::Config`] for an impossible configuration.
    pub fn from_source(
        config: &ModelConfig,
        source: impl WeightSource + 'static,
        compute: Compute,
    ) -> Result<Self, ModelError> {
        config.validate()?;
        let (weights, list) = (Weights::new(source, |_| false), RefCell::default());
        let network = SharpNetwork::new(config, &Params::new(&compute, &weights, &list));
        Ok(Self {
            config: config.clone(),
            network,
            compute,
        })
    }

    /// Opens the network of `spec`; see [`CheckpointSource::check`] for the required contents of
    /// its file. Values are read on demand, so the file must not change in the meantime.
    ///
    /// # Errors
    /// [`ModelError::Checkpoint`], [`ModelError::Incomplete`] with all differences, [`ModelError::Config`];
    /// [`ModelError::Device`] if the device is not available.
    pub fn open(spec: &NetworkSpec) -> Result<Self, ModelError> {
        let compute = spec.device.open(spec.convolution)?;
        let checkpoint = CheckpointSource::open(&spec.checkpoint)?;
        checkpoint.check(&spec.config, &spec.allow_unused)?;
        Self::from_source(&spec.config, checkpoint, compute)
    }

    /// Like [`Self::predict`], for a decoded picture, without an observer.
    ///
    /// # Errors
    /// As for [`Self::predict`].
    pub fn predict_rgb8(
        &self,
        image: &RgbImage,
        disparity_factor: f32,
    ) -> Result<NetworkOutput, ModelError> {
        let planes = Planes {
            values: &planes_of(image, |v| f32::from(v) / 255.0),
            width: image.width() as usize,
            height: image.height() as usize,
        };
        self.predict(planes, disparity_factor, &mut Silent)
    }

    pub fn compute(&self) -> &Compute {
        &self.compute
    }

    pub fn config(&self) -> &ModelConfig {
        &self.config
    }

    /// Predicts Gaussians.
    ///
    /// `disparity_factor` is the focal length divided by the width, both in pixels of the original
    /// image. This factor alone determines the metric scale.
    ///
    /// # Errors
    /// [`ModelError::Image`] for an image of the wrong size, non-finite values or a factor that is not positive;
    /// [`ModelError::Depth`] if the network's depth is not finite; [`ModelError::NotFinite`] if Gaussians are not
    /// finite; [`ModelError::Tensor`] if the device fails; any error of the observer.
    pub fn predict(
        &self,
        image: Planes<'_>,
        disparity_factor: f32,
        observer: &mut dyn StageObserver,
    ) -> Result<NetworkOutput, ModelError> {
        check_input(image, disparity_factor)?;
        let side = self.config.internal_resolution;
        let size = (image.width, image.height);
        let resized = bilinear_align_corners(image.values, size, (side, side));
        let shape = [1, 3, side, side];
        observer.stage("image_resized", StageValue::host(&shape, &resized))?;
        observer.stage(
            "disparity_factor",
            StageValue::host(&[1], &[disparity_factor]),
        )?;
        let normalized: Vec<f32> = resized.iter().map(|v| v * 2.0 - 1.0).collect();
        observer.stage("image_normalized", StageValue::host(&shape, &normalized))?;
        let out = self.network.monodepth.forward(&normalized, observer)?;
        drop(normalized);

        let mut depth = to_planes(&out.disparity)?;
        for value in &mut depth {
            *value = metric_depth(*value, disparity_factor);
        }
        let layers = [1, LAYERS, side, side];
        observer.stage("monodepth", StageValue::host(&layers, &depth))?;
        let (base, input) = self.base(&resized, &depth, observer)?;
        let shape = [1, 3 + LAYERS, side, side];
        observer.stage("feature_input", StageValue::host(&shape, &input))?;
        let seen = from_planes(&input, (3 + LAYERS, side, side), &self.compute.device)?;
        drop(input);
        let network = &self.network;
        let features = network
            .feature_model
            .forward(out.features, &seen, observer)?;
        let [geometry, texture] = network.prediction_head.forward(features)?;
        let deltas = [to_planes(&geometry)?, to_planes(&texture)?].concat();
        let (rows, columns) = (base.grid.rows(), base.grid.columns());
        observer.stage(
            "deltas",
            StageValue::host(&[1, ATTRIBUTES, LAYERS, rows, columns], &deltas),
        )?;
        let gaussians = compose(&base, Some(&deltas))?;
        observe_gaussians("ndc", &gaussians, observer)?;
        let count = gaussians.len();
        let broken = (0..count).filter(|k| !gaussians.is_finite(*k)).count();
        if broken > 0 {
            return Err(ModelError::NotFinite { broken, count });
        }
        Ok(NetworkOutput {
            gaussians,
            depth,
            resolution: side,
        })
    }

    /// Base Gaussians, and the decoder's input `[5, R, R]`.
    fn base(
        &self,
        image: &[f32],
        depth: &[f32],
        observer: &mut dyn StageObserver,
    ) -> Result<(BaseGaussians, Vec<f32>), ModelError> {
        let (grid, side) = (self.config.grid(), self.config.internal_resolution);
        let normalized = NormalizedDepth::new(depth, InvalidDepth::Refuse)?;
        let layers = [1, LAYERS, side, side];
        observer.stage(
            "normalized_depth",
            StageValue::host(&layers, &normalized.depth),
        )?;
        let base = BaseGaussians::from_normalized(image, &normalized, grid)?;
        observer.stage("global_scale", StageValue::host(&[1], &[base.global_scale]))?;
        observe_base(&base, observer)?;
        Ok((base, normalized.feature_input(image)))
    }

    /// Runs the alignment network on both layers of predicted depth, `[2, R, R]`, and known depth, `[R, R]`, in metres.
    /// Returns the factors from predicted to known depth, `[R, R]`.
    ///
    /// # Errors
    /// [`ModelError::Image`] for other sizes; [`ModelError::Tensor`] if the device fails.
    pub fn alignment_map(&self, predicted: &[f32], known: &[f32]) -> Result<Vec<f32>, ModelError> {
        let pixels = self.config.grid().pixels();
        if [predicted.len(), known.len()] != [LAYERS * pixels, pixels] {
            return Err(ModelError::Image(format!(
                "depth maps of {} and {} values instead of {} and {pixels}",
                predicted.len(),
                known.len(),
                LAYERS * pixels
            )));
        }
        let side = self.config.internal_resolution;
        let layers = self.config.alignment_input.layers();
        let depths = [&predicted[..layers * pixels], known].concat();
        let depths = from_planes(&depths, (layers + 1, side, side), &self.compute.device)?;
        let log = to_planes(&self.network.depth_alignment.forward(&depths)?)?;
        Ok(log.into_iter().map(f32::exp).collect())
    }
}

pub(super) fn check_input(image: Planes<'_>, disparity_factor: f32) -> Result<(), ModelError> {
    let Planes {
        values,
        width,
        height,
    } = image;
    let refuse = |what: String| Err(ModelError::Image(what));
    if width < 2 || height < 2 {
        return refuse(format!(
            "an image of {width}x{height} pixels; at least 2x2 are needed"
        ));
    }
    if values.len() != 3 * width * height {
        return refuse(format!(
            "{} values instead of three planes of {width}x{height}",
            values.len()
        ));
    }
    if let Some(at) = values.iter().position(|v| !v.is_finite()) {
        let (x, y) = (at % width, at / width % height);
        return refuse(format!("the image is not finite at ({x}, {y})"));
    }
    if !(disparity_factor.is_finite() && disparity_factor > 0.0) {
        return refuse(format!(
            "focal length over width is {disparity_factor}, not a positive number"
        ));
    }
    Ok(())
}

/// `factor / clamp(disparity)` in metres. NaN is preserved.
pub(super) fn metric_depth(disparity: f32, factor: f32) -> f32 {
    factor / disparity.clamp(MIN_DISPARITY, MAX_DISPARITY)
}

/// Passes base Gaussians to the observer, in the shapes of the recordings.
fn observe_base(base: &BaseGaussians, observer: &mut dyn StageObserver) -> Result<(), ModelError> {
    let (layers, rows, columns) = (base.grid.layers, base.grid.rows(), base.grid.columns());
    let shape = [1, 1, layers, rows, columns];
    let mut see = |name: &str, shape: &[usize], values: &[f32]| {
        observer.stage(&format!("base.{name}"), StageValue::host(shape, values))
    };
    see("mean_x_ndc", &shape, &base.x.repeat(layers * rows))?;
    let y: Vec<f32> = (0..layers)
        .flat_map(|_| base.y.iter().flat_map(|&y| std::iter::repeat_n(y, columns)))
        .collect();
    see("mean_y_ndc", &shape, &y)?;
    see("inverse_z", &shape, &base.inverse_depth)?;
    see("scales", &shape, &base.scales)?;
    see("quaternions", &[1, 4, 1, 1, 1], &[1.0, 0.0, 0.0, 0.0])?;
    let colors: Vec<f32> = base
        .colors
        .chunks(rows * columns)
        .flat_map(|plane| plane.repeat(layers))
        .collect();
    see("colors", &[1, 3, layers, rows, columns], &colors)?;
    see("opacities", &[1], &[base.opacity])
}

/// Passes Gaussians to the observer as stages named `space.…`.
pub(super) fn observe_gaussians(
    space: &str,
    gaussians: &Gaussians,
    observer: &mut dyn StageObserver,
) -> Result<(), ModelError> {
    let n = gaussians.len();
    let mut see = |name: &str, width: Option<usize>, values: &[f32]| {
        let shape = [Some(1), Some(n), width];
        let shape: Vec<usize> = shape.into_iter().flatten().collect();
        observer.stage(&format!("{space}.{name}"), StageValue::host(&shape, values))
    };
    see("mean_vectors", Some(3), gaussians.means.as_flattened())?;
    see("singular_values", Some(3), gaussians.scales.as_flattened())?;
    see("quaternions", Some(4), gaussians.quaternions.as_flattened())?;
    see("colors", Some(3), gaussians.colors.as_flattened())?;
    see("opacities", None, &gaussians.opacities)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::{Algorithm, Silent, inventory, synth::Synth};

    #[test]
    fn disparity_is_clamped_on_both_sides() {
        assert_eq!(metric_depth(0.0, 0.5), 0.5 / 1e-4);
        assert_eq!(metric_depth(-1.0, 0.5), 0.5 / 1e-4);
        assert_eq!(metric_depth(1e9, 0.5), 0.5 / 1e4);
        assert_eq!(metric_depth(2.0, 0.5), 0.25);
        assert!(metric_depth(f32::NAN, 0.5).is_nan());
    }

    fn tiny(stride: usize) -> Predictor {
        let file = "/../tests/golden/model/tiny_config.json#tiny";
        let file = format!("{}{file}", env!("CARGO_MANIFEST_DIR"));
        let mut config = ModelConfig::load(&file).unwrap();
        config.gaussian_stride = stride;
        assert!(!inventory::inventory(&config).unwrap().is_empty());
        let compute = Compute::cpu(Algorithm::Winograd);
        Predictor::from_source(&config, Synth::default(), compute).unwrap()
    }

    #[test]
    fn interleaved_pixels_become_planes() {
        let found = planes_of(&[1, 2, 3, 4, 5, 6], |v: u8| f32::from(v));
        assert_eq!(found, [1.0, 4.0, 2.0, 5.0, 3.0, 6.0]);
    }

    fn grey(width: usize, height: usize) -> Vec<f32> {
        vec![0.5; 3 * width * height]
    }

    #[test]
    fn every_stride_yields_its_number_of_gaussians() {
        for stride in [2, 4, 8] {
            let image = RgbImage::from_pixel(5, 4, image::Rgb([51, 102, 153]));
            let out = tiny(stride).predict_rgb8(&image, 0.8).unwrap();
            assert_eq!(out.gaussians.len(), 2 * (192 / stride).pow(2));
            assert_eq!(out.depth.len(), 2 * 192 * 192);
            assert_eq!(out.first_layer(), &out.depth[..192 * 192]);
        }
    }

    #[test]
    fn unusable_input_is_named() {
        let predictor = tiny(2);
        let predict = |values: &[f32], width, factor| {
            let planes = Planes {
                values,
                width,
                height: 4,
            };
            let result = predictor.predict(planes, factor, &mut Silent);
            result.unwrap_err().to_string()
        };
        let mut holed = grey(4, 4);
        holed[17] = f32::NAN;
        assert!(predict(&holed, 4, 1.0).contains("not finite at (1, 0)"));
        assert!(predict(&grey(1, 4), 1, 1.0).contains("1x4"));
        assert!(predict(&grey(4, 4)[1..], 4, 1.0).contains("47 values"));
        assert!(predict(&grey(4, 4), 4, 0.0).contains("focal length"));
        assert!(predict(&grey(4, 4), 4, f32::NAN).contains("focal length"));
    }
}
