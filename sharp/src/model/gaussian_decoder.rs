//! Encoder maps, image and depth to the deltas that refine base Gaussians.

use candle_core::Tensor;

use super::alignment::NormResidualBlock;
use super::config::LAYERS;
use super::decoder::{FusionBlock, MultiresConvDecoder};
use super::observer::{Observer, StageValue};
use super::ops::{Conv1x1, PatchConv};
use super::params::Params;
use super::{ModelConfig, ModelError};

/// Attributes whose deltas come from the geometry head: x, y, inverse depth.
const GEOMETRY: usize = 3;
/// The others: scales, quaternion, colour, opacity.
const TEXTURE: usize = 11;

/// The decoder (`feature_model` in the checkpoint).
pub(super) struct GaussianDecoder {
    decoder: MultiresConvDecoder,
    skip: PatchConv,
    fusion: FusionBlock,
    texture_head: Head,
    geometry_head: Head,
    /// Pixels of the decoder's finest map along a Gaussian's block.
    pooling: usize,
}

impl GaussianDecoder {
    pub(super) fn new(p: &Params<'_>, config: &ModelConfig) -> Result<Self, ModelError> {
        let [d0, d1, d2, d3] = config.encoder_dims;
        let dim = config.gaussian_dims_decoder[0];
        let stride = config.gaussian_stride;
        Ok(Self {
            decoder: MultiresConvDecoder::new(&p.pp("decoder"), [d0, d0, d1, d2, d3], dim)?,
            skip: PatchConv::new(&p.pp("image_encoder").pp("conv"), 3 + LAYERS, dim, stride)?,
            fusion: FusionBlock::new(&p.pp("fusion"), dim, true, false)?,
            texture_head: Head::new(&p.pp("texture_head"), config)?,
            geometry_head: Head::new(&p.pp("geometry_head"), config)?,
            // The finest map has half the internal resolution. Coarser Gaussians see its means:
            // our choice, the release only knows stride 2, where nothing is pooled.
            pooling: stride / 2,
        })
    }

    /// `maps` of the encoder and `input` `[1, 5, R, R]` (image and inverse depth in −1..1) to
    /// texture and geometry features `[1, out, R/stride, R/stride]`.
    pub(super) fn forward(
        &self,
        maps: &[Tensor; 5],
        input: &Tensor,
        observer: &mut dyn Observer,
    ) -> Result<[Tensor; 2], ModelError> {
        let mut decoded = self.decoder.forward(maps, "gauss_decoder", observer)?;
        if self.pooling > 1 {
            decoded = decoded.avg_pool2d(self.pooling)?;
        }
        let skip = self.skip.image(input)?;
        observer.stage("gauss_decoder.skip", StageValue::Tensor(&skip))?;
        let fused = self.fusion.forward(decoded, Some(&skip))?;
        drop(skip);
        observer.stage("gauss_decoder.fused", StageValue::Tensor(&fused))?;
        Ok([
            self.texture_head
                .forward(&fused, "texture_head", observer)?,
            self.geometry_head
                .forward(&fused, "geometry_head", observer)?,
        ])
    }
}

/// Two residual blocks and a projection, ReLU at the end.
struct Head {
    blocks: [NormResidualBlock; 2],
    conv3: Conv1x1,
}

impl Head {
    fn new(p: &Params<'_>, config: &ModelConfig) -> Result<Self, ModelError> {
        let dim = config.gaussian_dims_decoder[0];
        let groups = config.gaussian_norm_num_groups;
        let block = |k| NormResidualBlock::new(&p.pp(k), dim, dim, groups);
        Ok(Self {
            blocks: [block(0)?, block(1)?],
            conv3: Conv1x1::new(&p.pp(3), dim, config.gaussian_dim_out, true)?,
        })
    }

    /// `[1, dim, h, w]` to `[1, out, h, w]`, ≥ 0.
    fn forward(
        &self,
        x: &Tensor,
        name: &str,
        observer: &mut dyn Observer,
    ) -> Result<Tensor, ModelError> {
        let mut see = |stage: &str, value: &Tensor| {
            observer.stage(&format!("{name}.{stage}"), StageValue::Tensor(value))
        };
        let x = self.blocks[0].forward(x, |normal| see("0.groupnorm", normal))?;
        see("0", &x)?;
        let x = self.blocks[1].forward(&x, |_| Ok(()))?;
        see("1", &x)?;
        let out = self.conv3.forward(&x.relu()?)?.relu()?;
        see("out", &out)?;
        Ok(out)
    }
}

/// Two projections to deltas (`prediction_head` in the checkpoint).
pub(super) struct PredictionHead {
    geometry: Conv1x1,
    texture: Conv1x1,
}

impl PredictionHead {
    pub(super) fn new(p: &Params<'_>, config: &ModelConfig) -> Result<Self, ModelError> {
        let (dim, head) = (config.gaussian_dim_out, "prediction_head");
        let conv = |kind: &str, attributes: usize| {
            Conv1x1::new(
                &p.pp(format!("{kind}_{head}")),
                dim,
                attributes * LAYERS,
                true,
            )
        };
        Ok(Self {
            geometry: conv("geometry", GEOMETRY)?,
            texture: conv("texture", TEXTURE)?,
        })
    }

    /// Features `[1, out, h, w]` to deltas `[1, 14, 2, h, w]`, in the order of
    /// [`compose`](crate::composer::compose). A channel's layer varies fastest.
    pub(super) fn forward(
        &self,
        texture: &Tensor,
        geometry: &Tensor,
    ) -> Result<Tensor, ModelError> {
        let (_, _, h, w) = texture.dims4()?;
        let position = self.geometry.forward(geometry)?;
        let others = self.texture.forward(texture)?;
        Ok(
            Tensor::cat(&[&position, &others], 1)?.reshape((
                1,
                GEOMETRY + TEXTURE,
                LAYERS,
                h,
                w,
            ))?,
        )
    }
}
