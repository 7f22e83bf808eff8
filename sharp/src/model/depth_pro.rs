//! Depth Pro: estimates metric depth from one photograph, and the focal length if it is unknown.
//!
//! SHARP's depth network with one layer of disparity, and a head that estimates the horizontal field of view. Names,
//! shapes and formulas are facts about Apple's `ml-depth-pro` (`src/depth_pro/depth_pro.py` and, in its folder
//! `network`, `encoder.py`, `decoder.py`, `fov.py` and `vit_factory.py`), whose state dict `depth_pro.pt` loads without
//! renaming.

use std::cell::RefCell;
use std::path::Path;

use candle_core::{Device, Tensor};
use candle_nn::Module;

use super::config::LAYERS;
use super::inventory::{CheckpointSource, declared};
use super::layers::Conv;
use super::monodepth::Monodepth;
use super::observer::Silent;
use super::ops::{gather, to_planes};
use super::params::{Parameter, Params, WeightSource, Weights};
use super::predictor::{MAX_DISPARITY, MIN_DISPARITY, Planes, check_input};
use super::pyramid::quarter_size;
use super::vit::{Affine, Vit};
use super::{Compute, ModelConfig, ModelError, NetworkSpec};
use crate::resize::bilinear_half_pixel;

/// Name prefix of the depth network's parameters in SHARP's checkpoints.
const SHARPS_DEPTH: &str = "monodepth_model.monodepth_predictor.";

/// Name prefix of the field-of-view head, which is missing in some checkpoints.
const FOV: &str = "fov.";

/// All parameters of Depth Pro, in order of construction. Sizes are taken from the depth network of
/// `config`.
///
/// # Errors
/// [`ModelError::Config`] for an impossible configuration, or a configuration that the
/// field-of-view head does not fit.
pub fn parameters(config: &ModelConfig, has_fov: bool) -> Result<Vec<Parameter>, ModelError> {
    config.validate()?;
    if has_fov
        && !(config.vit.tokens_per_side() == FieldOfView::TOKENS
            && config.monodepth_dims_decoder[0].is_multiple_of(8))
    {
        return Err(ModelError::Config(format!(
            "`{}`: Depth Pro's field-of-view head needs {} tokens along a side and a decoder width divisible by 8",
            config.preset,
            FieldOfView::TOKENS
        )));
    }
    Ok(declared(|p| Modules::new(config, p, has_fov)))
}

/// A checkpoint of Depth Pro as a source of weights, under Depth Pro's names or the names of
/// SHARP's depth network. Under SHARP's names, both disparity layers get the weights of Depth Pro's
/// single layer.
#[derive(Debug)]
pub struct DepthProSource(CheckpointSource);

impl DepthProSource {
    /// Opens a checkpoint of Depth Pro.
    ///
    /// # Errors
    /// As for [`CheckpointSource::open`]; [`ModelError::File`] for a checkpoint of SHARP.
    pub fn open(path: &Path) -> Result<Self, ModelError> {
        if CheckpointSource::open(path)?.has(SHARPS_DEPTH) {
            return Err(ModelError::File {
                path: path.to_owned(),
                reason: "a checkpoint of SHARP, but one of Depth Pro is needed".to_owned(),
            });
        }
        let parameters = parameters(&ModelConfig::release(), true)?;
        Ok(Self(CheckpointSource::open_with(path, &parameters)?))
    }

    /// Opens a file; `None` if the file is not a checkpoint of Depth Pro.
    ///
    /// # Errors
    /// As for [`Self::open`].
    pub fn open_if(path: &Path) -> Result<Option<Self>, ModelError> {
        let source = Self::open(path)?;
        Ok(is_depth_pro(&source.0).then_some(source))
    }

    /// True if the file has a head that estimates the field of view.
    pub fn has_fov(&self) -> bool {
        self.0.has(FOV)
    }

    /// Checks that the file contains every parameter of Depth Pro, and no other tensors except
    /// those whose names begin with one of `allow_unused`.
    ///
    /// # Errors
    /// As for [`CheckpointSource::check`].
    pub fn check(&self, config: &ModelConfig, allow_unused: &[String]) -> Result<(), ModelError> {
        self.0
            .check_for(parameters(config, self.has_fov())?, allow_unused)
    }
}

/// True if a file has the tensors of Depth Pro, which lack the prefix of SHARP's depth network.
pub fn is_depth_pro(source: &CheckpointSource) -> bool {
    source.has("encoder.patch_encoder.")
}

impl WeightSource for DepthProSource {
    fn values(&self, name: &str, shape: &[usize]) -> Result<Vec<f32>, ModelError> {
        let Some(own) = name.strip_prefix(SHARPS_DEPTH) else {
            return self.0.values(name, shape);
        };
        let values = self.0.values(own, shape)?;
        Ok(if own.starts_with("head.4.") {
            values.repeat(LAYERS)
        } else {
            values
        })
    }
}

/// Metric depth of a photograph, and the focal length that the depth assumes.
#[derive(Debug, Clone, PartialEq)]
pub struct MetricDepth {
    /// z-depth in metres, 1e-4..1e4, `[height, width]` of the photograph.
    pub depth: Vec<f32>,
    /// Focal length in pixels from which the depth was computed: the given one or, if none was
    /// given, the network's estimate.
    pub focal_px: f32,
}

/// The network with its weights, on a device.
pub struct DepthPro {
    config: ModelConfig,
    modules: Modules,
    compute: Compute,
}

struct Modules {
    monodepth: Monodepth,
    fov: Option<FieldOfView>,
}

impl Modules {
    fn new(config: &ModelConfig, p: &Params<'_>, has_fov: bool) -> Self {
        Self {
            monodepth: Monodepth::new(p, config, 1),
            fov: has_fov.then(|| FieldOfView::new(&p.pp("fov"), config)),
        }
    }
}

impl DepthPro {
    /// Opens the network of `spec`. Values are read from the file on demand, so the file must not
    /// change in the meantime.
    ///
    /// # Errors
    /// As for [`Predictor::open`](super::Predictor::open).
    pub fn open(spec: &NetworkSpec) -> Result<Self, ModelError> {
        let compute = spec.device.open(spec.convolution)?;
        let source = DepthProSource::open(&spec.checkpoint)?;
        source.check(&spec.config, &spec.allow_unused)?;
        let has_fov = source.has_fov();
        let (weights, list) = (Weights::new(source, |_| false), RefCell::default());
        let p = Params::new(&compute, &weights, &list);
        Ok(Self {
            config: spec.config.clone(),
            modules: Modules::new(&spec.config, &p, has_fov),
            compute,
        })
    }

    /// Predicts the depth of a photograph with a focal length of `focal_px` pixels; `None`
    /// estimates the focal length.
    ///
    /// # Errors
    /// [`ModelError::Image`] if the image has the wrong size or non-finite values, the focal length is not positive, or
    /// the result is not finite; also if no focal length is given and the checkpoint cannot estimate one.
    /// [`ModelError::Tensor`] if the computation fails.
    pub fn predict(
        &self,
        image: Planes<'_>,
        focal_px: Option<f32>,
    ) -> Result<MetricDepth, ModelError> {
        let width = image.width as f32;
        check_input(image, focal_px.map_or(1.0, |focal| focal / width))?;
        let side = self.config.internal_resolution;
        let size = (image.width, image.height);
        let mut input = bilinear_half_pixel(image.values, size, (side, side));
        input.iter_mut().for_each(|v| *v = *v * 2.0 - 1.0);
        let out = self.modules.monodepth.forward(&input, &mut Silent)?;
        let focal_px = match (focal_px, &self.modules.fov) {
            (Some(focal), _) => focal,
            (None, Some(fov)) => {
                let coarsest = self.modules.monodepth.coarsest(&out.features)?;
                let quarter = quarter_size(&input, side);
                let degrees = fov.degrees(&quarter, &coarsest, &self.compute)?;
                if !(degrees > 0.0 && degrees < 180.0) {
                    return Err(ModelError::Image(format!(
                        "the estimated field of view is {degrees}°, so the focal length must be given"
                    )));
                }
                0.5 * width / (0.5 * degrees.to_radians()).tan()
            }
            (None, None) => {
                return Err(ModelError::Image(
                    "the focal length must be given, because the checkpoint has no head that estimates it".into(),
                ));
            }
        };
        // At a focal length of one width, the network's disparity is inverse depth.
        let scale = width / focal_px;
        let mut inverse = to_planes(&out.disparity)?;
        for value in &mut inverse {
            let rectified = if *value < 0.0 { 0.0 } else { *value };
            *value = rectified * scale;
        }
        let mut depth = bilinear_half_pixel(&inverse, (side, side), size);
        for value in &mut depth {
            *value = 1.0 / value.clamp(MIN_DISPARITY, MAX_DISPARITY);
        }
        if depth.iter().any(|z| z.is_nan()) {
            Err(ModelError::Image(
                "the predicted depth is not finite: the checkpoint's weights are broken".into(),
            ))
        } else {
            Ok(MetricDepth { depth, focal_px })
        }
    }
}

/// Estimates the field of view from the whole image, with a separate transformer, and from the
/// coarsest feature map.
struct FieldOfView {
    encoder: Vit,
    project: Affine,
    downsample: Conv,
    head: [Conv; 3],
}

impl FieldOfView {
    /// Tokens along a side; the convolutions have sizes for this number only.
    const TOKENS: usize = 24;

    fn new(p: &Params<'_>, config: &ModelConfig) -> Self {
        let dim = config.monodepth_dims_decoder[0];
        let (encoder, head) = (p.pp("encoder"), p.pp("head"));
        Self {
            encoder: Vit::new(&encoder.pp(0), &config.vit),
            project: Affine::new(&encoder.pp(1), &[dim / 2, config.vit.embed_dim]),
            downsample: Conv::halving(&p.pp("downsample").pp(0), dim, dim / 2).then_relu(),
            head: [
                Conv::halving(&head.pp(0), dim / 2, dim / 4).then_relu(),
                Conv::halving(&head.pp(2), dim / 4, dim / 8).then_relu(),
                Conv::whole(&head.pp(4), dim / 8, 1, Self::TOKENS / 4),
            ],
        }
    }

    /// The horizontal field of view in degrees. `quarter` is the image at a quarter of the
    /// network's resolution; `coarsest` has twice as many pixels along a side as there are tokens.
    fn degrees(
        &self,
        quarter: &[f32],
        coarsest: &Tensor,
        compute: &Compute,
    ) -> Result<f32, ModelError> {
        let seen = self
            .encoder
            .forward(quarter, &[], "fov_encoder", &mut Silent)?;
        let project = self.project.linear(compute.kernels, None)?;
        let tokens = project.forward(&seen.last)?;
        // The class token comes first.
        let places: Vec<u32> = (1..=(Self::TOKENS * Self::TOKENS) as u32).collect();
        let places = Tensor::new(places, compute.device())?;
        let mut x = (gather(&tokens, &places)? + self.downsample.forward(coarsest)?)?;
        for conv in &self.head {
            x = conv.forward(&x)?;
        }
        Ok(x.to_device(&Device::Cpu)?
            .flatten_all()?
            .get(0)?
            .to_scalar()?)
    }
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeMap;
    use std::path::PathBuf;

    use sharp_checkpoint::Checkpoint;
    use sharp_checkpoint::deterministic::{fnv1a64, splitmix64};

    use super::*;
    use crate::model::DeviceChoice;
    use crate::model::preprocess::{Photo, PhotoOptions, load_photo};

    fn golden(file: &str) -> PathBuf {
        Path::new(env!("CARGO_MANIFEST_DIR"))
            .join("../tests/golden")
            .join(file)
    }

    fn sized(name: &str) -> ModelConfig {
        let file = golden("model/tiny_config.json");
        ModelConfig::load(&format!("{}#{name}", file.display())).unwrap()
    }

    fn narrow() -> NetworkSpec {
        NetworkSpec {
            config: sized("narrow"),
            ..NetworkSpec::release(golden("depth_pro/narrow_model.pt"))
        }
    }

    fn photo() -> Photo {
        let file = golden("model/inputs/main_640x480.png");
        load_photo(&file, &PhotoOptions::default()).unwrap()
    }

    /// Compares names and shapes of our parameters with the official state dict.
    #[test]
    fn the_parameters_are_exactly_the_official_ones() {
        let csv = include_str!("../../../tests/golden/depth_pro/state_dict.csv");
        let official: BTreeMap<String, Vec<usize>> = csv
            .lines()
            .skip(1)
            .map(|line| {
                let (name, shape) = line.split_once(',').unwrap();
                let shape = shape.split('x').map(|d| d.parse().unwrap());
                (name.to_owned(), shape.collect())
            })
            .collect();
        let ours = parameters(&ModelConfig::release(), true)
            .unwrap()
            .into_iter();
        // Its transformers have no classification heads.
        let ours =
            ours.filter(|p| !p.name.contains("encoder.head.") && !p.name.contains("0.head."));
        let ours: BTreeMap<String, Vec<usize>> = ours.map(|p| (p.name, p.shape)).collect();
        assert_eq!(ours, official);
    }

    /// Compares `found` with the official network's recording, which has all values, or 512 at
    /// positions derived from the stage's name.
    fn judge(recording: &Checkpoint, stage: &str, found: &[f32], tolerance: f32) {
        let expected = recording.tensor_f32(stage).unwrap();
        let start = fnv1a64(&["idx:", stage]);
        let place = |k: usize| splitmix64(start.wrapping_add(k as u64)) % found.len() as u64;
        for (k, expected) in expected.iter().enumerate() {
            let at = if found.len() == 1 {
                0
            } else {
                place(k) as usize
            };
            let error = (found[at] - expected).abs() / expected.abs();
            assert!(error < tolerance, "{stage} {at}: {} {expected}", found[at]);
        }
    }

    /// Fails unless a device predicts what the official network does from the photograph alone.
    fn judge_estimate(device: DeviceChoice) -> (Checkpoint, DepthPro) {
        let recording = Checkpoint::open(golden("depth_pro/golden_narrow.safetensors")).unwrap();
        let network = DepthPro::open(&NetworkSpec { device, ..narrow() }).unwrap();
        let estimated = network.predict(photo().planes(), None).unwrap();
        judge(&recording, "focal_px", &[estimated.focal_px], 1e-6);
        judge(&recording, "depth_estimated", &estimated.depth, 5e-6);
        (recording, network)
    }

    #[test]
    fn depth_is_that_of_the_official_network_with_a_focal_length_and_without() {
        let (recording, network) = judge_estimate(DeviceChoice::Cpu);
        let given = network.predict(photo().planes(), Some(500.0)).unwrap();
        assert_eq!(given.focal_px, 500.0);
        judge(&recording, "depth_500px", &given.depth, 5e-6);
    }

    #[test]
    #[ignore = "half a minute: .ci/full slow"]
    fn depth_on_candles_tensors_is_that_of_the_official_network() {
        judge_estimate(DeviceChoice::CandleCpu);
    }
}
