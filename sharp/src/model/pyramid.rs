//! The sliding-pyramid encoder: patches at three scales, merged into five feature maps.

use super::engine::Runtime;
use super::layers::{Conv, Deconv, Fused};
use super::map::Map;
use super::observer::{StageObserver, StageValue};
use super::params::Params;
use super::vit::Vit;
use super::{ModelConfig, ModelError};

/// Patches along a side of a pyramid level, and the tokens that neighbours share on each side.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Tiling {
    /// Side of the level's image, pixels.
    size: usize,
    /// Side of a patch, pixels.
    patch: usize,
    /// Patches along a side.
    steps: usize,
    /// Pixels from one patch to the next.
    stride: usize,
    /// Tokens cut from every side that has a neighbour.
    padding: usize,
}

impl Tiling {
    /// Patches that overlap by `numerator / 8` of their side.
    fn new(size: usize, patch: usize, tokens: usize, numerator: usize) -> Self {
        let stride = patch * (8 - numerator) / 8;
        Self {
            size,
            patch,
            steps: (size - patch).div_ceil(stride) + 1,
            stride,
            padding: tokens * numerator / 16,
        }
    }

    /// Appends the patches of `image` `[3, size, size]`, row by row, each `[3, patch, patch]`.
    fn split(&self, image: &[f32], patches: &mut Vec<f32>) {
        for (row, column) in (0..self.steps).flat_map(|r| (0..self.steps).map(move |c| (r, c))) {
            for plane in image.chunks_exact(self.size * self.size) {
                let rows = plane.chunks_exact(self.size).skip(row * self.stride);
                for line in rows.take(self.patch) {
                    patches.extend(&line[column * self.stride..][..self.patch]);
                }
            }
        }
    }

    /// Maps of all patches, `tokens` along a side, to one map.
    fn merge(&self, patches: &[Map], tokens: usize) -> Result<Map, ModelError> {
        Map::mosaic(patches, self.steps, |index| {
            let start = if index > 0 { self.padding } else { 0 };
            let end = if index + 1 < self.steps {
                tokens - self.padding
            } else {
                tokens
            };
            (start, end - start)
        })
    }
}

/// A projection to other channels and `n` doublings of the resolution.
struct Upsample {
    project: Conv,
    double: Vec<Deconv>,
}

impl Upsample {
    fn new(p: &Params<'_>, input: usize, output: usize, n: usize) -> Self {
        Self {
            project: Conv::point(&p.pp(0), input, output, false),
            double: (1..=n)
                .map(|k| Deconv::new(&p.pp(k), output, output, false))
                .collect(),
        }
    }

    /// `[input, s, s]` to `[output, 2ⁿ s, 2ⁿ s]`.
    fn forward(&self, rt: &Runtime, x: &Map) -> Result<Map, ModelError> {
        let mut x = self.project.forward(rt, x, Fused::default())?;
        for double in &self.double {
            x = double.forward(rt, &x)?;
        }
        Ok(x)
    }
}

/// Both transformers with merging and projections.
pub(super) struct Encoder {
    patch_encoder: Vit,
    image_encoder: Vit,
    upsample_latent0: Upsample,
    upsample_latent1: Upsample,
    upsample0: Upsample,
    upsample1: Upsample,
    upsample2: Upsample,
    upsample_lowres: Deconv,
    fuse_lowres: Conv,
    taps: [usize; 2],
    tilings: [Tiling; 2],
    tokens: usize,
}

impl Encoder {
    pub(super) fn new(p: &Params<'_>, config: &ModelConfig) -> Self {
        let (vit, dim) = (&config.vit, config.vit.embed_dim);
        let [d0, d1, d2, d3] = config.encoder_dims;
        let size = config.internal_resolution;
        let tokens = vit.tokens_per_side();
        // A quarter at full size and a half at half size.
        let overlaps = if config.use_patch_overlap {
            [2, 4]
        } else {
            [0, 0]
        };
        Self {
            patch_encoder: Vit::new(&p.pp("patch_encoder"), vit),
            image_encoder: Vit::new(&p.pp("image_encoder"), vit),
            upsample_latent0: Upsample::new(&p.pp("upsample_latent0"), dim, d0, 3),
            upsample_latent1: Upsample::new(&p.pp("upsample_latent1"), dim, d0, 2),
            upsample0: Upsample::new(&p.pp("upsample0"), dim, d1, 1),
            upsample1: Upsample::new(&p.pp("upsample1"), dim, d2, 1),
            upsample2: Upsample::new(&p.pp("upsample2"), dim, d3, 1),
            upsample_lowres: Deconv::new(&p.pp("upsample_lowres"), dim, d3, true),
            fuse_lowres: Conv::point(&p.pp("fuse_lowres"), 2 * d3, d3, true),
            taps: [config.hook_ids[0], config.hook_ids[1]],
            tilings: [
                Tiling::new(size, vit.img_size, tokens, overlaps[0]),
                Tiling::new(size / 2, vit.img_size, tokens, overlaps[1]),
            ],
            tokens,
        }
    }

    /// `image` is `[3, R, R]` in −1..1. Five maps, finest first; for the release
    /// 256×768², 256×384², 512×192², 1024×96², 1024×48².
    pub(super) fn forward(
        &self,
        rt: &Runtime,
        image: &[f32],
        observer: &mut dyn StageObserver,
    ) -> Result<[Map; 5], ModelError> {
        let [fine, coarse] = self.tilings;
        let quarter = quarter_size(image, fine.size);
        let mut patches = Vec::new();
        fine.split(image, &mut patches);
        coarse.split(&half_size(image, fine.size), &mut patches);
        patches.extend(&quarter);
        let (n0, n1) = (fine.steps.pow(2), coarse.steps.pow(2));
        let mut seen =
            self.patch_encoder
                .forward(rt, &patches, &self.taps, "patch_encoder", observer)?;
        drop(patches);
        // A tap that is named twice is one tap.
        let tap = |k: usize| &seen.taps[k.min(seen.taps.len() - 1)][..n0];
        let latent0 = fine.merge(tap(0), self.tokens)?;
        let latent1 = fine.merge(tap(1), self.tokens)?;
        let x0 = fine.merge(&seen.last[..n0], self.tokens)?;
        let x1 = coarse.merge(&seen.last[n0..n0 + n1], self.tokens)?;
        let x2 = seen.last.swap_remove(n0 + n1);
        drop(seen);
        let whole = self
            .image_encoder
            .forward(rt, &quarter, &[], "image_encoder", observer)?;
        let x2_up = self.upsample2.forward(rt, &x2)?;
        let lowres_up = self.upsample_lowres.forward(rt, &whole.last[0])?;
        let lowest = x2_up.cat(&lowres_up)?;
        for (stage, value) in [
            ("merged.latent0", &latent0),
            ("merged.latent1", &latent1),
            ("merged.x0", &x0),
            ("merged.x1", &x1),
            ("merged.x2", &x2),
            ("encoder.x2_up", &x2_up),
            ("encoder.lowres_up", &lowres_up),
        ] {
            observer.stage(stage, StageValue::map(value))?;
        }
        let features = [
            self.upsample_latent0.forward(rt, &latent0)?,
            self.upsample_latent1.forward(rt, &latent1)?,
            self.upsample0.forward(rt, &x0)?,
            self.upsample1.forward(rt, &x1)?,
            self.fuse_lowres.forward(rt, &lowest, Fused::default())?,
        ];
        for (k, feature) in features.iter().enumerate() {
            observer.stage(&format!("encoder.feature{k}"), StageValue::map(feature))?;
        }
        Ok(features)
    }
}

/// Means of 2×2 blocks of planes `[…, side, side]`.
fn half_size(planes: &[f32], side: usize) -> Vec<f32> {
    sample(planes, side, 2, 0)
}

/// Means of the central 2×2 pixels of 4×4 blocks: bilinear sampling without a filter.
fn quarter_size(planes: &[f32], side: usize) -> Vec<f32> {
    sample(planes, side, 4, 1)
}

/// Means of the 2×2 pixels from `offset` in every `step × step` block.
fn sample(planes: &[f32], side: usize, step: usize, offset: usize) -> Vec<f32> {
    let mut out = Vec::with_capacity(planes.len() / (step * step));
    for rows in planes.chunks_exact(step * side) {
        let top = &rows[offset * side..][..side];
        let bottom = &rows[(offset + 1) * side..][..side];
        let pairs = top.chunks_exact(step).zip(bottom.chunks_exact(step));
        out.extend(pairs.map(|(t, b)| {
            let (t, b) = (&t[offset..], &b[offset..]);
            0.25 * ((t[0] + t[1]) + (b[0] + b[1]))
        }));
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::{Algorithm, Engine};

    #[test]
    fn the_release_has_25_and_9_overlapping_patches() {
        let fine = Tiling::new(1536, 384, 24, 2);
        assert_eq!((fine.steps, fine.stride, fine.padding), (5, 288, 3));
        let coarse = Tiling::new(768, 384, 24, 4);
        assert_eq!((coarse.steps, coarse.stride, coarse.padding), (3, 192, 6));
        let apart = Tiling::new(192, 48, 3, 0);
        assert_eq!((apart.steps, apart.stride, apart.padding), (4, 48, 0));
    }

    #[test]
    fn merging_undoes_splitting() {
        // One token a pixel: what is split and merged is the image itself.
        let image: Vec<f32> = (0..3 * 48 * 48).map(|k| k as f32).collect();
        let engine = Engine::cpu(Algorithm::Direct);
        for overlap in [0, 4] {
            let tiling = Tiling::new(48, 24, 24, overlap);
            let mut patches = Vec::new();
            tiling.split(&image, &mut patches);
            let maps: Vec<Map> = patches
                .chunks(3 * 24 * 24)
                .map(|patch| Map::from_planes(&engine, patch, (3, 24, 24)).unwrap())
                .collect();
            assert_eq!(maps.len(), tiling.steps.pow(2));
            let merged = tiling.merge(&maps, 24).unwrap();
            assert_eq!(merged.to_planes().unwrap(), image);
        }
    }

    #[test]
    fn the_quarter_scale_sees_only_the_middle_of_a_block() {
        let mut block = vec![100.0_f32; 16];
        for (at, v) in [(5, 1.0), (6, 2.0), (9, 3.0), (10, 6.0)] {
            block[at] = v;
        }
        assert_eq!(quarter_size(&block, 4), [3.0]);
        assert_eq!(half_size(&[1.0, 2.0, 3.0, 6.0], 2), [3.0]);
    }
}
