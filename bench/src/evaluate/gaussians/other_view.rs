//! Other views of a scene as the source of Gaussians.

use std::collections::BTreeSet;

use image::RgbImage;
use sharp::render::RenderError;
use sharp_datasets::Scene;

use super::likeness::Likeness;
use super::rereading::Trial;
use crate::methods::GaussianPrediction;
use crate::methods::file_reading::{FileReading, FileSpace};
use crate::pairs::PosedCamera;

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
    let views = others.into_iter().filter_map(|k| scene.views.get(k));
    let read = views.filter_map(|view| {
        // If a photograph is unreadable, its own pairs report it.
        let photograph = view.content.image().ok()?;
        Some((PosedCamera::from(view), photograph))
    });
    read.filter(|(_, photograph)| photograph.dimensions() == size)
        .collect()
}

/// A view that explains the Gaussians significantly better than their own source.
pub(super) struct OtherView<'a> {
    view: &'a PosedCamera,
    pub(super) fit: Likeness,
    /// True if the means are in this view's camera space but show the source; false if the Gaussians show this view.
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

/// The other view that explains the Gaussians best, if significantly better than their own source (`as_read`). Either
/// its photograph matches the Gaussians, rendered from it or from the source (`shown`), or the means are in its
/// camera's space.
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
