//! A feature map on the engine that computes it.

use std::sync::Arc;

use candle_core::Tensor;
use rayon::prelude::*;

use super::ModelError;
use super::engine::Engine;
use super::tape::{Gradients, Node};

/// A feature map of one image.
pub(super) enum Map {
    Host(HostMap),
    /// `[1, channels, height, width]`.
    Tensor(Tensor),
}

/// `[row][column][channel]`.
pub(super) struct HostMap {
    pub(super) height: usize,
    pub(super) width: usize,
    pub(super) channels: usize,
    pub(super) data: Arc<Vec<f32>>,
    /// Where gradients of this map go, in training.
    pub(super) node: Option<Node>,
}

impl HostMap {
    pub(super) fn new((height, width, channels): (usize, usize, usize), data: Vec<f32>) -> Self {
        Self {
            height,
            width,
            channels,
            data: Arc::new(data),
            node: None,
        }
    }

    /// The same map on a tape.
    pub(super) fn at_node(self, node: Option<Node>) -> Self {
        Self { node, ..self }
    }

    pub(super) fn into_values(self) -> Vec<f32> {
        Arc::unwrap_or_clone(self.data)
    }

    /// Channel `c` of pixel (x, y).
    fn at(&self, y: usize, x: usize) -> &[f32] {
        &self.data[(y * self.width + x) * self.channels..][..self.channels]
    }

    /// A map whose pixel (y, x) is made by `f(y, x, pixel)`.
    pub(super) fn by_pixel(
        (height, width, channels): (usize, usize, usize),
        f: impl Fn(usize, usize, &mut [f32]) + Sync,
    ) -> Self {
        let mut data = vec![0.0; height * width * channels];
        data.par_chunks_mut(width * channels)
            .enumerate()
            .for_each(|(y, row)| {
                for (x, pixel) in row.chunks_mut(channels).enumerate() {
                    f(y, x, pixel);
                }
            });
        Self::new((height, width, channels), data)
    }
}

impl Map {
    /// From planes `[channels, height, width]`.
    pub(super) fn from_planes(
        engine: &Engine,
        planes: &[f32],
        (channels, height, width): (usize, usize, usize),
    ) -> Result<Self, ModelError> {
        Ok(match engine {
            Engine::Kernels(_) => {
                let plane = height * width;
                let pixel = |y: usize, x: usize, out: &mut [f32]| {
                    for (c, out) in out.iter_mut().enumerate() {
                        *out = planes[c * plane + y * width + x];
                    }
                };
                Self::Host(HostMap::by_pixel((height, width, channels), pixel))
            }
            Engine::Tensors(device) => {
                let shape = (1, channels, height, width);
                Self::Tensor(Tensor::from_slice(planes, shape, device)?)
            }
        })
    }

    /// Where gradients of this map go, in training.
    pub(super) fn node(&self) -> Option<&Node> {
        match self {
            Self::Host(map) => map.node.as_ref(),
            Self::Tensor(_) => None,
        }
    }

    /// The same map on a tape.
    pub(super) fn at_node(self, node: Node) -> Self {
        match self {
            Self::Host(map) => Self::Host(map.at_node(Some(node))),
            Self::Tensor(tensor) => Self::Tensor(tensor),
        }
    }

    /// Planes `[channels, height, width]`.
    pub(super) fn to_planes(&self) -> Result<Vec<f32>, ModelError> {
        Ok(match self {
            Self::Host(map) => {
                let (plane, channels) = (map.height * map.width, map.channels);
                let mut out = vec![0.0; map.data.len()];
                out.par_chunks_mut(plane).enumerate().for_each(|(c, out)| {
                    for (out, pixel) in out.iter_mut().zip(map.data.chunks(channels)) {
                        *out = pixel[c];
                    }
                });
                out
            }
            Self::Tensor(tensor) => tensor.flatten_all()?.to_vec1()?,
        })
    }

    pub(super) fn dims(&self) -> Result<(usize, usize, usize), ModelError> {
        Ok(match self {
            Self::Host(map) => (map.channels, map.height, map.width),
            Self::Tensor(tensor) => {
                let (_, c, h, w) = tensor.dims4()?;
                (c, h, w)
            }
        })
    }

    /// Adds `other` to this map.
    pub(super) fn add(mut self, other: &Self) -> Result<Self, ModelError> {
        match (&mut self, other) {
            (Self::Host(a), Self::Host(b)) if a.data.len() == b.data.len() => {
                let values = Arc::make_mut(&mut a.data).par_chunks_mut(CHUNK);
                values.zip(b.data.par_chunks(CHUNK)).for_each(|(a, b)| {
                    for (a, b) in a.iter_mut().zip(b) {
                        *a += b;
                    }
                });
                a.node = recorded([a.node.as_ref(), b.node.as_ref()], |[a, b]| {
                    move |g: Vec<f32>, gradients: &mut Gradients| {
                        if b.is_some() {
                            gradients.add(b.as_ref(), g.clone());
                        }
                        gradients.add(a.as_ref(), g);
                        Ok(())
                    }
                });
            }
            (Self::Tensor(a), Self::Tensor(b)) => *a = (&*a + b)?,
            _ => return Err(mixed()),
        }
        Ok(self)
    }

    pub(super) fn relu(self) -> Result<Self, ModelError> {
        self.rectified(|_| false)
    }

    /// The same; in training, where the tape says so, what is zero lets gradients pass that would
    /// raise it.
    pub(super) fn relu_with_return(self) -> Result<Self, ModelError> {
        let returns = self.node().is_some_and(Node::zeros_return);
        self.rectified(move |g| returns && g < 0.0)
    }

    /// `passes` tells of the gradient of a zero whether it goes back.
    fn rectified(
        mut self,
        passes: impl Fn(f32) -> bool + Send + Sync + 'static,
    ) -> Result<Self, ModelError> {
        match &mut self {
            Self::Host(map) => {
                let values = Arc::make_mut(&mut map.data);
                values.par_chunks_mut(CHUNK).for_each(|chunk| {
                    for v in chunk {
                        // Unlike `max`, this keeps NaN.
                        *v = if *v < 0.0 { 0.0 } else { *v };
                    }
                });
                let out = Arc::clone(&map.data);
                map.node = recorded([map.node.as_ref()], |[x]| {
                    move |mut g: Vec<f32>, gradients: &mut Gradients| {
                        for (g, value) in g.iter_mut().zip(out.iter()) {
                            *g = if *value > 0.0 || passes(*g) { *g } else { 0.0 };
                        }
                        gradients.add(x.as_ref(), g);
                        Ok(())
                    }
                });
            }
            Self::Tensor(tensor) => *tensor = tensor.relu()?,
        }
        Ok(self)
    }

    /// Means of `size × size` blocks.
    pub(super) fn avg_pool(&self, size: usize) -> Result<Self, ModelError> {
        Ok(match self {
            Self::Host(map) => {
                let area = (size * size) as f32;
                let shape = (map.height / size, map.width / size, map.channels);
                let whole = (map.height, map.width, map.channels);
                let node = recorded([map.node.as_ref()], |[x]| {
                    move |g: Vec<f32>, gradients: &mut Gradients| {
                        let blocks = HostMap::new(shape, g);
                        let spread = HostMap::by_pixel(whole, |y, x, out| {
                            // Rows and columns beyond the last whole block were not averaged.
                            if y / size < shape.0 && x / size < shape.1 {
                                let block = blocks.at(y / size, x / size);
                                for (out, v) in out.iter_mut().zip(block) {
                                    *out = v / area;
                                }
                            }
                        });
                        gradients.add(x.as_ref(), spread.into_values());
                        Ok(())
                    }
                });
                let pooled = HostMap::by_pixel(shape, |y, x, out| {
                    for (dy, dx) in (0..size).flat_map(|dy| (0..size).map(move |dx| (dy, dx))) {
                        let pixel = map.at(y * size + dy, x * size + dx);
                        for (out, v) in out.iter_mut().zip(pixel) {
                            *out += v;
                        }
                    }
                    for out in out {
                        *out /= area;
                    }
                });
                Self::Host(pooled.at_node(node))
            }
            Self::Tensor(tensor) => Self::Tensor(tensor.avg_pool2d(size)?),
        })
    }

    /// Every pixel four times.
    pub(super) fn double_nearest(&self) -> Result<Self, ModelError> {
        Ok(match self {
            Self::Host(map) => {
                let small = (map.height, map.width, map.channels);
                let shape = (2 * map.height, 2 * map.width, map.channels);
                let node = recorded([map.node.as_ref()], |[x]| {
                    move |g: Vec<f32>, gradients: &mut Gradients| {
                        let doubled = HostMap::new(shape, g);
                        let sums = HostMap::by_pixel(small, |y, x, out| {
                            for (dy, dx) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
                                let pixel = doubled.at(2 * y + dy, 2 * x + dx);
                                for (out, v) in out.iter_mut().zip(pixel) {
                                    *out += v;
                                }
                            }
                        });
                        gradients.add(x.as_ref(), sums.into_values());
                        Ok(())
                    }
                });
                let doubled = HostMap::by_pixel(shape, |y, x, out| {
                    out.copy_from_slice(map.at(y / 2, x / 2));
                });
                Self::Host(doubled.at_node(node))
            }
            Self::Tensor(tensor) => {
                let (_, _, h, w) = tensor.dims4()?;
                Self::Tensor(tensor.upsample_nearest2d(2 * h, 2 * w)?)
            }
        })
    }

    /// Two maps' channels side by side.
    pub(super) fn cat(&self, other: &Self) -> Result<Self, ModelError> {
        Ok(match (self, other) {
            (Self::Host(a), Self::Host(b)) if (a.height, a.width) == (b.height, b.width) => {
                let shape = (a.height, a.width, a.channels + b.channels);
                let channels = [a.channels, b.channels];
                let node = recorded([a.node.as_ref(), b.node.as_ref()], |nodes| {
                    move |g: Vec<f32>, gradients: &mut Gradients| {
                        let both = HostMap::new(shape, g);
                        for (k, node) in nodes.iter().enumerate() {
                            let part = (shape.0, shape.1, channels[k]);
                            let first = k * channels[0];
                            let part = HostMap::by_pixel(part, |y, x, out| {
                                out.copy_from_slice(&both.at(y, x)[first..][..channels[k]]);
                            });
                            gradients.add(node.as_ref(), part.into_values());
                        }
                        Ok(())
                    }
                });
                let both = HostMap::by_pixel(shape, |y, x, out| {
                    let (left, right) = out.split_at_mut(a.channels);
                    left.copy_from_slice(a.at(y, x));
                    right.copy_from_slice(b.at(y, x));
                });
                Self::Host(both.at_node(node))
            }
            (Self::Tensor(a), Self::Tensor(b)) => Self::Tensor(Tensor::cat(&[a, b], 1)?),
            _ => return Err(mixed()),
        })
    }

    /// A grid of `side × side` maps as one: of each, in both directions, the part `span(index)`
    /// (start, length).
    pub(super) fn mosaic(
        cells: &[Self],
        side: usize,
        span: impl Fn(usize) -> (usize, usize),
    ) -> Result<Self, ModelError> {
        let spans: Vec<(usize, usize)> = (0..side).map(span).collect();
        if let Some(Self::Tensor(_)) = cells.first() {
            let rows = spans.iter().enumerate().map(|(row, (top, height))| {
                let parts = spans.iter().enumerate().map(|(column, (left, width))| {
                    match cells.get(row * side + column) {
                        Some(Self::Tensor(cell)) => {
                            Ok(cell.narrow(2, *top, *height)?.narrow(3, *left, *width)?)
                        }
                        _ => Err(mixed()),
                    }
                });
                let parts = parts.collect::<Result<Vec<_>, _>>()?;
                Ok(Tensor::cat(&parts, 3)?)
            });
            let rows = rows.collect::<Result<Vec<_>, ModelError>>()?;
            return Ok(Self::Tensor(Tensor::cat(&rows, 2)?));
        }
        // Which cell, and which of its rows or columns, lies at each place of the whole.
        let places: Vec<(usize, usize)> = spans
            .iter()
            .enumerate()
            .flat_map(|(cell, (start, length))| (*start..start + length).map(move |k| (cell, k)))
            .collect();
        let hosts = cells.iter().map(|cell| match cell {
            Self::Host(map) => Ok(map),
            Self::Tensor(_) => Err(mixed()),
        });
        let hosts = hosts.collect::<Result<Vec<_>, _>>()?;
        let channels = hosts.first().map_or(0, |map| map.channels);
        let shape = (places.len(), places.len(), channels);
        let whole = HostMap::by_pixel(shape, |y, x, out| {
            let ((row, y), (column, x)) = (places[y], places[x]);
            out.copy_from_slice(hosts[row * side + column].at(y, x));
        });
        let nodes: Vec<Option<Node>> = hosts.iter().map(|map| map.node.clone()).collect();
        let sizes: Vec<(usize, usize)> = hosts.iter().map(|map| (map.height, map.width)).collect();
        let node = nodes.iter().flatten().next().cloned();
        let node = node.map(|any| {
            any.record(move |g, gradients| {
                let mut parts: Vec<Vec<f32>> = sizes
                    .iter()
                    .map(|(height, width)| vec![0.0; height * width * channels])
                    .collect();
                for (pixel, g) in g.chunks_exact(channels).enumerate() {
                    let (row, y) = places[pixel / places.len()];
                    let (column, x) = places[pixel % places.len()];
                    let cell = row * side + column;
                    let at = (y * sizes[cell].1 + x) * channels;
                    parts[cell][at..at + channels].copy_from_slice(g);
                }
                for (node, part) in nodes.iter().zip(parts) {
                    gradients.add(node.as_ref(), part);
                }
                Ok(())
            })
        });
        Ok(Self::Host(whole.at_node(node)))
    }
}

/// A node for what was made from maps of which some are on a tape; `backward` is handed their nodes.
fn recorded<const N: usize, B>(
    inputs: [Option<&Node>; N],
    backward: impl FnOnce([Option<Node>; N]) -> B,
) -> Option<Node>
where
    B: FnOnce(Vec<f32>, &mut Gradients) -> Result<(), ModelError> + Send + 'static,
{
    let any = inputs.iter().copied().flatten().next()?;
    Some(any.record(backward(inputs.map(Option::<&Node>::cloned))))
}

/// Values that one task works on.
const CHUNK: usize = 1 << 16;

/// Maps of two engines or sizes met: a mistake in the network's wiring.
pub(super) fn mixed() -> ModelError {
    ModelError::Device("feature maps of different engines or sizes".into())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::Algorithm;
    use candle_core::Device;

    fn engines() -> [Engine; 2] {
        [Engine::cpu(Algorithm::Direct), Engine::Tensors(Device::Cpu)]
    }

    fn planes() -> Vec<f32> {
        (0..3 * 4 * 6).map(|k| (k * 13 % 29) as f32 - 9.0).collect()
    }

    #[test]
    fn both_engines_agree_on_every_operation() {
        let results = engines().map(|engine| {
            let map = || Map::from_planes(&engine, &planes(), (3, 4, 6)).unwrap();
            let doubled = map().double_nearest().unwrap();
            let cells = [
                map(),
                map().relu().unwrap(),
                map(),
                map().add(&map()).unwrap(),
            ];
            let square: Vec<Map> = cells
                .iter()
                .map(|m| Map::mosaic(std::slice::from_ref(m), 1, |_| (0, 4)).unwrap())
                .collect();
            let mosaic = Map::mosaic(&square, 2, |k| if k == 0 { (0, 3) } else { (1, 3) });
            [
                map(),
                map().relu().unwrap(),
                map().avg_pool(2).unwrap(),
                map().add(&map()).unwrap(),
                map().cat(&map().relu().unwrap()).unwrap(),
                doubled,
                mosaic.unwrap(),
            ]
            .map(|m| (m.dims().unwrap(), m.to_planes().unwrap()))
        });
        assert_eq!(results[0], results[1]);
        assert_eq!(results[0][0].1, planes());
        assert_eq!(results[0][6].0, (3, 6, 6));
    }
}
