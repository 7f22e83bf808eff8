//! Contradictions that no known change explains: features match between two pictures, but not at the places that poses,
//! cameras and depth predict.

use std::collections::BTreeMap;

use super::features::{CLOSE as CLOSE_TO_LINE, MIN_MATCHES, Matches, NEAR, lies, pixel};
use super::neighbours::Neighbours;
use super::small_view::{WIDEST, ray};

/// Depth contradicts a pair of views if the median distance of matches from their predicted places is at least this, in
/// reduced pixels, and few matches are close to these places ([`MAX_CLOSE`]). Consistent scenes have medians below 1.
const MIN_MISS: f64 = 2.5;
/// Depth contradicts a pair of views ([`MIN_MISS`]) only if at most this fraction of the matches are within [`CLOSE`]
/// of their predicted places. Consistent scenes have fractions above 0.8.
const MAX_CLOSE: f64 = 0.35;
/// Distance, in reduced pixels, within which a match is close to its predicted place.
const CLOSE: f64 = 2.0;
/// Depth that covers little of the pictures is judged by the matches of all pairs together, if they have depth at this
/// many matches at least.
const MIN_POOLED: usize = 12;
/// Poses and pictures contradict each other if at most this fraction of the matches are near their epipolar lines. Even
/// the lines of unrelated poses pass near some matches.
const MAX_NEAR_LINES: f64 = 0.35;
/// Poses and pictures agree if at least this fraction of the matches are on their epipolar lines.
const MIN_ON_LINES: f64 = 0.8;

/// Possible causes of depth from a scan that does not fit.
pub(super) const MISPLACED_SCAN: &str = "perhaps the transformation that places the scan is wrong or missing, or the \
                                         scan is in another unit than the poses";

/// Measures how well poses, cameras and depth predict the features that match between a view and the next.
#[derive(Debug)]
struct Residual {
    first: usize,
    matches: usize,
    /// Number of matches on each other's epipolar lines.
    on_lines: usize,
    /// Number of matches near each other's epipolar lines.
    close: usize,
    /// Distances of matches from their predicted places, in reduced pixels, ascending.
    misses: Vec<f64>,
}

impl Residual {
    fn of(first: usize) -> Self {
        Self {
            first,
            matches: 0,
            on_lines: 0,
            close: 0,
            misses: Vec::new(),
        }
    }

    /// One residual for each view that has matches. Without depth, their `misses` are empty.
    fn all(matches: &Matches<'_>, depth: Option<&Neighbours<'_>>) -> Vec<Self> {
        let mut all: BTreeMap<usize, Self> = BTreeMap::new();
        for (i, a, b) in &matches.matches {
            let [(pose, camera), (next_pose, next_camera)] =
                [*i, i + 1].map(|i| (&matches.views[i].camera_from_world, &matches.cameras[&i]));
            let next_from_view = next_pose.after(&pose.inverse());
            let rays = (ray(camera, *a), ray(next_camera, *b));
            let residual = all.entry(*i).or_insert(Self::of(*i));
            residual.matches += 1;
            let [on, close] = [NEAR, CLOSE_TO_LINE]
                .map(|near| lies(&next_from_view, rays, near * pixel(next_camera)));
            residual.on_lines += usize::from(on);
            residual.close += usize::from(close);
            let miss = depth.and_then(|depth| depth.miss((*i, camera, *a), next_camera, *b));
            residual.misses.extend(miss);
        }
        for residual in all.values_mut() {
            residual.misses.sort_by(f64::total_cmp);
        }
        all.into_values().collect()
    }

    /// Fraction of the matches near their epipolar lines.
    fn near_lines(&self) -> f64 {
        self.close as f64 / self.matches.max(1) as f64
    }

    /// True if poses and pictures agree.
    fn is_on_lines(&self) -> bool {
        self.on_lines as f64 >= MIN_ON_LINES * self.matches as f64
    }

    /// Median distance of matches from their predicted places; `None` if there are too few matches,
    /// or if the matches do not contradict depth.
    fn misses_by(&self) -> Option<f64> {
        median_miss(&self.misses).filter(|_| self.misses.len() >= MIN_MATCHES)
    }

    fn is_off_lines(&self) -> bool {
        self.matches >= MIN_MATCHES && self.near_lines() <= MAX_NEAR_LINES
    }

    fn is_contradicted(&self) -> bool {
        self.is_off_lines() || self.misses_by().is_some()
    }
}

/// Median of ascending distances of matches from their predicted places; `None` if the matches do not contradict depth.
fn median_miss(misses: &[f64]) -> Option<f64> {
    let median = *misses.get(misses.len() / 2)?;
    let close = misses.partition_point(|miss| *miss < CLOSE);
    (median >= MIN_MISS && close as f64 <= MAX_CLOSE * misses.len() as f64).then_some(median)
}

/// A sentence on sparse depth that the matches of all pairs contradict together, although each pair has depth at too few
/// of them. Only pairs whose pictures fit their poses, and whose colours do not fit depth, are considered.
fn sparse_contradiction(residuals: &[Residual], neighbours: &Neighbours<'_>) -> Option<String> {
    let misses = residuals
        .iter()
        .filter(|one| one.is_on_lines() && !neighbours.is_explained(one.first))
        .flat_map(|one| one.misses.iter().copied());
    let mut misses: Vec<f64> = misses.collect();
    misses.sort_by(f64::total_cmp);
    let median = median_miss(&misses).filter(|_| misses.len() >= MIN_POOLED)?;
    Some(format!(
        "pictures and poses fit each other, so depth does not fit them, and no known correction explains it: depth and \
         poses predict {} matched features {} away; {}",
        misses.len(),
        distance(median),
        unfitting_depth(neighbours)
    ))
}

fn distance(median: f64) -> String {
    if median.is_finite() {
        format!("{median:.1} pixels (median at a width of at most {WIDEST}; below 1 is usual)")
    } else {
        "far".to_owned()
    }
}

/// Possible causes of depth that fits neither pictures nor poses.
fn unfitting_depth(neighbours: &Neighbours<'_>) -> &'static str {
    if neighbours.depth_by_pose {
        MISPLACED_SCAN
    } else {
        "perhaps depth is nonlinear, is wrapped around, or belongs to another source or picture size"
    }
}

/// A sentence on the pair that fits worst, if poses, cameras and depth contradict the features of any pair.
pub(super) fn contradiction(
    matches: &Matches<'_>,
    neighbours: Option<&Neighbours<'_>>,
) -> Option<String> {
    let residuals = Residual::all(matches, neighbours);
    // If the colours fit, the features are probably parts of a repeated pattern that were matched wrongly.
    let is_explained = |one: &Residual| neighbours.is_some_and(|all| all.is_explained(one.first));
    let contradicted = residuals.iter().filter(|one| one.is_contradicted());
    let contradicted: Vec<&Residual> = contradicted.filter(|one| !is_explained(one)).collect();
    let mut contradicted = contradicted.into_iter();
    let n = contradicted.clone().count();
    if n == 0 {
        return sparse_contradiction(&residuals, neighbours?);
    }
    let by_lines = contradicted.clone();
    let worst = by_lines.min_by(|a, b| a.near_lines().total_cmp(&b.near_lines()))?;
    let [one, next] = [worst.first, worst.first + 1].map(|i| matches.id(i));
    let lines = format!(
        "between {one} and {next}, {:.0} % of {} matched features lie near their epipolar lines",
        100.0 * worst.near_lines(),
        worst.matches
    );
    let is_comparable = |one: &&Residual| one.matches >= MIN_MATCHES;
    let comparable = residuals.iter().filter(is_comparable).count();
    let misses = worst.misses_by().map_or(String::new(), |median| {
        format!(
            ", and depth and poses predict them {} away",
            distance(median)
        )
    });
    let (what, causes) = if contradicted.all(Residual::is_on_lines) {
        (
            "pictures and poses fit each other, so depth does not fit them",
            neighbours.map_or("", unfitting_depth),
        )
    } else {
        (
            "pictures and poses contradict each other",
            "perhaps the poses are from another model, delayed, or relative to the previous frame, or pictures were \
             repeated, cropped or turned",
        )
    };
    Some(format!(
        "{what}, and no known correction explains it: {n} of {comparable} comparable pairs of neighbours are inconsistent \
         ({lines}{misses}); {causes}"
    ))
}
