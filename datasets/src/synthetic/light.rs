//! Sun, lamps, ambient light and sky.

use glam::DVec3;
use sharp::random::SplitMix64;

use super::paint::fractal_noise;
use super::texture;

/// Lights of a scene, in linear light.
#[derive(Debug, Clone)]
pub(super) struct Light {
    /// Unit vector towards the brightest ambient light.
    pub(super) dome: DVec3,
    /// Ambient light on surfaces that face away from `dome`, and on surfaces that face it.
    pub(super) ambient: [DVec3; 2],
    pub(super) to_sun: DVec3,
    /// Light from the sun on a surface that faces it; zero if there is no sun.
    pub(super) sun: DVec3,
    pub(super) lamps: Vec<Lamp>,
    /// Distance in metres at which half of the light comes from haze; infinite in clear air.
    pub(super) haze_m: f64,
    pub(super) sky: Sky,
    /// Factor for all light received by the camera.
    pub(super) exposure: f64,
}

/// A point light that shines in all directions.
#[derive(Debug, Clone, Copy)]
pub(super) struct Lamp {
    pub(super) place: DVec3,
    /// Approximate light on a surface that faces the lamp at a distance of one metre.
    pub(super) power: DVec3,
}

#[derive(Debug, Clone)]
pub(super) enum Sky {
    Classic {
        seed: u64,
    },
    Varied {
        seed: u64,
        horizon: DVec3,
        zenith: DVec3,
        clouds: DVec3,
        /// Approximate fraction of the sky covered by clouds.
        cover: f64,
    },
    /// A sky with a sun in it, above a ground of one colour.
    Sunlit {
        above: Box<Self>,
        ground: DVec3,
        to_sun: DVec3,
        sun: DVec3,
    },
}

impl Sky {
    /// Radiance from a direction, which need not be normalised.
    pub(super) fn radiance(&self, direction: DVec3) -> DVec3 {
        match self {
            Self::Classic { seed } => texture::sky(*seed, direction),
            Self::Varied {
                seed,
                horizon,
                zenith,
                clouds,
                cover,
            } => {
                let up = (-direction.y / direction.length()).max(0.0);
                let clear = *horizon + (*zenith - *horizon) * (up * (2.0 - up));
                // Clouds lie in a horizontal plane, so that they flatten towards the horizon.
                let place = 1.6 / (up + 0.18) / direction.length();
                let noise = fractal_noise(
                    *seed,
                    direction.x * place,
                    direction.z * place,
                    (4, 0.02 / (up + 0.05)),
                );
                let share = ((noise - 1.0 + cover) * 3.0).clamp(0.0, 1.0);
                clear + (*clouds - clear) * share
            }
            Self::Sunlit { to_sun, sun, .. } => {
                let off = 1.0 - to_sun.dot(direction) / direction.length();
                // The disc has a radius of half a degree to a degree, and a saturated colour.
                let disc = ((1.5e-4 - off) / 1.1e-4).clamp(0.0, 1.0);
                self.scattered(direction) + *sun * (30.0 * disc)
            }
        }
    }

    /// Radiance from a direction, without the sun's disc.
    fn scattered(&self, direction: DVec3) -> DVec3 {
        let Self::Sunlit {
            above,
            ground,
            to_sun,
            sun,
        } = self
        else {
            return self.radiance(direction);
        };
        let length = direction.length();
        let near_sun = 1.0 + 40.0 * (1.0 - to_sun.dot(direction) / length);
        let sky = above.radiance(direction) + *sun * (0.4 / (near_sun * near_sun));
        let below = (direction.y / length * 25.0).clamp(0.0, 1.0);
        sky + (*ground - sky) * below
    }

    pub(super) fn haze(&self) -> DVec3 {
        match self {
            Self::Classic { .. } => DVec3::ZERO,
            Self::Varied { horizon, .. } => *horizon,
            Self::Sunlit { above, .. } => above.haze(),
        }
    }

    /// Mean over all directions of the radiance without the sun's disc, and of radiance times direction, per colour.
    fn moments(&self) -> (DVec3, [DVec3; 3]) {
        const CELLS: u32 = 16;
        let (mut mean, mut first, mut total) = (DVec3::ZERO, [DVec3::ZERO; 3], 0.0);
        let edge = |cell| (2.0 * f64::from(cell) + 1.0) / f64::from(CELLS) - 1.0;
        for place in 0..6 * CELLS * CELLS {
            let (u, v) = (edge(place % CELLS), edge(place / CELLS % CELLS));
            let direction = match place / (CELLS * CELLS) {
                0 => DVec3::new(1.0, u, v),
                1 => DVec3::new(-1.0, u, v),
                2 => DVec3::new(u, 1.0, v),
                3 => DVec3::new(u, -1.0, v),
                4 => DVec3::new(u, v, 1.0),
                _ => DVec3::new(u, v, -1.0),
            };
            let length = direction.length();
            // Solid angle of a cell on a cube's face, up to a factor.
            let share = 1.0 / (length * length * length);
            let radiance = self.scattered(direction) * share;
            total += share;
            mean += radiance;
            for (axis, sum) in first.iter_mut().enumerate() {
                *sum += radiance * (direction[axis] / length);
            }
        }
        (mean / total, first.map(|sum| sum / total))
    }
}

/// Ambient light on a surface that faces away from `towards` (unit vector), and on one that faces it. Computed from a
/// sky's moments by spherical harmonics up to the first order.
fn ambient((mean, first): (DVec3, [DVec3; 3]), towards: DVec3) -> [DVec3; 2] {
    let slope = (first[0] * towards.x + first[1] * towards.y + first[2] * towards.z) * 2.0;
    [mean - slope, mean + slope].map(|light| light.max(DVec3::ZERO))
}

impl Light {
    /// The light of the classic scene.
    pub(super) fn classic(to_sun: DVec3, sky_seed: u64) -> Self {
        Self {
            dome: DVec3::NEG_Y,
            ambient: [DVec3::splat(0.38); 2],
            to_sun,
            sun: DVec3::splat(0.72),
            lamps: Vec::new(),
            haze_m: f64::INFINITY,
            sky: Sky::Classic { seed: sky_seed },
            exposure: 1.0,
        }
    }

    /// Daylight at a random hour and in random weather: a fifth of the days are overcast.
    pub(super) fn outdoors(random: &mut SplitMix64) -> Self {
        let overcast = random.below(5) == 0;
        let height = random.between(0.25, 1.6);
        let beside = DVec3::new(random.between(-1.0, 1.0), 0.0, random.between(-1.0, 0.7));
        let to_sun = (beside.normalize_or(DVec3::X) - DVec3::Y * height).normalize();
        // A low sun is warm and makes shadows blue.
        let warm = 0.5 / (height + 0.5);
        let sun = if overcast {
            DVec3::ZERO
        } else {
            DVec3::new(1.0, 1.0 - 0.35 * warm, 1.0 - 0.7 * warm) * random.between(0.5, 1.5)
        };
        let high = DVec3::new(0.85, 0.95, 1.1) * random.between(0.25, 0.55);
        let low = DVec3::new(1.0, 0.95, 0.9) * high * random.between(0.25, 0.7);
        let dome = DVec3::new(random.between(-0.5, 0.5), -1.0, random.between(-0.6, 0.3));
        let blue = random.between(0.3, 1.0);
        let gray = DVec3::splat(random.between(0.55, 0.9));
        let horizon = gray * DVec3::new(1.0, 1.0 - 0.15 * warm, 1.0 - 0.4 * warm * blue);
        let zenith = DVec3::new(0.25, 0.45, 0.85) * random.between(0.5, 1.0);
        let hazy = random.below(3) == 0;
        Self {
            dome: dome.normalize(),
            ambient: [low, high],
            to_sun,
            sun,
            lamps: Vec::new(),
            haze_m: if hazy {
                random.between(25.0, 120.0)
            } else {
                250.0
            },
            sky: Sky::Varied {
                seed: random.next_u64(),
                horizon,
                zenith: if overcast { horizon * 0.8 } else { zenith },
                clouds: gray * random.between(0.8, 1.25),
                cover: random.between(0.1, 0.8),
            },
            exposure: 1.0,
        }
    }

    /// Draws the sun, if any, into the sky. Outdoors, also computes the ambient light from this sky and the ground.
    pub(super) fn lit_by_sky(self) -> Self {
        const GROUND: DVec3 = DVec3::new(0.24, 0.22, 0.18);
        let sky = |ground| Sky::Sunlit {
            above: Box::new(self.sky.clone()),
            ground,
            to_sun: self.to_sun,
            sun: self.sun,
        };
        let [_, from_above] = ambient(sky(DVec3::ZERO).moments(), DVec3::NEG_Y);
        let ground = GROUND * (from_above + self.sun * -self.to_sun.y);
        let sky = sky(ground);
        // Indoors, there is neither haze nor a view of the whole sky.
        if self.haze_m.is_infinite() {
            return Self { sky, ..self };
        }
        let moments = sky.moments();
        let [x, y, z] = moments.1.map(|sum| sum.x + sum.y + sum.z);
        let dome = DVec3::new(x, y, z).normalize();
        Self {
            dome,
            ambient: ambient(moments, dome),
            sky,
            ..self
        }
    }

    /// Adds light from the sky through a window of `square_m` square metres in direction `to_window` (unit vector).
    pub(super) fn admit(&mut self, to_window: DVec3, square_m: f64) {
        let share = (0.12 * square_m).min(0.5);
        self.dome = to_window;
        self.ambient[1] += self.sky.scattered(to_window) * share;
    }

    /// Indoor light: from all walls, with more from one side. Lamps are added separately.
    pub(super) fn indoors(random: &mut SplitMix64) -> Self {
        let tint = DVec3::new(1.0, random.between(0.8, 1.0), random.between(0.6, 1.05));
        let high = tint * random.between(0.15, 0.5);
        let dome = DVec3::new(
            random.between(-1.0, 1.0),
            random.between(-1.0, -0.3),
            random.between(-1.0, 1.0),
        );
        Self {
            dome: dome.normalize(),
            ambient: [high * random.between(0.3, 0.75), high],
            sun: DVec3::ZERO,
            haze_m: f64::INFINITY,
            ..Self::outdoors(random)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Ambient light agrees with an integral over the hemisphere above a surface, which is computed from directions
    /// in other places.
    #[test]
    fn ambient_light_is_that_of_the_sky() {
        for seed in 0..12 {
            let light = Light::outdoors(&mut SplitMix64::new(seed)).lit_by_sky();
            for normal in [DVec3::NEG_Y, DVec3::Y, DVec3::X, DVec3::NEG_Z] {
                let across = normal.any_orthonormal_vector();
                let aside = normal.cross(across);
                let (mut sum, rays) = (DVec3::ZERO, 40);
                for place in 0..rays * rays {
                    // Cosine-weighted directions, on rings of equal weight.
                    let ring = (f64::from(place / rays) + 0.5) / f64::from(rays);
                    let turn = f64::from(place % rays) / f64::from(rays) * std::f64::consts::TAU;
                    let flat = (across * turn.cos() + aside * turn.sin()) * ring.sqrt();
                    sum += light.sky.scattered(flat + normal * (1.0 - ring).sqrt());
                }
                let exact = sum / f64::from(rays * rays);
                let half = 0.5 + 0.5 * normal.dot(light.dome);
                let found = light.ambient[0] + (light.ambient[1] - light.ambient[0]) * half;
                let brightest = light.ambient[1].max_element();
                assert!(
                    (found - exact).abs().max_element() < 0.15 * brightest,
                    "seed {seed}, {normal}: {found} {exact}"
                );
            }
        }
    }

    #[test]
    fn the_sun_is_in_the_sky_unless_it_is_overcast() {
        let (mut sunny, mut overcast) = (0, 0);
        for seed in 0..30 {
            let light = Light::outdoors(&mut SplitMix64::new(seed)).lit_by_sky();
            let at_sun = light.sky.radiance(light.to_sun * 3.0);
            if light.sun == DVec3::ZERO {
                overcast += u32::from(at_sun.max_element() < 1.5)
            } else {
                sunny += u32::from(at_sun.min_element() > 2.0)
            }
            let ground = light.sky.radiance(DVec3::Y);
            assert!(ground.max_element() < light.ambient[1].max_element() + light.sun.x);
        }
        assert_eq!(sunny + overcast, 30);
        assert!(overcast > 0);
    }
}
