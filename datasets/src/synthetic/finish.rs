//! Mirrors and panes of glass: weights and paths of the light that they reflect and transmit.

use glam::DVec3;

/// A surface without colour of its own.
#[derive(Debug, Clone, Copy)]
pub(super) enum Finish {
    /// Reflects a fixed fraction of each colour, and transmits nothing.
    Mirror { reflectance: DVec3 },
    /// A plane-parallel slab. The object's surface is the face that the ray enters.
    Glass {
        /// Index of refraction, above 1.
        index: f64,
        thickness_m: f64,
        /// For each colour, the fraction of the light entering the glass that is not absorbed inside it.
        tint: DVec3,
        /// Surfaces behind the pane within this distance, in metres, are skipped, such as the wall
        /// that a window is in.
        opening_m: f64,
    },
}

/// Light seen along a ray that hits a [`Finish`], as a weighted sum of the light along two other rays. Each has a
/// weight per colour.
#[derive(Debug)]
pub(super) struct Layers {
    /// Direction of the reflected ray, which starts at the hit point, and its weight per colour.
    pub(super) reflected: (DVec3, DVec3),
    /// Offset from the hit point at which the transmitted ray starts, in an unchanged direction,
    /// and its weight per colour.
    pub(super) transmitted: Option<(DVec3, DVec3)>,
}

impl Finish {
    /// Layers for a ray; `normal` is a unit vector that faces the ray's origin. The reflected direction has the length
    /// of `direction`.
    pub(super) fn layers(&self, normal: DVec3, direction: DVec3) -> Layers {
        let along = normal.dot(direction);
        let mirrored = direction - normal * (2.0 * along);
        match *self {
            Self::Mirror { reflectance } => Layers {
                reflected: (mirrored, reflectance),
                transmitted: None,
            },
            Self::Glass {
                index,
                thickness_m,
                tint,
                opening_m,
            } => {
                let unit = direction / direction.length();
                let cosine = -normal.dot(unit);
                let inside = refracted_cosine(index, cosine);
                let face = fresnel(index, cosine, inside);
                // Fraction that both faces reflect together, with all reflections between them.
                let reflected = 2.0 * face / (1.0 + face);
                // Snell's direction, then straight on to the end of the opening.
                let refracted = unit / index + normal * (cosine / index - inside);
                let exit = refracted * (thickness_m / inside);
                let beyond = unit * ((opening_m - thickness_m).max(0.0) / cosine);
                Layers {
                    reflected: (mirrored, DVec3::splat(reflected)),
                    transmitted: Some((exit + beyond, tint * (1.0 - reflected))),
                }
            }
        }
    }
}

/// Cosine of the angle of refraction, by Snell's law.
fn refracted_cosine(index: f64, cosine: f64) -> f64 {
    (1.0 - (1.0 - cosine * cosine) / (index * index)).sqrt()
}

/// Fraction of unpolarised light that one face reflects, by Fresnel's equations.
fn fresnel(index: f64, cosine: f64, inside: f64) -> f64 {
    let square = |x: f64| x * x;
    let across = square((cosine - index * inside) / (cosine + index * inside));
    let within = square((index * cosine - inside) / (index * cosine + inside));
    0.5 * (across + within)
}

#[cfg(test)]
mod tests {
    use super::*;

    const GLASS: Finish = Finish::Glass {
        index: 1.5,
        thickness_m: 0.01,
        tint: DVec3::ONE,
        opening_m: 0.0,
    };

    /// A ray at an angle to the normal (0, 0, −1).
    fn ray(degrees: f64) -> DVec3 {
        let (s, c) = degrees.to_radians().sin_cos();
        DVec3::new(s, 0.0, c) * 1.7
    }

    #[test]
    fn reflected_and_transmitted_light_add_up_to_the_incident_light() {
        let dark = Finish::Glass {
            index: 1.33,
            thickness_m: 0.004,
            tint: DVec3::new(0.7, 0.9, 0.8),
            opening_m: 0.3,
        };
        let mirror = Finish::Mirror {
            reflectance: DVec3::new(0.9, 0.8, 0.85),
        };
        let mut before = 0.0;
        for tenth in 0..900 {
            let direction = ray(f64::from(tenth) / 10.0);
            let total = |finish: &Finish| {
                let layers = finish.layers(DVec3::NEG_Z, direction);
                let through = layers.transmitted.map_or(DVec3::ZERO, |(_, weight)| weight);
                assert!(layers.reflected.1.min_element() >= 0.0 && through.min_element() >= 0.0);
                layers.reflected.1 + through
            };
            assert!((total(&GLASS) - DVec3::ONE).abs().max_element() < 1e-12);
            for finish in [&dark, &mirror] {
                assert!(total(finish).max_element() <= 1.0);
            }
            let (mirrored, weight) = GLASS.layers(DVec3::NEG_Z, direction).reflected;
            assert!(weight.x >= before, "more at grazing angles");
            assert_eq!(mirrored, direction * DVec3::new(1.0, 1.0, -1.0));
            before = weight.x;
        }
        assert!(before > 0.9);
    }

    #[test]
    fn weights_and_paths_are_those_of_textbooks() {
        // 4 % per face at normal incidence; 2R / (1 + R) for both.
        let straight = GLASS.layers(DVec3::NEG_Z, DVec3::Z);
        assert!((straight.reflected.1.x - 0.08 / 1.04).abs() < 1e-12);
        let (exit, _) = straight.transmitted.unwrap();
        assert!((exit - DVec3::Z * 0.01).length() < 1e-15);
        // Brewster's angle: light that oscillates in the plane of incidence is not reflected at all.
        let brewster = 1.5_f64.atan();
        let inside = refracted_cosine(1.5, brewster.cos());
        let across = ((brewster.cos() - 1.5 * inside) / (brewster.cos() + 1.5 * inside)).powi(2);
        assert!((fresnel(1.5, brewster.cos(), inside) - 0.5 * across).abs() < 1e-12);
        // Lateral shift of a slab at 45 degrees: t sin(a − b) / cos(b).
        let direction = ray(45.0);
        let (exit, _) = GLASS.layers(DVec3::NEG_Z, direction).transmitted.unwrap();
        let b = (45.0_f64.to_radians().sin() / 1.5).asin();
        let shift = 0.01 * (45.0_f64.to_radians() - b).sin() / b.cos();
        let aside = exit - direction * (exit.dot(direction) / direction.length_squared());
        assert!((aside.length() - shift).abs() < 1e-12);
    }
}
