//! Detection of a single view whose picture, depth or pose is wrong among correct ones.

use std::collections::BTreeMap;
use std::sync::Arc;

use glam::{DMat3, DQuat, DVec3};
use sharp::camera::{RigidTransform, baseline_m};

use super::advice::{evidence, number};
use super::change::Change;
use super::compare::{MIN_GAIN_OF_VIEWS, forward, is_better, is_supported, mean_loss};
use super::explained::{Explained, Reading};
use super::neighbours::Neighbours;
use super::search::{is_reportable, least};
use super::small_view::{FLIPS, Part, Sample, SmallView};

/// A correction counts only if the remaining loss is at most this multiple of the loss between the surrounding views.
const MAX_LEFT: f64 = 1.5;
/// Minimum error of a wrong pose, in radians or in median depths; smaller errors are mere imprecision.
const MIN_OFF: f64 = 0.03;
/// A view is suspicious if its loss exceeds this multiple of the loss between the surrounding views.
const MIN_WORSE: f64 = 1.15;
/// Number of views on either side with which a view is compared.
const REACH: usize = 2;
/// Samples per view in the search for a depth factor and a pose.
const SEARCH_SAMPLES: usize = 1000;

/// A view, the samples of its depth, and its pose.
#[derive(Clone)]
struct Posed {
    view: SmallView,
    samples: Arc<[Sample]>,
    pose: RigidTransform,
}

impl Posed {
    fn new(view: SmallView, pose: RigidTransform) -> Self {
        let samples = view.samples().collect();
        Self {
            view,
            samples,
            pose,
        }
    }

    fn to(&self, other: &Self, stride: usize) -> Explained {
        let poses = (&self.pose, &other.pose);
        let from = (&self.view, &*self.samples);
        Explained::new(from, &other.view, poses, &Reading::AS_READ, stride)
    }
}

impl Neighbours<'_> {
    /// Changes of a single view that make it fit its neighbours significantly better, and nearly as
    /// well as the neighbours fit each other ([`MAX_LEFT`]). Each change comes with the statistics
    /// of all projections after it.
    pub(super) fn one_view(&self, as_read: &[Explained]) -> Vec<(Change, Vec<Explained>)> {
        let pose = |i: usize| self.views[i].camera_from_world;
        let small = self.small.iter().map(|(i, read)| (*i, &read.0));
        let all = small.chain(self.around.iter().map(|(i, view)| (*i, view)));
        let all = all.map(|(i, view)| (i, Posed::new(view.clone(), pose(i))));
        let all: BTreeMap<usize, Posed> = all.collect();
        let mut found = Vec::new();
        for (i, own) in &all {
            let near: Vec<&Posed> = (i.saturating_sub(REACH)..=i + REACH)
                .filter(|j| j != i)
                .filter_map(|j| all.get(&j))
                .collect();
            if near.len() < 2 {
                continue;
            }
            let links_by = |one: &Posed, stride: usize| -> Vec<Explained> {
                let both = |other: &&Posed| [one.to(other, stride), other.to(one, stride)];
                near.iter().flat_map(both).collect()
            };
            let links = |one: &Posed| links_by(one, self.stride);
            let rough = self.stride_of(SEARCH_SAMPLES);
            let others = near.windows(2);
            let others: Vec<Explained> = others
                .map(|pair| pair[0].to(pair[1], self.stride))
                .collect();
            let read = links(own);
            let wanted = MAX_LEFT * mean_loss(&others);
            if mean_loss(&read) <= MIN_WORSE * mean_loss(&others) {
                continue;
            }
            for (what, other) in self.changed(own, &|one| mean_loss(&links_by(one, rough))) {
                let mended = links(&other);
                if mean_loss(&mended) > wanted
                    || !is_better(&read, &mended, MIN_GAIN_OF_VIEWS)
                    || !is_supported(&read, &mended)
                {
                    continue;
                }
                let carries = self.carries.iter().zip(as_read);
                let carries = carries.map(|((a, b), read)| match (all.get(a), all.get(b)) {
                    (Some(_), Some(b)) if a == i => other.to(b, self.stride),
                    (Some(a), Some(_)) if b == i => a.to(&other, self.stride),
                    _ => *read,
                });
                let said = evidence(&forward(&read), &forward(&mended));
                found.push((
                    Change::Views(format!("{}: {what} ({said})", self.views[*i].id)),
                    carries.collect(),
                ));
            }
        }
        found
    }

    /// Candidate corrections of one view, each with its description.
    fn changed(&self, own: &Posed, loss: &dyn Fn(&Posed) -> f64) -> Vec<(String, Posed)> {
        let mut changed = Vec::new();
        for (flip, how) in FLIPS {
            let (picture, depth) = (
                own.view.flipped(flip, Part::Picture),
                own.view.flipped(flip, Part::Depth),
            );
            let both = picture.flipped(flip, Part::Depth);
            for (noun, view) in [
                ("its picture is", picture),
                ("its depth map is", depth),
                ("its picture and its depth map are", both),
            ] {
                changed.push((format!("{noun} {how}"), Posed::new(view, own.pose)));
            }
        }
        let scaled = |factor: f64| Posed::new(own.view.with_depth_times(factor), own.pose);
        let factor = least(20, 1.2, &|factor, _| loss(&scaled(factor)));
        if is_reportable(factor) {
            let what = format!("its depth should be multiplied by {}", number(factor));
            changed.push((what, scaled(factor)));
        }
        if self.thorough {
            changed.extend(self.moved(own, loss));
        }
        changed
    }

    /// The view with the position and rotation that best fit the surrounding views.
    fn moved(&self, own: &Posed, loss: &dyn Fn(&Posed) -> f64) -> Option<(String, Posed)> {
        let median_m = self.median_depth();
        let steps = (0..12).map(|i| {
            let mut by = [DVec3::ZERO; 2];
            by[i / 6][i % 3] = if i % 6 < 3 { 1.0 } else { -1.0 };
            by
        });
        let steps: Vec<[DVec3; 2]> = steps.collect();
        let (mut best, mut least, mut size) = (own.clone(), loss(own), 0.16);
        while size > 0.004 {
            let before = least;
            for [turn, shift] in &steps {
                let by = RigidTransform {
                    rotation: DMat3::from_quat(DQuat::from_scaled_axis(*turn * size)),
                    translation: *shift * size * median_m,
                };
                let moved = Posed {
                    pose: by.after(&best.pose),
                    ..best.clone()
                };
                let found = loss(&moved);
                if found < least {
                    (best, least) = (moved, found);
                }
            }
            if least == before {
                size /= 2.0;
            }
        }
        let off = best.pose.after(&own.pose.inverse());
        let (metres, degrees) = (baseline_m(&best.pose, &own.pose), off.rotation_deg());
        let is_off = metres > MIN_OFF * median_m || degrees.to_radians() > MIN_OFF;
        let what = format!(
            "its pose is off by about {} m and {degrees:.0} degrees",
            number(metres)
        );
        is_off.then_some((what, best))
    }
}
