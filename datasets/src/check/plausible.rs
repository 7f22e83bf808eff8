//! Detection of implausible values.

use std::ops::RangeInclusive;

use glam::DVec3;
use sharp::camera::{Intrinsics, baseline_m};

use super::Effort;
use super::advice::{DEPTHS_M, Units, number};
use crate::View;
use crate::view::evenly_spaced;

/// Plausible focal lengths, in widths of the picture.
pub(super) const FOCAL_WIDTHS: RangeInclusive<f64> = 0.2..=20.0;
/// Maximum plausible distance of the principal point from the centre, in widths and heights of the picture. A centred
/// point that was mistakenly halved is off by a quarter; half a pixel of rounding is allowed for.
const OFF_CENTRE: f64 = 0.245;

/// Maximum distance of a centred principal point from the centre, in widths and heights of the picture.
const MIDDLE: f64 = 0.03;

/// Depth is compared with masks only if at least this share of a depth map is known.
const MIN_WITH_DEPTH: f64 = 0.02;
/// Masks exclude nearly all depth if they keep at most this share of it.
const MAX_KEPT: f64 = 0.05;

/// Detects principal points that are centred only if x and y are swapped, in all views. The
/// principal point of one crop may have this property by chance, but not those of several different
/// crops.
fn swapped_centres(views: &[View]) -> Option<String> {
    let is_swapped = |view: &View| {
        let k = &view.intrinsics;
        let (w, h) = (f64::from(k.width), f64::from(k.height));
        let from_middle = |x: f64, y: f64| ((x - w / 2.0).abs() / w).max((y - h / 2.0).abs() / h);
        from_middle(k.cy, k.cx) <= MIDDLE && from_middle(k.cx, k.cy) > 2.0 * MIDDLE
    };
    let k = views
        .first()
        .filter(|_| views.iter().all(is_swapped))?
        .intrinsics;
    Some(format!(
        "the principal point ({}, {}) would be centred in {}x{} if cx and cy were swapped; swap them, or, if the \
         calibration is for pictures turned by 90 degrees, use the calibration for these pictures",
        number(k.cx),
        number(k.cy),
        k.width,
        k.height
    ))
}

pub(super) fn is_same_pose(one: &View, other: &View) -> bool {
    let [one, other] = [one, other].map(|view| view.camera_from_world);
    one.rotation.abs_diff_eq(other.rotation, 1e-9)
        && one.translation.abs_diff_eq(other.translation, 1e-9)
}

/// Detects views that all have the same pose.
pub(super) fn one_pose(views: &[View]) -> Option<String> {
    let first = views.first()?;
    let is_first = |view: &View| is_same_pose(view, first);
    (views.len() >= 2 && views.iter().all(is_first)).then(|| {
        format!(
            "all {} views have the same pose; give each view its own pose in the camera file",
            views.len()
        )
    })
}

/// Size of the pictures for which a camera seems to have been calibrated, divided by the camera's own size. `None` if
/// the camera fits its own size. A camera does not fit if its principal point is far off the centre by the same factor
/// in both directions.
fn calibrated_for(k: &Intrinsics) -> Option<f64> {
    let [x, y] = [(k.cx, k.width), (k.cy, k.height)].map(|(c, side)| 2.0 * c / f64::from(side));
    let times = (x + y) / 2.0;
    let is_one = x > 0.0 && (x / y).ln().abs() <= 2.0 * MIDDLE;
    (is_one && (times - 1.0).abs() > 2.0 * OFF_CENTRE).then_some(times)
}

/// True if all cameras seem to be calibrated for pictures of a size other than their own.
pub(super) fn are_of_other_size(views: &[View]) -> bool {
    views
        .iter()
        .all(|view| calibrated_for(&view.intrinsics).is_some())
}

/// Reports masks that exclude nearly all pixels with depth. Such masks may be inverted: objects usually have depth,
/// backgrounds often do not.
pub(super) fn depth_outside_masks(views: &[View], effort: Effort, units: Units) -> Option<String> {
    let masked = views.iter().filter(|view| view.content.processing().masked);
    let masked: Vec<&View> = masked.collect();
    let shares = evenly_spaced(masked.len(), effort.pairs).into_iter();
    let shares: Vec<[f64; 2]> = shares
        .filter_map(|i| {
            let content = &masked[i].content;
            let share = |valid: usize, all: usize| valid as f64 / all.max(1) as f64;
            let stored = content.stored_depth().ok()??.1;
            let known = stored.iter().filter(|z| **z > 0.0 && z.is_finite());
            let known = known.count();
            let depth = content.depth().ok()??;
            let kept = depth.iter().filter(|z| **z > 0.0).count();
            let mask = content.valid_pixels().ok()??;
            let excluded = mask.iter().filter(|value| **value == 0).count();
            let (known, kept) = (share(known, stored.len()), share(kept, depth.len()));
            (known >= MIN_WITH_DEPTH).then(|| [kept / known, share(excluded, mask.len())])
        })
        .collect();
    let mean = |part: usize| shares.iter().map(|of| of[part]).sum::<f64>() / shares.len() as f64;
    (mean(0) <= MAX_KEPT).then(|| {
        format!(
            "the masks exclude {:.1} % of the pixels that have depth{}",
            100.0 * (1.0 - mean(0)),
            units.inverted_masks(mean(1))
        )
    })
}

/// Implausible cameras: for each kind of error, a sentence with the first such camera. `is_centre_right` is true if
/// depth confirms the principal points.
pub(super) fn cameras(views: &[View], is_centre_right: bool) -> Vec<String> {
    let off_centre = |view: &View| {
        let k = &view.intrinsics;
        let (w, h) = (f64::from(k.width), f64::from(k.height));
        let far =
            (k.cx - w / 2.0).abs() > OFF_CENTRE * w || (k.cy - h / 2.0).abs() > OFF_CENTRE * h;
        let outside = k.cx < 0.0 || k.cy < 0.0 || k.cx > w || k.cy > h;
        let picture = format!("{}x{} picture", k.width, k.height);
        let where_ = match (outside, far) {
            (true, _) => format!("outside the {picture}"),
            (_, true) => format!("at least a quarter of the {picture} away from its centre"),
            _ => return None,
        };
        Some(format!(
            "the principal point ({:.1}, {:.1}) lies {where_}",
            k.cx, k.cy
        ))
    };
    let focal = |view: &View| {
        let k = &view.intrinsics;
        let widths = k.fx / f64::from(k.width);
        (!FOCAL_WIDTHS.contains(&widths)).then(|| {
            format!(
                "the focal length of {} pixels is implausible, because it is {} widths of the picture",
                number(k.fx),
                number(widths)
            )
        })
    };
    let sentence = |wrong: &dyn Fn(&View) -> Option<String>| {
        let mut all = views.iter().filter_map(|view| Some((view, wrong(view)?)));
        let (view, what) = all.next()?;
        let others = all.count();
        let others = if others > 0 {
            format!(" and {others} more")
        } else {
            String::new()
        };
        let cause = calibrated_for(&view.intrinsics).map_or(
            "another picture size, or in another unit".to_owned(),
            |times| {
                let (size, by) = (number((20.0 * times).round() / 20.0), number(1.0 / times));
                format!(
                    "pictures {size} times as large; if so, multiply focal lengths and principal points by {by}"
                )
            },
        );
        Some(format!(
            "{}{others}: {what}; perhaps the calibration is for {cause}",
            view.id
        ))
    };
    let centre = [sentence(&off_centre), swapped_centres(views)];
    let centre = centre.into_iter().filter(|_| !is_centre_right);
    centre.chain([sentence(&focal)]).flatten().collect()
}

/// Message for a scene whose views all look in one direction and do not fit together.
pub(super) const ONE_ROTATION: &str = "all views have the same rotation, which does not fit the pictures; perhaps the \
                                       rotations were lost";

/// True if there are at least three views and all of them look in the same direction.
pub(super) fn have_one_rotation(views: &[View]) -> bool {
    let rotation = |view: &View| view.camera_from_world.rotation;
    let is_first = |view: &View| rotation(view).abs_diff_eq(rotation(&views[0]), 1e-6);
    views.len() >= 3 && views.iter().all(is_first)
}

/// Candidates for the step to which positions may have been rounded, in the poses' unit.
const STEPS: [f64; 4] = [1.0, 0.1, 0.01, 0.001];
/// A coordinate counts as a multiple of a step if it is off by less than this fraction of the step.
const OFF_STEP: f64 = 1e-3;
/// Rounding is judged only if at least this many coordinates of the positions are not 0.
const MIN_COORDINATES: usize = 3;
/// A step is reported only if it is at least this fraction of the median distance between
/// neighbouring views; smaller rounding matters little.
const MIN_STEP: f64 = 0.02;

/// Text to append to a contradiction without a known cause if the poses seem to have been rounded.
pub(super) fn rounded(views: &[View], units: Units) -> Option<String> {
    let pose = |view: &View| view.camera_from_world;
    let mut steps: Vec<f64> = views
        .windows(2)
        .map(|two| baseline_m(&pose(&two[0]), &pose(&two[1])) / units.pose_unit_m())
        .collect();
    steps.sort_by(f64::total_cmp);
    let between = *steps.get(steps.len() / 2)?;
    let forms: [fn(&View) -> DVec3; 2] = [
        |view| view.camera_from_world.inverse().translation,
        |view| view.camera_from_world.translation,
    ];
    let is_multiple = |step: f64| {
        forms.iter().any(|form| {
            let all = views.iter().flat_map(|view| form(view).to_array());
            let all = all.map(|v| v / units.pose_unit_m() / step);
            let all: Vec<f64> = all.filter(|v| v.abs() > OFF_STEP).collect();
            all.len() >= MIN_COORDINATES && all.iter().all(|v| (v - v.round()).abs() < OFF_STEP)
        })
    };
    let step = STEPS.into_iter().find(|step| is_multiple(*step))?;
    (step >= MIN_STEP * between).then(|| {
        format!(
            "; every camera position is a multiple of {}, so the poses may have been rounded; store more digits",
            number(step)
        )
    })
}

/// Describes the median depth, in metres, if it is implausible.
pub(super) fn depth(median_m: f64, units: Units) -> Option<String> {
    (median_m > 0.0 && !DEPTHS_M.contains(&median_m)).then(|| {
        format!(
            "the median depth of {} m is implausible; {}",
            number(median_m),
            units.where_to_set()
        )
    })
}

/// Reports blank pictures, given their minimum and maximum levels.
pub(super) fn pictures(views: &[(&str, Option<(u8, u8)>)]) -> Option<String> {
    let is_blank = |levels: &(u8, u8)| levels.0 == levels.1;
    let read = views.iter().filter(|(_, levels)| levels.is_some());
    let blank = views
        .iter()
        .filter(|(_, levels)| levels.as_ref().is_some_and(is_blank));
    let blank: Vec<&str> = blank.map(|(id, _)| *id).collect();
    match blank.as_slice() {
        [] => None,
        all if all.len() == read.count() => {
            Some("every decoded picture has a single colour".to_owned())
        }
        some => Some(format!(
            "{}: the picture has a single colour",
            some.join(", ")
        )),
    }
}
