//! Frozen convolutions of feature maps, and their gradient with respect to the input.
//!
//! The gradient of a convolution with respect to its input is a convolution too, with input and output channels
//! exchanged and the kernel's taps in reverse; after a stride its input has zeros between.

use sharp_kernels::conv::backward::turned_weights;
use sharp_kernels::{Algorithm, Conv2d, ConvOptions, ConvSpec, RowOp, RowWindow, Simd};

/// A feature map, `[row][column][channel]`.
#[derive(Debug, Clone, PartialEq)]
pub(super) struct FeatureMap {
    pub(super) height: usize,
    pub(super) width: usize,
    pub(super) channels: usize,
    pub(super) data: Vec<f32>,
}

impl FeatureMap {
    pub(super) fn zeros([height, width]: [usize; 2], channels: usize) -> Self {
        Self {
            height,
            width,
            channels,
            data: vec![0.0; height * width * channels],
        }
    }

    pub(super) fn size(&self) -> [usize; 2] {
        [self.height, self.width]
    }

    pub(super) fn add(&mut self, other: &Self) {
        let pairs = self.data.iter_mut().zip(&other.data);
        pairs.for_each(|(a, b)| *a += b);
    }

    fn pixel(&self, y: usize, x: usize) -> &[f32] {
        &self.data[(y * self.width + x) * self.channels..][..self.channels]
    }

    fn pixel_mut(&mut self, y: usize, x: usize) -> &mut [f32] {
        &mut self.data[(y * self.width + x) * self.channels..][..self.channels]
    }

    /// Copies to `out` the pixels that `to` gives a place there, which is where they come from if `back`.
    fn moved(&self, mut out: Self, back: bool, to: impl Fn(usize) -> [usize; 2]) -> Self {
        // Axes move alike: each coordinate has its place along rows and along columns.
        let (small, large) = if back {
            (out.size(), self.size())
        } else {
            (self.size(), out.size())
        };
        debug_assert!(small[0] <= large[0] && small[1] <= large[1]);
        for y in 0..small[0] {
            for x in 0..small[1] {
                let (there_y, there_x) = (to(y)[0], to(x)[1]);
                if back {
                    out.pixel_mut(y, x)
                        .copy_from_slice(self.pixel(there_y, there_x));
                } else {
                    out.pixel_mut(there_y, there_x)
                        .copy_from_slice(self.pixel(y, x));
                }
            }
        }
        out
    }
}

/// A convolution with frozen weights, packed in both directions.
pub(super) struct FrozenConv {
    run: Conv2d,
    pull: Conv2d,
    stride: usize,
    /// Pixels between the taps of the kernel; of stride 1 only.
    dilation: usize,
}

impl FrozenConv {
    /// Weights `[out, in, kernel, kernel]` and biases; the kernel's side is 1, or 3, which is padded to keep a map's
    /// size.
    pub(super) fn new(
        simd: Simd,
        [out, inputs, kernel]: [usize; 3],
        [weight, bias]: [&[f32]; 2],
        [stride, dilation]: [usize; 2],
    ) -> Self {
        let spec = ConvSpec {
            in_channels: inputs,
            out_channels: out,
            kernel,
            stride,
            padding: kernel / 2,
        };
        let back = ConvSpec {
            in_channels: out,
            out_channels: inputs,
            stride: 1,
            ..spec
        };
        let conv = |spec, weight: &[f32], bias| {
            Conv2d::new(simd, spec, weight, bias, false, Algorithm::Winograd)
        };
        Self {
            run: conv(spec, weight, Some(bias)),
            pull: conv(back, &turned_weights(&spec, weight), None),
            stride,
            dilation,
        }
    }

    /// The result, plus `residual`, rectified if `relu`.
    pub(super) fn run(
        &self,
        x: &FeatureMap,
        residual: Option<&FeatureMap>,
        relu: bool,
    ) -> FeatureMap {
        dilated(&self.run, self.dilation, x, residual, relu)
    }

    /// From the gradient of the result to that of an input of `size`, plus `residual`.
    pub(super) fn pull(
        &self,
        gradient: &FeatureMap,
        size: [usize; 2],
        residual: Option<&FeatureMap>,
    ) -> FeatureMap {
        let spread;
        let gradient = if self.stride == 1 {
            gradient
        } else {
            let between = FeatureMap::zeros(size, gradient.channels);
            spread = gradient.moved(between, false, |i| [i * self.stride; 2]);
            &spread
        };
        dilated(&self.pull, self.dilation, gradient, residual, false)
    }
}

/// A convolution whose taps lie `dilation` pixels apart: it never mixes pixels whose coordinates differ by other than
/// multiples of that, so their images are laid side by side, zeros between, and convolved as one.
fn dilated(
    conv: &Conv2d,
    dilation: usize,
    x: &FeatureMap,
    residual: Option<&FeatureMap>,
    relu: bool,
) -> FeatureMap {
    if dilation == 1 {
        return whole(conv, x, residual, relu);
    }
    // Each image with the line of zeros that parts it from the next.
    let [rows, columns] = x.size().map(|side| side.div_ceil(dilation) + 1);
    let place = |i: usize| [rows, columns].map(|side| i % dilation * side + i / dilation);
    let phases = |map: &FeatureMap| {
        let zeros = FeatureMap::zeros([dilation * rows, dilation * columns], map.channels);
        map.moved(zeros, false, place)
    };
    let residual = residual.map(phases);
    let apart = whole(conv, &phases(x), residual.as_ref(), relu);
    apart.moved(FeatureMap::zeros(x.size(), apart.channels), true, place)
}

fn whole(conv: &Conv2d, x: &FeatureMap, residual: Option<&FeatureMap>, relu: bool) -> FeatureMap {
    let (height, width) = conv.out_size(x.height, x.width);
    let mut out = FeatureMap::zeros([height, width], conv.spec().out_channels);
    let window = RowWindow::whole(&x.data, x.height, x.width, x.channels);
    let options = ConvOptions {
        residual: residual.map(|map| map.data.as_slice()),
        relu,
        ..ConvOptions::default()
    };
    conv.run_rows_with(&window, 0..height, &mut out.data, options);
    out
}
