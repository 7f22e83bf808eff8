//! Tries alternative interpretations of a scene's poses, cameras and depth to find one that explains pictures and depth
//! significantly better than the dataset reader's own interpretation.

use glam::DVec2;

use super::THOROUGH;
use super::advice::{self, Units};
use super::change::{Better, Change, Focal};
use super::compare::{
    MIN_GAIN, MIN_GAIN_OF_FACTORS, agrees, fits_well, forward, is_better, is_better_by, is_needed,
    is_plain, is_refuted, is_suspicious, landed, mean_loss,
};
use super::convention::alternatives;
use super::explained::{DepthIs, Explained, Reading};
use super::features::swapped_focals;
use super::floor::MISPLACED_SCAN;
use super::neighbours::Neighbours;
use super::plausible::{self, ONE_ROTATION, have_one_rotation};
use super::search::{is_reportable, least};
use super::small_view::{FLIPS, Part, SmallView, WIDEST};

/// Number of steps in each direction in the search for the principal point.
const CENTRES: i32 = 10;
/// Ratio between consecutive factors in the search for the principal point, which reuses the search for factors: a
/// factor f stands for an offset of ln(f) / 10 widths of the picture.
const CENTRE_STEP: f64 = 1.12;
/// Maximum number of searches per axis. If the best value is at the end of the searched range,
/// another search starts there.
const CENTRE_SEARCHES: usize = 3;
/// Smallest reported offset of a principal point, in widths of the picture.
const MIN_OFF: f64 = 0.004;

/// Colour differences count as explained if they are at most this fraction of the differences
/// between unrelated places.
const MAX_EXPLAINED_COLOURS: f64 = 0.8;
/// Colour differences above [`MAX_EXPLAINED_COLOURS`] count as explained only if they are at most
/// this fraction of the differences under the reader's interpretation.
const MAX_COLOURS_LEFT: f64 = 0.75;
/// Colour differences above this multiple of the differences between unrelated places never count as explained.
const MAX_COLOURS: f64 = 1.0;
/// If more than this fraction of the loss remains after a change, rounded poses are considered a likelier cause than
/// the error that the change corrects.
const MAX_LOSS_LEFT: f64 = 0.75;
/// Factors of fx or fy alone are large if they are above this value or below its reciprocal.
const LARGE_FACTOR: f64 = 1.25;
/// A large factor of fx or fy alone is accepted only if it reduces colour differences to this fraction or less.
const MAX_LEFT_BY_LARGE_FACTOR: f64 = 0.6;

/// Samples per view in the coarse part of a search for a factor.
const COARSE_SAMPLES: usize = 600;
/// Samples per view in the fine part of a search for a factor, for a quick check.
const FINE_SAMPLES: usize = 800;
/// Like [`FINE_SAMPLES`], for a thorough check, which determines factors more exactly.
const THOROUGH_SAMPLES: usize = 3000;

impl Neighbours<'_> {
    /// The interpretation that explains the views best; `None` if none is significantly better than the dataset
    /// reader's own.
    pub(super) fn better(&self, units: Units) -> Option<Better> {
        let as_read = self.explained(&Reading::AS_READ, self.stride);
        let mut all: Vec<(Change, Vec<Explained>)> = Vec::new();
        let mut fitted = |reading: &Reading, change: Change| {
            all.push((change, self.explained(reading, self.stride)));
        };
        for convention in alternatives(units.poses_are_matrices) {
            let reading = Reading {
                take: convention.take,
                ..Reading::AS_READ
            };
            fitted(&reading, Change::Convention(convention.name));
        }
        for depth in [DepthIs::Z, DepthIs::Inverse] {
            let with = |scale: f64| Reading {
                scale,
                depth,
                ..Reading::AS_READ
            };
            let scale = self.fit(50, 10_f64.powf(0.1), &with);
            if depth == DepthIs::Inverse {
                fitted(&with(scale), Change::Inverse(scale));
            } else if is_reportable(scale) {
                fitted(&with(scale), Change::Scale(scale));
            }
        }
        for which in Focal::ALL {
            let with = |factor: f64| Reading {
                focal: [which.times(factor); 2],
                ..Reading::AS_READ
            };
            // Calibrations for pictures four times as large or as small are common.
            let n = if which == Focal::Both { 42 } else { 20 };
            let factor = self.fit(n, 1.035, &with);
            if is_reportable(factor) {
                fitted(&with(factor), Change::Focal(which, factor));
            }
        }
        let bent = |factor: f64| factor.ln();
        let with_bend = |bend: f64| Reading {
            bend,
            ..Reading::AS_READ
        };
        let factor = self.fit(20, 1.035, &|factor| with_bend(bent(factor)));
        if is_reportable(factor) {
            let bend = bent(factor);
            fitted(&with_bend(bend), Change::Bent(bend));
        }
        let centre_swapped = Reading {
            centre_swapped: true,
            ..Reading::AS_READ
        };
        fitted(&centre_swapped, Change::CentreSwapped);
        let off = self.centre_off();
        if off != DVec2::ZERO {
            let reading = Reading {
                centre_off: off,
                ..Reading::AS_READ
            };
            fitted(&reading, Change::CentreOff(off));
        }
        let with_depth = |depth: DepthIs| Reading {
            depth,
            ..Reading::AS_READ
        };
        fitted(&with_depth(DepthIs::RayLength), Change::RayLength);
        fitted(&with_depth(DepthIs::NoRayLength), Change::NoRayLength);
        let median_m = self.median_depth();
        let short = |factor: f64| (factor - 1.0) * median_m;
        let factor = self.fit(20, 1.035, &|factor| {
            with_depth(DepthIs::Short(short(factor)))
        });
        if is_reportable(factor) {
            let by = short(factor);
            fitted(&with_depth(DepthIs::Short(by)), Change::Short(by));
        }
        all.extend(self.swapped_cameras());
        all.extend(self.orders(&as_read));
        all.extend(self.turned());
        all.extend(self.flipped());
        all.extend(self.registered(&as_read));
        // If depths agree under the reader's interpretation, a candidate must also be better than the assumption that
        // the camera did not move.
        let still = Reading {
            scale: 0.0,
            ..Reading::AS_READ
        };
        let still = agrees(&as_read).then(|| self.explained(&still, self.stride));
        // The points of a scan give depth itself, never another function of it.
        let is_possible = |change: &Change| {
            let is_function = matches!(
                change,
                Change::Inverse(_)
                    | Change::RayLength
                    | Change::NoRayLength
                    | Change::Short(_)
                    | Change::Buffer(_)
                    | Change::InverseBetween(..)
                    | Change::Planes { .. }
            );
            !(self.depth_by_pose && is_function)
        };
        let is_candidate = |(change, other): &(Change, Vec<Explained>)| {
            is_possible(change)
                && is_better_by(&as_read, other, change.least_gain())
                && !is_refuted(&as_read, other, matches!(change, Change::Order(..)))
                && !(matches!(change, Change::Flipped(..)) && is_plain(&as_read, other))
                && is_needed(&as_read, other, change.shows_in_colours())
                && still
                    .as_ref()
                    .is_none_or(|still| is_better(still, other, MIN_GAIN_OF_FACTORS))
        };
        let by_loss = |one: &(Change, Vec<Explained>), other: &(Change, Vec<Explained>)| {
            mean_loss(&one.1).total_cmp(&mean_loss(&other.1))
        };
        let simple = all.into_iter().filter(is_candidate);
        let simple = simple.chain(self.one_view(&as_read)).min_by(by_loss);
        let is_poor = simple.is_some()
            || is_suspicious(&as_read)
            || self.unexplained(&as_read) > MAX_EXPLAINED_COLOURS;
        // The following changes have more degrees of freedom, so they must also be better than the
        // simpler changes above.
        let complex = self
            .some_views()
            .into_iter()
            .chain(self.elsewhere(&as_read))
            .chain(is_poor.then(|| self.z_buffer()))
            .chain(is_poor.then(|| self.inverse_between()))
            .chain(is_poor.then(|| self.between_planes()));
        let complex: Vec<_> = complex.filter(is_candidate).collect();
        let is_poor = is_poor || !complex.is_empty();
        let shifted = is_poor.then(|| self.shifted(&as_read)).flatten();
        let complex = complex.into_iter().chain(shifted.filter(is_candidate));
        let complex = complex.min_by(by_loss);
        let complex = complex.filter(|(_, complex)| {
            let simple = simple.as_ref();
            simple.is_none_or(|(_, simple)| is_better(simple, complex, MIN_GAIN))
        });
        let best = complex.or(simple);
        best.map(|(change, explained)| Better {
            as_read: forward(&as_read),
            explained: forward(&explained),
            fits_well: fits_well(&explained) && self.mends(&change, &as_read, &explained),
            is_slight: mean_loss(&explained) > MAX_LOSS_LEFT * mean_loss(&as_read),
            change,
        })
    }

    /// True if depth and colours fit significantly better with the principal points as read than with centred ones.
    pub(super) fn confirm_centre(&self) -> bool {
        let Some(k) = self.views.first().map(|view| view.intrinsics) else {
            return false;
        };
        let middle = DVec2::new(f64::from(k.width), f64::from(k.height)) / 2.0;
        let centred = Reading {
            centre_off: (middle - DVec2::new(k.cx, k.cy)) / f64::from(k.width),
            ..Reading::AS_READ
        };
        let [as_read, centred] =
            [Reading::AS_READ, centred].map(|of| self.explained(&of, self.stride));
        !is_suspicious(&as_read) && is_better(&centred, &as_read, MIN_GAIN)
    }

    /// Describes a contradiction between the views' poses, cameras, depth and pictures; `None` if
    /// there is none.
    pub(super) fn contradictions(&self, units: Units) -> Option<String> {
        let median_m = self.median_depth();
        let values = self.normalised(units).or_else(|| self.limited());
        let values = values.or_else(|| self.constant());
        if let Some(values) = values.or_else(|| self.filled()) {
            return Some(values);
        }
        let rounded = plausible::rounded(self.views, units);
        let unexplained = |text: String| {
            if have_one_rotation(self.views) {
                ONE_ROTATION.to_owned()
            } else if self.depth_by_pose {
                format!("{text}; {MISPLACED_SCAN}")
            } else {
                text + rounded.as_deref().unwrap_or_default()
            }
        };
        let better = self.better(units);
        let is_open = better
            .as_ref()
            .is_some_and(|better| better.change.needs_more_views());
        if is_open && !self.thorough {
            return Self::new(self.views, THOROUGH)?.contradictions(units);
        }
        match better {
            Some(better) => {
                let evidence = advice::evidence(&better.as_read, &better.explained);
                let is_doubtful = better.is_slight
                    || matches!(better.change, Change::Focal(Focal::X | Focal::Y, _));
                let is_cause = better.fits_well && !(is_doubtful && rounded.is_some());
                Some(if is_cause {
                    advice::sentence(&better.change, &evidence, units, median_m, self.views)
                } else {
                    unexplained(format!(
                        "poses, cameras, pictures and depth are inconsistent, and no single correction that was \
                         tried explains it (with the best one, {evidence})"
                    ))
                })
            }
            None => {
                let disagreement = || Some(unexplained(self.consistency()?.disagreement()?));
                plausible::depth(median_m, units).or_else(disagreement)
            }
        }
    }

    /// False if pictures still look unrelated under another interpretation and their colour differences hardly
    /// decrease. In that case, the change corrects the wrong quantity, or only one of several.
    fn mends(&self, change: &Change, as_read: &[Explained], other: &[Explained]) -> bool {
        let (before, after) = (self.unexplained(as_read), self.unexplained(other));
        match change {
            Change::Unlisted => false,
            // Correcting a large error should leave small differences.
            Change::Focal(Focal::X | Focal::Y, factor) if factor.ln().abs() > LARGE_FACTOR.ln() => {
                after <= MAX_LEFT_BY_LARGE_FACTOR * before
            }
            _ => {
                after <= MAX_EXPLAINED_COLOURS
                    || after <= MAX_COLOURS_LEFT * before && after <= MAX_COLOURS
            }
        }
    }

    /// Tries depth that was normalised to a range between two distances, i.e. has another offset
    /// and another unit.
    fn between_planes(&self) -> (Change, Vec<Explained>) {
        let median_m = self.median_depth();
        let short = |factor: f64| (factor - 1.0) * median_m;
        // `factor`: ratio of the median depth with the offset to the median depth without it. `scale`: factor of the
        // translations if there were no offset.
        let with = |scale: f64, factor: f64| Reading {
            scale: scale * factor,
            depth: DepthIs::Short(short(factor)),
            ..Reading::AS_READ
        };
        let mut scale = self.fit(50, 10_f64.powf(0.1), &|scale| with(scale, 1.0));
        let mut factor = 1.0;
        for _ in 0..2 {
            factor = self.fit(20, 1.05, &|factor| with(scale, factor));
            scale *= self.fit(10, 1.03, &|times| with(scale * times, factor));
        }
        let (reading, by) = (with(scale, factor), short(factor));
        let change = Change::Planes {
            scale: reading.scale,
            by,
        };
        (change, self.explained(&reading, self.stride))
    }

    /// If the views have exactly two focal lengths, tries swapping them.
    fn swapped_cameras(&self) -> Option<(Change, Vec<Explained>)> {
        let (text, factors) = swapped_focals(self.views)?;
        let carries = self.carries.iter().map(|(a, b)| {
            let focal = [factors[*a], factors[*b]];
            self.explained_one(
                (*a, *b),
                &Reading {
                    focal,
                    ..Reading::AS_READ
                },
                self.stride,
            )
        });
        Some((Change::Cameras(text), carries.collect()))
    }

    /// Tries the other treatment of the pictures' EXIF orientation, if pictures treated in that way
    /// also fit their cameras.
    fn turned(&self) -> Option<(Change, Vec<Explained>)> {
        let mut setting = None;
        let explained = self.with(&mut |i, _| {
            let content = &self.views[i].content;
            let (picture, found) = content.image_otherwise_turned().ok().flatten()?;
            setting = Some(found);
            SmallView::of(&self.views[i], picture, true, WIDEST)
        });
        Some((Change::Turned(setting?), explained))
    }

    /// Tries flipped pictures or depth maps.
    fn flipped(&self) -> impl Iterator<Item = (Change, Vec<Explained>)> {
        let parts = [Part::Picture, Part::Depth].into_iter();
        let parts = parts.filter(|part| *part == Part::Picture || !self.depth_by_pose);
        let all = parts.flat_map(|part| FLIPS.map(|(flip, how)| (part, flip, how)));
        all.map(|(part, flip, how)| {
            let explained = self.with(&mut |_, view| Some(view.flipped(flip, part)));
            (Change::Flipped(part, how), explained)
        })
    }

    /// Offset of principal points that fits best, in widths of the picture; zero if negligible.
    fn centre_off(&self) -> DVec2 {
        let step = |factor: f64| 0.1 * factor.ln();
        let with = |centre_off: DVec2| Reading {
            centre_off,
            ..Reading::AS_READ
        };
        let mut off = DVec2::ZERO;
        for axis in [DVec2::X, DVec2::Y] {
            for _ in 0..CENTRE_SEARCHES {
                let start = off;
                let moved = |factor: f64| start + step(factor) * axis;
                let factor = self.fit(CENTRES, CENTRE_STEP, &|factor| with(moved(factor)));
                off = moved(factor);
                let is_at_end = factor.ln().abs() > (f64::from(CENTRES) - 0.5) * CENTRE_STEP.ln();
                if !is_at_end {
                    break;
                }
            }
        }
        if off.length() < MIN_OFF {
            DVec2::ZERO
        } else {
            off
        }
    }

    /// The factor for which the interpretation `with(factor)` has the least loss; tries factors as
    /// [`least`] does.
    pub(super) fn fit(&self, n: i32, step: f64, with: &dyn Fn(f64) -> Reading) -> f64 {
        let coarse = self.stride_of(COARSE_SAMPLES).max(4 * self.stride);
        let fine = self.stride_of(if self.thorough {
            THOROUGH_SAMPLES
        } else {
            FINE_SAMPLES
        });
        let as_read = landed(&self.explained(&Reading::AS_READ, coarse));
        least(n, step, &|factor, is_coarse| {
            let stride = if is_coarse { coarse } else { fine };
            let explained = self.explained(&with(factor), stride);
            let few = is_coarse && 10 * landed(&explained) < 3 * as_read;
            if few { 1.0 } else { mean_loss(&explained) }
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::View;
    use crate::check::tests::{is_tried, views};
    use sharp::camera::RigidTransform;

    const SIZE: (u32, u32) = (96, 72);

    fn better(views: &[View]) -> Option<Change> {
        let neighbours = Neighbours::new(views, THOROUGH).unwrap();
        neighbours
            .better(Units::default())
            .map(|better| better.change)
    }

    #[test]
    fn what_was_changed_is_found() {
        type Spoil = fn(&mut [View]);
        type Found<'a> = &'a dyn Fn(&Change) -> bool;
        fn scaled(views: &mut [View], factor: f64) {
            for view in views {
                view.camera_from_world.translation *= factor;
            }
        }
        fn focal(views: &mut [View], factor: f64) {
            for view in views {
                view.intrinsics.fx *= factor;
                view.intrinsics.fy *= factor;
            }
        }
        fn poses(views: &mut [View], of: impl Fn(usize) -> usize) {
            let before: Vec<RigidTransform> = views.iter().map(|v| v.camera_from_world).collect();
            for (i, view) in views.iter_mut().enumerate() {
                view.camera_from_world = before[of(i)];
            }
        }
        let near = |found: f64, right: f64| (found / right).ln().abs() < 0.02;
        let cases: [(Spoil, Found<'_>); 11] = [
            (
                |v| focal(v, 4.0),
                &|c| matches!(c, Change::Focal(Focal::Both, f) if near(*f, 0.25)),
            ),
            (
                |v| focal(v, 0.25),
                &|c| matches!(c, Change::Focal(Focal::Both, f) if near(*f, 4.0)),
            ),
            (
                |v| scaled(v, 0.3),
                &|c| matches!(c, Change::Scale(s) if near(*s, 1.0 / 0.3)),
            ),
            (
                |v| scaled(v, 1.3),
                &|c| matches!(c, Change::Scale(s) if near(*s, 1.0 / 1.3)),
            ),
            (
                |v| scaled(v, 1000.0),
                &|c| matches!(c, Change::Scale(s) if near(*s, 0.001)),
            ),
            (
                |v| scaled(v, 0.001),
                &|c| matches!(c, Change::Scale(s) if near(*s, 1000.0)),
            ),
            (
                |v| focal(v, 1.1),
                &|c| matches!(c, Change::Focal(Focal::Both, f) if near(*f, 1.0 / 1.1)),
            ),
            (
                |v| focal(v, 0.8),
                &|c| matches!(c, Change::Focal(Focal::Both, f) if near(*f, 1.25)),
            ),
            (
                |v| poses(v, |i| 8 - i),
                &|c| matches!(c, Change::Order(how, _) if how.contains("reverse")),
            ),
            (
                |v| poses(v, |i| (i + 1).min(8)),
                &|c| matches!(c, Change::Order(how, _) if how == "every picture fits the pose before its own"),
            ),
            (
                |v| {
                    v.iter_mut()
                        .for_each(|v| v.camera_from_world = v.camera_from_world.inverse())
                },
                &|c| matches!(c, Change::Convention(name) if name.ends_with("swapped")),
            ),
        ];
        for (i, (spoil, is_right)) in cases.into_iter().enumerate() {
            for seed in (0..2).filter(|seed| is_tried(i, *seed)) {
                let mut views = views(seed, SIZE);
                spoil(&mut views);
                let found = better(&views);
                assert!(
                    found.as_ref().is_some_and(is_right),
                    "{i} {seed}: {found:?}"
                );
            }
        }
    }
}
