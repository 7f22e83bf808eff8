//! Paints for the surfaces of varied scenes: many patterns, which fade out if they are finer than a
//! pixel. In linear light; cheaper than the classic textures.

use glam::DVec3;
use sharp::random::{SplitMix64, mix, unit};

use super::arithmetic::floor;
use super::shapes::Meeting;

/// Material of a surface, which determines its colours.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Tone {
    Any,
    Wall,
    Earth,
    Leaf,
    Wood,
    Stone,
}

#[derive(Debug, Clone, Copy, PartialEq)]
enum Pattern {
    Plain,
    Checker,
    Stripes,
    Grating,
    Bricks,
    Tiles,
    Windows,
    Planks,
    Dots,
    Rings,
    Clouds,
    Patches,
    Gradient,
}

#[derive(Debug, Clone)]
pub(super) struct Paint {
    seed: u64,
    /// The two colours of the pattern: albedo, 0..1 per channel.
    colors: [DVec3; 2],
    pattern: Pattern,
    /// Size of the pattern's elements in metres.
    scale_m: f64,
    /// Cosine and sine of the pattern's rotation.
    turn: (f64, f64),
    /// Grain on the whole surface: its strength, 0..1, and the size of a grain relative to an element of the pattern.
    grain: (f64, f64),
    /// Brightness of the light that the surface emits; 0 for surfaces that only reflect.
    pub(super) glow: f64,
}

impl Paint {
    /// A random paint whose elements are about `scale_m` metres in size.
    pub(super) fn new(random: &mut SplitMix64, tone: Tone, scale_m: f64) -> Self {
        use Pattern as P;
        let patterns: &[Pattern] = match tone {
            Tone::Any => &[
                P::Plain,
                P::Plain,
                P::Checker,
                P::Stripes,
                P::Grating,
                P::Bricks,
                P::Tiles,
                P::Dots,
                P::Rings,
                P::Clouds,
                P::Patches,
                P::Gradient,
            ],
            Tone::Wall => &[
                P::Plain,
                P::Plain,
                P::Clouds,
                P::Gradient,
                P::Bricks,
                P::Tiles,
                P::Grating,
                P::Dots,
                P::Planks,
            ],
            Tone::Earth => &[P::Clouds, P::Clouds, P::Plain, P::Tiles, P::Patches],
            Tone::Leaf => &[P::Clouds, P::Patches],
            Tone::Wood => &[P::Rings, P::Planks, P::Plain, P::Planks],
            Tone::Stone => &[P::Windows, P::Windows, P::Bricks, P::Clouds, P::Plain],
        };
        let pattern = patterns[random.below(patterns.len() as u64) as usize];
        let first = color(random, tone);
        let second = match random.below(5) {
            0 | 1 => color(random, tone),
            2 => first * random.between(0.25, 0.6),
            _ => first * random.between(0.55, 0.85),
        };
        // Most patterns are upright; a few are rotated by a right angle or an arbitrary one.
        let turn = match random.below(6) {
            0 => (0.0, 1.0),
            1 if !matches!(pattern, P::Windows | P::Bricks) => (0.8, 0.6),
            _ => (1.0, 0.0),
        };
        let rough = matches!(tone, Tone::Earth | Tone::Leaf);
        let grain = if rough {
            random.between(0.4, 0.9)
        } else {
            random.between(0.0, 0.75) * random.between(0.1, 1.0)
        };
        Self {
            seed: random.next_u64(),
            colors: [first, second],
            pattern,
            scale_m: scale_m * random.between(0.5, 1.8),
            turn: if pattern == P::Windows {
                (1.0, 0.0)
            } else {
                turn
            },
            grain: (grain, random.between(1.0, 6.0)),
            glow: 0.0,
        }
    }

    /// Paint of a light source, in warm or cool white.
    pub(super) fn shining(random: &mut SplitMix64) -> Self {
        Self {
            colors: [DVec3::new(1.0, random.between(0.85, 1.0), random.between(0.65, 1.0)); 2],
            pattern: Pattern::Plain,
            grain: (0.0, 1.0),
            glow: random.between(0.8, 1.6),
            ..Self::new(random, Tone::Any, 1.0)
        }
    }

    /// Removes the pattern and most of the grain.
    pub(super) fn make_plain(&mut self) {
        self.pattern = Pattern::Plain;
        self.grain.0 *= 0.3;
    }

    /// Albedo at the point where a ray hits the surface; `footprint_m` is the size of a pixel there, in metres.
    pub(super) fn color(&self, meeting: &Meeting, footprint_m: f64) -> DVec3 {
        let p = meeting.local;
        let (x, y) = match meeting.across {
            0 => (p.z, p.y),
            1 => (p.x, p.z),
            2 => (p.x, p.y),
            _ => (p.x + 0.7 * p.z, p.y - 0.4 * p.z),
        };
        // Each face of a box shows another part of the pattern.
        let apart = 31.7 * meeting.across as f64;
        let (c, s) = self.turn;
        let u = (c * x - s * y) / self.scale_m + apart;
        let v = (s * x + c * y) / self.scale_m + apart;
        let size = footprint_m / self.scale_m;
        // A pattern with less than two pixels per element fades to its mean.
        let keep = (0.6 / size - 0.6).clamp(0.0, 1.0);
        let mean = self.mean();
        let choice = if keep > 0.0 {
            mean + (self.pattern_at(u, v, size) - mean) * keep
        } else {
            mean
        };
        let base = self.colors[0] + (self.colors[1] - self.colors[0]) * choice;
        let (strength, fineness) = self.grain;
        if strength < 0.02 {
            return base;
        }
        let octaves = (3, size * fineness);
        let noise = fractal_noise(self.seed ^ 1, u * fineness, v * fineness, octaves);
        base * (1.0 + strength * (2.0 * noise - 1.0))
    }

    /// Fraction of the second colour, 0..1, averaged over a square around the position (u, v).
    /// Position and side `size` are in units of pattern elements.
    fn pattern_at(&self, u: f64, v: f64, size: f64) -> f64 {
        let (column, row) = (floor(u), floor(v));
        let (x, y) = (u - column, v - row);
        let (i, j) = (column as i64, row as i64);
        match self.pattern {
            Pattern::Plain => 0.5,
            Pattern::Checker => 0.5 - 0.5 * square_wave(u, size) * square_wave(v, size),
            Pattern::Stripes => 0.5 - 0.5 * square_wave(u, size),
            Pattern::Grating => triangle(x),
            Pattern::Bricks => {
                let row = floor(v * 2.0);
                let along = u + 0.5 * odd(row);
                let joints = band(along - floor(along), 0.03, 0.03, size);
                either(joints, band(v * 2.0 - row, 0.06, 0.06, 2.0 * size))
            }
            Pattern::Tiles => either(band(x, 0.03, 0.03, size), band(y, 0.03, 0.03, size)),
            Pattern::Windows => {
                let pane = band(x, 0.5, 0.27, size) * band(y, 0.5, 0.33, size);
                pane * (0.55 + 0.45 * lattice(self.seed, i, j))
            }
            Pattern::Planks => {
                let end = floor(u * 0.15 + row * 0.37);
                let plank = 0.7 * lattice(self.seed, j, end as i64);
                plank + (1.0 - plank) * band(y, 0.025, 0.025, size)
            }
            Pattern::Dots => {
                let (dx, dy) = (x - 0.5, y - 0.5);
                let inwards = 0.316 - (dx * dx + dy * dy).sqrt();
                (inwards / size + 0.5).clamp(0.0, 1.0)
            }
            Pattern::Rings => {
                let bent = fractal_noise(self.seed, u * 0.7, v * 0.25, (2, size));
                let place = 2.0 * u + 4.0 * bent;
                triangle(place - floor(place))
            }
            Pattern::Clouds => {
                let noise = fractal_noise(self.seed, u, v, (3, size));
                smooth(((noise - 0.3) * 2.5).clamp(0.0, 1.0))
            }
            Pattern::Patches => blended(self.seed, u - 0.5, v - 0.5, |t| {
                ((t - 0.5) / size + 0.5).clamp(0.0, 1.0)
            }),
            Pattern::Gradient => triangle(0.1 * v - floor(0.1 * v)),
        }
    }

    fn mean(&self) -> f64 {
        match self.pattern {
            Pattern::Bricks => 0.17,
            Pattern::Tiles => 0.12,
            Pattern::Windows => 0.28,
            Pattern::Planks => 0.38,
            Pattern::Dots => 0.31,
            _ => 0.5,
        }
    }
}

/// A random albedo.
fn color(random: &mut SplitMix64, tone: Tone) -> DVec3 {
    let mut channel = |low, high| random.between(low, high);
    let any = DVec3::new(channel(0.0, 1.0), channel(0.0, 1.0), channel(0.0, 1.0));
    let bright = channel(0.0, 1.0);
    let vivid = channel(0.0, 1.0);
    // Base colour, how far single channels may deviate from it, and range of its brightness.
    let (base, stray, low, high) = match tone {
        // Most objects are not colourful.
        Tone::Any => (DVec3::splat(0.5), 0.2 + 0.8 * vivid * vivid, 0.06, 1.4),
        Tone::Wall => (DVec3::new(0.62, 0.6, 0.55), 0.3 * vivid, 0.5, 1.4),
        Tone::Earth => (DVec3::new(0.3, 0.27, 0.2), 0.3, 0.4, 1.5),
        Tone::Leaf => (DVec3::new(0.15, 0.25, 0.07), 0.25, 0.4, 1.6),
        Tone::Wood => (DVec3::new(0.42, 0.27, 0.15), 0.2, 0.25, 1.6),
        Tone::Stone => (DVec3::new(0.5, 0.46, 0.42), 0.45 * vivid, 0.35, 1.4),
    };
    let strayed = base * (DVec3::ONE + (any * 2.0 - DVec3::ONE) * stray);
    (strayed * (low + (high - low) * bright)).clamp(DVec3::splat(0.02), DVec3::splat(0.9))
}

/// Value noise of up to `octaves` octaves, each half as strong as the one before. Octaves finer
/// than a pixel of `size` are omitted. About 0..1 with mean 0.5.
pub(super) fn fractal_noise(seed: u64, u: f64, v: f64, (octaves, size): (u32, f64)) -> f64 {
    let (mut sum, mut weight, mut total) = (0.0, 1.0, 0.0);
    let (mut u, mut v, mut size) = (u, v, size);
    for octave in 0..octaves {
        total += weight;
        let keep = (1.0 / size - 1.0).clamp(0.0, 1.0);
        if keep > 0.0 {
            let noise = value_noise(seed.wrapping_add(u64::from(octave)), u, v);
            sum += weight * keep * (noise - 0.5);
        }
        weight *= 0.5;
        (u, v, size) = (u * 2.0 + 0.31, v * 2.0 + 0.17, size * 2.0);
    }
    0.5 + sum / total
}

/// Random values on a square lattice, interpolated smoothly; 0..1.
fn value_noise(seed: u64, u: f64, v: f64) -> f64 {
    blended(seed, u, v, smooth)
}

/// Random values on a square lattice. `blend` maps the fractional position between two neighbours
/// to the weight of the farther one.
fn blended(seed: u64, u: f64, v: f64, blend: impl Fn(f64) -> f64) -> f64 {
    let (column, row) = (floor(u), floor(v));
    let (x, y) = (blend(u - column), blend(v - row));
    let (i, j) = (column as i64, row as i64);
    let along = |j| {
        let (a, b) = (lattice(seed, i, j), lattice(seed, i.wrapping_add(1), j));
        a + (b - a) * x
    };
    let (a, b) = (along(j), along(j.wrapping_add(1)));
    a + (b - a) * y
}

/// 1 on even elements and −1 on odd ones, averaged over `size` elements (at most 1).
fn square_wave(t: f64, size: f64) -> f64 {
    let element = floor(t);
    let to_edge = 0.5 - (t - element - 0.5).abs();
    (1.0 - 2.0 * odd(element)) * (2.0 * to_edge / size).min(1.0)
}

/// Fraction covered by a band around `middle` of half width `half`, which repeats in every element;
/// averaged over `size` elements around `place`. All positions are in elements, 0..1.
fn band(place: f64, middle: f64, half: f64, size: f64) -> f64 {
    let off = (place - middle).abs();
    let off = off.min(1.0 - off);
    ((half + 0.5 * size - off) / size).clamp(0.0, (2.0 * half / size).min(1.0))
}

/// Fraction covered by at least one of two independent patterns.
fn either(a: f64, b: f64) -> f64 {
    a + b - a * b
}

/// Random value of a lattice point, 0..1, with one round of mixing instead of splitmix64's two.
fn lattice(seed: u64, i: i64, j: i64) -> f64 {
    let z = (i as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15)
        ^ (j as u64).wrapping_mul(0xC2B2_AE3D_27D4_EB4F)
        ^ seed;
    let z = (z ^ (z >> 29)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    unit(z ^ (z >> 32))
}

/// Smooth step from 0 at t = 0 to 1 at t = 1: 3t² − 2t³.
fn smooth(t: f64) -> f64 {
    t * t * (3.0 - 2.0 * t)
}

/// Rises from 0 to 1 and falls back to 0 over 0..1.
fn triangle(t: f64) -> f64 {
    1.0 - (2.0 * t - 1.0).abs()
}

/// 0 for even integers, 1 for odd ones.
fn odd(n: f64) -> f64 {
    n - 2.0 * floor(n * 0.5)
}

/// Derives an independent seed from a seed and a number.
pub(super) fn derived(seed: u64, number: u64) -> u64 {
    mix(mix(seed ^ 0x5EED_0FA5_CE9E_5EED).wrapping_add(number))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn noise_is_continuous_varies_and_fades_to_its_mean() {
        let mut previous = value_noise(3, -2.0, 0.3);
        let (mut low, mut high) = (1.0_f64, 0.0_f64);
        for i in 1..4000 {
            let next = value_noise(3, -2.0 + f64::from(i) * 0.01, 0.3);
            assert!((next - previous).abs() < 0.02);
            (low, high, previous) = (low.min(next), high.max(next), next);
        }
        assert!(low < 0.2 && high > 0.8, "{low} {high}");
        assert_eq!(fractal_noise(3, 0.4, 0.7, (4, 2.0)), 0.5);
    }

    #[test]
    fn patterns_are_their_means_from_afar() {
        let mut random = SplitMix64::new(1);
        let meeting = |x: f64, y: f64| Meeting {
            distance: 1.0,
            normal: DVec3::NEG_Z,
            local: DVec3::new(x, y, 0.0),
            across: 2,
        };
        for tone in [Tone::Any, Tone::Wall, Tone::Earth, Tone::Wood, Tone::Stone] {
            for _ in 0..20 {
                let paint = Paint {
                    grain: (0.0, 1.0),
                    ..Paint::new(&mut random, tone, 0.1)
                };
                let mut sum = DVec3::ZERO;
                for i in 0..10_000 {
                    let (x, y) = (f64::from(i % 100) * 0.031, f64::from(i / 100) * 0.027);
                    sum += paint.color(&meeting(x * 9.0, y * 9.0), 1e-9);
                }
                let far = paint.color(&meeting(0.2, 0.3), 10.0);
                let contrast = (paint.colors[0] - paint.colors[1]).length();
                let apart = (sum / 10_000.0 - far).length();
                assert!(apart <= 0.12 * contrast + 0.001, "{paint:?}: {apart}");
            }
        }
    }
}
