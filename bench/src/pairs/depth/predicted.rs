//! Depth predicted by a checkpoint: SHARP's first layer, or Depth Pro's depth.

use std::sync::OnceLock;

use sharp::model::depth_pro::{DepthPro, DepthProSource};
use sharp::model::predictor::{Planes, planes_of};
use sharp::model::{ModelConfig, ModelError, NetworkSpec, Predictor};
use sharp::resize::nearest;
use sharp_datasets::{DepthMap, Scene, View};

use super::DepthSource;
use crate::io::hash::file_sha256;
use crate::pairs::PairError;

/// The kind of a checkpoint that predicts depth.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum DepthNetwork {
    /// A checkpoint of SHARP, whose first depth layer is resized to the picture by nearest neighbour.
    Sharp,
    /// A checkpoint of Depth Pro, whose inverse depth is resized to the picture bilinearly, as its authors do.
    DepthPro,
}

/// Depth predicted by a network from the photograph and the dataset's focal length, in the way that the network's
/// authors use it. The network runs once per view.
pub struct PredictedDepth {
    network: NetworkSpec,
    kind: DepthNetwork,
    checkpoint_sha256: String,
    opened: OnceLock<Result<Opened, String>>,
}

enum Opened {
    Sharp(Box<Predictor>),
    DepthPro(Box<DepthPro>),
}

impl PredictedDepth {
    /// Creates a source from a checkpoint; its weights are loaded on first use.
    ///
    /// # Errors
    /// If the checkpoint cannot be read, or Depth Pro was requested and the checkpoint is of another network. Does not
    /// check whether a checkpoint is SHARP's: [`named_network`](crate::io::checkpoint::named_network) does so when it
    /// finds the configuration.
    pub fn new(network: NetworkSpec, kind: DepthNetwork) -> Result<Self, PairError> {
        let source = Self {
            checkpoint_sha256: file_sha256(&network.checkpoint)?,
            network,
            kind,
            opened: OnceLock::new(),
        };
        if kind == DepthNetwork::DepthPro {
            let checked = DepthProSource::open(&source.network.checkpoint)
                .and_then(|weights| weights.check(&source.network.config, &[]));
            checked.map_err(|error| source.wrong(error.to_string()))?;
        }
        Ok(source)
    }

    pub fn checkpoint_sha256(&self) -> &str {
        &self.checkpoint_sha256
    }

    fn wrong(&self, reason: String) -> PairError {
        PairError::Depth {
            path: self.network.checkpoint.clone(),
            reason,
        }
    }

    fn opened(&self) -> Result<&Opened, PairError> {
        let open = || match self.kind {
            DepthNetwork::Sharp => {
                Predictor::open(&self.network).map(|network| Opened::Sharp(Box::new(network)))
            }
            DepthNetwork::DepthPro => {
                DepthPro::open(&self.network).map(|network| Opened::DepthPro(Box::new(network)))
            }
        };
        let opened = self
            .opened
            .get_or_init(|| open().map_err(|e| e.to_string()));
        opened.as_ref().map_err(|reason| self.wrong(reason.clone()))
    }
}

impl DepthSource for PredictedDepth {
    fn depth(&self, _scene: &Scene, view: &View) -> Result<Option<DepthMap>, PairError> {
        let image = view.content.image()?;
        let size = (image.width() as usize, image.height() as usize);
        let focal_px = view.intrinsics.fx;
        let failed = |error: ModelError| self.wrong(format!("{}: {error}", view.id));
        let depth = match self.opened()? {
            Opened::Sharp(network) => {
                let factor = (focal_px / f64::from(image.width())) as f32;
                let predicted = network.predict_rgb8(&image, factor).map_err(failed)?;
                let side = predicted.resolution;
                nearest(predicted.first_layer(), (side, side), size)
            }
            Opened::DepthPro(network) => {
                let planes = Planes {
                    values: &planes_of(&image, |v| f32::from(v) / 255.0),
                    width: size.0,
                    height: size.1,
                };
                let predicted = network.predict(planes, Some(focal_px as f32));
                predicted.map_err(failed)?.depth
            }
        };
        Ok(DepthMap::from_vec(image.width(), image.height(), depth))
    }

    fn name(&self) -> String {
        let name = match (self.kind, self.network.config == ModelConfig::release()) {
            (DepthNetwork::Sharp, true) => "first layer of sharp-release",
            (DepthNetwork::Sharp, false) => "first layer of another network",
            (DepthNetwork::DepthPro, true) => "depth-pro",
            (DepthNetwork::DepthPro, false) => "depth-pro of other sizes",
        };
        format!("{name}(checkpoint sha256 {})", self.checkpoint_sha256)
    }

    /// Predicts one view at a time, because a single prediction already uses every core and gigabytes of memory.
    fn in_parallel(&self) -> bool {
        false
    }
}

#[cfg(test)]
mod tests {
    use std::path::{Path, PathBuf};

    use super::*;
    use crate::pairs::depth::{ScaledToGroundTruth, median_depth_m};
    use crate::pairs::valid_depth::is_valid_depth;
    use crate::pairs::{BuildContext, build_pairs};

    fn golden(name: &str) -> PathBuf {
        let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/golden/model");
        folder.join(name)
    }

    #[test]
    fn a_checkpoints_first_layer_decides_overlap() {
        let config = golden("tiny_config.json").display().to_string();
        let network = NetworkSpec {
            config: ModelConfig::load(&format!("{config}#tiny")).unwrap(),
            ..NetworkSpec::release(golden("tiny_model.pt"))
        };
        let source = PredictedDepth::new(network, DepthNetwork::Sharp).unwrap();
        let spec = sharp_datasets::DatasetSpec::parse("S:synthetic=size=96x72,views=4").unwrap();
        let scenes = sharp_datasets::open(&spec).unwrap();
        let view = &scenes[0].views[0];
        let depth = source.depth(&scenes[0], view).unwrap().unwrap();
        assert_eq!(depth.dimensions(), (96, 72));
        assert!(depth.iter().all(|z| is_valid_depth(*z)));
        let name = source.name();
        assert!(
            name.starts_with("first layer of another network(checkpoint sha256 "),
            "{name}"
        );

        // After scaling, the median ratio to the true depth is 1, and pairs can be built from the
        // scaled depth.
        let scaled = ScaledToGroundTruth(source);
        let metric = scaled.depth(&scenes[0], view).unwrap().unwrap();
        let truth = view.content.depth().unwrap().unwrap();
        let found = crate::pairs::alignment::median_scale(&truth, &metric).unwrap();
        assert!((found.scale - 1.0).abs() < 1e-5, "{}", found.scale);
        assert!(median_depth_m(&metric).is_some());
        let context = BuildContext {
            depth: &scaled,
            ..BuildContext::default()
        };
        let options = "threshold=0,at-threshold=in".parse().unwrap();
        let built = build_pairs(&scenes, &options, &context).unwrap();
        assert_eq!(built.pairs.len(), 12);
        assert!(built.problems.is_empty());
        let plain = build_pairs(&scenes, &options, &BuildContext::default()).unwrap();
        let overlaps = |build: &crate::pairs::PairBuild| -> Vec<Option<f64>> {
            build.pairs.iter().map(|p| p.overlap).collect()
        };
        assert_ne!(overlaps(&built), overlaps(&plain));
    }
}
