//! Measures how well an interpretation explains two views.

use glam::{DVec2, DVec3};
use sharp::camera::{Intrinsics, RigidTransform};

use super::small_view::{Sample, SmallView, ray};

/// Meaning of the stored depth values.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum DepthIs {
    Z,
    /// The length of the ray to the point.
    RayLength,
    /// z, which the reader mistook for a ray length and divided by the length of the ray to z = 1.
    NoRayLength,
    /// The reciprocal of depth, in an arbitrary unit.
    Inverse,
    /// Values of a z-buffer, `v · (1 − near / depth)`; holds v, the value at infinite depth. The
    /// resulting depth is in units of the near plane's distance.
    Buffer(f64),
    /// Reciprocals of depth, normalised so that 0 stands for a far distance. Holds the value of the near distance, and the
    /// offset that makes values proportional to reciprocals of depth. The resulting depth is in units of the near distance.
    InverseBetween(f64, f64),
    /// The depth minus this many metres.
    Short(f64),
}

impl DepthIs {
    fn z(self, read: f64, ray: DVec3) -> f64 {
        match self {
            Self::Z => read,
            Self::RayLength => read / ray.length(),
            Self::NoRayLength => read * ray.length(),
            Self::Inverse => 1.0 / read,
            Self::Buffer(infinite) => 1.0 / (1.0 - read / infinite).max(1e-6),
            Self::InverseBetween(near, offset) => (near + offset) / (read + offset),
            Self::Short(by) => read + by,
        }
    }

    /// Prepares two depths of the same place for a comparison by ratio: removes a positive offset of [`Self::Short`],
    /// which would make any two depths similar.
    fn compared(self, one: f64, other: f64) -> (f64, f64) {
        match self {
            Self::Short(by) if by > 0.0 => (one - by, (other - by).max(0.01 * one)),
            _ => (one, other),
        }
    }
}

/// Placement of a depth map relative to its picture.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Registration {
    /// Offset, within the depth map, from the map's own centre to the picture's centre: to the right and down, in
    /// widths of the picture.
    pub(super) off: DVec2,
    /// Magnification of the depth map relative to the picture.
    pub(super) zoom: f64,
}

impl Registration {
    pub(super) const SAME: Self = Self {
        off: DVec2::ZERO,
        zoom: 1.0,
    };

    /// Depth as read at a place in a view. If the registration leads to a position without depth,
    /// the unregistered position is used instead: leaving such positions out would favour
    /// registrations that lead there.
    fn depth_at(&self, view: &SmallView, place: DVec2) -> Option<(f64, DVec2)> {
        if *self == Self::SAME {
            return view.depth_at(place);
        }
        let size = DVec2::new(view.camera.width.into(), view.camera.height.into());
        let from = 0.5 * size + self.zoom * (place - 0.5 * size) + self.off * size.x;
        let depth = view.camera.contains(from).then(|| view.depth_at(from));
        let depth = depth.flatten().map(|(depth, _)| (depth, place));
        depth.or_else(|| view.depth_at(place))
    }
}

/// An alternative interpretation of views, as changes to the dataset reader's interpretation.
#[derive(Debug, Clone, Copy)]
pub(super) struct Reading {
    /// Factor by which the poses' translations are multiplied.
    pub(super) scale: f64,
    /// Factors of the focal lengths in x and y, for the view that is projected and the other view.
    pub(super) focal: [DVec2; 2],
    /// Factors of the depths, for the view that is projected and the other view.
    pub(super) depth_times: [f64; 2],
    /// Factors of the poses' translations, for the view that is projected and the other view.
    pub(super) pose_times: [f64; 2],
    /// True if cx and cy are swapped.
    pub(super) centre_swapped: bool,
    /// Offset of principal points to the right and down from the values read, in widths of the
    /// picture.
    pub(super) centre_off: DVec2,
    /// Radial distortion: lenses show a direction with radius r at radius r (1 + bend r²).
    pub(super) bend: f64,
    pub(super) depth: DepthIs,
    /// Mapping from places in the picture to places in the depth map.
    pub(super) depth_at: Registration,
    /// Conversion of world-to-camera poses.
    pub(super) take: fn(&RigidTransform) -> RigidTransform,
}

impl Reading {
    pub(super) const AS_READ: Self = Self {
        scale: 1.0,
        focal: [DVec2::ONE; 2],
        depth_times: [1.0; 2],
        pose_times: [1.0; 2],
        centre_swapped: false,
        centre_off: DVec2::ZERO,
        bend: 0.0,
        depth: DepthIs::Z,
        depth_at: Registration::SAME,
        take: |pose| *pose,
    };

    /// Moves a point to the direction in which the lens shows it; z is kept.
    pub(super) fn bent(&self, point: DVec3) -> DVec3 {
        if self.bend == 0.0 || point.z <= 0.0 {
            return point;
        }
        let true_radius = point.truncate().length() / point.z;
        // Newton's method, stopped after five steps, because a strongly distorting lens shows some
        // points in no direction.
        let mut seen = true_radius;
        for _ in 0..5 {
            let slope = (1.0 + 3.0 * self.bend * seen * seen).max(0.1);
            seen -= (seen * (1.0 + self.bend * seen * seen) - true_radius) / slope;
        }
        let by = seen / true_radius.max(1e-12);
        DVec3::new(point.x * by, point.y * by, point.z)
    }

    /// The true ray, at z = 1, that the lens shows in the direction `seen`; the inverse of [`Self::bent`].
    pub(super) fn straight(&self, seen: DVec3) -> DVec3 {
        if self.bend == 0.0 {
            return seen;
        }
        let by = 1.0 + self.bend * seen.truncate().length_squared();
        DVec3::new(seen.x * by, seen.y * by, 1.0)
    }
}

/// Number of tiles into which a picture is divided, to compare the losses of the tiles separately.
pub(super) const TILES: usize = 4;
/// Distance at which the texture of a view is measured, in reduced pixels.
const STEP: f64 = 3.0;
/// Relative difference in depth at which the loss saturates.
const DEPTH_SCALE: f64 = 0.1;
/// Difference in colour, in levels, at which the loss saturates.
pub(super) const COLOUR_SCALE: f64 = 32.0;
/// Agreement of depths is measured only if at least this fraction of the samples land on a pixel with depth.
pub(super) const ENOUGH: f64 = 0.05;
/// An exposure is measured only if at least this many colours were compared.
const MIN_COMPARED: usize = 200;
/// Depths agree if their relative difference is at most this.
pub(super) const TOLERANCE: f64 = 0.05;

/// Number of samples in a chunk. Each step of the comparison runs for a whole chunk before the next
/// step starts, so that a mispredicted branch costs the time of one step instead of all steps.
const CHUNK: usize = 64;

/// A sample that lands inside the other view.
#[derive(Debug, Clone, Copy, Default)]
struct Landing {
    /// Position in the other view, in reduced pixels.
    place: DVec2,
    /// z-depth in the other view's camera, in the unit of the poses.
    z: f64,
    tile: usize,
    colour: [f32; 3],
    /// Loss of the sample's depth; `None` if the other view has no depth at `place`.
    by_depth: Option<f64>,
}

/// Statistics on how well the samples of one view, projected into another view, match it.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct Explained {
    pub(super) samples: usize,
    /// Per quarter of the picture: the number of samples that land inside the other view, and the sum of their losses
    /// (0 to 1 each).
    pub(super) tiles: [(usize, f64); TILES],
    /// Number of samples that land on a pixel with depth.
    met: usize,
    /// Number of samples among `met` whose depth agrees within [`TOLERANCE`].
    agreeing: usize,
    /// Number of samples whose colours were compared.
    pub(super) compared: usize,
    /// Sum of squared colour differences of the `compared` samples.
    pub(super) squares: f64,
    /// Sums of squared levels of the `compared` samples, in their own view and in the other view.
    levels: [f64; 2],
    /// Number of examined places in the other view where samples land, and the sum of their squared colour differences
    /// from the places [`STEP`] to their right.
    texture: (usize, f64),
}

impl Explained {
    /// Projects every `stride`-th sample of `a` into `b`.
    pub(super) fn new(
        (a, samples): (&SmallView, &[Sample]),
        b: &SmallView,
        (pose_a, pose_b): (&RigidTransform, &RigidTransform),
        reading: &Reading,
        stride: usize,
    ) -> Self {
        let camera = |k: &Intrinsics, focal: DVec2| {
            let (cx, cy) = if reading.centre_swapped {
                (k.cy, k.cx)
            } else {
                (k.cx, k.cy)
            };
            let off = reading.centre_off * f64::from(k.width);
            let (cx, cy) = (cx + off.x, cy + off.y);
            let (fx, fy) = (k.fx * focal.x, k.fy * focal.y);
            Intrinsics {
                fx,
                fy,
                cx,
                cy,
                ..*k
            }
        };
        let [focal_a, focal_b] = reading.focal;
        let (camera_a, camera_b) = (camera(&a.camera, focal_a), camera(&b.camera, focal_b));
        let [times_a, times_b] = reading.depth_times;
        let pose = |pose: &RigidTransform, times: f64| {
            let mut taken = (reading.take)(pose);
            taken.translation *= times;
            taken
        };
        let [pose_a, pose_b] = [
            pose(pose_a, reading.pose_times[0]),
            pose(pose_b, reading.pose_times[1]),
        ];
        let mut b_from_a = pose_b.after(&pose_a.inverse());
        b_from_a.translation *= reading.scale;
        let mut explained = Self::default();
        let mut landings = [Landing::default(); CHUNK];
        for start in (0..samples.len()).step_by(CHUNK * stride) {
            let chunk = samples[start..].iter().step_by(stride).take(CHUNK);
            explained.samples += chunk.len();
            let mut n = 0;
            for sample in chunk {
                let depth = match reading.depth_at {
                    Registration::SAME => sample.depth,
                    at => at
                        .depth_at(a, sample.middle())
                        .map_or(sample.depth, |found| found.0),
                };
                let from = reading.straight(ray(&camera_a, sample.middle()));
                let point = b_from_a.apply(from * reading.depth.z(times_a * depth, from));
                let seen = reading.bent(point);
                let place = DVec2::new(
                    camera_b.fx * seen.x / seen.z + camera_b.cx,
                    camera_b.fy * seen.y / seen.z + camera_b.cy,
                );
                let right = usize::from(2 * sample.x >= camera_a.width);
                let below = usize::from(2 * sample.y >= camera_a.height);
                landings[n] = Landing {
                    place,
                    z: point.z,
                    tile: right + 2 * below,
                    colour: sample.colour,
                    by_depth: None,
                };
                n += usize::from((seen.z > 0.0) & camera_b.contains(place));
            }
            let landings = &mut landings[..n];
            let n = explained.compare_depths(landings, (b, &camera_b, times_b), reading);
            explained.compare_colours(&landings[..n], b);
        }
        explained
    }

    /// Compares the depths of samples that land in `b`, and adds their loss where it is saturated.
    /// Moves the other landings, whose loss also depends on colours, to the front of `landings`,
    /// and returns their number. `camera_b` and the depth factor `times_b` are those of `b` under
    /// `reading`.
    fn compare_depths(
        &mut self,
        landings: &mut [Landing],
        (b, camera_b, times_b): (&SmallView, &Intrinsics, f64),
        reading: &Reading,
    ) -> usize {
        let mut left = 0;
        for i in 0..landings.len() {
            let mut landing = landings[i];
            let found = reading.depth_at.depth_at(b, landing.place);
            let (read, middle) = found.unwrap_or((1.0, landing.place));
            let ray = reading.straight(ray(camera_b, middle));
            let there = reading.depth.z(times_b * read, ray);
            let (one, other) = reading.depth.compared(there, landing.z);
            let met = found.is_some();
            self.met += usize::from(met);
            self.agreeing += usize::from(met & ((one - other).abs() <= TOLERANCE * other));
            // Approximates the logarithm of the ratio, to 1e-4 up to where the loss saturates.
            let loss = 2.0 / DEPTH_SCALE * ((one - other) / (one + other)).abs();
            let saturated = met & (loss >= 1.0);
            let tile = &mut self.tiles[landing.tile];
            tile.0 += 1;
            tile.1 += f64::from(u8::from(saturated));
            landing.by_depth = met.then_some(loss);
            landings[left] = landing;
            left += usize::from(!saturated);
        }
        left
    }

    /// Compares the colours of samples that land in `b`, and adds the losses of these samples.
    fn compare_colours(&mut self, landings: &[Landing], b: &SmallView) {
        for landing in landings {
            let tile = &mut self.tiles[landing.tile];
            let Some(colour) = b.colour_at(landing.place) else {
                tile.1 += landing.by_depth.unwrap_or(0.5);
                continue;
            };
            let sum_of_squares = |colour: [f32; 3]| colour.iter().map(|v| v * v).sum::<f32>();
            let squares = sum_of_squares(std::array::from_fn(|i| landing.colour[i] - colour[i]));
            self.compared += 1;
            self.squares += f64::from(squares);
            for (sum, colour) in self.levels.iter_mut().zip([landing.colour, colour]) {
                *sum += f64::from(sum_of_squares(colour));
            }
            if self.compared.is_multiple_of(4)
                && let Some(beside) = b.colour_at(landing.place + STEP * DVec2::X)
            {
                let step = sum_of_squares(std::array::from_fn(|i| beside[i] - colour[i]));
                self.texture.0 += 1;
                self.texture.1 += f64::from(step);
            }
            let by_colour = (f64::from((squares / 3.0).sqrt()) / COLOUR_SCALE).min(1.0);
            tile.1 += landing
                .by_depth
                .map_or(by_colour, |by_depth| (by_depth + by_colour) / 2.0);
        }
    }

    pub(super) fn landed(&self) -> usize {
        self.tiles.iter().map(|tile| tile.0).sum()
    }

    pub(super) fn loss(&self) -> f64 {
        self.tiles.iter().map(|tile| tile.1).sum()
    }

    pub(super) fn add(&mut self, other: &Self) {
        self.samples += other.samples;
        for (tile, other) in self.tiles.iter_mut().zip(&other.tiles) {
            *tile = (tile.0 + other.0, tile.1 + other.1);
        }
        self.met += other.met;
        self.agreeing += other.agreeing;
        self.compared += other.compared;
        self.squares += other.squares;
        for (sum, other) in self.levels.iter_mut().zip(other.levels) {
            *sum += other;
        }
        self.texture.0 += other.texture.0;
        self.texture.1 += other.texture.1;
    }

    /// Fraction of all samples whose depth agrees with the other view's depth.
    pub(super) fn agreement(&self) -> f64 {
        self.agreeing as f64 / self.samples.max(1) as f64
    }

    /// Mean squared difference of colours between the places where samples land and places beside them.
    pub(super) fn texture(&self) -> f64 {
        self.texture.1 / self.texture.0.max(1) as f64
    }

    /// Root mean square difference of colours, in levels; `None` if no colours were compared.
    pub(super) fn colour_levels(&self) -> Option<f64> {
        (self.compared > 0).then(|| (self.squares / (3 * self.compared) as f64).sqrt())
    }

    /// The best-fitting factor from this view's levels to the other view's, and the root mean
    /// square colour difference after applying it, in levels; `None` if too few colours were
    /// compared.
    pub(super) fn exposure(&self) -> Option<(f64, f64)> {
        let [own, other] = self.levels;
        let mixed = (own + other - self.squares) / 2.0;
        (self.compared >= MIN_COMPARED && own > 0.0).then(|| {
            let left = (other - mixed * mixed / own).max(0.0);
            (mixed / own, (left / (3 * self.compared) as f64).sqrt())
        })
    }

    pub(super) fn meets_depth(&self) -> bool {
        self.met > 0
    }

    /// Fraction of agreeing depths among the samples that land on a pixel with depth; `None` if too few samples land
    /// there.
    pub(super) fn agreeing_where_met(&self) -> Option<f64> {
        let enough = self.met > 0 && self.met as f64 >= ENOUGH * self.samples as f64;
        enough.then(|| self.agreeing as f64 / self.met as f64)
    }
}
