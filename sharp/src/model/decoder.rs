//! The multi-resolution decoder: five feature maps fused from coarse to fine.

use std::sync::Arc;

use candle_core::Tensor;
use candle_nn::Module;

use super::ModelError;
use super::layers::{Conv, Deconv};
use super::observer::{StageObserver, StageValue};
use super::ops::Recompute;
use super::params::Params;

/// `y + conv3(relu(conv1(relu(y))))`, where both convolutions are 3×3; no normalisation.
struct ResidualBlock {
    conv1: Conv,
    conv3: Conv,
}

impl ResidualBlock {
    fn new(p: &Params<'_>, dim: usize) -> Self {
        let residual = p.pp("residual");
        Self {
            conv1: Conv::spatial(&residual.pp(1), dim, dim, true).after_relu(),
            conv3: Conv::spatial(&residual.pp(3), dim, dim, true).after_relu(),
        }
    }

    /// Declares the parameters of a block that is in the checkpoint but never used.
    fn unused(p: &Params<'_>, dim: usize) {
        for conv in [1, 3] {
            let conv = p.pp("residual").pp(conv);
            conv.unused("weight", &[dim, dim, 3, 3]);
            conv.unused("bias", &[dim]);
        }
    }
}

impl Module for ResidualBlock {
    fn forward(&self, y: &Tensor) -> candle_core::Result<Tensor> {
        self.conv3.forward_plus(&self.conv1.forward(y)?, y)
    }
}

/// Adds a map to the output of the next coarser level, refines it, and doubles the resolution.
pub(super) struct FusionBlock {
    resnet1: Option<ResidualBlock>,
    resnet2: ResidualBlock,
    deconv: Option<Deconv>,
    out_conv: Conv,
}

impl FusionBlock {
    /// `skip`: true if a finer map is added; `upsample`: true if the resolution is doubled.
    pub(super) fn new(p: &Params<'_>, dim: usize, skip: bool, upsample: bool) -> Self {
        let resnet1 = p.pp("resnet1");
        if !skip {
            ResidualBlock::unused(&resnet1, dim);
        }
        Self {
            resnet1: skip.then(|| ResidualBlock::new(&resnet1, dim)),
            resnet2: ResidualBlock::new(&p.pp("resnet2"), dim),
            deconv: upsample.then(|| Deconv::new(&p.pp("deconv"), dim, dim, false)),
            out_conv: Conv::point(&p.pp("out_conv"), dim, dim, true),
        }
    }

    /// Adds the level's own `map` to `x`, the output of the coarser level, which has the same size; without `x`, the
    /// map itself is refined. If the block upsamples, the output's sides are doubled.
    pub(super) fn forward(&self, x: Option<Tensor>, map: &Tensor) -> candle_core::Result<Tensor> {
        let mut x = match (&self.resnet1, x) {
            (Some(resnet1), Some(x)) => {
                let both = (x + resnet1.forward(map)?)?;
                self.resnet2.forward(&both)?
            }
            _ => self.resnet2.forward(map)?,
        };
        if let Some(deconv) = &self.deconv {
            x = deconv.forward(&x)?;
        }
        self.out_conv.forward(&x)
    }
}

/// Fuses feature maps of several resolutions; one decoder serves depth, another the Gaussians.
pub(super) struct MultiresConvDecoder {
    /// Levels of the decoder, finest first.
    levels: Vec<Arc<Level>>,
    recompute: Option<Recompute>,
}

struct Level {
    /// Projects the map to the decoder's width, by a 1×1 convolution at the finest level and a 3×3
    /// one elsewhere; `None` if the map already has that width.
    conv: Option<Conv>,
    fusion: FusionBlock,
}

impl Level {
    /// Runs the level; `fused` is the output of the coarser level, if any. `see` receives the stages `conv` and
    /// `fusion`.
    fn forward(
        &self,
        fused: Option<Tensor>,
        map: &Tensor,
        see: &mut dyn FnMut(&str, &Tensor) -> Result<(), ModelError>,
    ) -> Result<Tensor, ModelError> {
        let projected = self.conv.as_ref().map(|conv| conv.forward(map));
        let projected = projected.transpose()?;
        if let Some(map) = &projected {
            see("conv", map)?;
        }
        let map = projected.as_ref().unwrap_or(map);
        let fused = self.fusion.forward(fused, map)?;
        see("fusion", &fused)?;
        Ok(fused)
    }
}

impl MultiresConvDecoder {
    /// `inputs` are the channels of the maps, finest first; `dim` is the decoder's width.
    pub(super) fn new(p: &Params<'_>, inputs: [usize; 5], dim: usize) -> Self {
        let (convs, fusions) = (p.pp("convs"), p.pp("fusions"));
        let conv = |level: usize| {
            let p = convs.pp(level);
            match level {
                0 if inputs[0] == dim => None,
                0 => Some(Conv::point(&p, inputs[0], dim, false)),
                _ => Some(Conv::spatial(&p, inputs[level], dim, false)),
            }
        };
        // All convolutions are declared before the first fusion, as in the checkpoint.
        let convs: Vec<Option<Conv>> = (0..5).map(conv).collect();
        let levels = convs.into_iter().enumerate().map(|(level, conv)| {
            let p = fusions.pp(level);
            let fusion = FusionBlock::new(&p, dim, level < 4, level > 0);
            Arc::new(Level { conv, fusion })
        });
        Self {
            levels: levels.collect(),
            recompute: p.recompute.clone(),
        }
    }

    /// The projection of the coarsest of `maps`.
    pub(super) fn coarsest(&self, maps: &[Tensor; 5]) -> candle_core::Result<Tensor> {
        match &self.levels[4].conv {
            Some(conv) => conv.forward(&maps[4]),
            None => Ok(maps[4].clone()),
        }
    }

    /// Fuses five maps, finest first, each with twice the resolution of the next. The output has the finest resolution.
    pub(super) fn forward(
        &self,
        maps: &[Tensor; 5],
        name: &str,
        observer: &mut dyn StageObserver,
    ) -> Result<Tensor, ModelError> {
        let mut fused: Option<Tensor> = None;
        for (number, (level, map)) in self.levels.iter().zip(maps).enumerate().rev() {
            let mut see = |stage: &str, value: &Tensor| {
                let stage = format!("{name}.{stage}{number}");
                observer.stage(&stage, StageValue::image(value))
            };
            fused = Some(match &self.recompute {
                None => level.forward(fused.take(), map, &mut see)?,
                Some(recompute) => {
                    let level = Arc::clone(level);
                    let inputs: Vec<&Tensor> = [map].into_iter().chain(&fused).collect();
                    recompute.run(&inputs, move |inputs| {
                        let fused = inputs.get(1).cloned();
                        level.forward(fused, &inputs[0], &mut |_, _| Ok(()))
                    })?
                }
            });
        }
        fused.ok_or_else(|| ModelError::Config("a decoder without levels".into()))
    }
}
