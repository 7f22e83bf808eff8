//! The sliding-pyramid encoder: patches at three scales, merged into five feature maps.

use candle_core::{Device, Tensor};
use candle_nn::Module;

use super::layers::{Conv, Deconv};
use super::observer::{StageObserver, StageValue};
use super::ops::gather;
use super::params::Params;
use super::vit::Vit;
use super::{ModelConfig, ModelError};

/// Tiling of a pyramid level into patches, and the number of tokens cut at borders between neighbours.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
struct Tiling {
    /// Side of the level's image in pixels.
    size: usize,
    /// Side of a patch in pixels.
    patch: usize,
    /// Number of patches along a side.
    steps: usize,
    /// Distance between neighbouring patches in pixels.
    stride: usize,
    /// Tokens cut from every side that has a neighbour.
    padding: usize,
}

impl Tiling {
    /// Tiling with patches that overlap by `numerator / 8` of their side.
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

    /// Appends the patches of `image` (`[3, size, size]`) row by row, each `[3, patch, patch]`.
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

    /// For each pixel of the merged map, the index of its token, counted over the tokens of all images. The level's
    /// patches start at image `first`; each has `tokens` tokens along a side, preceded by a class token.
    fn places(&self, first: usize, tokens: usize) -> Vec<u32> {
        // Patch and token index of each row or column.
        let at = |patch: usize| {
            let start = if patch > 0 { self.padding } else { 0 };
            let is_last = patch + 1 == self.steps;
            let end = tokens - if is_last { 0 } else { self.padding };
            (start..end).map(move |token| (patch, token))
        };
        let axis: Vec<(usize, usize)> = (0..self.steps).flat_map(at).collect();
        let place = |(row, y): (usize, usize), (column, x): (usize, usize)| {
            let image = first + row * self.steps + column;
            image * (tokens * tokens + 1) + 1 + y * tokens + x
        };
        let rows = axis.iter();
        let all = rows.flat_map(|y| axis.iter().map(|x| place(*y, *x) as u32));
        all.collect()
    }
}

/// A projection to another number of channels, followed by `n` doublings of the resolution.
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
}

impl Module for Upsample {
    fn forward(&self, x: &Tensor) -> candle_core::Result<Tensor> {
        let mut x = self.project.forward(x)?;
        for double in &self.double {
            x = double.forward(&x)?;
        }
        Ok(x)
    }
}

/// Both transformers, with merging and projections.
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
    device: Device,
}

impl Encoder {
    pub(super) fn new(p: &Params<'_>, config: &ModelConfig) -> Self {
        let (vit, dim) = (&config.vit, config.vit.embed_dim);
        let [d0, d1, d2, d3] = config.encoder_dims;
        let size = config.internal_resolution;
        let tokens = vit.tokens_per_side();
        // Patches overlap by a quarter of their side at full size, and by half of it at half size.
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
            device: p.device().clone(),
        }
    }

    /// Encodes `image`, `[3, R, R]` in −1..1, into five maps, finest first. In the SHARP release's network these are
    /// 256×768², 256×384², 512×192², 1024×96² and 1024×48².
    pub(super) fn forward(
        &self,
        image: &[f32],
        observer: &mut dyn StageObserver,
    ) -> Result<[Tensor; 5], ModelError> {
        let [fine, coarse] = self.tilings;
        let quarter = quarter_size(image, fine.size);
        let mut patches = Vec::new();
        fine.split(image, &mut patches);
        coarse.split(&half_size(image, fine.size), &mut patches);
        patches.extend(&quarter);
        let (n0, n1) = (fine.steps.pow(2), coarse.steps.pow(2));
        let places = |tiling: Tiling, first: usize| {
            Tensor::new(tiling.places(first, self.tokens), &self.device)
        };
        let alone = Tiling { steps: 1, ..coarse };
        let in_fine = places(fine, 0)?;
        let taps = self.taps.map(|tap| (tap, &in_fine));
        let mut seen = self
            .patch_encoder
            .forward(&patches, &taps, "patch_encoder", observer)?;
        drop(patches);
        let x0 = gather(&seen.last, &in_fine)?;
        let x1 = gather(&seen.last, &places(coarse, n0)?)?;
        let x2 = gather(&seen.last, &places(alone, n0 + n1)?)?;
        let (Some(latent1), Some(latent0)) = (seen.taps.pop(), seen.taps.pop()) else {
            return Err(ModelError::Config(
                "the configuration taps a block that the network does not have".into(),
            ));
        };
        drop(seen);
        let whole = self
            .image_encoder
            .forward(&quarter, &[], "image_encoder", observer)?;
        let whole = gather(&whole.last, &places(alone, 0)?)?;
        let x2_up = self.upsample2.forward(&x2)?;
        let lowres_up = self.upsample_lowres.forward(&whole)?;
        for (stage, value) in [
            ("merged.latent0", &latent0),
            ("merged.latent1", &latent1),
            ("merged.x0", &x0),
            ("merged.x1", &x1),
            ("merged.x2", &x2),
            ("encoder.x2_up", &x2_up),
            ("encoder.lowres_up", &lowres_up),
        ] {
            observer.stage(stage, StageValue::image(value))?;
        }
        let features = [
            self.upsample_latent0.forward(&latent0)?,
            self.upsample_latent1.forward(&latent1)?,
            self.upsample0.forward(&x0)?,
            self.upsample1.forward(&x1)?,
            self.fuse_lowres
                .forward(&Tensor::cat(&[&x2_up, &lowres_up], 3)?)?,
        ];
        for (k, feature) in features.iter().enumerate() {
            observer.stage(&format!("encoder.feature{k}"), StageValue::image(feature))?;
        }
        Ok(features)
    }
}

/// Downsamples planes `[…, side, side]` by averaging 2×2 blocks.
fn half_size(planes: &[f32], side: usize) -> Vec<f32> {
    sample(planes, side, 2, 0)
}

/// Downsamples by averaging the central 2×2 pixels of 4×4 blocks, i.e. bilinear sampling without antialiasing.
pub(super) fn quarter_size(planes: &[f32], side: usize) -> Vec<f32> {
    sample(planes, side, 4, 1)
}

/// Averages the 2×2 pixels at `offset` in every `step × step` block.
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
    use crate::model::ops::to_planes;

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
        // One token per pixel, so that the image itself is split and merged.
        let image: Vec<f32> = (0..3 * 48 * 48).map(|k| k as f32).collect();
        for overlap in [0, 4] {
            let tiling = Tiling::new(48, 24, 24, overlap);
            let mut patches = Vec::new();
            tiling.split(&image, &mut patches);
            let count = patches.len() / (3 * 24 * 24);
            assert_eq!(count, tiling.steps.pow(2));
            let pixels = Tensor::from_vec(patches, (count, 3, 24 * 24), &Device::Cpu).unwrap();
            let class = Tensor::zeros((count, 1, 3), pixels.dtype(), &Device::Cpu).unwrap();
            let tokens = Tensor::cat(&[&class, &pixels.transpose(1, 2).unwrap()], 1).unwrap();
            let places = Tensor::new(tiling.places(0, 24), &Device::Cpu).unwrap();
            let merged = gather(&tokens, &places).unwrap();
            assert_eq!(to_planes(&merged).unwrap(), image);
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
