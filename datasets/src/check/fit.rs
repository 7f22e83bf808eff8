//! Fits other readings of a scene's poses, cameras and depth, and names one that explains pictures and depth significantly
//! better than the reader's.

use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};

use glam::DVec2;
use sharp::camera::RigidTransform;

use super::advice::{self, Units};
use super::compare::{
    LEAST_GAIN, LEAST_GAIN_OF_FACTORS, fits_well, forward, is_better, is_needed, is_refuted,
    landed, mean_loss,
};
use super::consistency::{Consistency, Fit};
use super::convention::{CONVENTIONS, alternatives};
use super::explained::{DepthIs, Explained, Reading};
use super::orders::{neighbours, orders};
use super::search::{is_worth_a_word, least};
use super::small_view::{FLIPS, Part, Sample, SmallView, WIDEST};
use super::{Effort, plausible};
use crate::View;

/// Most views of a scene all of which a thorough look reads.
const MOST_ALL: usize = 12;

/// The change that another reading makes.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Change {
    /// The poses' translations, times this, fit the depth.
    Scale(f64),
    /// These focal lengths, times this, fit.
    Focal(Focal, f64),
    CentreExchanged,
    /// Depth, and so many metres, fits.
    Short(f64),
    RayLength,
    /// Depth is the reciprocal of what is stored; the poses' translations, times this, fit the reciprocals.
    Inverse(f64),
    /// The poses are of another convention, named as in [`alternatives`].
    Convention(&'static str),
    /// Parts of views belong to other pictures; the assignment in words.
    Order(String, Moves),
    /// One view is wrong; the sentence on it.
    OneView(String),
    /// Lenses have this [`Reading::bend`].
    Bent(f64),
    /// Pictures or depth maps are turned, in words.
    Flipped(Part, &'static str),
    /// Pictures read under the other EXIF orientation rule, which fits the camera as well; the setting that selects it.
    Turned(&'static str),
}

/// Focal lengths that are wrong together.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Focal {
    Both,
    X,
    Y,
}

impl Focal {
    fn times(self, factor: f64) -> DVec2 {
        match self {
            Self::Both => DVec2::splat(factor),
            Self::X => DVec2::new(factor, 1.0),
            Self::Y => DVec2::new(1.0, factor),
        }
    }
}

impl Change {
    fn least_gain(&self) -> f64 {
        match self {
            Self::Scale(_) | Self::Focal(..) => LEAST_GAIN_OF_FACTORS,
            _ => LEAST_GAIN,
        }
    }
}

/// The part of a view that another assignment moves; the rest stays as it is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Moves {
    Poses,
    PosesAndDepth,
    Depth,
}

impl Moves {
    /// The parts that are reassigned.
    pub(super) fn noun(self) -> &'static str {
        match self {
            Self::Depth => "depth map",
            _ => "pose",
        }
    }
}

/// A reading that fits better.
#[derive(Debug, Clone)]
pub(super) struct Better {
    pub(super) change: Change,
    pub(super) as_read: Explained,
    pub(super) explained: Explained,
    /// Whether what it leaves unexplained is no more than in proper data.
    pub(super) fits_well: bool,
}

/// Neighbouring views of a scene, at a small size.
pub(super) struct Neighbours<'a> {
    pub(super) views: &'a [View],
    pub(super) small: BTreeMap<usize, (SmallView, Vec<Sample>)>,
    /// Whether depth goes with the pose, not with the picture.
    depth_by_pose: bool,
    /// Views around those, where their depth is asked for with other pictures.
    pub(super) around: BTreeMap<usize, SmallView>,
    /// From a view to its neighbour, and back.
    pub(super) carries: Vec<(usize, usize)>,
    pub(super) stride: usize,
    pub(super) thorough: bool,
}

impl<'a> Neighbours<'a> {
    /// `None` where no two neighbours can be read with depth.
    pub(super) fn new(views: &'a [View], effort: Effort) -> Option<Self> {
        let firsts: Vec<usize> = neighbours(views.len(), effort).collect();
        let wanted: BTreeSet<usize> = firsts.iter().flat_map(|i| [*i, *i + 1]).collect();
        let small = wanted.iter().filter_map(|i| {
            let view = SmallView::new(&views[*i], true, WIDEST)?;
            let samples: Vec<Sample> = view.samples().collect();
            (!samples.is_empty()).then_some((*i, (view, samples)))
        });
        let small: BTreeMap<usize, (SmallView, Vec<Sample>)> = small.collect();
        let both = firsts
            .iter()
            .filter(|i| small.contains_key(i) && small.contains_key(&(*i + 1)));
        let carries: Vec<(usize, usize)> = both.flat_map(|i| [(*i, i + 1), (i + 1, *i)]).collect();
        let depth_by_pose = |i: &usize| views[*i].content.processing().depth_by_pose;
        let depth_by_pose = small.keys().any(depth_by_pose);
        let mut around = BTreeSet::new();
        // A scan is dear to look at from more places.
        if effort.thorough && views.len() <= MOST_ALL {
            around = (0..views.len()).collect();
        } else if !depth_by_pose || effort.thorough {
            around = wanted
                .iter()
                .flat_map(|i| [i.wrapping_sub(1), i + 1])
                .collect();
        }
        around.retain(|i| !small.contains_key(i));
        let around = around
            .into_iter()
            .filter_map(|i| Some((i, SmallView::new(views.get(i)?, true, WIDEST)?)));
        let around = around.collect();
        let most = small.values().map(|(_, samples)| samples.len()).max()?;
        (!carries.is_empty()).then_some(Self {
            views,
            small,
            depth_by_pose,
            around,
            carries,
            stride: most.div_ceil(effort.samples).max(1),
            thorough: effort.thorough,
        })
    }

    /// Median of the depths as read, metres.
    pub(super) fn median_depth(&self) -> f64 {
        let all = self.small.values().flat_map(|(_, samples)| samples);
        let mut all: Vec<f64> = all.map(|sample| sample.depth).collect();
        all.sort_by(f64::total_cmp);
        all.get(all.len() / 2).copied().unwrap_or(0.0)
    }

    /// The reading that explains the views best, where it does so significantly better than the reader's.
    pub(super) fn better(&self) -> Option<Better> {
        let as_read = self.explained(&Reading::AS_READ, self.stride);
        let mut all: Vec<(Change, Vec<Explained>)> = Vec::new();
        let mut fitted = |reading: &Reading, change: Change| {
            all.push((change, self.explained(reading, self.stride)));
        };
        for convention in alternatives() {
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
            } else if is_worth_a_word(scale) {
                fitted(&with(scale), Change::Scale(scale));
            }
        }
        for which in [Focal::Both, Focal::X, Focal::Y] {
            let with = |factor: f64| Reading {
                focal: which.times(factor),
                ..Reading::AS_READ
            };
            let factor = self.fit(20, 1.035, &with);
            if is_worth_a_word(factor) {
                fitted(&with(factor), Change::Focal(which, factor));
            }
        }
        let bent = |factor: f64| factor.ln();
        let with_bend = |bend: f64| Reading {
            bend,
            ..Reading::AS_READ
        };
        let factor = self.fit(20, 1.035, &|factor| with_bend(bent(factor)));
        if is_worth_a_word(factor) {
            let bend = bent(factor);
            fitted(&with_bend(bend), Change::Bent(bend));
        }
        let centre_exchanged = Reading {
            centre_exchanged: true,
            ..Reading::AS_READ
        };
        fitted(&centre_exchanged, Change::CentreExchanged);
        let with_depth = |depth: DepthIs| Reading {
            depth,
            ..Reading::AS_READ
        };
        fitted(&with_depth(DepthIs::RayLength), Change::RayLength);
        let median_m = self.median_depth();
        let short = |factor: f64| (factor - 1.0) * median_m;
        let factor = self.fit(20, 1.035, &|factor| {
            with_depth(DepthIs::Short(short(factor)))
        });
        if is_worth_a_word(factor) {
            let by = short(factor);
            fitted(&with_depth(DepthIs::Short(by)), Change::Short(by));
        }
        all.extend(self.orders(&as_read));
        all.extend(self.turned());
        all.extend(self.flipped());
        let better = all.into_iter().filter(|(change, other)| {
            is_better(&as_read, other, change.least_gain())
                && !is_refuted(&as_read, other)
                && is_needed(&as_read, other)
        });
        let better = better.chain(self.one_view(&as_read));
        let best = better.min_by(|(_, a), (_, b)| mean_loss(a).total_cmp(&mean_loss(b)));
        best.map(|(change, explained)| Better {
            change,
            as_read: forward(&as_read),
            explained: forward(&explained),
            fits_well: fits_well(&explained),
        })
    }

    /// Describes a contradiction, if there is one.
    pub(super) fn contradictions(&self, units: Units) -> Option<String> {
        let median_m = self.median_depth();
        let values = self.constant().or_else(|| self.normalised(units));
        if let Some(values) = values.or_else(|| self.limited()) {
            return Some(values);
        }
        match self.better() {
            Some(better) => {
                let evidence = advice::evidence(&better.as_read, &better.explained);
                Some(match better.fits_well {
                    true => {
                        advice::sentence(&better.change, &evidence, units, median_m, self.views)
                    }
                    false => format!(
                        "poses, cameras, pictures and depth do not fit together, and no single change that was \
                         tried explains it: with the best one {evidence}"
                    ),
                })
            }
            None => {
                plausible::depth(median_m, units).or_else(|| self.consistency()?.disagreement())
            }
        }
    }

    /// How well the views agree, as read and under other conventions for poses.
    pub(super) fn consistency(&self) -> Option<Consistency> {
        let mut meeting: Option<f64> = None;
        let mut fits = CONVENTIONS.iter().map(|convention| {
            let take = convention.take;
            let all = self.explained(
                &Reading {
                    take,
                    ..Reading::AS_READ
                },
                1,
            );
            if meeting.is_none() {
                let met = all.iter().filter_map(Explained::agreeing_where_met);
                meeting = met.max_by(f64::total_cmp);
            }
            let sum = forward(&all);
            Fit {
                convention: convention.name,
                depth: sum.agreement(),
                colour_levels: sum.colour_levels(),
                colours: sum.compared,
            }
        });
        let (as_read, otherwise) = (fits.next()?, fits.collect());
        Some(Consistency {
            as_read,
            otherwise,
            meeting,
            pairs: self.carries.len() / 2,
        })
    }

    pub(super) fn explained(&self, reading: &Reading, stride: usize) -> Vec<Explained> {
        let carries = self.carries.iter().map(|(a, b)| {
            let ((from, samples), (to, _)) = (&self.small[a], &self.small[b]);
            let poses = (
                &self.views[*a].camera_from_world,
                &self.views[*b].camera_from_world,
            );
            Explained::new((from, samples), to, poses, reading, stride)
        });
        carries.collect()
    }

    /// Explains the carries as if picture i had what `moves` of view `of(i)`. `None` for a carry whose pictures would have
    /// none, or one and the same.
    fn in_order(
        &self,
        as_read: &[Explained],
        of: &dyn Fn(usize) -> Option<usize>,
        moves: Moves,
    ) -> Vec<Option<Explained>> {
        let pose = |i: usize| -> Option<&RigidTransform> {
            let from = if moves == Moves::Depth { i } else { of(i)? };
            Some(&self.views.get(from)?.camera_from_world)
        };
        let shown = |i: usize| -> Option<Cow<'_, (SmallView, Vec<Sample>)>> {
            let read = &self.small[&i];
            let from = of(i)?;
            if moves == Moves::Poses || from == i {
                return Some(Cow::Borrowed(read));
            }
            let own = self.small.get(&from).map(|(view, _)| view);
            let view = read
                .0
                .with_depth_of(own.or_else(|| self.around.get(&from))?)?;
            let samples = view.samples().collect();
            Some(Cow::Owned((view, samples)))
        };
        let carries = self.carries.iter().zip(as_read).map(|((a, b), read)| {
            let from = (of(*a)?, of(*b)?);
            if from == (*a, *b) {
                return Some(*read);
            }
            let poses = (pose(*a)?, pose(*b)?);
            // One place with one depth agrees with itself.
            if from.0 == from.1 {
                return None;
            }
            let (a, b) = (shown(*a)?, shown(*b)?);
            Some(Explained::new(
                (&a.0, &a.1),
                &b.0,
                poses,
                &Reading::AS_READ,
                self.stride,
            ))
        });
        carries.collect()
    }

    /// Explains the carries with other pictures or depth of the views.
    fn with(
        &self,
        other: &mut dyn FnMut(usize, &SmallView) -> Option<SmallView>,
    ) -> Vec<Explained> {
        let small = self.small.iter().map(|(i, read)| {
            let other = other(*i, &read.0).map(|view| {
                let samples = view.samples().collect();
                (view, samples)
            });
            (*i, other.unwrap_or_else(|| read.clone()))
        });
        let other = Self {
            small: small.collect(),
            around: BTreeMap::new(),
            carries: self.carries.clone(),
            ..*self
        };
        other.explained(&Reading::AS_READ, self.stride)
    }

    /// With pictures under the other reading of their EXIF orientation, where that fits their cameras, too.
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

    /// With pictures or depth maps turned.
    fn flipped(&self) -> impl Iterator<Item = (Change, Vec<Explained>)> {
        let parts = [Part::Picture, Part::Depth].into_iter();
        let parts = parts.filter(|part| *part == Part::Picture || !self.depth_by_pose);
        let all = parts.flat_map(|part| FLIPS.map(|(flip, how)| (part, flip, how)));
        all.map(|(part, flip, how)| {
            let explained = self.with(&mut |_, view| Some(view.flipped(flip, part)));
            (Change::Flipped(part, how), explained)
        })
    }

    /// Pictures of one colour among those that were read.
    pub(super) fn blank(&self) -> Option<String> {
        let around = self.around.iter();
        let all = self.small.iter().map(|(i, read)| (i, &read.0));
        let mut all = all.chain(around);
        let (i, _) = all.find(|(_, view)| view.is_of_one_colour())?;
        let id = &self.views[*i].id;
        Some(format!("{id}: the picture is of one colour"))
    }

    /// The factor with the least loss.
    fn fit(&self, n: i32, step: f64, with: &dyn Fn(f64) -> Reading) -> f64 {
        let coarse = 4 * self.stride;
        let as_read = landed(&self.explained(&Reading::AS_READ, coarse));
        least(n, step, &|factor, is_coarse| {
            let stride = if is_coarse { coarse } else { self.stride };
            let explained = self.explained(&with(factor), stride);
            let few = is_coarse && 10 * landed(&explained) < 3 * as_read;
            if few { 1.0 } else { mean_loss(&explained) }
        })
    }

    /// Other assignments of pictures to poses.
    fn orders(&self, as_read: &[Explained]) -> Vec<(Change, Vec<Explained>)> {
        let starts: BTreeSet<usize> = self.carries.iter().map(|(a, _)| *a).collect();
        // Depth may belong to the frame or to the picture; a scan's belongs to the pose.
        let moves: &[Moves] = if self.depth_by_pose {
            &[Moves::PosesAndDepth]
        } else {
            &[Moves::Poses, Moves::PosesAndDepth, Moves::Depth]
        };
        let mut measured = Vec::new();
        for &moves in moves {
            let exchanged = self.exchanges();
            for (text, of, least_pairs) in orders(self.views, &starts, &exchanged, moves.noun()) {
                let explained = self.in_order(as_read, &*of, moves);
                // Pictures that would be without a pose are as they are.
                let given = explained.iter().filter(|one| one.is_some()).count();
                let all = explained.into_iter().zip(as_read);
                let all: Vec<Explained> = all.map(|(one, read)| one.unwrap_or(*read)).collect();
                let is_less = |(one, read): &(&Explained, &Explained)| {
                    mean_loss(&[**one]) <= (1.0 - LEAST_GAIN) * mean_loss(&[**read])
                };
                let improved = all.iter().zip(as_read).filter(is_less).count();
                if 2 * given >= all.len() && improved >= 2 * least_pairs {
                    measured.push((Change::Order(text, moves), all));
                }
            }
        }
        measured
    }

    /// Two views of which at least one is carried and both are read.
    fn exchanges(&self) -> Vec<(usize, usize)> {
        if !self.thorough {
            return Vec::new();
        }
        let small = self.small.keys().copied();
        let others = |a: usize| {
            let carried = self.small.keys().filter(move |b| **b > a);
            carried.chain(self.around.keys()).map(move |b| (a, *b))
        };
        small.flat_map(others).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::check::{QUICK, THOROUGH};
    use crate::synthetic::{SyntheticOptions, SyntheticScene};

    fn views(options: SyntheticOptions) -> Vec<View> {
        SyntheticScene::new(options).unwrap().views().to_vec()
    }

    fn options(seed: u64) -> SyntheticOptions {
        SyntheticOptions {
            seed,
            width: 96,
            height: 72,
            views: 9,
            ..SyntheticOptions::default()
        }
    }

    fn better(views: &[View], effort: Effort) -> Option<Change> {
        let neighbours = Neighbours::new(views, effort).unwrap();
        neighbours.better().map(|better| better.change)
    }

    #[test]
    fn proper_scenes_have_no_better_reading() {
        for seed in 0..6 {
            let views = views(options(seed));
            for effort in [QUICK, THOROUGH] {
                assert_eq!(better(&views, effort), None, "{seed}");
            }
        }
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
        let cases: [(Spoil, Found<'_>); 9] = [
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
                &|c| matches!(c, Change::Convention(name) if name.ends_with("exchanged")),
            ),
        ];
        for (i, (spoil, is_right)) in cases.into_iter().enumerate() {
            for seed in 0..2 {
                let mut views = views(options(seed));
                spoil(&mut views);
                let found = better(&views, THOROUGH);
                assert!(
                    found.as_ref().is_some_and(is_right),
                    "{i} {seed}: {found:?}"
                );
            }
        }
    }
}
