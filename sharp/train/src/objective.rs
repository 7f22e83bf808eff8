//! The objective of one example: all of the paper's losses for one pass of the network, and their
//! gradient with respect to the network's outputs.
//!
//! The pixel gradients of a view are first accumulated and then propagated through the renderer together. No data of a
//! view is thus kept while the next view is rendered (the paper's graph surgery, applied to all losses).

use glam::DVec3;
use image::RgbImage;
use sharp::camera::{RigidTransform, target_camera_from_source_ndc};
use sharp::color::srgb_from_linear;
use sharp::frustum_mask::{FrustumMaskOptions, InfiniteDepth, frustum_mask};
use sharp::model::Compute;
use sharp::model::training::{PassGradient, TrainingPass};
use sharp::render::{
    CpuRenderer, GaussianGradient, PictureGradient, RenderError, RenderView, Renderer,
    backward_covariances, covariances,
};
use sharp::resize::nearest;

use crate::data::TrainingView;
use crate::losses::perceptual::{PerceptualError, PerceptualViews};
use crate::losses::{
    self, AlphaViews, GradAt, LossOptions, LossWeights, MaskSky, Perceptual, SplatView, TERMS,
    linear_from_srgb_gradient,
};

/// Inputs of the network, and the ground truth for its Gaussians.
#[derive(Debug, Clone, Copy)]
pub(crate) struct Example<'a> {
    pub source: &'a TrainingView,
    pub target: &'a TrainingView,
    /// Determines the position of the perceptual loss's crop.
    pub seed: u64,
}

/// Losses of an example and their gradient.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Cost {
    /// Losses before weighting, in the order of [`TERMS`]; 0 for losses without a weight.
    pub terms: [f64; TERMS.len()],
    /// Weighted sum of the losses.
    pub total: f64,
    pub gradient: PassGradient,
}

#[derive(Debug, thiserror::Error)]
pub enum ObjectiveError {
    #[error(transparent)]
    Render(#[from] RenderError),
    #[error(transparent)]
    Perceptual(#[from] PerceptualError),
}

/// Computes the weighted sum of all losses.
pub(crate) struct Objective {
    weights: LossWeights,
    options: LossOptions,
    perceptual: Option<Perceptual>,
}

impl Objective {
    /// Creates an objective with the given weights and options. Loads the network of the perceptual
    /// loss on `compute` if that loss has a weight.
    ///
    /// # Errors
    /// [`PerceptualError`] if the network's weights are missing or unreadable.
    pub(crate) fn new(
        weights: LossWeights,
        options: LossOptions,
        compute: Compute,
    ) -> Result<Self, PerceptualError> {
        let perceptual = if weights.percep > 0.0 {
            Some(Perceptual::new(options.percep.clone(), compute)?)
        } else {
            None
        };
        Ok(Self {
            weights,
            options,
            perceptual,
        })
    }

    /// Name of the perceptual loss's network, for a log.
    pub(crate) fn perceptual_network(&self) -> Option<&'static str> {
        self.perceptual.as_ref().map(Perceptual::network)
    }

    /// True if no loss depends on Gaussians or on pictures rendered from them.
    pub(crate) fn is_of_depth_alone(&self) -> bool {
        let LossWeights {
            color,
            alpha,
            percep,
            grad,
            delta,
            splat,
            ..
        } = self.weights;
        [color, alpha, percep, grad, delta, splat] == [0.0; 6]
    }

    /// Losses of a pass on the picture of `example.source`.
    ///
    /// # Errors
    /// [`ObjectiveError`] if a view cannot be rendered or the perceptual loss cannot be computed.
    pub(crate) fn cost(
        &self,
        pass: &TrainingPass,
        example: &Example<'_>,
    ) -> Result<Cost, ObjectiveError> {
        let Example { source, target, .. } = *example;
        let mut sum = Cost {
            terms: [0.0; TERMS.len()],
            total: 0.0,
            gradient: pass.zero_gradient(),
        };
        self.on_depth(&mut sum, pass, source);
        if self.is_of_depth_alone() {
            return Ok(sum);
        }
        let target_from_source = target
            .camera_from_world
            .after(&source.camera_from_world.inverse());
        let view = |view: &TrainingView, from_source: &RigidTransform| {
            let placed = target_camera_from_source_ndc(&source.intrinsics, from_source);
            RenderView::new(placed, view.intrinsics).with_low_pass(self.options.low_pass)
        };
        let input = view(source, &RigidTransform::IDENTITY);
        let novel = view(target, &target_from_source);
        self.on_picture(&mut sum, pass, &input, example, None)?;
        let options = FrustumMaskOptions {
            infinite_depth: match self.options.mask_sky {
                MaskSky::Direction => InfiniteDepth::Direction,
                MaskSky::LeftOut => InfiniteDepth::Invalid,
            },
            ..FrustumMaskOptions::default()
        };
        let mask = frustum_mask(
            &target.depth,
            &target.intrinsics,
            &source.intrinsics,
            &target_from_source.inverse(),
            &options,
        );
        let counts = |k: usize| target.valid.as_ref().is_none_or(|valid| valid[k]);
        let mask = mask.iter().enumerate();
        let mask: Vec<bool> = mask.map(|(k, inside)| *inside > 0 && counts(k)).collect();
        self.on_picture(&mut sum, pass, &novel, example, Some(&mask))?;
        self.on_gaussians(&mut sum, pass, [&input, &novel])?;
        Ok(sum)
    }

    /// Losses of a rendered picture: the input view, or (with a mask) the novel view.
    fn on_picture(
        &self,
        sum: &mut Cost,
        pass: &TrainingPass,
        view: &RenderView,
        example: &Example<'_>,
        novel: Option<&[bool]>,
    ) -> Result<(), ObjectiveError> {
        let (weights, options) = (&self.weights, &self.options);
        let mut renderer = CpuRenderer::new();
        let rendered = renderer.render(&pass.gaussians, view)?;
        let (truth, mask) = match novel {
            Some(mask) => (&example.target.image, Some(mask)),
            None => (&example.source.image, example.source.valid.as_deref()),
        };
        let truth = srgb(truth);
        let linear = &rendered.rgb;
        let encoded: Vec<[f32; 3]> = linear.iter().map(|c| c.map(srgb_from_linear)).collect();
        let mut of_srgb = vec![[0.0; 3]; encoded.len()];
        let mut of_alpha = vec![0.0; encoded.len()];
        if weights.color > 0.0 {
            let loss = losses::color(&encoded, &truth, mask, options);
            sum.add(0, loss.value, weights.color);
            add_scaled(
                of_srgb.as_flattened_mut(),
                loss.gradient.as_flattened(),
                weights.color,
            );
        }
        let covers = novel.is_none() || options.alpha_views == AlphaViews::Both;
        if weights.alpha > 0.0 && covers {
            let loss = losses::alpha(&rendered.alpha, mask, options);
            sum.add(1, loss.value, weights.alpha);
            add_scaled(&mut of_alpha, &loss.gradient, weights.alpha);
        }
        let looks = novel.is_some() || options.percep.views == PerceptualViews::Both;
        if let Some(perceptual) = self.perceptual.as_ref().filter(|_| looks) {
            let width = rendered.width as usize;
            let loss = perceptual.compare(&encoded, &truth, width, mask, example.seed)?;
            sum.add(2, loss.value, weights.percep);
            add_scaled(
                of_srgb.as_flattened_mut(),
                loss.gradient.as_flattened(),
                weights.percep,
            );
        }
        let gradient = PictureGradient {
            width: rendered.width as usize,
            rgb_linear: &linear_from_srgb_gradient(linear, &of_srgb),
            alpha: &of_alpha,
            depth_acc: &vec![0.0; encoded.len()],
        };
        let of_gaussians = renderer.backward(&pass.gaussians, view, &gradient)?;
        for (sum, one) in sum.gradient.gaussians.iter_mut().zip(&of_gaussians) {
            *sum += one;
        }
        Ok(())
    }

    /// Losses of the depth layers and the alignment's factors.
    fn on_depth(&self, sum: &mut Cost, pass: &TrainingPass, source: &TrainingView) {
        let (weights, options) = (&self.weights, &self.options);
        let side = pass.base.grid.width;
        let (first, second) = pass.depth.split_at(side * side);
        if weights.depth > 0.0 {
            let truth = known_depth(source, side);
            let nearest = f64::from(pass.base.global_scale);
            let loss = losses::depth(first, &truth, nearest, options);
            sum.add(3, loss.value, weights.depth);
            let of_first = &mut sum.gradient.depth[..side * side];
            add_scaled(of_first, &loss.gradient, weights.depth);
        }
        if weights.tv > 0.0 {
            let loss = losses::tv(second, side);
            sum.add(4, loss.value, weights.tv);
            let of_second = &mut sum.gradient.depth[side * side..];
            add_scaled(of_second, &loss.gradient, weights.tv);
        }
        if weights.scale > 0.0 {
            let loss = losses::scale(&pass.factors);
            sum.add(8, loss.value, weights.scale);
            add_scaled(&mut sum.gradient.factors, &loss.gradient, weights.scale);
        }
        if weights.scale_gradient > 0.0 {
            let loss = losses::scale_gradient(&pass.factors, side, options);
            sum.add(9, loss.value, weights.scale_gradient);
            let of_factors = &mut sum.gradient.factors;
            add_scaled(of_factors, &loss.gradient, weights.scale_gradient);
        }
    }

    fn on_gaussians(
        &self,
        sum: &mut Cost,
        pass: &TrainingPass,
        [input, novel]: [&RenderView; 2],
    ) -> Result<(), ObjectiveError> {
        let (weights, options) = (&self.weights, &self.options);
        let base = &pass.base;
        if weights.grad > 0.0 {
            let (opacities, nearest) = (&pass.gaussians.opacities, f64::from(base.global_scale));
            let (rows, columns) = (base.grid.rows(), base.grid.columns());
            let (loss, of_map) = match options.grad_at {
                GradAt::Projected => {
                    let sides = [columns, base.grid.width];
                    let loss =
                        losses::grad_projected(opacities, &pass.depth, sides, nearest, options);
                    (loss, &mut sum.gradient.depth)
                }
                GradAt::Grid => {
                    let (map, size) = (&base.inverse_depth, [rows, columns]);
                    let loss = losses::grad(opacities, map, size, nearest, options);
                    (loss, &mut sum.gradient.inverse_depth)
                }
            };
            if let Some(gradient) = &loss.map {
                add_scaled(of_map, gradient, weights.grad);
            }
            sum.add(5, loss.opacity.value, weights.grad);
            let gradients = &mut sum.gradient.gaussians;
            for (gaussian, g) in gradients.iter_mut().zip(&loss.opacity.gradient) {
                gaussian.opacity += (weights.grad * f64::from(*g)) as f32;
            }
        }
        if weights.delta > 0.0 {
            // The planes of x and y come first.
            let planes = 2 * base.inverse_depth.len();
            let loss = losses::delta(&pass.deltas[..planes]);
            sum.add(6, loss.value, weights.delta);
            let of_deltas = &mut sum.gradient.deltas[..planes];
            add_scaled(of_deltas, &loss.gradient, weights.delta);
        }
        if weights.splat > 0.0 {
            let view = match options.splat_view {
                SplatView::Input => input,
                SplatView::Novel => novel,
            };
            // Gaussians behind the camera or nearer than its near plane are left out.
            let means = &pass.gaussians.means;
            let depth = |k: usize| {
                let mean = DVec3::from_array(means[k].map(f64::from));
                view.camera_from_scene.transform_point3(mean).z
            };
            let near = f64::from(view.rule.near);
            let seen: Vec<usize> = (0..means.len()).filter(|k| depth(*k) >= near).collect();
            let all = covariances(&pass.gaussians, view)?;
            let variances: Vec<[f64; 3]> = seen.iter().map(|k| all[*k]).collect();
            let loss = losses::splat(&variances, view.intrinsics.width, options);
            sum.add(7, loss.value, weights.splat);
            let mut scaled = vec![[0.0; 3]; all.len()];
            for (k, g) in seen.iter().zip(&loss.gradient) {
                scaled[*k] = g.map(|g| weights.splat * g);
            }
            let out: &mut [GaussianGradient] = &mut sum.gradient.gaussians;
            backward_covariances(&pass.gaussians, view, &scaled, out)?;
        }
        Ok(())
    }
}

impl Cost {
    fn add(&mut self, term: usize, value: f64, weight: f64) {
        self.terms[term] += value;
        self.total += weight * value;
    }
}

/// Depth of the source at the network's resolution, `[side, side]`, as the input of a pass.
pub(crate) fn known_depth(view: &TrainingView, side: usize) -> Vec<f32> {
    let (width, height) = view.depth.dimensions();
    nearest(&view.depth, (width as usize, height as usize), (side, side))
}

/// Pixels of a picture as sRGB-encoded values in 0..1.
fn srgb(image: &RgbImage) -> Vec<[f32; 3]> {
    let level = |v: u8| f32::from(v) / 255.0;
    image.pixels().map(|pixel| pixel.0.map(level)).collect()
}

fn add_scaled(sum: &mut [f32], gradient: &[f32], weight: f64) {
    for (sum, g) in sum.iter_mut().zip(gradient) {
        *sum += (weight * f64::from(*g)) as f32;
    }
}

#[cfg(test)]
mod tests;
