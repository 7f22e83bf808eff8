//! Focal lengths that put matching features on each other's epipolar lines.

use glam::DVec2;
use sharp::camera::{Intrinsics, RigidTransform};

use super::super::advice::number;
use super::super::change::{Change, Focal};
use super::super::convention::CONVENTIONS;
use super::super::plausible::FOCAL_WIDTHS;
use super::super::search::{is_reportable, least};
use super::super::small_view::ray;
use super::{CLOSE, MIN_MORE, Matches, compared, miss, pixel, share};
use crate::View;

/// Other focal lengths are reported only if they explain at least this fraction of the matches.
const MIN_OF_FOCALS: f64 = 0.85;
/// Number of focal lengths tried in each direction (up to a factor of 6), then the ratio between consecutive ones.
const FOCALS: (i32, f64) = (52, 1.0353);
/// For fx or fy alone, the factor that makes pixels square is preferred to the best-fitting factor,
/// unless it lowers the fraction of explained matches by more than this.
const MAX_LOST_BY_SQUARE: f64 = 0.03;
/// Wrong focal lengths, as factors of the focal lengths read. If the matches determine the focal
/// length, each of these explains far fewer matches.
const OTHER_FOCALS: [f64; 2] = [0.8, 1.25];
/// Focal lengths whose relative difference is smaller are considered equal.
const MAX_SAME_DIFFERENCE: f64 = 0.02;

impl Matches<'_> {
    /// These matches, with the focal lengths of each view multiplied by `factors(view index)`.
    fn with_focals(&self, factors: impl Fn(usize) -> DVec2) -> Self {
        let cameras = self.cameras.iter().map(|(i, k)| {
            let (fx, fy) = (k.fx * factors(*i).x, k.fy * factors(*i).y);
            (*i, Intrinsics { fx, fy, ..*k })
        });
        Self {
            cameras: cameras.collect(),
            matches: self.matches.clone(),
            repeated: self.repeated.clone(),
            ..*self
        }
    }

    /// Tries swapping the focal lengths of the two groups of views that [`swapped_focals`] finds;
    /// returns which matches are then explained.
    pub(super) fn swapped_cameras(&self) -> Option<(Change, Vec<Option<bool>>)> {
        let (text, factors) = swapped_focals(self.views)?;
        let other = self.with_focals(|i| factors[i]);
        let explained = other.explained(CONVENTIONS[0].take, &Some);
        Some((Change::Cameras(text), explained))
    }

    /// The factor of fx, of fy, or of both that explains nearly all matches, and significantly more
    /// than the focal lengths read. If several factors do, the one that makes pixels closest to
    /// square.
    pub(super) fn other_focal(
        &self,
        as_read: &[Option<bool>],
    ) -> Option<(Change, Vec<Option<bool>>)> {
        let first = self.cameras.values().next()?;
        let found = Focal::ALL.iter().filter_map(|which| {
            let with = |factor| self.with_focals(|_| which.times(factor));
            let explained = |factor| with(factor).explained(CONVENTIONS[0].take, &Some);
            let is_plausible = |factor| {
                let times = which.times(factor);
                let both = [first.fx * times.x, first.fy * times.y].into_iter();
                both.map(|focal| focal / f64::from(first.width))
                    .all(|widths| FOCAL_WIDTHS.contains(&widths))
            };
            let best = least(FOCALS.0, FOCALS.1, &|factor, _| {
                if is_plausible(factor) {
                    with(factor).mean_miss(CONVENTIONS[0].take)
                } else {
                    f64::INFINITY
                }
            });
            // One focal length alone is measured less exactly, but usually equals the other.
            let square = match which {
                Focal::Both => best,
                Focal::X => first.fy / first.fx,
                Focal::Y => first.fx / first.fy,
            };
            let is_square =
                share(&explained(square)) >= share(&explained(best)) - MAX_LOST_BY_SQUARE;
            let factor = if is_square { square } else { best };
            let explained = explained(factor);
            let is_better = is_reportable(factor)
                && is_plausible(factor)
                && share(&explained) >= MIN_OF_FOCALS
                && compared(as_read, &explained).is_some();
            let times = which.times(factor);
            let stretch = (first.fx * times.x / (first.fy * times.y)).ln().abs();
            is_better.then_some((stretch, (Change::Focal(*which, factor), explained)))
        });
        let best = found.min_by(|a, b| a.0.total_cmp(&b.0));
        best.map(|(_, best)| best)
    }

    /// Mean distance of matches from their epipolar lines, in units of [`CLOSE`]. Distances above 1 count as 1. `take`
    /// converts the poses.
    pub(super) fn mean_miss(&self, take: fn(&RigidTransform) -> RigidTransform) -> f64 {
        let pose = |i: usize| take(&self.views[i].camera_from_world);
        let misses = self.matches.iter().map(|(i, a, b)| {
            let other_from_one = pose(i + 1).after(&pose(*i).inverse());
            let (one, other) = (&self.cameras[i], &self.cameras[&(i + 1)]);
            let near = CLOSE * pixel(other);
            (miss(&other_from_one, (ray(one, *a), ray(other, *b)), near) / near).min(1.0)
        });
        misses.sum::<f64>() / self.matches.len().max(1) as f64
    }

    /// True if the matches do not determine focal lengths, because clearly wrong ones explain about
    /// as many. `share` is the fraction of the matches that the focal lengths as read explain.
    pub(super) fn leaves_focals_open(&self, share: f64) -> bool {
        let mut others = Focal::ALL
            .iter()
            .flat_map(|which| OTHER_FOCALS.map(|by| which.times(by)));
        others.any(|times| {
            let other = self.with_focals(|_| times);
            self::share(&other.explained(CONVENTIONS[0].take, &Some)) > share - MIN_MORE
        })
    }
}

/// If the views have exactly two focal lengths: a description of a swap of the two, and each view's
/// factors.
pub(in crate::check) fn swapped_focals(views: &[View]) -> Option<(String, Vec<DVec2>)> {
    let focal = |view: &View| DVec2::new(view.intrinsics.fx, view.intrinsics.fy);
    let is_same = |a: DVec2, b: DVec2| (a / b - 1.0).abs().max_element() < MAX_SAME_DIFFERENCE;
    let one = views.first()?;
    let two = views
        .iter()
        .find(|view| !is_same(focal(view), focal(one)))?;
    let kinds = [one, two].map(focal);
    let is_known = |view: &View| kinds.iter().any(|kind| is_same(focal(view), *kind));
    let factor = |view: &View| kinds[usize::from(is_same(focal(view), kinds[0]))] / focal(view);
    let text = format!(
        "the focal lengths of {} ({} pixels) and {} ({}) appear to be swapped, also in all views with the same focal \
         lengths",
        one.id,
        number(kinds[0].x),
        two.id,
        number(kinds[1].x)
    );
    let has_two = views.iter().all(is_known);
    has_two.then(|| (text, views.iter().map(factor).collect()))
}

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use glam::{DMat3, DVec3};
    use sharp::camera::RigidTransform;

    use super::*;
    use crate::check::advice::Units;
    use crate::check::tests::views;

    const SIZE: (u32, u32) = (256, 192);

    /// Matches of views whose camera moves sideways or, if `forward`, ahead, and turns by `turn` from view to view.
    fn moving(views: &mut [View], turn: f64, forward: bool) -> Vec<(usize, DVec2, DVec2)> {
        for (i, view) in views.iter_mut().enumerate() {
            let at = i as f64;
            let sign = if i % 2 == 0 { 1.0 } else { -1.0 };
            view.camera_from_world = RigidTransform {
                rotation: DMat3::from_rotation_x(turn * sign) * DMat3::from_rotation_y(turn * at),
                translation: if forward {
                    DVec3::new(0.0, 0.0, -0.2 * at)
                } else {
                    DVec3::new(0.2 * at, 0.1 * sign, 0.0)
                },
            };
        }
        let random =
            |seed: usize| f64::from((seed as u32).wrapping_mul(2_654_435_761) >> 8) / 16_777_216.0;
        let all = (0..views.len() - 1).flat_map(|i| (0..60).map(move |k| (i, 180 * i + 3 * k)));
        let all = all.filter_map(|(i, seed)| {
            let (view, next) = (&views[i], &views[i + 1]);
            let size = DVec2::new(view.intrinsics.width.into(), view.intrinsics.height.into());
            let from = size * DVec2::new(random(seed), random(seed + 1));
            let point = view
                .intrinsics
                .unproject(from, 2.0 + 4.0 * random(seed + 2));
            let point = next
                .camera_from_world
                .after(&view.camera_from_world.inverse())
                .apply(point);
            let to = next.intrinsics.project(point)?;
            next.intrinsics.contains(to).then_some((i, from, to))
        });
        all.collect()
    }

    #[test]
    fn focal_lengths_are_named_where_features_tell_them() {
        let mut views = views(0, SIZE);
        let matches = moving(&mut views, 0.12, false);
        let read = |matches: &[(usize, DVec2, DVec2)], views: &[View], times: DVec2| {
            let cameras = views.iter().map(|view| view.intrinsics).enumerate();
            let right = Matches {
                views,
                cameras: cameras.collect(),
                matches: matches.to_vec(),
                repeated: BTreeSet::new(),
            };
            let wrong = right.with_focals(|_| times);
            (wrong.contradiction(Units::default()), wrong.note())
        };
        let (said, note) = read(&matches, &views, DVec2::ONE);
        assert!(said.is_none() && note.ends_with("lines"), "{said:?} {note}");
        for which in Focal::ALL {
            for factor in [0.225, 0.5, 0.75, 1.25, 2.0, 4.0] {
                let (said, _) = read(&matches, &views, which.times(factor));
                let name = ["the focal length", "fx", "fy"][which as usize];
                let part = format!("{name} should be {} times", number(1.0 / factor));
                assert!(
                    said.as_ref().is_some_and(|said| said.contains(&part)),
                    "{part}: {said:?}"
                );
            }
        }
        // Straight ahead, every focal length fits.
        let matches = moving(&mut views, 0.0, true);
        let (said, note) = read(&matches, &views, DVec2::splat(1.5));
        assert!(
            said.is_none() && note.ends_with("whether focal lengths are correct"),
            "{said:?} {note}"
        );
    }
}
