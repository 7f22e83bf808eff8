//! Objects and lights, and the radiance along a ray.
//!
//! The world axes are those of the rig's central camera: x right, y down, z forward, in metres.

use glam::DVec3;

use super::candidates::{LampCube, SunGrid, Wedge};
use super::finish::Finish;
use super::light::{Light, Sky};
use super::paint::Paint;
use super::shapes::{Meeting, SurfaceShape};
use super::texture::Texture;

#[derive(Debug)]
pub(super) struct Object {
    shape: SurfaceShape,
    /// Centre and squared radius of the object's bounding sphere.
    bounds: (DVec3, f64),
    surface: Surface,
    /// True if the object casts shadows. The floor and walls of a room need not cast shadows,
    /// because nothing is behind them.
    casts: bool,
}

/// Colouring of an object.
#[derive(Debug)]
pub(super) enum Surface {
    Classic(Texture),
    Varied(Paint),
    Layered(Finish),
}

/// Maximum number of mirrors and panes that light passes on its way to the camera; further mirrors
/// and panes are black.
const MAX_LAYERS: u32 = 5;

impl Object {
    pub(super) fn new(shape: SurfaceShape, surface: Surface, casts: bool) -> Self {
        Self {
            bounds: shape.bounds(),
            shape,
            surface,
            casts,
        }
    }

    #[cfg(test)]
    pub(super) fn shape(&self) -> &SurfaceShape {
        &self.shape
    }

    /// Intersection with a ray. The bounding sphere is only used to skip shapes that cannot be hit.
    fn meet(&self, origin: DVec3, direction: DVec3) -> Option<Meeting> {
        let (center, square_radius) = self.bounds;
        let to_center = center - origin;
        let along = to_center.dot(direction);
        let outside = to_center.dot(to_center) - square_radius;
        // The sphere is behind the origin, or the ray misses it.
        let square_length = direction.dot(direction);
        if outside > 0.0 && (along < 0.0 || along * along < outside * square_length) {
            return None;
        }
        self.shape.meet(origin, direction)
    }
}

/// The scene without its cameras.
#[derive(Debug)]
pub(super) struct World {
    objects: Vec<Object>,
    light: Light,
    /// Objects that may block the sun; `None` without a sun.
    sun_grid: Option<SunGrid>,
    /// Objects that may block each lamp, in the order of the lamps.
    lamp_cubes: Vec<LampCube>,
}

/// The first surface along a ray.
#[derive(Debug, Clone, Copy)]
pub(super) struct Hit {
    /// Distance in units of the ray's direction vector.
    pub(super) distance: f64,
    object: usize,
    meeting: Meeting,
}

/// Rays of one pixel that hit the same side of an object, or the sky, and are shaded together.
/// Values are stored as sums, so that they are exact for a single ray.
#[derive(Debug, Clone, Copy)]
pub(super) struct Sight {
    rays: f64,
    direction: DVec3,
    /// Sums of the hits and of the hit points over the rays, which all hit the same object.
    hit: Option<(Hit, DVec3)>,
}

impl Sight {
    /// Index of the visible object and, for a single ray, its distance.
    pub(super) fn object(&self) -> Option<(usize, f64)> {
        self.hit.map(|(hit, _)| (hit.object, hit.distance))
    }

    /// Adds the rays of another sight, which must show the same surface.
    pub(super) fn join(&mut self, other: &Self) {
        self.rays += other.rays;
        self.direction += other.direction;
        if let (Some((hit, point)), Some((more, at))) = (&mut self.hit, &other.hit) {
            hit.distance += more.distance;
            hit.meeting.normal += more.meeting.normal;
            hit.meeting.local += more.meeting.local;
            *point += *at;
        }
    }
}

/// Objects that the rays of a bundle can hit, nearest first.
pub(super) struct Candidates {
    /// A lower bound on the depth of an object's points, and the object's index; ascending.
    sorted: Vec<(f64, usize)>,
}

impl World {
    /// Creates a world from objects and a light.
    pub(super) fn of(objects: Vec<Object>, light: Light) -> Self {
        let casting = (0_u32..)
            .zip(&objects)
            .filter(|(_, object)| object.casts)
            .map(|(index, object)| (index, &object.shape));
        let sunny = light.sun != DVec3::ZERO && casting.clone().next().is_some();
        let sun_grid = sunny.then(|| SunGrid::new(light.to_sun, casting.clone()));
        let cubes = light.lamps.iter();
        let lamp_cubes = cubes.map(|lamp| LampCube::new(lamp.place, casting.clone()));
        Self {
            lamp_cubes: lamp_cubes.collect(),
            objects,
            light,
            sun_grid,
        }
    }

    #[cfg(test)]
    pub(super) fn objects(&self) -> &[Object] {
        &self.objects
    }

    /// True if the nearest surface along a ray is a mirror or a pane.
    #[cfg(test)]
    pub(super) fn is_layered_along(&self, origin: DVec3, direction: DVec3) -> bool {
        let hit = self.first_hit(origin, direction);
        hit.is_some_and(|hit| matches!(self.objects[hit.object].surface, Surface::Layered(_)))
    }

    /// Multiplies the exposure of all cameras.
    pub(super) fn expose(&mut self, factor: f64) {
        self.light.exposure *= factor;
    }

    /// The nearest surface along a ray, if any.
    pub(super) fn first_hit(&self, origin: DVec3, direction: DVec3) -> Option<Hit> {
        let mut first = None;
        for object in 0..self.objects.len() {
            self.meet_nearer(object, origin, direction, &mut first);
        }
        first
    }

    /// Like [`Self::first_hit`], for a ray of the bundle that belongs to `candidates`; the direction must have a depth
    /// of 1.
    pub(super) fn first_hit_among(
        &self,
        candidates: &Candidates,
        origin: DVec3,
        direction: DVec3,
    ) -> Option<Hit> {
        let mut first: Option<Hit> = None;
        for &(depth, object) in &candidates.sorted {
            if first.is_some_and(|hit| hit.distance < depth) {
                break;
            }
            self.meet_nearer(object, origin, direction, &mut first);
        }
        first
    }

    /// If two surfaces coincide, the object that was added first is visible.
    fn meet_nearer(&self, object: usize, origin: DVec3, direction: DVec3, first: &mut Option<Hit>) {
        if let Some(meeting) = self.objects[object].meet(origin, direction)
            && first.is_none_or(|hit| {
                meeting.distance < hit.distance
                    || (meeting.distance == hit.distance && object < hit.object)
            })
        {
            *first = Some(Hit {
                distance: meeting.distance,
                object,
                meeting,
            });
        }
    }

    /// Objects that a bundle of rays can hit, seen from a camera that looks `forward` (unit
    /// vector); without a bundle, all objects.
    pub(super) fn candidates(
        &self,
        eye: DVec3,
        forward: DVec3,
        bundle: Option<&Wedge>,
    ) -> Candidates {
        let depth = |object: &Object| {
            let nearest = -object.shape.reach(-forward) - forward.dot(eye);
            let farthest = object.shape.reach(forward) - forward.dot(eye);
            // Widened by far more than rounding errors.
            (nearest - 1e-7, farthest + 1e-7)
        };
        let mut sorted: Vec<(f64, usize)> = (0..)
            .zip(&self.objects)
            .filter(|(_, object)| {
                bundle.is_none_or(|wedge| wedge.may_meet(&object.shape, object.bounds))
            })
            .map(|(index, object)| (depth(object), index))
            .filter(|((_, farthest), _)| *farthest > 0.0)
            .map(|((nearest, _), index)| (nearest, index))
            .collect();
        sorted.sort_unstable_by(|a, b| a.0.total_cmp(&b.0).then(a.1.cmp(&b.1)));
        Candidates { sorted }
    }

    /// Nearest intersection of a ray, which must be in the bundle that belongs to `candidates`.
    pub(super) fn sight(&self, candidates: &Candidates, origin: DVec3, direction: DVec3) -> Sight {
        let hit = self.first_hit_among(candidates, origin, direction);
        Sight {
            rays: 1.0,
            direction,
            hit: hit.map(|hit| (hit, origin + direction * hit.distance)),
        }
    }

    /// True if two rays of a pixel may be shaded together. Paints of varied scenes fade out details
    /// finer than a pixel; classic textures, mirrors and panes do not, so their rays are shaded one
    /// by one.
    pub(super) fn shades_as_one(&self, a: &Sight, b: &Sight) -> bool {
        let surface = |sight: &Sight| {
            let hit = sight.hit.as_ref();
            hit.map(|(hit, _)| (hit.object, hit.meeting.across))
        };
        let layered = |(object, _): (usize, usize)| {
            matches!(self.objects[object].surface, Surface::Layered(_))
        };
        !matches!(self.light.sky, Sky::Classic { .. })
            && surface(a) == surface(b)
            && !surface(a).is_some_and(layered)
    }

    /// Linear light that arrives along the rays of a sight, summed over these rays. `sample` is the width of surface
    /// that one ray represents at a depth of 1.
    pub(super) fn radiance(&self, sight: &Sight, sample: f64) -> DVec3 {
        let (light, share) = (&self.light, 1.0 / sight.rays);
        let direction = sight.direction * share;
        let Some((hit, point)) = &sight.hit else {
            return light.sky.radiance(direction) * (light.exposure * sight.rays);
        };
        let meeting = Meeting {
            distance: hit.distance * share,
            normal: hit.meeting.normal * share,
            local: hit.meeting.local * share,
            across: hit.meeting.across,
        };
        let size = sample * sight.rays.sqrt();
        let point = *point * share;
        let seen = self.seen(hit.object, &meeting, point, direction, size, MAX_LAYERS);
        seen * (light.exposure * sight.rays)
    }

    /// Linear light that leaves a surface at `point` against the ray's direction, attenuated by
    /// haze. The distance in `meeting` is the length of the whole path from the camera. At most
    /// `layers` more mirrors and panes are followed.
    fn seen(
        &self,
        object: usize,
        meeting: &Meeting,
        point: DVec3,
        direction: DVec3,
        size: f64,
        layers: u32,
    ) -> DVec3 {
        let light = &self.light;
        let mut seen = match &self.objects[object].surface {
            Surface::Classic(texture) => {
                self.reflected(object, texture.color(meeting), meeting.normal, point)
            }
            Surface::Varied(paint) => {
                // On a slanted surface, a pixel covers a larger area, stretched in one direction.
                let facing = (meeting.normal.dot(direction).abs() / direction.length()).max(0.1);
                let footprint_m = meeting.distance * size / facing.sqrt();
                let albedo = paint.color(meeting, footprint_m);
                if paint.glow > 0.0 {
                    albedo * paint.glow
                } else {
                    self.reflected(object, albedo, meeting.normal, point)
                }
            }
            Surface::Layered(finish) => {
                let Some(layers) = layers.checked_sub(1) else {
                    return DVec3::ZERO;
                };
                let found = finish.layers(meeting.normal, direction);
                let onwards = |origin, direction| {
                    self.onwards(object, origin, direction, meeting.distance, size, layers)
                };
                let (mirrored, weight) = found.reflected;
                let mut seen = onwards(point, mirrored) * weight;
                if let Some((offset, weight)) = found.transmitted {
                    seen += onwards(point + offset, direction) * weight;
                }
                // The haze of the whole path is included.
                return seen;
            }
        };
        if light.haze_m.is_finite() {
            let far = meeting.distance / light.haze_m;
            seen += (light.sky.haze() - seen) * (far * far / (1.0 + far * far));
        }
        seen
    }

    /// Linear light along a ray that starts on the flat surface of object `own`. `before` is the length of the path
    /// from the camera to `origin`, in lengths of `direction`.
    fn onwards(
        &self,
        own: usize,
        origin: DVec3,
        direction: DVec3,
        before: f64,
        size: f64,
        layers: u32,
    ) -> DVec3 {
        let mut first = None;
        for object in (0..self.objects.len()).filter(|object| *object != own) {
            self.meet_nearer(object, origin, direction, &mut first);
        }
        let Some(hit) = first else {
            return self.light.sky.radiance(direction);
        };
        let meeting = Meeting {
            distance: before + hit.distance,
            ..hit.meeting
        };
        let point = origin + direction * hit.distance;
        self.seen(hit.object, &meeting, point, direction, size, layers)
    }

    /// Linear light of sun, lamps and surroundings that a surface of the given albedo reflects from a point.
    fn reflected(&self, object: usize, albedo: DVec3, normal: DVec3, point: DVec3) -> DVec3 {
        let light = &self.light;
        // Start slightly above the surface, to avoid self-shadowing.
        let above = point + normal * 1e-6;
        let facing_dome = 0.5 + 0.5 * normal.dot(light.dome);
        let mut arriving = light.ambient[0] + (light.ambient[1] - light.ambient[0]) * facing_dome;
        let facing_sun = normal.dot(light.to_sun);
        if let Some(grid) = &self.sun_grid
            && facing_sun > 0.0
        {
            let before = grid.before(above);
            if !self.blocked(before, object, above, light.to_sun, f64::INFINITY) {
                arriving += light.sun * facing_sun;
            }
        }
        for (lamp, cube) in light.lamps.iter().zip(&self.lamp_cubes) {
            let to_lamp = lamp.place - above;
            let facing_lamp = normal.dot(to_lamp);
            if facing_lamp > 0.0 && !self.blocked(cube.before(above), object, above, to_lamp, 1.0) {
                let square = to_lamp.dot(to_lamp);
                arriving += lamp.power * (facing_lamp / square.sqrt() / (0.2 + square));
            }
        }
        albedo * arriving
    }

    /// True if one of the objects is between the point `from` and a light at `from + limit * towards`. All shapes are
    /// convex, so the object that the point is on, `own`, never blocks it.
    fn blocked(&self, among: &[u32], own: usize, from: DVec3, towards: DVec3, limit: f64) -> bool {
        let others = among.iter().map(|&object| object as usize);
        others.filter(|object| *object != own).any(|object| {
            let meeting = self.objects[object].meet(from, towards);
            meeting.is_some_and(|meeting| meeting.distance < limit)
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::synthetic::varied;

    /// Lists only skip objects that cannot be hit: hits and shadows are the same with and without
    /// them.
    #[test]
    fn lists_never_change_what_is_seen_or_shaded() {
        const TILES: usize = 12;
        const RAYS: usize = 4;
        let (mut hits, mut shaded) = (0, 0);
        for seed in 1_000..1_080 {
            let (world, rig) = varied::scene(seed);
            let eye = rig.centers(11)[7];
            let forward = (rig.target - eye).normalize();
            let right = DVec3::Y.cross(forward).normalize();
            let down = forward.cross(right);
            // Slopes of half the field of view of a wide lens.
            let edge = |at: usize, of: usize| 1.6 * at as f64 / of as f64 - 0.8;
            let ray = |x: f64, y: f64| right * x + down * y + forward;
            for tile in 0..TILES * TILES {
                let (column, row) = (tile % TILES, tile / TILES);
                let corner = |i, j| ray(edge(column + i, TILES), edge(row + j, TILES));
                let corners = [corner(0, 0), corner(1, 0), corner(1, 1), corner(0, 1)];
                let wedge = Wedge::between(eye, corners);
                let candidates = world.candidates(eye, forward, Some(&wedge));
                for place in 0..(RAYS + 1) * (RAYS + 1) {
                    // Including the edges of the bundle.
                    let x = edge(column * RAYS + place % (RAYS + 1), TILES * RAYS);
                    let y = edge(row * RAYS + place / (RAYS + 1), TILES * RAYS);
                    let direction = ray(x, y);
                    let all = world.first_hit(eye, direction);
                    let listed = world.first_hit_among(&candidates, eye, direction);
                    let told = |hit: Option<Hit>| hit.map(|hit| (hit.object, hit.distance));
                    assert_eq!(told(all), told(listed), "seed {seed}, tile {tile}");
                    if let Some(hit) = all {
                        hits += 1;
                        shaded += shadows_agree(&world, &hit, eye + direction * hit.distance);
                    }
                }
            }
        }
        assert!(hits > 100_000 && shaded > 10_000, "{hits} {shaded}");
    }

    /// Number of lights that are blocked from a point; the same by the lists as by all objects.
    fn shadows_agree(world: &World, hit: &Hit, point: DVec3) -> usize {
        let casting: Vec<u32> = (0..)
            .zip(&world.objects)
            .filter(|(_, object)| object.casts)
            .map(|(index, _)| index)
            .collect();
        let above = point + hit.meeting.normal * 1e-6;
        let blocked =
            |among: &[u32], towards, limit| world.blocked(among, hit.object, above, towards, limit);
        let mut shaded = 0;
        if let Some(grid) = &world.sun_grid {
            let found = blocked(grid.before(above), world.light.to_sun, f64::INFINITY);
            assert_eq!(found, blocked(&casting, world.light.to_sun, f64::INFINITY));
            shaded += usize::from(found);
        }
        for (lamp, cube) in world.light.lamps.iter().zip(&world.lamp_cubes) {
            let found = blocked(cube.before(above), lamp.place - above, 1.0);
            assert_eq!(found, blocked(&casting, lamp.place - above, 1.0));
            shaded += usize::from(found);
        }
        shaded
    }
}
