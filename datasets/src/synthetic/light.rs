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
    /// Ambient light on surfaces that face away from `dome` and on those that face it.
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
        }
    }

    pub(super) fn haze(&self) -> DVec3 {
        match self {
            Self::Classic { .. } => DVec3::ZERO,
            Self::Varied { horizon, .. } => *horizon,
        }
    }
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
        let sun = match overcast {
            true => DVec3::ZERO,
            false => {
                DVec3::new(1.0, 1.0 - 0.35 * warm, 1.0 - 0.7 * warm) * random.between(0.5, 1.5)
            }
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
