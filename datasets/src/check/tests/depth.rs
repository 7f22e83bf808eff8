//! Depth of another camera, of a z-buffer or beyond 16 bits, slight lens distortion and rounded poses.

use glam::{DVec2, DVec3};
use image::{Luma, Rgb, RgbImage};
use sharp::camera::Intrinsics;

use super::{change, found, is_tried, views, views_of, worlds};
use crate::check::{Effort, QUICK, THOROUGH, check};
use crate::format::{FloatMap, depth_png};
use crate::synthetic::SyntheticOptions;
use crate::{DatasetSpec, DepthMap, View};

const SIZE: (u32, u32) = (192, 144);

fn varied(seed: u64) -> Vec<View> {
    let (width, height) = SIZE;
    let options = SyntheticOptions::varied(seed);
    views_of(SyntheticOptions {
        width,
        height,
        views: 9,
        ..options
    })
}

fn classic_and_varied() -> [Vec<View>; 2] {
    [views(0, SIZE), varied(2)]
}

/// Fails unless the check reports `cause` and nothing else.
fn is_named(what: &str, views: &[View], effort: Effort, cause: &str) {
    let said = found(views, effort);
    let is_named = said.len() == 1 && said[0].contains(cause);
    assert!(is_named, "{what} {effort:?} {cause}: {said:?}");
}

/// Depth as seen by another camera: its picture is enlarged by `zoom` about the centre and then
/// moved by `off` widths.
fn of_other_camera(views: &mut [View], zoom: f64, off: DVec2) {
    change(views, |c| {
        c.change(|depth| {
            let (w, h) = depth.dimensions();
            let half = DVec2::new(f64::from(w), f64::from(h)) / 2.0;
            DepthMap::from_fn(w, h, |x, y| {
                let place = DVec2::new(f64::from(x), f64::from(y)) + 0.5;
                let from = (place - half - off * f64::from(w)) / zoom + half;
                let is_inside = from.min_element() >= 0.0 && from.cmplt(2.0 * half).all();
                if is_inside {
                    *depth.get_pixel(from.x as u32, from.y as u32)
                } else {
                    Luma([0.0])
                }
            })
        });
    });
}

#[test]
fn depth_of_another_camera_is_named() {
    let cases = [
        (
            1.0,
            DVec2::new(10.0, 0.0),
            "they fit if shifted by about (-",
        ),
        (
            1.0,
            DVec2::new(-24.0, 16.0),
            "they fit if shifted by about (",
        ),
        (1.2, DVec2::ZERO, "they fit if reduced to 0.8"),
        (0.75, DVec2::ZERO, "they fit if enlarged 1.3"),
    ];
    let (mut tried, mut named) = (0, 0);
    for (world, right) in (0..).zip(&classic_and_varied()) {
        for (i, (zoom, off, cause)) in cases.into_iter().enumerate() {
            if !is_tried(i, world) {
                continue;
            }
            let mut wrong = right.clone();
            of_other_camera(&mut wrong, zoom, off / 640.0);
            is_named("other camera", &wrong, THOROUGH, cause);
            // With few samples, the check may find nothing, but must not report another cause.
            let quick = found(&wrong, QUICK);
            assert!(
                quick.iter().all(|said| said.contains("not aligned")),
                "{quick:?}"
            );
            tried += 1;
            named += quick.len();
        }
    }
    assert!(named > tried / 2, "{named} of {tried}");
}

#[test]
fn z_buffers_are_named_and_not_called_a_scale() {
    for (world, right) in (0..).zip(&classic_and_varied()) {
        let buffers = [(0.1, 100.0, 1.0), (0.05, 50.0, 10.0), (0.5, 1000.0, 65.535)];
        for (i, (near, far, unit)) in buffers.into_iter().enumerate() {
            if !is_tried(i, world) {
                continue;
            }
            let mut wrong = right.clone();
            change(&mut wrong, |c| {
                c.each(|z| (unit * far / (far - near) * (1.0 - near / f64::from(z))) as f32);
            });
            for effort in [QUICK, THOROUGH] {
                is_named("z-buffer", &wrong, effort, "is that of a z-buffer");
            }
        }
    }
}

#[test]
fn normalised_reciprocals_of_depth_are_named() {
    for (world, right) in (0..).zip(&classic_and_varied()) {
        let depths = right
            .iter()
            .filter_map(|view| view.content.depth().unwrap());
        let depths = depths.flat_map(|depth| depth.into_raw());
        let known: Vec<f64> = depths.filter(|z| *z > 0.0).map(f64::from).collect();
        let [near, far] = [f64::min, f64::max].map(|of| known.iter().copied().reduce(of).unwrap());
        let (near, far) = (0.8 * near, 1.5 * far);
        for (i, unit) in [1.0, 255.0, 65.535].into_iter().enumerate() {
            if !is_tried(i, world) {
                continue;
            }
            let mut wrong = right.clone();
            change(&mut wrong, |c| {
                c.each(|z| (unit * (far / f64::from(z) - 1.0) / (far / near - 1.0)) as f32);
            });
            for effort in [QUICK, THOROUGH] {
                is_named(
                    "inverse",
                    &wrong,
                    effort,
                    "the reciprocal of depth, normalised",
                );
            }
        }
    }
}

/// Views through a lens that shows radius r at r (1 + k1 r²), with cameras that state no
/// distortion.
fn distorted(views: &mut [View], k1: f64) {
    fn from(k: &Intrinsics, k1: f64, x: u32, y: u32) -> DVec2 {
        let focal = DVec2::new(k.fx, k.fy);
        let centre = DVec2::new(k.cx, k.cy);
        let seen = (DVec2::new(f64::from(x), f64::from(y)) + 0.5 - centre) / focal;
        let mut straight = seen;
        for _ in 0..20 {
            straight = seen / (1.0 + k1 * straight.length_squared());
        }
        straight * focal + centre
    }
    for view in views {
        let k = view.intrinsics;
        let last = DVec2::new(f64::from(k.width), f64::from(k.height)) - 1.0;
        change(std::slice::from_mut(view), |c| {
            c.turn(|picture| {
                RgbImage::from_fn(k.width, k.height, |x, y| {
                    let at = (from(&k, k1, x, y) - 0.5).clamp(DVec2::ZERO, last);
                    let (first, part) = (at.floor(), at.fract());
                    let level = |by: DVec2, channel: usize| {
                        let at = (first + by).min(last);
                        f64::from(picture.get_pixel(at.x as u32, at.y as u32).0[channel])
                    };
                    Rgb(std::array::from_fn(|i| {
                        let row = |y: f64| {
                            let [left, right] = [0.0, 1.0].map(|x| level(DVec2::new(x, y), i));
                            left + (right - left) * part.x
                        };
                        (row(0.0) + (row(1.0) - row(0.0)) * part.y).round() as u8
                    }))
                })
            });
            c.change(|depth| {
                DepthMap::from_fn(k.width, k.height, |x, y| {
                    let at = from(&k, k1, x, y).clamp(DVec2::ZERO, last);
                    *depth.get_pixel(at.x as u32, at.y as u32)
                })
            });
        });
    }
}

#[test]
fn lens_distortion_of_a_few_pixels_is_named() {
    for world in [0, 1] {
        let cases = [(-0.2, "a k1 of about -0."), (0.2, "a k1 of about 0.")];
        for (i, (k1, cause)) in cases.into_iter().enumerate() {
            if !is_tried(i, world) {
                continue;
            }
            let mut wrong = views(2 * world, (256, 192));
            distorted(&mut wrong, k1);
            is_named("lens", &wrong, THOROUGH, cause);
        }
    }
}

/// Poses with few decimals may be reported as rounded or not at all, but not as another error.
#[test]
fn rounded_poses_are_not_called_another_error() {
    let mut named = 0;
    let worlds = classic_and_varied().into_iter().chain([varied(1)]);
    let worlds: Vec<Vec<View>> = worlds.collect();
    for (i, digits) in [10.0, 100.0].into_iter().enumerate() {
        for (world, right) in (0..).zip(&worlds) {
            if !is_tried(i, world % 2) {
                continue;
            }
            let mut wrong = right.clone();
            for view in &mut wrong {
                let place = &mut view.camera_from_world.translation;
                *place = DVec3::from_array(place.to_array().map(|v| (v * digits).round() / digits));
            }
            for effort in [QUICK, THOROUGH] {
                let said = found(&wrong, effort);
                let is_told = |said: &String| said.contains("may have been rounded");
                assert!(said.iter().all(is_told), "{digits} {effort:?}: {said:?}");
                named += said.len();
            }
        }
    }
    assert!(named >= 2, "{named}");
}

#[test]
fn depth_beyond_16_bits_is_named_with_its_file() {
    let folder = tempfile::tempdir().unwrap();
    let views = &varied(1)[..4];
    // 16 bits hold depths up to 120 m, then up to 15 m.
    for (unit, is_over) in [(15.0 / 65535.0 * 8.0, false), (15.0 / 65535.0, true)] {
        let frames: Vec<String> = views
            .iter()
            .map(|view| {
                let picture = format!("{}.png", view.id);
                let map = format!("{}_depth.png", view.id);
                view.content.image().unwrap().save(folder.path().join(&picture)).unwrap();
                let depth = view.content.depth().unwrap().unwrap();
                let number = |z: f32| (f64::from(z) / unit).round() % 65536.0;
                let stored = depth.iter().map(|z| number(*z) as f32).collect();
                let stored = FloatMap::from_vec(depth.width(), depth.height(), stored).unwrap();
                depth_png::write(&folder.path().join(&map), &stored).unwrap();
                let pose = view.camera_from_world.inverse();
                let (r, t) = (pose.rotation, pose.translation);
                let rows = [0, 1, 2].map(|i| {
                    // Convert to OpenGL's camera axes, which the file has.
                    let [x, y, z] = [r.x_axis[i], -r.y_axis[i], -r.z_axis[i]];
                    format!("[{x}, {y}, {z}, {}]", t[i])
                });
                let rows = rows.join(", ");
                format!(
                    r#"{{"file_path": "{picture}", "depth_file_path": "{map}", "transform_matrix": [{rows}, [0, 0, 0, 1]]}}"#
                )
            })
            .collect();
        let k = views[0].intrinsics;
        let text = format!(
            r#"{{"fl_x": {}, "fl_y": {}, "cx": {}, "cy": {}, "w": {}, "h": {}, "frames": [{}]}}"#,
            k.fx,
            k.fy,
            k.cx,
            k.cy,
            k.width,
            k.height,
            frames.join(", ")
        );
        std::fs::write(folder.path().join("transforms.json"), text).unwrap();
        let spec = format!("nerfstudio={},depth-unit={unit}", folder.path().display());
        let spec = DatasetSpec::parse(&spec).unwrap();
        let report = check(&spec, 4, &|_, _| {}).unwrap();
        let said = &report.scenes[0].problems;
        let is_right = |said: &String| {
            said.contains("_depth.png: the depth overflowed 16 bits (")
                && said.ends_with("store it in a coarser unit or as float")
        };
        assert_eq!(said.len(), usize::from(is_over), "{said:?}");
        assert!(said.iter().all(is_right), "{said:?}");
    }
}

/// Fences and trees before a far background, corridors, streets and rooms.
#[test]
fn steep_edges_indoors_and_outdoors_are_proper() {
    for seed in worlds(16..28, 4) {
        let mut views = varied(seed);
        for effort in [QUICK, THOROUGH] {
            assert_eq!(found(&views, effort), [""; 0], "{seed} {effort:?}");
        }
        // Add noise, as of a depth sensor.
        change(&mut views, |c| {
            c.each(|z| {
                let noise = (z.to_bits().wrapping_mul(2_654_435_761) >> 8) as f32 / 16_777_216.0;
                z * (1.0 + 0.02 * (noise - 0.5))
            });
        });
        assert_eq!(found(&views, QUICK), [""; 0], "{seed}, noisy");
    }
}
