//! Finds out whether Gaussians were made from, or placed in the camera of, another view than their stated source.

use std::collections::BTreeSet;

use image::RgbImage;
use sharp::gaussians::Gaussians;
use sharp::render::RenderError;
use sharp_datasets::Scene;

use super::likeness::{Likeness, window};
use super::render::placed;
use super::rereading::Trial;
use crate::methods::file_reading::{FileReading, FileSpace};
use crate::methods::{GaussianPrediction, GaussianSpace};
use crate::pairs::PosedCamera;

/// Number of views of a scene among which [`best_shown`] chooses.
const VIEWS_TRIED: usize = 8;

/// Other views of the source's scene whose photographs have this `size`: the source's neighbours, the view at the
/// mirrored position in the scene's order, and the first view. The first view's camera may define the scene's
/// coordinates.
pub(super) fn other_views(
    source: &PosedCamera,
    scene: &Scene,
    size: (u32, u32),
) -> Vec<(PosedCamera, RgbImage)> {
    let Some(at) = scene.views.iter().position(|view| view.id == source.id) else {
        return Vec::new();
    };
    let mirrored = scene.views.len() - 1 - at;
    let others = [at.checked_sub(1), Some(at + 1), Some(mirrored), Some(0)];
    let others: BTreeSet<usize> = others.into_iter().flatten().filter(|&k| k != at).collect();
    views_at(scene, others, size).collect()
}

/// The views at these positions in the scene's order whose photographs have this `size`.
fn views_at(
    scene: &Scene,
    positions: impl IntoIterator<Item = usize>,
    size: (u32, u32),
) -> impl Iterator<Item = (PosedCamera, RgbImage)> {
    let views = positions.into_iter().filter_map(|k| scene.views.get(k));
    let read = views.filter_map(|view| {
        // If a photograph is unreadable, its own pairs report it.
        let photograph = view.content.image().ok()?;
        Some((PosedCamera::from(view), photograph))
    });
    read.filter(move |(_, photograph)| photograph.dimensions() == size)
}

/// Renders Gaussians into up to [`VIEWS_TRIED`] views spread over the scene, and returns the view whose photograph they
/// reproduce best; `None` if it is the source of `own`. Gaussians that were made from several views reproduce those
/// best, and the source need not be one of them.
pub(super) fn best_shown(
    gaussians: &Gaussians,
    space: GaussianSpace,
    own: &Trial<'_>,
    scene: &Scene,
) -> Result<Option<(PosedCamera, RgbImage)>, RenderError> {
    let fit = |trial: &Trial<'_>| {
        let fit = trial.fit(gaussians, placed(space, own.source, trial.source))?;
        Ok::<f64, RenderError>(fit.map_or(0.0, |fit| fit.explained()))
    };
    let mut best = (fit(own)?, None);
    let n = scene.views.len();
    let spread: BTreeSet<usize> = (0..VIEWS_TRIED).map(|k| k * n / VIEWS_TRIED).collect();
    for (source, photograph) in views_at(scene, spread, own.photograph.dimensions()) {
        let explained = fit(&Trial {
            source: &source,
            photograph: &photograph,
            region: window(&photograph),
            ..*own
        })?;
        if explained > best.0 && source.id != own.source.id {
            best = (explained, Some((source, photograph)));
        }
    }
    Ok(best.1)
}

/// A view that explains the Gaussians significantly better than their own source.
pub(super) struct OtherView<'a> {
    view: &'a PosedCamera,
    pub(super) fit: Likeness,
    /// True if the means are in this view's camera space but show what the source sees; false if the Gaussians show
    /// this view.
    pub(super) is_frame: bool,
}

impl OtherView<'_> {
    pub(super) fn sentence(&self, shown: &str) -> String {
        let (id, db) = (&self.view.id, self.fit.psnr());
        if self.is_frame {
            format!(
                "{shown}; with the means read in the camera space of {id}, they reach {db:.2} dB; either write means \
                 in the space of the source's own camera, or set `space=target` if each pair has a file in its target's \
                 camera"
            )
        } else {
            format!(
                "{shown}, and the photograph of {id} at {db:.2} dB; perhaps the Gaussians were predicted from {id}, \
                 or files are named after the wrong views; name each file after the view that it was predicted from"
            )
        }
    }
}

/// The view among `others` that explains the Gaussians best, if significantly better than the source does (`as_read`).
/// Three things are compared: the view's photograph with `shown`, the rendering from the source; the view's photograph
/// with a rendering from that view; and the source's photograph with the Gaussians placed in that view's camera space.
pub(super) fn other_view<'a>(
    prediction: &GaussianPrediction,
    reading: &FileReading,
    own: &Trial<'_>,
    others: &[Trial<'a>],
    as_read: &Likeness,
    shown: &RgbImage,
) -> Result<Option<OtherView<'a>>, RenderError> {
    let mut candidates = Vec::new();
    let in_cameras = reading.placement.space != FileSpace::World;
    for trial in others.iter().filter(|_| in_cameras) {
        let view = trial.source;
        let placed = reading.placement.camera_from_file(view);
        let placed_in_own = view.to(own.source).to_affine() * placed;
        let colored = Likeness::of(trial.photograph, trial.region, shown);
        let predicted = trial.fit(&prediction.gaussians, placed)?;
        let framed = own.fit(&prediction.gaussians, placed_in_own)?;
        candidates.extend([
            (view, Some(colored), false),
            (view, predicted, false),
            (view, framed, true),
        ]);
    }
    let candidates = candidates.into_iter().filter_map(|(view, fit, is_frame)| {
        let fit = fit.filter(|fit| fit.is_better_than(as_read))?;
        Some(OtherView {
            view,
            fit,
            is_frame,
        })
    });
    Ok(candidates.min_by(|a, b| a.fit.error().total_cmp(&b.fit.error())))
}
