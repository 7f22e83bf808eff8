//! Judges whether the pictures of a group show other targets than their own, or the view of a wrong camera.

use std::collections::{BTreeMap, BTreeSet};

use super::finding::{Framing, PictureChange, ShownCamera, ShownTarget};
use super::group::{Extent, PictureGroup};
use super::sample::FEWEST;
use super::shift::{far_shifted_pictures, shifted_pictures};
use crate::evaluate::record::Record;

/// A wrong camera is reported only if at least this share of the pictures with a measured camera agree on it.
const MIN_SHARE: f64 = 0.8;

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

/// The wrong camera on which nearly all measured pictures agree, the number that agree, and the number measured. A
/// translation in world axes resembles other mistakes, a different one in each picture, so it also counts where it
/// explains a picture about as well as the measured camera; but only if nearly all pictures agree on no other camera.
fn wrong_camera_of(group: &PictureGroup<'_, &Record>) -> Option<(ShownCamera, usize, usize)> {
    let mut cameras = cameras(group);
    let resized = group.pictures.iter().filter(|r| is_resized(r.change));
    // Pictures that were cropped or padded and then resized are reported as such.
    if resized.count() as f64 >= MIN_SHARE * group.pictures.len() as f64 {
        cameras.retain(|camera| !matches!(camera, ShownCamera::Reframed(_)));
    }
    wrong_camera(cameras.clone(), group.extent).or_else(|| {
        // If a wrong camera is far from the target, its pictures resemble other framings, a different one in each
        // picture.
        cameras.retain(|camera| !matches!(camera, ShownCamera::Reframed(_)));
        let found = wrong_camera(cameras, group.extent);
        // Poor depth can also cause other motions and framings, so another motion is no evidence here.
        let found = found.filter(|(camera, ..)| !matches!(camera, ShownCamera::Moved(_)));
        // The pictures of one scene are too much alike to tell several causes apart.
        let is_dataset = group.extent == Extent::Dataset;
        found.or_else(|| is_dataset.then(|| in_world(group)).flatten())
    })
}

/// A translation in world axes on which nearly all measured pictures agree, like [`wrong_camera_of`].
fn in_world(group: &PictureGroup<'_, &Record>) -> Option<(ShownCamera, usize, usize)> {
    let pictures = group.pictures.iter();
    let cameras = pictures.filter_map(|record| record.in_world.or(record.camera));
    let cameras = cameras.filter(|camera| !matches!(camera, ShownCamera::Reframed(_)));
    let found = wrong_camera(cameras.collect(), group.extent);
    found.filter(|(camera, ..)| matches!(camera, ShownCamera::WorldTranslation(_)))
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
pub(crate) fn misplaced_pictures(group: &PictureGroup<'_, &Record>) -> Option<String> {
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
        shown.remove(&ShownTarget::SourceFromTarget);
    }
    let far_shift = far_shifted_pictures(group);
    // A missing rotation or a reversed axis also moves content across epipolar lines, but not alike in all pictures.
    let is_shifted = |camera: &ShownCamera| {
        matches!(camera, ShownCamera::NoRotation | ShownCamera::Reversed(_)) && far_shift.is_some()
    };
    match wrong_camera_of(group).filter(|(camera, ..)| !is_shifted(camera)) {
        Some((camera, count, all)) => Some(format!(
            "its pictures {} ({count} of the {all} {pairs} whose motion could be measured agree)",
            camera.text()
        )),
        None => misplaced(&shown, &pairs, group.extent)
            .or(far_shift)
            .or_else(|| shifted_pictures(group)),
    }
}

/// Warns if most compared pictures show targets other than their own. `found` counts the pictures by the target shown;
/// `pairs` names their pairs in the sentence.
pub(crate) fn misplaced(
    found: &BTreeMap<ShownTarget, usize>,
    pairs: &str,
    extent: Extent,
) -> Option<String> {
    use ShownTarget::{
        Next, Other, Previous, Source, SourceFromTarget, SourceView, ViewAfter, ViewBefore,
    };
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
    let views = count(&[Source, SourceView, SourceFromTarget]);
    let from_target = count(&[SourceFromTarget]);
    // Depths that are far too large also give the source's view, so a scene needs more evidence.
    let are_views = is_most(views) && views as f64 >= extent.share(0.5) * all as f64;
    if are_views && from_target >= extent.fewest(FEWEST) && 2 * from_target > views {
        return Some(format!(
            "its pictures show {} rather than the target's ({views} of the {all} compared in {pairs} are significantly \
             closer to the source's photograph, and {from_target} of these are far worse where the target does not show \
             the source's content), so source and target are swapped in the file names; rename A__B to B__A, or render \
             B from A",
            SourceView.text()
        ));
    }
    if are_views {
        return Some(format!(
            "its pictures show {} rather than the target's ({views} of the {all} compared in {pairs} are significantly \
             closer to the source's photograph), as if they were rendered with the source's pose, or with poses of \
             another unit or axes, or as if source and target were swapped in the file names",
            SourceView.text()
        ));
    }
    // If the source is next to the target in the scene, a picture that is named one frame off looks like a copy of the
    // source.
    let all = all - views;
    let is_most = |count: usize| count >= extent.fewest(FEWEST) && 2 * count > all;
    let shifts = [Previous, Next, ViewBefore, ViewAfter].map(|place| (place, count(&[place])));
    let (shift, shifted) = shifts.into_iter().max_by_key(|(_, count)| *count)?;
    // Names are often shifted in a part of a sequence, after a frame that was dropped.
    let is_part = extent == Extent::Dataset && shifted >= FEWEST && 5 * shifted >= 2 * all;
    let (what, count) = if is_part || is_most(shifted) {
        (shift, shifted)
    } else {
        (
            Other,
            count(&[Previous, Next, ViewBefore, ViewAfter, Other]),
        )
    };
    (is_part || is_most(count)).then(|| {
        format!(
            "its pictures look as if they had the names of other {pairs} ({count} of the {all} compared show {} \
             significantly better than their own target); correct the file names",
            what.text()
        )
    })
}

/// The wrong camera on which nearly all of the `cameras` agree, the number that agree, and the total number. A wrong
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
    use super::super::group::tests::of_dataset;
    use super::*;
    use crate::evaluate::record::tests::record;

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
            vec![(Moved(50), 3), (framed(1000, [12, 0]), 3)],
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
    fn a_translation_in_world_axes_explains_several_other_cameras() {
        use ShownCamera::{Moved, Reversed, WorldTranslation};
        let told = |cameras: [ShownCamera; 6], explained: usize| {
            let records: Vec<Record> = (0..6)
                .map(|k| Record {
                    source: k.to_string(),
                    shows: Some(ShownTarget::Own),
                    camera: Some(cameras[k]),
                    in_world: (k < explained).then_some(WorldTranslation(true)),
                    ..record()
                })
                .collect();
            of_dataset(&records, misplaced_pictures)
        };
        let world = WorldTranslation(true);
        let mixed = [
            world,
            world,
            Moved(-100),
            Moved(-98),
            Reversed(0),
            Reversed(0),
        ];
        let said = told(mixed, 6).unwrap();
        assert!(
            said.contains("in world axes") && said.contains("6 of the 6"),
            "{said}"
        );
        assert_eq!(told(mixed, 3), None);
        // The simpler cause on which all pictures agree.
        assert!(told([Moved(-100); 6], 6).unwrap().contains("-1.00 times"));
        let right = [world, world, Moved(100), Moved(100), Moved(100), Moved(100)];
        assert_eq!(told(right, 2), None);
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
    fn a_shift_of_all_pictures_is_no_reversed_axis() {
        let told = |far_shift| {
            let records: Vec<Record> = (0..8)
                .map(|k| Record {
                    source: k.to_string(),
                    shows: Some(ShownTarget::Own),
                    camera: Some(ShownCamera::Reversed(1)),
                    far_shift,
                    ..record()
                })
                .collect();
            of_dataset(&records, misplaced_pictures).unwrap()
        };
        // All displacements are 30 thousandths of the width downwards.
        let shifted = Some([0.0, 0.0, 1.0, 0.0, 30.0, 900.0]);
        assert!(told(shifted).contains("shifted by about (0.0 %, 3.0 %)"));
        // Most of the displacements are not alike.
        let others = Some([0.0, 0.0, 1.0, 0.0, 30.0, 3000.0]);
        for far_shift in [None, others] {
            assert!(told(far_shift).contains("if the y of its translation were reversed"));
        }
    }

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
}
