//! Encoder maps, image and depth to the deltas that refine base Gaussians.

use super::alignment::NormResidualBlock;
use super::config::LAYERS;
use super::decoder::{FusionBlock, MultiresConvDecoder};
use super::engine::Runtime;
use super::layers::{Conv, Fused};
use super::map::Map;
use super::observer::{StageObserver, StageValue};
use super::params::Params;
use super::{ModelConfig, ModelError};

/// Attributes whose deltas come from the geometry head: x, y, inverse depth.
const GEOMETRY: usize = 3;
/// The others: scales, quaternion, colour, opacity.
const TEXTURE: usize = 11;

/// The decoder (`feature_model` in the checkpoint).
pub(super) struct GaussianDecoder {
    decoder: MultiresConvDecoder,
    skip: Conv,
    fusion: FusionBlock,
    texture_head: AttributeHead,
    geometry_head: AttributeHead,
    /// Pixels of the decoder's finest map along a Gaussian's block.
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
            fusion: FusionBlock::new(&p.pp("fusion"), dim, true, false),
            texture_head: AttributeHead::new(&p.pp("texture_head"), config),
            geometry_head: AttributeHead::new(&p.pp("geometry_head"), config),
            // The finest map has half the internal resolution. Coarser Gaussians see its means:
            // our choice, the release only knows stride 2, where nothing is pooled.
            pooling: stride / 2,
        }
    }

    /// `maps` of the encoder and `input` `[5, R, R]` (image and inverse depth in −1..1) to texture
    /// and geometry features `[out, R/stride, R/stride]`.
    pub(super) fn forward(
        &self,
        rt: &Runtime,
        maps: [Map; 5],
        input: &Map,
        observer: &mut dyn StageObserver,
    ) -> Result<[Map; 2], ModelError> {
        let mut decoded = self.decoder.forward(rt, &maps, "gauss_decoder", observer)?;
        drop(maps);
        if self.pooling > 1 {
            decoded = decoded.avg_pool(self.pooling)?;
        }
        let skip = self.skip.forward(rt, input, Fused::default())?;
        observer.stage("gauss_decoder.skip", StageValue::map(&skip))?;
        let fused = self.fusion.forward(rt, Some(decoded), &skip)?;
        drop(skip);
        observer.stage("gauss_decoder.fused", StageValue::map(&fused))?;
        let texture = self
            .texture_head
            .forward(rt, &fused, "texture_head", observer)?;
        let geometry = self
            .geometry_head
            .forward(rt, &fused, "geometry_head", observer)?;
        Ok([texture, geometry])
    }
}

/// Two residual blocks and a projection, ReLU at the end.
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
            conv3: Conv::point(&p.pp(3), dim, config.gaussian_dim_out, true),
        }
    }

    /// `[dim, h, w]` to `[out, h, w]`, ≥ 0.
    fn forward(
        &self,
        rt: &Runtime,
        x: &Map,
        name: &str,
        observer: &mut dyn StageObserver,
    ) -> Result<Map, ModelError> {
        let mut see = |stage: &str, value: &Map| {
            observer.stage(&format!("{name}.{stage}"), StageValue::map(value))
        };
        let mut x = self.blocks[0].forward(rt, x, |normal| see("0.groupnorm", normal))?;
        see("0", &x)?;
        x = self.blocks[1].forward(rt, &x, |_| Ok(()))?;
        see("1", &x)?;
        let both = Fused {
            relu_input: true,
            residual: None,
            relu: true,
        };
        x = self.conv3.forward(rt, &x, both)?;
        see("out", &x)?;
        Ok(x)
    }
}

/// Two projections to deltas (`prediction_head` in the checkpoint).
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

    /// Features `[out, h, w]` to the deltas of geometry `[3 · 2, h, w]` and of texture
    /// `[11 · 2, h, w]`; one after the other they are what [`compose`](crate::composer::compose)
    /// takes. A channel's layer varies fastest.
    pub(super) fn forward(
        &self,
        rt: &Runtime,
        texture: &Map,
        geometry: &Map,
    ) -> Result<[Map; 2], ModelError> {
        Ok([
            self.geometry.forward(rt, geometry, Fused::default())?,
            self.texture.forward(rt, texture, Fused::default())?,
        ])
    }
}
