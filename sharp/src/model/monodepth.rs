//! Layers of disparity from an image: two in SHARP, one in Depth Pro.

use std::sync::Arc;

use candle_core::Tensor;
use candle_nn::Module;

use super::decoder::MultiresConvDecoder;
use super::layers::{Conv, Deconv};
use super::observer::{Silent, StageObserver, StageValue};
use super::ops::Recompute;
use super::params::Params;
use super::pyramid::Encoder;
use super::{ModelConfig, ModelError};

pub(super) struct Monodepth {
    encoder: Encoder,
    decoder: MultiresConvDecoder,
    head: Arc<DisparityHead>,
    recompute: Option<Recompute>,
}

/// Outputs of the depth network that the rest of the network uses.
pub(super) struct MonodepthOutput {
    pub(super) features: [Tensor; 5],
    /// `[1, R, R, layers]`: inverse depth for a focal length of one image width; negative values are replaced by 0. The
    /// layers are not sorted.
    pub(super) disparity: Tensor,
}

impl Monodepth {
    pub(super) fn new(p: &Params<'_>, config: &ModelConfig, layers: usize) -> Self {
        let [d0, d1, d2, d3] = config.encoder_dims;
        let dim = config.monodepth_dims_decoder[0];
        Self {
            encoder: Encoder::new(&p.pp("encoder"), config),
            decoder: MultiresConvDecoder::new(&p.pp("decoder"), [d0, d0, d1, d2, d3], dim),
            head: Arc::new(DisparityHead::new(&p.pp("head"), dim, layers)),
            recompute: p.recompute.clone(),
        }
    }

    /// Runs the depth network on `image`, `[3, R, R]` in −1..1.
    pub(super) fn forward(
        &self,
        image: &[f32],
        observer: &mut dyn StageObserver,
    ) -> Result<MonodepthOutput, ModelError> {
        let features = self.encoder.forward(image, observer)?;
        let decoded = self.decoder.forward(&features, "depth_decoder", observer)?;
        let disparity = match &self.recompute {
            None => self.head.forward(decoded, observer)?,
            Some(recompute) => {
                let head = Arc::clone(&self.head);
                recompute.run(&[&decoded], move |x| {
                    head.forward(x[0].clone(), &mut Silent)
                })?
            }
        };
        observer.stage("disparity", StageValue::rectified(&disparity))?;
        Ok(MonodepthOutput {
            features,
            disparity,
        })
    }

    /// The coarsest feature map in the decoder's width.
    pub(super) fn coarsest(&self, features: &[Tensor; 5]) -> candle_core::Result<Tensor> {
        self.decoder.coarsest(features)
    }
}

/// Doubles the resolution and reduces to one channel per layer.
struct DisparityHead {
    conv0: Conv,
    deconv1: Deconv,
    conv2: Conv,
    conv4: Conv,
}

impl DisparityHead {
    fn new(p: &Params<'_>, dim: usize, layers: usize) -> Self {
        Self {
            conv0: Conv::spatial(&p.pp(0), dim, dim / 2, true),
            deconv1: Deconv::new(&p.pp(1), dim / 2, dim / 2, true),
            conv2: Conv::spatial(&p.pp(2), dim / 2, 32, true),
            conv4: Conv::point(&p.pp(4), 32, layers, true).after_relu(),
        }
    }

    /// Computes disparity from the decoder's features `x`.
    fn forward(
        &self,
        mut x: Tensor,
        observer: &mut dyn StageObserver,
    ) -> Result<Tensor, ModelError> {
        // `x` is reassigned rather than shadowed, so that each map (a gigabyte) is freed once the next one exists.
        x = self.conv0.forward(&x)?;
        observer.stage("depth_head.0", StageValue::image(&x))?;
        x = self.deconv1.forward(&x)?;
        observer.stage("depth_head.1", StageValue::image(&x))?;
        x = self.conv2.forward(&x)?;
        observer.stage("depth_head.2", StageValue::image(&x))?;
        observer.stage("depth_head.3", StageValue::rectified(&x))?;
        x = self.conv4.forward(&x)?;
        observer.stage("depth_head.4", StageValue::image(&x))?;
        Ok(x)
    }
}
