//! Two layers of disparity from an image.

use super::config::LAYERS;
use super::decoder::MultiresConvDecoder;
use super::engine::Runtime;
use super::layers::{Conv, Deconv, Fused};
use super::map::Map;
use super::observer::{StageObserver, StageValue};
use super::params::Params;
use super::pyramid::Encoder;
use super::{ModelConfig, ModelError};

pub(super) struct Monodepth {
    encoder: Encoder,
    decoder: MultiresConvDecoder,
    head: DisparityHead,
}

/// Outputs of the depth network that the rest of the network uses.
pub(super) struct MonodepthOutput {
    pub(super) features: [Map; 5],
    /// `[2, R, R]`, ≥ 0: inverse depth for a focal length of one image width. The layers are not
    /// sorted.
    pub(super) disparity: Map,
}

impl Monodepth {
    pub(super) fn new(p: &Params<'_>, config: &ModelConfig) -> Self {
        let [d0, d1, d2, d3] = config.encoder_dims;
        let dim = config.monodepth_dims_decoder[0];
        Self {
            encoder: Encoder::new(&p.pp("encoder"), config),
            decoder: MultiresConvDecoder::new(&p.pp("decoder"), [d0, d0, d1, d2, d3], dim),
            head: DisparityHead::new(&p.pp("head"), dim),
        }
    }

    /// `image` is `[3, R, R]` in −1..1.
    pub(super) fn forward(
        &self,
        rt: &Runtime,
        image: &[f32],
        observer: &mut dyn StageObserver,
    ) -> Result<MonodepthOutput, ModelError> {
        let features = self.encoder.forward(rt, image, observer)?;
        let decoded = self
            .decoder
            .forward(rt, &features, "depth_decoder", observer)?;
        let disparity = self.head.forward(rt, decoded, observer)?;
        observer.stage("disparity", StageValue::map(&disparity))?;
        Ok(MonodepthOutput {
            features,
            disparity,
        })
    }
}

/// Doubles the resolution and reduces to one channel a layer.
struct DisparityHead {
    conv0: Conv,
    deconv1: Deconv,
    conv2: Conv,
    conv4: Conv,
}

impl DisparityHead {
    fn new(p: &Params<'_>, dim: usize) -> Self {
        Self {
            conv0: Conv::spatial(&p.pp(0), dim, dim / 2, true),
            deconv1: Deconv::new(&p.pp(1), dim / 2, dim / 2, true),
            conv2: Conv::spatial(&p.pp(2), dim / 2, 32, true),
            conv4: Conv::point(&p.pp(4), 32, LAYERS, true),
        }
    }

    /// `[dim, R/2, R/2]` to `[2, R, R]`.
    fn forward(
        &self,
        rt: &Runtime,
        mut x: Map,
        observer: &mut dyn StageObserver,
    ) -> Result<Map, ModelError> {
        let mut see = |index: usize, value: Map| {
            let name = format!("depth_head.{index}");
            observer.stage(&name, StageValue::map(&value))?;
            Ok::<_, ModelError>(value)
        };
        // Assigned rather than shadowed: a map is a gigabyte, and gone when the next is there.
        x = see(0, self.conv0.forward(rt, &x, Fused::default())?)?;
        x = see(1, self.deconv1.forward(rt, &x)?)?;
        x = see(2, self.conv2.forward(rt, &x, Fused::default())?)?;
        x = see(3, x.relu()?)?;
        x = see(4, self.conv4.forward(rt, &x, Fused::default())?)?;
        x.relu_with_return()
    }
}
