//! Layers that the network is made of.
//!
//! Convolutions whose kernel equals their stride, or is 1, are matrix products. Normalisations
//! sum in f64 on the CPU: over the millions of values of a group, f32 sums would be off by 1e-5.

use candle_core::{CpuStorage, Device, Storage, Tensor};
use rayon::prelude::*;

use super::ModelError;
use super::params::Params;

/// `y = x Wᵀ + b` over the last axis.
pub(super) struct Linear {
    weight: Tensor,
    bias: Tensor,
}

impl Linear {
    pub(super) fn new(p: &Params<'_>, input: usize, output: usize) -> Result<Self, ModelError> {
        Ok(Self {
            weight: p.get("weight", &[output, input])?,
            bias: p.get("bias", &[output])?,
        })
    }

    /// `[rows, input]` to `[rows, output]`.
    pub(super) fn forward(&self, x: &Tensor) -> Result<Tensor, ModelError> {
        Ok(x.matmul(&self.weight.t()?)?.broadcast_add(&self.bias)?)
    }
}

/// A 3×3 convolution, stride 1, one pixel of zero padding.
pub(super) struct Conv3x3 {
    weight: Tensor,
    bias: Option<Tensor>,
}

impl Conv3x3 {
    pub(super) fn new(
        p: &Params<'_>,
        input: usize,
        output: usize,
        bias: bool,
    ) -> Result<Self, ModelError> {
        Ok(Self {
            weight: p.get("weight", &[output, input, 3, 3])?,
            bias: optional_bias(p, output, bias)?,
        })
    }

    /// `[1, input, h, w]` to `[1, output, h, w]`.
    pub(super) fn forward(&self, x: &Tensor) -> Result<Tensor, ModelError> {
        add_bias(x.conv2d(&self.weight, 1, 1, 1, 1)?, self.bias.as_ref())
    }
}

/// A 1×1 convolution.
pub(super) struct Conv1x1 {
    weight: Tensor,
    bias: Option<Tensor>,
}

impl Conv1x1 {
    pub(super) fn new(
        p: &Params<'_>,
        input: usize,
        output: usize,
        bias: bool,
    ) -> Result<Self, ModelError> {
        Ok(Self {
            weight: p
                .get("weight", &[output, input, 1, 1])?
                .reshape((output, input))?,
            bias: optional_bias(p, output, bias)?,
        })
    }

    /// `[1, input, h, w]` to `[1, output, h, w]`.
    pub(super) fn forward(&self, x: &Tensor) -> Result<Tensor, ModelError> {
        let (_, c, h, w) = x.dims4()?;
        let y = self.weight.matmul(&x.reshape((c, h * w))?)?;
        add_bias(y.reshape((1, (), h, w))?, self.bias.as_ref())
    }
}

/// A transposed 2×2 convolution with stride 2: every pixel becomes a block of four.
pub(super) struct Deconv2x2 {
    /// `[4 · output, input]`, the four pixels of an output channel together.
    weight: Tensor,
    bias: Option<Tensor>,
}

impl Deconv2x2 {
    pub(super) fn new(
        p: &Params<'_>,
        input: usize,
        output: usize,
        bias: bool,
    ) -> Result<Self, ModelError> {
        let weight = p.get("weight", &[input, output, 2, 2])?;
        Ok(Self {
            weight: weight.reshape((input, 4 * output))?.t()?,
            bias: optional_bias(p, output, bias)?,
        })
    }

    /// `[1, input, h, w]` to `[1, output, 2h, 2w]`.
    pub(super) fn forward(&self, x: &Tensor) -> Result<Tensor, ModelError> {
        let (_, c, h, w) = x.dims4()?;
        let y = self.weight.matmul(&x.reshape((c, h * w))?)?;
        // [output, dy, dx, y, x] to [output, y, dy, x, dx].
        let y = y.reshape(((), 2, 2, h, w))?.permute((0, 3, 1, 4, 2))?;
        add_bias(y.reshape((1, (), 2 * h, 2 * w))?, self.bias.as_ref())
    }
}

/// A convolution of `patch × patch` blocks that do not overlap.
pub(super) struct PatchConv {
    /// `[output, input · patch²]`.
    weight: Tensor,
    bias: Tensor,
    patch: usize,
}

impl PatchConv {
    pub(super) fn new(
        p: &Params<'_>,
        input: usize,
        output: usize,
        patch: usize,
    ) -> Result<Self, ModelError> {
        Ok(Self {
            weight: p
                .get("weight", &[output, input, patch, patch])?
                .reshape((output, input * patch * patch))?,
            bias: p.get("bias", &[output])?,
            patch,
        })
    }

    /// `[batch, input, h, w]` to one row of `output` values a block, `[batch · blocks, output]`,
    /// blocks row by row.
    pub(super) fn rows(&self, x: &Tensor) -> Result<Tensor, ModelError> {
        let (batch, c, h, w) = x.dims4()?;
        let (rows, columns, patch) = (h / self.patch, w / self.patch, self.patch);
        let blocks = x
            .reshape(&[batch, c, rows, patch, columns, patch][..])?
            .permute(vec![0, 2, 4, 1, 3, 5])?
            .reshape((batch * rows * columns, c * patch * patch))?;
        Ok(blocks
            .matmul(&self.weight.t()?)?
            .broadcast_add(&self.bias)?)
    }

    /// `[1, input, h, w]` to `[1, output, h / patch, w / patch]`.
    pub(super) fn image(&self, x: &Tensor) -> Result<Tensor, ModelError> {
        let (_, _, h, w) = x.dims4()?;
        let rows = self.rows(x)?.t()?.contiguous()?;
        Ok(rows.reshape((1, (), h / self.patch, w / self.patch))?)
    }
}

fn optional_bias(p: &Params<'_>, output: usize, bias: bool) -> Result<Option<Tensor>, ModelError> {
    bias.then(|| p.get("bias", &[output])).transpose()
}

fn add_bias(y: Tensor, bias: Option<&Tensor>) -> Result<Tensor, ModelError> {
    Ok(match bias {
        Some(bias) => y.broadcast_add(&bias.reshape((1, (), 1, 1))?)?,
        None => y,
    })
}

/// Normalisation of the last axis, then a learned scale and shift.
pub(super) struct LayerNorm {
    weight: Tensor,
    bias: Tensor,
}

impl LayerNorm {
    /// Not the 1e-5 of most transformers.
    const EPS: f64 = 1e-6;

    pub(super) fn new(p: &Params<'_>, width: usize) -> Result<Self, ModelError> {
        Ok(Self {
            weight: p.get("weight", &[width])?,
            bias: p.get("bias", &[width])?,
        })
    }

    /// `[…, width]` to the same shape.
    pub(super) fn forward(&self, x: &Tensor) -> Result<Tensor, ModelError> {
        if !matches!(x.device(), Device::Cpu) {
            let eps = Self::EPS as f32;
            return Ok(candle_nn::ops::layer_norm(
                &x.contiguous()?,
                &self.weight,
                &self.bias,
                eps,
            )?);
        }
        let (weight, bias) = (self.weight.to_vec1::<f32>()?, self.bias.to_vec1::<f32>()?);
        let width = weight.len();
        on_cpu(x, |data| {
            let mut out = vec![0.0; data.len()];
            out.par_chunks_mut(width)
                .zip(data.par_chunks(width))
                .for_each(|(out, row)| {
                    let (mean, inverse_std) = moments(row, Self::EPS);
                    for k in 0..width {
                        let normal = ((f64::from(row[k]) - mean) * inverse_std) as f32;
                        out[k] = normal * weight[k] + bias[k];
                    }
                });
            out
        })
    }
}

/// Mean and 1/√(population variance + eps) of a row.
fn moments(row: &[f32], eps: f64) -> (f64, f64) {
    let n = row.len() as f64;
    let mean = row.iter().map(|&v| f64::from(v)).sum::<f64>() / n;
    let square = |v: &f32| (f64::from(*v) - mean).powi(2);
    let variance = row.iter().map(square).sum::<f64>() / n;
    (mean, 1.0 / (variance + eps).sqrt())
}

/// Normalisation over groups of channels and all pixels, then a learned scale and shift.
pub(super) struct GroupNorm {
    weight: Tensor,
    bias: Tensor,
    groups: usize,
}

impl GroupNorm {
    const EPS: f64 = 1e-5;

    pub(super) fn new(p: &Params<'_>, width: usize, groups: usize) -> Result<Self, ModelError> {
        Ok(Self {
            weight: p.get("weight", &[width])?,
            bias: p.get("bias", &[width])?,
            groups,
        })
    }

    /// `[1, width, h, w]` to the same shape.
    pub(super) fn forward(&self, x: &Tensor) -> Result<Tensor, ModelError> {
        let (_, c, h, w) = x.dims4()?;
        if !matches!(x.device(), Device::Cpu) {
            return self.composed(x, (c, h, w));
        }
        let (weight, bias) = (self.weight.to_vec1::<f32>()?, self.bias.to_vec1::<f32>()?);
        let (plane, per_group) = (h * w, c / self.groups);
        on_cpu(x, |data| {
            let moments: Vec<(f64, f64)> = data
                .chunks(plane * per_group)
                .map(|group| chunked_moments(group, Self::EPS))
                .collect();
            let mut out = vec![0.0; data.len()];
            out.par_chunks_mut(plane)
                .zip(data.par_chunks(plane))
                .enumerate()
                .for_each(|(channel, (out, plane))| {
                    let (mean, inverse_std) = moments[channel / per_group];
                    let scale = inverse_std * f64::from(weight[channel]);
                    let shift = f64::from(bias[channel]) - mean * scale;
                    for (out, v) in out.iter_mut().zip(plane) {
                        *out = (f64::from(*v) * scale + shift) as f32;
                    }
                });
            out
        })
    }

    /// By tensor operations: means of rows first, then their mean, so that f32 sums stay short.
    fn composed(&self, x: &Tensor, (c, h, w): (usize, usize, usize)) -> Result<Tensor, ModelError> {
        let grouped = x.reshape((self.groups, c / self.groups * h, w))?;
        let mean = |t: &Tensor| t.mean_keepdim(2)?.mean_keepdim(1);
        let centered = grouped.broadcast_sub(&mean(&grouped)?)?;
        let variance = mean(&centered.sqr()?)?;
        let normal = centered.broadcast_div(&(variance + Self::EPS)?.sqrt()?)?;
        let per_channel = |t: &Tensor| t.reshape((1, c, 1, 1));
        Ok(normal
            .reshape((1, c, h, w))?
            .broadcast_mul(&per_channel(&self.weight)?)?
            .broadcast_add(&per_channel(&self.bias)?)?)
    }
}

/// As [`moments`], of a long row: chunks of fixed length in parallel, their sums in order, so that
/// the result does not depend on the number of threads.
fn chunked_moments(row: &[f32], eps: f64) -> (f64, f64) {
    const CHUNK: usize = 1 << 14;
    let sum = |term: &(dyn Fn(f64) -> f64 + Sync)| -> f64 {
        let partial: Vec<f64> = row
            .par_chunks(CHUNK)
            .map(|chunk| chunk.iter().map(|&v| term(f64::from(v))).sum())
            .collect();
        partial.iter().sum()
    };
    let n = row.len() as f64;
    let mean = sum(&|v| v) / n;
    let variance = sum(&|v| (v - mean).powi(2)) / n;
    (mean, 1.0 / (variance + eps).sqrt())
}

/// Applies `f` to the values of a CPU tensor; the result has its shape.
fn on_cpu(x: &Tensor, f: impl FnOnce(&[f32]) -> Vec<f32>) -> Result<Tensor, ModelError> {
    let x = x.contiguous()?;
    let out = {
        let (storage, layout) = x.storage_and_layout();
        let (Storage::Cpu(CpuStorage::F32(data)), Some((start, end))) =
            (&*storage, layout.contiguous_offsets())
        else {
            return Err(ModelError::Device("expected f32 on the CPU".into()));
        };
        f(&data[start..end])
    };
    Ok(Tensor::from_vec(out, x.shape(), &Device::Cpu)?)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::params::Source;
    use crate::model::synth::Synth;
    use sharp_checkpoint::deterministic::model_weights as values;

    fn synth() -> Synth {
        Synth {
            salt: "ops".into(),
            device: Device::Cpu,
        }
    }

    fn picture(shape: &[usize]) -> Tensor {
        Tensor::from_vec(values("", "x.weight", shape), shape, &Device::Cpu).unwrap()
    }

    fn assert_close(a: &Tensor, b: &Tensor) {
        assert_eq!(a.dims(), b.dims());
        let off = (a - b).unwrap().abs().unwrap().flatten_all().unwrap();
        let off = off.max(0).unwrap().to_scalar::<f32>().unwrap();
        assert!(off < 2e-6, "{off}");
    }

    #[test]
    fn deconvolution_equals_the_general_one() {
        let (source, x) = (synth(), picture(&[1, 3, 4, 5]));
        let p = Params::new(&source);
        let weight = source.tensor("weight", &[3, 2, 2, 2]).unwrap();
        let general = x.conv_transpose2d(&weight, 0, 0, 2, 1).unwrap();
        assert_close(
            &Deconv2x2::new(&p, 3, 2, false)
                .unwrap()
                .forward(&x)
                .unwrap(),
            &general,
        );
    }

    #[test]
    fn patch_and_point_convolutions_equal_the_general_one() {
        let (source, x) = (synth(), picture(&[1, 3, 4, 8]));
        let p = Params::new(&source);
        let bias = source
            .tensor("bias", &[2])
            .unwrap()
            .reshape((1, 2, 1, 1))
            .unwrap();
        for size in [1, 2, 4] {
            let weight = source.tensor("weight", &[2, 3, size, size]).unwrap();
            let general = x
                .conv2d(&weight, 0, size, 1, 1)
                .unwrap()
                .broadcast_add(&bias)
                .unwrap();
            let patch = PatchConv::new(&p, 3, 2, size).unwrap();
            assert_close(&patch.image(&x).unwrap(), &general);
            if size == 1 {
                let point = Conv1x1::new(&p, 3, 2, true).unwrap();
                assert_close(&point.forward(&x).unwrap(), &general);
            }
        }
    }

    #[test]
    fn group_norm_on_the_cpu_equals_its_composed_form() {
        let (source, x) = (synth(), picture(&[1, 8, 16, 12]));
        let norm = GroupNorm::new(&Params::new(&source), 8, 4).unwrap();
        assert_close(
            &norm.forward(&x).unwrap(),
            &norm.composed(&x, (8, 16, 12)).unwrap(),
        );
    }

    #[test]
    fn layer_norm_knows_its_epsilon() {
        // A row whose variance is of the size of eps shows which one is used.
        let source = synth();
        let norm = LayerNorm::new(&Params::new(&source), 2).unwrap();
        let x = Tensor::new(&[[1.0_f32, 1.002]], &Device::Cpu).unwrap();
        let found = norm.forward(&x).unwrap().to_vec2::<f32>().unwrap();
        let weight = values("ops", "weight", &[2]);
        let bias = values("ops", "bias", &[2]);
        let half = f64::from(1.002_f32 - 1.0) / 2.0;
        let normal = half / (half * half + 1e-6).sqrt();
        assert!(
            (f64::from(found[0][1]) - (normal as f32 * weight[1] + bias[1]) as f64).abs() < 1e-6
        );
    }
}
