//! The transformer on our kernels: tokens in one buffer that blocks update in place.

use sharp_kernels::{AttentionShape, Epilogue, PackedMatrix, Simd, Workspace, attention};
use sharp_kernels::{layer_norm, matmul};

use super::{Features, IMAGES_AT_ONCE, Vit, VitBlock, WeightBias};
use crate::model::ModelError;
use crate::model::engine::Runtime;
use crate::model::map::{HostMap, Map};
use crate::model::observer::{StageObserver, StageValue};
use crate::model::params::Parameter;

impl Vit {
    /// As [`Vit::forward`].
    pub(super) fn on_host(
        &self,
        rt: &Runtime,
        simd: Simd,
        images: &[f32],
        taps: &[usize],
        name: &str,
        observer: &mut dyn StageObserver,
    ) -> Result<Features, ModelError> {
        let shape = self.shape;
        let (tokens, dim, size) = (shape.tokens(), shape.dim, shape.image);
        let count = images.len() / (3 * size * size);
        let mut see = |stage: &str, shape: &[usize], values: &[f32]| {
            observer.stage(&format!("{name}.{stage}"), StageValue::host(shape, values))
        };
        see("input", &[count, 3, size, size], images)?;
        let embedded = self.embed(rt, simd, images)?;
        see("patch_embed", &[count, tokens - 1, dim], &embedded)?;
        let mut x = self.with_positions(rt, &embedded)?;
        drop(embedded);
        let all = [count, tokens, dim];
        see("tokens_in", &all, &x)?;
        let mut tapped = Vec::with_capacity(taps.len());
        let mut buffers = Buffers::default();
        for (k, block) in self.blocks.iter().enumerate() {
            let packed = PackedBlock::new(rt, simd, block, shape.norm_eps)?;
            for part in x.chunks_mut(IMAGES_AT_ONCE * tokens * dim) {
                let images = part.len() / (tokens * dim);
                let attention = AttentionShape {
                    batch: images,
                    tokens,
                    heads: shape.heads,
                    head_dim: dim / shape.heads,
                };
                rt.with_workspace(|w| packed.run(simd, part, attention, &mut buffers, w));
            }
            see(&format!("block{k}"), &all, &x)?;
            if taps.contains(&k) {
                tapped.push(self.maps(&x));
            }
        }
        let norm = Norm::new(rt, &self.norm, shape.norm_eps)?;
        let mut normal = vec![0.0; x.len()];
        norm.run(simd, &x, &mut normal);
        let last = self.maps(&normal);
        observer.stage(&format!("{name}.out"), StageValue::maps(&last))?;
        Ok(Features { taps: tapped, last })
    }

    /// Embedded squares `[images · side², dim]`.
    fn embed(&self, rt: &Runtime, simd: Simd, images: &[f32]) -> Result<Vec<f32>, ModelError> {
        let (square, dim) = (self.shape.square(), self.shape.dim);
        let rows = self.squares(images);
        let weights = PackedMatrix::from_out_in(
            simd,
            &rt.values(&self.patch_embed.weight)?,
            Some(&rt.values(&self.patch_embed.bias)?),
            dim,
            square,
        );
        let m = rows.len() / square;
        let mut out = vec![0.0; m * dim];
        rt.with_workspace(|w| matmul(&rows, &weights, &mut out, m, Epilogue::None, w));
        Ok(out)
    }

    /// The class token before each image's tokens, positions added.
    pub(super) fn with_positions(
        &self,
        rt: &Runtime,
        embedded: &[f32],
    ) -> Result<Vec<f32>, ModelError> {
        let (tokens, dim) = (self.shape.tokens(), self.shape.dim);
        let class = rt.values(&self.cls_token)?;
        let positions = rt.values(&self.pos_embed)?;
        let mut x = Vec::with_capacity(embedded.len() / (tokens - 1) * tokens);
        for image in embedded.chunks_exact((tokens - 1) * dim) {
            let values = class.iter().chain(image);
            x.extend(values.zip(positions.iter()).map(|(v, p)| v + p));
        }
        Ok(x)
    }

    /// Tokens `[images, 1 + side², dim]` as one map an image, the class token dropped.
    fn maps(&self, x: &[f32]) -> Vec<Map> {
        let (tokens, dim, side) = (self.shape.tokens(), self.shape.dim, self.shape.side);
        let map = |image: &[f32]| Map::Host(HostMap::new((side, side, dim), image[dim..].to_vec()));
        x.chunks_exact(tokens * dim).map(map).collect()
    }
}

struct Norm {
    gamma: Vec<f32>,
    beta: Vec<f32>,
    eps: f32,
}

impl Norm {
    fn new(rt: &Runtime, affine: &WeightBias, eps: f32) -> Result<Self, ModelError> {
        Ok(Self {
            gamma: rt.values(&affine.weight)?,
            beta: rt.values(&affine.bias)?,
            eps,
        })
    }

    fn run(&self, simd: Simd, x: &[f32], out: &mut [f32]) {
        layer_norm(simd, x, &self.gamma, &self.beta, self.eps, out);
    }
}

/// Intermediate values, reused from block to block.
#[derive(Default)]
struct Buffers {
    normal: Vec<f32>,
    qkv: Vec<f32>,
    attended: Vec<f32>,
    hidden: Vec<f32>,
}

/// A block's weights, packed. LayerScale is multiplied into the layers before it.
struct PackedBlock {
    norm1: Norm,
    qkv: PackedMatrix,
    proj: PackedMatrix,
    norm2: Norm,
    fc1: PackedMatrix,
    fc2: PackedMatrix,
}

impl PackedBlock {
    fn new(rt: &Runtime, simd: Simd, block: &VitBlock, eps: f32) -> Result<Self, ModelError> {
        Ok(Self {
            norm1: Norm::new(rt, &block.norm1, eps)?,
            qkv: pack(rt, simd, &block.qkv, None)?,
            proj: pack(rt, simd, &block.proj, Some(&block.ls1))?,
            norm2: Norm::new(rt, &block.norm2, eps)?,
            fc1: pack(rt, simd, &block.fc1, None)?,
            fc2: pack(rt, simd, &block.fc2, Some(&block.ls2))?,
        })
    }

    /// Updates the tokens of some images, `[images · tokens, dim]`, in place.
    fn run(
        &self,
        simd: Simd,
        x: &mut [f32],
        shape: AttentionShape,
        buffers: &mut Buffers,
        workspace: &mut Workspace,
    ) {
        let (rows, dim) = (shape.batch * shape.tokens, shape.dim());
        let Buffers {
            normal,
            qkv,
            attended,
            hidden,
        } = buffers;
        normal.resize(rows * dim, 0.0);
        qkv.resize(rows * 3 * dim, 0.0);
        attended.resize(rows * dim, 0.0);
        hidden.resize(rows * 4 * dim, 0.0);
        self.norm1.run(simd, x, normal);
        matmul(normal, &self.qkv, qkv, rows, Epilogue::None, workspace);
        let scale = 1.0 / (shape.head_dim as f32).sqrt();
        attention(simd, qkv, attended, shape, scale, workspace);
        matmul(attended, &self.proj, x, rows, Epilogue::Add, workspace);
        self.norm2.run(simd, x, normal);
        matmul(normal, &self.fc1, hidden, rows, Epilogue::Gelu, workspace);
        matmul(hidden, &self.fc2, x, rows, Epilogue::Add, workspace);
    }
}

/// Packs a linear layer, its outputs multiplied by `scale`.
fn pack(
    rt: &Runtime,
    simd: Simd,
    affine: &WeightBias,
    scale: Option<&Parameter>,
) -> Result<PackedMatrix, ModelError> {
    let [n, k] = [affine.weight.shape[0], affine.weight.shape[1]];
    let (mut weight, mut bias) = (rt.values(&affine.weight)?, rt.values(&affine.bias)?);
    if let Some(scale) = scale {
        let scale = rt.values(scale)?;
        let rows = weight.chunks_exact_mut(k);
        for (row, scale) in rows.zip(scale.iter()) {
            row.iter_mut().for_each(|w| *w *= scale);
        }
        for (bias, scale) in bias.iter_mut().zip(scale.iter()) {
            *bias *= scale;
        }
    }
    Ok(PackedMatrix::from_out_in(simd, &weight, Some(&bias), n, k))
}
