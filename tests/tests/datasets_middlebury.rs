//! Middlebury's Motorcycle in both of its layouts. The right picture, warped by the left view's
//! depth and the two cameras, must match the published left picture as well as if it is warped by
//! the disparity itself. This reveals a wrong sign, unit, row order or principal point.

#![allow(clippy::unwrap_used, reason = "test code outside of #[test] functions")]

use std::path::{Path, PathBuf};

use glam::DVec2;
use image::{GrayImage, RgbImage};
use sharp_datasets::{DatasetSpec, Pairing, Scene, View, bundled, open};

fn repository() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("..")
}

fn bundled_scene() -> Scene {
    read(&repository().join("datasets/bundled/middlebury"))
}

fn middeval3_scene() -> Scene {
    read(&repository().join("tests/fixtures/middeval3"))
}

fn read(folder: &Path) -> Scene {
    let spec = DatasetSpec::parse(&format!("middlebury={}", folder.display())).unwrap();
    let mut scenes = open(&spec).unwrap();
    assert_eq!(scenes.len(), 1);
    scenes.remove(0)
}

/// Treatment of pixels that are projected outside the other picture.
#[derive(Clone, Copy, PartialEq)]
enum Outside {
    LeftOut,
    Black,
}

/// Squared error and pixel count of the source warped into the target, for pixels that satisfy
/// `keep`.
fn warp_error(
    source: &View,
    target: &View,
    outside: Outside,
    keep: impl Fn(u32, u32) -> bool,
) -> (f64, u64) {
    let reference = source.content.image().unwrap();
    let other = target.content.image().unwrap();
    let depth = source.content.depth().unwrap().unwrap();
    let target_from_source = target
        .camera_from_world
        .after(&source.camera_from_world.inverse());
    let (mut sum, mut count) = (0.0, 0);
    for (x, y, z) in depth.enumerate_pixels() {
        if z.0[0] <= 0.0 || !keep(x, y) {
            continue;
        }
        let center = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
        let point = source.intrinsics.unproject(center, f64::from(z.0[0]));
        let p = target
            .intrinsics
            .project(target_from_source.apply(point))
            .unwrap();
        if let Some(color) = bilinear(&other, p - 0.5, outside) {
            for c in 0..3 {
                let difference = color[c] - f64::from(reference.get_pixel(x, y).0[c]);
                sum += difference * difference;
            }
            count += 1;
        }
    }
    (sum, count)
}

/// Colour at integer-centred coordinates, blended with black beyond the centres of the border
/// pixels.
fn bilinear(image: &RgbImage, p: DVec2, outside: Outside) -> Option<[f64; 3]> {
    // In a rectified pair, rows agree up to rounding; do not lose the first and last row because of
    // 1e-13 px.
    let p = DVec2::new(
        p.x,
        if (p.y - p.y.round()).abs() < 1e-6 {
            p.y.round()
        } else {
            p.y
        },
    );
    let (w, h) = (i64::from(image.width()), i64::from(image.height()));
    let inside = (0.0..=(w - 1) as f64).contains(&p.x) && (0.0..=(h - 1) as f64).contains(&p.y);
    if outside == Outside::LeftOut && !inside {
        return None;
    }
    let (floor, blend) = (p.floor(), p - p.floor());
    let (x, y) = (floor.x as i64, floor.y as i64);
    Some(std::array::from_fn(|c| {
        let at = |x: i64, y: i64| {
            if (0..w).contains(&x) && (0..h).contains(&y) {
                f64::from(image.get_pixel(x as u32, y as u32).0[c])
            } else {
                0.0
            }
        };
        (at(x, y) * (1.0 - blend.x) + at(x + 1, y) * blend.x) * (1.0 - blend.y)
            + (at(x, y + 1) * (1.0 - blend.x) + at(x + 1, y + 1) * blend.x) * blend.y
    }))
}

fn psnr((sum, count): (f64, u64)) -> f64 {
    10.0 * (255.0 * 255.0 * 3.0 * count as f64 / sum).log10()
}

fn not_occluded() -> GrayImage {
    let path = repository().join("tests/fixtures/middeval3/trainingQ/Motorcycle/mask0nocc.png");
    image::open(path).unwrap().into_luma8()
}

fn check_warp(scene: &Scene) {
    let (left, right) = (&scene.views[0], &scene.views[1]);
    let all = warp_error(left, right, Outside::LeftOut, |_, _| true);
    assert_eq!(all.1, 332_144);
    assert!((psnr(all) - 22.42).abs() < 0.005, "{}", psnr(all));
    let mask = not_occluded();
    // 201 of them are projected up to a pixel to the left of the first pixel's centre.
    let visible = warp_error(left, right, Outside::Black, |x, y| {
        mask.get_pixel(x, y).0[0] == 255
    });
    assert_eq!(visible.1, 312_975);
    assert!((psnr(visible) - 27.52).abs() < 0.005, "{}", psnr(visible));
}

#[test]
fn scenes2014_layout_warps_as_published() {
    check_warp(&bundled_scene());
}

#[test]
fn middeval3_layout_warps_as_published() {
    check_warp(&middeval3_scene());
}

/// The same pixels in Booster's layout. Its right view has its own disparity map, which was made by
/// warping the left one, so it has holes where the left view sees nothing.
#[test]
fn booster_layout_warps_in_both_directions() {
    let folder = repository().join("tests/fixtures/booster");
    let spec = DatasetSpec::parse(&format!("booster={}", folder.display())).unwrap();
    let scenes = open(&spec).unwrap();
    let (left, right) = (&scenes[0].views[0], &scenes[0].views[1]);
    let there = psnr(warp_error(left, right, Outside::LeftOut, |_, _| true));
    assert!((there - 22.42).abs() < 0.005, "{there}");
    let back = psnr(warp_error(right, left, Outside::LeftOut, |_, _| true));
    assert!((back - 27.59).abs() < 0.005, "{back}");
}

#[test]
fn cameras_and_depth_are_metric() {
    let scene = bundled_scene();
    assert_eq!(scene.id, "Motorcycle-quarter");
    assert_eq!(
        scene.pairing,
        Pairing::Stereo {
            source: 0,
            target: 1
        }
    );
    let (left, right) = (&scene.views[0], &scene.views[1]);
    assert_eq!((left.id.as_str(), right.id.as_str()), ("im0", "im1"));
    assert_eq!(left.camera_from_world.camera_center().x, 0.0);
    assert!((right.camera_from_world.camera_center().x - 0.193_001).abs() < 1e-15);
    assert_eq!(left.intrinsics.cx, 311.193 + 0.5);
    assert_eq!(right.intrinsics.cx, 342.278_75 + 0.5);
    let depth = left.content.depth().unwrap().unwrap();
    let valid: Vec<f32> = depth.iter().copied().filter(|z| *z > 0.0).collect();
    assert_eq!(valid.len(), 343_274);
    let nearest = valid.iter().copied().fold(f32::MAX, f32::min);
    let farthest = valid.iter().copied().fold(0.0, f32::max);
    assert!((nearest - 2.11).abs() < 0.01, "{nearest}");
    assert!((farthest - 5.02).abs() < 0.01, "{farthest}");
    assert!(right.content.depth().unwrap().is_none());
    assert_eq!(left.content.files().len(), 3);
}

#[test]
fn absent_ground_truth_is_no_error_and_an_empty_folder_is() {
    let folder = tempfile::tempdir().unwrap();
    let spec = DatasetSpec::parse(&format!("middlebury={}", folder.path().display())).unwrap();
    let error = open(&spec).unwrap_err().to_string();
    assert!(error.contains("no middlebury scene found"), "{error}");
    let scene_folder = bundled::extract(folder.path())
        .unwrap()
        .join("Motorcycle-quarter");
    std::fs::remove_file(scene_folder.join("disp0.pfm")).unwrap();
    let scene = read(folder.path());
    assert!(scene.views[0].content.depth().unwrap().is_none());
    assert!(scene.notes[0].contains("no depth"), "{:?}", scene.notes);
}
