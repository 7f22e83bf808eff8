//! Layers of feature maps, on either engine.
//!
//! Convolutions whose kernel equals their stride, or is 1, are matrix products on tensors.

use std::sync::Arc;

use candle_core::{DType, Tensor};
use sharp_kernels::conv::backward::{
    ConvInput, InputGradient, bias_gradient, keep_where_positive, weight_gradient,
};
use sharp_kernels::{
    Algorithm, Conv2d, ConvOptions, ConvSpec, NormGradient, RowOp, RowWindow, Simd,
};

use super::ModelError;
use super::engine::{CpuKernels, Engine, Runtime};
use super::map::{HostMap, Map, mixed};
use super::params::{Parameter, Params};
use super::tape::{Gradients, Node};

/// A convolution with what is fused into it.
#[derive(Clone, Copy, Default)]
pub(super) struct Fused<'a> {
    /// The input is rectified first.
    pub(super) relu_input: bool,
    /// Added to the result.
    pub(super) residual: Option<&'a Map>,
    /// The result is rectified, last.
    pub(super) relu: bool,
}

/// A convolution: 3×3 with one pixel of padding, 1×1, or blocks that do not overlap.
pub(super) struct Conv {
    weight: Parameter,
    bias: Option<Parameter>,
    spec: ConvSpec,
}

impl Conv {
    /// 3×3, stride 1, one pixel of zero padding.
    pub(super) fn spatial(p: &Params<'_>, input: usize, output: usize, bias: bool) -> Self {
        Self::new(p, (input, output), (3, 1, 1), bias)
    }

    /// 1×1.
    pub(super) fn point(p: &Params<'_>, input: usize, output: usize, bias: bool) -> Self {
        Self::new(p, (input, output), (1, 1, 0), bias)
    }

    /// `size × size` with that stride.
    pub(super) fn blocks(p: &Params<'_>, input: usize, output: usize, size: usize) -> Self {
        Self::new(p, (input, output), (size, size, 0), true)
    }

    /// A linear layer of the channels: weights `[output, input]`.
    pub(super) fn linear(weight: &Parameter, bias: &Parameter) -> Self {
        Self {
            weight: weight.clone(),
            bias: Some(bias.clone()),
            spec: ConvSpec {
                in_channels: weight.shape[1],
                out_channels: weight.shape[0],
                kernel: 1,
                stride: 1,
                padding: 0,
            },
        }
    }

    fn new(
        p: &Params<'_>,
        (in_channels, out_channels): (usize, usize),
        (kernel, stride, padding): (usize, usize, usize),
        bias: bool,
    ) -> Self {
        Self {
            weight: p.get("weight", &[out_channels, in_channels, kernel, kernel]),
            bias: bias.then(|| p.get("bias", &[out_channels])),
            spec: ConvSpec {
                in_channels,
                out_channels,
                kernel,
                stride,
                padding,
            },
        }
    }

    /// `[input, h, w]` to `[output, h / stride, w / stride]`.
    pub(super) fn forward(
        &self,
        rt: &Runtime,
        x: &Map,
        fused: Fused<'_>,
    ) -> Result<Map, ModelError> {
        match (&rt.engine, x) {
            (Engine::Kernels(kernels), Map::Host(x)) => {
                let residual = match fused.residual {
                    None => None,
                    Some(Map::Host(map)) => Some(map),
                    Some(Map::Tensor(_)) => return Err(mixed()),
                };
                let options = ConvOptions {
                    relu_input: fused.relu_input,
                    residual: residual.map(|map| map.data.as_slice()),
                    relu: fused.relu,
                };
                let out = self.on_host(rt, kernels, x, options)?;
                let node = self.recorded(rt, kernels, x, residual, fused, &out)?;
                Ok(Map::Host(out.at_node(node)))
            }
            (Engine::Tensors(_), Map::Tensor(x)) => Ok(Map::Tensor(self.on_tensors(rt, x, fused)?)),
            _ => Err(mixed()),
        }
    }

    fn on_host(
        &self,
        rt: &Runtime,
        kernels: &CpuKernels,
        x: &HostMap,
        options: ConvOptions<'_>,
    ) -> Result<HostMap, ModelError> {
        let bias = self.bias.as_ref().map(|bias| rt.values(bias)).transpose()?;
        let conv = Conv2d::new(
            kernels.simd,
            self.spec,
            &rt.values(&self.weight)?,
            bias.as_deref(),
            false,
            kernels.convolution,
        );
        let (height, width) = conv.out_size(x.height, x.width);
        let shape = (height, width, self.spec.out_channels);
        let mut out = vec![0.0; shape.0 * shape.1 * shape.2];
        let window = RowWindow::whole(&x.data, x.height, x.width, x.channels);
        rt.with_workspace(|workspace| {
            conv.run_rows_with(&window, 0..height, &mut out, options, workspace);
        });
        Ok(HostMap::new(shape, out))
    }

    /// The way back from `out`, in training.
    fn recorded(
        &self,
        rt: &Runtime,
        kernels: &CpuKernels,
        x: &HostMap,
        residual: Option<&HostMap>,
        fused: Fused<'_>,
        out: &HostMap,
    ) -> Result<Option<Node>, ModelError> {
        let learned = Learned::of(rt, &self.weight, self.bias.as_ref());
        let residual = residual.and_then(|map| map.node.clone());
        let Some(tape) = &rt.tape else {
            return Ok(None);
        };
        if !learned.any() && x.node.is_none() && residual.is_none() {
            return Ok(None);
        }
        let (spec, kernels) = (self.spec, *kernels);
        let weight = match x.node {
            Some(_) => rt.values(&self.weight)?,
            None => Vec::new(),
        };
        let rectified = fused.relu.then(|| Arc::clone(&out.data));
        let (data, node) = (Arc::clone(&x.data), x.node.clone());
        let (height, width) = (x.height, x.width);
        Ok(Some(tape.record(move |mut g, gradients| {
            if let Some(out) = rectified {
                keep_where_positive(&mut g, &out);
            }
            let input = ConvInput {
                data: &data,
                height,
                width,
                relu: fused.relu_input,
            };
            learned.add(gradients, spec.out_channels, &g, || {
                weight_gradient(kernels.simd, spec, input, &g)
            });
            if node.is_some() {
                let back = InputGradient::new(kernels.simd, spec, &weight, kernels.convolution);
                let of_input = back.run(input, &g, &mut gradients.workspace);
                gradients.add(node.as_ref(), of_input);
            }
            gradients.add(residual.as_ref(), g);
            Ok(())
        })))
    }

    fn on_tensors(&self, rt: &Runtime, x: &Tensor, fused: Fused<'_>) -> Result<Tensor, ModelError> {
        let weight = rt.tensor(&self.weight, x.device())?;
        let x = if fused.relu_input { &x.relu()? } else { x };
        let mut y = if self.spec.kernel == self.spec.stride {
            self.blocks_on_tensors(x, &weight)?
        } else {
            x.conv2d(&weight, self.spec.padding, self.spec.stride, 1, 1)?
        };
        if let Some(bias) = &self.bias {
            let bias = rt.tensor(bias, x.device())?;
            y = y.broadcast_add(&bias.reshape((1, (), 1, 1))?)?;
        }
        match fused.residual {
            None => {}
            Some(Map::Tensor(residual)) => y = (y + residual)?,
            Some(Map::Host(_)) => return Err(mixed()),
        }
        Ok(if fused.relu { y.relu()? } else { y })
    }

    fn blocks_on_tensors(&self, x: &Tensor, weight: &Tensor) -> Result<Tensor, ModelError> {
        let (_, c, h, w) = x.dims4()?;
        let size = self.spec.kernel;
        let (rows, columns) = (h / size, w / size);
        // [channel, dy, dx, row, column], the order of the weights' columns.
        let blocks = match size {
            1 => x.reshape((c, h * w))?,
            _ => x
                .reshape((c, rows, size, columns, size))?
                .permute((0, 2, 4, 1, 3))?
                .reshape((c * size * size, rows * columns))?,
        };
        let weight = weight.reshape((self.spec.out_channels, c * size * size))?;
        Ok(weight.matmul(&blocks)?.reshape((1, (), rows, columns))?)
    }
}

/// Which parameters of a layer want gradients.
pub(super) struct Learned {
    pub(super) weight: Option<String>,
    pub(super) bias: Option<String>,
}

impl Learned {
    pub(super) fn of(rt: &Runtime, weight: &Parameter, bias: Option<&Parameter>) -> Self {
        let wanted = |parameter: &Parameter| {
            let tape = rt.tape.as_ref()?;
            tape.trains(&parameter.name).then(|| parameter.name.clone())
        };
        Self {
            weight: wanted(weight),
            bias: bias.and_then(wanted),
        }
    }

    pub(super) fn any(&self) -> bool {
        self.weight.is_some() || self.bias.is_some()
    }

    /// Adds what the gradient `g` of an output with so many channels means.
    fn add(
        &self,
        gradients: &mut Gradients,
        channels: usize,
        g: &[f32],
        weight: impl FnOnce() -> Vec<f32>,
    ) {
        if let Some(name) = &self.weight {
            gradients.add_parameter(name, weight());
        }
        if let Some(name) = &self.bias {
            gradients.add_parameter(name, bias_gradient(g, channels));
        }
    }

    /// Adds the gradients of a normalisation's scales and shifts; that of its input is given back.
    pub(super) fn add_norm(&self, gradients: &mut Gradients, back: NormGradient) -> Vec<f32> {
        if let Some(name) = &self.weight {
            gradients.add_parameter(name, back.gamma);
        }
        if let Some(name) = &self.bias {
            gradients.add_parameter(name, back.beta);
        }
        back.input
    }
}

/// A transposed 2×2 convolution with stride 2: every pixel becomes a block of four.
pub(super) struct Deconv {
    weight: Parameter,
    bias: Option<Parameter>,
    input: usize,
    output: usize,
}

impl Deconv {
    pub(super) fn new(p: &Params<'_>, input: usize, output: usize, bias: bool) -> Self {
        Self {
            weight: p.get("weight", &[input, output, 2, 2]),
            bias: bias.then(|| p.get("bias", &[output])),
            input,
            output,
        }
    }

    /// `[input, h, w]` to `[output, 2h, 2w]`.
    pub(super) fn forward(&self, rt: &Runtime, x: &Map) -> Result<Map, ModelError> {
        match (&rt.engine, x) {
            (Engine::Kernels(kernels), Map::Host(x)) => {
                let bias = self.bias.as_ref().map(|bias| rt.values(bias)).transpose()?;
                let weight = rt.values(&self.weight)?;
                let deconv = sharp_kernels::TransposedConv2x2::new(
                    kernels.simd,
                    self.input,
                    self.output,
                    &weight,
                    bias.as_deref(),
                );
                let shape = (2 * x.height, 2 * x.width, self.output);
                let mut out = vec![0.0; shape.0 * shape.1 * shape.2];
                let window = RowWindow::whole(&x.data, x.height, x.width, x.channels);
                rt.with_workspace(|workspace| {
                    deconv.run_rows(&window, 0..2 * x.height, &mut out, workspace);
                });
                let node = self.recorded(rt, kernels, x, weight);
                Ok(Map::Host(HostMap::new(shape, out).at_node(node)))
            }
            (Engine::Tensors(_), Map::Tensor(x)) => {
                let (_, c, h, w) = x.dims4()?;
                let weight = rt.tensor(&self.weight, x.device())?;
                let weight = weight.reshape((c, 4 * self.output))?.t()?;
                let y = weight.matmul(&x.reshape((c, h * w))?)?;
                // [output, dy, dx, y, x] to [output, y, dy, x, dx].
                let y = y
                    .reshape((self.output, 2, 2, h, w))?
                    .permute((0, 3, 1, 4, 2))?
                    .reshape((1, self.output, 2 * h, 2 * w))?;
                Ok(Map::Tensor(match &self.bias {
                    Some(bias) => {
                        let bias = rt.tensor(bias, x.device())?;
                        y.broadcast_add(&bias.reshape((1, (), 1, 1))?)?
                    }
                    None => y,
                }))
            }
            _ => Err(mixed()),
        }
    }
}

impl Deconv {
    /// The way back, in training: through the convolution of blocks that this one transposes.
    fn recorded(
        &self,
        rt: &Runtime,
        kernels: &CpuKernels,
        x: &HostMap,
        weight: Vec<f32>,
    ) -> Option<Node> {
        let learned = Learned::of(rt, &self.weight, self.bias.as_ref());
        let tape = rt.tape.as_ref()?;
        if !learned.any() && x.node.is_none() {
            return None;
        }
        let transpose = ConvSpec {
            in_channels: self.output,
            out_channels: self.input,
            kernel: 2,
            stride: 2,
            padding: 0,
        };
        let (simd, data, node) = (kernels.simd, Arc::clone(&x.data), x.node.clone());
        let (height, width) = (x.height, x.width);
        Some(tape.record(move |g, gradients| {
            let blocks = ConvInput {
                data: &g,
                height: 2 * height,
                width: 2 * width,
                relu: false,
            };
            learned.add(gradients, transpose.in_channels, &g, || {
                weight_gradient(simd, transpose, blocks, &data)
            });
            if node.is_some() {
                let back = Conv2d::new(simd, transpose, &weight, None, false, Algorithm::Direct);
                let window = RowWindow::whole(&g, 2 * height, 2 * width, transpose.in_channels);
                let mut of_input = vec![0.0; data.len()];
                back.run_rows(&window, 0..height, &mut of_input, &mut gradients.workspace);
                gradients.add(node.as_ref(), of_input);
            }
            Ok(())
        }))
    }
}

/// Normalisation over groups of channels and all pixels, then a learned scale and shift.
pub(super) struct GroupNormLayer {
    weight: Parameter,
    bias: Parameter,
    groups: usize,
}

impl GroupNormLayer {
    const EPS: f32 = 1e-5;

    pub(super) fn new(p: &Params<'_>, width: usize, groups: usize) -> Self {
        Self {
            weight: p.get("weight", &[width]),
            bias: p.get("bias", &[width]),
            groups,
        }
    }

    /// `[width, h, w]` to the same shape.
    pub(super) fn forward(&self, rt: &Runtime, x: &Map) -> Result<Map, ModelError> {
        match (&rt.engine, x) {
            (Engine::Kernels(kernels), Map::Host(x)) => {
                let norm = sharp_kernels::GroupNorm::new(
                    self.groups,
                    &rt.values(&self.weight)?,
                    &rt.values(&self.bias)?,
                    Self::EPS,
                );
                let mut out = vec![0.0; x.data.len()];
                norm.run(kernels.simd, &x.data, false, &mut out);
                let node = self.recorded(rt, kernels.simd, norm, x);
                let shape = (x.height, x.width, x.channels);
                Ok(Map::Host(HostMap::new(shape, out).at_node(node)))
            }
            (Engine::Tensors(_), Map::Tensor(x)) => Ok(Map::Tensor(self.on_tensors(rt, x)?)),
            _ => Err(mixed()),
        }
    }

    /// The way back, in training.
    fn recorded(
        &self,
        rt: &Runtime,
        simd: Simd,
        norm: sharp_kernels::GroupNorm,
        x: &HostMap,
    ) -> Option<Node> {
        let learned = Learned::of(rt, &self.weight, Some(&self.bias));
        let tape = rt.tape.as_ref()?;
        if !learned.any() && x.node.is_none() {
            return None;
        }
        let (data, node) = (Arc::clone(&x.data), x.node.clone());
        Some(tape.record(move |g, gradients| {
            let back = norm.backward(simd, &data, &g);
            let of_input = learned.add_norm(gradients, back);
            gradients.add(node.as_ref(), of_input);
            Ok(())
        }))
    }

    /// Sums in f64 where the device has it: over the millions of values of a group, f32 would be
    /// off by 1e-5.
    fn on_tensors(&self, rt: &Runtime, x: &Tensor) -> Result<Tensor, ModelError> {
        let (_, c, h, w) = x.dims4()?;
        let wide = if x.device().is_metal() {
            DType::F32
        } else {
            DType::F64
        };
        let grouped = x.reshape((self.groups, c / self.groups * h, w))?;
        let mean = |t: &Tensor| {
            let t = t.to_dtype(wide)?;
            t.mean_keepdim(2)?.mean_keepdim(1)?.to_dtype(DType::F32)
        };
        let centered = grouped.broadcast_sub(&mean(&grouped)?)?;
        let variance = mean(&centered.sqr()?)?;
        let deviation = (variance + f64::from(Self::EPS))?.sqrt()?;
        let normal = centered.broadcast_div(&deviation)?;
        let per_channel = |parameter: &Parameter| {
            Ok::<_, ModelError>(rt.tensor(parameter, x.device())?.reshape((1, c, 1, 1))?)
        };
        Ok(normal
            .reshape((1, c, h, w))?
            .broadcast_mul(&per_channel(&self.weight)?)?
            .broadcast_add(&per_channel(&self.bias)?)?)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::cell::RefCell;

    use crate::model::synth::Synth;
    use candle_core::Device;
    use sharp_checkpoint::deterministic::model_weights;

    fn runtimes() -> [Runtime; 3] {
        [
            Engine::Tensors(Device::Cpu),
            Engine::cpu(Algorithm::Direct),
            Engine::cpu(Algorithm::Winograd),
        ]
        .map(|engine| Runtime::new(engine, Box::new(Synth::default())))
    }

    /// Runs a layer on every engine; the planes must agree with the first's.
    fn agree(shape: (usize, usize, usize), layer: impl Fn(&Runtime, &Map) -> Map) -> Vec<f32> {
        let (c, h, w) = shape;
        let planes = model_weights("", "x.weight", &[c, h, w, 1]);
        let mut reference = Vec::new();
        for rt in runtimes() {
            let x = Map::from_planes(&rt.engine, &planes, shape).unwrap();
            let found = layer(&rt, &x).to_planes().unwrap();
            if reference.is_empty() {
                reference = found;
                continue;
            }
            let exact =
                matches!(&rt.engine, Engine::Kernels(k) if k.convolution == Algorithm::Direct);
            let tolerance = if exact { 2e-6 } else { 1e-5 };
            assert_eq!(found.len(), reference.len());
            for (a, b) in found.iter().zip(&reference) {
                assert!((a - b).abs() < tolerance, "{a} against {b}");
            }
        }
        reference
    }

    fn declare<T>(build: impl FnOnce(&Params<'_>) -> T) -> T {
        build(&Params::new(&RefCell::default()))
    }

    #[test]
    fn convolutions_agree_with_everything_fused() {
        let convs = [
            declare(|p| Conv::spatial(p, 16, 16, true)),
            declare(|p| Conv::point(p, 16, 16, false)),
        ];
        for conv in convs {
            for (relu_input, relu, with_residual) in [
                (false, false, false),
                (true, false, true),
                (false, true, true),
            ] {
                agree((16, 9, 7), |rt, x| {
                    let fused = Fused {
                        relu_input,
                        residual: with_residual.then_some(x),
                        relu,
                    };
                    conv.forward(rt, x, fused).unwrap()
                });
            }
        }
        let blocks = declare(|p| Conv::blocks(p, 5, 6, 2));
        agree((5, 8, 6), |rt, x| {
            blocks.forward(rt, x, Fused::default()).unwrap()
        });
    }

    #[test]
    fn blocks_are_the_general_convolution() {
        let blocks = declare(|p| Conv::blocks(p, 3, 4, 2));
        let found = agree((3, 4, 6), |rt, x| {
            blocks.forward(rt, x, Fused::default()).unwrap()
        });
        let tensor = |name: &str, shape: &[usize]| {
            Tensor::from_vec(model_weights("", name, shape), shape, &Device::Cpu).unwrap()
        };
        let x = model_weights("", "x.weight", &[3, 4, 6, 1]);
        let x = Tensor::from_vec(x, (1, 3, 4, 6), &Device::Cpu).unwrap();
        let general = x
            .conv2d(&tensor("weight", &[4, 3, 2, 2]), 0, 2, 1, 1)
            .unwrap();
        let bias = tensor("bias", &[4]).reshape((1, 4, 1, 1)).unwrap();
        let general = general.broadcast_add(&bias).unwrap().flatten_all().unwrap();
        for (a, b) in found.iter().zip(general.to_vec1::<f32>().unwrap()) {
            assert!((a - b).abs() < 2e-6, "{a} against {b}");
        }
    }

    #[test]
    fn deconvolutions_agree_with_the_general_one() {
        let deconv = declare(|p| Deconv::new(p, 3, 2, false));
        let found = agree((3, 4, 5), |rt, x| deconv.forward(rt, x).unwrap());
        let with_bias = declare(|p| Deconv::new(p, 8, 6, true));
        agree((8, 3, 5), |rt, x| with_bias.forward(rt, x).unwrap());
        let weight = model_weights("", "weight", &[3, 2, 2, 2]);
        let weight = Tensor::from_vec(weight, (3, 2, 2, 2), &Device::Cpu).unwrap();
        let x = model_weights("", "x.weight", &[3, 4, 5, 1]);
        let x = Tensor::from_vec(x, (1, 3, 4, 5), &Device::Cpu).unwrap();
        let general = x.conv_transpose2d(&weight, 0, 0, 2, 1).unwrap();
        let general = general.flatten_all().unwrap().to_vec1::<f32>().unwrap();
        for (a, b) in found.iter().zip(general) {
            assert!((a - b).abs() < 2e-6, "{a} against {b}");
        }
    }

    #[test]
    fn group_norms_agree() {
        let norm = declare(|p| GroupNormLayer::new(p, 8, 4));
        agree((8, 16, 12), |rt, x| norm.forward(rt, x).unwrap());
    }
}
