//! Depth maps that were taken by another camera: shifted relative to the photographs, or with another field of view.

use glam::DVec2;

use super::change::Change;
use super::compare::{forward, mean_loss};
use super::explained::{Explained, Reading, Registration};
use super::neighbours::Neighbours;
use super::search::is_reportable;

/// Offset that is tried first, in widths of the picture. If neither this offset nor [`PROBED_ZOOM`]
/// improves the fit, the depth maps count as aligned with the photographs, and no search follows.
const PROBE: f64 = 0.02;
/// Magnification that is tried first.
const PROBED_ZOOM: f64 = 1.1;
/// Number of steps in the search for the offset, then the ratio between consecutive factors. An offset is a tenth of
/// the logarithm of its factor, in widths.
const OFFSETS: (i32, f64) = (10, 1.12);
/// Number of steps in the search for the magnification, then the ratio between consecutive
/// magnifications.
const ZOOMS: (i32, f64) = (12, 1.035);
/// Smallest reported offset, in widths of the picture.
const MIN_OFF: f64 = 0.008;
/// Maximum offset along an axis, in widths of the picture.
const MAX_OFF: f64 = 0.12;
/// Maximum magnification, and maximum reduction, of a depth map.
const MAX_ZOOM: f64 = 1.6;
/// A registration is accepted only if it reduces colour differences to at most this fraction. Only
/// colours show that a depth map is misplaced.
const MAX_LEFT: f64 = 0.9;
/// A registration is accepted only if the remaining colour differences are at most this fraction of the differences
/// between unrelated places.
const MAX_UNEXPLAINED: f64 = 0.75;

const fn with(depth_at: Registration) -> Reading {
    Reading {
        depth_at,
        ..Reading::AS_READ
    }
}

fn moved(by: Registration, axis: DVec2, width: f64) -> Registration {
    Registration {
        off: by.off + width * axis,
        ..by
    }
}

fn zoomed(by: Registration, factor: f64) -> Registration {
    Registration {
        zoom: by.zoom * factor,
        ..by
    }
}

impl Neighbours<'_> {
    /// The shift and magnification with which depth maps fit the pictures best. `None` if no registration is accepted,
    /// or if depth belongs to the poses.
    pub(super) fn registered(&self, as_read: &[Explained]) -> Option<(Change, Vec<Explained>)> {
        if self.depth_by_pose {
            return None;
        }
        let same = Registration::SAME;
        let loss = |at: Registration| mean_loss(&self.explained(&with(at), self.stride));
        let shifts = [DVec2::X, DVec2::NEG_X, DVec2::Y, DVec2::NEG_Y];
        let shifts = shifts.map(|axis| loss(moved(same, axis, PROBE)));
        let zooms = [PROBED_ZOOM, 1.0 / PROBED_ZOOM].map(|factor| loss(zoomed(same, factor)));
        let [shift, zoom] =
            [&shifts[..], &zooms[..]].map(|all| all.iter().copied().fold(1.0, f64::min));
        if shift.min(zoom) >= mean_loss(as_read) {
            return None;
        }
        let mut found = same;
        for zooms in [zoom < shift, zoom >= shift, zoom < shift] {
            found = if zooms {
                let factor = self.fit(ZOOMS.0, ZOOMS.1, &|factor| with(zoomed(found, factor)));
                zoomed(found, factor)
            } else {
                [DVec2::X, DVec2::Y].into_iter().fold(found, |found, axis| {
                    let to = |factor: f64| moved(found, axis, 0.1 * factor.ln());
                    to(self.fit(OFFSETS.0, OFFSETS.1, &|factor| with(to(factor))))
                })
            };
        }
        if !is_reportable(found.zoom) {
            found.zoom = 1.0;
        }
        if found.off.length() < MIN_OFF {
            found.off = DVec2::ZERO;
        }
        let is_far =
            found.off.abs().max_element() > MAX_OFF || found.zoom.ln().abs() > MAX_ZOOM.ln();
        if found == same || is_far {
            return None;
        }
        let explained = self.explained(&with(found), self.stride);
        let levels = [as_read, &explained].map(|all| forward(all).colour_levels());
        let is_nearer = matches!(levels, [Some(read), Some(other)] if other <= MAX_LEFT * read);
        let is_near = is_nearer && self.unexplained(&explained) <= MAX_UNEXPLAINED;
        is_near.then_some((Change::Registered(found), explained))
    }
}
