//! Detection of calibrations that belong to another scene.

use std::collections::BTreeMap;
use std::ops::RangeInclusive;

use super::advice::number;
use crate::format::{calib, picture};
use crate::{Pairing, Scene, View, files};

/// A calibration is reported if more than this fraction of the disparities lie outside the range that it states.
const MAX_OUTSIDE: f64 = 0.1;
/// Tolerance by which the stated range of disparities is widened on both sides, in pixels.
const TOLERANCE_PX: f64 = 1.0;
/// Additional tolerance on both sides, as a fraction of the stated range.
const TOLERANCE_SHARE: f64 = 0.02;

/// Sizes of shrunk pictures relative to the originals. Their `calib.txt` may still state the originals' range, which is
/// harmless, because nothing is computed from it.
const SHRUNK: [f64; 3] = [0.5, 0.25, 0.125];
/// Range of the principal point, in widths of the picture; a calibration for another picture size is outside it.
const CENTRAL: RangeInclusive<f64> = 0.3..=0.7;

/// Reports `disparities` (in pixels) that are outside the range stated by Middlebury's `calib.txt`. A shrunk picture
/// whose file still states the original's range is accepted.
pub(super) fn range(left: &View, disparities: &[f64]) -> Option<String> {
    let file = left.camera_file("calib.txt")?;
    let calibration = files::parse_text(&file, calib::parse).ok()?;
    let (low, high) = calibration.disparities?;
    let outside = |factor: f64| {
        let (low, high) = (factor * low, factor * high);
        let tolerance = TOLERANCE_PX + TOLERANCE_SHARE * (high - low);
        let stated = low - tolerance..=high + tolerance;
        let outside = disparities.iter().filter(|d| !stated.contains(*d)).count();
        outside as f64 / disparities.len().max(1) as f64
    };
    let (width, _) = picture::dimensions(left.content.image_file()?).ok()?;
    let is_central = CENTRAL.contains(&(calibration.left_center.0 / f64::from(width)));
    let is_shrunk = is_central && SHRUNK.iter().any(|size| outside(*size) <= MAX_OUTSIDE);
    let share = outside(1.0);
    (share > MAX_OUTSIDE && !is_shrunk).then(|| {
        format!(
            "{:.0} % of the disparities lie outside the range from {} to {} pixels that {} states; perhaps `vmin` and \
             `vmax`, or the whole calibration, are those of another scene or picture size; correct them",
            100.0 * share,
            number(low),
            number(high),
            file.display()
        )
    })
}

/// Finds rectified pairs whose cameras equal those of another scene although the sizes of the
/// pictures differ. Returns the index of each affected scene with a message.
pub fn copied_calibrations(scenes: &[Scene]) -> Vec<(usize, String)> {
    let mut groups: BTreeMap<Vec<u64>, Vec<usize>> = BTreeMap::new();
    for (i, scene) in scenes.iter().enumerate() {
        if matches!(scene.pairing, Pairing::Stereo { .. }) {
            let numbers = scene.views.iter().flat_map(|view| {
                let (k, at) = (view.intrinsics, view.camera_from_world.translation);
                [k.fx, k.fy, k.cx, k.cy, at.x, at.y, at.z].map(f64::to_bits)
            });
            groups.entry(numbers.collect()).or_default().push(i);
        }
    }
    let mut found = Vec::new();
    for group in groups.into_values().filter(|group| group.len() > 1) {
        let size = |i: &usize| {
            let first = scenes[*i].views.first()?;
            picture::dimensions(first.content.image_file()?).ok()
        };
        let sized: Vec<_> = group.iter().filter_map(|i| Some((*i, size(i)?))).collect();
        for (i, (w, h)) in &sized {
            if let Some((other, (v, u))) = sized.iter().find(|(_, size)| *size != (*w, *h)) {
                let text = format!(
                    "the cameras are the same as those of {}, whose pictures are {v}x{u} instead of {w}x{h}; perhaps the \
                     calibration was copied from another scene; if so, replace it with this scene's own",
                    scenes[*other].id
                );
                found.push((*i, text));
            }
        }
    }
    found.sort();
    found
}
