//! Unusual but valid scenes, which must not be reported.

use glam::{DMat3, DVec2, DVec3};
use image::{Luma, Rgb, RgbImage};
use sharp::camera::{Intrinsics, RigidTransform};
use std::sync::Arc;

use super::{Pixels, change, found, is_tried, views_of, worlds};
use crate::check::{QUICK, THOROUGH};
use crate::synthetic::SyntheticOptions;
use crate::{DepthMap, View};

/// Fails if the check finds anything.
fn is_proper(what: &str, views: &[View]) {
    for effort in [QUICK, THOROUGH] {
        assert_eq!(found(views, effort), [""; 0], "{what}");
    }
}

/// Axis and coordinate of each wall of a room.
const WALLS: [(usize, f64); 5] = [(1, 1.2), (1, -1.8), (0, -3.0), (0, 3.0), (2, 6.0)];
/// Centre and radius of each object in the room.
const BALLS: [([f64; 3], f64); 5] = [
    ([-1.2, 0.3, 2.0], 0.4),
    ([0.9, 0.5, 2.6], 0.35),
    ([0.1, -0.6, 3.4], 0.5),
    ([-0.4, 0.7, 4.2], 0.3),
    ([1.6, -0.3, 4.0], 0.45),
];

/// Depth along a ray with z = 1, and the index of the surface that it hits.
fn seen(at: DVec3, ray: DVec3) -> (f64, usize) {
    let walls = WALLS
        .iter()
        .map(|(axis, place)| (place - at[*axis]) / ray[*axis]);
    let balls = BALLS.iter().map(|(middle, radius)| {
        let from = at - DVec3::from(*middle);
        let (a, b, c) = (
            ray.length_squared(),
            ray.dot(from),
            from.length_squared() - radius * radius,
        );
        (-b - (b * b - a * c).sqrt()) / a
    });
    let all = walls.chain(balls).zip(0..).filter(|(z, _)| *z > 0.05);
    all.min_by(|a, b| a.0.total_cmp(&b.0)).unwrap()
}

/// Six views, `step` apart, of a room whose surfaces have one colour each; the focal length is
/// `widths` picture widths.
fn room((w, h): (u32, u32), widths: f64, step: DVec3) -> Vec<View> {
    let focal = widths * f64::from(w);
    let centre = (f64::from(w) / 2.0, f64::from(h) / 2.0);
    let intrinsics = Intrinsics::new((focal, focal), centre, (w, h)).unwrap();
    let view = |i: u32| {
        let at = step * f64::from(i);
        let seen = |x: u32, y: u32| {
            let place = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
            seen(at, intrinsics.unproject(place, 1.0))
        };
        let colour =
            |i: usize| [40 + 67 * i, 90 + 41 * i, 150 + 97 * i].map(|v| (v % 200 + 30) as u8);
        View {
            id: format!("v{i}"),
            intrinsics,
            camera_from_world: RigidTransform {
                rotation: DMat3::IDENTITY,
                translation: -at,
            },
            content: Arc::new(Pixels {
                picture: RgbImage::from_fn(w, h, |x, y| Rgb(colour(seen(x, y).1))),
                depth: Some(DepthMap::from_fn(w, h, |x, y| Luma([seen(x, y).0 as f32]))),
                valid: None,
            }),
        }
    };
    (0..6).map(view).collect()
}

/// With flat colours and coarse pixels, no motion at all seems to fit best.
#[test]
fn flat_colours_wide_angles_and_small_steps_are_proper() {
    for (world, size) in [(0, (96, 72)), (1, (128, 96))] {
        for (i, widths) in [0.2, 0.4].into_iter().enumerate() {
            for (j, step) in [
                DVec3::X,
                DVec3::Z,
                DVec3::new(0.7, 0.0, 0.7),
                DVec3::Z / 3.0,
            ]
            .into_iter()
            .enumerate()
            {
                if !is_tried(i + j, world) {
                    continue;
                }
                let views = room(size, widths, 0.03 * step);
                is_proper(&format!("{size:?} {widths} {step}"), &views);
            }
        }
    }
}

#[test]
fn tiny_pictures_are_proper() {
    for seed in worlds(0..3, 1) {
        for (width, height) in [(24, 18), (32, 24), (32, 32)] {
            for views in [2, 4, 9] {
                let classic = SyntheticOptions {
                    seed,
                    ..SyntheticOptions::default()
                };
                for options in [classic, SyntheticOptions::varied(seed)] {
                    let mut views = views_of(SyntheticOptions {
                        width,
                        height,
                        views,
                        ..options
                    });
                    is_proper(&format!("{seed} {width}x{height} {options:?}"), &views);
                    change(&mut views, |pixels| pixels.depth = None);
                    is_proper(&format!("{seed} {width}x{height}, without depth"), &views);
                }
            }
        }
    }
}

/// Views of a painted wall at z = 2 m, parallel to the picture plane, so that its depth is the same
/// everywhere.
fn wall(step: DVec3) -> Vec<View> {
    let (w, h) = (96, 72);
    let intrinsics = Intrinsics::new((80.0, 80.0), (48.0, 36.0), (w, h)).unwrap();
    let painted = |x: f64, y: f64| {
        let wave = |u: f64, v: f64| 127.0 + 60.0 * (u * 9.0).sin() + 60.0 * (v * 7.0 + u).cos();
        Rgb([wave(x, y), wave(y, x), wave(x + y, x - y)].map(|v| v as u8))
    };
    let view = |i: u32| {
        let at = step * f64::from(i);
        let depth = 2.0 - at.z;
        let place = |pixel: u32, centre: f64| (f64::from(pixel) + 0.5 - centre) / 80.0 * depth;
        View {
            id: format!("v{i}"),
            intrinsics,
            camera_from_world: RigidTransform {
                rotation: DMat3::IDENTITY,
                translation: -at,
            },
            content: Arc::new(Pixels {
                picture: RgbImage::from_fn(w, h, |x, y| {
                    painted(place(x, 48.0) + at.x, place(y, 36.0) + at.y)
                }),
                depth: Some(DepthMap::from_pixel(w, h, Luma([depth as f32]))),
                valid: None,
            }),
        }
    };
    (0..6).map(view).collect()
}

#[test]
fn a_wall_parallel_to_the_pictures_is_proper_and_depth_that_its_poses_contradict_is_not() {
    for step in [DVec3::X * 0.2, DVec3::new(0.1, 0.05, 0.1)] {
        let mut views = wall(step);
        is_proper("wall", &views);
        change(&mut views, |pixels| pixels.each(|_| 2.0));
        let said = found(&views, QUICK);
        let is_contradicted = step.z != 0.0;
        assert_eq!(said.len(), usize::from(is_contradicted), "{said:?}");
        for said in said {
            assert!(
                said.contains("the depth map of each view contains a single value, 2 m"),
                "{said}"
            );
        }
    }
}

/// Without depth, features of equal tiles may be matched to those of other tiles.
#[test]
fn equal_tiles_on_all_surfaces_are_proper_without_depth() {
    for (step, per_metre) in [
        (DVec3::new(0.12, 0.03, 0.05), 4.0),
        (DVec3::new(0.2, 0.0, 0.0), 4.0),
        (DVec3::new(0.1, 0.05, 0.2), 3.0),
        (DVec3::new(0.3, 0.1, 0.0), 2.0),
    ] {
        let mut views = room((200, 150), 0.95, step);
        for view in &mut views {
            let (k, place) = (view.intrinsics, -view.camera_from_world.translation);
            let tile = |x: u32, y: u32| {
                let ray = k.unproject(DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5), 1.0);
                let (z, surface) = seen(place, ray);
                let axis = WALLS.get(surface).map_or(2, |(axis, _)| *axis);
                let at = (place + z * ray).to_array();
                let [u, v] = [(axis + 1) % 3, (axis + 2) % 3].map(|i| at[i] * per_metre);
                let (u, v) = (u.rem_euclid(1.0), v.rem_euclid(1.0));
                match (u < 0.08 || v < 0.08, (u - 0.5).hypot(v - 0.5) < 0.25) {
                    (true, _) => Rgb([230; 3]),
                    (_, true) => Rgb([90, 70, 50]),
                    _ => Rgb([150, 120, 90]),
                }
            };
            let picture = RgbImage::from_fn(k.width, k.height, tile);
            change(std::slice::from_mut(view), |pixels| {
                pixels.picture = picture.clone();
                pixels.depth = None;
            });
        }
        is_proper(&format!("{step} {per_metre}"), &views);
    }
}
