//! The vision transformer that sees patches and the whole image.

use candle_core::{D, Tensor};

use super::ModelError;
use super::config::VitConfig;
use super::observer::{Observer, StageValue};
use super::ops::{LayerNorm, Linear, PatchConv};
use super::params::Params;

/// Images whose attention matrices are in memory at a time: 21 MB each in the release.
const IMAGES_AT_ONCE: usize = 5;

/// Pre-norm blocks over a class token and one token a patch.
pub(super) struct Vit {
    patch_embed: PatchConv,
    cls_token: Tensor,
    pos_embed: Tensor,
    blocks: Vec<Block>,
    norm: LayerNorm,
    tokens_per_side: usize,
}

/// What a transformer yields.
pub(super) struct Features {
    /// Outputs of the tapped blocks, not normalised, `[images, dim, side, side]`.
    pub(super) taps: Vec<Tensor>,
    /// The normalised last output, `[images, dim, side, side]`.
    pub(super) last: Tensor,
}

impl Vit {
    pub(super) fn new(p: &Params<'_>, config: &VitConfig) -> Result<Self, ModelError> {
        let dim = config.embed_dim;
        let side = config.tokens_per_side();
        let blocks = p.pp("blocks");
        p.pp("head").unused("weight", &[config.num_classes, dim]);
        p.pp("head").unused("bias", &[config.num_classes]);
        Ok(Self {
            patch_embed: PatchConv::new(
                &p.pp("patch_embed").pp("proj"),
                config.in_chans,
                dim,
                config.patch_size,
            )?,
            cls_token: p.get("cls_token", &[1, 1, dim])?,
            pos_embed: p.get("pos_embed", &[1, side * side + 1, dim])?,
            blocks: (0..config.depth)
                .map(|k| Block::new(&blocks.pp(k), dim, config.num_heads))
                .collect::<Result<_, _>>()?,
            norm: LayerNorm::new(&p.pp("norm"), dim)?,
            tokens_per_side: side,
        })
    }

    /// `images` is `[images, 3, size, size]` in −1..1; stages are called `name.…`.
    pub(super) fn forward(
        &self,
        images: &Tensor,
        taps: &[usize],
        name: &str,
        observer: &mut dyn Observer,
    ) -> Result<Features, ModelError> {
        let mut see = |stage: &str, value: &Tensor| {
            observer.stage(&format!("{name}.{stage}"), StageValue::Tensor(value))
        };
        see("input", images)?;
        let batch = images.dim(0)?;
        let (_, tokens, dim) = self.pos_embed.dims3()?;
        let embedded = self.patch_embed.rows(images)?;
        let embedded = embedded.reshape((batch, tokens - 1, dim))?;
        see("patch_embed", &embedded)?;
        let class = self.cls_token.broadcast_as((batch, 1, dim))?;
        let mut x = Tensor::cat(&[&class, &embedded], 1)?.broadcast_add(&self.pos_embed)?;
        see("tokens_in", &x)?;
        let mut tapped = Vec::with_capacity(taps.len());
        for (k, block) in self.blocks.iter().enumerate() {
            x = block.forward(&x)?;
            see(&format!("block{k}"), &x)?;
            if taps.contains(&k) {
                tapped.push(self.to_map(&x)?);
            }
        }
        let last = self.to_map(&self.norm.forward(&x)?)?;
        see("out", &last)?;
        Ok(Features { taps: tapped, last })
    }

    /// Tokens `[images, 1 + side², dim]` to `[images, dim, side, side]`, the class token dropped.
    fn to_map(&self, tokens: &Tensor) -> Result<Tensor, ModelError> {
        let (batch, count, dim) = tokens.dims3()?;
        let side = self.tokens_per_side;
        let patches = tokens.narrow(1, 1, count - 1)?.transpose(1, 2)?;
        Ok(patches.contiguous()?.reshape((batch, dim, side, side))?)
    }
}

/// `x += ls1 · attention(norm1(x))`, then `x += ls2 · mlp(norm2(x))`.
struct Block {
    norm1: LayerNorm,
    qkv: Linear,
    proj: Linear,
    ls1: Tensor,
    norm2: LayerNorm,
    fc1: Linear,
    fc2: Linear,
    ls2: Tensor,
    heads: usize,
}

impl Block {
    fn new(p: &Params<'_>, dim: usize, heads: usize) -> Result<Self, ModelError> {
        let (attention, mlp) = (p.pp("attn"), p.pp("mlp"));
        Ok(Self {
            norm1: LayerNorm::new(&p.pp("norm1"), dim)?,
            qkv: Linear::new(&attention.pp("qkv"), dim, 3 * dim)?,
            proj: Linear::new(&attention.pp("proj"), dim, dim)?,
            ls1: p.pp("ls1").get("gamma", &[dim])?,
            norm2: LayerNorm::new(&p.pp("norm2"), dim)?,
            fc1: Linear::new(&mlp.pp("fc1"), dim, 4 * dim)?,
            fc2: Linear::new(&mlp.pp("fc2"), 4 * dim, dim)?,
            ls2: p.pp("ls2").get("gamma", &[dim])?,
            heads,
        })
    }

    /// `[images, tokens, dim]` to the same shape, a few images at a time.
    fn forward(&self, x: &Tensor) -> Result<Tensor, ModelError> {
        let (batch, tokens, dim) = x.dims3()?;
        let parts = (0..batch)
            .step_by(IMAGES_AT_ONCE)
            .map(|first| {
                let images = IMAGES_AT_ONCE.min(batch - first);
                let x = x
                    .narrow(0, first, images)?
                    .reshape((images * tokens, dim))?;
                let attended = self.attention(&self.norm1.forward(&x)?, images)?;
                let x = (x + attended.broadcast_mul(&self.ls1)?)?;
                let hidden = self.fc1.forward(&self.norm2.forward(&x)?)?.gelu_erf()?;
                let refined = self.fc2.forward(&hidden)?.broadcast_mul(&self.ls2)?;
                Ok((x + refined)?.reshape((images, tokens, dim))?)
            })
            .collect::<Result<Vec<_>, ModelError>>()?;
        Ok(Tensor::cat(&parts, 0)?)
    }

    /// Softmax attention of `[images · tokens, dim]`, without masks or query and key norms.
    fn attention(&self, x: &Tensor, images: usize) -> Result<Tensor, ModelError> {
        let (rows, dim) = x.dims2()?;
        let (tokens, width) = (rows / images, dim / self.heads);
        // [image, token, (q, k, v), head, width] to [(q, k, v), image · head, token, width].
        let qkv = self
            .qkv
            .forward(x)?
            .reshape((images, tokens, 3, self.heads, width))?
            .permute((2, 0, 3, 1, 4))?
            .contiguous()?
            .reshape((3, images * self.heads, tokens, width))?;
        let q = (qkv.get(0)? * (1.0 / (width as f64).sqrt()))?;
        let weights = q.matmul(&qkv.get(1)?.transpose(D::Minus1, D::Minus2)?)?;
        let weights = candle_nn::ops::softmax_last_dim(&weights)?;
        let mixed = weights
            .matmul(&qkv.get(2)?)?
            .reshape((images, self.heads, tokens, width))?
            .transpose(1, 2)?
            .reshape((rows, dim))?;
        self.proj.forward(&mixed)
    }
}
