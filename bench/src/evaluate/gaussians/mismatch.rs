//! Detects Gaussians that were transformed wrongly in a way that no setting corrects.

use glam::{DAffine3, DMat3, DQuat, DVec3};
use sharp::gaussians::Gaussians;
use sharp::render::RenderError;

use super::likeness::{Likeness, between_pixels};
use super::rereading::{MIN_FACING_AREA, MIN_NARROWER_GAIN_DB, Seen, Trial};
use crate::methods::file_reading::{Axes, FileReading, FileSpace, Placement};
use crate::pairs::PosedCamera;

/// Factors by which standard deviations are multiplied to find a better match.
const WIDTHS: [f64; 9] = [1.0 / 3.0, 0.1, 0.01, 0.001, 2.0, 3.0, 10.0, 100.0, 1000.0];
/// Minimum gain for reporting a part that was not turned with the rest, in dB. Correct Gaussians that leave gaps gain less
/// if they are turned.
const MIN_TURN_GAIN_DB: f64 = 2.0;
/// Minimum gain for reporting wider standard deviations, in dB. Correct Gaussians with holes gain less.
const MIN_WIDER_GAIN_DB: f64 = 6.0;
/// Minimum gain for reporting a factor of the standard deviations that comparing depths suggests, in dB.
const MIN_WIDTHS_GAIN_DB: f64 = 1.0;
/// Widened Gaussians are not tried if more than this number of them cover a pixel on average.
const MAX_LAYERS: f64 = 300.0;
/// Narrower Gaussians are not tried if their total area (see [`Trial::overlap`]) is below this share of the picture.
const MIN_OVERLAP: f64 = 0.5;
/// Minimum angle of the rotations that are tried, in degrees.
const MIN_TURN_DEG: f64 = 3.0;

/// A part of Gaussians that may not have been turned with the rest.
#[derive(Clone, Copy, PartialEq)]
pub(in crate::evaluate) enum Part {
    Quaternions,
    Harmonics,
}

impl Trial<'_> {
    /// Compares with the photograph after multiplying standard deviations by a factor; `None` unless this is
    /// significantly better than `as_read`.
    pub(in crate::evaluate) fn fit_with_widths(
        &self,
        gaussians: &Gaussians,
        factor: f64,
        reading: &FileReading,
        as_read: &Likeness,
    ) -> Result<Option<Likeness>, RenderError> {
        let other = with_widths(gaussians, factor);
        let fit = self.fit(&other, reading.placement.camera_from_file(self.source))?;
        Ok(fit.filter(|fit| {
            fit.is_better_than(as_read) && fit.gain_over(as_read) >= MIN_WIDTHS_GAIN_DB
        }))
    }

    /// The factor of the standard deviations with which the Gaussians match the source far better than as read; `None`
    /// if no factor does. Factors below 1 are tried only if the rendering is blurred. The first of them that matches is
    /// taken, because still narrower Gaussians, drawn as mere centres, would resemble the source even more.
    pub(in crate::evaluate) fn other_widths(
        &self,
        gaussians: &Gaussians,
        reading: &FileReading,
        as_read: &Likeness,
        is_blurred: bool,
        elsewhere: &[Trial<'_>],
    ) -> Result<Option<(f64, Likeness)>, RenderError> {
        let map = reading.placement.camera_from_file(self.source);
        let mut best: Option<(f64, Likeness)> = None;
        for factor in WIDTHS
            .into_iter()
            .filter(|factor| *factor > 1.0 || is_blurred)
        {
            if best.as_ref().is_some_and(|(known, _)| *known < 1.0) {
                break;
            }
            let other = with_widths(gaussians, factor);
            if factor > 1.0 && Seen::of(&other, map, &self.source.intrinsics).layers > MAX_LAYERS {
                break;
            }
            // Narrower Gaussians that no longer cover the picture copy its noise.
            if factor < 1.0 && self.overlap(&other, reading.placement) < MIN_OVERLAP {
                break;
            }
            let least = if factor < 1.0 {
                MIN_NARROWER_GAIN_DB
            } else {
                MIN_WIDER_GAIN_DB
            };
            if let Some(fit) = self.fit(&other, map)?
                && fit.is_better_than(as_read)
                && fit.gain_over(as_read) >= least
                && best
                    .as_ref()
                    .is_none_or(|(_, known)| fit.error() < known.error())
                && (factor > 1.0 || self.fits_between([gaussians, &other], map)?)
                && self.is_borne_out([(gaussians, map), (&other, map)], reading, elsewhere)?
            {
                best = Some((factor, fit));
            }
        }
        Ok(best)
    }

    /// Whether narrower Gaussians fit the photograph better than `gaussians` at the corners of its pixels, too. At the
    /// centres, narrow Gaussians copy the photograph's noise.
    pub(super) fn fits_between(
        &self,
        [gaussians, narrower]: [&Gaussians; 2],
        camera_from_file: DAffine3,
    ) -> Result<bool, RenderError> {
        let between = between_pixels(self.photograph);
        let moved = Trial {
            photograph: &between,
            moved: [0.5; 2],
            ..*self
        };
        let [own, other] = [gaussians, narrower].map(|of| moved.fit(of, camera_from_file));
        Ok(matches!((own?, other?), (Some(own), Some(other)) if other.gain_over(&own) > 0.0))
    }

    /// Turns `part` of the Gaussians by each of [`Self::turns`]. If the best match is significantly better than `as_read`,
    /// returns its angle, in degrees, and its comparison: the other parts were probably turned without this one.
    pub(in crate::evaluate) fn other_turn(
        &self,
        gaussians: &Gaussians,
        part: Part,
        reading: &FileReading,
        as_read: &Likeness,
        elsewhere: &[Trial<'_>],
    ) -> Result<Option<(f64, Likeness)>, RenderError> {
        let placement = reading.placement;
        let map = placement.camera_from_file(self.source);
        let own_area = self.mean_area(gaussians, placement);
        let mut best: Option<(f64, Likeness)> = None;
        let shows_harmonics =
            gaussians.harmonics.degree > 0 && self.rule.is_some_and(|rule| rule.degree > 0);
        if part == Part::Harmonics && !shows_harmonics {
            return Ok(best);
        }
        for turn in self.turns(placement) {
            let mut other = with_turned_quaternions(gaussians, turn);
            let mut other_map = map;
            if part == Part::Harmonics {
                // Turning all else, and the camera backwards, turns the harmonics.
                for mean in &mut other.means {
                    let turned = turn * DVec3::from(mean.map(f64::from));
                    *mean = turned.as_vec3().to_array();
                }
                other_map *= DAffine3::from_quat(turn.inverse());
            } else if self.mean_area(&other, placement) < MIN_FACING_AREA * own_area {
                // Turns that show the Gaussians more edge-on would only sharpen a rendering whose Gaussians are too wide.
                continue;
            }
            if let Some(fit) = self.fit(&other, other_map)?
                && fit.is_better_than(as_read)
                && fit.gain_over(as_read) >= MIN_TURN_GAIN_DB
                && best
                    .as_ref()
                    .is_none_or(|(_, known)| fit.error() < known.error())
                && self.is_borne_out([(gaussians, map), (&other, other_map)], reading, elsewhere)?
            {
                best = Some((degrees(turn), fit));
            }
        }
        Ok(best)
    }

    /// Compares Gaussians in world space, placed by the inverse of the source's pose, with the photograph; `None`
    /// unless this is significantly better than `as_read`.
    pub(in crate::evaluate) fn fit_with_inverse_pose(
        &self,
        gaussians: &Gaussians,
        reading: &FileReading,
        as_read: &Likeness,
    ) -> Result<Option<Likeness>, RenderError> {
        if reading.placement.space != FileSpace::World {
            return Ok(None);
        }
        let inverse = PosedCamera {
            camera_from_world: self.source.camera_from_world.inverse(),
            ..self.source.clone()
        };
        let fit = self.fit(gaussians, reading.placement.camera_from_file(&inverse))?;
        Ok(fit.filter(|fit| fit.is_better_than(as_read)))
    }

    /// Rotations to try: those of the whole placement, of the source's pose and of `transform=`, each in both
    /// directions, and half turns about the axes.
    fn turns(&self, placement: Placement) -> Vec<DQuat> {
        let rigid = Placement {
            shift: [0.0; 2],
            focal: [1.0; 2],
            ..placement
        };
        let world = Placement {
            space: FileSpace::World,
            ..Placement::default()
        };
        let own = Placement {
            space: FileSpace::Camera,
            axes: Axes::OPENCV,
            ..rigid
        };
        let mut all: Vec<DQuat> = [DVec3::X, DVec3::Y, DVec3::Z]
            .map(|axis| DQuat::from_axis_angle(axis, std::f64::consts::PI))
            .into();
        for placement in [rigid, world, own] {
            let turn = rotation(placement.camera_from_file(self.source).matrix3);
            all.extend([turn, turn.inverse()]);
        }
        let mut kept: Vec<DQuat> = Vec::new();
        for turn in all {
            let is_new = kept
                .iter()
                .all(|known| degrees(turn * known.inverse()) > MIN_TURN_DEG);
            if is_new && degrees(turn) > MIN_TURN_DEG {
                kept.push(turn);
            }
        }
        kept
    }
}

/// Gaussians with all standard deviations multiplied by a factor.
fn with_widths(gaussians: &Gaussians, factor: f64) -> Gaussians {
    let mut other = gaussians.clone();
    let scales = other.scales.as_flattened_mut().iter_mut();
    scales.for_each(|scale| *scale *= factor as f32);
    other
}

fn with_turned_quaternions(gaussians: &Gaussians, turn: DQuat) -> Gaussians {
    let mut other = gaussians.clone();
    for quaternion in &mut other.quaternions {
        let [w, x, y, z] = quaternion.map(f64::from);
        let turned = turn * DQuat::from_xyzw(x, y, z, w);
        *quaternion = [turned.w, turned.x, turned.y, turned.z].map(|v| v as f32);
    }
    other
}

/// The rotation of a similarity. If the similarity mirrors, returns the rotation of its negative, which turns Gaussians
/// in the same way.
fn rotation(matrix: DMat3) -> DQuat {
    let scale = matrix.determinant().cbrt();
    DQuat::from_mat3(&(matrix * scale.recip())).normalize()
}

fn degrees(turn: DQuat) -> f64 {
    2.0 * turn.w.abs().min(1.0).acos().to_degrees()
}
