//! Watching the network's stages as they are computed.

use candle_core::Tensor;

use super::ModelError;
use super::map::Map;

/// The value of a stage, wherever it lies. Reading it costs a copy.
#[derive(Clone, Copy)]
pub struct StageValue<'a>(StageData<'a>);

#[derive(Clone, Copy)]
enum StageData<'a> {
    Tensor(&'a Tensor),
    /// Values in C order with their shape.
    Host(&'a [usize], &'a [f32]),
    /// One map an image.
    Maps(&'a [Map]),
}

impl<'a> StageValue<'a> {
    /// Values in C order with their shape.
    pub fn host(shape: &'a [usize], values: &'a [f32]) -> Self {
        Self(StageData::Host(shape, values))
    }

    pub(super) fn tensor(tensor: &'a Tensor) -> Self {
        Self(StageData::Tensor(tensor))
    }

    pub(super) fn map(map: &'a Map) -> Self {
        Self(StageData::Maps(std::slice::from_ref(map)))
    }

    pub(super) fn maps(maps: &'a [Map]) -> Self {
        Self(StageData::Maps(maps))
    }

    /// Dimensions, in PyTorch's order.
    ///
    /// # Errors
    /// [`ModelError::Tensor`].
    pub fn shape(&self) -> Result<Vec<usize>, ModelError> {
        match self.0 {
            StageData::Tensor(tensor) => Ok(tensor.dims().to_vec()),
            StageData::Host(shape, _) => Ok(shape.to_vec()),
            StageData::Maps(maps) => {
                let (c, h, w) = maps.first().map_or(Ok((0, 0, 0)), Map::dims)?;
                Ok(vec![maps.len(), c, h, w])
            }
        }
    }

    /// The values in C order.
    ///
    /// # Errors
    /// [`ModelError::Tensor`].
    pub fn to_vec(&self) -> Result<Vec<f32>, ModelError> {
        match self.0 {
            StageData::Tensor(tensor) => Ok(tensor.flatten_all()?.to_vec1()?),
            StageData::Host(_, values) => Ok(values.to_vec()),
            StageData::Maps(maps) => {
                let planes = maps.iter().map(Map::to_planes);
                Ok(planes.collect::<Result<Vec<_>, _>>()?.concat())
            }
        }
    }
}

/// Called with every named stage of a prediction, in order of computation. Stages are named as in
/// the official recordings: `patch_encoder.block5`, `depth_decoder.fusion0`.
pub trait StageObserver {
    /// Called once a stage. An error stops the prediction.
    ///
    /// # Errors
    /// The observer's own.
    fn stage(&mut self, name: &str, value: StageValue<'_>) -> Result<(), ModelError>;
}

#[derive(Debug, Clone, Copy, Default)]
pub struct Silent;

impl StageObserver for Silent {
    fn stage(&mut self, _: &str, _: StageValue<'_>) -> Result<(), ModelError> {
        Ok(())
    }
}

/// Reports progress to a callback: the part just computed and the share (0..1) of all arithmetic
/// done so far.
pub struct StageProgress<F> {
    blocks: usize,
    callback: F,
}

impl<F: FnMut(&'static str, f64)> StageProgress<F> {
    /// For a network whose transformers have `blocks` blocks.
    pub fn new(blocks: usize, callback: F) -> Self {
        Self { blocks, callback }
    }
}

impl<F: FnMut(&'static str, f64)> StageObserver for StageProgress<F> {
    fn stage(&mut self, name: &str, _: StageValue<'_>) -> Result<(), ModelError> {
        let block = name.strip_prefix("patch_encoder.block");
        if let Some(k) = block.and_then(|k| k.parse::<usize>().ok()) {
            let done = (k + 1) as f64 / self.blocks.max(1) as f64;
            (self.callback)("patch encoder", PATCH_ENCODER * done.min(1.0));
        } else if let Some((_, part, done)) = MILESTONES.iter().find(|(stage, ..)| *stage == name) {
            (self.callback)(part, *done);
        }
        Ok(())
    }
}

/// The patch encoder's share of the release's 21.5 TFLOP.
const PATCH_ENCODER: f64 = 0.62;

/// Stage, the part it ends, and the share of all arithmetic that is done then.
const MILESTONES: [(&str, &str, f64); 13] = [
    ("image_encoder.out", "image encoder", 0.64),
    ("encoder.feature4", "projections", 0.65),
    ("depth_decoder.fusion3", "depth decoder", 0.67),
    ("depth_decoder.fusion1", "depth decoder", 0.72),
    ("depth_decoder.fusion0", "depth decoder", 0.85),
    ("disparity", "depth head", 0.88),
    ("base.opacities", "initializer", 0.88),
    ("gauss_decoder.fusion1", "Gaussian decoder", 0.90),
    ("gauss_decoder.fusion0", "Gaussian decoder", 0.93),
    ("gauss_decoder.fused", "Gaussian decoder", 0.96),
    ("texture_head.out", "texture head", 0.98),
    ("geometry_head.out", "geometry head", 1.0),
    ("ndc.opacities", "composer", 1.0),
];

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn progress_only_grows_and_ends_at_one() {
        let mut seen = Vec::new();
        let mut progress = StageProgress::new(2, |part, done| seen.push((part, done)));
        let blocks = ["patch_encoder.block0", "patch_encoder.block1", "merged.x0"];
        for stage in blocks.into_iter().chain(MILESTONES.map(|m| m.0)) {
            progress.stage(stage, StageValue::host(&[0], &[])).unwrap();
        }
        assert!(seen.is_sorted_by(|a, b| a.1 <= b.1));
        assert_eq!(seen[0], ("patch encoder", 0.31));
        assert_eq!(seen.last(), Some(&("composer", 1.0)));
        assert_eq!(seen.len(), 2 + MILESTONES.len());
    }
}
