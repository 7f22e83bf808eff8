//! A network with its weights.

use std::ops::Range;
use std::sync::Arc;

use sharp_kernels::{Algorithm, Conv2d, ConvSpec, L2Pool, MaxPool, RowOp, RowWindow, Simd};

use super::architecture::{LayerSpec, layer_specs, smallest_side};
use super::rows::MapSize;
use crate::weights::{Backbone, Tensors};

/// Instruction set and algorithm of the kernels that run a network.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Kernels {
    pub(crate) simd: Simd,
    pub(crate) algorithm: Algorithm,
}

/// A layer, optionally followed by a tap.
#[derive(Clone)]
pub(crate) struct Layer {
    pub(crate) op: Arc<dyn RowOp>,
    /// Index of the tap on the layer's output, if there is one.
    pub(crate) tap: Option<usize>,
    /// True for max pooling, which DISTS replaces by L2 pooling.
    pub(super) pools: bool,
}

/// All layers, starting at the picture.
#[derive(Clone)]
pub(crate) struct Network {
    pub(crate) layers: Vec<Layer>,
    smallest_side: usize,
}

impl std::fmt::Debug for Network {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "Network of {} layers", self.layers.len())
    }
}

impl Network {
    /// Builds the network as it was trained, i.e. with max pooling.
    pub(crate) fn new(backbone: Backbone, tensors: &Tensors, kernels: Kernels) -> Self {
        let conv = |name: String, stride: usize, padding: usize| {
            let (shape, weights) = tensors.get(&format!("{name}.weight"));
            let (_, bias) = tensors.get(&format!("{name}.bias"));
            let spec = ConvSpec {
                in_channels: shape[1],
                out_channels: shape[0],
                kernel: shape[2],
                stride,
                padding,
            };
            Conv2d::new(
                kernels.simd,
                spec,
                weights,
                Some(bias),
                true,
                kernels.algorithm,
            )
        };
        let mut layers: Vec<Layer> = Vec::new();
        let mut push = |op: Arc<dyn RowOp>, pools| {
            layers.push(Layer {
                op,
                tap: None,
                pools,
            });
        };
        for step in layer_specs(backbone) {
            match *step {
                LayerSpec::Conv {
                    index,
                    stride,
                    padding,
                    ..
                } => push(Arc::new(conv(index.to_string(), stride, padding)), false),
                LayerSpec::MaxPool { kernel, ceil } => {
                    push(Arc::new(MaxPool::new(kernels.simd, kernel, 2, ceil)), true);
                }
                LayerSpec::Fire { index, .. } => {
                    push(Arc::new(conv(format!("{index}.squeeze"), 1, 0)), false);
                    let parts = [
                        conv(format!("{index}.expand1x1"), 1, 0),
                        conv(format!("{index}.expand3x3"), 1, 1),
                    ];
                    push(Arc::new(Expand { parts }), false);
                }
                LayerSpec::Tap => {}
            }
        }
        // A fire module counts as two layers, every other step except a tap as one.
        let mut layer = 0;
        let mut tap = 0;
        for step in layer_specs(backbone) {
            match step {
                LayerSpec::Fire { .. } => layer += 2,
                LayerSpec::Conv { .. } | LayerSpec::MaxPool { .. } => layer += 1,
                LayerSpec::Tap => {
                    layers[layer - 1].tap = Some(tap);
                    tap += 1;
                }
            }
        }
        Self {
            layers,
            smallest_side: smallest_side(backbone),
        }
    }

    /// The same network with DISTS's L2 pooling instead of max pooling; both share the weights.
    pub(crate) fn with_l2_pooling(&self, kernels: Kernels) -> Self {
        let mut network = self.clone();
        for layer in network.layers.iter_mut().filter(|layer| layer.pools) {
            layer.op = Arc::new(L2Pool::new(kernels.simd));
        }
        network.smallest_side = 1;
        network
    }

    /// Minimum side of a picture that the network accepts.
    pub(crate) fn smallest_side(&self) -> usize {
        self.smallest_side
    }

    /// Sizes of the picture and of every layer's output; `None` if the picture is too small.
    pub(crate) fn sizes(&self, width: usize, height: usize) -> Option<Vec<MapSize>> {
        if width.min(height) < self.smallest_side {
            return None;
        }
        let mut size = MapSize {
            height,
            width,
            channels: 3,
        };
        let mut sizes = vec![size];
        for Layer { op, .. } in &self.layers {
            let (height, width) = op.out_size(size.height, size.width);
            size = MapSize {
                height,
                width,
                channels: op.out_channels(size.channels),
            };
            sizes.push(size);
        }
        Some(sizes)
    }
}

/// SqueezeNet's two convolutions side by side: outputs of the same size, channels joined.
#[derive(Debug)]
struct Expand {
    parts: [Conv2d; 2],
}

impl RowOp for Expand {
    fn out_size(&self, height: usize, width: usize) -> (usize, usize) {
        self.parts[0].out_size(height, width)
    }

    fn out_channels(&self, in_channels: usize) -> usize {
        self.parts
            .iter()
            .map(|part| part.out_channels(in_channels))
            .sum()
    }

    fn in_rows(&self, out: Range<usize>, in_height: usize) -> Range<usize> {
        let [a, b] = self
            .parts
            .each_ref()
            .map(|part| part.in_rows(out.clone(), in_height));
        a.start.min(b.start)..a.end.max(b.end)
    }

    fn run_rows(&self, input: &RowWindow<'_>, out: Range<usize>, output: &mut [f32]) {
        let channels = self.out_channels(input.channels());
        let mut first = 0;
        for part in &self.parts {
            let own = part.out_channels(input.channels());
            let mut values = vec![0.0; output.len() / channels * own];
            part.run_rows(input, out.clone(), &mut values);
            let pixels = output
                .chunks_exact_mut(channels)
                .zip(values.chunks_exact(own));
            for (pixel, values) in pixels {
                pixel[first..first + own].copy_from_slice(values);
            }
            first += own;
        }
    }
}
