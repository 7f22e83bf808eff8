//! Valid scenes are not reported, and each kind of damage is reported with its cause.

use std::sync::{Arc, LazyLock};

use glam::{DMat3, DQuat, DVec2, DVec3};
use image::RgbImage;
use image::imageops::{flip_horizontal, flip_vertical, rotate180};
use sharp::camera::RigidTransform;

use super::{Pixels, change, is_tried, scene, views, views_of, worlds};
use crate::check::advice::Units;
use crate::check::convention::{camera_mirrored, places_mirrored, turned_in_place};
use crate::check::{QUICK, THOROUGH, check, look, plausible};
use crate::lens::{Distortion, Lens};
use crate::processing::Processing;
use crate::synthetic::{SyntheticOptions, SyntheticScene};
use crate::{DatasetError, DepthMap, Pairing, Scene, View, ViewContent};

const SIZE: (u32, u32) = (128, 96);

fn found(views: &[View]) -> Vec<String> {
    super::found(views, THOROUGH)
}

type Spoil = fn(&mut [View]);

/// Two valid scenes, made once for all tests.
static VALID: LazyLock<[Vec<View>; 2]> = LazyLock::new(|| [0, 1].map(|seed| views(seed, SIZE)));

#[test]
fn valid_scenes_are_not_reported() {
    for (seed, right) in VALID.iter().enumerate() {
        assert_eq!(found(right), [""; 0], "{seed}");
    }
}

/// Fails unless the thorough check reports only the given text for each damaged scene. [`is_tried`] says which of the
/// two are damaged.
fn named(cases: &[(Spoil, &str)]) {
    for (seed, right) in (0..).zip(VALID.iter()) {
        for (i, (spoil, cause)) in cases.iter().enumerate() {
            if !is_tried(i, seed) {
                continue;
            }
            let mut wrong = right.clone();
            spoil(&mut wrong);
            let said = found(&wrong);
            assert!(
                said.len() == 1 && said[0].contains(cause),
                "{seed} {i} {cause}: {said:?}"
            );
        }
    }
}

/// Gives every view the depth of view `of(i)`, but keeps its picture and pose.
fn depth_of(views: &mut [View], of: impl Fn(usize) -> usize) {
    let before: Vec<Pixels> = views.iter().map(Pixels::of).collect();
    for (i, view) in views.iter_mut().enumerate() {
        view.content = Arc::new(Pixels {
            depth: before[of(i)].depth.clone(),
            ..before[i].clone()
        });
    }
}

/// Gives every view the picture of view `of(i)`, but keeps its depth and pose.
fn picture_of(views: &mut [View], of: impl Fn(usize) -> usize) {
    let before: Vec<Pixels> = views.iter().map(Pixels::of).collect();
    for (i, view) in views.iter_mut().enumerate() {
        view.content = Arc::new(Pixels {
            picture: before[of(i)].picture.clone(),
            ..before[i].clone()
        });
    }
}

fn swapped(a: usize, b: usize) -> impl Fn(usize) -> usize {
    move |i| match i {
        i if i == a => b,
        i if i == b => a,
        i => i,
    }
}

#[test]
fn depth_maps_of_other_pictures_are_named() {
    named(&[
        (
            |v| depth_of(v, |i| i.saturating_sub(1)),
            "every picture fits the depth map after its own",
        ),
        (
            |v| depth_of(v, |i| (i + 1) % 9),
            "every picture fits the depth map before its own",
        ),
        (
            |v| depth_of(v, |i| 8 - i),
            "the pictures fit the depth maps in reverse order",
        ),
        (
            |v| depth_of(v, swapped(2, 6)),
            "view_02 and view_06 have each other's depth map",
        ),
    ]);
}

#[test]
fn one_pose_or_one_depth_map_for_all_and_cameras_of_another_size_are_named() {
    named(&[
        (
            |views| {
                let first = views[0].camera_from_world;
                views
                    .iter_mut()
                    .for_each(|view| view.camera_from_world = first);
            },
            "all 9 views have the same pose",
        ),
        (|views| depth_of(views, |_| 0), "have the same depth map"),
    ]);
    let mut half = VALID[0].clone();
    for view in &mut half {
        let k = &mut view.intrinsics;
        let all = [&mut k.fx, &mut k.fy, &mut k.cx, &mut k.cy];
        all.into_iter().for_each(|value| *value /= 2.0);
    }
    let said = plausible::cameras(&half, false);
    assert!(
        said[0].contains("pictures 0.5 times as large; if so, multiply"),
        "{said:?}"
    );
}

#[test]
fn turned_pictures_and_depth_maps_are_named() {
    named(&[
        (
            |v| change(v, |c| c.change(flip_vertical)),
            "the depth maps are upside down",
        ),
        (
            |v| change(v, |c| c.change(flip_horizontal)),
            "the depth maps are mirrored left to right",
        ),
        (
            |v| change(v, |c| c.change(rotate180)),
            "the depth maps are turned by 180 degrees",
        ),
        (
            |v| change(v, |c| c.turn(flip_vertical)),
            "the pictures are upside down",
        ),
        (
            |v| change(v, |c| c.turn(flip_horizontal)),
            "the pictures are mirrored left to right",
        ),
        (
            |v| change(v, |c| c.turn(rotate180)),
            "the pictures are turned by 180 degrees",
        ),
    ]);
}

#[test]
fn depth_that_was_cut_off_is_named() {
    named(&[
        (
            |v| change(v, |c| c.each(|z| z.min(3.0))),
            "depth is clipped at 3 m",
        ),
        (
            |v| change(v, |c| c.each(|z| z.min(5.0))),
            "depth is clipped at 5 m",
        ),
    ]);
}

#[test]
fn values_that_stand_for_unknown_depth_are_named() {
    /// Replaces the depth in blocks that lie elsewhere in each view.
    fn holes(views: &mut [View], value: f32) {
        for (i, view) in views.iter_mut().enumerate() {
            let mut content = Pixels::of(view);
            let depth = content.depth.as_mut().unwrap();
            for (x, y, image::Luma([z])) in depth.enumerate_pixels_mut() {
                let block = i as u64 * 10_000 + u64::from(y / 8 * 100 + x / 8);
                if sharp::random::mix(block).is_multiple_of(5) {
                    *z = value;
                }
            }
            view.content = Arc::new(content);
        }
    }
    named(&[
        (|v| holes(v, 10.0), "of the depths are exactly 10 m"),
        (|v| holes(v, 0.1), "of the depths are exactly 0.1 m"),
    ]);
}

#[test]
fn swapped_pictures_are_named() {
    named(&[
        (
            |v| picture_of(v, swapped(2, 6)),
            "view_02 and view_06 have each other's pose",
        ),
        (
            |v| {
                let (a, b) = (v[3].content.clone(), v[7].content.clone());
                (v[3].content, v[7].content) = (b, a);
            },
            "view_03 and view_07 have each other's pose",
        ),
    ]);
}

fn world(views: &mut [View], signs: DVec3) {
    for view in views {
        view.camera_from_world = camera_mirrored(&view.camera_from_world, signs);
    }
}

#[test]
fn mirrored_axes_are_named() {
    fn places(views: &mut [View], signs: DVec3) {
        for view in views {
            view.camera_from_world = places_mirrored(&view.camera_from_world, signs);
        }
    }
    fn both(c: &mut Pixels, turn: fn(&RgbImage) -> RgbImage, depth: fn(&DepthMap) -> DepthMap) {
        c.turn(turn);
        c.change(depth);
    }
    named(&[
        (
            |v| world(v, DVec3::new(-1.0, 1.0, 1.0)),
            "the cameras' x axis negated",
        ),
        (
            |v| world(v, DVec3::new(1.0, -1.0, 1.0)),
            "the cameras' y axis negated",
        ),
        (
            |v| world(v, DVec3::new(1.0, 1.0, -1.0)),
            "the cameras' z axis negated",
        ),
        (
            |v| change(v, |c| both(c, flip_horizontal, flip_horizontal)),
            "pictures mirrored left to right",
        ),
        (
            |v| change(v, |c| both(c, flip_vertical, flip_vertical)),
            "pictures upside down",
        ),
        (
            |v| places(v, DVec3::new(-1.0, 1.0, 1.0)),
            "the x coordinates of the camera positions negated",
        ),
        (
            |v| places(v, DVec3::new(1.0, -1.0, 1.0)),
            "the y coordinates of the camera positions negated",
        ),
        (|v| places(v, -DVec3::ONE), "the translations negated"),
    ]);
}

/// Where cameras hardly roll or move forward, transposed rotations explain left-handed poses about as well.
#[test]
fn left_handed_poses_are_named_without_depth() {
    for seed in 0..3 {
        let mut views = views_of(SyntheticOptions {
            width: 240,
            height: 180,
            ..SyntheticOptions::varied(seed)
        });
        world(&mut views, DVec3::new(1.0, 1.0, -1.0));
        change(&mut views, |content| content.depth = None);
        for effort in [QUICK, THOROUGH] {
            let said = super::found(&views, effort);
            assert!(
                said.len() == 1 && said[0].contains("the cameras' z axis negated"),
                "{seed}: {said:?}"
            );
        }
    }
}

/// Uses a seed whose neighbouring views share enough features in any order.
#[test]
fn pictures_of_other_poses_are_named_without_depth() {
    for seed in [0] {
        let mut right = views(seed, (192, 144));
        change(&mut right, |content| content.depth = None);
        assert_eq!(found(&right), [""; 0], "{seed}");
        let order = [3_usize, 6, 1, 7, 0, 2, 8, 5, 4];
        for of in [
            &(|i: usize| order[i]) as &dyn Fn(usize) -> usize,
            &swapped(2, 6),
        ] {
            let mut wrong = right.clone();
            picture_of(&mut wrong, of);
            change(&mut wrong, |content| content.depth = None);
            let said = found(&wrong);
            assert!(
                said.len() == 1 && said[0].contains("pictures and poses are assigned incorrectly"),
                "{seed}: {said:?}"
            );
        }
    }
}

#[test]
fn proper_scenes_of_many_kinds_contradict_nothing() {
    for seed in worlds(0..12, 4) {
        let options = SyntheticOptions {
            width: 96,
            height: 96,
            ..SyntheticOptions::varied(seed)
        };
        let mut views = views_of(options);
        for effort in [QUICK, THOROUGH] {
            assert_eq!(super::found(&views, effort), [""; 0], "{seed}");
        }
        change(&mut views, |content| content.depth = None);
        assert_eq!(found(&views), [""; 0], "{seed}, without depth");
    }
}

#[test]
fn swapped_principal_points_are_named_and_crops_are_not() {
    let right = VALID[0].clone();
    let of = |cx: f64, cy: f64| {
        let mut views = right.clone();
        for view in &mut views {
            change(std::slice::from_mut(view), |content| content.depth = None);
            (view.intrinsics.cx, view.intrinsics.cy) = (cx, cy);
        }
        let all = plausible::cameras(&views, false);
        all.join("; ")
    };
    for (cx, cy) in [(48.0, 64.0), (46.9, 65.5)] {
        let said = of(cx, cy);
        assert!(said.contains("if cx and cy were swapped"), "{said}");
    }
    // Principal points of a whole picture, and of crops from the left, the bottom and a corner.
    for (cx, cy) in [
        (64.0, 48.0),
        (61.0, 50.0),
        (48.0, 48.0),
        (64.0, 64.0),
        (40.0, 60.0),
    ] {
        assert_eq!(of(cx, cy), "");
    }
}

pub(super) const FOCAL: f64 = 150.0;
pub(super) const BASELINE_M: f64 = 0.1;

/// A rectified pair of the procedural world.
pub(super) fn pair(seed: u64) -> Vec<View> {
    pair_of_size(seed, 1)
}

/// A rectified pair, `times` as large as 160x120.
fn pair_of_size(seed: u64, times: u32) -> Vec<View> {
    pair_of(seed, times, (BASELINE_M, 82.0))
}

/// A pair with this baseline (metres) and horizontal principal point (pixels) of the right camera.
pub(super) fn pair_of(seed: u64, times: u32, right: (f64, f64)) -> Vec<View> {
    let by = f64::from(times);
    let options = SyntheticOptions {
        seed,
        width: 160 * times,
        height: 120 * times,
        views: 2,
        samples: 1,
        ..SyntheticOptions::default()
    };
    let scene = SyntheticScene::new(options).unwrap();
    let side = |(x, cx): (f64, f64)| {
        let (focal, size) = ((FOCAL * by, FOCAL * by), (160 * times, 120 * times));
        let lens = Lens::new(focal, (cx * by, 60.5 * by), size, Distortion::None).unwrap();
        let pose = RigidTransform {
            rotation: DMat3::IDENTITY,
            translation: DVec3::new(-x, 0.0, 0.0),
        };
        scene.view_through("side", lens, pose)
    };
    let mut views = [(0.0, 79.5), right].map(side).to_vec();
    change(&mut views, |_| {});
    views
}

pub(super) fn of_pair(views: Vec<View>) -> (String, Option<String>) {
    let stereo = Pairing::Stereo {
        source: 0,
        target: 1,
    };
    let scene = Scene {
        pairing: stereo,
        ..scene(views)
    };
    let look = look(&scene, Units::default(), THOROUGH);
    (look.contradictions.join("; "), look.note)
}

/// The depth that results if a map of depths is read as disparities, or a map of disparities as
/// depths.
fn read_as_disparity(pixels: &mut Pixels) {
    pixels.each(|z| (BASELINE_M * FOCAL) as f32 / (z + 2.5));
}

#[test]
fn pairs_whose_disparity_is_something_else_are_named() {
    type Change = fn(&mut Pixels);
    let cases: [(Change, &str); 3] = [
        (read_as_disparity, "the disparity map holds depth, with 1"),
        (
            |c| c.change(flip_vertical),
            "the disparity map is upside down",
        ),
        (
            |c| c.change(flip_horizontal),
            "the disparity map is mirrored left to right",
        ),
    ];
    for seed in 0..3 {
        assert_eq!(of_pair(pair(seed)), (String::new(), None), "{seed}");
        for (spoil, cause) in cases {
            let mut wrong = pair(seed);
            change(&mut wrong, spoil);
            let (said, _) = of_pair(wrong);
            assert!(said.contains(cause), "{seed} {cause}: {said}");
        }
    }
}

/// The right picture was cropped, so that depths are positive with negated disparities, too.
#[test]
fn negated_disparities_are_named() {
    let product = 4.0 * BASELINE_M * FOCAL;
    for seed in 0..2 {
        let depth = pair(seed)[0].content.depth().unwrap().unwrap();
        let nearest = depth
            .iter()
            .filter(|z| **z > 0.0)
            .fold(f32::MAX, |a, b| a.min(*b));
        let offset = (0.55 * product / f64::from(nearest)).ceil();
        let right = pair_of(seed, 1, (4.0 * BASELINE_M, 79.5 + offset));
        assert_eq!(of_pair(right.clone()).0, "", "{seed}");
        let mut wrong = right;
        let (product, offset) = (product as f32, offset as f32);
        // The points with positive disparities, which are negative when negated.
        change(&mut wrong, |content| {
            content.each(|z| {
                if product / z > offset {
                    product / (2.0 * offset - product / z)
                } else {
                    0.0
                }
            });
        });
        let (said, _) = of_pair(wrong);
        assert!(
            said.contains("the disparities are negated"),
            "{seed}: {said}"
        );
    }
}

/// The right picture was cropped `by` columns further right than its camera states.
#[test]
fn pairs_cropped_at_different_columns_are_named() {
    for (by, said) in [
        (9, "disparities should be 9 pixels larger"),
        (-14, "should be 14 pixels smaller"),
    ] {
        for seed in 0..3 {
            let mut wrong = pair(seed);
            change(&mut wrong[1..], |c| {
                let before = c.picture.clone();
                let last = before.width() as i32 - 1;
                let from = |x: u32| (x as i32 + by).clamp(0, last) as u32;
                let moved = RgbImage::from_fn(before.width(), before.height(), |x, y| {
                    *before.get_pixel(from(x), y)
                });
                c.turn(|_: &RgbImage| moved.clone());
            });
            let (text, _) = of_pair(wrong);
            assert!(text.contains(said), "{seed} {by}: {text}");
        }
    }
}

#[test]
fn pairs_without_disparity_are_judged_by_their_rows() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = crate::bundled::extract(folder.path()).unwrap();
    let at = |name: &str| dataset.join("Motorcycle-quarter").join(name);
    std::fs::remove_file(at("disp0.pfm")).unwrap();
    let text = format!("middlebury={}", dataset.display());
    let spec = crate::DatasetSpec::parse(&text).unwrap();
    let scene = || check(&spec, 2, &|_, _| {}).unwrap().scenes.remove(0);
    let right = scene();
    assert_eq!(right.problems, [""; 0]);
    let note = "lie on their epipolar lines";
    assert!(
        right.notes.iter().any(|found| found.contains(note)),
        "{:?}",
        right.notes
    );
    for (from, to) in [("im0.png", "t"), ("im1.png", "im0.png"), ("t", "im1.png")] {
        std::fs::rename(at(from), at(to)).unwrap();
    }
    let wrong = scene().problems;
    assert!(
        wrong.len() == 1 && wrong[0].contains("left and right are swapped"),
        "{wrong:?}"
    );
    // A picture of one colour has no features.
    let mut blank = pair(0);
    change(&mut blank, |content| {
        content.depth = None;
        content.picture.fill(0);
    });
    let (said, note) = of_pair(blank);
    assert_eq!(said, "");
    assert!(note.unwrap().ends_with("match between neighbouring views)"));
}

#[test]
fn wrong_quaternions_cameras_and_depths_are_named() {
    fn w_last(pose: &mut RigidTransform) {
        let [x, y, z, w] = DQuat::from_mat3(&pose.rotation).to_array();
        // Stored as x, y, z, w, and read as w, x, y, z.
        pose.rotation = DMat3::from_quat(DQuat::from_xyzw(y, z, w, x));
    }
    fn normalised(pixels: &mut Pixels) {
        let depth = pixels.depth.clone().unwrap();
        let valid = || depth.iter().copied().filter(|z| *z > 0.0);
        let most = valid().fold(0.0, f32::max);
        let least = valid().fold(most, f32::min);
        pixels.each(|z| (z - least) / (most - least));
    }
    named(&[
        (
            |v| v.iter_mut().for_each(|v| w_last(&mut v.camera_from_world)),
            "quaternions taken as x, y, z, w instead of w, x, y, z",
        ),
        (
            |v| v.iter_mut().for_each(|v| v.intrinsics.fy *= 1.1),
            "fy should be 0.9 times as long",
        ),
        (|v| change(v, |c| c.each(|z| z + 1.0)), "m smaller ("),
        (
            |v| change(v, normalised),
            "every depth map ranges from 0 to 1",
        ),
        (
            |v| change(v, |c| c.each(|_| 2.0)),
            "the depth map of each view contains a single value, 2 m",
        ),
    ]);
}

#[test]
fn one_wrong_view_is_named() {
    named(&[
        (
            |v| {
                let off = RigidTransform {
                    rotation: DMat3::from_rotation_y(0.12),
                    translation: DVec3::new(0.2, 0.1, 0.1),
                };
                v[4].camera_from_world = off.after(&v[4].camera_from_world);
            },
            "view_04: its pose is off by about",
        ),
        (
            |v| change(&mut v[3..4], |c| c.each(|z| 2.0 * z)),
            "view_03: its depth should be multiplied by 0.5",
        ),
        (
            |v| change(&mut v[3..4], |c| c.change(flip_vertical)),
            "view_03: its depth map is upside down",
        ),
        (
            |v| change(&mut v[3..4], |c| c.turn(flip_horizontal)),
            "view_03: its picture is mirrored left to right",
        ),
        (
            |v| change(&mut v[6..7], |c| c.turn(rotate180)),
            "view_06: its picture is turned by 180 degrees",
        ),
    ]);
    let mut black = VALID[0].clone();
    change(&mut black[3..4], |c| c.picture.fill(0));
    let said = super::found(&black, QUICK);
    assert_eq!(said, ["view_03: the picture has a single colour"]);
}

/// An off-centre principal point is valid; with cx and cy swapped, it is reported.
#[test]
fn swapped_principal_points_off_the_middle_are_named() {
    let options = SyntheticOptions {
        width: 128,
        height: 96,
        views: 9,
        samples: 1,
        ..SyntheticOptions::default()
    };
    let world = SyntheticScene::new(options).unwrap();
    let f = world.views()[0].intrinsics.fx;
    let lens = Lens::new((f, f), (72.0, 42.0), (128, 96), Distortion::None).unwrap();
    let views = world.views().iter();
    let mut views: Vec<View> = views
        .map(|view| world.view_through(&view.id, lens, view.camera_from_world))
        .collect();
    assert_eq!(found(&views), [""; 0]);
    for view in &mut views {
        let k = &mut view.intrinsics;
        (k.cx, k.cy) = (k.cy, k.cx);
    }
    let said = found(&views);
    let is_named = said
        .iter()
        .any(|one| one.contains("cx and cy appear to be swapped"));
    assert!(is_named, "{said:?}");
}

#[test]
fn pairs_that_are_not_rectified_or_far_too_wide_are_named() {
    let lowered = |mut views: Vec<View>, by: u32| {
        change(&mut views[1..], |c| {
            c.turn(|picture| {
                let (w, h) = picture.dimensions();
                RgbImage::from_fn(w, h, |x, y| *picture.get_pixel(x, y.saturating_sub(by)))
            });
        });
        of_pair(views).0
    };
    let large = pair_of_size(0, 8);
    for (views, by) in [(pair(0), 3), (large.clone(), 2), (large, 5)] {
        assert_eq!(lowered(views.clone(), 0), "");
        let said = lowered(views, by);
        assert!(said.contains("rows are about"), "{by}: {said}");
    }
    let mut wide = pair(0);
    change(&mut wide, |content| content.depth = None);
    assert_eq!(of_pair(wide.clone()).0, "");
    wide[1].camera_from_world.translation *= 2000.0;
    let (said, _) = of_pair(wide);
    assert!(said.contains("the baseline of 200 m"), "{said}");
}

/// One calibration for pictures of two focal lengths, and depth maps of two units.
#[test]
fn some_wrong_views_are_named() {
    named(&[
        (
            |v| v[5..].iter_mut().for_each(|v| zoom(v, 1.0 / 1.3)),
            "view_05, view_06, view_07: their focal length should be multiplied by 1.",
        ),
        (
            |v| v.iter_mut().step_by(2).for_each(|v| zoom(v, 1.25)),
            "their focal length should be multiplied by",
        ),
        (
            |v| change(&mut v[3..5], |c| c.each(|z| 2.0 * z)),
            "view_03, view_04: their depth should be multiplied by 0.5 (",
        ),
        (
            |v| {
                change(&mut v[2..3], |c| c.each(|z| 2.0 * z));
                change(&mut v[5..6], |c| c.each(|z| 2.0 * z));
            },
            "view_02, view_05: their depth should be multiplied by 0.5 (",
        ),
    ]);
}

#[test]
fn units_that_change_within_a_scene_are_named() {
    let right = views(0, (64, 48));
    type UnitOf = fn(usize) -> f64;
    let cases: [(UnitOf, &str); 3] = [
        (
            |i| if i < 4 { 1.0 } else { 0.1 },
            "their translation should be multiplied by 10 (",
        ),
        // Only pairs within one half of the views are examined.
        (
            |i| if i < 4 { 1.0 } else { 2.0 },
            "their depth should be multiplied by 2, or their translation by 0.5 (",
        ),
        (
            |i| if i % 2 == 0 { 0.5 } else { 1.0 },
            "view_02, view_04, view_06: their translation should be multiplied by 2 (",
        ),
    ];
    for (by, cause) in cases {
        let mut wrong = right.clone();
        for (i, view) in wrong.iter_mut().enumerate() {
            view.camera_from_world.translation *= by(i);
        }
        let said = found(&wrong);
        assert!(said.len() == 1 && said[0].contains(cause), "{said:?}");
    }
}

/// Multiplies depth by a power of the length of the pixels' rays with z = 1.
fn times_ray_length(views: &mut [View], power: i32) {
    for view in views {
        let k = view.intrinsics;
        let length = |x: u32, y: u32| {
            let place = DVec2::new(f64::from(x), f64::from(y)) + 0.5;
            k.unproject(place, 1.0).length().powi(power) as f32
        };
        change(std::slice::from_mut(view), |c| {
            let pixels = c
                .depth
                .iter_mut()
                .flat_map(|depth| depth.enumerate_pixels_mut());
            pixels.for_each(|(x, y, z)| z.0[0] *= length(x, y));
        });
    }
}

/// Maps of ray lengths that are read as z, and maps of z that are read as ray lengths.
#[test]
fn lengths_of_rays_are_named_either_way() {
    named(&[
        (
            |v| times_ray_length(v, 1),
            "the stored depth is the length of rays, not z",
        ),
        (|v| times_ray_length(v, -1), "the stored depth is already z"),
    ]);
}

/// With many views, neighbours hardly move, so that their depths agree under either interpretation.
#[test]
fn lengths_of_rays_show_in_colours() {
    let right = views_of(SyntheticOptions {
        width: SIZE.0,
        height: SIZE.1,
        views: 49,
        samples: 1,
        ..SyntheticOptions::default()
    });
    let mut wrong = right[..9].to_vec();
    assert_eq!(found(&wrong), [""; 0]);
    times_ray_length(&mut wrong, 1);
    let said = found(&wrong);
    let named = "the stored depth is the length of rays";
    assert!(said.len() == 1 && said[0].contains(named), "{said:?}");
}

/// The masks keep what has no depth, and nothing else.
#[test]
fn masks_that_exclude_all_depth_are_named() {
    let mut wrong = VALID[0].clone();
    change(&mut wrong, |c| {
        let middle = |x: u32| x > SIZE.0 / 3;
        c.depth = c.depth.take().map(|depth| {
            DepthMap::from_fn(depth.width(), depth.height(), |x, y| {
                let z = depth.get_pixel(x, y).0[0];
                image::Luma([if middle(x) { z } else { 0.0 }])
            })
        });
    });
    let masked = |keep: bool| {
        let mut views = wrong.clone();
        change(&mut views, |c| {
            let (width, height) = c.picture.dimensions();
            c.valid = Some(image::GrayImage::from_fn(width, height, |x, _| {
                image::Luma([if (x > SIZE.0 / 3) == keep { 255 } else { 0 }])
            }));
        });
        found(&views)
    };
    assert_eq!(masked(true), [""; 0]);
    let said = masked(false);
    let named = "the masks exclude 100.0 % of the pixels that have depth";
    assert!(said.iter().any(|text| text.contains(named)), "{said:?}");
}

/// Views that show little of each other's remaining pixels fit no better if one of them is flipped.
#[test]
fn masks_that_keep_one_side_are_no_flipped_pictures() {
    type Keeps = fn(u32, u32) -> bool;
    let kept: [Keeps; 6] = [
        |_, y| 2 * y >= SIZE.1,
        |_, y| 20 * y >= 11 * SIZE.1,
        |_, y| 5 * y < 2 * SIZE.1,
        |x, _| 2 * x >= SIZE.0,
        |x, _| 3 * x >= 2 * SIZE.0,
        |x, _| 5 * x < 2 * SIZE.0,
    ];
    for (seed, right) in (0..).zip(VALID.iter()) {
        for (i, keeps) in kept.iter().enumerate() {
            if !is_tried(i, seed) {
                continue;
            }
            let mut views = right.clone();
            change(&mut views, |c| {
                let (width, height) = c.picture.dimensions();
                let level = |x, y| image::Luma([if keeps(x, y) { 255 } else { 0 }]);
                c.valid = Some(image::GrayImage::from_fn(width, height, level));
            });
            for effort in [QUICK, THOROUGH] {
                let said = look(&scene(views.clone()), Units::default(), effort).contradictions;
                assert_eq!(said, [""; 0], "{seed} {i} {effort:?}");
            }
        }
    }
}

/// The few views of a quick check do not tell a dropped frame from other changes with many degrees of freedom.
#[test]
fn a_quick_check_names_a_dropped_frame_like_a_thorough_one() {
    let mut named = 0;
    for (seed, right) in (0..).zip(VALID.iter()) {
        for dropped in 2..right.len() - 2 {
            if !is_tried(dropped, seed) {
                continue;
            }
            let mut wrong = right.clone();
            let of = |i: usize| (i + usize::from(i >= dropped)).min(right.len() - 1);
            picture_of(&mut wrong, of);
            depth_of(&mut wrong, of);
            wrong.pop();
            let [quick, thorough] = [QUICK, THOROUGH]
                .map(|effort| look(&scene(wrong.clone()), Units::default(), effort).contradictions);
            assert!(
                quick.is_empty() || quick == thorough,
                "{seed} {dropped}: {quick:?}, {thorough:?}"
            );
            named += usize::from(!quick.is_empty());
        }
    }
    assert!(named > 0);
}

#[test]
fn lost_rotations_are_named() {
    named(&[(
        |v| {
            v.iter_mut()
                .for_each(|v| v.camera_from_world.rotation = DMat3::IDENTITY)
        },
        "perhaps the rotations were lost",
    )]);
}

/// Points and poses from two models with different units.
#[test]
fn points_in_another_unit_are_told_to_be_of_another_model() {
    let spec = crate::DatasetSpec::parse("colmap=c,depth=points").unwrap();
    let mut wrong = VALID[0].clone();
    change(&mut wrong, |c| c.each(|z| 5.0 * z));
    let said = look(&scene(wrong), Units::of(&spec), THOROUGH).contradictions;
    let fits = "a unit of the poses that is 5 times that of the points fits better (";
    let mends =
        "; use points and poses from the same model, because no setting scales only one of them";
    assert!(
        said.len() == 1 && said[0].starts_with(fits) && said[0].ends_with(mends),
        "{said:?}"
    );
}

#[test]
fn two_views_are_enough_for_inverse_depth_and_a_principal_point() {
    for seed in worlds(0..2, 1) {
        let right = views(seed, (320, 240))[3..5].to_vec();
        assert_eq!(found(&right), [""; 0], "{seed}");
        let mut inverse = right.clone();
        change(&mut inverse, |c| c.each(|z| 5000.0 / z));
        let said = found(&inverse);
        assert!(
            said.len() == 1 && said[0].contains("the reciprocal of depth"),
            "{said:?}"
        );
        let mut aside = right;
        aside.iter_mut().for_each(|v| v.intrinsics.cx += 16.0);
        let said = found(&aside);
        let is_right = |said: &String| said.starts_with("cx and cy should be about 16");
        // If views only move sideways, the error has little effect.
        assert!(
            said.iter().all(is_right) && said.len() >= usize::from(seed == 0),
            "{said:?}"
        );
    }
    // A large offset, as in a crop with the cameras of the whole picture.
    let mut cropped = views(0, (320, 240));
    cropped.iter_mut().for_each(|v| v.intrinsics.cx += 60.0);
    let said = found(&cropped);
    // The true one is at 162.6.
    let is_right = |one: &String| (161..=164).any(|cx| one.contains(&format!("about {cx}")));
    let is_right = said.iter().any(is_right);
    assert!(is_right, "{said:?}");
}

/// Two cameras of one scene, without depth.
#[test]
fn swapped_focal_lengths_are_named_without_depth() {
    let options = SyntheticOptions {
        width: 256,
        height: 192,
        views: 9,
        samples: 1,
        ..SyntheticOptions::default()
    };
    let world = SyntheticScene::new(options).unwrap();
    let focal = |i: usize| world.views()[0].intrinsics.fx * [1.0, 1.1][i % 2];
    let views = world.views().iter().enumerate();
    let mut views: Vec<View> = views
        .map(|(i, view)| {
            let both = (focal(i), focal(i));
            let lens = Lens::new(both, (128.0, 96.0), (256, 192), Distortion::None);
            world.view_through(&view.id, lens.unwrap(), view.camera_from_world)
        })
        .collect();
    change(&mut views, |content| content.depth = None);
    assert_eq!(found(&views), [""; 0]);
    for (i, view) in views.iter_mut().enumerate() {
        (view.intrinsics.fx, view.intrinsics.fy) = (focal(i + 1), focal(i + 1));
    }
    let said = found(&views);
    let cause =
        "the focal lengths of view_00 (253.4 pixels) and view_01 (230.4) appear to be swapped";
    assert!(said.len() == 1 && said[0].starts_with(cause), "{said:?}");
}

#[test]
fn right_pictures_of_other_pairs_are_told() {
    for seed in 0..3 {
        let (own, other) = (pair(seed), pair(seed + 1));
        let (said, _) = of_pair(vec![own[0].clone(), other[1].clone()]);
        assert!(
            said.contains("replace it with this pair's own"),
            "{seed}: {said}"
        );
    }
}

fn zoom(view: &mut View, by: f64) {
    view.intrinsics.fx *= by;
    view.intrinsics.fy *= by;
}

/// No single swap explains shuffled pictures, even if they have few colours.
#[test]
fn shuffled_pictures_are_named_and_not_called_swapped() {
    fn flat(pixels: &mut Pixels) {
        pixels.turn(|picture| {
            let (w, h) = picture.dimensions();
            let level = |v: u8| v / 64 * 64 + 32;
            RgbImage::from_fn(w, h, |x, y| {
                image::Rgb(picture.get_pixel(x, y).0.map(level))
            })
        });
    }
    let order = [3_usize, 6, 1, 7, 0, 2, 8, 5, 4];
    for seed in worlds(0..3, 1) {
        for is_flat in [false, true] {
            let mut right = views(seed, SIZE);
            if is_flat {
                change(&mut right, flat);
            }
            assert_eq!(found(&right), [""; 0], "{seed}");
            for with_depth in [false, true] {
                let mut wrong = right.clone();
                if with_depth {
                    (0..9).for_each(|i| wrong[i].content = right[order[i]].content.clone())
                } else {
                    picture_of(&mut wrong, |i| order[i])
                }
                let said = found(&wrong);
                let says = |part: &str| said.iter().any(|text| text.contains(part));
                let is_named = says("assigned incorrectly") || says("are inconsistent");
                // Flat pictures may allow no conclusion, but must not lead to a wrong one.
                assert!(is_named || is_flat && said.is_empty(), "{seed}: {said:?}");
                assert!(!says("each other's"), "{seed}: {said:?}");
            }
        }
    }
}

#[test]
fn transposed_rotations_and_swapped_translations_are_named() {
    fn each(views: &mut [View], take: impl Fn(&RigidTransform) -> RigidTransform) {
        for view in views {
            view.camera_from_world = take(&view.camera_from_world);
        }
    }
    named(&[
        (
            |v| {
                each(v, |pose| RigidTransform {
                    rotation: pose.rotation.transpose(),
                    ..*pose
                });
            },
            "the poses' rotations transposed",
        ),
        (
            |v| each(v, |pose| turned_in_place(pose, pose.rotation.transpose())),
            "the poses' rotations transposed",
        ),
        (
            |v| {
                each(v, |pose| {
                    let axes = DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0));
                    turned_in_place(pose, axes * pose.rotation.transpose() * axes)
                });
            },
            "the poses' rotations transposed",
        ),
    ]);
    named(&[
        (
            |v| {
                each(v, |pose| RigidTransform {
                    translation: pose.rotation.transpose() * -pose.translation,
                    ..*pose
                });
            },
            "the translations taken as the cameras' positions",
        ),
        (
            |v| {
                each(v, |pose| RigidTransform {
                    translation: pose.rotation * -pose.translation,
                    ..*pose
                });
            },
            "the cameras' positions taken as translations",
        ),
    ]);
    // Body axes as in ROS and as in aviation.
    for axes in [
        DMat3::from_cols(-DVec3::Y, -DVec3::Z, DVec3::X),
        DMat3::from_cols(DVec3::Y, DVec3::Z, DVec3::X),
    ] {
        let mut wrong = VALID[0].clone();
        each(&mut wrong, |pose| RigidTransform {
            rotation: axes * pose.rotation,
            translation: axes * pose.translation,
        });
        let said = found(&wrong);
        let is_named = |one: &String| one.contains("the axes of a vehicle's body");
        assert!(said.iter().any(is_named), "{said:?}");
    }
}

/// Tested with depth maps, which are turned as well, and without them.
#[test]
fn pictures_turned_by_a_quarter_without_their_poses_are_named() {
    let mut right = views(0, (192, 144));
    for with_depth in [true, false] {
        if !with_depth {
            change(&mut right, |c| c.depth = None);
        }
        assert_eq!(found(&right), [""; 0]);
        let mut wrong = right.clone();
        change(&mut wrong, |c| {
            c.turn(image::imageops::rotate90);
            c.change(image::imageops::rotate90);
        });
        for view in &mut wrong {
            let k = view.intrinsics;
            (view.intrinsics.fx, view.intrinsics.fy) = (k.fy, k.fx);
            (view.intrinsics.cx, view.intrinsics.cy) = (f64::from(k.height) - k.cy, k.cx);
            (view.intrinsics.width, view.intrinsics.height) = (k.height, k.width);
        }
        let said = found(&wrong);
        assert!(
            said.len() == 1
                && said[0].contains("the pictures were turned clockwise, but not the poses"),
            "{with_depth}: {said:?}"
        );
    }
}

const CONTRADICT: &str =
    "pictures and poses contradict each other, and no known correction explains it";

fn shifted(pixels: &mut Pixels, (x, y): (i64, i64)) {
    pixels.turn(|picture| {
        let (w, h) = picture.dimensions();
        let at = |i: u32, by: i64, n: u32| (i64::from(i) + by).clamp(0, i64::from(n) - 1) as u32;
        RgbImage::from_fn(w, h, |i, j| *picture.get_pixel(at(i, x, w), at(j, y, h)))
    });
}

/// Tested with pictures that were each cropped at another position, as by video stabilisation, and with poses whose
/// second half is from another model.
#[test]
fn what_no_change_explains_is_named_as_a_contradiction() {
    let right = views(0, (256, 192));
    let mut bare = right.clone();
    change(&mut bare, |c| c.depth = None);
    for right in [right, bare] {
        assert_eq!(found(&right), [""; 0]);
        let mut cropped = right.clone();
        for (i, view) in cropped.iter_mut().enumerate() {
            let by = [(14, 12), (-12, -14), (9, -13), (-15, 10)][i % 4];
            change(std::slice::from_mut(view), |c| shifted(c, by));
        }
        let mut of_two = right.clone();
        let to_other = RigidTransform {
            rotation: DMat3::from_rotation_y(0.4) * DMat3::from_rotation_x(0.3),
            translation: DVec3::new(1.0, 0.4, -0.7),
        };
        for view in &mut of_two[5..] {
            view.camera_from_world = view.camera_from_world.after(&to_other);
        }
        for wrong in [cropped, of_two] {
            for effort in [THOROUGH, QUICK] {
                let said = super::found(&wrong, effort);
                assert!(
                    said.len() == 1 && said[0].starts_with(CONTRADICT),
                    "{effort:?}: {said:?}"
                );
            }
        }
    }
}

/// A view whose depth comes from a scan.
#[derive(Debug)]
struct Scanned(Pixels);

impl ViewContent for Scanned {
    fn image(&self) -> Result<RgbImage, DatasetError> {
        self.0.image()
    }

    fn depth(&self) -> Result<Option<DepthMap>, DatasetError> {
        self.0.depth()
    }

    fn processing(&self) -> Processing {
        Processing {
            depth_by_pose: true,
            ..self.0.processing()
        }
    }
}

/// Scans that give depth to a few per cent of the pixels: one in its place, and one whose points, after a wrong
/// transformation, are a square in front of the scene. The depth of such a square agrees between all views.
#[test]
fn a_scan_in_another_place_is_reported_although_few_pixels_have_depth() {
    let right = views(0, (256, 192));
    let scanned = |depth_of: &dyn Fn(&View, u32, u32, f32) -> f32| {
        let mut views = right.clone();
        for view in &mut views {
            let mut pixels = Pixels::of(view);
            for (x, y, z) in pixels.depth.as_mut().unwrap().enumerate_pixels_mut() {
                z.0[0] = depth_of(view, x, y, z.0[0]);
            }
            view.content = Arc::new(Scanned(pixels));
        }
        views
    };
    let in_place = scanned(&|_, x, y, z| {
        let is_scanned = (100..160).contains(&x) && (70..120).contains(&y);
        if is_scanned { z } else { 0.0 }
    });
    let square = right[4].camera_from_world;
    let elsewhere = scanned(&|view, x, y, _| {
        let square_from_camera = square.after(&view.camera_from_world.inverse());
        let at = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
        let ray = square_from_camera.rotation * view.intrinsics.unproject(at, 1.0);
        let z = (1.0 - square_from_camera.translation.z) / ray.z;
        let hit = square_from_camera.translation + ray * z;
        let is_inside = z > 0.0 && hit.truncate().abs().max_element() < 0.15;
        if is_inside { z as f32 } else { 0.0 }
    });
    for effort in [THOROUGH, QUICK] {
        assert_eq!(super::found(&in_place, effort), [""; 0], "{effort:?}");
    }
    for effort in [THOROUGH, QUICK] {
        let said = super::found(&elsewhere, effort);
        assert!(
            said.len() == 1 && said[0].contains("the transformation that places the scan"),
            "{effort:?}: {said:?}"
        );
    }
}

/// A third of each picture shows something that moves on its own, and poses are imprecise.
#[test]
fn moving_objects_and_imprecise_poses_are_no_contradiction() {
    for seed in worlds(0..2, 1) {
        let mut views = views(seed, (256, 192));
        for (i, view) in views.iter_mut().enumerate() {
            let off = RigidTransform {
                rotation: DMat3::from_rotation_y(0.004 * [1.0, -1.0, 0.5][i % 3]),
                translation: DVec3::ZERO,
            };
            view.camera_from_world = off.after(&view.camera_from_world);
            let left = 20 + 11 * i as u32;
            change(std::slice::from_mut(view), |c| {
                c.turn(|picture| {
                    let mut picture = picture.clone();
                    for (x, y, pixel) in picture.enumerate_pixels_mut() {
                        if (left..left + 110).contains(&x) && (40..150).contains(&y) {
                            let (x, y) = (f64::from(x - left), f64::from(y));
                            let wave = 127.0
                                + 60.0 * (x * 0.37).sin()
                                + 60.0 * (y * 0.29 + x * x * 0.003).cos();
                            pixel.0 = [wave as u8; 3];
                        }
                    }
                    picture
                });
            });
        }
        for with_depth in [true, false] {
            if !with_depth {
                change(&mut views, |c| c.depth = None);
            }
            for effort in [THOROUGH, QUICK] {
                let said = super::found(&views, effort);
                let is_accused = said.iter().any(|said| said.contains("no known correction"));
                assert!(!is_accused, "{seed} {with_depth} {effort:?}: {said:?}");
            }
        }
    }
}

/// A camera that does not move may give the same picture twice.
#[test]
fn repeated_pictures_are_named_where_the_camera_moves() {
    named(&[(
        |v| v[3].content = v[2].content.clone(),
        "view_02 and view_03 have the same picture",
    )]);
    let mut still = VALID[0].clone();
    still[3] = View {
        id: still[3].id.clone(),
        ..still[2].clone()
    };
    assert_eq!(found(&still), [""; 0]);
}

#[test]
fn pairs_of_one_picture_or_turned_against_each_other_are_named() {
    let mut copied = pair(0);
    let left = Pixels::of(&copied[0]);
    change(&mut copied[1..], |c| c.picture = left.picture.clone());
    let (said, _) = of_pair(copied);
    assert!(
        said.starts_with("the right picture is the same as the left one"),
        "{said}"
    );
    for (degrees, way) in [(1.5_f64, "clockwise"), (-1.5, "counterclockwise")] {
        let mut turned = pair_of_size(0, 2);
        assert_eq!(of_pair(turned.clone()).0, "");
        change(&mut turned[1..], |c| {
            c.turn(|picture| {
                let (w, h) = picture.dimensions();
                let middle = DVec2::new(f64::from(w), f64::from(h)) / 2.0;
                let back = DVec2::from_angle(-degrees.to_radians());
                RgbImage::from_fn(w, h, |x, y| {
                    let from = DVec2::new(f64::from(x), f64::from(y)) + 0.5 - middle;
                    let from = middle + back.rotate(from);
                    let at = |v: f64, n: u32| v.clamp(0.0, f64::from(n - 1)) as u32;
                    *picture.get_pixel(at(from.x, w), at(from.y, h))
                })
            });
        });
        let (said, _) = of_pair(turned);
        let right = format!("degrees {way} relative to the left one");
        assert!(
            said.contains("turned by about 1.") && said.contains(&right),
            "{way}: {said}"
        );
    }
}

/// If depths agree for any focal length, colours must reveal the error, also in a thorough check.
#[test]
fn focal_lengths_that_depth_does_not_tell_are_named() {
    let mut wrong = VALID[0].clone();
    for view in &mut wrong {
        zoom(view, 1.3);
    }
    for effort in [THOROUGH, QUICK] {
        let said = super::found(&wrong, effort);
        assert!(
            said.len() == 1 && said[0].contains("the focal length should be 0.7"),
            "{effort:?}: {said:?}"
        );
    }
}

/// In a pair whose views differ in focal length, a quick check reports both unless the surrounding
/// views show which one is wrong.
#[test]
fn a_quick_look_blames_no_view_of_an_undecided_pair() {
    let mut wrong = VALID[0].clone();
    wrong[5..].iter_mut().for_each(|view| zoom(view, 1.0 / 1.3));
    let said = super::found(&wrong, QUICK);
    assert!(
        said.len() == 1 && said[0].starts_with("view_05") && !said[0].contains("view_04"),
        "{said:?}"
    );
    let said = super::found(&wrong[4..6], QUICK);
    assert!(said.len() == 1 && said[0].contains("view_05"), "{said:?}");
}

#[test]
fn thinned_pictures_are_named() {
    for (stride, which) in [(2, "second"), (3, "third")] {
        let all = views_of(SyntheticOptions {
            width: 192,
            height: 144,
            views: 10 * stride,
            samples: 1,
            ..SyntheticOptions::default()
        });
        let mut thinned: Vec<View> = all.iter().step_by(stride).cloned().collect();
        for (view, other) in thinned.iter_mut().zip(&all) {
            view.camera_from_world = other.camera_from_world;
        }
        for has_depth in [true, false] {
            if !has_depth {
                change(&mut thinned, |content| content.depth = None);
            }
            // Without depth, the few pairs that a quick check examines have too few features.
            for effort in [THOROUGH, QUICK]
                .into_iter()
                .take(1 + usize::from(has_depth))
            {
                let said = super::found(&thinned, effort);
                let cause = format!("as if only every {which} picture had been kept");
                assert!(
                    said.len() == 1 && said[0].contains(&cause),
                    "{effort:?} {has_depth}: {said:?}"
                );
            }
        }
    }
}

#[test]
fn depth_between_two_planes_is_named() {
    for effort in [THOROUGH, QUICK] {
        let mut wrong = VALID[0].clone();
        change(&mut wrong, |content| content.each(|z| 9.0 * (z - 0.5)));
        let said = super::found(&wrong, effort);
        assert!(
            said.len() == 1 && said[0].contains("normalised between a near and a far"),
            "{effort:?}: {said:?}"
        );
    }
}

/// With two views at nearly the same pose, only the ratio of their focal lengths can be measured.
#[test]
fn either_of_two_views_may_be_wrong() {
    let options = SyntheticOptions {
        width: SIZE.0,
        height: SIZE.1,
        ..SyntheticOptions::default()
    };
    let world = SyntheticScene::new(options).unwrap();
    let first = &world.views()[0];
    let k = first.intrinsics;
    let lens = Lens::new((k.fx, k.fy), (k.cx, k.cy), SIZE, Distortion::None).unwrap();
    let beside = RigidTransform {
        translation: first.camera_from_world.translation + DVec3::new(0.02, 0.0, 0.0),
        ..first.camera_from_world
    };
    let mut wrong = vec![first.clone(), world.view_through("view_01", lens, beside)];
    change(&mut wrong, |_| {});
    zoom(&mut wrong[1], 1.3);
    let said = super::found(&wrong, QUICK);
    assert!(
        said.len() == 1
            && said[0].contains("its focal length should be multiplied by")
            && said[0].contains(", or that of view_0"),
        "{said:?}"
    );
}

#[test]
fn another_exposure_is_a_note() {
    let note = |views: &[View]| look(&scene(views.to_vec()), Units::default(), THOROUGH);
    for seed in worlds(0..2, 1) {
        let right = views(seed, SIZE);
        let mut exposed = right.clone();
        for i in [1, 4, 6] {
            change(&mut exposed[i..=i], |pixels| {
                let levels = pixels.picture.iter_mut();
                levels.for_each(|level| *level = (0.7 * f64::from(*level)) as u8);
            });
        }
        let said = note(&exposed);
        assert_eq!(said.contradictions, [""; 0], "{seed}");
        let said = said.note.unwrap();
        let factor = said.split("by a factor of ").nth(1).unwrap();
        let factor: f64 = factor.split(')').next().unwrap().parse().unwrap();
        assert!(said.contains("differ in exposure"), "{seed}: {said}");
        let off = factor.ln().abs() + 0.7_f64.ln();
        assert!(off.abs() < 0.03, "{seed}: {said}");
        assert_eq!(note(&right).note, None, "{seed}");
    }
}
