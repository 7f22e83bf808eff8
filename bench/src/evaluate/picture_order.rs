//! Detects pictures stored under the names of other pairs, by comparing a sample with the targets of other pairs, and
//! pictures that are the source's photograph.
//!
//! To avoid false alarms on poor predictions and on pictures with little motion, most of the compared pictures must
//! show another target significantly better than their own, and better than the source's photograph shows it. Scores do
//! not depend on this check.

use std::collections::{BTreeMap, BTreeSet};

use image::RgbImage;
use image::imageops::thumbnail;
use sharp_datasets::View;

use super::finding::{Framing, PictureChange, ShownCamera, ShownTarget};
use super::gaussians::likeness::Likeness;
use super::picture_check::shrunk;
use super::picture_framing::shown_framing;
use super::picture_group::{Extent, PictureGroup};
use super::picture_motion::{MeasuredMotion, shown_camera};
use super::picture_sample::{FEWEST, PictureSample};
use super::picture_shift::{shift_equations, shifted_pictures};
use super::picture_stamp::wrong_cells;
use super::picture_tone::tone;
use super::record::Record;
use crate::pairs::pair_list::ResolvedPair;
use crate::scoring::Region;

/// A wrong camera is reported only if at least this share of the pictures with a measured camera agree on it.
const MIN_SHARE: f64 = 0.8;
/// A picture shows another target only if it is closer to that target than to its own by at least this, in dB.
const MIN_GAIN: f64 = 2.0;
/// A picture is a copy of the source's photograph, perhaps stored as JPEG, only if its PSNR against that photograph is
/// at least this, in dB. [`MIN_COPY_GAIN`] must also be reached.
const MIN_COPY_PSNR: f64 = 40.0;
/// A copy is closer to the source's photograph than to the target's by at least this, in dB.
const MIN_COPY_GAIN: f64 = 10.0;

/// A prediction shows the source's view only if it is closer to the source's photograph than to the target's by at
/// least this, in dB. [`MIN_SOURCE_VIEW_ERROR`] must also be reached.
const MIN_SOURCE_VIEW_GAIN: f64 = 3.0;
/// If a picture is closer to the source's photograph by at least this, in dB, it did not move, whatever was measured.
const SURE_SOURCE_VIEW_GAIN: f64 = 5.0;
/// A prediction shows the source's view only if its squared error against the target is at least this, relative to that
/// of the source's photograph. Predictions of the target's view have a smaller error.
const MIN_SOURCE_VIEW_ERROR: f64 = 0.7;

/// Reduced photographs, keyed by dataset, scene and view.
#[derive(Default)]
pub(super) struct Thumbnails(BTreeMap<[String; 3], Option<RgbImage>>);

impl Thumbnails {
    /// A view's photograph, shrunk; `None` if it cannot be read.
    pub(super) fn of(&mut self, planned: &ResolvedPair<'_>, view: &View) -> Option<RgbImage> {
        let scene = planned.scene;
        let name = [&scene.dataset, &scene.id, &view.id].map(Clone::clone);
        let read = || Some(shrunk(&view.content.image().ok()?));
        self.0.entry(name).or_insert_with(read).clone()
    }
}

/// Sets [`Record::shows`], [`Record::camera`], [`Record::wrong_cells`], [`Record::tone`], [`Record::shift`] and
/// [`Record::masked`] if the picture is in `sample` and covers the whole target.
pub(super) fn note_order(
    record: &mut Record,
    planned: &ResolvedPair<'_>,
    sample: &PictureSample<'_>,
    (photograph, picture): (&RgbImage, &RgbImage),
    read: &mut Thumbnails,
) {
    (record.shows, record.camera, record.wrong_cells) = (None, None, None);
    (record.tone, record.shift, record.masked) = (None, None, None);
    if record.crop.is_some() {
        return;
    }
    let views = [planned.source, planned.target];
    let [from, to] = views.map(|view| view.camera_from_world);
    let target_from_source = to.after(&from.inverse());
    let others = sample.others.get(&record.pair_id);
    if others.is_some() || sample.shifts.contains(&record.pair_id) {
        let (target, moved) = (planned.target.intrinsics, target_from_source.translation);
        record.shift = shift_equations(target, moved, [photograph, picture]);
    }
    let Some(others) = others else {
        return;
    };
    record.wrong_cells = Some(wrong_cells(photograph, picture));
    let [seen, shown] = [photograph, picture].map(shrunk);
    let Some(source) = read.of(planned, planned.source) else {
        return;
    };
    record.tone = tone([&source, &seen, &shown]);
    let is_other = |other: &ResolvedPair<'_>| {
        let is_own_scene = other.scene.id == planned.scene.id;
        !(is_own_scene && [&planned.source.id, &planned.target.id].contains(&&other.target.id))
    };
    let others = others.iter().filter(|(_, other)| is_other(other));
    let others = others.filter_map(|(place, other)| Some((*place, read.of(other, other.target)?)));
    let MeasuredMotion {
        camera: moved,
        masked,
    } = shown_camera(
        views.map(|view| view.intrinsics),
        target_from_source,
        [&source, &seen, &shown],
    );
    record.masked = masked;
    // A zoom resembles a reversed motion along the optical axis.
    let is_certain =
        |camera: &ShownCamera| camera.is_wrong() && *camera != ShownCamera::Reversed(2);
    let camera = moved.filter(is_certain).or_else(|| {
        let translation = target_from_source.translation;
        let (intrinsics, both) = (planned.target.intrinsics, [&seen, &shown]);
        let framing = shown_framing(intrinsics, translation, both, moved.is_some());
        framing.map(ShownCamera::Reframed).or(moved)
    });
    let shows = shown_target(&seen, &shown, Some(&source), others);
    let gain = || fit(&source, &shown).gain_over(&fit(&seen, &shown));
    (record.shows, record.camera) = reconciled(shows, camera, gain);
}

/// Drops whichever of the view and the camera that a picture shows contradicts the other. `gain` computes how much
/// closer the picture is to the source's photograph than to the target's, in dB.
fn reconciled(
    shows: Option<ShownTarget>,
    camera: Option<ShownCamera>,
    gain: impl Fn() -> f64,
) -> (Option<ShownTarget>, Option<ShownCamera>) {
    use ShownCamera::{Moved, Reframed};
    use ShownTarget::{Own, Source, SourceView};
    match (shows, camera) {
        (Some(Source), _) | (Some(SourceView), Some(Moved(-5..=5))) => (shows, None),
        // If both cameras look at one point, the source's view resembles a larger motion, or another framing.
        (Some(SourceView), Some(Reframed(_) | Moved(51..))) if gain() >= SURE_SOURCE_VIEW_GAIN => {
            (shows, None)
        }
        // Poor depth may make a picture closer to the source, although its motion was measured.
        (Some(SourceView), Some(_)) => (Some(Own), camera),
        _ => (shows, camera),
    }
}

/// The view that the picture `shown` resembles most, given its own target `seen`. The first that applies:
/// [`ShownTarget::Source`] for a copy of the source's photograph; [`ShownTarget::SourceView`] if it is significantly
/// closer to that photograph than to `seen`; the closest of `others` to which it is significantly closer than to
/// `seen`; [`ShownTarget::Own`]. `None` if `shown` and `seen` differ in size. All pictures must be [`shrunk`].
pub(crate) fn shown_target(
    seen: &RgbImage,
    shown: &RgbImage,
    source: Option<&RgbImage>,
    others: impl Iterator<Item = (ShownTarget, RgbImage)>,
) -> Option<ShownTarget> {
    if seen.dimensions() != shown.dimensions() {
        return None;
    }
    let own = fit(seen, shown);
    let is_copy = |copied: Likeness| {
        copied.psnr() >= MIN_COPY_PSNR && copied.psnr() - own.psnr() >= MIN_COPY_GAIN
    };
    if source.is_some_and(|source| is_copy(fit(source, shown))) {
        return Some(ShownTarget::Source);
    }
    // A prediction that follows the motion is closer to the target than the source's photograph is.
    if let Some(source) = source
        && let (shows, copied) = (fit(source, shown), fit(seen, source))
        && shows.is_better_than(&own)
        && shows.gain_over(&own) >= MIN_SOURCE_VIEW_GAIN
        && own.error() >= MIN_SOURCE_VIEW_ERROR * copied.error()
    {
        return Some(ShownTarget::SourceView);
    }
    let mut best: Option<(ShownTarget, Likeness)> = None;
    for (place, seen) in others {
        let other = fit(&seen, shown);
        if other.is_better_than(&own)
            && other.gain_over(&own) >= MIN_GAIN
            && source.is_none_or(|source| other.is_closer_than(&fit(&seen, source)))
            && best.as_ref().is_none_or(|(_, b)| other.error() < b.error())
        {
            best = Some((place, other));
        }
    }
    Some(best.map_or(ShownTarget::Own, |(place, _)| place))
}

/// Compares `shown` with `seen`, at the size of `shown`.
fn fit(seen: &RgbImage, shown: &RgbImage) -> Likeness {
    let size = shown.dimensions();
    let resized = (seen.dimensions() != size).then(|| thumbnail(seen, size.0, size.1));
    Likeness::of(resized.as_ref().unwrap_or(seen), Region::whole(size), shown)
}

/// The cameras measured in a group's pictures.
fn cameras(group: &PictureGroup<'_, &Record>) -> Vec<ShownCamera> {
    let mut sources = BTreeSet::new();
    let mut cameras = Vec::new();
    for record in group.pictures {
        // Predictions from one source have the same error of scale, so positive factors count once per source.
        let is_repeated = matches!(record.camera, Some(ShownCamera::Moved(1..)))
            && !sources.insert((&record.scene, &record.source));
        cameras.extend(record.camera.filter(|_| !is_repeated));
    }
    cameras
}

/// The wrong camera on which nearly all measured pictures agree, the number that agree, and the number measured.
fn wrong_camera_of(group: &PictureGroup<'_, &Record>) -> Option<(ShownCamera, usize, usize)> {
    let mut cameras = cameras(group);
    let resized = group.pictures.iter().filter(|r| is_resized(r.change));
    // Pictures that were cropped or padded and then resized are already reported.
    if resized.count() as f64 >= MIN_SHARE * group.pictures.len() as f64 {
        cameras.retain(|camera| !matches!(camera, ShownCamera::Reframed(_)));
    }
    wrong_camera(cameras.clone(), group.extent).or_else(|| {
        // Pictures from a wrong camera that are too far from their targets resemble framings, each another one.
        cameras.retain(|camera| !matches!(camera, ShownCamera::Reframed(_)));
        wrong_camera(cameras, group.extent)
    })
}

/// Whether a picture seems to be cropped or padded and then resized.
pub(super) fn is_resized(change: Option<PictureChange>) -> bool {
    matches!(change, Some(PictureChange::Cropped | PictureChange::Padded))
}

/// Whether the pictures agree on another focal length, lens or principal point. If so, that is why some of them seem to
/// be cropped or padded.
pub(super) fn is_reframed(group: &PictureGroup<'_, &Record>) -> bool {
    let camera = wrong_camera_of(group).map(|(camera, ..)| camera);
    matches!(camera, Some(ShownCamera::Reframed(_)))
}

/// Warns if the compared pictures agree on a wrong camera or shift, or if most show other targets.
pub(super) fn misplaced_pictures(group: &PictureGroup<'_, &Record>) -> Option<String> {
    let pairs = format!("pairs of {}", group.name);
    let mut shown: BTreeMap<ShownTarget, usize> = BTreeMap::new();
    for target in group.pictures.iter().filter_map(|record| record.shows) {
        *shown.entry(target).or_default() += 1;
    }
    // If a quarter of the pictures clearly moved, pictures that resemble the source merely have poor depth.
    let cameras = cameras(group).into_iter();
    let moving = cameras.filter(|camera| matches!(camera, ShownCamera::Moved(20..)));
    if 4 * moving.count() >= shown.values().sum() {
        shown.remove(&ShownTarget::SourceView);
    }
    match wrong_camera_of(group) {
        Some((camera, count, all)) => Some(format!(
            "its pictures {} ({count} of the {all} {pairs} whose motion could be measured agree)",
            camera.text()
        )),
        None => misplaced(&shown, &pairs, group.extent).or_else(|| shifted_pictures(group)),
    }
}

/// Warns if most compared pictures show targets other than their own. `found` counts the pictures by the target shown;
/// `pairs` names their pairs in the sentence.
pub(crate) fn misplaced(
    found: &BTreeMap<ShownTarget, usize>,
    pairs: &str,
    extent: Extent,
) -> Option<String> {
    use ShownTarget::{Next, Other, Previous, Source, SourceView};
    let count = |places: &[ShownTarget]| -> usize {
        places.iter().filter_map(|place| found.get(place)).sum()
    };
    let all: usize = found.values().sum();
    let is_most = |count: usize| count >= extent.fewest(FEWEST) && 2 * count > all;
    let copies = count(&[Source]);
    if is_most(copies) {
        return Some(format!(
            "its pictures are {}, as with the baseline `copy` ({copies} of the {all} compared in {pairs}); if this is \
             not intended, store the predictions",
            Source.text()
        ));
    }
    let views = count(&[Source, SourceView]);
    // Far too large depths also give the source's view, so a scene needs more evidence.
    if is_most(views) && views as f64 >= extent.share(0.5) * all as f64 {
        return Some(format!(
            "its pictures show {} rather than the target's ({views} of the {all} compared in {pairs} are significantly \
             closer to the source's photograph), as if they were rendered with the source's pose, or with poses of \
             another unit or axes, or as if source and target were swapped in the file names",
            SourceView.text()
        ));
    }
    let shifts = [Previous, Next].map(|place| (place, count(&[place])));
    let (shift, shifted) = shifts.into_iter().max_by_key(|(_, count)| *count)?;
    // Names are often shifted in a part of a sequence, after a frame that was dropped.
    let is_part = shifted >= extent.fewest(FEWEST) && 5 * shifted >= 2 * all;
    let (what, count) = if is_part {
        (shift, shifted)
    } else {
        (Other, count(&[Previous, Next, Other]))
    };
    (is_part || is_most(count)).then(|| {
        format!(
            "its pictures look as if they had the names of other {pairs} ({count} of the {all} compared show {} \
             significantly better than their own); correct the file names",
            what.text()
        )
    })
}

/// The wrong camera on which nearly all of the `cameras` agree, the number that agree, and the number of all. A wrong
/// scale of the motion in one scene does not count, because predictions from single photographs often have one.
fn wrong_camera(cameras: Vec<ShownCamera>, extent: Extent) -> Option<(ShownCamera, usize, usize)> {
    let all = cameras.len();
    let mut wrong: Vec<ShownCamera> = cameras.into_iter().filter(|c| c.is_wrong()).collect();
    wrong.sort_unstable();
    let framed = wrong.iter().filter_map(|camera| match camera {
        ShownCamera::Reframed(framing) => Some(*framing),
        _ => None,
    });
    let middle = match *wrong.get(wrong.len() / 2)? {
        ShownCamera::Reframed(_) => {
            ShownCamera::Reframed(Framing::common(&framed.collect::<Vec<_>>())?)
        }
        other => other,
    };
    let is_scale = matches!(middle, ShownCamera::Moved(0..)) && extent == Extent::Scene;
    let count = wrong.iter().filter(|camera| camera.is_like(middle)).count();
    let is_found =
        count >= extent.fewest(FEWEST) && count as f64 >= MIN_SHARE * all as f64 && !is_scale;
    is_found.then_some((middle, count, all))
}

#[cfg(test)]
mod tests {
    use image::Rgb;

    use super::super::picture_group::tests::of_dataset;
    use super::super::picture_sample::compared_pictures;
    use super::super::record::tests::record;
    use super::*;

    /// Waves of another direction for each `view`, with some noise.
    fn view(view: usize, noise: u32) -> RgbImage {
        RgbImage::from_fn(96, 72, |x, y| {
            let (u, v) = (f64::from(x) / 7.0, f64::from(y) / 9.0);
            let wave = 120.0 + 90.0 * (u * (view as f64 * 0.7).cos() + v + view as f64).sin();
            let hash = f64::from((x * 7919 + y * 104_729) % 17) - 8.0;
            Rgb([(wave + hash * f64::from(noise)).clamp(0.0, 255.0) as u8; 3])
        })
    }

    /// What the sentence is if the picture of `from(k)` has the name of k, for 9 pictures.
    fn told(from: impl Fn(usize) -> usize) -> Option<String> {
        let mut found = BTreeMap::new();
        for (at, others) in
            compared_pictures(&["1", "2", "3", "4", "5", "6", "7", "8", "9"].map(|name| ["", name]))
        {
            let others = others.into_iter().map(|(place, k)| (place, view(k, 0)));
            let shown = view(from(at), 1);
            *found
                .entry(shown_target(&view(at, 0), &shown, None, others)?)
                .or_insert(0) += 1;
        }
        misplaced(&found, "pictures", Extent::Dataset)
    }

    #[test]
    fn pictures_of_a_folder_under_the_names_of_others_are_told() {
        let before = told(|k| (k + 8) % 9).unwrap();
        assert!(
            before.contains("show the target of the pair before theirs"),
            "{before}"
        );
        let after = told(|k| (k + 1) % 9).unwrap();
        assert!(
            after.contains("show the target of the pair after theirs"),
            "{after}"
        );
        assert!(
            told(|k| (k * 4 + 3) % 9)
                .unwrap()
                .contains("the target of another pair")
        );
        assert_eq!(told(|k| k), None);
        // A frame in the middle was dropped; then one picture has another's name.
        let half = told(|k| if k < 4 { k } else { k - 1 }).unwrap();
        assert!(half.contains("before theirs"), "{half}");
        assert_eq!(told(|k| if k == 5 { 4 } else { k }), None);
        assert_eq!(compared_pictures(&[["", "1"], ["", "2"]]), BTreeMap::new());
    }

    #[test]
    fn copies_of_the_source_are_told_from_predictions_near_it() {
        let shown = |shown: &RgbImage, target| {
            shown_target(
                &view(target, 0),
                shown,
                Some(&view(0, 0)),
                std::iter::empty(),
            )
        };
        assert_eq!(shown(&view(0, 0), 1), Some(ShownTarget::Source));
        assert_eq!(shown(&view(0, 1), 1), Some(ShownTarget::SourceView));
        assert_eq!(shown(&view(1, 4), 1), Some(ShownTarget::Own));
        let between = |x: u32, y: u32| {
            let [a, b] = [0, 1].map(|k| view(k, 0).get_pixel(x, y).0[0] / 2);
            Rgb([a + b; 3])
        };
        let blend = RgbImage::from_fn(96, 72, between);
        assert_eq!(shown(&blend, 1), Some(ShownTarget::Own));
        // A target equal to its source.
        assert_eq!(shown(&view(0, 0), 0), Some(ShownTarget::Own));
        let said = misplaced(
            &BTreeMap::from([(ShownTarget::Source, 3)]),
            "pairs of d",
            Extent::Dataset,
        )
        .unwrap();
        assert!(
            said.contains("are the source's photograph, as with the baseline `copy` (3 of the 3"),
            "{said}"
        );
        let said = BTreeMap::from([(ShownTarget::Source, 1), (ShownTarget::SourceView, 3)]);
        let said = misplaced(&said, "pairs of d", Extent::Dataset).unwrap();
        assert!(
            said.contains("show the source's view rather than the target's (4 of the 4"),
            "{said}"
        );
    }

    /// The warning about 8 pictures, each of another source. `found` lists wrong cameras and how many pictures show them;
    /// the other pictures show their own.
    fn told_of(found: &[(ShownCamera, usize)]) -> Option<String> {
        let found = found
            .iter()
            .flat_map(|(camera, n)| std::iter::repeat_n(*camera, *n));
        let cameras: Vec<ShownCamera> = found.collect();
        let records: Vec<Record> = (0..8)
            .map(|k| Record {
                source: k.to_string(),
                shows: Some(ShownTarget::Own),
                camera: cameras.get(k).copied(),
                ..record()
            })
            .collect();
        of_dataset(&records, misplaced_pictures)
    }

    #[test]
    fn nearly_all_measured_cameras_have_to_agree() {
        use ShownCamera::{InversePose, Moved, NoRotation, Reframed, Reversed};
        let through = |zoom, shift, lens| {
            Reframed(Framing {
                zoom,
                roll: 0,
                shift,
                lens,
            })
        };
        let framed = |zoom, shift| through(zoom, shift, 0);
        for (found, parts) in [
            (
                vec![(Moved(-104), 2), (Moved(-98), 2)],
                ["move by -0.98 times", "check the sign", "4 of the 4"],
            ),
            (
                vec![(Moved(47), 1), (Moved(50), 5), (Moved(100), 1)],
                ["by 0.50", "the unit", "6 of the 7"],
            ),
            (
                vec![(InversePose, 3)],
                ["show", "the inverse of the target's pose", "3 of the 3"],
            ),
            (
                vec![(framed(801, [2, 0]), 2), (framed(795, [-1, 0]), 3)],
                ["show", "0.80 times its focal length, ", "5 of the 5"],
            ),
            // Large zooms are measured less exactly.
            (
                vec![(framed(754, [0, 0]), 3), (framed(774, [-14, 8]), 1)],
                ["show", "0.75 times its focal length, ", "4 of the 4"],
            ),
            (
                vec![
                    (through(1000, [0; 2], 104), 3),
                    (through(1000, [0; 2], 91), 2),
                ],
                ["show", "k1 = 0.10", "5 of the 5"],
            ),
            (
                vec![(NoRotation, 3)],
                ["show", "if it were not turned", "3 of the 3"],
            ),
            // Pictures that moved too far resemble framings, each another one.
            (
                vec![
                    (InversePose, 3),
                    (framed(940, [13, 0]), 1),
                    (framed(1000, [0, -9]), 1),
                ],
                ["show", "the inverse of the target's pose", "3 of the 3"],
            ),
            (
                vec![(Reversed(1), 4)],
                [
                    "show",
                    "if the y of its translation were reversed",
                    "4 of the 4",
                ],
            ),
            (
                vec![(framed(1000, [12, 0]), 4)],
                ["show", "shifted by (1.2 %, 0.0 %)", "4 of the 4"],
            ),
            // Components of one shift, across epipolar lines in three directions.
            (
                vec![
                    (framed(1000, [12, 0]), 2),
                    (framed(1000, [0, 6]), 2),
                    (framed(1000, [9, 9]), 1),
                ],
                ["show", "shifted by (1.2 %, 0.6 %)", "5 of the 5"],
            ),
        ] {
            let said = told_of(&found).unwrap();
            assert!(parts.iter().all(|part| said.contains(part)), "{said}");
        }
        for proper in [
            vec![(Moved(50), 2)],
            vec![(Moved(50), 3), (Moved(100), 3)],
            vec![(Moved(30), 2), (Moved(45), 2), (Moved(170), 2)],
            vec![(Moved(100), 8)],
            vec![(Moved(70), 8)],
            vec![(InversePose, 2), (framed(940, [13, 0]), 2)],
            vec![(framed(800, [0, 0]), 3), (framed(900, [0, 0]), 3)],
            vec![(framed(1000, [12, 0]), 3), (framed(1000, [-12, 0]), 3)],
            vec![
                (through(1000, [0; 2], 100), 3),
                (through(1000, [0; 2], -100), 3),
            ],
            vec![(Reversed(0), 3), (Reversed(1), 3)],
            vec![(NoRotation, 3), (Moved(100), 3)],
            vec![
                (framed(1000, [6, 0]), 2),
                (framed(1000, [-6, 1]), 2),
                (framed(1000, [0, 7]), 2),
                (framed(1000, [1, -7]), 2),
            ],
            vec![(framed(800, [0, 0]), 3), (Moved(100), 3)],
        ] {
            assert_eq!(told_of(&proper), None);
        }
    }

    #[test]
    fn a_wrong_focal_length_explains_crops_and_a_crop_of_nearly_all_explains_zooms() {
        let told = |resized: usize| {
            let framing = Framing {
                zoom: 1150,
                roll: 0,
                shift: [0; 2],
                lens: 0,
            };
            let records: Vec<Record> = (0..8)
                .map(|k| Record {
                    source: k.to_string(),
                    shows: Some(ShownTarget::Own),
                    camera: Some(ShownCamera::Reframed(framing)),
                    change: (k < resized).then_some(PictureChange::Cropped),
                    ..record()
                })
                .collect();
            let is_told = of_dataset(&records, misplaced_pictures).is_some();
            [is_told, of_dataset(&records, is_reframed)]
        };
        assert_eq!(
            [told(0), told(5), told(7)],
            [[true; 2], [true; 2], [false; 2]]
        );
    }

    #[test]
    fn a_picture_far_closer_to_the_source_did_not_move() {
        use ShownCamera::{InversePose, Moved};
        use ShownTarget::{Own, Source, SourceView};
        let told = |shows, camera, gain: f64| reconciled(Some(shows), Some(camera), || gain);
        assert_eq!(told(SourceView, Moved(133), 6.0), (Some(SourceView), None));
        assert_eq!(
            told(SourceView, Moved(133), 4.0),
            (Some(Own), Some(Moved(133)))
        );
        for camera in [Moved(40), InversePose] {
            assert_eq!(told(SourceView, camera, 9.0), (Some(Own), Some(camera)));
        }
        assert_eq!(told(SourceView, Moved(3), 4.0), (Some(SourceView), None));
        assert_eq!(told(Source, Moved(100), 0.0), (Some(Source), None));
        assert_eq!(told(Own, Moved(133), 9.0), (Some(Own), Some(Moved(133))));
    }

    #[test]
    fn moving_pictures_are_not_the_sources_view() {
        let told = |moving: usize| {
            let records: Vec<Record> = (0..8)
                .map(|k| Record {
                    source: k.to_string(),
                    shows: Some(if k < moving {
                        ShownTarget::Own
                    } else {
                        ShownTarget::SourceView
                    }),
                    camera: (k < moving).then_some(ShownCamera::Moved(60)),
                    ..record()
                })
                .collect();
            of_dataset(&records, misplaced_pictures)
        };
        assert!(told(1).unwrap().contains("show the source's view"));
        assert_eq!(told(2), None);
    }

    #[test]
    fn pictures_of_one_source_are_one_measurement_of_its_scale() {
        let told = |of: fn(usize) -> String| {
            let records: Vec<Record> = (0..4)
                .map(|k| Record {
                    source: of(k),
                    camera: Some(ShownCamera::Moved(50)),
                    ..record()
                })
                .collect();
            of_dataset(&records, misplaced_pictures)
        };
        assert_eq!(told(|_| "a".to_owned()), None);
        assert!(told(|k| k.to_string()).unwrap().contains("4 of the 4"));
    }

    /// Pictures under other names also seem to have moved by multiples of the motion, which differ from pair to pair.
    #[test]
    fn other_targets_are_told_although_cameras_were_measured() {
        let records: Vec<Record> = (0..8)
            .map(|k| Record {
                source: k.to_string(),
                shows: Some(ShownTarget::Next),
                camera: (k < 6).then_some(ShownCamera::Moved(-150 + 60 * k as i16)),
                ..record()
            })
            .collect();
        let said = of_dataset(&records, misplaced_pictures).unwrap();
        assert!(
            said.contains("the target of the pair after theirs"),
            "{said}"
        );
    }

    #[test]
    fn pictures_of_other_targets_are_told_at_other_sizes() {
        let resized = thumbnail(&view(1, 1), 120, 60);
        let own = thumbnail(&view(0, 0), 120, 60);
        let other = [(ShownTarget::Next, view(1, 0))].into_iter();
        assert_eq!(
            shown_target(&own, &resized, None, other),
            Some(ShownTarget::Next)
        );
    }
}
