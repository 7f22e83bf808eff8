//! Other assignments of pictures to poses.

use std::borrow::Cow;
use std::collections::BTreeSet;

use sharp::camera::RigidTransform;

use super::change::{Change, Moves};
use super::compare::{MIN_GAIN, fits_well, is_suspicious, mean_loss};
use super::explained::{Explained, Reading};
use super::neighbours::{MAX_ALL, Neighbours};
use super::small_view::{Sample, SmallView};
use crate::View;

/// Shifts and reorderings are tried only with at least this many views; with fewer, any assignment to poses may fit.
const MIN_VIEWS: usize = 5;

/// A shift that starts after the first picture is reported only if it explains at least this many pairs of neighbours
/// better. A single pair may be due to one wrong pose.
const MIN_SHIFTED: usize = 2;

/// The poses of two other views fit a pair only if they remove at least this fraction of the pair's loss. The fraction
/// is high, because these poses are the best of many.
const MIN_GAIN_ELSEWHERE: f64 = 0.25;
/// Samples per view in the search for the poses of two other views.
const SAMPLES_ELSEWHERE: usize = 500;

type Read<'a> = Cow<'a, (SmallView, Vec<Sample>)>;

/// For each view, the view whose pose, depth or both its picture receives; `None` if it receives none.
pub(super) type Assignment = Box<dyn Fn(usize) -> Option<usize>>;

/// Assignments that result from common mistakes, with descriptions: shifts starting at one of
/// `starts`, reverse order, lexicographic instead of numeric order, and the `swapped` pairs. `noun`
/// names the parts that are assigned to the pictures. Each assignment comes with the minimum number
/// of neighbouring pairs that it must explain better to be reported.
pub(super) fn orders(
    views: &[View],
    starts: &BTreeSet<usize>,
    swapped: &[(usize, usize)],
    noun: &str,
) -> Vec<(String, Assignment, usize)> {
    let n = views.len();
    let shifted = |by: i64, from: usize| {
        move |i: usize| {
            if i < from {
                Some(i)
            } else {
                usize::try_from(i as i64 + by).ok()
            }
        }
    };
    let id = |i: usize| &views[i].id;
    let mut orders: Vec<(String, Assignment, usize)> = Vec::new();
    for &(a, b) in swapped {
        let text = format!("{} and {} have each other's {noun}", id(a), id(b));
        let swap = move |i: usize| match i {
            i if i == a => Some(b),
            i if i == b => Some(a),
            i => Some(i),
        };
        orders.push((text, Box::new(swap), 1));
    }
    if n < MIN_VIEWS {
        return orders;
    }
    let starts: BTreeSet<usize> = starts.iter().copied().chain([0]).collect();
    for by in [-2_i64, -1, 1, 2] {
        let places = if by.abs() == 1 { "" } else { "two places " };
        let side = if by < 0 { "before" } else { "after" };
        for &from in &starts {
            let which = match from {
                0 => "every picture fits".to_owned(),
                from => format!("from about {} on, every picture fits", id(from)),
            };
            let text = format!("{which} the {noun} {places}{side} its own");
            let pairs = if from == 0 { 1 } else { MIN_SHIFTED };
            orders.push((text, Box::new(shifted(by, from)), pairs));
        }
    }
    let backwards = format!("the pictures fit the {noun}s in reverse order");
    orders.push((backwards, Box::new(move |i| Some(n - 1 - i)), 1));
    let mut spelt: Vec<usize> = (0..n).collect();
    spelt.sort_by(|a, b| id(*a).cmp(id(*b)));
    if spelt.iter().enumerate().any(|(i, j)| i != *j) {
        let mut rank = vec![0; n];
        spelt.iter().enumerate().for_each(|(i, j)| rank[*j] = i);
        let text = |pictures: &str, others: &str| {
            format!(
                "the pictures, sorted by their {pictures}, fit the {noun}s, sorted by their {others}"
            )
        };
        let to_spelling = text("numbers", "spelling");
        orders.push((to_spelling, Box::new(move |i| spelt.get(i).copied()), 1));
        let to_numbers = text("spelling", "numbers");
        orders.push((to_numbers, Box::new(move |i| rank.get(i).copied()), 1));
    }
    orders
}

/// Like [`orders`], for the mistake of keeping only every second or third picture, but all poses.
pub(super) fn thinned(views: &[View], noun: &str) -> Vec<(String, Assignment, usize)> {
    let strides = [(2, "second"), (3, "third")].into_iter();
    let strides = strides.filter(|(stride, _)| views.len() >= MIN_VIEWS.max(2 * stride));
    let all = strides.map(|(stride, which)| {
        let text = format!(
            "the pictures fit every {which} {noun}, starting with the first, as if only every {which} picture had been \
             kept, but all {noun}s"
        );
        let of: Assignment = Box::new(move |i| Some(stride * i));
        (text, of, 1)
    });
    all.collect()
}

/// True if no picture has two poses and no two pictures share a pose. Each pair is a picture and
/// its pose.
pub(super) fn is_one_to_one(assigned: &[(usize, usize)]) -> bool {
    assigned.iter().all(|one| {
        let mut others = assigned.iter();
        others.all(|other| (one.0 == other.0) == (one.1 == other.1))
    })
}

impl Neighbours<'_> {
    /// Evaluates other assignments of pictures to poses.
    pub(super) fn orders(&self, as_read: &[Explained]) -> Vec<(Change, Vec<Explained>)> {
        let starts: BTreeSet<usize> = self.carries.iter().map(|(a, _)| *a).collect();
        let mut measured = Vec::new();
        for &moves in self.moves() {
            let swapped = self.swaps();
            for (text, of, least_pairs) in orders(self.views, &starts, &swapped, moves.noun()) {
                let explained = self.in_order(as_read, &*of, moves);
                // Pictures that would have no pose are left unchanged.
                let given = explained.iter().filter(|one| one.is_some()).count();
                let all = explained.into_iter().zip(as_read);
                let all: Vec<Explained> = all.map(|(one, read)| one.unwrap_or(*read)).collect();
                let is_less = |(one, read): &(&Explained, &Explained)| {
                    mean_loss(&[**one]) <= (1.0 - MIN_GAIN) * mean_loss(&[**read])
                };
                let improved = all.iter().zip(as_read).filter(is_less).count();
                if 2 * given >= all.len() && improved >= 2 * least_pairs {
                    measured.push((Change::Order(text, moves), all));
                }
            }
            for (text, of, _) in thinned(self.views, moves.noun()) {
                let explained = self.in_order(as_read, &*of, moves);
                // A picture beyond the last pose cannot be evaluated. If such a picture fits its
                // own pose, this order is wrong.
                let fits = |(one, read): (&Option<Explained>, &Explained)| {
                    one.is_none() && !is_suspicious(&[*read])
                };
                if !explained.iter().zip(as_read).any(fits) {
                    let all = explained.into_iter().map(Option::unwrap_or_default);
                    measured.push((Change::Order(text, moves), all.collect()));
                }
            }
        }
        measured
    }

    /// The combinations of parts that may have been reassigned. Depth from maps may go with the picture or with the
    /// pose; depth from a scan always goes with the pose.
    fn moves(&self) -> &'static [Moves] {
        if self.depth_by_pose {
            &[Moves::PosesAndDepth]
        } else {
            &[Moves::Poses, Moves::PosesAndDepth, Moves::Depth]
        }
    }

    /// Pairs of views whose swap is tried: both views were read, and at least one is projected. None in a quick check.
    fn swaps(&self) -> Vec<(usize, usize)> {
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

    /// The poses of other views, with or without their depth, that explain pairs of neighbours best. Tried only in a
    /// thorough check of a scene with few views.
    pub(super) fn elsewhere(&self, as_read: &[Explained]) -> Vec<(Change, Vec<Explained>)> {
        let n = self.views.len();
        if !self.thorough || !(MIN_VIEWS..=MAX_ALL).contains(&n) {
            return Vec::new();
        }
        let all: Vec<(usize, usize)> = (0..n).flat_map(|a| (0..n).map(move |b| (a, b))).collect();
        let rough = self.stride_of(SAMPLES_ELSEWHERE);
        let found = self.moves().iter().filter(|moves| **moves != Moves::Depth);
        let found = found.map(|&moves| {
            let mut explained = as_read.to_vec();
            let (mut texts, mut assigned) = (Vec::new(), Vec::new());
            // Picture `i`, combined in turn with the parts `moves` of every view.
            let shown = |i: usize| -> Vec<Option<Read<'_>>> {
                (0..n).map(|from| self.shown(i, from, moves)).collect()
            };
            for (at, &(one, next)) in self.carries.iter().enumerate().step_by(2) {
                let (of_one, of_next) = (shown(one), shown(next));
                let as_if = |(a, b): (usize, usize), stride: usize| {
                    let pose = |i: usize| &self.views[i].camera_from_world;
                    let (x, y) = (of_one[a].as_ref()?, of_next[b].as_ref()?);
                    let to = |(x, a): (&Read<'_>, usize), (y, b): (&Read<'_>, usize)| {
                        let poses = (pose(a), pose(b));
                        Explained::new((&x.0, &x.1), &y.0, poses, &Reading::AS_READ, stride)
                    };
                    Some([to((x, a), (y, b)), to((y, b), (x, a))])
                };
                let others = all
                    .iter()
                    .filter(|(a, b)| a != b && (*a, *b) != (one, next));
                let others = others.filter_map(|pair| Some((*pair, as_if(*pair, rough)?)));
                let best = others.min_by(|(_, a), (_, b)| mean_loss(a).total_cmp(&mean_loss(b)));
                let best = best.and_then(|(pair, _)| Some((pair, as_if(pair, self.stride)?)));
                let own = mean_loss(&as_read[at..at + 2]);
                let best =
                    best.filter(|(_, best)| mean_loss(best) <= (1.0 - MIN_GAIN_ELSEWHERE) * own);
                if best.is_none() && fits_well(&as_read[at..at + 2]) {
                    assigned.extend([(one, one), (next, next)]);
                }
                if let Some(((a, b), best)) = best {
                    explained[at..at + 2].copy_from_slice(&best);
                    assigned.extend([(one, a), (next, b)]);
                    let id = |i: usize| &self.views[i].id;
                    let (one, next, a, b) = (id(one), id(next), id(a), id(b));
                    texts.push(format!("{one} and {next} fit the poses of {a} and {b}"));
                }
            }
            // Among so many poses, some fit by chance, but hardly as a consistent assignment.
            let change = if is_one_to_one(&assigned) {
                Change::Order(texts.join(", "), moves)
            } else {
                Change::Unlisted
            };
            (change, explained)
        });
        found.collect()
    }

    /// View `i`, with the parts that `moves` selects replaced by those of view `from`.
    fn shown_view(&self, i: usize, from: usize, moves: Moves) -> Option<Cow<'_, SmallView>> {
        let (view, _) = &self.small[&i];
        if moves == Moves::Poses || from == i {
            return Some(Cow::Borrowed(view));
        }
        let other = self.small.get(&from).map(|(view, _)| view);
        let other = other.or_else(|| self.around.get(&from))?;
        view.with_depth_of(other).map(Cow::Owned)
    }

    /// Like [`Self::shown_view`], with the samples of the view's depth.
    fn shown(&self, i: usize, from: usize, moves: Moves) -> Option<Read<'_>> {
        Some(match self.shown_view(i, from, moves)? {
            Cow::Borrowed(_) => Cow::Borrowed(&self.small[&i]),
            Cow::Owned(view) => {
                let samples = view.samples().collect();
                Cow::Owned((view, samples))
            }
        })
    }

    /// Evaluates each projection as if picture i had the pose, the depth map, or both (`moves`) of view `of(i)`. `None` if
    /// one of its two pictures gets no view, or one whose parts cannot be used, or if both get the same view.
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
        let carries = self.carries.iter().zip(as_read);
        let carries = carries.map(|((a, b), read)| {
            let from = (of(*a)?, of(*b)?);
            if from == (*a, *b) {
                return Some(*read);
            }
            let poses = (pose(*a)?, pose(*b)?);
            // Two views that receive the parts of the same view agree under any poses.
            if from.0 == from.1 {
                return None;
            }
            let a = self.shown(*a, from.0, moves)?;
            let b = self.shown_view(*b, from.1, moves)?;
            Some(Explained::new(
                (&a.0, &a.1),
                &b,
                poses,
                &Reading::AS_READ,
                self.stride,
            ))
        });
        carries.collect()
    }
}
