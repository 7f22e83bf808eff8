//! Objects of the classic scene.

use glam::{DMat3, DVec3};
use sharp::random::SplitMix64;

use super::light::Light;
use super::shapes::{SurfaceShape, turned};
use super::texture::Texture;
use super::world::{Object, Surface, World};

/// Depth of the ground below the central camera, in metres.
const GROUND_Y: f64 = 1.3;

/// Builds the classic world of a seed, with `posts` posts in front of the other objects.
pub(super) fn world(seed: u64, posts: usize) -> World {
    let mut random = SplitMix64::new(seed);
    let to_sun = DVec3::new(random.between(-0.7, 0.7), -1.0, -0.6).normalize();
    let light = Light::classic(to_sun, random.next_u64());
    let mut objects = Objects(Vec::new());
    objects.add_planes(&mut random);
    objects.add_solids(&mut random);
    objects.add_thin_structures(&mut random);
    objects.add_occluder(&mut random);
    objects.add_posts(&mut random, posts);
    World::of(objects.0, light)
}

struct Objects(Vec<Object>);

impl Objects {
    fn add(&mut self, random: &mut SplitMix64, scale: f64, shape: SurfaceShape) {
        let texture = Texture::random(random, scale);
        let object = Object::new(shape, Surface::Classic(texture), true);
        self.0.push(object);
    }

    /// Adds the ground, a wall at the back that leaves a strip of sky above and to the sides, and a slanted wall.
    fn add_planes(&mut self, random: &mut SplitMix64) {
        let ground = SurfaceShape::Rectangle {
            center: DVec3::new(0.0, GROUND_Y, 5.0),
            axes: DMat3::from_cols(DVec3::X, DVec3::Z, -DVec3::Y),
            half: (9.0, 5.5),
        };
        self.add(random, 0.6, ground);
        let height = random.between(1.75, 1.95);
        let back = SurfaceShape::Rectangle {
            center: DVec3::new(
                random.between(-1.6, -1.0),
                GROUND_Y - height,
                random.between(7.5, 9.0),
            ),
            axes: DMat3::IDENTITY,
            half: (5.0, height),
        };
        self.add(random, 0.5, back);
        let slant = turned(0.0, random.between(-0.48, -0.38), 0.0, 1.0);
        let side = SurfaceShape::Rectangle {
            center: DVec3::new(random.between(2.6, 3.1), 0.2, 5.0),
            axes: slant,
            half: (1.7, 1.1),
        };
        self.add(random, 0.4, side);
    }

    /// Adds boxes and balls on the ground, 2 to 6 metres away, and a ball in the air.
    fn add_solids(&mut self, random: &mut SplitMix64) {
        for i in 0..4 {
            let half = DVec3::new(
                random.between(0.18, 0.4),
                random.between(0.2, 0.55),
                random.between(0.18, 0.4),
            );
            let x = -1.5 + f64::from(i) + random.between(-0.3, 0.3);
            let shape = SurfaceShape::Box {
                center: DVec3::new(x, GROUND_Y - half.y, random.between(2.4, 5.5)),
                axes: turned(0.0, random.between(-0.5, 0.5), 0.0, 1.0),
                half,
            };
            self.add(random, 0.18, shape);
        }
        for i in 0..3 {
            let radius = random.between(0.15, 0.32);
            let x = -1.1 + 1.1 * f64::from(i) + random.between(-0.25, 0.25);
            let shape = SurfaceShape::Sphere {
                center: DVec3::new(x, GROUND_Y - radius, random.between(2.2, 4.5)),
                radius,
            };
            self.add(random, 0.15, shape);
        }
        let floating = SurfaceShape::Sphere {
            center: DVec3::new(random.between(-0.8, 0.8), -0.5, random.between(3.0, 5.0)),
            radius: random.between(0.2, 0.35),
        };
        self.add(random, 0.15, floating);
        let tilted = SurfaceShape::Box {
            center: DVec3::new(random.between(-1.2, -0.4), -0.1, random.between(3.0, 4.0)),
            axes: turned(0.3, random.between(-0.4, 0.4), 0.25, 1.0),
            half: DVec3::new(0.25, 0.12, 0.2),
        };
        self.add(random, 0.12, tilted);
    }

    /// Adds poles of 2 to 3 centimetres and wires of 1 centimetre.
    fn add_thin_structures(&mut self, random: &mut SplitMix64) {
        for i in 0..4 {
            let half = random.between(0.01, 0.016);
            let shape = SurfaceShape::Box {
                center: DVec3::new(
                    -0.9 + 0.6 * f64::from(i) + random.between(-0.15, 0.15),
                    0.35,
                    random.between(1.8, 3.2),
                ),
                axes: turned(0.0, 0.0, random.between(-0.06, 0.06), 1.0),
                half: DVec3::new(half, 0.95, half),
            };
            self.add(random, 0.1, shape);
        }
        for _ in 0..2 {
            let shape = SurfaceShape::Box {
                center: DVec3::new(0.0, random.between(-0.75, -0.35), random.between(2.2, 3.0)),
                axes: turned(
                    0.0,
                    random.between(-0.1, 0.1),
                    random.between(-0.08, 0.08),
                    1.0,
                ),
                half: DVec3::new(2.2, 0.005, 0.005),
            };
            self.add(random, 0.1, shape);
        }
    }

    /// Adds a slab close to the cameras, off centre, that hides much of the background.
    fn add_occluder(&mut self, random: &mut SplitMix64) {
        let side = if random.next_u64().is_multiple_of(2) {
            1.0
        } else {
            -1.0
        };
        let shape = SurfaceShape::Box {
            center: DVec3::new(
                side * random.between(0.3, 0.4),
                0.25,
                random.between(1.15, 1.3),
            ),
            axes: turned(
                0.0,
                random.between(-0.2, 0.2),
                random.between(-0.1, 0.1),
                1.0,
            ),
            half: DVec3::new(0.11, 0.3, 0.03),
        };
        self.add(random, 0.08, shape);
    }

    /// Adds posts of 3 centimetres, a metre away and taller than the picture; each new post is
    /// placed between earlier ones. A second camera, 10 cm to the side, sees the part of the
    /// background that a post hides from the first one. Thus, every post adds the same area that
    /// only the second camera sees.
    fn add_posts(&mut self, random: &mut SplitMix64, posts: usize) {
        for i in 0..posts {
            // Halves, quarters, eighths of the picture's width (van der Corput sequence).
            let (mut place, mut part, mut rest) = (0.0, 0.5, i + 1);
            while rest > 0 {
                place += part * (rest % 2) as f64;
                (part, rest) = (part / 2.0, rest / 2);
            }
            let shape = SurfaceShape::Box {
                center: DVec3::new(-0.55 + 1.1 * place, 0.0, 1.0),
                axes: DMat3::IDENTITY,
                half: DVec3::new(0.015, 2.0, 0.015),
            };
            self.add(random, 0.08, shape);
        }
    }
}
