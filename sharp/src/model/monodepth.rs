//! Two layers of disparity from an image.

use candle_core::Tensor;

use super::config::LAYERS;
use super::decoder::MultiresConvDecoder;
use super::observer::{Observer, StageValue};
use super::ops::{Conv1x1, Conv3x3, Deconv2x2};
use super::params::Params;
use super::pyramid::Encoder;
use super::{ModelConfig, ModelError};

/// Encoder, decoder and head.
pub(super) struct Monodepth {
    encoder: Encoder,
    decoder: MultiresConvDecoder,
    head: Head,
}

/// What the rest of the network needs of the depth network.
pub(super) struct MonodepthOutput {
    /// The encoder's five maps.
    pub(super) features: [Tensor; 5],
    /// `[1, 2, R, R]`, ≥ 0: inverse depth for a focal length of one image width. The layers are
    /// not sorted.
    pub(super) disparity: Tensor,
}

impl Monodepth {
    pub(super) fn new(p: &Params<'_>, config: &ModelConfig) -> Result<Self, ModelError> {
        let [d0, d1, d2, d3] = config.encoder_dims;
        let dim = config.monodepth_dims_decoder[0];
        Ok(Self {
            encoder: Encoder::new(&p.pp("encoder"), config)?,
            decoder: MultiresConvDecoder::new(&p.pp("decoder"), [d0, d0, d1, d2, d3], dim)?,
            head: Head::new(&p.pp("head"), dim)?,
        })
    }

    /// `image` is `[1, 3, R, R]` in −1..1.
    pub(super) fn forward(
        &self,
        image: &Tensor,
        observer: &mut dyn Observer,
    ) -> Result<MonodepthOutput, ModelError> {
        let features = self.encoder.forward(image, observer)?;
        let decoded = self.decoder.forward(&features, "depth_decoder", observer)?;
        let disparity = self.head.forward(decoded, observer)?;
        observer.stage("disparity", StageValue::Tensor(&disparity))?;
        Ok(MonodepthOutput {
            features,
            disparity,
        })
    }
}

/// Doubles the resolution and reduces to one channel a layer.
struct Head {
    conv0: Conv3x3,
    deconv1: Deconv2x2,
    conv2: Conv3x3,
    conv4: Conv1x1,
}

impl Head {
    fn new(p: &Params<'_>, dim: usize) -> Result<Self, ModelError> {
        Ok(Self {
            conv0: Conv3x3::new(&p.pp(0), dim, dim / 2, true)?,
            deconv1: Deconv2x2::new(&p.pp(1), dim / 2, dim / 2, true)?,
            conv2: Conv3x3::new(&p.pp(2), dim / 2, 32, true)?,
            conv4: Conv1x1::new(&p.pp(4), 32, LAYERS, true)?,
        })
    }

    /// `[1, dim, R/2, R/2]` to `[1, 2, R, R]`.
    fn forward(&self, x: Tensor, observer: &mut dyn Observer) -> Result<Tensor, ModelError> {
        let mut see = |index: usize, value: Tensor| {
            let name = format!("depth_head.{index}");
            observer.stage(&name, StageValue::Tensor(&value))?;
            Ok::<_, ModelError>(value)
        };
        let x = see(0, self.conv0.forward(&x)?)?;
        let x = see(1, self.deconv1.forward(&x)?)?;
        let x = see(2, self.conv2.forward(&x)?)?;
        let x = see(3, x.relu()?)?;
        let x = see(4, self.conv4.forward(&x)?)?;
        Ok(x.relu()?)
    }
}
