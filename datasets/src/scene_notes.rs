//! Notes on a scene's pictures and masks, derived from their files, one line each.

use std::collections::BTreeMap;
use std::path::Path;

use image::{ColorType, GrayImage};
use sharp::camera::Intrinsics;
use sharp::image_file::{ColorRule, OrientationRule};

use crate::format::picture;
use crate::left_out::first_few;
use crate::mask::WHITE;
use crate::mask_labels::labels;
use crate::processing::Undistorted;
use crate::required_files::FileRole;
use crate::view::{evenly_spaced, without_depth};
use crate::{DatasetSpec, Pairing, Scene, View, files};

/// Maximum number of headers read per scene, evenly spaced.
const HEADERS: usize = 64;
/// Maximum number of masks decoded per scene, evenly spaced.
const MASKS: usize = 4;
/// Maximum number of 16-bit pictures decoded per scene, evenly spaced.
const DEEP: usize = 4;
/// 16-bit pictures are suspected to hold 14-bit values if their brightest level, reduced to 8 bits, is in this range.
/// Pictures with values of 8 to 12 bits are refused when they are read.
const UNSCALED: std::ops::RangeInclusive<u8> = 16..=64;
/// Smallest plausible fraction of pixels that masks keep: most masks exclude only a person, a sky or a logo.
const MIN_LEFT: f64 = 0.2;

/// Masks are reported if the fraction of their pixels that are neither black nor white exceeds this.
const MAX_GREY: f64 = 0.005;

/// A note if `folder` has a subfolder of masks, none of which are read; `hint` explains how to read them.
pub(crate) fn unread_masks(folder: &Path, hint: &str) -> Option<String> {
    let folder = ["masks", "mask"]
        .map(|name| folder.join(name))
        .into_iter()
        .find(|f| f.is_dir())?;
    let count = files::list(&folder)
        .ok()?
        .iter()
        .filter(|(_, path)| path.is_file())
        .count();
    (count > 0).then(|| {
        format!(
            "masks: {} contains {count} file(s), which are not read{hint}",
            folder.display()
        )
    })
}

/// Warns if all pictures are 16-bit but none has a value above a quarter of the range. `stored` yields the colour type
/// in each picture's header.
fn unscaled(scene: &Scene, mut stored: impl ExactSizeIterator<Item = ColorType>) -> Option<String> {
    use ColorType::{L16, La16, Rgb16, Rgba16};
    let is_deep =
        stored.len() >= 2 && stored.all(|color| matches!(color, L16 | La16 | Rgb16 | Rgba16));
    let read = evenly_spaced(scene.views.len(), DEEP)
        .into_iter()
        .filter(|_| is_deep);
    let highest = read.filter_map(|i| scene.views[i].content.image().ok()?.iter().max().copied());
    let highest: Vec<u8> = highest.collect();
    let is_unscaled = highest.len() >= 2 && highest.iter().all(|level| UNSCALED.contains(level));
    is_unscaled.then(|| {
        "pictures: no 16-bit value of those checked exceeds a quarter of the range, perhaps because 14-bit values were stored \
         unscaled; if so, multiply them by 4"
            .to_owned()
    })
}

/// Adds notes and warnings to a scene. Files that cannot be read are skipped; decoding reports them.
pub(crate) fn add(scene: &mut Scene, spec: &DatasetSpec) {
    scene.notes.extend(processing(scene));
    let rules = spec.picture_rules();
    let looked_at = evenly_spaced(scene.views.len(), HEADERS).into_iter();
    let found = looked_at.filter_map(|i| scene.views[i].content.found().ok().flatten());
    let found: Vec<_> = found.collect();
    let mut turned: BTreeMap<(u8, bool, bool), usize> = BTreeMap::new();
    let mut profiles: BTreeMap<String, usize> = BTreeMap::new();
    for picture in &found {
        if picture.header.orientation != 1 {
            let key = (
                picture.header.orientation,
                picture.turned,
                picture.fits_both,
            );
            *turned.entry(key).or_default() += 1;
        }
        let profile = &picture.header.profile;
        let ignored = profile
            .ignored()
            .filter(|_| rules.color == ColorRule::Convert);
        let converted = profile.name().map(|name| {
            let taken = match rules.color {
                ColorRule::Convert => {
                    "which is converted to sRGB (color=as-stored would read it as sRGB)"
                }
                ColorRule::AsStored => "which is read as sRGB (color=convert would convert it)",
            };
            format!("the colour profile '{name}', {taken}")
        });
        if let Some(text) = converted.or(ignored) {
            *profiles.entry(text).or_default() += 1;
        }
    }
    let of = found.len();
    for ((orientation, is_turned, fits_both), count) in turned {
        let have = format!("pictures: {count} of {of} have the EXIF orientation {orientation}");
        match (is_turned, fits_both && rules.orientation == OrientationRule::Auto) {
            (true, _) => scene.notes.push(format!(
                "{have} and are turned upright, which fits their cameras (orientation=stored would not turn them)"
            )),
            (false, false) => scene.notes.push(format!("{have} and are read as stored, which fits their cameras")),
            (false, true) => scene.warnings.push(format!(
                "{have} and are read as stored, as COLMAP and nerfstudio do; if their cameras are \
                 for the upright pictures, set orientation=upright (orientation=stored confirms the current \
                 reading and removes this warning)"
            )),
        }
    }
    for (text, count) in profiles {
        scene
            .notes
            .push(format!("pictures: {count} of {of} have {text}"));
    }
    scene.warnings.extend(unscaled(
        scene,
        found.iter().map(|picture| picture.header.color),
    ));
    // If the format defines which side of masks is kept, there is nothing to check.
    if !spec.has_mask_sides() {
        return;
    }
    let masked = scene.views.iter().filter(|v| v.content.processing().masked);
    let masked: Vec<&View> = masked.collect();
    let grey = grey_masks(&masked);
    scene.warnings.extend(grey);
    let shares = evenly_spaced(masked.len(), MASKS)
        .into_iter()
        .filter_map(|i| {
            let mask = masked[i].content.valid_pixels().ok().flatten()?;
            let left = mask.iter().filter(|value| **value != 0).count();
            Some(left as f64 / mask.len().max(1) as f64)
        });
    let shares: Vec<f64> = shares.collect();
    let left = shares.iter().sum::<f64>() / shares.len().max(1) as f64;
    let percent = 100.0 * left;
    match spec.setting("masks") {
        _ if shares.is_empty() => {}
        "apply" if left < MIN_LEFT => scene.warnings.push(format!(
            "masks: on average they leave {percent:.1} % of the pixels; if black marks the pixels to \
             keep, set masks=keep-black (masks=keep-white confirms the current reading and removes this warning)"
        )),
        _ if left < 0.5 => scene.notes.push(format!(
            "masks: on average they leave {percent:.1} % of the pixels"
        )),
        _ => {}
    }
}

/// A warning if many pixels of masks are neither black nor white.
fn grey_masks(masked: &[&View]) -> Option<String> {
    let files = evenly_spaced(masked.len(), MASKS)
        .into_iter()
        .flat_map(|i| {
            let files = masked[i].content.files_by_role().into_iter();
            files.filter(|(role, _)| *role == FileRole::Mask)
        });
    let masks = files.filter_map(|(_, file)| picture::read_mask(&file, WHITE).ok());
    let masks: Vec<GrayImage> = masks.collect();
    let shares = masks.iter().map(|mask| {
        let grey = mask.iter().filter(|level| (1..255).contains(*level));
        grey.count() as f64 / mask.len().max(1) as f64
    });
    let share = shares.sum::<f64>() / masks.len().max(1) as f64;
    (share > MAX_GREY).then(|| {
        let cause = match masks.iter().find_map(labels) {
            Some(labels) => format!("they have uniform areas of the levels {labels}, so perhaps they are maps of objects"),
            None => "perhaps stored as JPEG, or resized".to_owned(),
        };
        format!(
            "masks: {:.1} % of their pixels are neither black nor white ({cause}); levels of {WHITE} and more count as \
             white; store masks as PNG with levels 0 and 255",
            100.0 * share
        )
    })
}

/// Notes on the processing of a scene's pixels, and on views that lack data which other views have;
/// one line each.
fn processing(scene: &Scene) -> Vec<String> {
    let all = scene.views.len();
    let mut notes = Vec::new();
    let mut ways: BTreeMap<Undistorted, Vec<&Intrinsics>> = BTreeMap::new();
    for view in &scene.views {
        if let Some(way) = view.content.processing().undistorted {
            ways.entry(way).or_default().push(&view.intrinsics);
        }
    }
    for (way, cameras) in ways {
        let camera = if cameras.iter().all(|camera| *camera == cameras[0]) {
            let k = cameras[0];
            format!(
                " (fx {:.3}, fy {:.3}, cx {:.3}, cy {:.3}, {}x{})",
                k.fx, k.fy, k.cx, k.cy, k.width, k.height
            )
        } else {
            String::new()
        };
        notes.push(format!(
            "pictures: {} of {all} undistorted by sharp-bench, bilinearly, from {} to {}{camera}",
            cameras.len(),
            way.model,
            way.camera
        ));
    }
    let masked = scene.views.iter().filter(|v| v.content.processing().masked);
    let masked = masked.count();
    if masked > 0 {
        notes.push(format!(
            "masks: {masked} of {all} pictures have a mask; excluded pixels are black and without depth"
        ));
    }
    let lacking = without_depth(&scene.views);
    if scene.pairing == Pairing::MultiView && (1..all).contains(&lacking) {
        notes.push(format!(
            "depth: {lacking} of {all} pictures have no depth ({})",
            first_without_depth(&scene.views)
        ));
    }
    notes
}

/// File names of the first pictures without depth.
fn first_without_depth(views: &[View]) -> String {
    let lacking = views.iter().filter(|v| v.content.processing().lacks_depth);
    let names = lacking.map(|view| {
        let file = view.content.image_file().and_then(|path| path.file_name());
        file.map_or(view.id.clone(), |name| name.to_string_lossy().into_owned())
    });
    first_few(&names.collect::<Vec<_>>())
}
