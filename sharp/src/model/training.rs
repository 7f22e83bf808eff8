//! The network in training: forward passes with gradients.

use std::cell::RefCell;
use std::collections::BTreeMap;

use candle_core::backprop::GradStore;
use candle_core::{Tensor, Var};
use candle_nn::Module;

use super::alignment::DepthAlignment;
use super::config::LAYERS;
use super::inventory::inventory;
use super::monodepth::MonodepthOutput;
use super::network::SharpNetwork;
use super::observer::Silent;
use super::ops::{Recompute, from_planes, pull, to_planes};
use super::params::{Parameter, Params, WeightSource, Weights};
use super::predictor::{MAX_DISPARITY, MIN_DISPARITY, Planes, check_input, metric_depth};
use super::{Compute, ModelConfig, ModelError};
use crate::composer::{self, compose};
use crate::gaussians::Gaussians;
use crate::initializer::{self, BaseGaussians, InvalidDepth, NormalizedDepth};
use crate::render::GaussianGradient;
use crate::resize::bilinear_align_corners;

/// A network whose weights change between passes.
pub struct TrainableNetwork {
    config: ModelConfig,
    parameters: Vec<Parameter>,
    compute: Compute,
    recomputes: bool,
}

/// Inputs of a forward pass.
#[derive(Debug, Clone, Copy)]
pub struct TrainingInput<'a> {
    pub image: Planes<'a>,
    /// Focal length divided by width, both in pixels of the original image.
    pub disparity_factor: f32,
    /// True depth of the image, `[R, R]` in metres, to which the alignment network scales the
    /// predicted depth; without it the factors are 1. Infinite in the sky. At pixels where the
    /// depth is 0 (unknown), the network receives the first predicted layer instead.
    pub known_depth: Option<&'a [f32]>,
    /// If true, a gradient that would raise a disparity passes even where the disparity is below
    /// its lower bound. If false, a randomly initialised network may drop below the bound
    /// everywhere and never recover. At the bound itself, gradients always pass. The SHARP release
    /// defines such a clamp but does not use it.
    pub zeros_return: bool,
    /// Skips the refinement of Gaussians, for losses that depend on depth alone: deltas are 0.
    pub depth_only: bool,
}

/// Outputs of a pass, with the graph for the backward pass. R is the internal resolution.
pub struct TrainingPass {
    /// Gaussians in the composer's space: x/z and y/z over [−1, 1] across the image, z in metres.
    pub gaussians: Gaussians,
    /// Base Gaussians that the deltas refined.
    pub base: BaseGaussians,
    /// Aligned depth layers `[2, R, R]` in metres.
    pub depth: Vec<f32>,
    /// Factors of the alignment, `[R, R]`.
    pub factors: Vec<f32>,
    /// Raw outputs of the prediction heads `[14, 2, rows, columns]`.
    pub deltas: Vec<f32>,
    /// Aligned depth divided by its minimum.
    normalized: NormalizedDepth,
    disparity_factor: f32,
    zeros_return: bool,
    monodepth: MonodepthOutput,
    alignment: Option<AlignmentGraph>,
    deltas_graph: Option<DeltasGraph>,
    weights: Weights,
    recompute: Option<Recompute>,
    compute: Compute,
}

/// Graph of the alignment of predicted depth.
struct AlignmentGraph {
    predicted: Tensor,
    factors: Tensor,
    depth: Tensor,
}

/// Graph from features, image and depth to deltas. The graph starts at new leaves, so that
/// gradients of the features pass through the encoder only once.
struct DeltasGraph {
    features: [Tensor; 5],
    seen: Tensor,
    /// Deltas of geometry and texture.
    deltas: [Tensor; 2],
}

/// Gradient of a loss with respect to the outputs of a [`TrainingPass`].
#[derive(Debug, Clone, PartialEq)]
pub struct PassGradient {
    /// Gradient with respect to [`TrainingPass::gaussians`], in the same order.
    pub gaussians: Vec<GaussianGradient>,
    /// Gradient with respect to the inverse depth of [`TrainingPass::base`], `[2, rows, columns]`, not counting its
    /// effect through the Gaussians.
    pub inverse_depth: Vec<f32>,
    /// Gradient with respect to [`TrainingPass::depth`], `[2, R, R]`, not counting its effect through other outputs.
    pub depth: Vec<f32>,
    /// Gradient with respect to [`TrainingPass::factors`], `[R, R]`, not counting their effect through other outputs.
    pub factors: Vec<f32>,
    /// Gradient with respect to [`TrainingPass::deltas`], not counting their effect through other outputs.
    pub deltas: Vec<f32>,
}

impl TrainableNetwork {
    /// Creates a network for passes on `compute`.
    ///
    /// # Errors
    /// [`ModelError::Config`] for an impossible configuration.
    pub fn new(config: &ModelConfig, compute: Compute) -> Result<Self, ModelError> {
        Ok(Self {
            config: config.clone(),
            parameters: inventory(config)?,
            recomputes: compute.device.is_cpu() && config.internal_resolution >= RECOMPUTED_FROM,
            compute: compute.learning(),
        })
    }

    /// True if the backward pass computes most intermediate tensors again because memory cannot
    /// hold them all. Recomputation costs another forward pass, and gradients differ by rounding.
    pub fn recomputes(&self) -> bool {
        self.recomputes
    }

    /// All parameters of the network, in the order of its modules.
    pub fn parameters(&self) -> &[Parameter] {
        &self.parameters
    }

    /// Runs one pass. `weights` are fetched while the pass runs. Gradients are tracked for the
    /// parameters for which `trainable` returns true.
    ///
    /// # Errors
    /// As for [`Predictor::predict`](super::Predictor::predict); [`ModelError::Image`] if the known depth has the wrong
    /// size.
    pub fn forward(
        &self,
        weights: impl WeightSource + 'static,
        trainable: impl Fn(&str) -> bool + Send + Sync + 'static,
        input: TrainingInput<'_>,
    ) -> Result<TrainingPass, ModelError> {
        check_input(input.image, input.disparity_factor)?;
        let (side, grid) = (self.config.internal_resolution, self.config.grid());
        let weights = Weights::new(weights, trainable);
        let list = RefCell::default();
        let recompute = self.recomputes.then(|| Recompute::new(&self.compute));
        let mut params = Params::new(&self.compute, &weights, &list);
        params.recompute = recompute.clone();
        let network = SharpNetwork::new(&self.config, &params);
        let size = (input.image.width, input.image.height);
        let image = bilinear_align_corners(input.image.values, size, (side, side));
        let normal: Vec<f32> = image.iter().map(|v| v * 2.0 - 1.0).collect();
        let out = network.monodepth.forward(&normal, &mut Silent)?;
        let disparity = to_planes(&out.disparity)?;
        let factor = input.disparity_factor;
        let metric = |d: &f32| metric_depth(*d, factor);
        let predicted: Vec<f32> = disparity.iter().map(metric).collect();

        let (factors, alignment) = match input.known_depth {
            Some(known) => {
                let (factors, graph) =
                    self.align(network.depth_alignment, &recompute, &predicted, known)?;
                (factors, Some(graph))
            }
            None => (vec![1.0; grid.pixels()], None),
        };
        let twice = factors.iter().chain(&factors);
        let depth: Vec<f32> = predicted.iter().zip(twice).map(|(d, s)| d * s).collect();
        let normalized = NormalizedDepth::new(&depth, InvalidDepth::Refuse)?;
        let base = BaseGaussians::from_normalized(&image, &normalized, grid)?;

        let (deltas, deltas_graph) = if input.depth_only {
            (
                vec![0.0; DELTA_CHANNELS.iter().sum::<usize>() * grid.blocks()],
                None,
            )
        } else {
            let planes = normalized.feature_input(&image);
            let shape = (3 + LAYERS, side, side);
            let seen = from_planes(&planes, shape, &self.compute.device)?;
            let seen = Var::from_tensor(&seen)?.into_inner();
            let [f0, f1, f2, f3, f4] = out.features.each_ref().map(leaf);
            let features = [f0?, f1?, f2?, f3?, f4?];
            let decoded = network
                .feature_model
                .forward(features.clone(), &seen, &mut Silent)?;
            let deltas = network.prediction_head.forward(decoded)?;
            let values = [to_planes(&deltas[0])?, to_planes(&deltas[1])?].concat();
            let graph = DeltasGraph {
                features,
                seen,
                deltas,
            };
            (values, Some(graph))
        };
        let gaussians = compose(&base, Some(&deltas))?;
        Ok(TrainingPass {
            gaussians,
            base,
            normalized,
            depth,
            factors,
            deltas,
            disparity_factor: factor,
            zeros_return: input.zeros_return,
            monodepth: out,
            alignment,
            deltas_graph,
            weights,
            recompute,
            compute: self.compute.clone(),
        })
    }

    /// Computes the factors of the alignment.
    fn align(
        &self,
        network: DepthAlignment,
        recompute: &Option<Recompute>,
        predicted: &[f32],
        known: &[f32],
    ) -> Result<(Vec<f32>, AlignmentGraph), ModelError> {
        let side = self.config.internal_resolution;
        if known.len() != side * side {
            return Err(ModelError::Image(format!(
                "known depth of {} values instead of {}",
                known.len(),
                side * side
            )));
        }
        let device = &self.compute.device;
        let predicted = from_planes(predicted, (LAYERS, side, side), device)?;
        let predicted = Var::from_tensor(&predicted)?.into_inner();
        let is_unknown = |known: &f32| u8::from(known.is_nan() || *known <= 0.0);
        let unknown: Vec<u8> = known.iter().map(is_unknown).collect();
        let layers = predicted.narrow(3, 0, self.config.alignment_input.layers())?;
        let first = layers.narrow(3, 0, 1)?;
        let unknown = Tensor::from_vec(unknown, first.shape(), device)?;
        let known = Tensor::from_slice(known, first.shape(), device)?;
        let seen = unknown.where_cond(&first, &known)?;
        let depths = Tensor::cat(&[&layers, &seen], 3)?;
        let log = match recompute {
            None => network.forward(&depths)?,
            Some(recompute) => recompute.run(&[&depths], move |x| Ok(network.forward(&x[0])?))?,
        };
        let factors = log.exp()?;
        let graph = AlignmentGraph {
            depth: predicted.broadcast_mul(&factors)?,
            predicted,
            factors,
        };
        let factors = to_planes(&graph.factors)?;
        Ok((factors, graph))
    }
}

/// Starts a new graph at `tensor`. If `tensor` is tracked, the result is a variable, which receives the gradient.
fn leaf(tensor: &Tensor) -> candle_core::Result<Tensor> {
    Ok(if tensor.track_op() {
        Var::from_tensor(tensor)?.into_inner()
    } else {
        tensor.clone()
    })
}

impl TrainingPass {
    /// A zero gradient with the sizes of this pass's outputs.
    pub fn zero_gradient(&self) -> PassGradient {
        PassGradient {
            gaussians: vec![GaussianGradient::default(); self.gaussians.len()],
            inverse_depth: vec![0.0; self.base.inverse_depth.len()],
            depth: vec![0.0; self.depth.len()],
            factors: vec![0.0; self.factors.len()],
            deltas: vec![0.0; self.deltas.len()],
        }
    }

    /// Gradients of the trainable parameters in PyTorch's layout, keyed by name. Parameters that no output depends on
    /// are omitted.
    ///
    /// # Errors
    /// [`ModelError::Image`] if a part of `upstream` has the wrong size; [`ModelError::Tensor`] if the device fails.
    pub fn backward(
        self,
        upstream: &PassGradient,
    ) -> Result<BTreeMap<String, Vec<f32>>, ModelError> {
        for (what, given, made) in [
            (
                "inverse depth",
                &upstream.inverse_depth,
                &self.base.inverse_depth,
            ),
            ("depth", &upstream.depth, &self.depth),
            ("factors", &upstream.factors, &self.factors),
            ("deltas", &upstream.deltas, &self.deltas),
        ] {
            if given.len() != made.len() {
                return Err(ModelError::Image(format!(
                    "a gradient of {} values for {} of {what}",
                    given.len(),
                    made.len()
                )));
            }
        }
        let variables = self.weights.variables();
        let mut gradients = BTreeMap::new();
        let mut collect = |found: &GradStore| {
            for (name, variable) in &variables {
                let recomputed = self.recompute.as_ref().and_then(|r| r.take(variable));
                if let Some(gradient) = found.get(variable).or(recomputed.as_ref()) {
                    gradients.insert(name.clone(), gradient.flatten_all()?.to_vec1()?);
                }
            }
            Ok::<_, ModelError>(())
        };

        let mut composed = composer::backward(&self.base, &self.deltas, &upstream.gaussians)?;
        for (sum, g) in composed.deltas.iter_mut().zip(&upstream.deltas) {
            *sum += g;
        }
        let pooled = &mut composed.base.inverse_depth;
        for (sum, g) in pooled.iter_mut().zip(&upstream.inverse_depth) {
            *sum += g;
        }
        let grid = self.base.grid;
        let compute = &self.compute;
        let with_upstream = |output: Tensor, planes: &[f32]| {
            let (_, h, w, c) = output.dims4()?;
            let upstream = from_planes(planes, (c, h, w), &compute.device)?;
            candle_core::Result::Ok((output, upstream))
        };
        let mut of_features = vec![0.0; LAYERS * grid.pixels()];
        let mut upstream_of_features = Vec::new();
        if let Some(graph) = self.deltas_graph {
            let (geometry, texture) = composed.deltas.split_at(DELTA_CHANNELS[0] * grid.blocks());
            let [of_geometry, of_texture] = graph.deltas;
            let outputs = [
                with_upstream(of_geometry, geometry)?,
                with_upstream(of_texture, texture)?,
            ];
            if let Some(found) = pull(compute, &outputs)? {
                if let Some(gradient) = found.get(&graph.seen) {
                    of_features = to_planes(&gradient.narrow(3, 3, LAYERS)?)?;
                }
                let ends = self.monodepth.features.into_iter().zip(&graph.features);
                for (feature, end) in ends {
                    let arrived = found.get(end).map(|gradient| (feature, gradient.clone()));
                    upstream_of_features.extend(arrived);
                }
                collect(&found)?;
            }
        }
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
        let mut predicted = depth;
        if let Some(graph) = self.alignment {
            let outputs = [
                with_upstream(graph.depth, &predicted)?,
                with_upstream(graph.factors, &upstream.factors)?,
            ];
            if let Some(found) = pull(compute, &outputs)? {
                collect(&found)?;
                if let Some(of_predicted) = found.get(&graph.predicted) {
                    predicted = to_planes(of_predicted)?;
                }
            }
        }
        let disparity = self.monodepth.disparity;
        let inside = MIN_DISPARITY..=MAX_DISPARITY;
        for (g, disparity) in predicted.iter_mut().zip(&to_planes(&disparity)?) {
            let clamped = disparity.clamp(MIN_DISPARITY, MAX_DISPARITY);
            let slope = -*g * self.disparity_factor / (clamped * clamped);
            let returns = self.zeros_return && *disparity < MIN_DISPARITY && slope < 0.0;
            *g = if inside.contains(disparity) || returns {
                slope
            } else {
                0.0
            };
        }
        upstream_of_features.push(with_upstream(disparity, &predicted)?);
        if let Some(found) = pull(compute, &upstream_of_features)? {
            collect(&found)?;
        }
        Ok(gradients)
    }
}

/// Smallest internal resolution at which intermediate tensors are computed again instead of kept. At 1536, they would
/// take more than 24 GiB.
const RECOMPUTED_FROM: usize = 1024;

/// Output channels of the two heads.
const DELTA_CHANNELS: [usize; 2] = [3 * LAYERS, 11 * LAYERS];

#[cfg(test)]
mod tests;
