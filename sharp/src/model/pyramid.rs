//! The sliding-pyramid encoder: patches at three scales, merged into five feature maps.

use candle_core::Tensor;

use super::observer::{Observer, StageValue};
use super::ops::{Conv1x1, Deconv2x2};
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

    /// `[1, 3, size, size]` to its patches, row by row.
    fn split(&self, image: &Tensor) -> Result<Vec<Tensor>, ModelError> {
        debug_assert_eq!((self.steps - 1) * self.stride + self.patch, self.size);
        let mut patches = Vec::with_capacity(self.steps * self.steps);
        for row in 0..self.steps {
            let rows = image.narrow(2, row * self.stride, self.patch)?;
            for column in 0..self.steps {
                patches.push(rows.narrow(3, column * self.stride, self.patch)?);
            }
        }
        Ok(patches)
    }

    /// Maps of all patches `[steps², dim, tokens, tokens]` to one map `[1, dim, side, side]`.
    fn merge(&self, patches: &Tensor) -> Result<Tensor, ModelError> {
        let tokens = patches.dim(2)?;
        let span = |index: usize| {
            let start = if index > 0 { self.padding } else { 0 };
            let end = if index + 1 < self.steps {
                tokens - self.padding
            } else {
                tokens
            };
            (start, end - start)
        };
        let rows = (0..self.steps)
            .map(|row| {
                let (top, height) = span(row);
                let cells = (0..self.steps)
                    .map(|column| {
                        let (left, width) = span(column);
                        let patch = patches.narrow(0, row * self.steps + column, 1)?;
                        patch.narrow(2, top, height)?.narrow(3, left, width)
                    })
                    .collect::<Result<Vec<_>, _>>()?;
                Tensor::cat(&cells, 3)
            })
            .collect::<Result<Vec<_>, _>>()?;
        Ok(Tensor::cat(&rows, 2)?)
    }
}

/// A projection to other channels and `n` doublings of the resolution.
struct Upsample {
    project: Conv1x1,
    double: Vec<Deconv2x2>,
}

impl Upsample {
    fn new(p: &Params<'_>, input: usize, output: usize, n: usize) -> Result<Self, ModelError> {
        Ok(Self {
            project: Conv1x1::new(&p.pp(0), input, output, false)?,
            double: (1..=n)
                .map(|k| Deconv2x2::new(&p.pp(k), output, output, false))
                .collect::<Result<_, _>>()?,
        })
    }

    /// `[1, input, s, s]` to `[1, output, 2ⁿ s, 2ⁿ s]`.
    fn forward(&self, x: &Tensor) -> Result<Tensor, ModelError> {
        let mut x = self.project.forward(x)?;
        for double in &self.double {
            x = double.forward(&x)?;
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
    upsample_lowres: Deconv2x2,
    fuse_lowres: Conv1x1,
    taps: [usize; 2],
    tilings: [Tiling; 2],
}

impl Encoder {
    pub(super) fn new(p: &Params<'_>, config: &ModelConfig) -> Result<Self, ModelError> {
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
        Ok(Self {
            patch_encoder: Vit::new(&p.pp("patch_encoder"), vit)?,
            image_encoder: Vit::new(&p.pp("image_encoder"), vit)?,
            upsample_latent0: Upsample::new(&p.pp("upsample_latent0"), dim, d0, 3)?,
            upsample_latent1: Upsample::new(&p.pp("upsample_latent1"), dim, d0, 2)?,
            upsample0: Upsample::new(&p.pp("upsample0"), dim, d1, 1)?,
            upsample1: Upsample::new(&p.pp("upsample1"), dim, d2, 1)?,
            upsample2: Upsample::new(&p.pp("upsample2"), dim, d3, 1)?,
            upsample_lowres: Deconv2x2::new(&p.pp("upsample_lowres"), dim, d3, true)?,
            fuse_lowres: Conv1x1::new(&p.pp("fuse_lowres"), 2 * d3, d3, true)?,
            taps: [config.hook_ids[0], config.hook_ids[1]],
            tilings: [
                Tiling::new(size, vit.img_size, tokens, overlaps[0]),
                Tiling::new(size / 2, vit.img_size, tokens, overlaps[1]),
            ],
        })
    }

    /// `image` is `[1, 3, R, R]` in −1..1. Five maps, finest first; for the release
    /// 256×768², 256×384², 512×192², 1024×96², 1024×48².
    pub(super) fn forward(
        &self,
        image: &Tensor,
        observer: &mut dyn Observer,
    ) -> Result<[Tensor; 5], ModelError> {
        let [fine, coarse] = self.tilings;
        let (half, quarter) = (half_size(image)?, quarter_size(image)?);
        let mut patches = fine.split(image)?;
        patches.extend(coarse.split(&half)?);
        patches.push(quarter.clone());
        let patches = Tensor::cat(&patches, 0)?;
        let seen = self
            .patch_encoder
            .forward(&patches, &self.taps, "patch_encoder", observer)?;
        let (n0, n1) = (fine.steps.pow(2), coarse.steps.pow(2));
        let tap = |k: usize| {
            // A tap that is named twice is one tap.
            let map = seen.taps.get(k).or(seen.taps.last()).unwrap_or(&seen.last);
            fine.merge(&map.narrow(0, 0, n0)?)
        };
        let (latent0, latent1) = (tap(0)?, tap(1)?);
        let x0 = fine.merge(&seen.last.narrow(0, 0, n0)?)?;
        let x1 = coarse.merge(&seen.last.narrow(0, n0, n1)?)?;
        let x2 = seen.last.narrow(0, n0 + n1, 1)?.contiguous()?;
        let whole = self
            .image_encoder
            .forward(&quarter, &[], "image_encoder", observer)?;
        let x2_up = self.upsample2.forward(&x2)?;
        let lowres_up = self.upsample_lowres.forward(&whole.last)?;
        let features = [
            self.upsample_latent0.forward(&latent0)?,
            self.upsample_latent1.forward(&latent1)?,
            self.upsample0.forward(&x0)?,
            self.upsample1.forward(&x1)?,
            self.fuse_lowres
                .forward(&Tensor::cat(&[&x2_up, &lowres_up], 1)?)?,
        ];
        for (stage, value) in [
            ("merged.latent0", &latent0),
            ("merged.latent1", &latent1),
            ("merged.x0", &x0),
            ("merged.x1", &x1),
            ("merged.x2", &x2),
            ("encoder.x2_up", &x2_up),
            ("encoder.lowres_up", &lowres_up),
        ] {
            observer.stage(stage, StageValue::Tensor(value))?;
        }
        for (k, feature) in features.iter().enumerate() {
            observer.stage(&format!("encoder.feature{k}"), StageValue::Tensor(feature))?;
        }
        Ok(features)
    }
}

/// Means of 2×2 blocks.
fn half_size(image: &Tensor) -> Result<Tensor, ModelError> {
    Ok(image.avg_pool2d(2)?)
}

/// Means of the central 2×2 pixels of 4×4 blocks: bilinear sampling without a filter.
fn quarter_size(image: &Tensor) -> Result<Tensor, ModelError> {
    let (batch, c, h, w) = image.dims4()?;
    let centers = image
        .reshape(&[batch, c, h / 4, 4, w / 4, 4][..])?
        .narrow(3, 1, 2)?
        .narrow(5, 1, 2)?
        .contiguous()?
        .reshape((batch, c, h / 2, w / 2))?;
    half_size(&centers)
}

#[cfg(test)]
mod tests {
    use super::*;
    use candle_core::Device;

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
        let values: Vec<f32> = (0..3 * 48 * 48).map(|k| k as f32).collect();
        let image = Tensor::from_vec(values, (1, 3, 48, 48), &Device::Cpu).unwrap();
        for overlap in [0, 4] {
            let tiling = Tiling::new(48, 24, 24, overlap);
            let patches = Tensor::cat(&tiling.split(&image).unwrap(), 0).unwrap();
            let merged = tiling.merge(&patches).unwrap();
            let off = (merged - &image).unwrap().abs().unwrap().sum_all().unwrap();
            assert_eq!(off.to_scalar::<f32>().unwrap(), 0.0);
        }
    }

    #[test]
    fn the_quarter_scale_sees_only_the_middle_of_a_block() {
        let mut values = vec![100.0_f32; 16];
        for (at, v) in [(5, 1.0), (6, 2.0), (9, 3.0), (10, 6.0)] {
            values[at] = v;
        }
        let image = Tensor::from_vec(values, (1, 1, 4, 4), &Device::Cpu).unwrap();
        let quarter = quarter_size(&image).unwrap().flatten_all().unwrap();
        assert_eq!(quarter.to_vec1::<f32>().unwrap(), [3.0]);
    }
}
