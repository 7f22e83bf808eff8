//! Compares shifts and focal lengths on flattened Gaussians: most neighbours have the same depth, so that none covers
//! the others systematically. For shifts, the colours at the Gaussians' centres must agree, too.
//!
//! On a slanted surface, each Gaussian is partly covered by nearer neighbours. Even if a file is read correctly, this
//! moves its rendering by up to a pixel, which must not be taken for a wrong shift or focal length.

use glam::{DAffine3, DVec3};
use image::imageops::interpolate_bilinear;
use sharp::color::srgb_from_linear;
use sharp::gaussians::Gaussians;
use sharp::ply::ColorSpace;
use sharp::render::RenderError;

use super::super::likeness::Likeness;
use super::super::registration::shift;
use super::{Seen, Trial};
use crate::methods::file_reading::{FileReading, Placement};

/// Ratio between successive depths to which Gaussians are moved.
const DEPTH_RATIO: f64 = 1.25;

/// A Gaussian is foremost if its depth is at most this multiple of the smallest depth in its pixel and the adjacent ones.
const FOREMOST: f64 = 1.05;

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

    /// Whether the foremost Gaussians have colours (their constant terms) that are closer to the photograph's at their
    /// centres under `placement` than under `before`. Unlike a rendering, this does not depend on how Gaussians cover each
    /// other. True if no centre lies in the photograph.
    pub(super) fn brings_colors_nearer(
        &self,
        gaussians: &Gaussians,
        before: &FileReading,
        placement: Placement,
    ) -> bool {
        let maps = [before.placement, placement].map(|place| place.camera_from_file(self.source));
        let is_linear = self
            .under(before)
            .rule
            .is_none_or(|rule| rule.blending == ColorSpace::Linear);
        let k = self.intrinsics();
        let (w, h) = (self.region.width, self.region.height);
        let place = |map: &DAffine3, mean: &[f32; 3]| {
            let p = map.transform_point3(DVec3::from(mean.map(f64::from)));
            let at = [k.fx * p.x / p.z + k.cx, k.fy * p.y / p.z + k.cy];
            (p.z > 0.0).then_some((at, p.z))
        };
        // The centres' places under both placements, and the smallest depth in each pixel.
        let mut nearest = vec![f64::INFINITY; w as usize * h as usize];
        let pixel = |[x, y]: [f64; 2]| {
            let is_inside =
                (1.0..f64::from(w) - 1.0).contains(&x) && (1.0..f64::from(h) - 1.0).contains(&y);
            is_inside.then_some(y as usize * w as usize + x as usize)
        };
        let mut centres = Vec::new();
        for (index, mean) in gaussians.means.iter().enumerate() {
            let [own, other] = [&maps[0], &maps[1]].map(|map| place(map, mean));
            if let (Some((own, z)), Some((other, _))) = (own, other)
                && let (Some(at), Some(_)) = (pixel(own), pixel(other))
            {
                nearest[at] = nearest[at].min(z);
                centres.push((index, at, z, [own, other]));
            }
        }
        let mut errors = [0.0; 2];
        for (index, at, z, places) in centres {
            // A pixel and its neighbours may be covered by the same surface.
            let row = w as usize;
            let around = [at - row, at - 1, at, at + 1, at + row];
            let front = around
                .map(|at| nearest[at])
                .into_iter()
                .fold(f64::INFINITY, f64::min);
            if z > FOREMOST * front {
                continue;
            }
            let color = gaussians.colors[index].map(|value| {
                let encoded = if is_linear {
                    srgb_from_linear(value)
                } else {
                    value
                };
                255.0 * f64::from(encoded.clamp(0.0, 1.0))
            });
            for (error, [x, y]) in errors.iter_mut().zip(places) {
                let [x, y] = [(x, self.region.x), (y, self.region.y)]
                    .map(|(place, first)| (place + f64::from(first) - 0.5) as f32);
                let seen = interpolate_bilinear(self.photograph, x, y);
                let off = seen.iter().flat_map(|seen| seen.0.into_iter().zip(color));
                *error += off
                    .map(|(seen, own)| (f64::from(seen) - own).powi(2))
                    .sum::<f64>();
            }
        }
        errors[0] == 0.0 && errors[1] == 0.0 || errors[1] < errors[0]
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
