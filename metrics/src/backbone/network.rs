//! A network with its weights.

use std::ops::Range;
use std::sync::Arc;

use super::architecture::{Step, smallest_side, steps};
use super::convolution::Convolution;
use super::pool::{l2_pool, max_pool};
use super::rows::{Rows, Size};
use crate::weights::{Backbone, Tensors};

/// A layer that turns rows into rows.
#[derive(Debug, Clone)]
pub(crate) enum Layer {
    Conv(Arc<Convolution>),
    MaxPool {
        kernel: usize,
        ceil: bool,
    },
    L2Pool,
    /// A 1×1 and a 3×3 convolution whose channels are joined.
    Expand([Arc<Convolution>; 2]),
}

/// Layers from the picture on; after some of them the metrics look.
#[derive(Debug)]
pub(crate) struct Network {
    pub(crate) layers: Vec<(Layer, Option<usize>)>,
    smallest_side: usize,
}

impl Network {
    /// Builds the network as it was trained.
    pub(crate) fn new(backbone: Backbone, tensors: &Tensors) -> Self {
        let conv = |name: String, stride: usize, padding: usize| {
            let (shape, weights) = tensors.get(&format!("{name}.weight"));
            let (_, bias) = tensors.get(&format!("{name}.bias"));
            let shape = [shape[0], shape[1], shape[2]];
            Arc::new(Convolution::new(shape, stride, padding, weights, bias))
        };
        let mut layers: Vec<(Layer, Option<usize>)> = Vec::new();
        let mut taps = 0;
        for step in steps(backbone) {
            match *step {
                Step::Conv {
                    index,
                    stride,
                    padding,
                    ..
                } => layers.push((Layer::Conv(conv(index.to_string(), stride, padding)), None)),
                Step::MaxPool { kernel, ceil } => {
                    layers.push((Layer::MaxPool { kernel, ceil }, None));
                }
                Step::Fire { index, .. } => {
                    let squeeze = conv(format!("{index}.squeeze"), 1, 0);
                    layers.push((Layer::Conv(squeeze), None));
                    let expand = [
                        conv(format!("{index}.expand1x1"), 1, 0),
                        conv(format!("{index}.expand3x3"), 1, 1),
                    ];
                    layers.push((Layer::Expand(expand), None));
                }
                Step::Tap => {
                    if let Some((_, tap)) = layers.last_mut() {
                        *tap = Some(taps);
                        taps += 1;
                    }
                }
            }
        }
        Self {
            layers,
            smallest_side: smallest_side(backbone),
        }
    }

    /// The same network with DISTS's L2 pooling in place of max pooling; weights are shared.
    pub(crate) fn with_l2_pooling(&self) -> Self {
        let layers = self.layers.iter().map(|(layer, tap)| match layer {
            Layer::MaxPool { .. } => (Layer::L2Pool, *tap),
            other => (other.clone(), *tap),
        });
        Self {
            layers: layers.collect(),
            smallest_side: 1,
        }
    }

    /// The smallest side of a picture that the network takes.
    pub(crate) fn smallest_side(&self) -> usize {
        self.smallest_side
    }

    /// Sizes of the picture and of every layer's output; `None` if the picture is too small.
    pub(crate) fn sizes(&self, width: usize, height: usize) -> Option<Vec<Size>> {
        if width.min(height) < self.smallest_side {
            return None;
        }
        let mut sizes = vec![Size {
            height,
            width,
            channels: 3,
        }];
        for (layer, _) in &self.layers {
            let input = *sizes.last()?;
            sizes.push(layer.output(input)?);
        }
        Some(sizes)
    }
}

impl Layer {
    fn output(&self, input: Size) -> Option<Size> {
        let pooled = |side: &dyn Fn(usize) -> Option<usize>| {
            Some(Size {
                height: side(input.height)?,
                width: side(input.width)?,
                channels: input.channels,
            })
        };
        match self {
            Self::Conv(conv) => conv.output(input),
            Self::Expand([pointwise, spatial]) => {
                let mut size = spatial.output(input)?;
                size.channels += pointwise.output(input)?.channels;
                Some(size)
            }
            &Self::MaxPool { kernel, ceil } => pooled(&|n| {
                let room = n.checked_sub(kernel)?;
                Some(if ceil { room.div_ceil(2) } else { room / 2 } + 1)
            }),
            Self::L2Pool => pooled(&|n| Some(n.div_ceil(2))),
        }
    }

    /// The input rows that output row `y` reads, as far as they exist.
    pub(crate) fn needs(&self, y: usize, height: usize) -> Range<usize> {
        match self {
            Self::Conv(conv) | Self::Expand([_, conv]) => conv.needs(y, height),
            Self::MaxPool { kernel, .. } => 2 * y..(2 * y + kernel).min(height),
            Self::L2Pool => (2 * y).saturating_sub(1)..(2 * y + 2).min(height),
        }
    }

    /// Output rows `rows` from the input rows they need.
    pub(crate) fn run(&self, input: Rows, rows: Range<usize>, output: Size, out: &mut [f32]) {
        let (width, channels) = (output.width, output.channels);
        match self {
            Self::Conv(conv) => conv.run(input, rows, width, channels, out),
            Self::Expand([pointwise, spatial]) => {
                pointwise.run(input, rows.clone(), width, channels, out);
                spatial.run(input, rows, width, channels, &mut out[channels / 2..]);
            }
            Self::MaxPool { kernel, .. } => max_pool(*kernel, input, rows, output, out),
            Self::L2Pool => l2_pool(input, rows, output, out),
        }
    }
}
