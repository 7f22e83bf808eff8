//! Convolutions. Those whose kernel equals their stride, or is 1, are matrix products on tensors.

use std::sync::Arc;

use candle_core::Tensor;
use sharp_kernels::conv::backward::{
    ConvInput, InputGradient, keep_where_positive, weight_gradient,
};
use sharp_kernels::{Conv2d, ConvOptions, ConvSpec, RowOp, RowWindow};

use super::Learned;
use crate::model::ModelError;
use crate::model::engine::{CpuKernels, Engine, Runtime};
use crate::model::map::{HostMap, Map, mixed};
use crate::model::params::{Parameter, Params};
use crate::model::tape::Node;

/// A convolution with what is fused into it.
#[derive(Clone, Copy, Default)]
pub(in crate::model) struct Fused<'a> {
    /// The input is rectified first.
    pub(in crate::model) relu_input: bool,
    /// Added to the result.
    pub(in crate::model) residual: Option<&'a Map>,
    /// The result is rectified, last.
    pub(in crate::model) relu: bool,
}

/// A convolution: 3×3 with one pixel of padding, 1×1, or blocks that do not overlap.
pub(in crate::model) struct Conv {
    weight: Parameter,
    bias: Option<Parameter>,
    spec: ConvSpec,
}

impl Conv {
    /// 3×3, stride 1, one pixel of zero padding.
    pub(in crate::model) fn spatial(
        p: &Params<'_>,
        input: usize,
        output: usize,
        bias: bool,
    ) -> Self {
        Self::new(p, (input, output), (3, 1, 1), bias)
    }

    /// 1×1.
    pub(in crate::model) fn point(p: &Params<'_>, input: usize, output: usize, bias: bool) -> Self {
        Self::new(p, (input, output), (1, 1, 0), bias)
    }

    /// `size × size` with that stride.
    pub(in crate::model) fn blocks(
        p: &Params<'_>,
        input: usize,
        output: usize,
        size: usize,
    ) -> Self {
        Self::new(p, (input, output), (size, size, 0), true)
    }

    /// A linear layer of the channels: weights `[output, input]`.
    pub(in crate::model) fn linear(weight: &Parameter, bias: &Parameter) -> Self {
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
    pub(in crate::model) fn forward(
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
