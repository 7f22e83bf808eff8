//! The vision transformer, used for patches and for the whole image.

use std::sync::Arc;

use candle_core::{Device, Tensor};

use super::ModelError;
use super::compute::Kernels;
use super::config::VitConfig;
use super::observer::{StageObserver, StageValue};
use super::ops::{Linear, Recompute, attention, gather, layer_norm};
use super::params::{Params, Weight};

/// Number of images whose intermediate values are in memory at a time. In the SHARP release's network,
/// none of these values exceeds 32 MiB, the size up to which glibc reuses freed memory; fresh pages
/// would cost a twentieth of a prediction.
const IMAGES_AT_ONCE: usize = 3;

/// Weight and bias of a linear layer or a normalisation.
pub(super) struct Affine {
    weight: Weight,
    bias: Weight,
}

impl Affine {
    pub(super) fn new(p: &Params<'_>, shape: &[usize]) -> Self {
        Self {
            weight: p.get("weight", shape),
            bias: p.get("bias", &shape[..1]),
        }
    }

    /// Builds a linear layer whose outputs are multiplied by `scale`.
    pub(super) fn linear(
        &self,
        kernels: Option<Kernels>,
        scale: Option<&Weight>,
    ) -> candle_core::Result<Linear> {
        let (mut weight, mut bias) = (self.weight.get()?.flatten_from(1)?, self.bias.get()?);
        if let Some(scale) = scale {
            let scale = scale.get()?;
            weight = weight.broadcast_mul(&scale.unsqueeze(1)?)?;
            bias = (bias * scale)?;
        }
        Linear::new(kernels, weight, bias)
    }

    fn norm(&self) -> candle_core::Result<[Tensor; 2]> {
        Ok([self.weight.get()?, self.bias.get()?])
    }
}

/// Pre-norm blocks over a class token and one token per patch.
pub(super) struct Vit {
    patch_embed: Affine,
    cls_token: Weight,
    pos_embed: Weight,
    blocks: Vec<Arc<VitBlock>>,
    norm: Affine,
    shape: Shape,
    recompute: Option<Recompute>,
    device: Device,
}

/// `x += ls1 · attention(norm1(x))`, then `x += ls2 · mlp(norm2(x))`.
struct VitBlock {
    norm1: Affine,
    qkv: Affine,
    proj: Affine,
    ls1: Weight,
    norm2: Affine,
    fc1: Affine,
    fc2: Affine,
    ls2: Weight,
}

/// Sizes, and the epsilon of the normalisations.
#[derive(Debug, Clone, Copy)]
struct Shape {
    kernels: Option<Kernels>,
    /// Side of an image in pixels.
    image: usize,
    /// Side of a token's patch in pixels.
    patch: usize,
    /// Number of tokens along a side.
    side: usize,
    dim: usize,
    heads: usize,
    /// Added to the variance in normalisations.
    norm_eps: f32,
}

/// Outputs of the transformer.
pub(super) struct Features {
    /// Images made of the tokens of the tapped blocks, not normalised, in block order.
    pub(super) taps: Vec<Tensor>,
    /// `[images, 1 + side², dim]`; each image's tokens follow its class token.
    pub(super) last: Tensor,
}

impl Vit {
    pub(super) fn new(p: &Params<'_>, config: &VitConfig) -> Self {
        let (dim, patch) = (config.embed_dim, config.patch_size);
        let side = config.tokens_per_side();
        p.pp("head").unused("weight", &[config.num_classes, dim]);
        p.pp("head").unused("bias", &[config.num_classes]);
        let embed = p.pp("patch_embed").pp("proj");
        let blocks = p.pp("blocks");
        Self {
            patch_embed: Affine::new(&embed, &[dim, 3, patch, patch]),
            cls_token: p.get("cls_token", &[1, 1, dim]),
            pos_embed: p.get("pos_embed", &[1, side * side + 1, dim]),
            blocks: (0..config.depth)
                .map(|k| Arc::new(VitBlock::new(&blocks.pp(k), dim)))
                .collect(),
            norm: Affine::new(&p.pp("norm"), &[dim]),
            shape: Shape {
                kernels: p.kernels,
                image: config.img_size,
                patch,
                side,
                dim,
                heads: config.num_heads,
                norm_eps: config.norm_eps,
            },
            recompute: p.recompute.clone(),
            device: p.device().clone(),
        }
    }

    /// Runs the transformer on `images`, `[images, 3, size, size]` in −1..1. Stages are named `name.…`. Each of `taps`
    /// is the index of a block and the `places` argument of [`gather`].
    pub(super) fn forward(
        &self,
        images: &[f32],
        taps: &[(usize, &Tensor)],
        name: &str,
        observer: &mut dyn StageObserver,
    ) -> Result<Features, ModelError> {
        let Shape {
            kernels,
            image: size,
            patch,
            side,
            dim,
            norm_eps,
            ..
        } = self.shape;
        let mut see =
            |stage: &str, value: StageValue<'_>| observer.stage(&format!("{name}.{stage}"), value);
        let count = images.len() / (3 * size * size);
        see("input", StageValue::host(&[count, 3, size, size], images))?;
        let shape = (count, side * side, 3 * patch * patch);
        let squares = Tensor::from_vec(self.squares(images), shape, &self.device)?;
        let embedded = self.patch_embed.linear(kernels, None)?.forward(&squares)?;
        drop(squares);
        see("patch_embed", StageValue::tensor(&embedded))?;
        let class = self.cls_token.get()?.broadcast_as((count, 1, dim))?;
        let mut x = Tensor::cat(&[&class.contiguous()?, &embedded], 1)?;
        drop(embedded);
        x = x.broadcast_add(&self.pos_embed.get()?)?;
        see("tokens_in", StageValue::tensor(&x))?;
        let mut tapped = Vec::with_capacity(taps.len());
        for (k, block) in self.blocks.iter().enumerate() {
            x = match &self.recompute {
                None => block.forward(x, self.shape)?,
                Some(recompute) => {
                    let (block, shape) = (Arc::clone(block), self.shape);
                    recompute.run(&[&x], move |x| Ok(block.forward(x[0].clone(), shape)?))?
                }
            };
            see(&format!("block{k}"), StageValue::tensor(&x))?;
            for (_, tokens) in taps.iter().filter(|(tap, _)| *tap == k) {
                tapped.push(gather(&x, tokens)?);
            }
        }
        let [gamma, beta] = &self.norm.norm()?;
        let last = layer_norm(kernels, &x, [gamma, beta], norm_eps)?;
        see("out", StageValue::tokens(&last))?;
        Ok(Features { taps: tapped, last })
    }

    /// Patches of pixels as rows `[images · side², 3 · patch²]`, in the order of the embedding's weights.
    fn squares(&self, images: &[f32]) -> Vec<f32> {
        let Shape {
            image: size,
            patch,
            side,
            ..
        } = self.shape;
        let mut rows = Vec::with_capacity(images.len());
        for image in images.chunks_exact(3 * size * size) {
            for (y, x) in (0..side).flat_map(|y| (0..side).map(move |x| (y, x))) {
                for plane in image.chunks_exact(size * size) {
                    for dy in 0..patch {
                        rows.extend(&plane[(y * patch + dy) * size + x * patch..][..patch]);
                    }
                }
            }
        }
        rows
    }
}

impl VitBlock {
    fn new(p: &Params<'_>, dim: usize) -> Self {
        let (attention, mlp) = (p.pp("attn"), p.pp("mlp"));
        Self {
            norm1: Affine::new(&p.pp("norm1"), &[dim]),
            qkv: Affine::new(&attention.pp("qkv"), &[3 * dim, dim]),
            proj: Affine::new(&attention.pp("proj"), &[dim, dim]),
            ls1: p.pp("ls1").get("gamma", &[dim]),
            norm2: Affine::new(&p.pp("norm2"), &[dim]),
            fc1: Affine::new(&mlp.pp("fc1"), &[4 * dim, dim]),
            fc2: Affine::new(&mlp.pp("fc2"), &[dim, 4 * dim]),
            ls2: p.pp("ls2").get("gamma", &[dim]),
        }
    }

    /// Applies the block; the shape `[images, tokens, dim]` is preserved.
    fn forward(&self, x: Tensor, shape: Shape) -> candle_core::Result<Tensor> {
        let Shape {
            kernels,
            heads,
            norm_eps,
            ..
        } = shape;
        let [norm1, norm2] = [self.norm1.norm()?, self.norm2.norm()?];
        let qkv = self.qkv.linear(kernels, None)?;
        let proj = self.proj.linear(kernels, Some(&self.ls1))?;
        let fc1 = self.fc1.linear(kernels, None)?;
        let fc2 = self.fc2.linear(kernels, Some(&self.ls2))?;
        let norm = |x: &Tensor, [gamma, beta]: &[Tensor; 2]| {
            layer_norm(kernels, x, [gamma, beta], norm_eps)
        };
        let run = |x: Tensor| {
            let attended = attention(kernels, &qkv.forward(&norm(&x, &norm1)?)?, heads)?;
            let x = proj.add_to(x, &attended)?;
            drop(attended);
            let hidden = fc1.forward_gelu(&norm(&x, &norm2)?)?;
            fc2.add_to(x, &hidden)
        };
        if kernels.is_some_and(|kernels| kernels.learning) {
            return run(x);
        }
        let count = x.dim(0)?;
        let parts = (0..count).step_by(IMAGES_AT_ONCE);
        let parts =
            parts.map(|first| run(x.narrow(0, first, IMAGES_AT_ONCE.min(count - first))?));
        let parts = parts.collect::<candle_core::Result<Vec<_>>>()?;
        match kernels {
            // The parts are views of `x` and were updated in place.
            Some(_) => Ok(x),
            None => Tensor::cat(&parts, 0),
        }
    }
}
