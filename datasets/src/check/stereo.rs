//! Checks that the depth of a rectified pair's left view leads to matching colours in the right view, and tests other
//! disparities.

use std::ops::RangeInclusive;

use glam::{DMat3, DVec2};
use sharp::camera::baseline_m;

use super::advice::{DEPTHS_M, number};
use super::compare::{MIN_GAIN, is_better, landed, mean_loss};
use super::explained::{COLOUR_SCALE, Explained, TILES};
use super::features::Matches;
use super::search::{is_reportable, least};
use super::small_view::{FLIPS, Part, Sample, SmallView, WIDEST};
use super::{Effort, block_match, calibration};
use crate::View;

/// Plausible distances between the two cameras of a pair, in metres.
const BASELINES_M: RangeInclusive<f64> = 1e-3..=10.0;
/// Number of horizontal bands of a picture; each has [`TILES`] tiles whose losses are compared separately.
const BANDS: u32 = 4;
/// Row offsets that are tested in both directions, in pixels of the reduced size. Offsets of less than one pixel of the
/// photograph are ignored.
const ROWS: [f64; 7] = [0.25, 0.5, 1.0, 2.0, 3.0, 4.0, 6.0];
/// Maximum offset of disparities that is tested, in both directions, in pixels of the reduced size.
const OFFSETS: i32 = 40;
/// Smallest reported offset of disparities, in pixels of the photograph.
const MIN_OFFSET: f64 = 2.0;

/// Centre of the range of depth units tested in case the disparity map holds depth, in metres per
/// unit.
const MIDDLE_UNIT_M: f64 = 0.03;
/// Number of units tested in either direction, then the ratio between consecutive units: from 0.1
/// mm to 10 m. A larger step would change disparities by too many pixels where the principal points
/// differ much.
const UNITS: (i32, f64) = (195, 1.03);
/// Number of rotations of the right picture that are tested in either direction.
const SLOPES: i32 = 14;
/// Step between tested rotations, as a slope; about 0.2 degrees.
const SLOPE: f64 = 0.0035;

/// A description of the contradiction between a left and a right view, if any; then a note if the
/// pair has no disparity.
pub(super) fn contradictions(views: &[View], effort: Effort) -> (Option<String>, Option<String>) {
    let [left, right] = views else {
        return (None, None);
    };
    let has_disparity = left.content.depth().is_ok_and(|depth| depth.is_some());
    let small = has_disparity.then(|| SmallView::new(left, true, WIDEST));
    let median_m = small.flatten().as_ref().and_then(median_depth);
    if let Some(implausible) = implausible_baseline(left, right, median_m) {
        return (Some(implausible), None);
    }
    if let Some(same) = same_picture(left, right) {
        return (Some(same), None);
    }
    if has_disparity {
        return (by_disparity(left, right), None);
    }
    let matches = Matches::new(views, effort, true);
    let swapped = matches.swapped();
    let swapped = swapped.map(|evidence| format!("{SWAPPED} ({evidence})"));
    (swapped, Some(matches.note()))
}

const SWAPPED: &str = "left and right are swapped; swap the pictures";

fn implausible_baseline(left: &View, right: &View, median_m: Option<f64>) -> Option<String> {
    let baseline_m = baseline_m(&left.camera_from_world, &right.camera_from_world);
    if !BASELINES_M.contains(&baseline_m) {
        let at = median_m.map_or(String::new(), |median| {
            format!(", with a median depth of {} m", number(median))
        });
        let unit = if baseline_m > *BASELINES_M.end() {
            "it may be in millimetres or centimetres"
        } else {
            "it may be in metres already"
        };
        return Some(format!(
            "the baseline of {} m is implausible{at}; {unit}",
            number(baseline_m)
        ));
    }
    None
}

fn same_picture(left: &View, right: &View) -> Option<String> {
    let [a, b] = [left, right].map(|view| SmallView::new(view, false, WIDEST));
    a?.has_picture_of(&b?).then(|| {
        "the right picture is the same as the left one; replace it with the right camera's picture".to_owned()
    })
}

/// True if the right camera is displaced only sideways from the left one and looks in the same direction;
/// otherwise disparities are meaningless.
fn is_rectified(left: &View, right: &View) -> bool {
    let from_left = left.camera_from_world.inverse();
    let map = right.camera_from_world.after(&from_left).to_affine();
    let (turn, by) = (map.matrix3 - DMat3::IDENTITY, map.translation);
    let entries = turn.to_cols_array();
    entries.iter().all(|entry| entry.abs() < 2e-3) && by.y.hypot(by.z) < 0.01 * by.x.abs()
}

fn by_disparity(left: &View, right: &View) -> Option<String> {
    let baseline_m = baseline_m(&left.camera_from_world, &right.camera_from_world);
    let (a, b) = (
        SmallView::new(left, true, WIDEST)?,
        SmallView::new(right, false, WIDEST)?,
    );
    let median_m = median_depth(&a)?;
    let pair_of = |a: SmallView| Pair::new((a, left), (b.clone(), right));
    let flipped = FLIPS
        .iter()
        .filter_map(|(flip, how)| Some((*how, pair_of(a.flipped(*flip, Part::Depth))?)));
    let flipped: Vec<(&str, Pair)> = flipped.collect();
    let full = left.intrinsics.fx / a.camera.fx;
    let pair = pair_of(a)?;
    let better = pair.better(
        &flipped,
        baseline_m,
        full,
        left.camera_file("rig.txt").is_some(),
    );
    let out_of_range = || {
        let disparities = pair.samples.iter().map(|sample| sample.depth * full);
        calibration::range(left, &disparities.collect::<Vec<_>>())
    };
    let mismatch = || pair.mismatch(&|d| d).filter(|_| is_rectified(left, right));
    better.or_else(mismatch).or_else(out_of_range).or_else(|| {
        let plausible = DEPTHS_M.contains(&median_m);
        (!plausible).then(|| {
            format!(
                "the median depth of {} m is implausible; correct the baseline's unit or the calibration's size",
                number(median_m)
            )
        })
    })
}

fn median_depth(view: &SmallView) -> Option<f64> {
    let mut depths: Vec<f64> = view.samples().map(|sample| sample.depth).collect();
    depths.sort_by(f64::total_cmp);
    depths.get(depths.len() / 2).copied()
}

/// Two pictures with the disparity of the left picture.
struct Pair {
    left: SmallView,
    right: SmallView,
    /// Samples with disparities instead of depths.
    samples: Vec<Sample>,
    /// True if the poses are rectified, so that a point is in the same row of both pictures.
    is_rectified: bool,
}

impl Pair {
    fn new((a, left): (SmallView, &View), (mut b, right): (SmallView, &View)) -> Option<Self> {
        let right_from_left = right
            .camera_from_world
            .after(&left.camera_from_world.inverse());
        let samples = a.samples().filter_map(|sample| {
            let point = a.camera.unproject(sample.middle(), sample.depth);
            let place = b.camera.project(right_from_left.apply(point))?;
            let depth = sample.middle().x - place.x;
            Some(Sample { depth, ..sample })
        });
        let samples: Vec<Sample> = samples.collect();
        b.match_levels(&a);
        let moved = right_from_left.translation;
        let turned = right_from_left.rotation - DMat3::IDENTITY;
        let is_rectified = turned.to_cols_array().iter().all(|v| v.abs() < 1e-4)
            && moved.y.hypot(moved.z) < 1e-3 * moved.length();
        let same_size = (a.camera.width, a.camera.height) == (b.camera.width, b.camera.height);
        (same_size && !samples.is_empty()).then_some(Self {
            left: a,
            right: b,
            samples,
            is_rectified,
        })
    }

    /// Evaluates how well one picture matches the other at the disparities that `disparity`
    /// computes from the stored ones.
    fn explained(
        &self,
        (from, to): (&SmallView, &SmallView),
        disparity: &dyn Fn(f64) -> f64,
        stride: usize,
    ) -> Vec<Explained> {
        self.explained_moved((from, to), disparity, &|_| DVec2::ZERO, stride)
    }

    /// Like [`Self::explained`], with places in the right picture moved by `moved`.
    fn explained_moved(
        &self,
        (from, to): (&SmallView, &SmallView),
        disparity: &dyn Fn(f64) -> f64,
        moved: &dyn Fn(DVec2) -> DVec2,
        stride: usize,
    ) -> Vec<Explained> {
        let mut bands = vec![Explained::default(); BANDS as usize];
        let size = &self.left.camera;
        for sample in self.samples.iter().step_by(stride) {
            let band = &mut bands[(sample.y * BANDS / size.height) as usize];
            band.samples += 1;
            let mut place = sample.middle() - DVec2::new(disparity(sample.depth), 0.0);
            place += moved(place);
            let colours = from.colour_at(sample.middle()).zip(to.colour_at(place));
            let Some((here, there)) = colours.filter(|_| size.contains(place)) else {
                continue;
            };
            let squares: f64 = here
                .iter()
                .zip(there)
                .map(|(a, b)| f64::from(a - b).powi(2))
                .sum();
            let tile = &mut band.tiles[(sample.x as usize * TILES) / size.width as usize];
            *tile = (
                tile.0 + 1,
                tile.1 + ((squares / 3.0).sqrt() / COLOUR_SCALE).min(1.0),
            );
            band.compared += 1;
            band.squares += squares;
        }
        bands
    }

    /// Compares blocks with [`block_match::mismatch`], at the disparities that `disparity` computes
    /// from the stored ones.
    fn mismatch(&self, disparity: &dyn Fn(f64) -> f64) -> Option<String> {
        let [left, right] = [&self.left, &self.right].map(|view| view.clone().grey());
        let samples = self.samples.iter().map(|sample| Sample {
            depth: disparity(sample.depth),
            ..*sample
        });
        block_match::mismatch(&left, &right, &samples.collect::<Vec<_>>())
    }

    /// A sentence on the interpretation that explains the pictures significantly better than the
    /// reader's own, if any. `flipped` are pairs with flipped disparities; `full` is the
    /// photographs' size relative to the reduced ones. `has_unit` is true if a setting gives the
    /// disparities' unit.
    fn better(
        &self,
        flipped: &[(&str, Self)],
        baseline_m: f64,
        full: f64,
        has_unit: bool,
    ) -> Option<String> {
        let stride = self.samples.len().div_ceil(8000);
        let (left, right) = ((&self.left, &self.right), (&self.right, &self.left));
        let (same, negated) = (|d: f64| d, |d: f64| -d);
        let as_read = self.explained(left, &same, stride);
        let fit = |(n, step): (i32, f64), disparity: &dyn Fn(f64, f64) -> f64| {
            let factor = least(n, step, &|factor, is_coarse| {
                let stride = if is_coarse { 4 * stride } else { stride };
                mean_loss(&self.explained(left, &|d| disparity(factor, d), stride))
            });
            (
                factor,
                self.explained(left, &|d| disparity(factor, d), stride),
            )
        };
        // Another scene's disparities may also fit better by chance, so blocks must match as well.
        let is_cause = |pair: &Self, explained: &[Explained], disparity: &dyn Fn(f64) -> f64| {
            let is_confirmed = || !self.is_rectified || pair.mismatch(disparity).is_none();
            is_better(&as_read, explained, MIN_GAIN) && is_confirmed()
        };
        let (factor, scaled) = fit((40, 2_f64.powf(0.25)), &|factor, d| factor * d);
        // If the pictures were swapped together with their disparities, the disparities would be
        // positive.
        let negative = self.samples.iter().filter(|sample| sample.depth < 0.0);
        let all_swapped = if 2 * negative.count() > self.samples.len() {
            "the disparities are negated; store x in the left picture minus x in the right one"
        } else {
            "left and right are swapped, including the disparities; swap pictures and disparities"
        };
        let mut readings = vec![
            (SWAPPED.to_owned(), self.explained(right, &same, stride)),
            (
                all_swapped.to_owned(),
                self.explained(left, &negated, stride),
            ),
            (
                "the left picture's disparities are those of the right picture; swap the disparities"
                    .to_owned(),
                self.explained(right, &negated, stride),
            ),
        ];
        readings.extend(flipped.iter().filter_map(|(how, pair)| {
            let explained = pair.explained((&pair.left, &pair.right), &same, stride);
            is_cause(pair, &explained, &same)
                .then(|| (format!("the disparity map is {how}"), explained))
        }));
        let rows = ROWS
            .iter()
            .filter(|rows| self.is_rectified && **rows * full >= 1.0);
        readings.extend(rows.flat_map(|rows| [-rows, *rows]).map(|rows| {
            let (pixels, side) = (number(rows.abs() * full), if rows > 0.0 { "below" } else { "above" });
            (
                format!("the right picture's rows are about {pixels} pixels {side} the left one's; rectify the pair"),
                self.explained_moved(left, &same, &|_| rows * DVec2::Y, stride),
            )
        }));
        if self.is_rectified {
            let turned = |slope: f64, stride: usize| {
                let k = &self.right.camera;
                let middle = DVec2::new(f64::from(k.width), f64::from(k.height)) / 2.0;
                let by = |place: DVec2| slope * (place - middle).perp();
                self.explained_moved(left, &same, &by, stride)
            };
            let all = (-SLOPES..=SLOPES).map(|i| f64::from(i) * SLOPE);
            let loss = |slope: f64| mean_loss(&turned(slope, 4 * stride));
            let slope = all
                .min_by(|a, b| loss(*a).total_cmp(&loss(*b)))
                .unwrap_or(0.0);
            let most_off = slope.abs() * f64::from(self.left.camera.width) / 2.0;
            if most_off * full >= 1.0 && most_off >= ROWS[0] {
                let (degrees, way) = (
                    slope.abs().atan().to_degrees(),
                    if slope > 0.0 { "" } else { "counter" },
                );
                readings.push((
                    format!(
                        "the right picture is turned by about {} degrees {way}clockwise relative to the left one; rectify the pair",
                        number((10.0 * degrees).round() / 10.0)
                    ),
                    turned(slope, stride),
                ));
            }
        }
        if self.is_rectified {
            let moved = |by: f64, stride| self.explained(left, &|d| d + by, stride);
            let best = |offsets: &mut dyn Iterator<Item = f64>, stride: usize| {
                let all = offsets.map(|by| (mean_loss(&moved(by, stride)), by));
                let best = all.min_by(|a, b| a.0.total_cmp(&b.0));
                best.map_or(0.0, |(_, by)| by)
            };
            let coarse = best(&mut (-OFFSETS..=OFFSETS).map(f64::from), 4 * stride);
            let by = best(&mut (-4..=4).map(|i| coarse + 0.25 * f64::from(i)), stride);
            let fitted = moved(by, stride);
            if by.abs() * full >= MIN_OFFSET && is_cause(self, &fitted, &|d| d + by) {
                let (pixels, way) = (
                    number((by.abs() * full).round()),
                    if by > 0.0 { "larger" } else { "smaller" },
                );
                readings.push((
                    format!(
                        "disparities should be {pixels} pixels {way}, because the two pictures were cropped at different \
                         columns; crop both at the same columns"
                    ),
                    fitted,
                ));
            }
        }
        // If the map holds depths instead of disparities, the true disparities are proportional to
        // the reciprocals of its values, up to an offset.
        let camera = &self.left.camera;
        let offset = self.right.camera.cx - camera.cx;
        let product = camera.fx * baseline_m / (full * MIDDLE_UNIT_M);
        let (times, reciprocal) = fit(UNITS, &|times, d| product / (times * d) - offset);
        let how = format!(
            "the disparity map holds depth, with {} m per unit; store disparities",
            number(times * MIDDLE_UNIT_M)
        );
        if is_cause(self, &reciprocal, &|d| product / (times * d) - offset) {
            readings.push((how, reciprocal));
        }
        if is_reportable(factor) && is_cause(self, &scaled, &|d| factor * d) {
            let how = format!(
                "disparities should be multiplied by {}, because they are for another picture size or in another unit; \
                 rescale them{}",
                number(factor),
                if has_unit {
                    " with disparity_unit in rig.txt"
                } else {
                    ""
                }
            );
            readings.push((how, scaled));
        }
        readings.retain(|(_, explained)| is_better(&as_read, explained, MIN_GAIN));
        // An interpretation under which few places land in the right picture may fit these by
        // chance.
        let most = readings
            .iter()
            .map(|(_, explained)| landed(explained))
            .max();
        readings.retain(|(_, explained)| 2 * landed(explained) >= most.unwrap_or(0));
        let best = readings
            .into_iter()
            .min_by(|a, b| mean_loss(&a.1).total_cmp(&mean_loss(&b.1)));
        best.map(|(how, explained)| {
            let levels = |bands: &[Explained]| {
                let mut sum = Explained::default();
                bands.iter().for_each(|band| sum.add(band));
                sum.colour_levels()
                    .map_or("nothing".to_owned(), |levels| format!("{levels:.1}"))
            };
            let (before, after) = (levels(&as_read), levels(&explained));
            format!("{how} (corrected, colours differ by {after} levels instead of {before})")
        })
    }
}
