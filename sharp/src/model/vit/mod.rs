//! The vision transformer that sees patches and the whole image.

mod host;
mod taped;
mod tensors;

use super::ModelError;
use super::config::VitConfig;
use super::engine::{Engine, Runtime};
use super::map::Map;
use super::observer::StageObserver;
use super::params::{Parameter, Params};

/// Images whose intermediate values are in memory at a time: some 100 MB for the release.
const IMAGES_AT_ONCE: usize = 5;

/// Weight and bias of a linear layer or a normalisation.
struct WeightBias {
    weight: Parameter,
    bias: Parameter,
}

impl WeightBias {
    fn linear(p: &Params<'_>, input: usize, output: usize) -> Self {
        Self {
            weight: p.get("weight", &[output, input]),
            bias: p.get("bias", &[output]),
        }
    }

    fn norm(p: &Params<'_>, width: usize) -> Self {
        Self {
            weight: p.get("weight", &[width]),
            bias: p.get("bias", &[width]),
        }
    }
}

/// Pre-norm blocks over a class token and one token a patch.
pub(super) struct Vit {
    patch_embed: WeightBias,
    cls_token: Parameter,
    pos_embed: Parameter,
    blocks: Vec<VitBlock>,
    norm: WeightBias,
    shape: Shape,
}

/// `x += ls1 · attention(norm1(x))`, then `x += ls2 · mlp(norm2(x))`.
struct VitBlock {
    norm1: WeightBias,
    qkv: WeightBias,
    proj: WeightBias,
    ls1: Parameter,
    norm2: WeightBias,
    fc1: WeightBias,
    fc2: WeightBias,
    ls2: Parameter,
}

/// Sizes, and the one constant of the arithmetic.
#[derive(Debug, Clone, Copy)]
struct Shape {
    /// Side of an image, pixels.
    image: usize,
    /// Side of a token's square, pixels.
    patch: usize,
    /// Tokens along a side.
    side: usize,
    dim: usize,
    heads: usize,
    /// Added to the variance by normalisations.
    norm_eps: f32,
}

impl Shape {
    /// Tokens of an image, with the class token.
    fn tokens(&self) -> usize {
        self.side * self.side + 1
    }

    /// Values of a token's square of pixels.
    fn square(&self) -> usize {
        3 * self.patch * self.patch
    }
}

/// Outputs of a transformer, one map `[dim, side, side]` an image.
pub(super) struct Features {
    /// Outputs of the tapped blocks, not normalised.
    pub(super) taps: Vec<Vec<Map>>,
    pub(super) last: Vec<Map>,
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
            patch_embed: WeightBias {
                weight: embed.get("weight", &[dim, 3, patch, patch]),
                bias: embed.get("bias", &[dim]),
            },
            cls_token: p.get("cls_token", &[1, 1, dim]),
            pos_embed: p.get("pos_embed", &[1, side * side + 1, dim]),
            blocks: (0..config.depth)
                .map(|k| VitBlock::new(&blocks.pp(k), dim))
                .collect(),
            norm: WeightBias::norm(&p.pp("norm"), dim),
            shape: Shape {
                image: config.img_size,
                patch,
                side,
                dim,
                heads: config.num_heads,
                norm_eps: config.norm_eps,
            },
        }
    }

    /// `images` is `[images, 3, size, size]` in −1..1; stages are called `name.…`.
    pub(super) fn forward(
        &self,
        rt: &Runtime,
        images: &[f32],
        taps: &[usize],
        name: &str,
        observer: &mut dyn StageObserver,
    ) -> Result<Features, ModelError> {
        match (&rt.engine, &rt.tape) {
            (Engine::Kernels(kernels), Some(tape)) => {
                self.on_tape(rt, tape, kernels.simd, images, taps)
            }
            (Engine::Kernels(kernels), None) => {
                self.on_host(rt, kernels.simd, images, taps, name, observer)
            }
            (Engine::Tensors(device), _) => {
                self.on_tensors(rt, device, images, taps, name, observer)
            }
        }
    }

    /// Squares of pixels as rows `[images · side², 3 · patch²]`, in the order of the embedding's
    /// weights.
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
            norm1: WeightBias::norm(&p.pp("norm1"), dim),
            qkv: WeightBias::linear(&attention.pp("qkv"), dim, 3 * dim),
            proj: WeightBias::linear(&attention.pp("proj"), dim, dim),
            ls1: p.pp("ls1").get("gamma", &[dim]),
            norm2: WeightBias::norm(&p.pp("norm2"), dim),
            fc1: WeightBias::linear(&mlp.pp("fc1"), dim, 4 * dim),
            fc2: WeightBias::linear(&mlp.pp("fc2"), 4 * dim, dim),
            ls2: p.pp("ls2").get("gamma", &[dim]),
        }
    }
}
