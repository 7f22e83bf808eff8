//! Linear layers and attention.

use std::sync::Arc;

use candle_core::{CpuStorage, D, InplaceOp2, Layout, Result, Tensor, bail};
use candle_nn::Module;
use candle_nn::ops::softmax;
use sharp_kernels::activation::{gelu, gelu_gradient};
use sharp_kernels::conv::backward::ConvInput;
use sharp_kernels::{AttentionShape, Epilogue, PackedMatrix, matmul};

use super::convolution::{gradients, point};
use super::custom::{Back, Operation, Pass, View, apply};
use super::{joined, parted};
use crate::model::compute::Kernels;

/// A linear layer with prepared weights.
pub(in crate::model) struct Linear {
    kernels: Option<Kernels>,
    product: Product,
    /// Weights followed by biases; `None` if the weights are packed and not trained.
    weights: Option<Tensor>,
}

impl Linear {
    /// Creates a linear layer; `weight` is `[out, in]`.
    pub(in crate::model) fn new(
        kernels: Option<Kernels>,
        weight: Tensor,
        bias: Tensor,
    ) -> Result<Self> {
        let (n, k) = weight.dims2()?;
        let pack = |kernels: Kernels| {
            let [(weight, of_weight), (bias, of_bias)] =
                [&weight, &bias].map(Tensor::storage_and_layout);
            let weight = View::of(&weight, of_weight)?.values;
            let bias = View::of(&bias, of_bias)?.values;
            let matrix = PackedMatrix::from_out_in(kernels.simd, weight, Some(bias), n, k);
            Ok::<_, candle_core::Error>(Arc::new(matrix))
        };
        let keeps = kernels.is_none_or(|kernels| kernels.learning);
        Ok(Self {
            kernels,
            product: Product {
                shape: [n, k],
                packed: kernels.map(pack).transpose()?,
                gelu: false,
            },
            weights: keeps.then(|| joined(&weight, Some(&bias))).transpose()?,
        })
    }

    pub(in crate::model) fn forward(&self, x: &Tensor) -> Result<Tensor> {
        let inputs: Vec<&Tensor> = [x].into_iter().chain(&self.weights).collect();
        apply(self.kernels, self.product.clone(), &inputs)
    }

    /// Applies the layer, then GELU.
    pub(in crate::model) fn forward_gelu(&self, x: &Tensor) -> Result<Tensor> {
        if self.weights.is_some() {
            return apply(self.kernels, Gelu, &[&self.forward(x)?]);
        }
        let fused = Product {
            gelu: true,
            ..self.product.clone()
        };
        apply(self.kernels, fused, &[x])
    }

    /// `x` plus the layer's output for `y`. Outside training, the memory of `x` is reused.
    pub(in crate::model) fn add_to(&self, x: Tensor, y: &Tensor) -> Result<Tensor> {
        match &self.weights {
            Some(weights) => apply(self.kernels, self.product.clone(), &[y, weights, &x]),
            None => {
                x.inplace_op2(y, &self.product)?;
                Ok(x)
            }
        }
    }
}

/// A linear layer, `[…, in]` to `[…, out]`. Its inputs are the tensor, the weights followed by
/// biases, and the tensor added to the result.
#[derive(Clone)]
struct Product {
    /// Shape of the weights, `[out, in]`.
    shape: [usize; 2],
    packed: Option<Arc<PackedMatrix>>,
    /// Applies GELU to the result; allowed only with packed weights.
    gelu: bool,
}

impl Product {
    fn matmul(&self, x: &[f32], out: &mut [f32], epilogue: Epilogue<'_>) {
        if let Some(packed) = &self.packed {
            matmul(x, packed, out, x.len() / packed.k(), epilogue);
        }
    }
}

impl Operation for Product {
    const NAME: &'static str = "sharp-linear";

    fn by_candle(&self, inputs: &[Tensor]) -> Result<Tensor> {
        let (weight, bias) = parted(&inputs[1], &self.shape)?;
        let y = candle_nn::Linear::new(weight, bias).forward(&inputs[0])?;
        match inputs.get(2) {
            Some(residual) => residual + y,
            None => Ok(y),
        }
    }

    fn by_kernels(&self, _: Kernels, inputs: &[View<'_>]) -> (Vec<f32>, Vec<usize>) {
        let [n, k] = self.shape;
        let x = inputs[0].values;
        let mut out = vec![0.0; x.len() / k * n];
        let epilogue = match inputs.get(2) {
            Some(residual) => Epilogue::Residual(residual.values),
            None if self.gelu => Epilogue::Gelu,
            None => Epilogue::None,
        };
        self.matmul(x, &mut out, epilogue);
        let mut shape = inputs[0].dims.to_vec();
        shape.pop();
        shape.push(n);
        (out, shape)
    }

    fn back(&self, kernels: Kernels, pass: &Pass<'_>) -> Option<Vec<Option<Back>>> {
        let [out_channels, in_channels] = self.shape;
        let spec = point(in_channels, out_channels);
        let data = pass.inputs[0].values;
        let input = ConvInput {
            data,
            height: data.len() / in_channels,
            width: 1,
            relu: false,
        };
        let upstream = pass.upstream.into();
        Some(gradients(kernels, spec, input, upstream, pass, None))
    }
}

/// Adds the product of the second tensor to the first, in place.
impl InplaceOp2 for Product {
    fn name(&self) -> &'static str {
        "sharp-add-linear"
    }

    fn cpu_fwd(
        &self,
        x: &mut CpuStorage,
        x_layout: &Layout,
        y: &CpuStorage,
        y_layout: &Layout,
    ) -> Result<()> {
        let y = View::new(y, y_layout)?.values;
        match (x, x_layout.contiguous_offsets()) {
            (CpuStorage::F32(x), Some((start, end))) => {
                self.matmul(y, &mut x[start..end], Epilogue::Add);
                Ok(())
            }
            _ => bail!("kernels need contiguous f32 tensors, not {x_layout:?}"),
        }
    }
}

/// Exact GELU, with the error function.
struct Gelu;

impl Operation for Gelu {
    const NAME: &'static str = "sharp-gelu";

    fn by_candle(&self, inputs: &[Tensor]) -> Result<Tensor> {
        inputs[0].gelu_erf()
    }

    fn by_kernels(&self, kernels: Kernels, inputs: &[View<'_>]) -> (Vec<f32>, Vec<usize>) {
        (
            gelu(kernels.simd, inputs[0].values),
            inputs[0].dims.to_vec(),
        )
    }

    fn back(&self, kernels: Kernels, pass: &Pass<'_>) -> Option<Vec<Option<Back>>> {
        let values = gelu_gradient(kernels.simd, pass.inputs[0].values, pass.upstream);
        Some(vec![Some(Back::Values(values))])
    }
}

/// Unmasked softmax attention of `[images, tokens, (queries, keys, values) · dim]`.
pub(in crate::model) fn attention(
    kernels: Option<Kernels>,
    qkv: &Tensor,
    heads: usize,
) -> Result<Tensor> {
    apply(kernels, Attention { heads }, &[qkv])
}

struct Attention {
    heads: usize,
}

impl Operation for Attention {
    const NAME: &'static str = "sharp-attention";

    fn by_candle(&self, inputs: &[Tensor]) -> Result<Tensor> {
        let (images, tokens, width) = inputs[0].dims3()?;
        let (heads, width) = (self.heads, width / 3 / self.heads);
        // [image, token, (q, k, v), head, width] to [(q, k, v), image · head, token, width].
        let qkv = inputs[0]
            .reshape((images, tokens, 3, heads, width))?
            .permute((2, 0, 3, 1, 4))?
            .contiguous()?
            .reshape((3, images * heads, tokens, width))?;
        let q = (qkv.get(0)? * (1.0 / (width as f64).sqrt()))?;
        let scores = q.matmul(&qkv.get(1)?.transpose(1, 2)?)?;
        softmax(&scores, D::Minus1)?
            .matmul(&qkv.get(2)?)?
            .reshape((images, heads, tokens, width))?
            .transpose(1, 2)?
            .reshape((images, tokens, heads * width))
    }

    fn by_kernels(&self, kernels: Kernels, inputs: &[View<'_>]) -> (Vec<f32>, Vec<usize>) {
        let (batch, tokens, width) = inputs[0].image();
        let head_dim = width / 3 / self.heads;
        let shape = AttentionShape {
            batch,
            tokens,
            heads: self.heads,
            head_dim,
        };
        let mut out = vec![0.0; inputs[0].values.len() / 3];
        let scale = 1.0 / (head_dim as f32).sqrt();
        sharp_kernels::attention(kernels.simd, inputs[0].values, &mut out, shape, scale);
        (out, vec![batch, tokens, shape.dim()])
    }
}
