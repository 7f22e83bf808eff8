//! The multi-resolution decoder: five feature maps fused from coarse to fine.

use candle_core::Tensor;

use super::ModelError;
use super::observer::{Observer, StageValue};
use super::ops::{Conv1x1, Conv3x3, Deconv2x2};
use super::params::Params;

/// `y + conv3(relu(conv1(relu(y))))`: both 3×3, no normalisation.
struct ResidualBlock {
    conv1: Conv3x3,
    conv3: Conv3x3,
}

impl ResidualBlock {
    fn new(p: &Params<'_>, dim: usize) -> Result<Self, ModelError> {
        let residual = p.pp("residual");
        Ok(Self {
            conv1: Conv3x3::new(&residual.pp(1), dim, dim, true)?,
            conv3: Conv3x3::new(&residual.pp(3), dim, dim, true)?,
        })
    }

    /// `[1, dim, h, w]` to the same shape.
    fn forward(&self, y: &Tensor) -> Result<Tensor, ModelError> {
        let inner = self.conv1.forward(&y.relu()?)?.relu()?;
        Ok((self.conv3.forward(&inner)? + y)?)
    }

    /// Declares the parameters of a block that is in the checkpoint but never runs.
    fn unused(p: &Params<'_>, dim: usize) {
        for conv in [1, 3] {
            let conv = p.pp("residual").pp(conv);
            conv.unused("weight", &[dim, dim, 3, 3]);
            conv.unused("bias", &[dim]);
        }
    }
}

/// Adds a map to the coarser one's result, refines, doubles the resolution.
pub(super) struct FusionBlock {
    resnet1: Option<ResidualBlock>,
    resnet2: ResidualBlock,
    deconv: Option<Deconv2x2>,
    out_conv: Conv1x1,
}

impl FusionBlock {
    /// `skip`: whether a finer map is added; `upsample`: whether the resolution doubles.
    pub(super) fn new(
        p: &Params<'_>,
        dim: usize,
        skip: bool,
        upsample: bool,
    ) -> Result<Self, ModelError> {
        let resnet1 = p.pp("resnet1");
        if !skip {
            ResidualBlock::unused(&resnet1, dim);
        }
        Ok(Self {
            resnet1: skip
                .then(|| ResidualBlock::new(&resnet1, dim))
                .transpose()?,
            resnet2: ResidualBlock::new(&p.pp("resnet2"), dim)?,
            deconv: upsample
                .then(|| Deconv2x2::new(&p.pp("deconv"), dim, dim, false))
                .transpose()?,
            out_conv: Conv1x1::new(&p.pp("out_conv"), dim, dim, true)?,
        })
    }

    /// `x` and `skip` are `[1, dim, h, w]`, the result has h and w doubled where the block does so.
    pub(super) fn forward(&self, x: Tensor, skip: Option<&Tensor>) -> Result<Tensor, ModelError> {
        let mut x = match (&self.resnet1, skip) {
            (Some(resnet1), Some(skip)) => (x + resnet1.forward(skip)?)?,
            _ => x,
        };
        x = self.resnet2.forward(&x)?;
        if let Some(deconv) = &self.deconv {
            x = deconv.forward(&x)?;
        }
        self.out_conv.forward(&x)
    }
}

/// The convolution that brings a map to the decoder's width.
enum Input {
    /// The finest map where its width is right already: no parameter.
    Identity,
    /// The finest map otherwise.
    Point(Conv1x1),
    /// All others.
    Spatial(Conv3x3),
}

/// The decoder; depth and Gaussians have one each.
pub(super) struct MultiresConvDecoder {
    convs: Vec<Input>,
    fusions: Vec<FusionBlock>,
}

impl MultiresConvDecoder {
    /// `inputs` are the maps' channels, finest first; `dim` the decoder's.
    pub(super) fn new(p: &Params<'_>, inputs: [usize; 5], dim: usize) -> Result<Self, ModelError> {
        let (convs, fusions) = (p.pp("convs"), p.pp("fusions"));
        let input = |level: usize| {
            let conv = convs.pp(level);
            Ok(match level {
                0 if inputs[0] == dim => Input::Identity,
                0 => Input::Point(Conv1x1::new(&conv, inputs[0], dim, false)?),
                _ => Input::Spatial(Conv3x3::new(&conv, inputs[level], dim, false)?),
            })
        };
        Ok(Self {
            convs: (0..5).map(input).collect::<Result<_, ModelError>>()?,
            fusions: (0..5)
                .map(|level| FusionBlock::new(&fusions.pp(level), dim, level < 4, level > 0))
                .collect::<Result<_, _>>()?,
        })
    }

    /// Five maps, finest first, each twice as fine as the next but for the first two pairs, which
    /// the blocks' doublings make equal. The result is `[1, dim, s, s]` at the finest resolution.
    pub(super) fn forward(
        &self,
        maps: &[Tensor; 5],
        name: &str,
        observer: &mut dyn Observer,
    ) -> Result<Tensor, ModelError> {
        let mut fused: Option<Tensor> = None;
        for level in (0..5).rev() {
            let (map, learned) = match &self.convs[level] {
                Input::Identity => (maps[level].clone(), false),
                Input::Point(conv) => (conv.forward(&maps[level])?, true),
                Input::Spatial(conv) => (conv.forward(&maps[level])?, true),
            };
            if learned {
                observer.stage(&format!("{name}.conv{level}"), StageValue::Tensor(&map))?;
            }
            let block = &self.fusions[level];
            let next = match fused.take() {
                None => block.forward(map, None)?,
                Some(coarser) => block.forward(coarser, Some(&map))?,
            };
            observer.stage(&format!("{name}.fusion{level}"), StageValue::Tensor(&next))?;
            fused = Some(next);
        }
        fused.ok_or_else(|| ModelError::Config("a decoder without levels".into()))
    }
}
