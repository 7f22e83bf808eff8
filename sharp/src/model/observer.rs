//! Observation of the network's stages as they are computed.

use candle_core::Tensor;

use super::ModelError;
use super::ops::to_planes;

/// The value of a stage, on the host or on a device. Reading it makes a copy.
#[derive(Clone, Copy)]
pub struct StageValue<'a>(StageData<'a>);

#[derive(Clone, Copy)]
enum StageData<'a> {
    /// Values in C order, preceded by their shape.
    Host(&'a [usize], &'a [f32]),
    Tensor(&'a Tensor),
    /// Image `[1, height, width, channels]`; if the flag is set, negative values are read as 0.
    Image(&'a Tensor, bool),
    /// Class token and tokens of square images, `[images, 1 + side², channels]`.
    Tokens(&'a Tensor),
}

impl<'a> StageValue<'a> {
    /// A value on the host: its shape, and its elements in C order.
    pub fn host(shape: &'a [usize], values: &'a [f32]) -> Self {
        Self(StageData::Host(shape, values))
    }

    pub(super) fn tensor(tensor: &'a Tensor) -> Self {
        Self(StageData::Tensor(tensor))
    }

    /// A value that is an image `[1, height, width, channels]`.
    pub(super) fn image(tensor: &'a Tensor) -> Self {
        Self(StageData::Image(tensor, false))
    }

    /// A value that is an image `[1, height, width, channels]`, with negative values read as 0.
    pub(super) fn rectified(tensor: &'a Tensor) -> Self {
        Self(StageData::Image(tensor, true))
    }

    /// The images formed by tokens `[images, 1 + side², channels]`; class tokens are left out.
    pub(super) fn tokens(tensor: &'a Tensor) -> Self {
        Self(StageData::Tokens(tensor))
    }

    /// Dimensions, in PyTorch's order.
    pub fn shape(&self) -> Result<Vec<usize>, ModelError> {
        Ok(match self.0 {
            StageData::Host(shape, _) => shape.to_vec(),
            StageData::Tensor(tensor) => tensor.dims().to_vec(),
            StageData::Image(tensor, _) => {
                let (images, height, width, channels) = tensor.dims4()?;
                vec![images, channels, height, width]
            }
            StageData::Tokens(tensor) => {
                let (images, tokens, channels) = tensor.dims3()?;
                let side = (tokens - 1).isqrt();
                vec![images, channels, side, side]
            }
        })
    }

    /// Elements in C order.
    ///
    /// # Errors
    /// [`ModelError::Tensor`] if the tensor cannot be copied from its device.
    pub fn to_vec(&self) -> Result<Vec<f32>, ModelError> {
        let flat = |tensor: &Tensor| tensor.flatten_all()?.to_vec1();
        Ok(match self.0 {
            StageData::Host(_, values) => values.to_vec(),
            StageData::Tensor(tensor) => flat(tensor)?,
            StageData::Image(tensor, rectified) => {
                let mut values = to_planes(tensor)?;
                // Unlike `max`, this keeps NaN.
                let negative = values.iter_mut().filter(|v| rectified && **v < 0.0);
                negative.for_each(|v| *v = 0.0);
                values
            }
            StageData::Tokens(tensor) => {
                let tokens = tensor.narrow(1, 1, tensor.dim(1)? - 1)?;
                flat(&tokens.transpose(1, 2)?)?
            }
        })
    }
}

/// Receives every named stage of a prediction, in order of computation. Stages are named as in the official recordings:
/// `patch_encoder.block5`, `depth_decoder.fusion0`.
pub trait StageObserver {
    /// Called once per stage. An error stops the prediction.
    ///
    /// # Errors
    /// Any error of the observer.
    fn stage(&mut self, name: &str, value: StageValue<'_>) -> Result<(), ModelError>;
}

#[derive(Debug, Clone, Copy, Default)]
pub struct Silent;

impl StageObserver for Silent {
    fn stage(&mut self, _: &str, _: StageValue<'_>) -> Result<(), ModelError> {
        Ok(())
    }
}

/// Reports progress to a callback: the part just computed, and the fraction (0..1) of all arithmetic completed.
pub struct StageProgress<F> {
    blocks: usize,
    callback: F,
}

impl<F: FnMut(&'static str, f64)> StageProgress<F> {
    /// Creates an observer for a network whose transformers have `blocks` blocks.
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

/// The patch encoder's share of the SHARP release's 21.5 TFLOP.
const PATCH_ENCODER: f64 = 0.62;

/// For each milestone: the stage, the part that it completes, and the fraction of all arithmetic
/// that is then complete.
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
