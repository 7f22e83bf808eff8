//! Detection of depth maps that were clipped at a distance, normalised, or filled with a single value.

use std::cmp::Ordering;
use std::collections::BTreeMap;

use sharp::camera::RigidTransform;

use super::advice::{Units, number};
use super::explained::TOLERANCE;
use super::neighbours::Neighbours;
use super::small_view::Sample;

/// Depth counts as clipped only if at least this fraction of its values equal the maximum.
const MIN_LIMITED: f64 = 0.01;
/// Depth is judged only if at least this many positions have known depth.
const ENOUGH_LIMITED: usize = 100;
/// A point that has the maximum depth in two views contradicts the poses if the depth that the poses predict differs
/// from the maximum by more than this fraction.
const OFF_LIMIT: f64 = 0.002;
/// Like [`OFF_LIMIT`], in quantisation steps of the depth map at its maximum; the larger of the two
/// thresholds applies.
const OFF_STEPS: f64 = 2.0;
/// A value may stand for unknown depth only if at least this fraction of the depths have exactly this value.
const MIN_FILLED: f64 = 0.05;
/// If more than this fraction of the remaining depths differ between neighbouring views, poses or the whole depth are
/// wrong, rather than one value.
const MAX_OTHERS_OFF: f64 = 0.4;
/// The minimum of a normalised map, at the reduced size, is below this.
const MIN_NORMALISED: f64 = 0.1;
/// The maximum of a normalised map, at the reduced size, is at least this.
const MAX_NORMALISED: f64 = 0.9;

/// Two single-valued maps contradict each other if the relative difference of their depths exceeds this. For other
/// maps, the limit is [`TOLERANCE`].
const OFF_CONSTANT: f64 = 0.01;

/// Number of positions at which two views both have depth, and the number of these positions at
/// which the depths differ.
#[derive(Default)]
struct Met {
    all: usize,
    off: usize,
}

impl Met {
    fn are_mostly_off(&self) -> bool {
        self.all >= ENOUGH_LIMITED && 2 * self.off > self.all
    }

    fn percent_off(&self) -> f64 {
        100.0 * self.off as f64 / self.all as f64
    }
}

impl Neighbours<'_> {
    /// Projects samples of a view into its neighbour. `is_off` receives the sample's depth, its depth in the neighbour
    /// according to the poses and the depth found there, and returns whether the last two differ, or `None` to ignore
    /// the position.
    fn meet<'s>(
        &self,
        (a, b): (usize, usize),
        samples: impl Iterator<Item = &'s Sample>,
        is_off: impl Fn(f64, f64, f64) -> Option<bool>,
    ) -> Met {
        let ((from, _), (to, _)) = (&self.small[&a], &self.small[&b]);
        let to_from = self.to_from(a, b);
        let mut met = Met::default();
        for sample in samples {
            let point = to_from.apply(from.camera.unproject(sample.middle(), sample.depth));
            let place = to.camera.project(point);
            let place = place.filter(|place| to.camera.contains(*place));
            let there = place.and_then(|place| to.depth_at(place));
            if let Some(off) = there.and_then(|(there, _)| is_off(sample.depth, point.z, there)) {
                met.all += 1;
                met.off += usize::from(off);
            }
        }
        met
    }

    fn to_from(&self, a: usize, b: usize) -> RigidTransform {
        let pose = |i: usize| self.views[i].camera_from_world;
        pose(b).after(&pose(a).inverse())
    }

    /// Reports depth that was clipped: two neighbouring views both have the maximum depth at
    /// positions where, according to the poses, their depths should differ.
    pub(super) fn limited(&self) -> Option<String> {
        // The maximum depth and the next smaller one.
        let largest = |samples: &[Sample]| {
            samples.iter().fold((0.0, 0.0), |(most, next), one| {
                match one.depth.total_cmp(&most) {
                    Ordering::Greater => (one.depth, most),
                    Ordering::Less => (most, f64::max(next, one.depth)),
                    Ordering::Equal => (most, next),
                }
            })
        };
        let (mut all, mut met, mut limit) = (0, Met::default(), 0.0);
        for &(a, b) in &self.carries {
            let ((from, samples), (_, there)) = (&self.small[&a], &self.small[&b]);
            all += samples.len();
            let ((most, next), (most_there, next_there)) = (largest(samples), largest(there));
            // If the maximum is so far away that both views see it in the same direction, it may represent the sky.
            let moves = self.to_from(a, b).translation.length() * from.camera.fx > most;
            if most != most_there || !moves {
                continue;
            }
            limit = most;
            let step = 1.0 - next.max(next_there) / most;
            let least = OFF_LIMIT.max(OFF_STEPS * step);
            let at_limit = samples.iter().filter(|sample| sample.depth == most);
            let found = self.meet((a, b), at_limit, |_, z, there| {
                (there == most).then(|| (z / most - 1.0).abs() > least)
            });
            met.all += found.all;
            met.off += found.off;
        }
        let enough = met.all as f64 >= MIN_LIMITED * all as f64;
        (enough && met.are_mostly_off()).then(|| {
            format!(
                "depth is clipped at {} m (of {} points with exactly this depth in two neighbouring views, {:.0} % \
                 cannot have the same depth in both); store 0 where depth is unknown",
                number(limit),
                met.all,
                met.percent_off()
            )
        })
    }

    /// Reports a value that stands for unknown depth: many depths have exactly this value, most of them differ from those of
    /// the neighbouring views, and most other depths do not.
    pub(super) fn filled(&self) -> Option<String> {
        let samples = self.small.values().flat_map(|(_, samples)| samples);
        let depths = samples.map(|sample| sample.depth);
        let mut counts: BTreeMap<u64, usize> = BTreeMap::new();
        let mut all = 0;
        for depth in depths {
            *counts.entry(depth.to_bits()).or_default() += 1;
            all += 1;
        }
        let (bits, count) = counts.into_iter().max_by_key(|(_, count)| *count)?;
        let value = f64::from_bits(bits);
        let share = count as f64 / all as f64;
        if share < MIN_FILLED {
            return None;
        }
        // Positions where one of the two depths has this value, or neither has. If both have it, they may see the sky or a
        // wall.
        let met = |is_filled: bool| {
            let mut met = Met::default();
            for &(a, b) in &self.carries {
                let samples = self.small[&a].1.iter();
                let found = self.meet((a, b), samples, |own, z, there| {
                    let off = (z / there - 1.0).abs() > TOLERANCE;
                    match (own == value, there == value) {
                        (true, true) => is_filled.then_some(false),
                        (false, false) => (!is_filled).then_some(off),
                        _ => is_filled.then_some(off),
                    }
                });
                met.all += found.all;
                met.off += found.off;
            }
            met
        };
        let (filled, others) = (met(true), met(false));
        let others_fit =
            others.all >= ENOUGH_LIMITED && others.off as f64 <= MAX_OTHERS_OFF * others.all as f64;
        (filled.are_mostly_off() && others_fit).then(|| {
            format!(
                "{:.0} % of the depths are exactly {} m; {:.0} % of these differ from the depths of neighbouring views, \
                 against {:.0} % of all others, so this value probably stands for unknown depth; store 0 there",
                100.0 * share,
                number(value),
                filled.percent_off(),
                others.percent_off()
            )
        })
    }

    /// Lists views whose depth maps contain a single value that their neighbours contradict. (A wall parallel to the
    /// picture also has a single depth, but no contradiction.)
    pub(super) fn constant(&self) -> Option<String> {
        let is_constant = |i: usize| {
            let (_, samples) = &self.small[&i];
            samples.iter().all(|one| one.depth == samples[0].depth)
        };
        let constant: Vec<_> = self
            .carries
            .iter()
            .filter(|(a, _)| is_constant(*a))
            .collect();
        let contradicted = constant.iter().filter(|(a, b)| {
            let least = if is_constant(*b) {
                OFF_CONSTANT
            } else {
                TOLERANCE
            };
            let samples = self.small[a].1.iter();
            let met = self.meet((*a, *b), samples, |_, z, there| {
                Some((z / there - 1.0).abs() > least)
            });
            met.are_mostly_off()
        });
        let (i, _) = contradicted.min()?;
        let which = if constant.len() == self.carries.len() {
            "each view"
        } else {
            &self.views[*i].id
        };
        let depth = number(self.small[i].1[0].depth);
        Some(format!(
            "the depth map of {which} contains a single value, {depth} m, which contradicts the poses of the \
             neighbouring views"
        ))
    }

    /// Reports depth maps that range from 0 to 1 of their unit.
    pub(super) fn normalised(&self, units: Units) -> Option<String> {
        let one = units.depth_unit_m();
        let is_normalised = |(_, samples): &(_, Vec<Sample>)| {
            let depths = samples.iter().map(|sample| sample.depth / one);
            let (least, most) = depths.fold((f64::INFINITY, 0.0), |(least, most), depth| {
                (f64::min(least, depth), f64::max(most, depth))
            });
            samples.len() >= ENOUGH_LIMITED
                && least < MIN_NORMALISED
                && (MAX_NORMALISED..=1.0 + 1e-6).contains(&most)
        };
        self.small.values().all(is_normalised).then(|| {
            "every depth map ranges from 0 to 1, so depth was normalised per map and has no unit; store metres".to_owned()
        })
    }
}
