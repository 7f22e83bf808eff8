//! The transformer by tensor operations.

use candle_core::{D, Device, Tensor};

use super::{Features, IMAGES_AT_ONCE, Shape, Vit, VitBlock, WeightBias};
use crate::model::ModelError;
use crate::model::engine::Runtime;
use crate::model::map::Map;
use crate::model::observer::{StageObserver, StageValue};

impl Vit {
    /// As [`Vit::forward`].
    pub(super) fn on_tensors(
        &self,
        rt: &Runtime,
        device: &Device,
        images: &[f32],
        taps: &[usize],
        name: &str,
        observer: &mut dyn StageObserver,
    ) -> Result<Features, ModelError> {
        let (tokens, dim, size) = (self.shape.tokens(), self.shape.dim, self.shape.image);
        let count = images.len() / (3 * size * size);
        let input = [count, 3, size, size];
        observer.stage(&format!("{name}.input"), StageValue::host(&input, images))?;
        let mut see = |stage: &str, value: &Tensor| {
            observer.stage(&format!("{name}.{stage}"), StageValue::tensor(value))
        };
        let square = self.shape.square();
        let rows = Tensor::from_vec(self.squares(images), ((), square), device)?;
        let weight = rt.tensor(&self.patch_embed.weight, device)?;
        let embedded = rows
            .matmul(&weight.reshape((dim, square))?.t()?)?
            .broadcast_add(&rt.tensor(&self.patch_embed.bias, device)?)?
            .reshape((count, tokens - 1, dim))?;
        see("patch_embed", &embedded)?;
        let class = rt.tensor(&self.cls_token, device)?;
        let class = class.broadcast_as((count, 1, dim))?;
        let positions = rt.tensor(&self.pos_embed, device)?;
        let mut x = Tensor::cat(&[&class, &embedded], 1)?.broadcast_add(&positions)?;
        see("tokens_in", &x)?;
        let mut tapped = Vec::with_capacity(taps.len());
        for (k, block) in self.blocks.iter().enumerate() {
            x = block.on_tensors(rt, &x, self.shape)?;
            see(&format!("block{k}"), &x)?;
            if taps.contains(&k) {
                tapped.push(self.tensor_maps(&x)?);
            }
        }
        let last = self.tensor_maps(&norm(rt, &self.norm, &x, self.shape.norm_eps)?)?;
        observer.stage(&format!("{name}.out"), StageValue::maps(&last))?;
        Ok(Features { taps: tapped, last })
    }

    /// Tokens `[images, 1 + side², dim]` as one map an image, the class token dropped.
    fn tensor_maps(&self, x: &Tensor) -> Result<Vec<Map>, ModelError> {
        let (count, tokens, dim) = x.dims3()?;
        let side = self.shape.side;
        let map = |image: usize| {
            let patches = x.narrow(0, image, 1)?.narrow(1, 1, tokens - 1)?;
            let planes = patches.transpose(1, 2)?.contiguous()?;
            Ok(Map::Tensor(planes.reshape((1, dim, side, side))?))
        };
        (0..count).map(map).collect()
    }
}

impl VitBlock {
    /// `[images, tokens, dim]` to the same shape, a few images at a time.
    fn on_tensors(&self, rt: &Runtime, x: &Tensor, shape: Shape) -> Result<Tensor, ModelError> {
        let (count, tokens, dim) = x.dims3()?;
        let (ls1, ls2) = (
            rt.tensor(&self.ls1, x.device())?,
            rt.tensor(&self.ls2, x.device())?,
        );
        let parts = (0..count)
            .step_by(IMAGES_AT_ONCE)
            .map(|first| {
                let images = IMAGES_AT_ONCE.min(count - first);
                let x = x.narrow(0, first, images)?;
                let x = x.reshape((images * tokens, dim))?;
                let attended = self.attention(
                    rt,
                    &norm(rt, &self.norm1, &x, shape.norm_eps)?,
                    images,
                    shape,
                )?;
                let x = (x + attended.broadcast_mul(&ls1)?)?;
                let hidden = linear(rt, &self.fc1, &norm(rt, &self.norm2, &x, shape.norm_eps)?)?
                    .gelu_erf()?;
                let refined = linear(rt, &self.fc2, &hidden)?.broadcast_mul(&ls2)?;
                Ok((x + refined)?.reshape((images, tokens, dim))?)
            })
            .collect::<Result<Vec<_>, ModelError>>()?;
        Ok(Tensor::cat(&parts, 0)?)
    }

    /// Softmax attention of `[images · tokens, dim]`, without masks or query and key norms.
    fn attention(
        &self,
        rt: &Runtime,
        x: &Tensor,
        images: usize,
        shape: Shape,
    ) -> Result<Tensor, ModelError> {
        let (rows, dim) = x.dims2()?;
        let (tokens, heads) = (rows / images, shape.heads);
        let width = dim / heads;
        // [image, token, (q, k, v), head, width] to [(q, k, v), image · head, token, width].
        let qkv = linear(rt, &self.qkv, x)?
            .reshape((images, tokens, 3, heads, width))?
            .permute((2, 0, 3, 1, 4))?
            .contiguous()?
            .reshape((3, images * heads, tokens, width))?;
        let q = (qkv.get(0)? * (1.0 / (width as f64).sqrt()))?;
        let weights = q.matmul(&qkv.get(1)?.transpose(D::Minus1, D::Minus2)?)?;
        let weights = candle_nn::ops::softmax_last_dim(&weights)?;
        let mixed = weights
            .matmul(&qkv.get(2)?)?
            .reshape((images, heads, tokens, width))?
            .transpose(1, 2)?
            .reshape((rows, dim))?;
        linear(rt, &self.proj, &mixed)
    }
}

fn linear(rt: &Runtime, affine: &WeightBias, x: &Tensor) -> Result<Tensor, ModelError> {
    let weight = rt.tensor(&affine.weight, x.device())?;
    let bias = rt.tensor(&affine.bias, x.device())?;
    Ok(x.matmul(&weight.t()?)?.broadcast_add(&bias)?)
}

/// Centred first, then squared: a difference of large sums would lose digits.
fn norm(rt: &Runtime, affine: &WeightBias, x: &Tensor, eps: f32) -> Result<Tensor, ModelError> {
    let centered = x.broadcast_sub(&x.mean_keepdim(D::Minus1)?)?;
    let variance = centered.sqr()?.mean_keepdim(D::Minus1)?;
    let deviation = (variance + f64::from(eps))?.sqrt()?;
    Ok(centered
        .broadcast_div(&deviation)?
        .broadcast_mul(&rt.tensor(&affine.weight, x.device())?)?
        .broadcast_add(&rt.tensor(&affine.bias, x.device())?)?)
}
