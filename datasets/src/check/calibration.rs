//! Detection of calibrations that belong to another scene.

use std::collections::BTreeMap;

use super::advice::number;
use crate::format::{calib, picture};
use crate::{Pairing, Scene, View, files};

/// A calibration is reported if more than this fraction of the disparities lie outside the range that it states.
const MAX_OUTSIDE: f64 = 0.1;
/// Tolerance by which the stated range of disparities is widened on both sides, in pixels.
const TOLERANCE_PX: f64 = 1.0;
/// Additional tolerance on both sides, as a fraction of the stated range.
const TOLERANCE_SHARE: f64 = 0.02;

/// Reports `disparities` (in pixels) that contradict the range that Middlebury's `calib.txt` states.
pub(super) fn range(left: &View, disparities: &[f64]) -> Option<String> {
    let file = left.camera_file("calib.txt")?;
    let (low, high) = files::parse_text(&file, calib::parse).ok()?.disparities?;
    let tolerance = TOLERANCE_PX + TOLERANCE_SHARE * (high - low);
    let stated = low - tolerance..=high + tolerance;
    let outside = disparities.iter().filter(|d| !stated.contains(*d)).count();
    let share = outside as f64 / disparities.len().max(1) as f64;
    (share > MAX_OUTSIDE).then(|| {
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
