//! Check without depth: tests whether features that match between neighbouring views lie on each other's epipolar
//! lines, in front of both cameras. Also tests whether another interpretation of the poses explains the features
//! better.

mod focals;

use std::cmp::Reverse;
use std::collections::{BTreeMap, BTreeSet};

use glam::{DVec2, DVec3};
use sharp::camera::{Intrinsics, RigidTransform};

use super::Effort;
use super::advice::{self, Units};
use super::change::{Change, Moves};
use super::convention::{CONVENTIONS, alternatives};
use super::neighbours::neighbours;
use super::orders::{is_one_to_one, orders, thinned};
use super::small_view::{Grey, SmallView, ray};
use crate::View;
use crate::view::evenly_spaced;

pub(super) use focals::swapped_focals;

/// Maximum width of the reduced views, in pixels.
pub(super) const WIDEST: u32 = 192;
/// Number of cells across and down; each gives one feature.
const CELLS: (u32, u32) = (14, 10);
/// Radius of the patch around a feature that is compared, in pixels.
const RADIUS: u32 = 3;
/// Patches match only if their correlation is at least this.
const MIN_ALIKE: f32 = 0.85;
/// A match is unique if its distance (1 − correlation) is below this multiple of the second-best match's distance.
const UNIQUE: f32 = 0.6;
/// A match lies on its epipolar line if it is at most this far from the line, in pixels.
pub(super) const NEAR: f64 = 1.0;
/// Like [`NEAR`], in pixels, but wide enough for poses that are merely imprecise.
pub(super) const CLOSE: f64 = 3.0;
/// Minimum width and height of reduced views; smaller ones are skipped, because a pixel is too large a fraction of
/// them.
const MIN_SIDE: u32 = 48;
/// Poses are judged only if there are at least this many matches.
pub(super) const MIN_MATCHES: usize = 30;
/// A scene is examined more closely if the dataset reader's interpretation explains less than this fraction of the matches.
const MIN_EXPLAINED: f64 = 0.75;
/// Another interpretation counts as better only if it explains at least this fraction of the matches.
const MIN_SHARE: f64 = 0.6;
/// Another interpretation must explain a larger fraction of the matches than the dataset reader's own, by at least
/// this.
pub(super) const MIN_MORE: f64 = 0.2;
/// Another interpretation must explain more matches than the dataset reader's own, by at least this many standard
/// errors.
const MIN_ERRORS: f64 = 4.0;
/// Two interpretations are about equal if the number of matches that only the first explains differs from the number
/// that only the second explains by at most this many standard errors.
const MAX_ERRORS_OF_EQUALS: f64 = 2.0;
/// Maximum number of views whose poses are tried, two at a time, for two pictures.
const MAX_TRIED: usize = 48;
/// The poses of other views are reported only if they explain at least this fraction of the matches.
const MIN_ELSEWHERE: f64 = 0.75;
/// The poses of other views are reported only if the pictures' own poses explain at most this fraction of the matches.
/// If they explain more, they may merely be imprecise, and one of many alternatives may fit better by chance.
const MAX_AS_READ: f64 = 0.5;

/// Indices of two views whose poses fit two pictures, a description, and for each match whether
/// these poses explain it.
type Elsewhere = ((usize, usize), String, Vec<Option<bool>>);

/// Features that match between neighbouring views.
pub(super) struct Matches<'a> {
    pub(super) views: &'a [View],
    pub(super) cameras: BTreeMap<usize, Intrinsics>,
    /// View index, and the positions in that view and in the next.
    pub(super) matches: Vec<(usize, DVec2, DVec2)>,
    /// Indices of views that have the same picture as the next view.
    pub(super) repeated: BTreeSet<usize>,
}

/// The reduced picture of a view; `None` if it cannot be read, or is smaller than [`MIN_SIDE`].
fn grey(view: &View) -> Option<Grey> {
    let grey = SmallView::new(view, false, WIDEST)?.grey();
    (grey.size().0.min(grey.size().1) >= MIN_SIDE).then_some(grey)
}

/// Cameras of two views at reduced size, and the places of features that match in both directions, in the first view and
/// in the second. `None` if a view cannot be read, or if fewer than [`MIN_MATCHES`] features match.
pub(super) fn matched_views(
    one: &View,
    other: &View,
) -> Option<([Intrinsics; 2], Vec<[DVec2; 2]>)> {
    let (a, b) = (grey(one)?, grey(other)?);
    let found = matched(&a, &b, true).into_iter();
    let found: Vec<[DVec2; 2]> = found.map(|(at, to)| [at, to]).collect();
    (found.len() >= MIN_MATCHES).then_some(([a.camera, b.camera], found))
}

/// Places of features of one picture and of their unique matches in another. If `both_ways`, each of the two features
/// must be the best match of the other, which rules out most wrong matches in repeated patterns.
fn matched(a: &Grey, b: &Grey, both_ways: bool) -> Vec<(DVec2, DVec2)> {
    let patches_a = both_ways.then(|| patches(a));
    let patches_b = patches(b);
    let found = features(a).into_iter().filter_map(|at| {
        let place = |(x, y)| DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
        let found = matching(&patch(a, at), at, b.size(), &patches_b);
        let (to, _) = found.filter(|(_, is_unique)| *is_unique)?;
        let returns = |patches_a: &Vec<_>| {
            let back = matching(&patch(b, to), to, a.size(), patches_a);
            back.is_some_and(|(back, _)| !is_apart(back, at))
        };
        let is_match = patches_a.as_ref().is_none_or(returns);
        is_match.then(|| (place(at), place(to)))
    });
    found.collect()
}

impl<'a> Matches<'a> {
    /// Matches features of neighbouring views, `both_ways` as for [`matched`].
    pub(super) fn new(views: &'a [View], effort: Effort, both_ways: bool) -> Self {
        let firsts: Vec<usize> = neighbours(views.len(), effort).collect();
        let wanted: BTreeSet<usize> = firsts.iter().flat_map(|i| [*i, *i + 1]).collect();
        let grey = |i: &usize| Some((*i, grey(&views[*i])?));
        let grey: BTreeMap<usize, Grey> = wanted.iter().filter_map(grey).collect();
        let (mut matches, mut repeated) = (Vec::new(), BTreeSet::new());
        for i in firsts {
            if let (Some(a), Some(b)) = (grey.get(&i), grey.get(&(i + 1))) {
                let found = matched(a, b, both_ways).into_iter();
                matches.extend(found.map(|(at, to)| (i, at, to)));
                repeated.extend(a.is_same(b).then_some(i));
            }
        }
        Self {
            views,
            cameras: grey.into_iter().map(|(i, grey)| (i, grey.camera)).collect(),
            matches,
            repeated,
        }
    }

    /// Describes how well the matches agree with the poses under the reader's interpretation.
    pub(super) fn note(&self) -> String {
        let explained = self.explained(CONVENTIONS[0].take, &Some);
        let (n, share) = (self.matches.len(), share(&explained));
        let unjudged = if share >= MIN_SHARE && self.leaves_focals_open(share) {
            ", which does not show whether focal lengths are correct"
        } else {
            ""
        };
        if n >= MIN_MATCHES {
            format!(
                "poses (checked without depth): {:.0} % of {n} features that match between neighbouring views lie on their \
                 epipolar lines{unjudged}",
                100.0 * share
            )
        } else {
            format!(
                "poses: not checked (no depth, and only {n} features match between neighbouring views)"
            )
        }
    }

    /// True if fewer matches than in valid data lie on their epipolar lines.
    pub(super) fn is_poorly_explained(&self) -> bool {
        share(&self.explained(CONVENTIONS[0].take, &Some)) < MIN_EXPLAINED
    }

    pub(super) fn contradiction(&self, units: Units) -> Option<String> {
        if self.matches.len() < MIN_MATCHES {
            return None;
        }
        let as_read = self.explained(CONVENTIONS[0].take, &Some);
        let conventions = alternatives(units.poses_are_matrices).map(|convention| {
            let change = Change::Convention(convention.name);
            (change, self.explained(convention.take, &Some))
        });
        let order = |text| Change::Order(text, Moves::Poses);
        let starts: BTreeSet<usize> = self.matches.iter().map(|found| found.0).collect();
        let seen = || self.cameras.keys().copied();
        let swapped = seen().flat_map(|a| seen().filter(move |b| *b > a).map(move |b| (a, b)));
        let swapped: Vec<(usize, usize)> = swapped.collect();
        let noun = Moves::Poses.noun();
        let orders = orders(self.views, &starts, &swapped, noun).into_iter();
        let orders = orders.chain(thinned(self.views, noun));
        let orders = orders.map(|(text, pose_of, _)| {
            (order(text), self.explained(CONVENTIONS[0].take, &*pose_of))
        });
        let elsewhere = self.all_elsewhere(&starts, &as_read).into_iter();
        let elsewhere = elsewhere.map(|(text, explained)| (order(text), explained));
        let cameras = self.swapped_cameras().into_iter();
        let better = cameras.chain(conventions).chain(self.other_focal(&as_read));
        let better = better.chain(orders).chain(elsewhere);
        let better =
            better.filter_map(|(change, other)| Some((change, compared(&as_read, &other)?, other)));
        // Of equally good changes, takes the first, which is the simplest.
        let (change, found, explained) =
            better.min_by_key(|(_, found, _)| Reverse(found.after - found.before))?;
        let is_shifted = share(&explained) + MIN_MORE <= 1.0;
        if let Some(shifted) = is_shifted.then(|| self.shifted(&explained)).flatten() {
            return Some(shifted);
        }
        let (change, evidence) = match change {
            Change::Convention(_) => self.convention(units, &as_read, &explained)?,
            change => (change, found.evidence()),
        };
        Some(advice::sentence(&change, &evidence, units, 1.0, self.views))
    }

    /// Of the conventions that explain about as many matches as `best` does, the one whose epipolar lines are closest to
    /// the matches. The evidence names the others.
    fn convention(
        &self,
        units: Units,
        as_read: &[Option<bool>],
        best: &[Option<bool>],
    ) -> Option<(Change, String)> {
        let alike = alternatives(units.poses_are_matrices).filter_map(|convention| {
            let explained = self.explained(convention.take, &Some);
            let found = compared(as_read, &explained)?;
            is_about_equal(&explained, best)
                .then(|| (self.mean_miss(convention.take), convention.name, found))
        });
        let mut alike: Vec<(f64, &str, Compared)> = alike.collect();
        alike.sort_by(|a, b| a.0.total_cmp(&b.0));
        let mut names = BTreeSet::new();
        alike.retain(|(_, name, _)| names.insert(*name));
        let mut alike = alike.into_iter();
        let (_, name, found) = alike.next()?;
        let others: Vec<&str> = alike.map(|(_, name, _)| name).collect();
        let mut evidence = found.evidence();
        if !others.is_empty() {
            evidence += &format!(
                "; about as many features fit with {}",
                others.join(", or with ")
            );
        }
        Some((Change::Convention(name), evidence))
    }

    pub(super) fn id(&self, i: usize) -> &str {
        &self.views[i].id
    }

    /// Evidence that the two pictures of a pair are swapped; `None` if it is not significant.
    pub(super) fn swapped(&self) -> Option<String> {
        let as_read = self.explained(CONVENTIONS[0].take, &Some);
        let other = self.explained(CONVENTIONS[0].take, &|i| Some(1 - i));
        Some(compared(&as_read, &other)?.evidence())
    }

    /// Finds pairs (a view in `starts` and the next one) whose matches are explained by the poses of two other views,
    /// but not by their own. Returns a sentence for each pair, with the matches explained. Because some of so many
    /// poses fit by chance, returns nothing if a pair with enough matches remains unexplained, or if two pictures would
    /// share a pose.
    fn all_elsewhere(
        &self,
        starts: &BTreeSet<usize>,
        as_read: &[Option<bool>],
    ) -> Vec<(String, Vec<Option<bool>>)> {
        let (mut found, mut assigned) = (Vec::new(), Vec::new());
        for &first in starts {
            let own = self.matches.iter().zip(as_read);
            let own = own.filter(|(found, _)| found.0 == first);
            let own: Vec<Option<bool>> = own.map(|(_, explained)| *explained).collect();
            if share(&own) > MAX_AS_READ {
                assigned.extend([(first, first), (first + 1, first + 1)]);
            } else if let Some(((a, b), text, explained)) = self.elsewhere(first, as_read) {
                assigned.extend([(first, a), (first + 1, b)]);
                found.push((text, explained));
            } else if own.len() >= MIN_MATCHES {
                return Vec::new();
            }
        }
        if is_one_to_one(&assigned) {
            found
        } else {
            Vec::new()
        }
    }

    /// The poses of two views that explain most of the matches of view `first` and the next one. `None` if no poses
    /// explain enough of them, or if the pictures' own poses explain too many of them.
    fn elsewhere(&self, first: usize, as_read: &[Option<bool>]) -> Option<Elsewhere> {
        let all = 0..self.views.len();
        let some = evenly_spaced(self.views.len(), MAX_TRIED);
        let pairs = some.iter().flat_map(|a| some.iter().map(|b| (*a, *b)));
        let pairs = pairs.chain(all.clone().map(|a| (a, first + 1)));
        let pairs = pairs.chain(all.map(|b| (first, b)));
        let explained = pairs.filter(|(a, b)| a != b).map(|(a, b)| {
            let explained = self.explained(CONVENTIONS[0].take, &|i| match i {
                i if i == first => Some(a),
                i if i == first + 1 => Some(b),
                _ => None,
            });
            ((a, b), explained)
        });
        let count =
            |explained: &[Option<bool>]| explained.iter().filter(|one| **one == Some(true)).count();
        let ((a, b), best) = explained.max_by_key(|(_, explained)| count(explained))?;
        let own = as_read.iter().zip(&best).filter(|(_, best)| best.is_some());
        let own: Vec<Option<bool>> = own.map(|(read, _)| *read).collect();
        let id = |i: usize| &self.views[i].id;
        let (one, next) = (id(first), id(first + 1));
        let text = format!("{one} and {next} fit the poses of {} and {}", id(a), id(b));
        let is_needed = share(&own) <= MAX_AS_READ;
        (is_needed && share(&best) >= MIN_ELSEWHERE).then_some(((a, b), text, best))
    }

    /// For each match, true if an interpretation explains it; `None` if `pose_of` gives no pose for
    /// one of the two pictures.
    fn explained(
        &self,
        take: fn(&RigidTransform) -> RigidTransform,
        pose_of: &dyn Fn(usize) -> Option<usize>,
    ) -> Vec<Option<bool>> {
        let pose = |i: usize| Some(take(&self.views.get(pose_of(i)?)?.camera_from_world));
        // A pose is used with the camera of its own frame, provided that both pictures have the same size.
        let camera = |i: usize| {
            let (own, other) = (
                &self.cameras[&i],
                pose_of(i).and_then(|j| self.cameras.get(&j)),
            );
            let is_same_size = |k: &&Intrinsics| (k.width, k.height) == (own.width, own.height);
            other.filter(is_same_size).unwrap_or(own)
        };
        let is_explained = |(i, a, b): &(usize, DVec2, DVec2)| {
            let other_from_one = pose(i + 1)?.after(&pose(*i)?.inverse());
            Some(fits(
                &other_from_one,
                ray(camera(*i), *a),
                camera(i + 1),
                *b,
            ))
        };
        self.matches.iter().map(is_explained).collect()
    }
}

pub(super) fn share(explained: &[Option<bool>]) -> f64 {
    let given = explained.iter().flatten();
    given.clone().filter(|one| **one).count() as f64 / given.count().max(1) as f64
}

/// Number of matches, and how many of them each of two interpretations explains.
struct Compared {
    matches: usize,
    before: usize,
    after: usize,
}

impl Compared {
    fn evidence(&self) -> String {
        let percent = |count: usize| 100.0 * count as f64 / self.matches as f64;
        format!(
            "of {} features matched between neighbouring views, {:.0} % lie on their epipolar lines instead of {:.0} %",
            self.matches,
            percent(self.after),
            percent(self.before)
        )
    }
}

/// Compares two interpretations; `None` unless `other` explains significantly more matches.
fn compared(as_read: &[Option<bool>], other: &[Option<bool>]) -> Option<Compared> {
    let both = as_read
        .iter()
        .zip(other)
        .filter_map(|(one, other)| Some(((*one)?, (*other)?)));
    let both: Vec<(bool, bool)> = both.collect();
    let count = |of: (bool, bool)| both.iter().filter(|found| **found == of).count() as f64;
    let (gained, lost, kept) = (
        count((false, true)),
        count((true, false)),
        count((true, true)),
    );
    let is_better = both.len() >= MIN_MATCHES
        && gained + kept >= MIN_SHARE * both.len() as f64
        && gained - lost >= MIN_MORE * both.len() as f64
        && gained - lost >= MIN_ERRORS * (gained + lost).sqrt();
    is_better.then_some(Compared {
        matches: both.len(),
        before: (lost + kept) as usize,
        after: (gained + kept) as usize,
    })
}

/// True if neither of two interpretations explains significantly more matches than the other.
fn is_about_equal(one: &[Option<bool>], other: &[Option<bool>]) -> bool {
    let count = |of: (bool, bool)| {
        let both = one.iter().copied().zip(other.iter().copied());
        let differing = both.filter(|found| *found == (Some(of.0), Some(of.1)));
        differing.count() as f64
    };
    let (first, second) = (count((true, false)), count((false, true)));
    (first - second).abs() <= MAX_ERRORS_OF_EQUALS * (first + second).sqrt()
}

/// True if the pixel at a position in the second view may show a point on a ray of the first view.
fn fits(
    second_from_first: &RigidTransform,
    from: DVec3,
    second: &Intrinsics,
    place: DVec2,
) -> bool {
    let rays = (from, ray(second, place));
    lies(second_from_first, rays, NEAR * pixel(second))
}

/// Size of a pixel at z = 1, in the direction in which it is smaller.
pub(super) fn pixel(camera: &Intrinsics) -> f64 {
    1.0 / camera.fx.max(camera.fy)
}

/// True if two rays, one from each view, pass within `near` of each other, measured at z = 1 of the second view.
pub(super) fn lies(second_from_first: &RigidTransform, rays: (DVec3, DVec3), near: f64) -> bool {
    miss(second_from_first, rays, near) < near
}

/// Distance by which two rays, one from each view, miss each other, measured at z = 1 of the second view. 0 for rays
/// that are parallel up to `near`, and infinite for rays that meet behind a camera.
fn miss(second_from_first: &RigidTransform, (from, to): (DVec3, DVec3), near: f64) -> f64 {
    let (turned, t) = (
        second_from_first.rotation * from,
        second_from_first.translation,
    );
    let line = t.cross(turned);
    let slope = line.truncate().length();
    let parallax = to.cross(turned);
    // Without parallax, accept the match: either the point is far away or the cameras are at the same position.
    let far = turned.z > 0.0 && parallax.length() < near * turned.length() * to.length();
    if far {
        return 0.0;
    }
    let depth = -to.cross(t).dot(parallax) / parallax.length_squared();
    let there = (turned * depth + t).z;
    if slope >= 1e-12 && depth > 0.0 && there > 0.0 {
        line.dot(to).abs() / slope
    } else {
        f64::INFINITY
    }
}

/// The pixel of each cell that is most like a corner: the one whose smaller variation, horizontal or vertical, is
/// largest. Flat cells are omitted.
fn features(grey: &Grey) -> Vec<(u32, u32)> {
    let (w, h) = grey.size();
    let margin = RADIUS + 1;
    let varies = |x: u32, y: u32| {
        let (mut across, mut down) = (0.0, 0.0);
        for (u, v) in around(x, y) {
            across += (grey.at(u + 1, v) - grey.at(u - 1, v)).abs();
            down += (grey.at(u, v + 1) - grey.at(u, v - 1)).abs();
        }
        f32::min(across, down)
    };
    let cells = (0..CELLS.1).flat_map(|row| (0..CELLS.0).map(move |column| (column, row)));
    let best = cells.filter_map(|(column, row)| {
        let range = |i: u32, n: u32, side: u32| {
            (i * side / n).max(margin)..((i + 1) * side / n).min(side.saturating_sub(margin))
        };
        let pixels =
            range(row, CELLS.1, h).flat_map(|y| range(column, CELLS.0, w).map(move |x| (x, y)));
        let pixels = pixels.map(|(x, y)| (varies(x, y), (x, y)));
        pixels
            .filter(|(most, _)| most.is_finite())
            .max_by(|a, b| a.0.total_cmp(&b.0))
    });
    // A flat patch matches anywhere, so require four levels per pixel.
    let least = 4.0 * (2 * RADIUS + 1).pow(2) as f32;
    best.filter(|(most, _)| *most > least)
        .map(|(_, at)| at)
        .collect()
}

fn around(x: u32, y: u32) -> impl Iterator<Item = (u32, u32)> {
    let rows = y - RADIUS..=y + RADIUS;
    rows.flat_map(move |v| (x - RADIUS..=x + RADIUS).map(move |u| (u, v)))
}

/// The patch around a pixel, normalised to mean 0 and length 1.
fn patch(grey: &Grey, (x, y): (u32, u32)) -> [f32; PATCH] {
    let mut values = [0.0; PATCH];
    values
        .iter_mut()
        .zip(around(x, y))
        .for_each(|(value, (u, v))| *value = grey.at(u, v));
    let mean = values.iter().sum::<f32>() / PATCH as f32;
    values.iter_mut().for_each(|value| *value -= mean);
    let length = values.iter().map(|value| value * value).sum::<f32>().sqrt();
    values.map(|value| value / length.max(1.0))
}

const PATCH: usize = (2 * RADIUS as usize + 1).pow(2);

/// Patches around all pixels that are far enough from the border, row by row.
fn patches(grey: &Grey) -> Vec<[f32; PATCH]> {
    let (w, h) = grey.size();
    let inner = |side: u32| RADIUS..side.saturating_sub(RADIUS);
    let all = inner(h).flat_map(|y| inner(w).map(move |x| (x, y)));
    all.map(|at| patch(grey, at)).collect()
}

/// True if two pixels are too far apart to belong to the same feature.
fn is_apart(one: (u32, u32), other: (u32, u32)) -> bool {
    one.0.abs_diff(other.0).max(one.1.abs_diff(other.1)) > RADIUS
}

/// The pixel of another view that matches a patch best, searched within a quarter of the picture around the patch's
/// position, and whether this match is unique. `None` if no pixel matches well enough.
fn matching(
    wanted: &[f32; PATCH],
    at: (u32, u32),
    (w, h): (u32, u32),
    patches: &[[f32; PATCH]],
) -> Option<((u32, u32), bool)> {
    let range = |at: u32, side: u32| {
        let last = side.saturating_sub(RADIUS);
        at.saturating_sub(side / 4).max(RADIUS)..(at + side / 4).min(last)
    };
    let places = range(at.1, h).flat_map(|y| range(at.0, w).map(move |x| (x, y)));
    let found = places.map(|(x, y)| {
        let other = &patches[((y - RADIUS) * (w - 2 * RADIUS) + x - RADIUS) as usize];
        let alike: f32 = wanted.iter().zip(other).map(|(a, b)| a * b).sum();
        (alike, (x, y))
    });
    let found = found.filter(|(alike, _)| *alike > MIN_ALIKE - (1.0 - MIN_ALIKE));
    let found: Vec<(f32, (u32, u32))> = found.collect();
    let (best, place) = found.iter().copied().max_by(|a, b| a.0.total_cmp(&b.0))?;
    let next = found
        .iter()
        .filter(|found| is_apart(found.1, place))
        .map(|found| found.0)
        .fold(0.0, f32::max);
    (best >= MIN_ALIKE).then_some((place, 1.0 - best < UNIQUE * (1.0 - next)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::check::convention::flip;
    use crate::check::tests::views;
    use crate::check::{QUICK, THOROUGH};

    const SIZE: (u32, u32) = (256, 192);

    #[test]
    fn wrong_poses_are_found_without_depth_and_right_ones_are_not() {
        for seed in 0..3 {
            let right = views(seed, SIZE);
            for effort in [QUICK, THOROUGH] {
                let matches = Matches::new(&right, effort, true);
                assert_eq!(matches.contradiction(Units::default()), None, "{seed}");
                let explained = matches.explained(|pose| *pose, &Some);
                assert!(
                    explained.len() > MIN_MATCHES && share(&explained) > 0.6,
                    "{}",
                    matches.note()
                );
            }
            type Spoil = fn(&mut [View]);
            let cases: [(Spoil, &str); 2] = [
                (
                    |v| {
                        v.iter_mut()
                            .for_each(|v| v.camera_from_world = flip(&v.camera_from_world))
                    },
                    "OpenGL",
                ),
                (
                    |v| {
                        let poses: Vec<_> = v.iter().map(|v| v.camera_from_world).collect();
                        v.iter_mut()
                            .zip(poses.into_iter().rev())
                            .for_each(|(v, pose)| v.camera_from_world = pose);
                    },
                    "reverse order",
                ),
            ];
            for (spoil, named) in cases {
                let mut wrong = right.clone();
                spoil(&mut wrong);
                let matches = Matches::new(&wrong, THOROUGH, true);
                let found = matches.contradiction(Units::default());
                assert!(
                    found.as_ref().is_some_and(|f| f.contains(named)),
                    "{seed} {named}: {found:?} {}",
                    matches.note()
                );
            }
        }
    }

    #[test]
    fn pictures_without_features_say_nothing() {
        let views = &views(0, SIZE)[..1];
        let matches = Matches::new(views, THOROUGH, true);
        assert_eq!(matches.contradiction(Units::default()), None);
        assert!(
            matches
                .note()
                .ends_with("match between neighbouring views)")
        );
    }
}
