//! Transposed convolutions.

use std::sync::Arc;

use sharp_kernels::conv::backward::{ConvInput, weight_gradient};
use sharp_kernels::{Algorithm, Conv2d, ConvSpec, RowOp, RowWindow};

use super::Learned;
use crate::model::ModelError;
use crate::model::engine::{CpuKernels, Engine, Runtime};
use crate::model::map::{HostMap, Map, mixed};
use crate::model::params::{Parameter, Params};
use crate::model::tape::Node;

/// A transposed 2×2 convolution with stride 2: every pixel becomes a block of four.
pub(in crate::model) struct Deconv {
    weight: Parameter,
    bias: Option<Parameter>,
    input: usize,
    output: usize,
}

impl Deconv {
    pub(in crate::model) fn new(p: &Params<'_>, input: usize, output: usize, bias: bool) -> Self {
        Self {
            weight: p.get("weight", &[input, output, 2, 2]),
            bias: bias.then(|| p.get("bias", &[output])),
            input,
            output,
        }
    }

    /// `[input, h, w]` to `[output, 2h, 2w]`.
    pub(in crate::model) fn forward(&self, rt: &Runtime, x: &Map) -> Result<Map, ModelError> {
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
