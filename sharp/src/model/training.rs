//! The network in training: a pass forward that gradients can go back through.

use std::cell::RefCell;
use std::collections::BTreeMap;
use std::sync::Arc;

use super::alignment::{MIN_DEPTH, inverse_depth};
use super::config::LAYERS;
use super::engine::Runtime;
use super::map::Map;
use super::network::SharpNetwork;
use super::observer::Silent;
use super::params::{Parameter, Params, WeightSource};
use super::predictor::{DISPARITY, Planes, check_input, metric_depth};
use super::tape::{Gradients, Node, Tape};
use super::{ModelConfig, ModelError};
use crate::composer::{self, compose};
use crate::gaussians::Gaussians;
use crate::initializer::{self, BaseGaussians, InvalidDepth, NormalizedDepth};
use crate::render::GaussianGradient;
use crate::resize::bilinear_align_corners;

/// A network whose weights change from pass to pass.
pub struct TrainableNetwork {
    config: ModelConfig,
    network: SharpNetwork,
    parameters: Vec<Parameter>,
}

/// Inputs of a pass.
#[derive(Debug, Clone, Copy)]
pub struct TrainingInput<'a> {
    pub image: Planes<'a>,
    /// Focal length over width, both in pixels of the original image.
    pub disparity_factor: f32,
    /// True depth of the image, `[R, R]`, metres, to which the alignment network brings the predicted
    /// one; without it the factors are 1. Infinite for the sky; where it is 0, unknown, the network
    /// sees the predicted depth in its place.
    pub known_depth: Option<&'a [f32]>,
    /// Whether disparity that lies at or below its range lets gradients pass that would raise it. A network
    /// that begins with random weights may otherwise lose all of its depth at once, and never
    /// learns again; the release has a clamp to the same end, which it does not use.
    pub zeros_return: bool,
    /// Leaves out what refines Gaussians, for losses that see the depth alone: deltas are 0.
    pub depth_only: bool,
}

/// Outputs of a pass, with the tape for gradients. R is the internal resolution.
pub struct TrainingPass {
    /// In the composer's space: x/z and y/z over [−1, 1] across the image, z in metres.
    pub gaussians: Gaussians,
    /// What the deltas refined.
    pub base: BaseGaussians,
    /// Aligned depth layers `[2, R, R]`, metres.
    pub depth: Vec<f32>,
    /// The alignment's factors `[R, R]`.
    pub factors: Vec<f32>,
    /// Raw outputs of the prediction heads `[14, 2, rows, columns]`.
    pub deltas: Vec<f32>,
    /// Depth layers before alignment `[2, R, R]`, metres.
    predicted: Vec<f32>,
    /// The aligned depth over its nearest.
    normalized: NormalizedDepth,
    disparity: Vec<f32>,
    disparity_factor: f32,
    zeros_return: bool,
    nodes: Nodes,
    tape: Arc<Tape>,
    side: usize,
}

/// The tape's nodes at which gradients enter and leave.
struct Nodes {
    disparity: Option<Node>,
    alignment: Option<AlignmentNodes>,
    features: Node,
    deltas: [Option<Node>; 2],
}

struct AlignmentNodes {
    input: Node,
    /// Where the true depth is unknown, so that the predicted one stands in for it.
    stands_in: Vec<bool>,
    /// Of the factors' logarithm.
    log: Option<Node>,
}

/// Gradient of a loss with respect to what a [`TrainingPass`] made.
#[derive(Debug, Clone, PartialEq)]
pub struct PassGradient {
    /// Of [`TrainingPass::gaussians`], in their order.
    pub gaussians: Vec<GaussianGradient>,
    /// Of the inverse depth of [`TrainingPass::base`] as such, `[2, rows, columns]`.
    pub inverse_depth: Vec<f32>,
    /// Of [`TrainingPass::depth`] as such, `[2, R, R]`.
    pub depth: Vec<f32>,
    /// Of [`TrainingPass::factors`] as such, `[R, R]`.
    pub factors: Vec<f32>,
    /// Of [`TrainingPass::deltas`] as such.
    pub deltas: Vec<f32>,
}

impl TrainableNetwork {
    /// # Errors
    /// [`ModelError::Config`].
    pub fn new(config: &ModelConfig) -> Result<Self, ModelError> {
        config.validate()?;
        let list = RefCell::default();
        let network = SharpNetwork::new(config, &Params::new(&list));
        Ok(Self {
            config: config.clone(),
            network,
            parameters: list.into_inner(),
        })
    }

    /// Every parameter of the network, in the order of its modules.
    pub fn parameters(&self) -> &[Parameter] {
        &self.parameters
    }

    /// One pass. `weights` are asked for while it runs. Gradients are kept for the parameters that
    /// `trainable` names.
    ///
    /// # Errors
    /// As [`Predictor::predict`](super::Predictor::predict); [`ModelError::Image`] for known depth of
    /// the wrong size.
    pub fn forward(
        &self,
        weights: impl WeightSource + 'static,
        trainable: impl Fn(&str) -> bool + Send + Sync + 'static,
        input: TrainingInput<'_>,
    ) -> Result<TrainingPass, ModelError> {
        check_input(input.image, input.disparity_factor)?;
        let (side, grid) = (self.config.internal_resolution, self.config.grid());
        let tape = Tape::new(trainable, input.zeros_return);
        let rt = &Runtime::in_training(Box::new(weights), Arc::clone(&tape));
        let size = (input.image.width, input.image.height);
        let image = bilinear_align_corners(input.image.values, size, (side, side));
        let normal: Vec<f32> = image.iter().map(|v| v * 2.0 - 1.0).collect();
        let network = &self.network;
        let out = network.monodepth.forward(rt, &normal, &mut Silent)?;
        let disparity = out.disparity.to_planes()?;
        let factor = input.disparity_factor;
        let metric = |d: &f32| metric_depth(*d, factor);
        let predicted: Vec<f32> = disparity.iter().map(metric).collect();

        let (factors, alignment) = match input.known_depth {
            Some(known) => {
                let (factors, nodes) = self.align(rt, &tape, &predicted, known)?;
                (factors, Some(nodes))
            }
            None => (vec![1.0; grid.pixels()], None),
        };
        let twice = factors.iter().chain(&factors);
        let depth: Vec<f32> = predicted.iter().zip(twice).map(|(d, s)| d * s).collect();
        let normalized = NormalizedDepth::new(&depth, InvalidDepth::Refuse)?;
        let base = BaseGaussians::from_normalized(&image, &normalized, grid)?;

        let features = tape.leaf();
        let (deltas, delta_nodes) = match input.depth_only {
            true => {
                let channels: usize = DELTA_CHANNELS.iter().sum();
                (vec![0.0; channels * grid.blocks()], [None, None])
            }
            false => {
                let planes = normalized.feature_input(&image);
                let seen = Map::from_planes(&rt.engine, &planes, (3 + LAYERS, side, side))?;
                let seen = seen.at_node(features.clone());
                let [texture, geometry] =
                    network
                        .feature_model
                        .forward(rt, out.features, &seen, &mut Silent)?;
                let heads = network.prediction_head.forward(rt, &texture, &geometry)?;
                let deltas = [heads[0].to_planes()?, heads[1].to_planes()?].concat();
                (deltas, heads.map(|head| head.node().cloned()))
            }
        };
        let gaussians = compose(&base, Some(&deltas))?;
        Ok(TrainingPass {
            gaussians,
            base,
            normalized,
            depth,
            factors,
            deltas,
            predicted,
            disparity,
            disparity_factor: factor,
            zeros_return: input.zeros_return,
            nodes: Nodes {
                disparity: out.disparity.node().cloned(),
                alignment,
                features,
                deltas: delta_nodes,
            },
            tape,
            side,
        })
    }

    /// The alignment's factors.
    fn align(
        &self,
        rt: &Runtime,
        tape: &Arc<Tape>,
        predicted: &[f32],
        known: &[f32],
    ) -> Result<(Vec<f32>, AlignmentNodes), ModelError> {
        let side = self.config.internal_resolution;
        if known.len() != side * side {
            return Err(ModelError::Image(format!(
                "known depth of {} values instead of {}",
                known.len(),
                side * side
            )));
        }
        let first = &predicted[..side * side];
        let is_unknown = |known: &f32| known.is_nan() || *known <= 0.0;
        let stands_in: Vec<bool> = known.iter().map(is_unknown).collect();
        let seen = stands_in.iter().zip(known.iter().zip(first));
        let seen = seen.map(|(stands_in, (known, first))| if *stands_in { first } else { known });
        let depths = first.iter().chain(seen);
        let input: Vec<f32> = depths.map(|d| inverse_depth(*d)).collect();
        let leaf = tape.leaf();
        let input = Map::from_planes(&rt.engine, &input, (2, side, side))?.at_node(leaf.clone());
        let log = self.network.depth_alignment.forward(rt, &input)?;
        let factors = log.to_planes()?.into_iter().map(f32::exp).collect();
        let log = log.node().cloned();
        let nodes = AlignmentNodes {
            input: leaf,
            stands_in,
            log,
        };
        Ok((factors, nodes))
    }
}

impl TrainingPass {
    /// Zeros of the sizes of what the pass made.
    pub fn zero_gradient(&self) -> PassGradient {
        PassGradient {
            gaussians: vec![GaussianGradient::default(); self.gaussians.len()],
            inverse_depth: vec![0.0; self.base.inverse_depth.len()],
            depth: vec![0.0; self.depth.len()],
            factors: vec![0.0; self.factors.len()],
            deltas: vec![0.0; self.deltas.len()],
        }
    }

    /// Gradients of the trainable parameters, by name, as PyTorch lays them out; of those that nothing depends on there is none.
    ///
    /// # Errors
    /// [`ModelError::Image`] when a part of `upstream` is not of its size, [`ModelError::Tensor`].
    pub fn backward(
        self,
        upstream: &PassGradient,
    ) -> Result<BTreeMap<String, Vec<f32>>, ModelError> {
        let lengths = [
            (
                "inverse depth",
                upstream.inverse_depth.len(),
                self.base.inverse_depth.len(),
            ),
            ("depth", upstream.depth.len(), self.depth.len()),
            ("factors", upstream.factors.len(), self.factors.len()),
            ("deltas", upstream.deltas.len(), self.deltas.len()),
        ];
        for (what, found, expected) in lengths {
            if found != expected {
                return Err(ModelError::Image(format!(
                    "a gradient of {found} values for {expected} of {what}"
                )));
            }
        }
        let pixels = self.side * self.side;
        let gradients = &mut Gradients::default();

        let mut composed = composer::backward(&self.base, &self.deltas, &upstream.gaussians)?;
        for (sum, g) in composed.deltas.iter_mut().zip(&upstream.deltas) {
            *sum += g;
        }
        let pooled = &mut composed.base.inverse_depth;
        for (sum, g) in pooled.iter_mut().zip(&upstream.inverse_depth) {
            *sum += g;
        }
        let grid = self.base.grid;
        let (rows, columns) = (grid.rows(), grid.columns());
        let mut rest = composed.deltas.as_slice();
        for (node, channels) in self.nodes.deltas.iter().zip(DELTA_CHANNELS) {
            let (planes, others) = rest.split_at(channels * rows * columns);
            rest = others;
            gradients.add(node.as_ref(), interleaved(planes, channels));
        }
        self.tape
            .backward(self.nodes.features.index + 1, gradients)?;

        let of_features = gradients.take(&self.nodes.features);
        let of_features = match of_features {
            Some(pixels) => planes_from(&pixels, 3 + LAYERS, 3),
            None => vec![0.0; LAYERS * pixels],
        };
        let mut depth = initializer::backward(
            &self.depth,
            &self.normalized,
            grid,
            &composed.base,
            &of_features,
        )?;
        for (sum, g) in depth.iter_mut().zip(&upstream.depth) {
            *sum += g;
        }
        let mut predicted: Vec<f32> = depth
            .iter()
            .zip(self.factors.iter().chain(&self.factors))
            .map(|(g, s)| g * s)
            .collect();
        if let Some(nodes) = &self.nodes.alignment {
            let AlignmentNodes {
                input,
                stands_in,
                log,
            } = nodes;
            let of_log: Vec<f32> = (0..pixels)
                .map(|k| {
                    let layers = [k, k + pixels].map(|at| depth[at] * self.predicted[at]);
                    (layers[0] + layers[1] + upstream.factors[k]) * self.factors[k]
                })
                .collect();
            gradients.add(log.as_ref(), of_log);
            self.tape.backward(input.index + 1, gradients)?;
            if let Some(of_input) = gradients.take(input) {
                for (k, of_input) in of_input.chunks_exact(2).enumerate() {
                    let depth = self.predicted[k];
                    if depth > MIN_DEPTH {
                        let of_known = if stands_in[k] { of_input[1] } else { 0.0 };
                        predicted[k] -= (of_input[0] + of_known) / (depth * depth);
                    }
                }
            }
        }
        let inside = DISPARITY.0..=DISPARITY.1;
        for (g, disparity) in predicted.iter_mut().zip(&self.disparity) {
            let clamped = disparity.clamp(DISPARITY.0, DISPARITY.1);
            let slope = -*g * self.disparity_factor / (clamped * clamped);
            let returns = self.zeros_return && *disparity < DISPARITY.0 && slope < 0.0;
            *g = if inside.contains(disparity) || returns {
                slope
            } else {
                0.0
            };
        }
        gradients.add(
            self.nodes.disparity.as_ref(),
            interleaved(&predicted, LAYERS),
        );
        self.tape.backward(0, gradients)?;
        Ok(std::mem::take(&mut gradients.parameters))
    }
}

/// Channels of the two heads' outputs.
const DELTA_CHANNELS: [usize; 2] = [3 * LAYERS, 11 * LAYERS];

/// Planes `[channels, pixels]` as `[pixels, channels]`.
fn interleaved(planes: &[f32], channels: usize) -> Vec<f32> {
    let pixels = planes.len() / channels;
    let value = |at: usize| planes[at % channels * pixels + at / channels];
    (0..planes.len()).map(value).collect()
}

/// The planes from channel `first` on of `[pixels, channels]`.
fn planes_from(pixels: &[f32], channels: usize, first: usize) -> Vec<f32> {
    (first..channels)
        .flat_map(|c| pixels[c..].iter().step_by(channels).copied())
        .collect()
}

#[cfg(test)]
mod tests;
