//! Depth maps whose values tell what was done to them: cut off at a distance, normalised, or all the same.

use std::cmp::Ordering;

use super::advice::{Units, number};
use super::fit::Neighbours;
use super::small_view::Sample;

/// Depths at the largest value, of all: fewer, or fewer than so many, are no sign of a limit.
const LEAST_LIMITED: f64 = 0.01;
const ENOUGH_LIMITED: usize = 100;
/// Least relative difference of such a depth from the other view's, and its least number of the map's steps at that depth.
const OFF_LIMIT: f64 = 0.002;
const OFF_STEPS: f64 = 2.0;
/// Least and largest depth of a normalised map at the reduced size.
const LEAST_NORMALISED: f64 = 0.1;
const MOST_NORMALISED: f64 = 0.9;

impl Neighbours<'_> {
    /// The largest depth, where depth was cut off at it: both of two neighbouring views have it in places where the other
    /// one's poses make it another.
    pub(super) fn limited(&self) -> Option<String> {
        // The largest depth and the next one.
        let largest = |samples: &[Sample]| {
            samples.iter().fold((0.0, 0.0), |(most, next), one| {
                match one.depth.total_cmp(&most) {
                    Ordering::Greater => (one.depth, most),
                    Ordering::Less => (most, f64::max(next, one.depth)),
                    Ordering::Equal => (most, next),
                }
            })
        };
        let (mut all, mut met, mut off, mut limit) = (0, 0, 0, 0.0);
        for (a, b) in &self.carries {
            let ((from, samples), (to, there)) = (&self.small[a], &self.small[b]);
            all += samples.len();
            let ((most, next), (most_there, next_there)) = (largest(samples), largest(there));
            let pose = |i: &usize| self.views[*i].camera_from_world;
            let to_from = pose(b).after(&pose(a).inverse());
            // So far away that the views show it in one direction, it may stand for a sky.
            let moves = to_from.translation.length() * from.camera.fx > most;
            if most != most_there || !moves {
                continue;
            }
            limit = most;
            let step = 1.0 - next.max(next_there) / most;
            let least = OFF_LIMIT.max(OFF_STEPS * step);
            for sample in samples.iter().filter(|sample| sample.depth == most) {
                let point = to_from.apply(from.camera.unproject(sample.middle(), most));
                let place = to.camera.project(point);
                let place = place.filter(|place| to.camera.contains(*place));
                let depth = place.and_then(|place| to.depth_at(place));
                if depth.is_some_and(|(depth, _)| depth == most) {
                    met += 1;
                    off += usize::from((point.z / most - 1.0).abs() > least);
                }
            }
        }
        let enough = met >= ENOUGH_LIMITED && met as f64 >= LEAST_LIMITED * all as f64;
        (enough && 2 * off > met).then(|| {
            format!(
                "depth is cut off at {} m: {:.0} % of {met} places with exactly that depth in two neighbouring views \
                 cannot have it in both; store 0 where depth is not known",
                number(limit),
                100.0 * off as f64 / met as f64
            )
        })
    }

    /// Names a view whose depth map holds a single value, as of real scenes only a wall parallel to the picture gives.
    pub(super) fn constant(&self) -> Option<String> {
        let is_constant = |(_, samples): &(_, Vec<Sample>)| {
            samples.len() >= ENOUGH_LIMITED
                && samples.iter().all(|one| one.depth == samples[0].depth)
        };
        let (i, (_, samples)) = self.small.iter().find(|(_, read)| is_constant(read))?;
        let all = if self.small.values().all(is_constant) {
            "each map"
        } else {
            &self.views[*i].id
        };
        let depth = number(samples[0].depth);
        Some(format!(
            "the depth is the same in all pixels of {all}, {depth} m: no measured depth is"
        ))
    }

    /// Depth maps that run from 0 to 1 of their unit.
    pub(super) fn normalised(&self, units: Units) -> Option<String> {
        let one = units.depth_unit_m();
        let is_normalised = |(_, samples): &(_, Vec<Sample>)| {
            let depths = samples.iter().map(|sample| sample.depth / one);
            let (least, most) = depths.fold((f64::INFINITY, 0.0), |(least, most), depth| {
                (f64::min(least, depth), f64::max(most, depth))
            });
            samples.len() >= ENOUGH_LIMITED
                && least < LEAST_NORMALISED
                && (MOST_NORMALISED..=1.0 + 1e-6).contains(&most)
        };
        self.small.values().all(is_normalised).then(|| {
            "every depth map runs from 0 to 1: depth was normalised map by map and is in no unit; store metres".to_owned()
        })
    }
}
