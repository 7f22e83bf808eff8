//! Weights before the first step.

use std::path::Path;

use sharp::model::config::LAYERS;
use sharp::model::depth_pro::DepthProSource;
use sharp::model::inventory::{CheckpointSource, ZERO_BEFORE_TRAINING};
use sharp::model::params::WeightSource;
use sharp::model::{ModelConfig, ModelError};
use sharp::random::{SplitMix64, mix, unit};
use sharp::resize::bilinear_align_corners;

/// Random weights of an untrained network.
///
/// * Convolutions and linear layers: normal with variance 1 / fan-in, zero biases. The variance is
///   2 / fan-in for inputs after a ReLU, and 1 / (2 fan-in) for inputs that are the sum of two maps
///   (at the end of a fusion). Features thus stay of order 1 from the encoder to the heads; if they
///   were larger, every optimiser step would change depth abruptly. The last convolution of a
///   residual branch is divided by four, so that the branches do not accumulate. The four taps of a
///   transposed convolution are equal, so that it starts as nearest-neighbour doubling, without a
///   pattern.
/// * Normalisation: 1 and 0. LayerScale: the configuration's `vit.init_values`. Class token:
///   standard deviation 0.02. Positions: sines and cosines of column and row, because the position
///   in a picture is the best predictor of depth.
/// * Prediction heads: 0, so that the Gaussians are the base Gaussians. Alignment: the last weight
///   is 0, so that its factors are 1. Both choices are the SHARP release's.
/// * Both channels of the depth head are equal (paper, section on the depth decoder), with a bias
///   of 0.3, because a ReLU output that starts at 0 never learns.
pub(crate) struct Untrained {
    seed: u64,
    layer_scale: f32,
}

/// Initial disparity: inverse depth for a focal length of one image width.
const FIRST_DISPARITY: f32 = 0.3;

impl Untrained {
    pub(crate) fn new(config: &ModelConfig, seed: u64) -> Self {
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

/// Position embeddings `[tokens, channels]`: zeros for the class token, then a square of patches, by row. A channel is
/// the sine or cosine of the column or row, with wavelengths from four times the square's side down to two patches.
fn positions(tokens: usize, channels: usize) -> Vec<f32> {
    let side = ((tokens - 1) as f64).sqrt().round().max(1.0);
    let waves = (channels / 4).max(1);
    let value = |patch: usize, channel: usize| {
        let patch = patch as f64;
        let (row, column) = ((patch / side).floor(), patch % side);
        let along = if channel.is_multiple_of(2) {
            column
        } else {
            row
        };
        let share = (channel / 4) as f64 / waves as f64;
        let wave_length = 4.0 * side * (2.0 * side).powf(-share);
        let phase = std::f64::consts::TAU * along / wave_length;
        let wave = if (channel / 2).is_multiple_of(2) {
            phase.sin()
        } else {
            phase.cos()
        };
        0.5 * wave as f32
    };
    let class_token = std::iter::repeat_n(0.0, channels);
    let patches = (0..tokens - 1).flat_map(|p| (0..channels).map(move |c| value(p, c)));
    class_token.chain(patches).collect()
}

impl WeightSource for Untrained {
    fn values(&self, name: &str, shape: &[usize]) -> Result<Vec<f32>, ModelError> {
        let len: usize = shape.iter().product();
        let constant = |value: f32| Ok(vec![value; len]);
        let ends = |ends: &[&str]| ends.iter().any(|end| name.ends_with(end));
        let contains = |parts: &[&str]| parts.iter().any(|part| name.contains(part));
        if contains(&ZERO_BEFORE_TRAINING) {
            return constant(0.0);
        }
        if ends(&["cls_token"]) {
            return Ok(self.normal(name, len, 0.02));
        }
        if ends(&["pos_embed"]) {
            return Ok(positions(shape[1], shape[2]));
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
        // In a transposed convolution, each output pixel depends on one weight per input channel.
        let fan_in = if transposed {
            shape[0]
        } else {
            shape[1..].iter().product()
        };
        let rectified = contains(&[
            ".residual.",
            "texture_head.3.",
            "geometry_head.3.",
            ".head.4.",
        ]);
        let gain = if ends(&["out_conv.weight"]) {
            0.5
        } else if rectified {
            2.0
        } else {
            1.0
        };
        let mut deviation = (gain / fan_in as f64).sqrt();
        if ends(&["residual.3.weight", "residual.5.weight"]) {
            deviation *= 0.25;
        }
        if ends(&["monodepth_predictor.head.4.weight"]) {
            let layer = self.normal(name, len / shape[0], 0.1 * deviation);
            return Ok(layer.repeat(shape[0]));
        }
        if transposed {
            let taps = self.normal(name, len / 4, deviation).into_iter();
            return Ok(taps.flat_map(|weight| [weight; 4]).collect());
        }
        Ok(self.normal(name, len, deviation))
    }
}

/// Weights of a checkpoint. If the checkpoint is for another picture size of the same network,
/// position embeddings, the only weights that depend on the size, are resampled as the network
/// resamples pictures.
pub(crate) struct Pretrained(Box<dyn WeightSource>);

impl Pretrained {
    /// Opens a checkpoint of the network of `config`.
    ///
    /// # Errors
    /// [`ModelError::Checkpoint`]; [`ModelError::Incomplete`] for another network.
    pub(crate) fn open(file: &Path, config: &ModelConfig) -> Result<Self, ModelError> {
        let weights = CheckpointSource::open(file)?;
        weights.check(&sizes_there(&weights, config), &[])?;
        Ok(Self(Box::new(weights)))
    }
}

impl WeightSource for Pretrained {
    fn values(&self, name: &str, shape: &[usize]) -> Result<Vec<f32>, ModelError> {
        let values = self.0.values(name, shape)?;
        let len: usize = shape.iter().product();
        if values.len() == len {
            Ok(values)
        } else {
            Ok(resample_positions(&values, shape[1], shape[2]))
        }
    }
}

const POSITIONS: &str = "monodepth_model.monodepth_predictor.encoder.patch_encoder.pos_embed";

/// The configuration with the picture size that a checkpoint was trained on. Unchanged if the checkpoint's position
/// embeddings do not form a square of tokens with this configuration's channels.
fn sizes_there(weights: &dyn WeightSource, config: &ModelConfig) -> ModelConfig {
    let mut there = config.clone();
    let values = weights.values(POSITIONS, &[]).unwrap_or_default().len();
    let side = side(values / config.vit.embed_dim);
    if side > 0 && (side * side + 1) * config.vit.embed_dim == values {
        there.vit.img_size = side * config.vit.patch_size;
        there.internal_resolution = 4 * there.vit.img_size;
    }
    there
}

/// Tokens along a side, given the total including the class token.
fn side(tokens: usize) -> usize {
    tokens.saturating_sub(1).isqrt()
}

/// Resamples position embeddings `[1, tokens, channels]` to another number of tokens. The first
/// embedding, which belongs to the class token, is kept.
fn resample_positions(values: &[f32], tokens: usize, channels: usize) -> Vec<f32> {
    let (class, grid) = values.split_at(channels);
    let [from, to] = [values.len() / channels, tokens].map(side);
    let channel = |at| grid.iter().skip(at).step_by(channels).copied();
    let planes: Vec<f32> = (0..channels).flat_map(channel).collect();
    let resized = bilinear_align_corners(&planes, (from, from), (to, to));
    let token = |at| resized.iter().skip(at).step_by(to * to).copied();
    let rest = (0..to * to).flat_map(token);
    class.iter().copied().chain(rest).collect()
}

/// The depth network of a checkpoint of SHARP or Depth Pro, combined with an untrained Gaussian
/// decoder. Both depth layers start as the checkpoint's first layer (paper, section on the depth
/// decoder), because training on depth alone has no loss for the second layer.
pub(crate) struct TrainedDepth {
    depth: Pretrained,
    rest: Untrained,
}

/// Name prefix of the depth network's parameters.
const DEPTH: &str = "monodepth_model.";

impl TrainedDepth {
    /// Opens a checkpoint. `seed` determines the weights of the Gaussian decoder.
    ///
    /// # Errors
    /// [`ModelError::Checkpoint`]; [`ModelError::Incomplete`] if `config` has another depth network.
    pub(crate) fn open(file: &Path, config: &ModelConfig, seed: u64) -> Result<Self, ModelError> {
        let rest = Untrained::new(config, seed);
        let sharp = CheckpointSource::open(file)?;
        if !sharp.has(DEPTH)
            && let Some(depth) = DepthProSource::open_if(file)?
        {
            depth.check(&sizes_there(&depth, config), &[])?;
            let depth = Pretrained(Box::new(depth));
            return Ok(Self { depth, rest });
        }
        sharp.check_part(&sizes_there(&sharp, config), DEPTH)?;
        let depth = Pretrained(Box::new(sharp));
        Ok(Self { depth, rest })
    }
}

impl WeightSource for TrainedDepth {
    fn values(&self, name: &str, shape: &[usize]) -> Result<Vec<f32>, ModelError> {
        if !name.starts_with(DEPTH) {
            return self.rest.values(name, shape);
        }
        let mut values = self.depth.values(name, shape)?;
        if name.contains("monodepth_predictor.head.4.") {
            let layer = values.len() / LAYERS;
            values.copy_within(..layer, layer);
        }
        Ok(values)
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;

    use sharp::model::predictor::Planes;
    use sharp::model::{Algorithm, Compute, Predictor, StageObserver, StageValue};

    use super::*;

    /// Root mean squares, keyed by stage.
    #[derive(Default)]
    struct Magnitudes(BTreeMap<String, f64>);

    impl StageObserver for Magnitudes {
        fn stage(&mut self, name: &str, value: StageValue<'_>) -> Result<(), ModelError> {
            let values = value.to_vec()?;
            let sum: f64 = values.iter().map(|v| f64::from(*v).powi(2)).sum();
            let mean = sum / values.len() as f64;
            self.0.insert(name.to_owned(), mean.sqrt());
            Ok(())
        }
    }

    #[test]
    fn features_are_of_order_one_wherever_a_decoder_or_head_reads_them() {
        let config = sharp::model::bundled::config().unwrap();
        let side = config.internal_resolution;
        let source = Untrained::new(&config, 7);
        let compute = Compute::cpu(Algorithm::Winograd);
        let predictor = Predictor::from_source(&config, source, compute).unwrap();
        let mut random = SplitMix64::new(1);
        // Blocks that are as coarse as the content of real pictures.
        let blocks: Vec<f32> = (0..3 * 24 * 24)
            .map(|_| unit(random.next_u64()) as f32)
            .collect();
        let value = |at: usize| {
            let (c, y, x) = (at / side / side, at / side % side, at % side);
            blocks[c * 576 + y * 24 / side * 24 + x * 24 / side]
        };
        let values: Vec<f32> = (0..3 * side * side).map(value).collect();
        let image = Planes {
            values: &values,
            width: side,
            height: side,
        };
        let mut found = Magnitudes::default();
        predictor.predict(image, 1.0, &mut found).unwrap();
        let read = [
            "encoder.feature",
            "depth_decoder.fusion",
            "depth_head.0",
            "depth_head.2",
            "gauss_decoder.fus",
            "geometry_head.1",
        ];
        let read = |name: &str| read.iter().any(|stage| name.starts_with(stage));
        let read: Vec<_> = found.0.iter().filter(|(name, _)| read(name)).collect();
        assert!(read.len() > 15, "{read:?}");
        for (name, magnitude) in read {
            assert!((0.2..3.0).contains(magnitude), "{name}: {magnitude}");
        }
    }
}
