//! Detection of poses that stand still while the pictures move, and of pictures that stand still while the poses move.
//! Needs no depth.

use std::cmp::Reverse;
use std::collections::BTreeSet;
use std::io::{self, BufRead as _, BufReader};
use std::path::Path;

use sharp::camera::{RigidTransform, baseline_m};
use sharp::files::open_regular;

use super::Effort;
use super::features::{self, matched_views};
use super::neighbours::{MIN_MOVED, neighbours};
use super::plausible::is_same_pose;
use super::small_view::ray;
use crate::View;

/// Matches that move by less than this, in reduced pixels, stand still; they are located to whole pixels.
const STILL: f64 = 0.9;
/// Views with the same pose contradict it only if at most this fraction of their matches stand still. Where a camera stands
/// still in front of something that moves, the background stands still.
const MAX_STILL: f64 = 0.2;
/// If content hardly moves between the first two views of a run, the first is compared with the view this many places
/// after it, or with the last one if the run is shorter.
const FAR: usize = 5;
/// Number of pairs of neighbouring pictures whose files are compared; only files of the same size are compared.
const MAX_FILES: usize = 64;

/// Indices of the first and the last view of the longest runs of neighbouring views that have the same pose.
fn runs(views: &[View], effort: Effort) -> Vec<(usize, usize)> {
    let mut runs = Vec::new();
    let mut first = 0;
    for i in 1..=views.len() {
        let is_same = |view: &View| is_same_pose(view, &views[first]);
        if !views.get(i).is_some_and(is_same) {
            runs.extend((i - first >= 2).then_some((first, i - 1)));
            first = i;
        }
    }
    runs.sort_by_key(|(first, last)| Reverse(last - first));
    runs.truncate(effort.pairs);
    runs
}

/// Pairs of views of a run that are compared.
fn compared((first, last): (usize, usize)) -> BTreeSet<(usize, usize)> {
    BTreeSet::from([(first, first + 1), (first, last.min(first + FAR))])
}

/// Indices of the views that are read in a check: the examined pairs with the views before and after each, and some
/// views of runs with the same pose.
pub(super) fn looked_at(views: &[View], effort: Effort) -> BTreeSet<usize> {
    let of_runs = runs(views, effort).into_iter().flat_map(compared);
    let of_runs = of_runs.flat_map(|(a, b)| [a, b]);
    around(views, effort).into_iter().chain(of_runs).collect()
}

fn around(views: &[View], effort: Effort) -> BTreeSet<usize> {
    neighbours(views.len(), effort)
        .flat_map(|i| i.saturating_sub(1)..(i + 3).min(views.len()))
        .collect()
}

/// The distances by which matching features moved from one view to the other, apart from what the rotation between the
/// poses explains: in reduced pixels, in ascending order. `None` if too few features match.
fn moves(one: &View, other: &View) -> Option<Vec<f64>> {
    let other_from_one = (other.camera_from_world).after(&one.camera_from_world.inverse());
    let ([camera, other_camera], matches) = matched_views(one, other)?;
    let moves = matches.into_iter().filter_map(|[from, to]| {
        let place = other_camera.project(other_from_one.rotation * ray(&camera, from))?;
        Some(place.distance(to))
    });
    let mut moves: Vec<f64> = moves.collect();
    moves.sort_by(f64::total_cmp);
    (!moves.is_empty()).then_some(moves)
}

/// Reports a run of neighbouring views that have the same pose although the content of their pictures moves.
pub(super) fn frozen_poses(views: &[View], effort: Effort) -> Option<String> {
    runs(views, effort).into_iter().find_map(|run| {
        let moved = compared(run).into_iter().find_map(|(a, b)| {
            let moves = moves(&views[a], &views[b])?;
            let still = moves.partition_point(|by| *by < STILL);
            let median = moves[moves.len() / 2];
            let is_moved = median >= MIN_MOVED && still as f64 <= MAX_STILL * moves.len() as f64;
            is_moved.then_some((a, b, median))
        });
        let (a, b, median) = moved?;
        let (first, last) = run;
        let [a, b, from, to] = [a, b, first, last].map(|i| &views[i].id);
        Some(format!(
            "the {} views from {from} to {to} have the same pose, although their pictures move (between {a} and {b}, \
             matched features move by {median:.1} pixels, median at a width of at most {}); perhaps tracking was lost; \
             remove these views or recover their poses",
            last - first + 1,
            features::WIDEST
        ))
    })
}

/// Whether two files have the same bytes; reads only up to the first difference.
fn is_same(one: &Path, other: &Path) -> io::Result<bool> {
    let open = |file: &Path| open_regular(file).map(BufReader::new);
    let (mut one, mut other) = (open(one)?, open(other)?);
    loop {
        let (a, b) = (one.fill_buf()?, other.fill_buf()?);
        let n = a.len().min(b.len());
        if n == 0 || a[..n] != b[..n] {
            return Ok(a.is_empty() && b.is_empty());
        }
        one.consume(n);
        other.consume(n);
    }
}

/// Indices of views whose picture's file has the same bytes as that of the next view. A quick check compares the files
/// of [`looked_at`], a thorough check those of all views.
pub(super) fn same_files(views: &[View], effort: Effort) -> BTreeSet<usize> {
    let around = (!effort.thorough).then(|| around(views, effort));
    let is_read = |i: &usize| around.as_ref().is_none_or(|around| around.contains(i));
    let firsts = (1..views.len()).map(|i| i - 1);
    let pairs = firsts.filter(|i| is_read(i) && is_read(&(i + 1)));
    let pairs = pairs.filter_map(|i| {
        let file = |i: usize| views[i].content.image_file();
        let (one, other) = (file(i)?, file(i + 1)?);
        let size = |file: &Path| file.metadata().ok().map(|of| of.len());
        (size(one) == size(other)).then_some((i, one, other))
    });
    let same = pairs
        .take(MAX_FILES)
        .filter(|(_, one, other)| one != other && is_same(one, other).unwrap_or(false));
    same.map(|(i, ..)| i).collect()
}

/// Reports two neighbouring views that have the same picture although their poses move its content. `same` holds the
/// indices of views that have the same picture as the next one.
pub(super) fn repeated_pictures(
    views: &[View],
    same: &BTreeSet<usize>,
    effort: Effort,
) -> Option<String> {
    let step =
        |a: usize, b: usize| baseline_m(&views[a].camera_from_world, &views[b].camera_from_world);
    let mut widest: Vec<usize> = same.iter().copied().collect();
    widest.sort_by(|a, b| step(*b, b + 1).total_cmp(&step(*a, a + 1)));
    let read = (!effort.thorough).then(|| around(views, effort));
    let is_moved = |i: &usize| {
        let pose = |i: usize| -> &RigidTransform { &views[i].camera_from_world };
        let k = views[*i].intrinsics;
        let turn = pose(i + 1)
            .after(&pose(*i).inverse())
            .rotation_deg()
            .to_radians();
        let turned = turn * k.fx / f64::from(k.width.div_ceil(features::WIDEST));
        // A view with another picture shows how far a step of the camera moves the content.
        let others = [i + 2, i.wrapping_sub(1)].into_iter();
        let others = others.filter(|j| read.as_ref().is_none_or(|read| read.contains(j)));
        let mut by_step = others.filter_map(|j| {
            let moves = moves(&views[*i], views.get(j)?)?;
            Some(moves[moves.len() / 2] * step(*i, i + 1) / step(*i, j))
        });
        turned >= MIN_MOVED
            || step(*i, i + 1) > 0.0 && by_step.any(|by| by.is_finite() && by >= MIN_MOVED)
    };
    let first = widest.into_iter().take(effort.pairs).find(is_moved)?;
    let [a, b] = [first, first + 1].map(|i| &views[i].id);
    let others = match same.len() - 1 {
        0 => String::new(),
        others => format!(" ({others} more pairs of neighbours have the same picture)"),
    };
    Some(format!(
        "{a} and {b} have the same picture{others}, although their poses move its content by {MIN_MOVED} pixels or more \
         (in pictures up to {} pixels wide); give each view its own picture, or remove repeated ones",
        features::WIDEST
    ))
}
