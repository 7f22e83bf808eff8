//! A scene under construction.

use glam::{DMat3, DVec3};
use sharp::random::SplitMix64;

use super::super::arithmetic::unit_circle;
use super::super::finish::Finish;
use super::super::light::{Lamp, Light};
use super::super::paint::{Paint, Tone};
use super::super::rig::Rig;
use super::super::shapes::{SurfaceShape, turned};
use super::super::world::{Object, Surface, World};

/// Minimum distance of surfaces from the sampled camera positions, in metres. The positions are only a few centimetres
/// apart, so no surface is closer than 0.3 m to any possible position.
const CLEAR_M: f64 = 0.34;

/// Objects, light and lens of a scene under construction. Positions are in metres, in a frame with x right, y down and
/// z forward. The frame is rotated about the vertical through the central camera, so that walls are not always
/// perpendicular to the camera's axis.
pub(super) struct Draft<'a> {
    pub(super) random: &'a mut SplitMix64,
    pub(super) light: Light,
    /// True if mirrors and panes are added.
    pub(super) reflective: bool,
    objects: Vec<Object>,
    /// Cameras; the lens has a horizontal field of view of 45 to 75 degrees.
    pub(super) rig: Rig,
    /// Target mean radiance of the central picture.
    pub(super) brightness: f64,
    world_from_frame: DMat3,
    cameras: Vec<DVec3>,
    /// Occupied circles on the floor: x and z of the centres, and radii.
    taken: Vec<(f64, f64, f64)>,
}

impl<'a> Draft<'a> {
    pub(super) fn new(random: &'a mut SplitMix64, light: Light, reflective: bool) -> Self {
        let rig = Rig {
            focal: random.between(0.652, 1.207),
            center: (random.between(0.49, 0.51), random.between(0.49, 0.51)),
            ..Rig::CLASSIC
        };
        Self {
            brightness: random.between(0.13, 0.36),
            random,
            rig,
            light,
            reflective,
            objects: Vec::new(),
            world_from_frame: DMat3::IDENTITY,
            cameras: rig.centers(97),
            taken: Vec::new(),
        }
    }

    /// Rotates the frame in either direction by up to `most` of a full turn.
    pub(super) fn turn_frame(&mut self, most: f64) {
        let (c, s) = unit_circle(self.random.between(-most, most));
        self.world_from_frame =
            DMat3::from_cols(DVec3::new(c, 0.0, -s), DVec3::Y, DVec3::new(s, 0.0, c));
    }

    pub(super) fn between(&mut self, low: f64, high: f64) -> f64 {
        self.random.between(low, high)
    }

    /// True with a probability of `percent`.
    pub(super) fn chance(&mut self, percent: u64) -> bool {
        self.random.below(100) < percent
    }

    pub(super) fn count(&mut self, low: u64, high: u64) -> u64 {
        low + self.random.below(high - low + 1)
    }

    /// One of the two values, each equally likely.
    pub(super) fn one_of<T>(&mut self, first: T, second: T) -> T {
        if self.chance(50) { first } else { second }
    }

    pub(super) fn paint(&mut self, tone: Tone, scale_m: f64) -> Paint {
        Paint::new(self.random, tone, scale_m)
    }

    /// Adds a shape, unless it is too close to a camera.
    pub(super) fn put(&mut self, shape: SurfaceShape, paint: Paint) {
        self.put_if_clear(shape, Surface::Varied(paint), true);
    }

    /// Adds a shape that casts no shadow, unless it is too close to a camera.
    pub(super) fn put_without_shadow(&mut self, shape: SurfaceShape, paint: Paint) {
        self.put_if_clear(shape, Surface::Varied(paint), false);
    }

    /// Adds a mirror or a pane, unless it is too close to a camera.
    pub(super) fn put_finish(&mut self, shape: SurfaceShape, finish: Finish) {
        self.put_if_clear(shape, Surface::Layered(finish), false);
    }

    fn put_if_clear(&mut self, shape: SurfaceShape, surface: Surface, casts: bool) {
        let shape = shape.turned_by(&self.world_from_frame);
        let clear = |camera: &DVec3| shape.distance_to(*camera) > CLEAR_M;
        if self.cameras.iter().all(clear) {
            self.objects.push(Object::new(shape, surface, casts));
        }
    }

    /// Adds a box whose bottom centre is at `base`; `turn` is the tangent of half its angle of rotation about the
    /// vertical.
    pub(super) fn stand(&mut self, base: DVec3, size: DVec3, turn: f64, paint: Paint) {
        let half = size * 0.5;
        self.put(
            SurfaceShape::Box {
                center: base - DVec3::Y * half.y,
                axes: turned(0.0, turn, 0.0, 1.0),
                half,
            },
            paint,
        );
    }

    /// Adds a cylinder that stands on `base`.
    pub(super) fn column(&mut self, base: DVec3, height: f64, radius: f64, paint: Paint) {
        self.put(
            SurfaceShape::Cylinder {
                center: base - DVec3::Y * (0.5 * height),
                axes: DMat3::IDENTITY,
                radius,
                half: 0.5 * height,
            },
            paint,
        );
    }

    /// Adds a ball that lies on `base`.
    pub(super) fn ball(&mut self, base: DVec3, radius: f64, paint: Paint) {
        let center = base - DVec3::Y * radius;
        self.put(SurfaceShape::Sphere { center, radius }, paint);
    }

    /// Adds a thin round bar between two points.
    pub(super) fn bar(&mut self, from: DVec3, to: DVec3, radius: f64, paint: Paint) {
        let along = to - from;
        let direction = along.normalize();
        let side = direction.any_orthonormal_vector();
        self.put(
            SurfaceShape::Cylinder {
                center: (from + to) * 0.5,
                axes: DMat3::from_cols(side, direction, side.cross(direction)),
                radius,
                half: along.length() * 0.5,
            },
            paint,
        );
    }

    /// Adds a flat rectangle that casts no shadow, perpendicular to axis `across` (0 x, 1 y, 2 z) of the frame.
    pub(super) fn panel(&mut self, center: DVec3, across: usize, half: (f64, f64), paint: Paint) {
        let axes = match across {
            0 => DMat3::from_cols(DVec3::Z, DVec3::Y, DVec3::NEG_X),
            1 => DMat3::from_cols(DVec3::X, DVec3::Z, DVec3::NEG_Y),
            _ => DMat3::IDENTITY,
        };
        self.put_without_shadow(SurfaceShape::Rectangle { center, axes, half }, paint);
    }

    /// Adds a lamp: a glowing ball, and light from its centre.
    pub(super) fn lamp(&mut self, place: DVec3, radius: f64, power: f64) {
        let paint = Paint::shining(self.random);
        let tint = DVec3::new(1.0, self.between(0.8, 1.0), self.between(0.6, 1.0));
        self.put_without_shadow(
            SurfaceShape::Sphere {
                center: place,
                radius,
            },
            paint,
        );
        self.light.lamps.push(Lamp {
            place: self.world_from_frame * place,
            power: tint * power,
        });
    }

    /// Adds the light of a window of `square_m` square metres in the given direction of the frame.
    pub(super) fn admit(&mut self, to_window: DVec3, square_m: f64) {
        let to_window = self.world_from_frame * to_window;
        self.light.admit(to_window, square_m);
    }

    /// Finds and occupies a free circle on the floor (y = 0) that is in view and whose centre
    /// satisfies `allowed`. The centre's depth, from `near` to `far`, is drawn half of the time
    /// uniformly in depth and half of the time uniformly in disparity.
    pub(super) fn spot(
        &mut self,
        (near, far): (f64, f64),
        radius: f64,
        allowed: impl Fn(f64, f64) -> bool,
    ) -> Option<DVec3> {
        for _ in 0..8 {
            let depth = if self.chance(50) {
                self.between(near, far)
            } else {
                1.0 / self.between(1.0 / far, 1.0 / near)
            };
            let side = self.between(-0.65, 0.65) * depth;
            let place = self.world_from_frame.transpose() * DVec3::new(side, 0.0, depth);
            let free = self.taken.iter().all(|&(x, z, other)| {
                let (dx, dz) = (place.x - x, place.z - z);
                let apart = radius + other;
                dx * dx + dz * dz > apart * apart
            });
            if free && allowed(place.x, place.z) {
                self.taken.push((place.x, place.z, radius));
                return Some(place);
            }
        }
        None
    }

    /// A point to look at: at the given depth, `below` the central camera, and slightly to one side.
    pub(super) fn target(&mut self, depth: f64, below: f64) -> DVec3 {
        DVec3::new(self.between(-0.15, 0.15) * depth, below, depth)
    }

    pub(super) fn finish(self) -> World {
        World::of(self.objects, self.light)
    }
}
