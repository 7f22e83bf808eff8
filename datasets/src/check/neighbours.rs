//! Neighbouring views of a scene at reduced size. Measures how well an interpretation projects one view into the next.

use std::collections::{BTreeMap, BTreeSet};

use glam::DVec2;
use sharp::camera::Intrinsics;

use super::Effort;
use super::compare::{agrees, forward, is_suspicious};
use super::consistency::{Consistency, Fit};
use super::convention::CONVENTIONS;
use super::explained::{Explained, Reading};
use super::small_view::{Sample, SmallView, WIDEST};
use crate::View;
use crate::view::evenly_spaced;

/// A thorough check reads all views of a scene if there are at most this many.
pub(super) const MAX_ALL: usize = 12;

/// Identical pictures are an error if the content moves by at least this between the two views, in reduced pixels.
pub(super) const MIN_MOVED: f64 = 1.5;

/// Colours fit if their difference is at most this fraction of the difference between unrelated places.
const EXPLAINED: f64 = 0.35;

/// Share of pixels with depth below which a scan is examined more closely.
const LITTLE_SCAN_DEPTH: f64 = 0.3;

/// Two views differ in exposure if their levels differ by at least this factor.
const MIN_EXPOSURE_FACTOR: f64 = 1.12;
/// Two views differ in exposure only if correcting for the factor reduces their colour difference to this share or
/// less.
const MAX_LEFT_BY_EXPOSURE: f64 = 0.5;

/// Indices of the first view of each pair of neighbours that is examined.
pub(super) fn neighbours(views: usize, effort: Effort) -> impl Iterator<Item = usize> {
    evenly_spaced(views.saturating_sub(1), effort.pairs).into_iter()
}

/// Neighbouring views of a scene at reduced size.
pub(super) struct Neighbours<'a> {
    pub(super) views: &'a [View],
    pub(super) small: BTreeMap<usize, (SmallView, Vec<Sample>)>,
    /// True if depth belongs to the pose rather than the picture.
    pub(super) depth_by_pose: bool,
    /// Further views around the examined ones, for tests of single views and of other assignments.
    pub(super) around: BTreeMap<usize, SmallView>,
    /// Pairs of view indices (from, to) for projections: each view to its neighbour, and back.
    pub(super) carries: Vec<(usize, usize)>,
    pub(super) stride: usize,
    pub(super) thorough: bool,
}

impl<'a> Neighbours<'a> {
    /// Reads some or all of the views; `None` if no two neighbours can be read with depth.
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
        // Depth from a scan is expensive, so fewer views are read.
        if effort.thorough && views.len() <= MAX_ALL {
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

    /// Stride at which at most `samples` samples per view are projected; at least the stride of the check.
    pub(super) fn stride_of(&self, samples: usize) -> usize {
        let most = self.small.values().map(|(_, samples)| samples.len()).max();
        most.unwrap_or(0).div_ceil(samples).max(self.stride)
    }

    /// Median of the depths under the reader's interpretation, in metres.
    pub(super) fn median_depth(&self) -> f64 {
        let all = self.small.values().flat_map(|(_, samples)| samples);
        let mut all: Vec<f64> = all.map(|sample| sample.depth).collect();
        all.sort_by(f64::total_cmp);
        all.get(all.len() / 2).copied().unwrap_or(0.0)
    }

    /// Consistency of the views under the reader's interpretation and under other pose conventions.
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
        let carries = self.carries.iter();
        carries
            .map(|carry| self.explained_one(*carry, reading, stride))
            .collect()
    }

    pub(super) fn explained_one(
        &self,
        (a, b): (usize, usize),
        reading: &Reading,
        stride: usize,
    ) -> Explained {
        let ((from, samples), (to, _)) = (&self.small[&a], &self.small[&b]);
        let [pose_a, pose_b] = [a, b].map(|i| &self.views[i].camera_from_world);
        Explained::new((from, samples), to, (pose_a, pose_b), reading, stride)
    }

    /// Evaluates the projections with each view replaced by `other(index, view)`, or unchanged if
    /// `other` returns `None`.
    pub(super) fn with(
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

    /// Largest difference of colours in a projection, as a fraction of the difference between unrelated places.
    pub(super) fn unexplained(&self, all: &[Explained]) -> f64 {
        let shares = self.carries.iter().zip(all).filter_map(|((_, to), one)| {
            Some(one.colour_levels()? / self.small[to].0.unrelated_levels().max(1.0))
        });
        shares.fold(0.0, f64::max)
    }

    /// True if the colours of view `first` and the next fit when each is projected into the other. Matches of features
    /// are not considered.
    pub(super) fn is_explained(&self, first: usize) -> bool {
        [(first, first + 1), (first + 1, first)]
            .iter()
            .all(|carry| {
                let explained = || self.explained_one(*carry, &Reading::AS_READ, self.stride);
                let levels = self.carries.contains(carry).then(explained);
                let levels = levels.and_then(|explained| explained.colour_levels());
                let unrelated = || self.small[&carry.1].0.unrelated_levels().max(1.0);
                levels.is_some_and(|levels| levels <= EXPLAINED * unrelated())
            })
    }

    /// Projects the place `from` in view `i` into the next view, by depth and poses, and returns
    /// its distance from the place `to` there, in reduced pixels. `None` if `from` has no depth.
    /// `from` is in pixels of `camera`, and `to` in pixels of `next_camera`; their sizes may differ
    /// from the reduced views'.
    pub(super) fn miss(
        &self,
        (i, camera, from): (usize, &Intrinsics, DVec2),
        next_camera: &Intrinsics,
        to: DVec2,
    ) -> Option<f64> {
        let ((view, _), (next, _)) = (self.small.get(&i)?, self.small.get(&(i + 1))?);
        let from = from * (view.camera.fx / camera.fx);
        let to = to * (next.camera.fx / next_camera.fx);
        let (depth, _) = view.depth_at(from)?;
        let pose = |i: usize| &self.views[i].camera_from_world;
        let next_from_view = pose(i + 1).after(&pose(i).inverse());
        let point = next_from_view.apply(view.camera.unproject(from, depth));
        let place = next.camera.project(point);
        Some(place.map_or(f64::INFINITY, |place| place.distance(to)))
    }

    /// A note if neighbouring views differ in exposure.
    pub(super) fn exposures(&self) -> Option<String> {
        let all = self.explained(&Reading::AS_READ, self.stride);
        let pairs = self.carries.iter().zip(&all).step_by(2);
        let compared = pairs.filter_map(|(pair, one)| {
            let ((factor, left), levels) = (one.exposure()?, one.colour_levels()?);
            let is_other = factor.ln().abs() >= MIN_EXPOSURE_FACTOR.ln()
                && left <= MAX_LEFT_BY_EXPOSURE * levels;
            Some((pair, factor, is_other))
        });
        let compared: Vec<(&(usize, usize), f64, bool)> = compared.collect();
        let other = compared.iter().filter(|(.., is_other)| *is_other);
        let count = other.clone().count();
        let ((a, b), factor, _) = other.max_by(|a, b| a.1.ln().abs().total_cmp(&b.1.ln().abs()))?;
        Some(format!(
            "exposure: {count} of {} pairs of neighbouring views differ in exposure (for example, the levels of {} \
             and {} by a factor of {factor:.2}); methods that keep the source's exposure lose PSNR on these pairs, so \
             use pictures of a single exposure if available",
            compared.len(),
            self.views[*a].id,
            self.views[*b].id
        ))
    }

    /// Mean fraction of pixels that masks exclude; `None` if this fraction is at most half.
    pub(super) fn excluded(&self) -> Option<f64> {
        let is_masked = |i: &usize| self.views[*i].content.processing().masked;
        let masked = self.small.iter().filter(|(i, _)| is_masked(i));
        let shares: Vec<f64> = masked.map(|(_, (view, _))| view.excluded()).collect();
        let share = shares.iter().sum::<f64>() / shares.len() as f64;
        (share > 0.5).then_some(share)
    }

    /// True if a scan gives depth to so few pixels that it may be in the wrong place.
    pub(super) fn has_little_scan_depth(&self) -> bool {
        let (known, all) = self.small.values().fold((0, 0), |sum, (view, samples)| {
            let (w, h) = (view.camera.width as usize, view.camera.height as usize);
            (sum.0 + samples.len(), sum.1 + w * h)
        });
        self.depth_by_pose && (known as f64) < LITTLE_SCAN_DEPTH * all as f64
    }

    pub(super) fn is_poorly_explained(&self) -> bool {
        is_suspicious(&self.explained(&Reading::AS_READ, self.stride))
    }

    /// Reports neighbouring views that have the same picture, or views that all have the same depth map, although the
    /// content should have moved between them.
    pub(super) fn repeated(&self) -> Option<String> {
        let is_moved = |(a, b): &(usize, usize)| {
            let ((one, samples), (other, _)) = (&self.small[a], &self.small[b]);
            let is_moved = |sample: &&Sample| {
                let place = sample.middle();
                let miss = self.miss((*a, &one.camera, place), &other.camera, place);
                miss.is_some_and(|miss| miss >= MIN_MOVED)
            };
            let moved = samples.iter().step_by(7).filter(is_moved).count();
            2 * 7 * moved > samples.len()
        };
        let small = |(a, b): &(usize, usize)| [a, b].map(|i| &self.small[i].0);
        let mut pairs = self.carries.iter().step_by(2);
        let pictured = pairs.clone().find(|pair| {
            let [one, other] = small(pair);
            one.has_picture_of(other) && is_moved(pair)
        });
        let has_one_depth = |pair: &(usize, usize)| {
            let [one, other] = small(pair);
            one.has_depth_of(other)
        };
        // The depth of a plane may stay the same while the camera moves.
        let disagrees = |pair: &(usize, usize)| {
            let explained = || self.explained_one(*pair, &Reading::AS_READ, self.stride);
            is_moved(pair) && !agrees(&[explained()])
        };
        let moves = format!(
            "although their poses move its content by {MIN_MOVED} pixels or more (in pictures up to {WIDEST} pixels \
             wide)"
        );
        if let Some((a, b)) = pictured {
            let [a, b] = [a, b].map(|i| &self.views[*i].id);
            return Some(format!(
                "{a} and {b} have the same picture, {moves}; give each view its own picture"
            ));
        }
        let is_one = pairs.clone().all(has_one_depth) && pairs.any(disagrees);
        is_one.then(|| {
            format!("all views examined have the same depth map, {moves}; give each view its own depth map")
        })
    }

    /// Reports a picture of a single colour among the views read.
    pub(super) fn blank(&self) -> Option<String> {
        let around = self.around.iter();
        let all = self.small.iter().map(|(i, read)| (i, &read.0));
        let mut all = all.chain(around);
        let (i, _) = all.find(|(_, view)| view.is_of_one_colour())?;
        let id = &self.views[*i].id;
        Some(format!("{id}: the picture has a single colour"))
    }
}
