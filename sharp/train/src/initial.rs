//! Weights before the first step.

use sharp::model::params::WeightSource;
use sharp::model::{ModelConfig, ModelError};
use sharp::random::{SplitMix64, mix, unit};

/// Random weights of a network that has seen nothing.
///
/// * Convolutions and linear layers: normal with variance 2 / fan-in (1 / fan-in where no
///   rectification follows: transposed convolutions, transformers), biases 0. The last convolution of
///   a residual branch is divided by four, so that the branches do not add up. The four taps of a
///   transposed convolution are equal, so that it begins as nearest doubling, without a pattern.
/// * Normalisation: 1 and 0. LayerScale: the configuration's `vit.init_values`. Class token and
///   positions: deviation 0.02.
/// * Prediction heads: 0, so that the Gaussians are the base Gaussians. Alignment: last weight 0, so that
///   its factors are 1. Both as in the release.
/// * Both channels of the depth head are equal (paper, section on the depth decoder), with a bias of
///   0.3, because a rectified output that starts at 0 never learns.
pub struct Untrained {
    seed: u64,
    layer_scale: f32,
}

/// Disparity before training: inverse depth for a focal length of one image width.
const FIRST_DISPARITY: f32 = 0.3;

impl Untrained {
    pub fn new(config: &ModelConfig, seed: u64) -> Self {
        Self {
            seed,
            layer_scale: config.vit.init_values as f32,
        }
    }

    fn normal(&self, name: &str, len: usize, deviation: f64) -> Vec<f32> {
        let named = name.bytes().fold(self.seed, |hash, byte| {
            mix(hash ^ u64::from(byte)).wrapping_add(1)
        });
        let mut random = SplitMix64::new(named);
        let mut uniform = || unit(random.next_u64());
        let mut value = || {
            let radius = (-2.0 * (1.0 - uniform()).ln()).sqrt();
            radius * (std::f64::consts::TAU * uniform()).cos()
        };
        (0..len).map(|_| (deviation * value()) as f32).collect()
    }
}

impl WeightSource for Untrained {
    fn values(&self, name: &str, shape: &[usize]) -> Result<Vec<f32>, ModelError> {
        let len: usize = shape.iter().product();
        let constant = |value: f32| Ok(vec![value; len]);
        let ends = |ends: &[&str]| ends.iter().any(|end| name.ends_with(end));
        let contains = |parts: &[&str]| parts.iter().any(|part| name.contains(part));
        if contains(&["prediction_head.", "scale_map_estimator.conv_out."]) {
            return constant(0.0);
        }
        if ends(&["cls_token", "pos_embed"]) {
            return Ok(self.normal(name, len, 0.02));
        }
        if ends(&[".gamma"]) {
            return constant(self.layer_scale);
        }
        if ends(&["monodepth_predictor.head.4.bias"]) {
            return constant(FIRST_DISPARITY);
        }
        if ends(&[".bias"]) {
            return constant(0.0);
        }
        if shape.len() == 1 {
            return constant(1.0);
        }
        let transposed = shape[2..] == [2, 2] && contains(&["deconv", "upsample", "head.1."]);
        let transformer = contains(&["_encoder.blocks", "patch_embed"]);
        // Of a transposed convolution, each output pixel sees one weight of each input.
        let fan_in = match transposed {
            true => shape[0],
            false => shape[1..].iter().product(),
        };
        let linear = transformer || contains(&["upsample", "fuse_lowres"]);
        let gain = if transposed || linear { 1.0 } else { 2.0 };
        let mut deviation = (gain / fan_in as f64).sqrt();
        if ends(&["residual.3.weight", "residual.5.weight"]) {
            deviation *= 0.25;
        }
        if ends(&["monodepth_predictor.head.4.weight"]) {
            let layer = self.normal(name, len / shape[0], 0.01 * deviation);
            return Ok(layer.repeat(shape[0]));
        }
        if transposed {
            let taps = self.normal(name, len / 4, deviation).into_iter();
            return Ok(taps.flat_map(|weight| [weight; 4]).collect());
        }
        Ok(self.normal(name, len, deviation))
    }
}
