//! Colours from integer noise, in linear light.

use glam::DVec3;
use sharp::random::{SplitMix64, mix, unit};

use super::arithmetic::floor;
use super::shapes::Meeting;

#[derive(Debug, Clone)]
pub(super) struct Texture {
    seed: u64,
    colors: [DVec3; 2],
    pattern: Pattern,
    /// Size of the pattern's elements in metres.
    scale: f64,
}

#[derive(Debug, Clone, Copy)]
enum Pattern {
    Checker,
    Stripes,
    Bricks,
    Clouds,
}

impl Texture {
    /// A random texture whose elements are about `scale` metres in size.
    pub(super) fn random(random: &mut SplitMix64, scale: f64) -> Self {
        let mut color = |low, high| {
            let color = DVec3::new(
                random.between(low, high),
                random.between(low, high),
                random.between(low, high),
            );
            // Desaturated: most of what a camera sees is not colourful.
            let gray = (color.x + color.y + color.z) / 3.0;
            DVec3::splat(gray) + (color - gray) * 0.55
        };
        let colors = [color(0.02, 0.35), color(0.25, 0.9)];
        let pattern = match random.next_u64() % 4 {
            0 => Pattern::Checker,
            1 => Pattern::Stripes,
            2 => Pattern::Bricks,
            _ => Pattern::Clouds,
        };
        Self {
            seed: random.next_u64(),
            colors,
            pattern,
            scale: scale * random.between(0.7, 1.4),
        }
    }

    /// Albedo at the point where a ray hits the surface, 0..1 per channel.
    pub(super) fn color(&self, meeting: &Meeting) -> DVec3 {
        let p = meeting.local / self.scale;
        let (u, v) = match meeting.across {
            0 => (p.y, p.z),
            1 => (p.x, p.z),
            _ => (p.x, p.y),
        };
        let fine = fractal_noise(self.seed, p * 4.0, 4);
        let choice = match self.pattern {
            Pattern::Checker => parity(floor(u) + floor(v)),
            Pattern::Stripes => parity(floor(u + 0.5 * v + 0.6 * fine)),
            Pattern::Bricks => {
                let row = floor(v * 2.0);
                let along = u + 0.5 * parity(row);
                let (x, y) = (along - floor(along), v * 2.0 - row);
                f64::from(u8::from(x > 0.05 && y > 0.1))
            }
            Pattern::Clouds => {
                smooth(((fractal_noise(self.seed ^ 1, p, 3) - 0.3) * 2.5).clamp(0.0, 1.0))
            }
        };
        let base = self.colors[0] + (self.colors[1] - self.colors[0]) * choice;
        base * (0.55 + 0.9 * fine)
    }
}

/// Radiance of the sky in a direction: brighter towards the horizon, with clouds.
pub(super) fn sky(seed: u64, direction: DVec3) -> DVec3 {
    let up = (-direction.y / direction.length()).max(0.0);
    let plane = DVec3::new(direction.x, direction.y, 1.0) * (3.0 / direction.length());
    let clouds = smooth(((fractal_noise(seed, plane, 4) - 0.45) * 4.0).clamp(0.0, 1.0));
    let blue = DVec3::new(0.45, 0.65, 0.95) * (1.0 - 0.7 * up);
    blue + (DVec3::splat(0.92) - blue) * (0.7 * clouds)
}

/// Several octaves of value noise, each half as strong as the previous one; about 0..1.
fn fractal_noise(seed: u64, point: DVec3, octaves: u32) -> f64 {
    let (mut sum, mut weight, mut total, mut p) = (0.0, 1.0, 0.0, point);
    for octave in 0..octaves {
        sum += weight * value_noise(seed.wrapping_add(u64::from(octave)), p);
        total += weight;
        weight *= 0.5;
        p *= 2.0;
    }
    sum / total
}

/// SplitMix64 values on the integer lattice, interpolated smoothly; 0..1.
fn value_noise(seed: u64, point: DVec3) -> f64 {
    let cell = DVec3::new(floor(point.x), floor(point.y), floor(point.z));
    let f = point - cell;
    let blend = DVec3::new(smooth(f.x), smooth(f.y), smooth(f.z));
    let lattice =
        |start: f64, step: u64, below: u64| mix((start as i64 as u64).wrapping_add(step) ^ below);
    let lerp = |a: f64, b: f64, t: f64| a + (b - a) * t;
    let edge = |below| {
        let corner = |step| unit(lattice(cell.x, step, below));
        lerp(corner(0), corner(1), blend.x)
    };
    let face = |below| {
        let row = |step| edge(lattice(cell.y, step, below));
        lerp(row(0), row(1), blend.y)
    };
    let layer = |step| face(lattice(cell.z, step, seed));
    lerp(layer(0), layer(1), blend.z)
}

/// Smooth step from 0 at t = 0 to 1 at t = 1: 3t² − 2t³.
fn smooth(t: f64) -> f64 {
    t * t * (3.0 - 2.0 * t)
}

/// 0 for even integers, 1 for odd ones.
fn parity(n: f64) -> f64 {
    n - 2.0 * floor(n * 0.5)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_is_continuous_and_varies() {
        let mut previous = value_noise(1, DVec3::new(-2.0, 0.3, 0.7));
        let (mut low, mut high) = (1.0_f64, 0.0_f64);
        for i in 1..4000 {
            let next = value_noise(1, DVec3::new(-2.0 + f64::from(i) * 0.01, 0.3, 0.7));
            assert!((next - previous).abs() < 0.02);
            (low, high, previous) = (low.min(next), high.max(next), next);
        }
        assert!(low < 0.3 && high > 0.7, "{low} {high}");
    }

    #[test]
    fn parity_holds_below_zero() {
        assert_eq!(
            [parity(-3.0), parity(-2.0), parity(0.0), parity(5.0)],
            [1.0, 0.0, 0.0, 1.0]
        );
    }
}
