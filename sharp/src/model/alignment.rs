//! A map of factors that brings predicted depth to known depth: a small U-Net. It was trained
//! along with the network; a prediction does not need it.

use super::engine::Runtime;
use super::layers::{Conv, Fused, GroupNormLayer};
use super::map::Map;
use super::params::Params;
use super::{ModelConfig, ModelError};

/// Groups of every normalisation here.
const GROUPS: usize = 4;

/// Nearest depth that the network sees, metres.
pub(super) const MIN_DEPTH: f32 = 1e-4;

/// A convolution of the rectified input.
const RECTIFIED: Fused<'_> = Fused {
    relu_input: true,
    residual: None,
    relu: false,
};

/// `relu(norm(x))`, then a convolution, twice, beside a shortcut.
pub(super) struct NormResidualBlock {
    norm0: GroupNormLayer,
    conv2: Conv,
    norm3: GroupNormLayer,
    conv5: Conv,
    shortcut: Option<Conv>,
}

impl NormResidualBlock {
    /// The inner width is half of `output`; a block that changes the width has a 1×1 shortcut.
    pub(super) fn new(p: &Params<'_>, input: usize, output: usize, groups: usize) -> Self {
        let (residual, inner) = (p.pp("residual"), output / 2);
        Self {
            norm0: GroupNormLayer::new(&residual.pp(0), input, groups),
            conv2: Conv::spatial(&residual.pp(2), input, inner, true),
            norm3: GroupNormLayer::new(&residual.pp(3), inner, groups),
            conv5: Conv::spatial(&residual.pp(5), inner, output, true),
            shortcut: (input != output)
                .then(|| Conv::point(&p.pp("shortcut"), input, output, true)),
        }
    }

    /// `[input, h, w]` to `[output, h, w]`; `see` is shown the first normalisation.
    pub(super) fn forward(
        &self,
        rt: &Runtime,
        x: &Map,
        see: impl FnOnce(&Map) -> Result<(), ModelError>,
    ) -> Result<Map, ModelError> {
        let mut y = self.norm0.forward(rt, x)?;
        see(&y)?;
        y = self.conv2.forward(rt, &y, RECTIFIED)?;
        y = self.norm3.forward(rt, &y)?;
        let through = match &self.shortcut {
            Some(shortcut) => Some(shortcut.forward(rt, x, Fused::default())?),
            None => None,
        };
        let residual = Some(through.as_ref().unwrap_or(x));
        self.conv5.forward(
            rt,
            &y,
            Fused {
                residual,
                ..RECTIFIED
            },
        )
    }

    fn silent(&self, rt: &Runtime, x: &Map) -> Result<Map, ModelError> {
        self.forward(rt, x, |_| Ok(()))
    }
}

/// The network's input for a depth in metres.
pub(super) fn inverse_depth(depth: f32) -> f32 {
    1.0 / depth.max(MIN_DEPTH)
}

pub(super) struct DepthAlignment {
    conv_in: Conv,
    norm_in: GroupNormLayer,
    down: Vec<[NormResidualBlock; 2]>,
    up: Vec<[NormResidualBlock; 2]>,
    norm_out0: GroupNormLayer,
    conv_out2: Conv,
    norm_out3: GroupNormLayer,
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
            // All but the first step see their predecessor beside the encoder's map.
            let input = width(steps - k) * if k == 0 { 1 } else { 2 };
            let p = decoder.pp("convs_up").pp(k);
            pair(p, input, width(steps - k - 1))
        };
        let (conv_in, conv_out) = (encoder.pp("conv_in"), decoder.pp("conv_out"));
        Self {
            conv_in: Conv::spatial(&conv_in.pp(0), 2, base, true),
            norm_in: GroupNormLayer::new(&conv_in.pp(1), base, GROUPS),
            down: (0..steps).map(down).collect(),
            up: (0..steps).map(up).collect(),
            norm_out0: GroupNormLayer::new(&conv_out.pp(0), 2 * base, GROUPS),
            conv_out2: Conv::point(&conv_out.pp(2), 2 * base, base, true),
            norm_out3: GroupNormLayer::new(&conv_out.pp(3), base, GROUPS),
            conv_out: Conv::point(&p.pp("conv_out"), base, 1, true),
        }
    }

    /// The logarithm `[1, R, R]` of the factors, from inverse depth `[2, R, R]`: that of the first
    /// predicted layer and the known one, each as [`inverse_depth`] makes it.
    pub(super) fn forward(&self, rt: &Runtime, input: &Map) -> Result<Map, ModelError> {
        let first = self.conv_in.forward(rt, input, Fused::default())?;
        let mut maps = vec![self.norm_in.forward(rt, &first)?.relu()?];
        for [widen, refine] in &self.down {
            let x = maps[maps.len() - 1].avg_pool(2)?;
            maps.push(refine.silent(rt, &widen.silent(rt, &x)?)?);
        }
        let mut x: Option<Map> = None;
        for [narrow, refine] in &self.up {
            let skip = maps.pop().ok_or_else(super::map::mixed)?;
            let joined = match &x {
                Some(x) => x.cat(&skip)?,
                None => skip,
            };
            let joined = joined.double_nearest()?;
            x = Some(refine.silent(rt, &narrow.silent(rt, &joined)?)?);
        }
        let (Some(x), Some(finest)) = (x, maps.pop()) else {
            return Err(super::map::mixed());
        };
        let mut x = self.norm_out0.forward(rt, &x.cat(&finest)?)?;
        x = self.conv_out2.forward(rt, &x, RECTIFIED)?;
        x = self.norm_out3.forward(rt, &x)?;
        self.conv_out.forward(rt, &x, RECTIFIED)
    }
}
