//! Proper scenes contradict nothing, and what was spoiled in them is named.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{DMat3, DQuat, DVec2, DVec3};
use image::imageops::{flip_horizontal, flip_vertical, rotate180};
use image::{GrayImage, RgbImage};
use sharp::camera::RigidTransform;

use super::advice::Units;
use super::{QUICK, THOROUGH, look};
use crate::lens::{Distortion, Lens};
use crate::required_files::FileRole;
use crate::synthetic::{SyntheticOptions, SyntheticScene};
use crate::{DatasetError, DepthMap, Pairing, Scene, View, ViewContent};

/// The picture of one view and the depth of another, changed.
#[derive(Debug)]
struct Changed {
    picture: Arc<dyn ViewContent>,
    depth: Option<Arc<dyn ViewContent>>,
    turn: fn(&RgbImage) -> RgbImage,
    change: fn(&DepthMap) -> DepthMap,
}

impl Changed {
    fn of(view: &View) -> Self {
        Self {
            picture: Arc::clone(&view.content),
            depth: Some(Arc::clone(&view.content)),
            turn: RgbImage::clone,
            change: DepthMap::clone,
        }
    }
}

impl ViewContent for Changed {
    fn image(&self) -> Result<RgbImage, DatasetError> {
        Ok((self.turn)(&self.picture.image()?))
    }

    fn valid_pixels(&self) -> Result<Option<GrayImage>, DatasetError> {
        Ok(None)
    }

    fn depth(&self) -> Result<Option<DepthMap>, DatasetError> {
        let depth = self.depth.as_ref().map(|depth| depth.depth());
        Ok(depth
            .transpose()?
            .flatten()
            .map(|depth| (self.change)(&depth)))
    }

    fn image_file(&self) -> Option<&Path> {
        None
    }

    fn files_by_role(&self) -> Vec<(FileRole, PathBuf)> {
        Vec::new()
    }

    fn image_sha256(&self) -> Result<String, DatasetError> {
        self.picture.image_sha256()
    }
}

fn scene(views: Vec<View>, pairing: Pairing) -> Scene {
    Scene {
        dataset: "d".to_owned(),
        id: "s".to_owned(),
        cluster: "s".to_owned(),
        views,
        pairing,
        notes: Vec::new(),
        warnings: Vec::new(),
    }
}

fn views(seed: u64) -> Vec<View> {
    let options = SyntheticOptions {
        seed,
        width: 128,
        height: 96,
        views: 9,
        samples: 1,
        ..SyntheticOptions::default()
    };
    SyntheticScene::new(options).unwrap().views().to_vec()
}

fn found(views: &[View]) -> Vec<String> {
    let scene = scene(views.to_vec(), Pairing::MultiView);
    look(&scene, Units::default(), THOROUGH).contradictions
}

type Spoil = fn(&mut [View]);

/// Fails unless the thorough look at two proper scenes says nothing, and of the spoiled ones this.
fn named(cases: &[(Spoil, &str)]) {
    for seed in 0..2 {
        let right = views(seed);
        assert_eq!(found(&right), [""; 0], "{seed}");
        for (i, (spoil, cause)) in cases.iter().enumerate() {
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

fn change(views: &mut [View], change: impl Fn(&mut Changed)) {
    for view in views {
        let mut content = Changed::of(view);
        change(&mut content);
        view.content = Arc::new(content);
    }
}

/// Every view keeps its picture and pose and has the depth of another.
fn depth_of(views: &mut [View], of: impl Fn(usize) -> usize) {
    let before = views.to_vec();
    for (i, view) in views.iter_mut().enumerate() {
        let mut content = Changed::of(view);
        content.depth = Some(Arc::clone(&before[of(i)].content));
        view.content = Arc::new(content);
    }
}

/// Every view keeps its depth and pose and has the picture of another.
fn picture_of(views: &mut [View], of: impl Fn(usize) -> usize) {
    let before = views.to_vec();
    for (i, view) in views.iter_mut().enumerate() {
        let mut content = Changed::of(view);
        content.picture = Arc::clone(&before[of(i)].content);
        view.content = Arc::new(content);
    }
}

fn exchanged(a: usize, b: usize) -> impl Fn(usize) -> usize {
    move |i| match i {
        i if i == a => b,
        i if i == b => a,
        i => i,
    }
}

fn clipped(depth: &DepthMap, most: f32) -> DepthMap {
    let mut depth = depth.clone();
    depth.iter_mut().for_each(|z| *z = z.min(most));
    depth
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
            |v| depth_of(v, exchanged(2, 6)),
            "view_02 fits the depth map of view_06, and the other way round",
        ),
    ]);
}

#[test]
fn turned_pictures_and_depth_maps_are_named() {
    named(&[
        (
            |v| change(v, |c| c.change = flip_vertical),
            "the depth maps are upside down",
        ),
        (
            |v| change(v, |c| c.change = flip_horizontal),
            "the depth maps are mirrored left to right",
        ),
        (
            |v| change(v, |c| c.change = rotate180),
            "the depth maps are turned by 180 degrees",
        ),
        (
            |v| change(v, |c| c.turn = flip_vertical),
            "the pictures are upside down",
        ),
        (
            |v| change(v, |c| c.turn = flip_horizontal),
            "the pictures are mirrored left to right",
        ),
        (
            |v| change(v, |c| c.turn = rotate180),
            "the pictures are turned by 180 degrees",
        ),
    ]);
}

#[test]
fn depth_that_was_cut_off_is_named() {
    named(&[
        (
            |v| change(v, |c| c.change = |depth| clipped(depth, 3.0)),
            "depth is cut off at 3 m",
        ),
        (
            |v| change(v, |c| c.change = |depth| clipped(depth, 5.0)),
            "depth is cut off at 5 m",
        ),
    ]);
}

#[test]
fn exchanged_pictures_are_named() {
    named(&[
        (
            |v| picture_of(v, exchanged(2, 6)),
            "view_02 fits the pose of view_06, and the other way round",
        ),
        (
            |v| {
                let (a, b) = (v[3].content.clone(), v[7].content.clone());
                (v[3].content, v[7].content) = (b, a);
            },
            "view_03 fits the pose of view_07, and the other way round",
        ),
    ]);
}

#[test]
fn mirrored_axes_are_named() {
    fn places(views: &mut [View], signs: DVec3) {
        for view in views {
            let pose = &mut view.camera_from_world;
            let place = pose.rotation.transpose() * pose.translation;
            pose.translation = pose.rotation * (signs * place);
        }
    }
    fn world(views: &mut [View], signs: DVec3) {
        let axes = DMat3::from_diagonal(signs);
        for view in views {
            let pose = view.camera_from_world;
            view.camera_from_world = RigidTransform {
                rotation: axes * pose.rotation * axes,
                translation: axes * pose.translation,
            };
        }
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
            |v| {
                change(v, |c| {
                    (c.turn, c.change) = (flip_horizontal, flip_horizontal)
                })
            },
            "pictures mirrored left to right",
        ),
        (
            |v| change(v, |c| (c.turn, c.change) = (flip_vertical, flip_vertical)),
            "pictures upside down",
        ),
        (
            |v| places(v, DVec3::new(-1.0, 1.0, 1.0)),
            "the x of the cameras' places negated",
        ),
        (
            |v| places(v, DVec3::new(1.0, -1.0, 1.0)),
            "the y of the cameras' places negated",
        ),
        (|v| places(v, -DVec3::ONE), "the translations negated"),
    ]);
}

/// Of a seed whose neighbours share enough features in any order.
#[test]
fn pictures_of_other_poses_are_named_without_depth() {
    for seed in [0] {
        let options = SyntheticOptions {
            seed,
            width: 192,
            height: 144,
            views: 9,
            samples: 1,
            ..SyntheticOptions::default()
        };
        let mut right = SyntheticScene::new(options).unwrap().views().to_vec();
        change(&mut right, |content| content.depth = None);
        assert_eq!(found(&right), [""; 0], "{seed}");
        let order = [3_usize, 6, 1, 7, 0, 2, 8, 5, 4];
        for of in [
            &(|i: usize| order[i]) as &dyn Fn(usize) -> usize,
            &exchanged(2, 6),
        ] {
            let mut wrong = right.clone();
            picture_of(&mut wrong, of);
            change(&mut wrong, |content| content.depth = None);
            let said = found(&wrong);
            assert!(
                said.len() == 1 && said[0].contains("pictures and poses are not assigned rightly"),
                "{seed}: {said:?} {:?}",
                look(
                    &scene(wrong.clone(), Pairing::MultiView),
                    Units::default(),
                    THOROUGH
                )
                .note
            );
        }
    }
}

#[test]
fn proper_scenes_of_many_kinds_contradict_nothing() {
    for seed in 0..12 {
        let options = SyntheticOptions {
            width: 96,
            height: 96,
            ..SyntheticOptions::varied(seed)
        };
        let proper = SyntheticScene::new(options).unwrap();
        let mut scene = scene(proper.views().to_vec(), Pairing::MultiView);
        for effort in [QUICK, THOROUGH] {
            let said = look(&scene, Units::default(), effort).contradictions;
            assert_eq!(said, [""; 0], "{seed}");
        }
        change(&mut scene.views, |content| content.depth = None);
        let said = look(&scene, Units::default(), THOROUGH).contradictions;
        assert_eq!(said, [""; 0], "{seed}, without depth");
    }
}

#[test]
fn exchanged_principal_points_are_named_and_crops_are_not() {
    let right = views(0);
    let of = |cx: f64, cy: f64| {
        let mut views = right.clone();
        for view in &mut views {
            change(std::slice::from_mut(view), |content| content.depth = None);
            (view.intrinsics.cx, view.intrinsics.cy) = (cx, cy);
        }
        let all = super::plausible::cameras(&views);
        all.join("; ")
    };
    for (cx, cy) in [(48.0, 64.0), (46.9, 65.5)] {
        let said = of(cx, cy);
        assert!(said.contains("with cx and cy exchanged"), "{said}");
    }
    // The middle, and crops of the left, of the bottom and of a corner.
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

const FOCAL: f64 = 150.0;
const BASELINE_M: f64 = 0.1;

/// A rectified pair of the procedural world.
fn pair(seed: u64) -> Vec<View> {
    let options = SyntheticOptions {
        seed,
        width: 160,
        height: 120,
        views: 2,
        samples: 1,
        ..SyntheticOptions::default()
    };
    let scene = SyntheticScene::new(options).unwrap();
    let side = |(x, cx): (f64, f64)| {
        let lens = Lens::new((FOCAL, FOCAL), (cx, 60.5), (160, 120), Distortion::None).unwrap();
        let pose = RigidTransform {
            rotation: DMat3::IDENTITY,
            translation: DVec3::new(-x, 0.0, 0.0),
        };
        scene.view_through("side", lens, pose)
    };
    [(0.0, 79.5), (BASELINE_M, 82.0)].map(side).to_vec()
}

fn of_pair(views: Vec<View>) -> (String, Option<String>) {
    let stereo = Pairing::Stereo {
        source: 0,
        target: 1,
    };
    let look = look(&scene(views, stereo), Units::default(), THOROUGH);
    (look.contradictions.join("; "), look.note)
}

/// What a depth map becomes if its values are read as disparities, or its disparities are.
fn read_as_disparity(depth: &DepthMap) -> DepthMap {
    let mut depth = depth.clone();
    depth
        .iter_mut()
        .filter(|z| **z > 0.0)
        .for_each(|z| *z = (BASELINE_M * FOCAL) as f32 / (*z + 2.5));
    depth
}

#[test]
fn pairs_whose_disparity_is_something_else_are_named() {
    type Change = fn(&mut Changed);
    let cases: [(Change, &str); 3] = [
        (
            |c| c.change = read_as_disparity,
            "the disparity map holds depth, 1",
        ),
        (
            |c| c.change = flip_vertical,
            "the disparity map is upside down",
        ),
        (
            |c| c.change = flip_horizontal,
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

#[test]
fn pairs_without_disparity_are_judged_by_their_rows() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = crate::bundled::extract(folder.path()).unwrap();
    let at = |name: &str| dataset.join("Motorcycle-quarter").join(name);
    std::fs::remove_file(at("disp0.pfm")).unwrap();
    let text = format!("middlebury={}", dataset.display());
    let spec = crate::DatasetSpec::parse(&text).unwrap();
    let scene = || super::check(&spec, 2, &|_, _| {}).unwrap().scenes.remove(0);
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
        wrong.len() == 1 && wrong[0].contains("left and right are exchanged"),
        "{wrong:?}"
    );
    // A picture of one colour has no features.
    let mut blank = pair(0);
    change(&mut blank, |content| {
        (content.depth, content.turn) = (None, |picture: &RgbImage| {
            RgbImage::new(picture.width(), picture.height())
        });
    });
    let (said, note) = of_pair(blank);
    assert_eq!(said, "");
    assert!(note.unwrap().ends_with("nothing can be said"));
}

/// Values of a depth map, changed where there is depth.
fn each(depth: &DepthMap, change: impl Fn(f32) -> f32) -> DepthMap {
    let mut depth = depth.clone();
    let valid = depth.iter_mut().filter(|z| **z > 0.0);
    valid.for_each(|z| *z = change(*z));
    depth
}

#[test]
fn wrong_quaternions_cameras_and_depths_are_named() {
    fn w_last(pose: &mut RigidTransform) {
        let [x, y, z, w] = DQuat::from_mat3(&pose.rotation).to_array();
        // Stored as x, y, z, w, and read as w, x, y, z.
        pose.rotation = DMat3::from_quat(DQuat::from_xyzw(y, z, w, x));
    }
    fn normalised(depth: &DepthMap) -> DepthMap {
        let valid = || depth.iter().copied().filter(|z| *z > 0.0);
        let most = valid().fold(0.0, f32::max);
        let least = valid().fold(most, f32::min);
        each(depth, |z| (z - least) / (most - least))
    }
    named(&[
        (
            |v| v.iter_mut().for_each(|v| w_last(&mut v.camera_from_world)),
            "quaternions taken as x, y, z, w instead of w, x, y, z",
        ),
        (
            |v| v.iter_mut().for_each(|v| v.intrinsics.fy *= 1.1),
            "an fy 0.9 times as long fits",
        ),
        (
            |v| change(v, |c| c.change = |depth| each(depth, |z| z + 1.0)),
            "m less fits",
        ),
        (
            |v| change(v, |c| c.change = normalised),
            "every depth map runs from 0 to 1",
        ),
        (
            |v| change(v, |c| c.change = |depth| each(depth, |_| 2.0)),
            "the depth is the same in all pixels of each map, 2 m",
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
            |v| {
                change(&mut v[3..4], |c| {
                    c.change = |depth| each(depth, |z| 2.0 * z)
                })
            },
            "view_03: its depth times 0.5 fits",
        ),
        (
            |v| change(&mut v[3..4], |c| c.change = flip_vertical),
            "view_03: its depth map is upside down",
        ),
        (
            |v| change(&mut v[3..4], |c| c.turn = flip_horizontal),
            "view_03: its picture is mirrored left to right",
        ),
        (
            |v| change(&mut v[6..7], |c| c.turn = rotate180),
            "view_06: its picture is turned by 180 degrees",
        ),
    ]);
    let mut black = views(0);
    change(&mut black[3..4], |c| {
        c.turn = |p| RgbImage::new(p.width(), p.height())
    });
    let said = look(&scene(black, Pairing::MultiView), Units::default(), QUICK);
    assert_eq!(
        said.contradictions,
        ["view_03: the picture is of one colour"]
    );
}

/// A camera whose principal point is off the middle is proper, and is named with cx and cy exchanged.
#[test]
fn exchanged_principal_points_off_the_middle_are_named() {
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
    let is_named = said.iter().any(|one| one.contains("cx and cy exchanged"));
    assert!(is_named, "{said:?}");
}

#[test]
fn pairs_that_are_not_rectified_or_far_too_wide_are_named() {
    let lowered = |by: u32| {
        let mut views = pair(0);
        change(&mut views[1..], |c| {
            c.turn = match by {
                0 => RgbImage::clone,
                _ => |picture: &RgbImage| {
                    let (w, h) = picture.dimensions();
                    RgbImage::from_fn(w, h, |x, y| *picture.get_pixel(x, y.saturating_sub(3)))
                },
            }
        });
        of_pair(views).0
    };
    assert_eq!(lowered(0), "");
    assert!(
        lowered(3).contains("rows lie about 3 pixels below"),
        "{}",
        lowered(3)
    );
    let mut wide = pair(0);
    change(&mut wide, |content| content.depth = None);
    assert_eq!(of_pair(wide.clone()).0, "");
    wide[1].camera_from_world.translation *= 2000.0;
    let (said, _) = of_pair(wide);
    assert!(said.contains("the baseline is 200 m"), "{said}");
}

/// Seen through a lens that magnifies the middle more than the border, by a camera that says nothing of it.
fn distorted(views: &mut [View]) {
    const BY: f64 = 0.25;
    fn from((w, h): (u32, u32), x: u32, y: u32) -> (u32, u32) {
        let half = DVec2::new(f64::from(w), f64::from(h)) / 2.0;
        let out = (DVec2::new(f64::from(x), f64::from(y)) + 0.5 - half) / half.x;
        let whole = 1.0 + BY * (1.0 + (half.y / half.x).powi(2));
        let from = half + out * (1.0 + BY * out.length_squared()) / whole * half.x;
        ((from.x as u32).min(w - 1), (from.y as u32).min(h - 1))
    }
    change(views, |c| {
        c.turn = |picture| {
            let size = picture.dimensions();
            RgbImage::from_fn(size.0, size.1, |x, y| {
                let (x, y) = from(size, x, y);
                *picture.get_pixel(x, y)
            })
        };
        c.change = |depth| {
            let size = depth.dimensions();
            DepthMap::from_fn(size.0, size.1, |x, y| {
                let (x, y) = from(size, x, y);
                *depth.get_pixel(x, y)
            })
        };
    });
    for view in views {
        let whole = 1.0 + BY * (1.0 + 0.75_f64.powi(2));
        view.intrinsics.fx *= whole;
        view.intrinsics.fy *= whole;
    }
}

#[test]
fn lens_distortion_that_was_left_in_is_named() {
    let mut wrong = views(0);
    distorted(&mut wrong);
    let said = found(&wrong);
    assert!(
        said.len() == 1 && said[0].contains("lens distortion was left in"),
        "{said:?}"
    );
}
