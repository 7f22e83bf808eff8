//! Gradient of a picture propagated to its Gaussians: the exact derivative of the forward definition with SHARP's rule,
//! including clamps, skips, stop and low-pass. Depth order and culling are treated as constants.
//!
//! Passes have the same names as in the forward direction: `raster` sums over pixels, `project` applies the chain rule.

mod project;
mod raster;
#[cfg(test)]
mod tests;

use super::cpu::{BinScratch, CpuRenderer};
use super::emit::{BinGrid, count, emit};
use super::project::{Projected, Splat, project as forward};
use super::renderer::check_scene;
use super::view::ViewConstants;
use super::{RenderError, RenderView};
use crate::gaussians::Gaussians;
use project::{Projection, ScreenGradient, ShapeGradient};
use raster::{SplatSums, Steps, Upstream};
use rayon::prelude::*;

/// Gradient of a loss with respect to the contents of [`RenderOutput`](super::RenderOutput), in the same row-major
/// layout.
#[derive(Debug, Clone, Copy)]
pub struct PictureGradient<'a> {
    /// Pixels per row.
    pub width: usize,
    /// Gradient with respect to [`RenderOutput::rgb`](super::RenderOutput::rgb).
    pub rgb_linear: &'a [[f32; 3]],
    /// Gradient with respect to [`RenderOutput::alpha`](super::RenderOutput::alpha).
    pub alpha: &'a [f32],
    /// Gradient with respect to [`RenderOutput::depth_acc`](super::RenderOutput::depth_acc).
    pub depth_acc: &'a [f32],
}

/// Gradient of a loss with respect to one Gaussian; zero if the Gaussian was not drawn.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub struct GaussianGradient {
    pub mean: [f32; 3],
    /// Gradient with respect to the stored (unnormalised) quaternion, w first; perpendicular to it.
    pub quaternion: [f32; 4],
    pub scales: [f32; 3],
    pub opacity: f32,
    /// Gradient with respect to linear RGB.
    pub color: [f32; 3],
    /// Gradient with respect to the centre's z in the view, through the accumulated depth. The gradient of the mean
    /// already includes it.
    pub view_depth: f32,
}

/// Maximum number of (Gaussian, bin) pairs whose sums are in memory at a time, 44 bytes each.
const PAIR_LIMIT: u64 = 1 << 22;
/// Gaussians per task.
const CHUNK: usize = 4096;

impl PictureGradient<'_> {
    fn height(&self) -> usize {
        self.alpha.len() / self.width.max(1)
    }

    /// Gradient at the 4×4 pixels whose first pixel is `[x, y]`.
    fn block(&self, [x, y]: [usize; 2]) -> Upstream<f32> {
        let mut out = [[0.0; 16]; 5];
        let (columns, rows) = (self.width - x, self.height() - y);
        for lane in 0..16 {
            let (dx, dy) = (lane % 4, lane / 4);
            if dx < columns && dy < rows {
                let pixel = (y + dy) * self.width + x + dx;
                for channel in 0..3 {
                    out[channel][lane] = self.rgb_linear[pixel][channel];
                }
                out[3][lane] = self.alpha[pixel];
                out[4][lane] = self.depth_acc[pixel];
            }
        }
        out
    }

    fn check(&self, view: &RenderView) -> Result<(), RenderError> {
        let (width, height) = (
            view.intrinsics.width as usize,
            view.intrinsics.height as usize,
        );
        let lengths = [
            self.rgb_linear.len(),
            self.alpha.len(),
            self.depth_acc.len(),
        ];
        if self.width != width || lengths != [width * height; 3] {
            return Err(RenderError::View(format!(
                "a gradient of {lengths:?} values in rows of {} for a picture of {width}x{height}",
                self.width
            )));
        }
        Ok(())
    }
}

/// For each Gaussian of a bin, its index and the sums over the bin's pixels of its contributions to the gradient.
type BinSums = Vec<(u32, SplatSums)>;

impl CpuRenderer {
    /// Gradient of a loss with respect to the scene, given the loss's gradient with respect to the
    /// picture that [`render`](super::Renderer::render) returns for the same scene and view.
    ///
    /// The gradient is zero for non-finite Gaussians and for Gaussians that the forward pass
    /// dropped. Results are bit-identical for any number of threads.
    ///
    /// # Errors
    /// As for rendering; [`RenderError::View`] also if the gradient's size differs from the picture's, or if the rule
    /// differs from SHARP's in anything but low-pass, near and far.
    pub fn backward(
        &mut self,
        scene: &Gaussians,
        view: &RenderView,
        gradient: &PictureGradient<'_>,
    ) -> Result<Vec<GaussianGradient>, RenderError> {
        check_scene(scene)?;
        view.check()?;
        gradient.check(view)?;
        check_rule(view)?;
        forward(self.simd, scene, view, &mut self.projected);
        let Projected {
            splats, footprints, ..
        } = &self.projected;
        let grid = BinGrid::new(view.intrinsics.width, view.intrinsics.height);
        let counts = count(grid, footprints);
        let mut totals = vec![SplatSums::<f64>::default(); scene.len()];
        for bins in counts.groups(grid, PAIR_LIMIT) {
            let lists = emit(grid, footprints, &counts, bins.clone());
            let sums: Vec<BinSums> = bins
                .into_par_iter()
                .with_max_len(1)
                .map(|bin| {
                    let mut scratch = self.take_scratch();
                    let corner = scratch.load((grid, bin), &lists, splats, footprints);
                    let mut sums = vec![SplatSums::default(); scratch.keys.len()];
                    let mut steps = Steps::default();
                    if !scratch.keys.is_empty() {
                        let BinScratch { lists, members, .. } = &mut scratch;
                        lists.for_each_band(self.tile.pixels(), |band| {
                            let scratch = (&mut *members, &mut steps);
                            raster::raster(self.simd, band, corner, gradient, scratch, &mut sums);
                        });
                    }
                    // The low half of a key is the index.
                    let indices = scratch.keys.iter().map(|key| *key as u32);
                    let sums = indices.zip(sums).collect();
                    self.return_scratch(scratch);
                    sums
                })
                .collect();
            // Adds sums in the order of bins, regardless of which thread computed them.
            for (index, sums) in sums.iter().flatten() {
                totals[*index as usize].add(sums);
            }
        }
        Ok(through_projection(scene, view, splats, &totals))
    }
}

impl SplatSums<f64> {
    fn add(&mut self, other: &SplatSums) {
        self.opacity += f64::from(other.opacity);
        self.z += f64::from(other.z);
        self.across += f64::from(other.across);
        self.along += f64::from(other.along);
        for c in 0..3 {
            self.color[c] += f64::from(other.color[c]);
            self.factor[c] += f64::from(other.factor[c]);
        }
    }

    /// Gradient of the projection's outputs, for a splat with the conic factor `[p, q, r]`.
    fn on_screen(&self, [p, q, r]: [f64; 3]) -> ScreenGradient {
        ScreenGradient {
            center: [p * self.across, q * self.across + r * self.along],
            factor: self.factor,
            covariance: [0.0; 3],
            z: self.z,
        }
    }
}

impl std::ops::AddAssign<&Self> for GaussianGradient {
    fn add_assign(&mut self, other: &Self) {
        fn add<const N: usize>(sum: &mut [f32; N], other: &[f32; N]) {
            for (sum, other) in sum.iter_mut().zip(other) {
                *sum += other;
            }
        }
        add(&mut self.mean, &other.mean);
        add(&mut self.quaternion, &other.quaternion);
        add(&mut self.scales, &other.scales);
        add(&mut self.color, &other.color);
        self.opacity += other.opacity;
        self.view_depth += other.view_depth;
    }
}

impl GaussianGradient {
    fn add_shape(&mut self, shape: &ShapeGradient) {
        for c in 0..3 {
            self.mean[c] = narrow(f64::from(self.mean[c]) + shape.mean[c]);
            self.scales[c] = narrow(f64::from(self.scales[c]) + shape.scales[c]);
        }
        for c in 0..4 {
            self.quaternion[c] = narrow(f64::from(self.quaternion[c]) + shape.quaternion[c]);
        }
    }
}

/// Rounds to f32; values out of range saturate to the largest finite f32, which clipping can handle.
pub(crate) fn narrow(x: f64) -> f32 {
    (x as f32).clamp(f32::MIN, f32::MAX)
}

fn check_rule(view: &RenderView) -> Result<(), RenderError> {
    if view.rule.is_like_sharp() {
        return Ok(());
    }
    Err(RenderError::View(format!(
        "derivatives are not supported for rule \"{}\", only for \"sharp\" with any low-pass, near and far",
        view.rule
    )))
}

fn projection(k: &ViewConstants, scene: &Gaussians, index: usize) -> Projection {
    Projection::new(
        k,
        scene.means[index].map(f64::from),
        scene.quaternions[index].map(f64::from),
        scene.scales[index].map(f64::from),
    )
}

/// Backward of pass `project`, on the threads of the current pool.
fn through_projection(
    scene: &Gaussians,
    view: &RenderView,
    splats: &[Splat],
    totals: &[SplatSums<f64>],
) -> Vec<GaussianGradient> {
    let constants = ViewConstants::new(view);
    let one = |(k, sums): (usize, &SplatSums<f64>)| {
        let mut out = GaussianGradient::default();
        // Also true for dropped Gaussians, whose splat is meaningless.
        if *sums == SplatSums::default() {
            return out;
        }
        let splat = &splats[k];
        let screen = sums.on_screen([splat.p, splat.q, splat.r].map(f64::from));
        out.add_shape(&projection(&constants, scene, k).pull(&constants, &screen));
        out.opacity = narrow(sums.opacity / f64::from(splat.opacity));
        out.color = sums.color.map(narrow);
        out.view_depth = narrow(sums.z);
        out
    };
    let totals = totals.par_iter().enumerate().with_min_len(CHUNK);
    totals.map(one).collect()
}

/// Entries uu, uv, vv of each Gaussian's 2D covariance in a view, in px², without the low-pass. Only meaningful if the
/// centre lies in front of the camera.
///
/// # Errors
/// As for [`CpuRenderer::backward`].
pub fn covariances(scene: &Gaussians, view: &RenderView) -> Result<Vec<[f64; 3]>, RenderError> {
    check_scene(scene)?;
    view.check()?;
    check_rule(view)?;
    let constants = ViewConstants::new(view);
    let each = (0..scene.len()).into_par_iter().with_min_len(CHUNK);
    Ok(each
        .map(|k| projection(&constants, scene, k).covariance())
        .collect())
}

/// Adds to `out` the scene gradient that corresponds to `gradient`, the gradient with respect to the entries returned
/// by [`covariances`]. The gradient with respect to uv includes both off-diagonal elements of the matrix.
///
/// # Errors
/// As for [`CpuRenderer::backward`]; [`RenderError::View`] also if a length differs from the scene's.
pub fn backward_covariances(
    scene: &Gaussians,
    view: &RenderView,
    gradient: &[[f64; 3]],
    out: &mut [GaussianGradient],
) -> Result<(), RenderError> {
    check_scene(scene)?;
    view.check()?;
    check_rule(view)?;
    if [gradient.len(), out.len()] != [scene.len(); 2] {
        return Err(RenderError::View(format!(
            "{} gradients of covariances and {} outputs for {} Gaussians",
            gradient.len(),
            out.len(),
            scene.len()
        )));
    }
    let constants = ViewConstants::new(view);
    let each = out.par_iter_mut().zip(gradient).enumerate();
    each.with_min_len(CHUNK).for_each(|(k, (out, gradient))| {
        if *gradient != [0.0; 3] {
            let screen = ScreenGradient {
                covariance: *gradient,
                ..ScreenGradient::default()
            };
            out.add_shape(&projection(&constants, scene, k).pull(&constants, &screen));
        }
    });
    Ok(())
}
