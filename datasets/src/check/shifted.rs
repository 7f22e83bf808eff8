//! Detection of pictures that are each shifted by another amount relative to their cameras, as by video stabilisation.

use std::collections::BTreeMap;

use glam::DVec2;
use sharp::camera::Intrinsics;

use super::advice::{evidence, number};
use super::change::Change;
use super::compare::{forward, is_suspicious, mean_loss};
use super::explained::{Explained, Reading};
use super::features::{MIN_MORE, Matches, NEAR, lies, pixel, share};
use super::neighbours::Neighbours;
use super::small_view::{SmallView, ray};

/// Largest shift that is tried in each direction, in widths of the picture.
const MAX_SHIFT: f64 = 0.16;
/// Number of shifts tried in each direction of each axis; smaller steps follow around the best.
const STEPS: i32 = 5;
/// Halvings of the step.
const HALVINGS: i32 = 5;
/// The pictures are shifted individually if the shifts of two pairs of neighbours differ by at least this, in widths of
/// the picture.
const MIN_SPREAD: f64 = 0.006;
/// Samples per view in the search for a shift.
const SAMPLES: usize = 400;

/// The shift, in widths of the picture, with the least loss.
fn best_shift(loss: &dyn Fn(DVec2) -> f64) -> DVec2 {
    let around = |middle: DVec2, n: i32, step: f64| {
        let all = (-n..=n).flat_map(|x| (-n..=n).map(move |y| (x, y)));
        let all = all.map(|(x, y)| middle + step * DVec2::new(x.into(), y.into()));
        let all = all.map(|shift| (loss(shift), shift.length(), shift));
        let best = all.min_by(|a, b| {
            (a.0, a.1)
                .partial_cmp(&(b.0, b.1))
                .unwrap_or(std::cmp::Ordering::Equal)
        });
        best.map_or(middle, |best| best.2)
    };
    let step = MAX_SHIFT / f64::from(STEPS);
    let coarse = around(DVec2::ZERO, STEPS, step);
    (1..=HALVINGS).fold(coarse, |best, halvings| {
        around(best, 1, step * 0.5_f64.powi(halvings))
    })
}

fn shifted(camera: &Intrinsics, by: DVec2) -> Intrinsics {
    let by = by * f64::from(camera.width);
    Intrinsics {
        cx: camera.cx + by.x,
        cy: camera.cy + by.y,
        ..*camera
    }
}

/// A sentence on the shifts between the views of pairs of neighbours; `None` if they are about equal, so that another
/// error is more likely.
fn sentence(shifts: &[DVec2], evidence: &str) -> Option<String> {
    let off = shifts.iter().map(|shift| shift.distance(shifts[0]));
    (off.fold(0.0, f64::max) >= MIN_SPREAD).then(|| {
        format!(
            "the pictures are shifted against each other, each pair of neighbours by another amount, as by video \
             stabilisation ({evidence}); use pictures without stabilisation, or give each view its own principal \
             point; imprecise rotations of the poses have the same effect"
        )
    })
}

impl Neighbours<'_> {
    /// The shift of each view against the one before that explains the views best, with the statistics of the projections
    /// after it. `None` if the views still do not fit as well as valid ones.
    pub(super) fn shifted(&self, as_read: &[Explained]) -> Option<(Change, Vec<Explained>)> {
        // A scan is not shifted with the pictures.
        if self.depth_by_pose {
            return None;
        }
        let small = self.small.iter().map(|(i, read)| (*i, read.0.clone()));
        let mut small: BTreeMap<usize, SmallView> = small.collect();
        let one = |a: (usize, &SmallView), b: (usize, &SmallView), stride: usize| {
            let poses = [a.0, b.0].map(|i| &self.views[i].camera_from_world);
            let from = (a.1, &*self.small[&a.0].1);
            Explained::new(from, b.1, poses.into(), &Reading::AS_READ, stride)
        };
        let rough = self.stride_of(SAMPLES);
        let mut shifts = Vec::new();
        for (a, b) in self.carries.iter().copied().step_by(2) {
            let with = |shift: DVec2| small[&b].with_camera(shifted(&small[&b].camera, shift));
            let shift = best_shift(&|shift| {
                let (first, second) = ((a, &small[&a]), with(shift));
                let second = (b, &second);
                mean_loss(&[one(first, second, rough), one(second, first, rough)])
            });
            let second = with(shift);
            small.insert(b, second);
            shifts.push(shift);
        }
        let carries = self.carries.iter();
        let explained = carries.map(|(a, b)| one((*a, &small[a]), (*b, &small[b]), self.stride));
        let explained: Vec<Explained> = explained.collect();
        if is_suspicious(&explained) {
            return None;
        }
        let width = f64::from(self.views.first()?.intrinsics.width);
        let most = shifts
            .iter()
            .map(|shift| shift.length())
            .fold(0.0, f64::max)
            * width;
        let said = evidence(&forward(as_read), &forward(&explained));
        let said = format!("by up to about {} pixels; {said}", number(most.round()));
        Some((Change::Shifted(sentence(&shifts, &said)?), explained))
    }
}

impl Matches<'_> {
    /// A sentence on pictures that are shifted individually, if this explains more matches than `explained` does, by
    /// [`MIN_MORE`] of them or more.
    pub(super) fn shifted(&self, explained: &[Option<bool>]) -> Option<String> {
        let mut shifts = Vec::new();
        let mut fitting = 0;
        for matches in self.matches.chunk_by(|a, b| a.0 == b.0) {
            let [a, b] = [0, 1].map(|by| matches[0].0 + by);
            let [pose, next] = [a, b].map(|i| self.views[i].camera_from_world);
            let next_from_pose = next.after(&pose.inverse());
            let fits = |shift: DVec2| {
                let camera = shifted(&self.cameras[&b], shift);
                let fits = matches.iter().filter(|(_, from, to)| {
                    let rays = (ray(&self.cameras[&a], *from), ray(&camera, *to));
                    lies(&next_from_pose, rays, NEAR * pixel(&camera))
                });
                fits.count()
            };
            let shift = best_shift(&|shift| -(fits(shift) as f64));
            fitting += fits(shift);
            shifts.push(shift);
        }
        let after = fitting as f64 / self.matches.len() as f64;
        if after < share(explained) + MIN_MORE {
            return None;
        }
        let said = format!(
            "of {} features matched between neighbouring views, {:.0} % lie on their epipolar lines if shifted",
            self.matches.len(),
            100.0 * after
        );
        sentence(&shifts, &said)
    }
}
