//! The networks on candle tensors, on a GPU or, for reference, on the CPU.
//!
//! Like [`stream`](super::stream()) on the CPU kernels, this works in strips of rows. Each layer buffers only what its
//! next rows need, so that memory does not grow with the picture's height. Each picture is a separate batch, because a
//! device's summation order may depend on the batch size, but a score must not depend on which other pictures are
//! scored. Features leave the device as f32; everything after them is the same f64 code as for the kernels.

use std::ops::Range;

use candle_core::{Device, Result, Tensor};

use super::architecture::{LayerSpec, layer_specs, smallest_side};
use super::rows::MapSize;
use super::stream::{Taps, default_strip};
use crate::weights::{Backbone, Tensors};

#[derive(Debug, Clone)]
pub(crate) struct TensorNetwork {
    device: Device,
    layers: Vec<TensorLayer>,
    smallest_side: usize,
}

#[derive(Debug, Clone)]
struct TensorLayer {
    op: Op,
    window: Window,
    /// Index of the tap on the layer's output, if there is one.
    tap: Option<usize>,
}

/// The operation on each window.
#[derive(Debug, Clone)]
enum Op {
    /// Convolution, bias, ReLU.
    Conv(ConvWeights),
    /// SqueezeNet's parallel 1×1 and 3×3 convolutions, each with bias and ReLU.
    Expand(ConvWeights, ConvWeights),
    MaxPool,
    /// DISTS's pooling: the root of the mean of squares under a 3×3 Hann window `[1, 1, 3, 3]`.
    L2Pool(Tensor),
}

#[derive(Debug, Clone)]
struct ConvWeights {
    /// Weights `[out, in, k, k]`.
    weight: Tensor,
    /// Biases `[1, out, 1, 1]`.
    bias: Tensor,
}

/// The window of inputs from which each output is computed, the same along rows and columns.
#[derive(Debug, Clone, Copy)]
struct Window {
    size: usize,
    stride: usize,
    padding: usize,
    /// True if a window that extends beyond the input is kept.
    ceil: bool,
}

impl Window {
    fn out_side(&self, side: usize) -> usize {
        let beyond = if self.ceil { self.stride - 1 } else { 0 };
        let Some(room) = (side + 2 * self.padding + beyond).checked_sub(self.size) else {
            return 0;
        };
        let outputs = room / self.stride + 1;
        if self.ceil {
            outputs.min(side.div_ceil(self.stride))
        } else {
            outputs
        }
    }

    /// The inputs that the outputs `out` depend on, as a range within `0..side`, and the numbers of padding zeros
    /// before and after it.
    fn inputs(&self, out: &Range<usize>, side: usize) -> (Range<usize>, usize, usize) {
        let start = out.start * self.stride;
        let end = (out.end - 1) * self.stride + self.size;
        let (first, last) = (
            start.saturating_sub(self.padding),
            end.saturating_sub(self.padding),
        );
        let before = self.padding.saturating_sub(start);
        (first..last.min(side), before, last.saturating_sub(side))
    }
}

impl ConvWeights {
    fn new(tensors: &Tensors, name: &str, device: &Device) -> Result<Self> {
        let (shape, values) = tensors.get(&format!("{name}.weight"));
        let (_, bias) = tensors.get(&format!("{name}.bias"));
        Ok(Self {
            weight: Tensor::from_slice(values, shape, device)?,
            bias: Tensor::from_slice(bias, (1, bias.len(), 1, 1), device)?,
        })
    }

    /// Convolution, bias and ReLU of a padded input, `[1, in, rows, columns]`.
    fn apply(&self, x: &Tensor, stride: usize) -> Result<Tensor> {
        x.conv2d(&self.weight, 0, stride, 1, 1)?
            .broadcast_add(&self.bias)?
            .relu()
    }

    fn channels(&self) -> usize {
        self.weight.dims()[0]
    }
}

impl TensorLayer {
    fn channels(&self, input: usize) -> usize {
        match &self.op {
            Op::Conv(conv) => conv.channels(),
            Op::Expand(one, three) => one.channels() + three.channels(),
            Op::MaxPool | Op::L2Pool(_) => input,
        }
    }

    /// Computes the output rows `out` from an input map of `size`. `x`, `[1, channels, rows, columns]`, holds the
    /// input's rows from `first` on.
    fn rows(&self, x: &Tensor, first: usize, size: MapSize, out: &Range<usize>) -> Result<Tensor> {
        let columns = 0..self.window.out_side(size.width);
        let (rows, above, below) = self.window.inputs(out, size.height);
        let (_, left, right) = self.window.inputs(&columns, size.width);
        let held = x.narrow(2, rows.start - first, rows.len())?;
        // Zero padding does not affect max pooling, because the values pooled are the output of a ReLU and never
        // negative.
        let x = held
            .pad_with_zeros(2, above, below)?
            .pad_with_zeros(3, left, right)?
            .contiguous()?;
        let Window { size, stride, .. } = self.window;
        match &self.op {
            Op::Conv(conv) => conv.apply(&x, stride),
            Op::Expand(one, three) => {
                let inner = x
                    .narrow(2, 1, out.len())?
                    .narrow(3, 1, columns.len())?
                    .contiguous()?;
                Tensor::cat(&[one.apply(&inner, 1)?, three.apply(&x, 1)?], 1)
            }
            Op::MaxPool => x.max_pool2d_with_stride(size, stride),
            Op::L2Pool(hann) => {
                let (_, channels, rows, width) = x.dims4()?;
                let squares = x.sqr()?.reshape((channels, 1, rows, width))?;
                let means = (squares.conv2d(hann, 0, stride, 1, 1)? + 1e-12)?;
                means
                    .sqrt()?
                    .reshape((1, channels, out.len(), columns.len()))
            }
        }
    }
}

impl TensorNetwork {
    /// Builds the network as it was trained, i.e. with max pooling.
    pub(crate) fn new(backbone: Backbone, tensors: &Tensors, device: &Device) -> Result<Self> {
        let conv = |name: &str| ConvWeights::new(tensors, name, device);
        let mut layers: Vec<TensorLayer> = Vec::new();
        let mut taps = 0;
        for step in layer_specs(backbone) {
            let (op, size, stride, padding, ceil) = match *step {
                LayerSpec::Conv {
                    index,
                    kernel,
                    stride,
                    padding,
                    ..
                } => (
                    Op::Conv(conv(&index.to_string())?),
                    kernel,
                    stride,
                    padding,
                    false,
                ),
                LayerSpec::MaxPool { kernel, ceil } => (Op::MaxPool, kernel, 2, 0, ceil),
                LayerSpec::Fire { index, .. } => {
                    layers.push(TensorLayer {
                        op: Op::Conv(conv(&format!("{index}.squeeze"))?),
                        window: Window {
                            size: 1,
                            stride: 1,
                            padding: 0,
                            ceil: false,
                        },
                        tap: None,
                    });
                    let one = conv(&format!("{index}.expand1x1"))?;
                    let three = conv(&format!("{index}.expand3x3"))?;
                    (Op::Expand(one, three), 3, 1, 1, false)
                }
                LayerSpec::Tap => {
                    if let Some(layer) = layers.last_mut() {
                        layer.tap = Some(taps);
                        taps += 1;
                    }
                    continue;
                }
            };
            layers.push(TensorLayer {
                op,
                window: Window {
                    size,
                    stride,
                    padding,
                    ceil,
                },
                tap: None,
            });
        }
        Ok(Self {
            device: device.clone(),
            layers,
            smallest_side: smallest_side(backbone),
        })
    }

    /// The same network with DISTS's L2 pooling instead of max pooling; both share the weights.
    pub(crate) fn with_l2_pooling(&self) -> Result<Self> {
        let hann = [1.0, 2.0, 1.0, 2.0, 4.0, 2.0, 1.0, 2.0, 1.0].map(|w: f32| w / 16.0);
        let hann = Tensor::from_slice(&hann, (1, 1, 3, 3), &self.device)?;
        let mut network = self.clone();
        for layer in &mut network.layers {
            if matches!(layer.op, Op::MaxPool) {
                layer.op = Op::L2Pool(hann.clone());
                layer.window = Window {
                    size: 3,
                    stride: 2,
                    padding: 1,
                    ceil: false,
                };
            }
        }
        network.smallest_side = 1;
        Ok(network)
    }

    /// Minimum side of a picture that the network accepts.
    pub(crate) fn smallest_side(&self) -> usize {
        self.smallest_side
    }

    fn sizes(&self, width: usize, height: usize) -> Vec<MapSize> {
        let picture = MapSize {
            height,
            width,
            channels: 3,
        };
        let next = |size: &mut MapSize, layer: &TensorLayer| {
            *size = MapSize {
                height: layer.window.out_side(size.height),
                width: layer.window.out_side(size.width),
                channels: layer.channels(size.channels),
            };
            Some(*size)
        };
        let outputs = self.layers.iter().scan(picture, next);
        std::iter::once(picture).chain(outputs).collect()
    }

    /// Like [`stream`](super::stream()), for pictures that are large enough.
    pub(crate) fn stream(
        &self,
        (width, height): (usize, usize),
        pictures: usize,
        strip: Option<usize>,
        input: impl Fn(usize, usize, &mut [f32]),
        mut each: impl FnMut(Taps),
    ) -> Result<Vec<MapSize>> {
        let sizes = self.sizes(width, height);
        // The strip is chosen as for two pictures, because a device's summation order may also
        // depend on the strip's height.
        let strip = strip.unwrap_or_else(|| default_strip(&sizes, 2));
        let hold_none = |_| sizes.iter().map(|_| Held::default()).collect();
        let mut held: Vec<Vec<Held>> = (0..pictures).map(hold_none).collect();
        for first in (0..height).step_by(strip) {
            let rows = first..(first + strip).min(height);
            for (picture, held) in held.iter_mut().enumerate() {
                let mut values = vec![0.0; rows.len() * sizes[0].row_len()];
                let places = rows
                    .clone()
                    .zip(values.chunks_exact_mut(sizes[0].row_len()));
                for (y, out) in places {
                    input(picture, y, out);
                }
                let pixels = Tensor::from_vec(values, (1, rows.len(), width, 3), &self.device)?;
                held[0].push(pixels.permute((0, 3, 1, 2))?.contiguous()?)?;
            }
            for (i, layer) in self.layers.iter().enumerate() {
                let (from, to) = (sizes[i], sizes[i + 1]);
                // All pictures advance in lockstep, so each has as many rows ready as the first.
                let out = layer.ready(from, to, &held[0][i], held[0][i + 1].end);
                let mut tapped = Vec::new();
                for held in &mut held {
                    if !out.is_empty()
                        && let Some(x) = &held[i].rows
                    {
                        let made = layer.rows(x, held[i].first, from, &out)?;
                        if layer.tap.is_some() {
                            tapped.push(host_rows(&made)?);
                        }
                        held[i + 1].push(made)?;
                    }
                    let needed = if out.end < to.height {
                        let next = out.end..out.end + 1;
                        layer.window.inputs(&next, from.height).0.start
                    } else {
                        held[i].end
                    };
                    held[i].drop_before(needed)?;
                }
                if let Some(tap) = layer.tap
                    && !tapped.is_empty()
                {
                    let rows: Vec<&[f32]> = tapped.iter().map(Vec::as_slice).collect();
                    each(Taps {
                        tap,
                        size: to,
                        rows: &rows,
                    });
                }
            }
            for last in held.iter_mut().filter_map(|held| held.last_mut()) {
                last.drop_before(last.end)?;
            }
        }
        let outputs = self.layers.iter().zip(&sizes[1..]);
        let tapped = outputs.filter(|(layer, _)| layer.tap.is_some());
        Ok(tapped.map(|(_, &size)| size).collect())
    }
}

impl TensorLayer {
    /// The next output rows whose input is complete; `end` is one past the last row already computed.
    fn ready(&self, from: MapSize, to: MapSize, held: &Held, end: usize) -> Range<usize> {
        let there = |y: &usize| self.window.inputs(&(*y..*y + 1), from.height).0.end <= held.end;
        let next = (end..to.height).take_while(there).last();
        end..next.map_or(end, |y| y + 1)
    }
}

/// Rows of a map that are buffered until the next layer has used them.
#[derive(Default)]
struct Held {
    first: usize,
    /// Index one past the last row that was pushed.
    end: usize,
    /// The buffered rows, `[1, channels, end − first, columns]`; `None` if there are none.
    rows: Option<Tensor>,
}

impl Held {
    fn push(&mut self, more: Tensor) -> Result<()> {
        self.end += more.dims()[2];
        self.rows = Some(match &self.rows {
            Some(rows) => Tensor::cat(&[rows, &more], 2)?,
            None => more,
        });
        Ok(())
    }

    fn drop_before(&mut self, row: usize) -> Result<()> {
        let row = row.clamp(self.first, self.end);
        self.rows = match &self.rows {
            // Made contiguous, so that the dropped rows are freed.
            Some(rows) if row < self.end => Some(
                rows.narrow(2, row - self.first, self.end - row)?
                    .contiguous()?,
            ),
            _ => None,
        };
        self.first = row;
        Ok(())
    }
}

/// Copies rows to the host, with channels innermost.
fn host_rows(rows: &Tensor) -> Result<Vec<f32>> {
    rows.get(0)?
        .permute((1, 2, 0))?
        .contiguous()?
        .flatten_all()?
        .to_vec1()
}
