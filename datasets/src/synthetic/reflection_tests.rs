//! Compares what mirrors and panes show with worlds without them.

use std::sync::Arc;

use glam::{DMat3, DVec3};
use image::RgbImage;
use sharp::camera::RigidTransform;
use sharp::random::SplitMix64;

use super::content::ProceduralContent;
use super::finish::Finish;
use super::light::{Lamp, Light};
use super::paint::{Paint, Tone};
use super::shapes::{SurfaceShape, turned};
use super::world::{Object, Surface, World};
use crate::ViewContent;
use crate::lens::{Distortion, Lens};

const SIDE: u32 = 64;

/// Axes of the mirror: its plane goes through the origin, and its third axis points away from the cameras.
fn axes() -> DMat3 {
    turned(0.1, -0.25, 0.05, 1.0)
}

/// Reflection in the mirror's plane.
fn reflection() -> DMat3 {
    let n = axes().z_axis;
    DMat3::IDENTITY - DMat3::from_cols(n * n.x, n * n.y, n * n.z) * 2.0
}

fn camera() -> RigidTransform {
    let turn = turned(0.02, -0.05, 0.01, 1.0);
    RigidTransform {
        rotation: turn,
        translation: turn * DVec3::new(0.2, 0.1, 2.0),
    }
}

/// Boxes, poles and walls behind the camera, in front of the mirror.
fn shapes() -> Vec<SurfaceShape> {
    let mut shapes = vec![
        SurfaceShape::Rectangle {
            center: DVec3::new(0.0, 0.0, -9.0),
            axes: turned(0.0, 0.1, 0.0, 1.0),
            half: (40.0, 40.0),
        },
        SurfaceShape::Rectangle {
            center: DVec3::new(0.0, 1.5, -12.0),
            axes: DMat3::from_cols(DVec3::X, DVec3::Z, DVec3::NEG_Y),
            half: (30.0, 9.0),
        },
    ];
    for i in 0..7 {
        let x = f64::from(i) - 3.0;
        shapes.push(SurfaceShape::Box {
            center: DVec3::new(1.2 * x, 0.4 * (x * 1.7).sin(), -5.0 - 0.2 * x),
            axes: turned(0.1 * x, 0.3, 0.2, 1.0),
            half: DVec3::new(0.3, 0.5, 0.25),
        });
        shapes.push(SurfaceShape::Cylinder {
            center: DVec3::new(1.1 * x + 0.4, 0.0, -4.0),
            axes: turned(0.0, 0.0, 0.05 * x, 1.0),
            radius: 0.06,
            half: 1.4,
        });
    }
    shapes
}

/// The shapes moved by `by`, with the light moved in the same way.
fn world(by: DMat3, finish: Option<Finish>) -> World {
    let mut random = SplitMix64::new(5);
    let mut light = Light::outdoors(&mut random);
    light.sun = DVec3::new(0.9, 0.8, 0.7);
    light.haze_m = 30.0;
    light.to_sun = by * DVec3::new(0.3, -1.0, 0.5).normalize();
    light.dome = by * light.dome;
    light.lamps = vec![Lamp {
        place: by * DVec3::new(0.5, -1.0, -3.0),
        power: DVec3::new(2.0, 1.5, 1.0),
    }];
    let mut objects: Vec<Object> = shapes()
        .into_iter()
        .map(|shape| {
            let paint = Paint::new(&mut random, Tone::Any, 0.3);
            Object::new(shape.turned_by(&by), Surface::Varied(paint), true)
        })
        .collect();
    objects.extend(finish.map(|finish| {
        let pane = SurfaceShape::Rectangle {
            center: DVec3::ZERO,
            axes: axes(),
            half: (30.0, 30.0),
        };
        Object::new(pane, Surface::Layered(finish), false)
    }));
    World::of(objects, light)
}

fn view(world: World) -> ProceduralContent {
    let middle = 0.5 * f64::from(SIDE);
    let lens = Lens::new(
        (60.0, 60.0),
        (middle, middle),
        (SIDE, SIDE),
        Distortion::None,
    );
    ProceduralContent::new(Arc::new(world), lens.unwrap(), camera(), 1)
}

fn levels(picture: &RgbImage) -> usize {
    let mut levels = picture.as_raw().clone();
    levels.sort_unstable();
    levels.dedup();
    levels.len()
}

/// A perfect mirror shows what a window onto the reflected world would show. Its depth is that of
/// the mirror itself.
#[test]
fn a_mirror_shows_the_reflected_world() {
    let mirror = Finish::Mirror {
        reflectance: DVec3::ONE,
    };
    let mirrored = view(world(DMat3::IDENTITY, Some(mirror)));
    let behind = view(world(reflection(), None));
    let pictures = [&mirrored, &behind].map(|content| content.image().unwrap());
    let [surface, seen] = [&mirrored, &behind].map(|content| content.depth().unwrap().unwrap());
    assert!(levels(&pictures[0]) > 100);
    let mut compared = 0;
    for (x, y, pixel) in pictures[0].enumerate_pixels() {
        // Pixels that reflect the sky are not compared.
        if seen.get_pixel(x, y).0[0] == 0.0 {
            continue;
        }
        compared += 1;
        let other = pictures[1].get_pixel(x, y);
        for (a, b) in pixel.0.into_iter().zip(other.0) {
            assert!(a.abs_diff(b) <= 1, "({x}, {y}): {pixel:?} {other:?}");
        }
    }
    assert!(compared > SIDE * SIDE / 2, "{compared}");
    let (eye, normal) = (camera().camera_center(), axes().z_axis);
    for (x, y, depth) in surface.enumerate_pixels() {
        let at = |t: u32| (f64::from(t) + 0.5 - 0.5 * f64::from(SIDE)) / 60.0;
        let direction = camera().inverse().rotation * DVec3::new(at(x), at(y), 1.0);
        let plane = -normal.dot(eye) / normal.dot(direction);
        assert!((f64::from(depth.0[0]) - plane).abs() < 1e-5, "({x}, {y})");
        let behind = seen.get_pixel(x, y).0[0];
        assert!(behind == 0.0 || depth.0[0] < behind);
    }
}

/// Light along one ray; `direction` is a unit vector.
fn along(world: &World, origin: DVec3, direction: DVec3) -> DVec3 {
    let all = world.candidates(origin, direction, None);
    world.radiance(&world.sight(&all, origin, direction), 0.01)
}

/// A pane shows what the reflected camera sees, and the world behind it along a ray that is shifted, each with its weight.
#[test]
fn a_pane_shows_both_worlds() {
    let (index, thickness_m) = (1.5, 0.02);
    let glass = Finish::Glass {
        index,
        thickness_m,
        tint: DVec3::ONE,
        opening_m: 0.0,
    };
    let eye = camera().camera_center();
    let turn = reflection();
    // The camera is in front of the pane, and then behind it, so that it looks at the shapes through the pane.
    for (eye, flip) in [(eye, DVec3::ONE), (turn * eye, DVec3::new(1.0, 1.0, -1.0))] {
        let normal = axes().z_axis * (if flip.z > 0.0 { -1.0 } else { 1.0 });
        let mut different = 0;
        for place in 0..400 {
            let (x, y) = (f64::from(place % 20), f64::from(place / 20));
            let direction = DVec3::new(0.05 * x - 0.5, 0.05 * y - 0.5, 1.0) * flip;
            let direction = direction.normalize();
            let seen = along(&world(DMat3::IDENTITY, Some(glass)), eye, direction);
            let mirrored = along(&world(DMat3::IDENTITY, None), turn * eye, turn * direction);
            let cosine = -normal.dot(direction);
            let (outer, sine) = (cosine.acos(), cosine.acos().sin());
            let inner = (sine / index).asin();
            let across = ((outer - inner).sin() / (outer + inner).sin()).powi(2);
            let within = ((outer - inner).tan() / (outer + inner).tan()).powi(2);
            let face = 0.5 * (across + within);
            let reflected = 2.0 * face / (1.0 + face);
            // The pane shifts the ray sideways, in the plane of incidence.
            let aside = (direction + normal * cosine).normalize_or_zero();
            let shift = thickness_m * (inner.tan() - outer.tan());
            let straight = along(
                &world(DMat3::IDENTITY, None),
                eye + aside * shift,
                direction,
            );
            let expected = mirrored * reflected + straight * (1.0 - reflected);
            let off = (seen - expected).abs().max_element();
            // The lengths of the paths differ by the shift, which changes haze and details a little.
            different += u32::from(off > 2e-3);
            assert!(seen.max_element() <= mirrored.max(straight).max_element() + 1e-9);
        }
        assert!(different <= 4, "{different}");
    }
}

/// Between two mirrors, light ends after a limited number of reflections.
#[test]
fn facing_mirrors_end() {
    let mirror = |z: f64| {
        let shape = SurfaceShape::Rectangle {
            center: DVec3::new(0.0, 0.0, z),
            axes: DMat3::IDENTITY,
            half: (5.0, 5.0),
        };
        let reflectance = DVec3::ONE;
        Object::new(
            shape,
            Surface::Layered(Finish::Mirror { reflectance }),
            false,
        )
    };
    let light = Light::outdoors(&mut SplitMix64::new(1));
    let world = World::of(vec![mirror(3.0), mirror(-3.0)], light);
    assert_eq!(along(&world, DVec3::ZERO, DVec3::Z), DVec3::ZERO);
    let aside = DVec3::new(0.5, -0.5, 1.0).normalize();
    assert!(along(&world, DVec3::ZERO, aside).min_element() > 0.0);
}
