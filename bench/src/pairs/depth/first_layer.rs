//! Depth predicted by a SHARP checkpoint: its first layer.

use std::path::Path;
use std::sync::OnceLock;

use sharp::model::{ModelConfig, NetworkSpec, Predictor};
use sharp::resize::nearest;
use sharp_datasets::{DepthMap, Scene, View};

use super::DepthSource;
use crate::io::hash::file_sha256;
use crate::pairs::PairError;

/// The first depth layer of a SHARP network, resized to the picture by nearest neighbour.
///
/// Predicts as the release does: resizes the photograph to the network's square and takes the
/// dataset's focal length over the width as disparity factor. Runs once per view, on the CPU.
pub struct FirstLayerDepth {
    network: NetworkSpec,
    checkpoint_sha256: String,
    name: &'static str,
    predictor: OnceLock<Result<Predictor, String>>,
}

impl FirstLayerDepth {
    /// Creates a source from a checkpoint; its weights are loaded on first use. `name` precedes the checkpoint's
    /// SHA-256 in records.
    pub fn new(
        checkpoint: &Path,
        config: ModelConfig,
        name: &'static str,
    ) -> Result<Self, PairError> {
        Ok(Self {
            checkpoint_sha256: file_sha256(checkpoint)?,
            network: NetworkSpec {
                config,
                ..NetworkSpec::release(checkpoint)
            },
            name,
            predictor: OnceLock::new(),
        })
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

    fn predictor(&self) -> Result<&Predictor, PairError> {
        let load = || Predictor::open(&self.network).map_err(|error| error.to_string());
        let predictor = self.predictor.get_or_init(load).as_ref();
        predictor.map_err(|reason| self.wrong(reason.clone()))
    }
}

impl DepthSource for FirstLayerDepth {
    fn depth(&self, _scene: &Scene, view: &View) -> Result<Option<DepthMap>, PairError> {
        let image = view.content.image()?;
        let size = (image.width() as usize, image.height() as usize);
        let factor = (view.intrinsics.fx / f64::from(image.width())) as f32;
        let predicted = self
            .predictor()?
            .predict_rgb8(&image, factor)
            .map_err(|error| self.wrong(format!("{}: {error}", view.id)))?;
        let side = predicted.resolution;
        let layer = nearest(predicted.first_layer(), (side, side), size);
        Ok(DepthMap::from_vec(image.width(), image.height(), layer))
    }

    fn name(&self) -> String {
        format!(
            "{}(checkpoint sha256 {})",
            self.name, self.checkpoint_sha256
        )
    }

    /// One prediction at a time: a single one already uses every core and gigabytes of memory.
    fn in_parallel(&self) -> bool {
        false
    }
}

#[cfg(test)]
mod tests {
    use std::path::PathBuf;

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
        let config = ModelConfig::load(&format!("{config}#tiny")).unwrap();
        let source = FirstLayerDepth::new(&golden("tiny_model.pt"), config, "tiny").unwrap();
        let spec = sharp_datasets::DatasetSpec::parse("S:synthetic=size=96x72,views=4").unwrap();
        let scenes = sharp_datasets::open(&spec).unwrap();
        let view = &scenes[0].views[0];
        let depth = source.depth(&scenes[0], view).unwrap().unwrap();
        assert_eq!(depth.dimensions(), (96, 72));
        assert!(depth.iter().all(|z| is_valid_depth(*z)));
        assert!(source.name().starts_with("tiny(checkpoint sha256 "));

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
