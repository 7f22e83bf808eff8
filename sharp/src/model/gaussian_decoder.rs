//! Decoder from encoder maps, image and depth to the deltas that refine base Gaussians.

use std::sync::Arc;

use candle_core::Tensor;
use candle_nn::Module;

use super::alignment::NormResidualBlock;
use super::config::LAYERS;
use super::decoder::{FusionBlock, MultiresConvDecoder};
use super::layers::Conv;
use super::observer::{Silent, StageObserver, StageValue};
use super::ops::{Recompute, avg_pool};
use super::params::Params;
use super::{ModelConfig, ModelError};

/// Number of attributes predicted by the geometry head: x, y, inverse depth.
const GEOMETRY: usize = 3;
/// Number of attributes predicted by the texture head: scales, quaternion, colour, opacity.
const TEXTURE: usize = 11;

/// Feature decoder (`feature_model` in the checkpoint).
pub(super) struct GaussianDecoder {
    decoder: MultiresConvDecoder,
    skip: Conv,
    fusion: Arc<FusionBlock>,
    texture_head: Arc<AttributeHead>,
    geometry_head: Arc<AttributeHead>,
    recompute: Option<Recompute>,
    /// Side, in pixels of the decoder's finest map, of the block that one Gaussian covers.
    pooling: usize,
}

impl GaussianDecoder {
    pub(super) fn new(p: &Params<'_>, config: &ModelConfig) -> Self {
        let [d0, d1, d2, d3] = config.encoder_dims;
        let dim = config.gaussian_dims_decoder[0];
        let stride = config.gaussian_stride;
        let skip = p.pp("image_encoder").pp("conv");
        Self {
            decoder: MultiresConvDecoder::new(&p.pp("decoder"), [d0, d0, d1, d2, d3], dim),
            skip: Conv::blocks(&skip, 3 + LAYERS, dim, stride),
            fusion: Arc::new(FusionBlock::new(&p.pp("fusion"), dim, true, false)),
            texture_head: Arc::new(AttributeHead::new(&p.pp("texture_head"), config)),
            geometry_head: Arc::new(AttributeHead::new(&p.pp("geometry_head"), config)),
            recompute: p.recompute.clone(),
            // The finest map has half the internal resolution. For a stride above 2, it is averaged over blocks. This
            // is our choice: the SHARP release only supports stride 2, which needs no pooling.
            pooling: stride / 2,
        }
    }

    /// Maps the encoder's `maps` and `input` (`[1, R, R, 5]`: image and inverse depth in −1..1) to texture and geometry
    /// features, one pixel per Gaussian of a layer.
    pub(super) fn forward(
        &self,
        maps: [Tensor; 5],
        input: &Tensor,
        observer: &mut dyn StageObserver,
    ) -> Result<[Tensor; 2], ModelError> {
        let mut decoded = self.decoder.forward(&maps, "gauss_decoder", observer)?;
        drop(maps);
        if self.pooling > 1 {
            decoded = avg_pool(&decoded, self.pooling)?;
        }
        let skip = self.skip.forward(input)?;
        observer.stage("gauss_decoder.skip", StageValue::image(&skip))?;
        let fused = match &self.recompute {
            None => self.fusion.forward(Some(decoded), &skip)?,
            Some(recompute) => {
                let fusion = Arc::clone(&self.fusion);
                recompute.run(&[&decoded, &skip], move |inputs| {
                    Ok(fusion.forward(Some(inputs[0].clone()), &inputs[1])?)
                })?
            }
        };
        drop(skip);
        observer.stage("gauss_decoder.fused", StageValue::image(&fused))?;
        let mut attributes = |head: &Arc<AttributeHead>, name| match &self.recompute {
            None => head.forward(&fused, name, observer),
            Some(recompute) => {
                let head = Arc::clone(head);
                recompute.run(&[&fused], move |x| head.forward(&x[0], name, &mut Silent))
            }
        };
        Ok([
            attributes(&self.texture_head, "texture_head")?,
            attributes(&self.geometry_head, "geometry_head")?,
        ])
    }
}

/// Two residual blocks and a projection, with a final ReLU.
struct AttributeHead {
    blocks: [NormResidualBlock; 2],
    conv3: Conv,
}

impl AttributeHead {
    fn new(p: &Params<'_>, config: &ModelConfig) -> Self {
        let dim = config.gaussian_dims_decoder[0];
        let groups = config.gaussian_norm_num_groups;
        let block = |k: usize| NormResidualBlock::new(&p.pp(k), dim, dim, groups);
        Self {
            blocks: [block(0), block(1)],
            conv3: Conv::point(&p.pp(3), dim, config.gaussian_dim_out, true)
                .after_relu()
                .then_relu(),
        }
    }

    /// Applies the head; its outputs are at least 0.
    fn forward(
        &self,
        x: &Tensor,
        name: &str,
        observer: &mut dyn StageObserver,
    ) -> Result<Tensor, ModelError> {
        let mut see = |stage: &str, value: &Tensor| {
            observer.stage(&format!("{name}.{stage}"), StageValue::image(value))
        };
        let normal = self.blocks[0].normalized(x)?;
        see("0.groupnorm", &normal)?;
        let mut x = self.blocks[0].refined(x, normal)?;
        see("0", &x)?;
        x = self.blocks[1].forward(&x)?;
        see("1", &x)?;
        x = self.conv3.forward(&x)?;
        see("out", &x)?;
        Ok(x)
    }
}

/// Two projections from features to deltas (`prediction_head` in the checkpoint).
pub(super) struct PredictionHead {
    geometry: Conv,
    texture: Conv,
}

impl PredictionHead {
    pub(super) fn new(p: &Params<'_>, config: &ModelConfig) -> Self {
        let (dim, head) = (config.gaussian_dim_out, "prediction_head");
        let conv = |kind: &str, attributes: usize| {
            let p = p.pp(format!("{kind}_{head}"));
            Conv::point(&p, dim, attributes * LAYERS, true)
        };
        Self {
            geometry: conv("geometry", GEOMETRY),
            texture: conv("texture", TEXTURE),
        }
    }

    /// Maps features to the deltas of geometry (`3 · 2` channels) and texture (`11 · 2` channels).
    /// The planes of geometry followed by the planes of texture are the input of
    /// [`compose`](crate::composer::compose). The layer is the fastest-varying index of the
    /// channels.
    pub(super) fn forward(
        &self,
        [texture, geometry]: [Tensor; 2],
    ) -> candle_core::Result<[Tensor; 2]> {
        Ok([
            self.geometry.forward(&geometry)?,
            self.texture.forward(&texture)?,
        ])
    }
}
