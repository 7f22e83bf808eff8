//! Compares shifts and focal lengths on flattened Gaussians: most neighbours have the same depth, so that none covers
//! the others systematically.
//!
//! On a slanted surface, each Gaussian is partly covered by nearer neighbours. Even if a file is read correctly, this
//! moves its rendering by up to a pixel, which must not be taken for a wrong shift or focal length.

use glam::{DAffine3, DVec3};
use sharp::gaussians::Gaussians;
use sharp::render::RenderError;

use super::super::likeness::Likeness;
use super::super::registration::shift;
use super::{Seen, Trial};
use crate::methods::file_reading::{FileReading, Placement};

/// Ratio between successive depths to which Gaussians are moved.
const DEPTH_RATIO: f64 = 1.25;

impl Trial<'_> {
    /// Comparisons of flattened Gaussians with the photograph: as read, and with the shift and the focal length of
    /// `placement`. `None` if one of the two cannot be rendered.
    pub(super) fn flat_fits(
        &self,
        gaussians: &Gaussians,
        before: &FileReading,
        placement: Placement,
    ) -> Result<Option<[Likeness; 2]>, RenderError> {
        let trial = self.under(before);
        let maps = [before.placement, placement].map(|place| place.camera_from_file(self.source));
        let [fit, shifted] = maps.map(|map| trial.fit(&trial.flattened(gaussians, map), map));
        Ok(fit?.zip(shifted?).map(|(fit, shifted)| [fit, shifted]))
    }

    /// Shift, in pixels to the right and down, that aligns a rendering of flattened Gaussians with the photograph; zero if
    /// they cannot be rendered.
    pub(in crate::evaluate) fn flat_shift(
        &self,
        gaussians: &Gaussians,
        camera_from_file: DAffine3,
    ) -> Result<[f64; 2], RenderError> {
        let flat = self.flattened(gaussians, camera_from_file);
        let Some(output) = self.rendered(&flat, camera_from_file)? else {
            return Ok([0.0; 2]);
        };
        let part = self.region.part_of(self.photograph);
        Ok(shift(&part, &self.renderer.picture(&output)))
    }

    /// The Gaussians seen by the camera, each moved along its ray to the nearest of a few depths and scaled
    /// accordingly. Neighbours on a surface then mostly have the same depth and cover each other in random order.
    fn flattened(&self, gaussians: &Gaussians, camera_from_file: DAffine3) -> Gaussians {
        let seen = Seen::of(gaussians, camera_from_file, &self.intrinsics());
        let mut flat = gaussians.subset(&seen.members);
        let eye = camera_from_file.inverse().translation;
        for (mean, scales) in flat.means.iter_mut().zip(&mut flat.scales) {
            let place = DVec3::from(mean.map(f64::from));
            let z = camera_from_file.transform_point3(place).z;
            let factor = DEPTH_RATIO.powf(z.log(DEPTH_RATIO).round()) / z;
            *mean = (eye + factor * (place - eye)).as_vec3().to_array();
            *scales = scales.map(|scale| (f64::from(scale) * factor) as f32);
        }
        flat
    }
}
