//! Layers of frozen networks that evaluate pictures.

use std::sync::Arc;

use candle_core::{Result, Tensor};
use sharp_kernels::conv::backward::InputGradient;
use sharp_kernels::{ConvSpec, MaxPool, RowOp};

use super::convolution::{Convolution, every};
use super::custom::{Back, Operation, Pass, View, apply};
use crate::model::compute::{Compute, Kernels};

/// A convolution with constant weights, which the kernels keep packed for the forward and the
/// backward direction.
pub struct FrozenConvolution {
    operation: Convolution,
    /// Weights followed by biases.
    weights: Tensor,
    dilation: usize,
    kernels: Option<Kernels>,
}

impl FrozenConvolution {
    /// Packs the weights, `[out, in, kernel, kernel]`. An odd kernel is padded so that the output has the image's size,
    /// divided by the stride. If `dilation` (the distance between the kernel's taps, in pixels) exceeds 1, the stride
    /// must be 1.
    ///
    /// # Errors
    /// If the device fails.
    ///
    /// # Panics
    /// If a length is wrong.
    pub fn new(
        compute: &Compute,
        [out_channels, in_channels, kernel]: [usize; 3],
        [weight, bias]: [&[f32]; 2],
        [stride, dilation]: [usize; 2],
    ) -> Result<Self> {
        let Compute { device, kernels } = compute;
        let spec = ConvSpec {
            in_channels,
            out_channels,
            kernel,
            stride,
            padding: kernel / 2,
        };
        let packed = kernels.map(|kernels| {
            let back = InputGradient::new(kernels.simd, spec, weight, kernels.convolution);
            Arc::new((kernels.conv2d(spec, weight, Some(bias)), back))
        });
        let weights = [weight, bias].concat();
        Ok(Self {
            operation: Convolution {
                spec,
                relu_input: false,
                relu: false,
                packed,
            },
            weights: Tensor::new(weights, device)?,
            dilation,
            kernels: *kernels,
        })
    }

    /// Convolves an image, adds `residual`, and applies ReLU if `relu`.
    ///
    /// # Errors
    /// If shapes do not fit, or the device fails.
    pub fn forward(&self, x: &Tensor, residual: Option<&Tensor>, relu: bool) -> Result<Tensor> {
        if self.dilation == 1 {
            return self.dense(x, residual, relu);
        }
        // A dilated kernel only combines pixels whose distances are multiples of the dilation.
        // Therefore, the image consists of `dilation²` independent images, which are placed side by
        // side with zeros between them and convolved as one.
        let (_, height, width, _) = x.dims4()?;
        let residual = residual.map(|residual| self.apart(residual)).transpose()?;
        let y = self.dense(&self.apart(x)?, residual.as_ref(), relu)?;
        let (_, rows, columns, channels) = y.dims4()?;
        let (d, side) = (
            self.dilation,
            [rows, columns].map(|side| side / self.dilation),
        );
        y.reshape((d, side[0], d, side[1], channels))?
            .permute((1, 0, 3, 2, 4))?
            .contiguous()?
            .reshape((1, rows, columns, channels))?
            .narrow(1, 0, height)?
            .narrow(2, 0, width)?
            .contiguous()
    }

    /// Splits an image into `dilation²` images, placed side by side, each followed by at least one
    /// row and one column of zeros.
    fn apart(&self, x: &Tensor) -> Result<Tensor> {
        let (_, height, width, channels) = x.dims4()?;
        let d = self.dilation;
        let [rows, columns] = [height, width].map(|side| side.div_ceil(d) + 1);
        x.pad_with_zeros(1, 0, rows * d - height)?
            .pad_with_zeros(2, 0, columns * d - width)?
            .reshape((rows, d, columns, d, channels))?
            .permute((1, 0, 3, 2, 4))?
            .contiguous()?
            .reshape((1, rows * d, columns * d, channels))
    }

    fn dense(&self, x: &Tensor, residual: Option<&Tensor>, relu: bool) -> Result<Tensor> {
        let operation = Convolution {
            relu,
            ..self.operation.clone()
        };
        let inputs: Vec<&Tensor> = [x, &self.weights].into_iter().chain(residual).collect();
        apply(self.kernels, operation, &inputs)
    }
}

/// Maxima of `side × side` windows with stride 2, for a non-negative image with `padding` zeros around it. The gradient
/// goes to the first of equal values. Without padding, a last odd row or column is dropped.
///
/// # Errors
/// If the device fails.
pub fn max_pool(compute: &Compute, x: &Tensor, side: usize, padding: usize) -> Result<Tensor> {
    let x = x.pad_with_zeros(1, padding, padding)?;
    let x = x.pad_with_zeros(2, padding, padding)?;
    apply(compute.kernels, Maxima { side }, &[&x])
}

struct Maxima {
    side: usize,
}

impl Operation for Maxima {
    const NAME: &'static str = "sharp-max-pool";

    fn by_candle(&self, inputs: &[Tensor]) -> Result<Tensor> {
        let x = &inputs[0];
        let (_, height, width, _) = x.dims4()?;
        // Number of rows and columns from the first window's first pixel to the last window's first pixel, both
        // included.
        let [rows, columns] = [height, width].map(|side| (side - self.side) / 2 * 2 + 1);
        let tap = |tap: usize| {
            let rows = x.narrow(1, tap / self.side, rows)?;
            every(&rows.narrow(2, tap % self.side, columns)?.contiguous()?, 2)
        };
        let mut most = tap(0)?;
        for at in 1..self.side * self.side {
            let other = tap(at)?;
            most = most.ge(&other)?.where_cond(&most, &other)?;
        }
        Ok(most)
    }

    fn by_kernels(&self, kernels: Kernels, inputs: &[View<'_>]) -> (Vec<f32>, Vec<usize>) {
        let pool = MaxPool::new(kernels.simd, self.side, 2, false);
        let (height, width, channels) = inputs[0].image();
        let (rows, columns) = pool.out_size(height, width);
        let mut out = vec![0.0; rows * columns * channels];
        pool.run_rows(&inputs[0].window(), 0..rows, &mut out);
        (out, vec![1, rows, columns, channels])
    }

    fn back(&self, _: Kernels, pass: &Pass<'_>) -> Option<Vec<Option<Back>>> {
        let x = pass.inputs[0].values;
        let ((_, width, channels), (_, columns, _)) = (pass.inputs[0].image(), pass.output.image());
        let mut values = vec![0.0; x.len()];
        for (at, (most, upstream)) in pass.output.values.iter().zip(pass.upstream).enumerate() {
            let (pixel, channel) = (at / channels, at % channels);
            let corner = 2 * (pixel / columns * width + pixel % columns);
            let taps = (0..self.side * self.side).map(|tap| {
                let pixel = corner + tap / self.side * width + tap % self.side;
                pixel * channels + channel
            });
            if let Some(first) = taps.into_iter().find(|tap| x[*tap] == *most) {
                values[first] += upstream;
            }
        }
        Some(vec![Some(Back::Values(values))])
    }
}
