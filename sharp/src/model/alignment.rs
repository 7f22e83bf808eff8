//! A map of factors that brings predicted depth to known depth: a small U-Net. It was trained
//! along with the network; at inference it runs only where depth is given.

use candle_core::Tensor;

use super::ops::{Conv1x1, Conv3x3, GroupNorm};
use super::params::Params;
use super::{ModelConfig, ModelError};

/// Groups of every normalisation here.
const GROUPS: usize = 4;

/// Nearest depth that the network sees, metres.
const MIN_DEPTH: f64 = 1e-4;

/// `relu(norm(x))`, then a convolution, twice, beside a shortcut.
pub(super) struct NormResidualBlock {
    norm0: GroupNorm,
    conv2: Conv3x3,
    norm3: GroupNorm,
    conv5: Conv3x3,
    shortcut: Option<Conv1x1>,
}

impl NormResidualBlock {
    /// The inner width is half of `output`; a block that changes the width has a 1×1 shortcut.
    pub(super) fn new(
        p: &Params<'_>,
        input: usize,
        output: usize,
        groups: usize,
    ) -> Result<Self, ModelError> {
        let (residual, inner) = (p.pp("residual"), output / 2);
        Ok(Self {
            norm0: GroupNorm::new(&residual.pp(0), input, groups)?,
            conv2: Conv3x3::new(&residual.pp(2), input, inner, true)?,
            norm3: GroupNorm::new(&residual.pp(3), inner, groups)?,
            conv5: Conv3x3::new(&residual.pp(5), inner, output, true)?,
            shortcut: (input != output)
                .then(|| Conv1x1::new(&p.pp("shortcut"), input, output, true))
                .transpose()?,
        })
    }

    /// `[1, input, h, w]` to `[1, output, h, w]`; `see` is shown the first normalisation.
    pub(super) fn forward(
        &self,
        x: &Tensor,
        see: impl FnOnce(&Tensor) -> Result<(), ModelError>,
    ) -> Result<Tensor, ModelError> {
        let normal = self.norm0.forward(x)?;
        see(&normal)?;
        let inner = self.conv2.forward(&normal.relu()?)?;
        drop(normal);
        let inner = self.norm3.forward(&inner)?.relu()?;
        let residual = self.conv5.forward(&inner)?;
        Ok(match &self.shortcut {
            Some(shortcut) => (residual + shortcut.forward(x)?)?,
            None => (residual + x)?,
        })
    }

    fn silent(&self, x: &Tensor) -> Result<Tensor, ModelError> {
        self.forward(x, |_| Ok(()))
    }
}

/// The U-Net.
pub(super) struct DepthAlignment {
    conv_in: Conv3x3,
    norm_in: GroupNorm,
    down: Vec<[NormResidualBlock; 2]>,
    up: Vec<[NormResidualBlock; 2]>,
    norm_out0: GroupNorm,
    conv_out2: Conv1x1,
    norm_out3: GroupNorm,
    conv_out: Conv1x1,
}

impl DepthAlignment {
    pub(super) fn new(p: &Params<'_>, config: &ModelConfig) -> Result<Self, ModelError> {
        let (encoder, decoder) = (p.pp("encoder"), p.pp("decoder"));
        let (base, steps) = (config.alignment_base_width, config.alignment_steps);
        let width = |level: usize| base << level;
        let pair = |p: Params<'_>, input, output| {
            Ok::<_, ModelError>([
                NormResidualBlock::new(&p.pp(1), input, output, GROUPS)?,
                NormResidualBlock::new(&p.pp(2), output, output, GROUPS)?,
            ])
        };
        let (conv_in, conv_out) = (encoder.pp("conv_in"), decoder.pp("conv_out"));
        Ok(Self {
            conv_in: Conv3x3::new(&conv_in.pp(0), 2, base, true)?,
            norm_in: GroupNorm::new(&conv_in.pp(1), base, GROUPS)?,
            down: (0..steps)
                .map(|k| pair(encoder.pp("convs_down").pp(k), width(k), width(k + 1)))
                .collect::<Result<_, _>>()?,
            up: (0..steps)
                .map(|k| {
                    // All but the first step see their predecessor beside the encoder's map.
                    let input = width(steps - k) * if k == 0 { 1 } else { 2 };
                    pair(decoder.pp("convs_up").pp(k), input, width(steps - k - 1))
                })
                .collect::<Result<_, _>>()?,
            norm_out0: GroupNorm::new(&conv_out.pp(0), 2 * base, GROUPS)?,
            conv_out2: Conv1x1::new(&conv_out.pp(2), 2 * base, base, true)?,
            norm_out3: GroupNorm::new(&conv_out.pp(3), base, GROUPS)?,
            conv_out: Conv1x1::new(&p.pp("conv_out"), base, 1, true)?,
        })
    }

    /// Factors > 0 `[1, 1, R, R]` from the first layer of predicted depth and known depth, both
    /// `[1, 1, R, R]` in metres.
    pub(super) fn forward(&self, predicted: &Tensor, known: &Tensor) -> Result<Tensor, ModelError> {
        let inverse = |depth: &Tensor| depth.maximum(MIN_DEPTH)?.recip();
        let input = Tensor::cat(&[&inverse(predicted)?, &inverse(known)?], 1)?;
        let first = self.norm_in.forward(&self.conv_in.forward(&input)?)?;
        let mut maps = vec![first.relu()?];
        let mut x = maps[0].clone();
        for [widen, refine] in &self.down {
            x = refine.silent(&widen.silent(&x.avg_pool2d(2)?)?)?;
            maps.push(x.clone());
        }
        for (k, [narrow, refine]) in self.up.iter().enumerate() {
            if k > 0 {
                x = Tensor::cat(&[&x, &maps[maps.len() - 1 - k]], 1)?;
            }
            let (_, _, h, w) = x.dims4()?;
            x = refine.silent(&narrow.silent(&x.upsample_nearest2d(2 * h, 2 * w)?)?)?;
        }
        let x = Tensor::cat(&[&x, &maps[0]], 1)?;
        let x = self
            .conv_out2
            .forward(&self.norm_out0.forward(&x)?.relu()?)?;
        let x = self.norm_out3.forward(&x)?.relu()?;
        Ok(self.conv_out.forward(&x)?.exp()?)
    }
}
