//! SHARP itself: our network on the source photograph, our renderer for the target.

use std::path::PathBuf;
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

use sharp::gaussians::Gaussians;
use sharp::model::predictor::Planes;
use sharp::model::{DeviceChoice, ModelConfig, ModelError, Precision, Predictor, Silent};
use sharp_datasets::DepthMap;

use super::method::{Method, MethodError, PairInput, Prediction};
use super::spec::{MethodSpec, SpecError};
use super::splat::{planes, render_from_ndc};
use crate::durable::{file_sha256, sha256_hex};
use crate::model_files::find_checkpoint;
use crate::model_files::record::{RecordError, compare_or_record, record_file};
use crate::protocol::alignment::median_scale;

/// What a method may know of the source's true depth.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum KnownDepth {
    /// Nothing.
    None,
    /// Its scale: the first layer's median ratio to ground truth (the paper's "privileged depth").
    Privileged,
}

/// The SHARP network.
///
/// The photograph is taken as the dataset gives it. The disparity factor is the dataset's focal length over the width
/// (f_x / W), and Gaussians are placed by E_t E_s⁻¹ K_s⁻¹ with the dataset's intrinsics. With `depth=privileged`,
/// Gaussians are scaled about the source camera by the median of ground truth over the first depth layer (the paper's
/// eq. global_scale); a source without depth is a failure then.
///
/// Extras: `mean_alpha`, `hole_share`, and `median_scale` with privileged depth.
pub struct Sharp {
    label: String,
    checkpoint: PathBuf,
    checkpoint_sha256: String,
    config: ModelConfig,
    allow_unused: Vec<String>,
    depth: KnownDepth,
    device: DeviceChoice,
    /// What the device turned out to be: `auto` is no identity.
    engine: String,
    predictor: OnceLock<Result<Predictor, String>>,
    /// The last source's Gaussians: pairs come sorted, so that those of one source follow each other.
    last: Mutex<Option<(String, Arc<SourcePrediction>)>>,
}

struct SourcePrediction {
    /// With privileged depth already scaled, where it has a scale.
    gaussians: Gaussians,
    /// The scale of privileged depth, or why there is none; `None` where no depth is known.
    scale: Option<Result<f64, String>>,
}

impl Sharp {
    /// Options of the kind.
    pub const OPTIONS: [&'static str; 5] =
        ["checkpoint", "config", "depth", "device", "allow_unused"];

    /// Reads the options; the weights are loaded at the first prediction.
    ///
    /// # Errors
    /// When the checkpoint is not found or is not the one recorded, the device is not there, or an option's value is
    /// not known.
    pub fn from_spec(spec: &MethodSpec) -> Result<Self, SpecError> {
        let option = |key: &str| spec.options.get(key).map(String::as_str);
        let depth = match option("depth") {
            None | Some("none") => KnownDepth::None,
            Some("privileged") => KnownDepth::Privileged,
            Some(other) => return Err(spec.error(format!("depth={other}: none or privileged"))),
        };
        let refused = |error: &dyn std::fmt::Display| spec.error(error.to_string());
        let device: DeviceChoice = option("device")
            .unwrap_or("cpu")
            .parse()
            .map_err(|error: ModelError| refused(&error))?;
        let engine = device.open(Precision::Fast).map_err(|e| refused(&e))?;
        let checkpoint = match option("checkpoint") {
            Some(file) => PathBuf::from(file),
            None => find_checkpoint().map_err(|error| refused(&error))?,
        };
        let config = match option("config") {
            Some(file) => ModelConfig::load(file).map_err(|error| refused(&error))?,
            None => ModelConfig::release(),
        };
        let checkpoint_sha256 = file_sha256(&checkpoint).map_err(|error| refused(&error))?;
        // The official checkpoint, found rather than named, has to be the one that was used before. A cache that cannot
        // be written is no reason against it.
        if let (None, Some(record)) = (option("checkpoint"), record_file()) {
            match compare_or_record(&checkpoint, &checkpoint_sha256, &record) {
                Ok(_) | Err(RecordError::File(_)) => {}
                Err(error) => return Err(refused(&error)),
            }
        }
        let prefixes = option("allow_unused").unwrap_or_default().split(',');
        Ok(Self {
            label: spec.label.clone(),
            checkpoint,
            checkpoint_sha256,
            config,
            allow_unused: prefixes
                .filter(|prefix| !prefix.is_empty())
                .map(str::to_owned)
                .collect(),
            depth,
            device,
            engine: engine.name(),
            predictor: OnceLock::new(),
            last: Mutex::new(None),
        })
    }

    fn predictor(&self) -> Result<&Predictor, MethodError> {
        let load = || {
            let engine = self.device.open(Precision::Fast);
            let engine = engine.map_err(|error| error.to_string())?;
            Predictor::load(&self.config, &self.checkpoint, engine, &self.allow_unused)
                .map_err(|error| error.to_string())
        };
        self.predictor
            .get_or_init(load)
            .as_ref()
            .map_err(|reason| MethodError::Model(reason.clone()))
    }

    fn source_prediction(&self, pair: &PairInput) -> Result<Arc<SourcePrediction>, MethodError> {
        let source = pair.pair_id.split("__").next().unwrap_or(pair.pair_id);
        let mut last = self.last.lock().unwrap_or_else(PoisonError::into_inner);
        if let Some((id, prediction)) = last.as_ref()
            && id == source
        {
            return Ok(Arc::clone(prediction));
        }
        let image = pair.source_image;
        let values = planes(image);
        let planes = Planes {
            values: &values,
            width: image.width() as usize,
            height: image.height() as usize,
        };
        let factor = (pair.source.intrinsics.fx / f64::from(image.width())) as f32;
        let predicted = self
            .predictor()?
            .predict(planes, factor, &mut Silent)
            .map_err(|error| MethodError::Model(error.to_string()))?;
        let side = predicted.resolution;
        let layer = predicted.depth[..side * side].to_vec();
        let Some(first_layer) = DepthMap::from_raw(side as u32, side as u32, layer) else {
            return Err(MethodError::Model("a depth layer of the wrong size".into()));
        };
        let scale = match self.depth {
            KnownDepth::None => None,
            KnownDepth::Privileged => Some(scale_of(pair, &first_layer)),
        };
        let gaussians = match &scale {
            Some(Ok(scale)) => scaled(&predicted.gaussians, *scale),
            _ => predicted.gaussians,
        };
        let prediction = Arc::new(SourcePrediction { gaussians, scale });
        *last = Some((source.to_owned(), Arc::clone(&prediction)));
        Ok(prediction)
    }
}

impl Method for Sharp {
    fn label(&self) -> &str {
        &self.label
    }

    fn identity(&self) -> String {
        format!(
            "sharp(checkpoint={},config={}:{},depth={},engine={})",
            self.checkpoint_sha256,
            self.config.preset,
            &config_sha256(&self.config)[..16],
            match self.depth {
                KnownDepth::None => "none",
                KnownDepth::Privileged => "privileged",
            },
            self.engine
        )
    }

    fn predict(&self, pair: &PairInput) -> Result<Prediction, MethodError> {
        let prediction = self.source_prediction(pair)?;
        let scale = prediction.scale.clone().transpose();
        let scale = scale.map_err(|reason| MethodError::Unsuitable {
            view: pair.source.id.clone(),
            reason,
        })?;
        let mut rendered = render_from_ndc(&prediction.gaussians, pair)?;
        if let Some(scale) = scale {
            rendered.extras.insert("median_scale".to_owned(), scale);
        }
        Ok(rendered)
    }
}

/// The scale of the source's true depth over the first layer (metres, at the network's resolution).
fn scale_of(pair: &PairInput, first_layer: &DepthMap) -> Result<f64, String> {
    let truth = pair.source.content.depth();
    let truth = truth.map_err(|error| error.to_string())?;
    let truth = truth.ok_or("the source view has no depth, which depth=privileged needs")?;
    let found = median_scale(&truth, first_layer).map_err(|error| error.to_string())?;
    Ok(found.scale)
}

/// What the configuration says, whatever file it stands in.
fn config_sha256(config: &ModelConfig) -> String {
    // Debug output of numbers, texts and lists of them: as unambiguous as JSON, and it cannot fail.
    sha256_hex(format!("{config:?}").as_bytes())
}

/// Gaussians scaled about the source camera. Normalised x and y are ratios, so that one factor on the whole space is a
/// factor on depth.
fn scaled(gaussians: &Gaussians, scale: f64) -> Gaussians {
    let scale = scale as f32;
    let times = |v: &[f32; 3]| v.map(|x| x * scale);
    Gaussians {
        means: gaussians.means.iter().map(times).collect(),
        scales: gaussians.scales.iter().map(times).collect(),
        ..gaussians.clone()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scaling_keeps_directions_and_multiplies_depth() {
        let gaussians = Gaussians::new(
            vec![[1.0, 2.0, 4.0]],
            vec![[1.0, 0.0, 0.0, 0.0]],
            vec![[0.1, 0.2, 0.3]],
            vec![0.5],
            vec![[0.1; 3]],
        )
        .unwrap();
        let twice = scaled(&gaussians, 2.0);
        assert_eq!(twice.means, [[2.0, 4.0, 8.0]]);
        assert_eq!(twice.scales, [[0.2, 0.4, 0.6]]);
        assert_eq!(twice.opacities, gaussians.opacities);
    }

    #[test]
    fn options_are_checked() {
        for (text, part) in [
            ("sharp:depth=some", "none or privileged"),
            ("sharp:checkpoint=nowhere.pt", "nowhere.pt"),
            ("sharp:checkpoint=x,device=tpu", "tpu"),
        ] {
            let spec: MethodSpec = text.parse().unwrap();
            let error = Sharp::from_spec(&spec).err().unwrap().to_string();
            assert!(error.contains(part), "{error}");
        }
        if !cfg!(feature = "cuda") {
            let spec: MethodSpec = "sharp:device=cuda".parse().unwrap();
            let error = Sharp::from_spec(&spec).err().unwrap().to_string();
            assert!(error.contains("--features cuda"), "{error}");
        }
    }

    #[test]
    fn identity_is_what_computes_and_unused_tensors_can_be_allowed() {
        let golden = concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/golden/model");
        let sharp = |more: &str| {
            let text = format!(
                "sharp:checkpoint={golden}/tiny_model.pt,config={golden}/tiny_config.json#tiny{more}"
            );
            Sharp::from_spec(&text.parse().unwrap()).unwrap()
        };
        let plain = sharp("");
        // The device that was found, not what was asked for.
        assert!(
            plain.identity().contains("engine=cpu-"),
            "{}",
            plain.identity()
        );
        let more = sharp(",allow_unused='ema.,aux.'");
        assert_eq!(more.allow_unused, ["ema.", "aux."]);
        assert_eq!(more.identity(), plain.identity());
        let mut other = sharp("");
        other.config.vit.norm_eps = 1e-5;
        assert_ne!(other.identity(), plain.identity());
    }
}
