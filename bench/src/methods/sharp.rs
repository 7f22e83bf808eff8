//! SHARP itself: our network predicts from the source photograph, our renderer draws the target.

use std::path::Path;
use std::sync::OnceLock;

use sharp::model::inventory::CheckpointSource;
use sharp::model::{Algorithm, DeviceChoice, ModelError, NetworkIdentity, NetworkSpec, Predictor};
use sharp_datasets::DepthMap;

use super::method::{
    Approach, GaussianPrediction, GaussianSpace, Method, MethodError, MethodIdentity,
    PredictGaussians, SourceView, TargetCamera,
};
use super::privilege::{Privilege, TrueDepth};
use super::spec::{MethodSpec, SpecError};
use crate::io::checkpoint::record::{RecordError, compare_or_record, record_file};
use crate::io::checkpoint::{RELEASE_ADDRESS, RELEASE_FILE, named_network};
use crate::io::fingerprints;
use crate::io::hash::{FileStamp, HashedFile};

/// The SHARP network.
///
/// Uses the photograph as the dataset provides it. The disparity factor is the dataset's focal length divided by the
/// width (f_x / W). `depth=privileged` is [`TrueDepth::DepthScale`]; with it, pairs fail if their source has no depth.
pub struct Sharp {
    label: String,
    network: NetworkSpec,
    identity: NetworkIdentity,
    depth: TrueDepth,
    /// The checkpoint file. It is hashed while the network runs.
    checkpoint: HashedFile,
    predictor: OnceLock<Result<Predictor, String>>,
}

impl Sharp {
    pub const OPTIONS: [&'static str; 5] =
        ["checkpoint", "config", "depth", "device", "allow_unused"];

    /// Key in the identity for notes on how the checkpoint was read.
    pub const NOTE: &'static str = "note";

    /// Parses the options; the weights are loaded at the first prediction.
    ///
    /// # Errors
    /// If the checkpoint is missing or differs from the one recorded at first use, the device does not exist, or an
    /// option has an unknown value.
    pub fn from_spec(spec: &MethodSpec) -> Result<Self, SpecError> {
        let depth = spec.depth(TrueDepth::DepthScale)?;
        let refused = |error: &dyn std::fmt::Display| spec.refused(error);
        let device: DeviceChoice = spec
            .option("device")
            .unwrap_or("cpu")
            .parse()
            .map_err(|error: ModelError| spec.error(error.to_string()))?;
        // Report a missing device before searching for a checkpoint.
        device.open(Algorithm::Winograd).map_err(|e| refused(&e))?;
        let checkpoint = spec.option("checkpoint").map(Path::new);
        let named = named_network(checkpoint, spec.option("config"));
        let prefixes = spec.option("allow_unused").unwrap_or_default().split(',');
        let network = NetworkSpec {
            allow_unused: prefixes
                .filter(|prefix| !prefix.is_empty())
                .map(str::to_owned)
                .collect(),
            device,
            ..named.map_err(|error| refused(&error))?
        };
        let sharp = Self::new(&spec.label, network, depth).map_err(|error| refused(&error))?;
        // If the user named no checkpoint, the official one found now must equal the one recorded at first use. Failing
        // to write this record is no error.
        if let (None, Some(record)) = (checkpoint, record_file(RELEASE_FILE)) {
            let Self {
                network, identity, ..
            } = &sharp;
            let sha256 = &identity.checkpoint_sha256;
            match compare_or_record(&network.checkpoint, RELEASE_ADDRESS, sha256, &record) {
                Ok(_) | Err(RecordError::File(_)) => {}
                Err(error) => return Err(refused(&error)),
            }
        }
        // Report a checkpoint that does not fit the network now, rather than at the first pair.
        let complete = CheckpointSource::open(&sharp.network.checkpoint)
            .and_then(|source| source.check(&sharp.network.config, &sharp.network.allow_unused));
        complete.map_err(|error| refused(&error))?;
        Ok(sharp)
    }

    /// Creates a method from a network; the weights are loaded at the first prediction.
    ///
    /// # Errors
    /// If the checkpoint cannot be read, or the device does not exist.
    pub fn new(label: &str, network: NetworkSpec, depth: TrueDepth) -> Result<Self, MethodError> {
        let stamp = FileStamp::of(&network.checkpoint);
        let stamp = stamp.map_err(|error| MethodError::Model(error.to_string()))?;
        let identity = network.identity();
        let identity = identity.map_err(|error| MethodError::Model(error.to_string()))?;
        let sha256 = identity.checkpoint_sha256.clone();
        Ok(Self {
            label: label.to_owned(),
            checkpoint: HashedFile::new(&network.checkpoint, sha256, stamp),
            network,
            identity,
            depth,
            predictor: OnceLock::new(),
        })
    }

    fn predictor(&self) -> Result<&Predictor, MethodError> {
        let load = || Predictor::open(&self.network).map_err(|error| error.to_string());
        self.predictor
            .get_or_init(load)
            .as_ref()
            .map_err(|reason| MethodError::Model(reason.clone()))
    }
}

impl Method for Sharp {
    fn label(&self) -> &str {
        &self.label
    }

    fn identity(&self) -> MethodIdentity {
        let NetworkIdentity {
            checkpoint_sha256,
            preset,
            config_sha256,
            engine,
        } = &self.identity;
        let mut identity = MethodIdentity::new(
            "sharp",
            [
                ("checkpoint", checkpoint_sha256.clone()),
                ("config", format!("{preset}:{}", &config_sha256[..16])),
                ("engine", engine.clone()),
            ],
        );
        if !self.network.notes.is_empty() {
            let notes = self.network.notes.join("; ");
            identity.settings.insert(Self::NOTE.to_owned(), notes);
        }
        identity
    }

    fn sources(&self) -> &'static str {
        fingerprints::NETWORK
    }

    fn privilege(&self) -> Privilege {
        Privilege::of_depth(self.depth)
    }

    fn approach(&self) -> Approach<'_> {
        Approach::Gaussians(self)
    }
}

impl PredictGaussians for Sharp {
    fn predict(
        &self,
        source: &SourceView,
        _: Option<&TargetCamera>,
    ) -> Result<GaussianPrediction, MethodError> {
        let image = source.image();
        let factor = (source.intrinsics().fx / f64::from(image.width())) as f32;
        let predicted = self
            .predictor()?
            .predict_rgb8(image, factor)
            .map_err(|error| MethodError::Model(error.to_string()))?;
        if !self.checkpoint.is_unchanged() {
            let reason = "the checkpoint changed during the run";
            return Err(MethodError::file(&self.network.checkpoint, reason));
        }
        let side = predicted.resolution as u32;
        let layer = predicted.first_layer().to_vec();
        let Some(first_layer) = DepthMap::from_raw(side, side, layer) else {
            return Err(MethodError::Model("a depth layer of the wrong size".into()));
        };
        Ok(GaussianPrediction {
            gaussians: predicted.gaussians,
            space: GaussianSpace::Normalized,
            first_layer: Some(first_layer),
            ..GaussianPrediction::default()
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

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
        // The actual device, not the requested one.
        let engine = &plain.identity().settings["engine"];
        assert!(engine.starts_with("cpu-"), "{engine}");
        let more = sharp(",allow_unused='ema.,aux.'");
        assert_eq!(more.network.allow_unused, ["ema.", "aux."]);
        assert_eq!(more.identity(), plain.identity());
    }
}
