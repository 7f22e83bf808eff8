//! A small U-Net that predicts a map of factors from predicted to known depth. The U-Net was
//! trained along with the main network; prediction does not need it.

use candle_core::{Result, Tensor};
use candle_nn::Module;

use super::ModelConfig;
use super::layers::{Conv, GroupNorm};
use super::ops::{avg_pool, double_nearest};
use super::params::Params;

/// Number of groups in every normalisation of this network.
const GROUPS: usize = 4;

/// Minimum depth passed to the network, in metres.
const MIN_DEPTH: f32 = 1e-4;

/// A residual block: normalisation, ReLU and convolution, twice, added to a shortcut.
pub(super) struct NormResidualBlock {
    norm0: GroupNorm,
    conv2: Conv,
    norm3: GroupNorm,
    conv5: Conv,
    shortcut: Option<Conv>,
}

impl NormResidualBlock {
    /// The inner width is half of `output`; a block that changes the width has a 1×1 shortcut.
    pub(super) fn new(p: &Params<'_>, input: usize, output: usize, groups: usize) -> Self {
        let (residual, inner) = (p.pp("residual"), output / 2);
        Self {
            norm0: GroupNorm::new(&residual.pp(0), input, groups),
            conv2: Conv::spatial(&residual.pp(2), input, inner, true).after_relu(),
            norm3: GroupNorm::new(&residual.pp(3), inner, groups),
            conv5: Conv::spatial(&residual.pp(5), inner, output, true).after_relu(),
            shortcut: (input != output)
                .then(|| Conv::point(&p.pp("shortcut"), input, output, true)),
        }
    }

    /// Output of the block's first normalisation for `x`.
    pub(super) fn normalized(&self, x: &Tensor) -> Result<Tensor> {
        self.norm0.forward(x)
    }

    /// Output of the block, given `x` and the result of [`normalized`](Self::normalized) for `x`.
    pub(super) fn refined(&self, x: &Tensor, normal: Tensor) -> Result<Tensor> {
        let inner = self.conv2.forward(&normal)?;
        drop(normal);
        let inner = self.norm3.forward(&inner)?;
        match &self.shortcut {
            Some(shortcut) => self.conv5.forward_plus(&inner, &shortcut.forward(x)?),
            None => self.conv5.forward_plus(&inner, x),
        }
    }
}

impl Module for NormResidualBlock {
    fn forward(&self, x: &Tensor) -> Result<Tensor> {
        self.refined(x, self.normalized(x)?)
    }
}

pub(super) struct DepthAlignment {
    conv_in: Conv,
    norm_in: GroupNorm,
    down: Vec<[NormResidualBlock; 2]>,
    up: Vec<[NormResidualBlock; 2]>,
    norm_out0: GroupNorm,
    conv_out2: Conv,
    norm_out3: GroupNorm,
    conv_out: Conv,
}

impl DepthAlignment {
    pub(super) fn new(p: &Params<'_>, config: &ModelConfig) -> Self {
        let (encoder, decoder) = (p.pp("encoder"), p.pp("decoder"));
        let (base, steps) = (config.alignment_base_width, config.alignment_steps);
        let width = |level: usize| base << level;
        let pair = |p: Params<'_>, input, output| {
            [
                NormResidualBlock::new(&p.pp(1), input, output, GROUPS),
                NormResidualBlock::new(&p.pp(2), output, output, GROUPS),
            ]
        };
        let down = |k: usize| {
            let p = encoder.pp("convs_down").pp(k);
            pair(p, width(k), width(k + 1))
        };
        let up = |k: usize| {
            // Every step but the first also receives the output of the step before it, concatenated
            // to the encoder's map.
            let input = width(steps - k) * if k == 0 { 1 } else { 2 };
            let p = decoder.pp("convs_up").pp(k);
            pair(p, input, width(steps - k - 1))
        };
        let (conv_in, conv_out) = (encoder.pp("conv_in"), decoder.pp("conv_out"));
        Self {
            conv_in: Conv::spatial(
                &conv_in.pp(0),
                config.alignment_input.layers() + 1,
                base,
                true,
            ),
            norm_in: GroupNorm::new(&conv_in.pp(1), base, GROUPS).then_relu(),
            down: (0..steps).map(down).collect(),
            up: (0..steps).map(up).collect(),
            norm_out0: GroupNorm::new(&conv_out.pp(0), 2 * base, GROUPS),
            conv_out2: Conv::point(&conv_out.pp(2), 2 * base, base, true).after_relu(),
            norm_out3: GroupNorm::new(&conv_out.pp(3), base, GROUPS),
            conv_out: Conv::point(&p.pp("conv_out"), base, 1, true).after_relu(),
        }
    }
}

/// Computes the logarithm of the factors, `[1, R, R, 1]`, from depth maps in metres, `[1, R, R, 2 or 3]`: the predicted
/// layers of [`ModelConfig::alignment_input`], then the known depth.
impl Module for DepthAlignment {
    fn forward(&self, depths: &Tensor) -> Result<Tensor> {
        let inverse = depths.maximum(MIN_DEPTH)?.recip()?;
        let mut maps = vec![inverse.apply(&self.conv_in)?.apply(&self.norm_in)?];
        for [widen, refine] in &self.down {
            let x = avg_pool(&maps[maps.len() - 1], 2)?;
            maps.push(x.apply(widen)?.apply(refine)?);
        }
        let finest = maps.remove(0);
        let mut x: Option<Tensor> = None;
        for ([narrow, refine], skip) in self.up.iter().zip(maps.iter().rev()) {
            let joined = match &x {
                Some(x) => Tensor::cat(&[x, skip], 3)?,
                None => skip.clone(),
            };
            x = Some(double_nearest(&joined)?.apply(narrow)?.apply(refine)?);
        }
        let x = x.as_ref().unwrap_or(&finest);
        Tensor::cat(&[x, &finest], 3)?
            .apply(&self.norm_out0)?
            .apply(&self.conv_out2)?
            .apply(&self.norm_out3)?
            .apply(&self.conv_out)
    }
}
