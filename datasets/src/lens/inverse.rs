//! Inverse distortion: from distorted coordinates to the ray, and the radius within which the
//! inverse exists.

use glam::DVec2;

use super::Distortion;

impl Distortion {
    /// Converts the coordinates that [`Self::bend`] acts on to normalised coordinates; `None` for
    /// rays of a fisheye at 90° and beyond.
    pub(super) fn straightened(&self, bent: DVec2) -> Option<DVec2> {
        if !self.is_fisheye() {
            return Some(bent);
        }
        let theta = bent.length();
        if theta >= std::f64::consts::FRAC_PI_2 {
            return None;
        }
        let scale = if theta < 1e-9 {
            1.0
        } else {
            theta.tan() / theta
        };
        Some(bent * scale)
    }

    /// Newton's iteration on [`Self::bend`], with halved steps if a full step does not reduce the
    /// error.
    pub(super) fn invert(&self, distorted: DVec2) -> Option<DVec2> {
        if !distorted.is_finite() {
            return None;
        }
        if *self == Self::None {
            return Some(distorted);
        }
        let mut x = distorted;
        // The polynomial may diverge far outside, so start where it is close to the identity.
        let mut error = self.bend(x) - distorted;
        if error.length_squared() > x.length_squared() {
            x = DVec2::ZERO;
            error = self.bend(x) - distorted;
        }
        let rounding = 1e-15 * (1.0 + distorted.length());
        for _ in 0..100 {
            if error.length_squared() <= rounding * rounding {
                break;
            }
            let step = self.bend_slope(x).inverse() * error;
            if !step.is_finite() {
                return None;
            }
            let mut fraction = 1.0;
            let next = loop {
                let candidate = x - step * fraction;
                let next_error = self.bend(candidate) - distorted;
                if next_error.length_squared() < error.length_squared() {
                    break Some((candidate, next_error));
                }
                fraction *= 0.5;
                if fraction < 1e-3 {
                    break None;
                }
            };
            // At the limit of rounding, no step reduces the error.
            let Some((candidate, next_error)) = next else {
                break;
            };
            (x, error) = (candidate, next_error);
        }
        let converged = error.length() <= 1e3 * rounding;
        converged.then_some(x)
    }

    /// True if [`Self::bend`] preserves orientation at `x`, i.e. the distortion does not fold back
    /// there.
    fn is_unfolded_at(&self, x: DVec2) -> bool {
        let slope = self.bend_slope(x);
        slope.determinant() > 0.0 && (slope * x).dot(x) > 0.0 || x == DVec2::ZERO
    }

    /// Radius within which the distortion does not fold back, accurate to 1/128, in normalised
    /// coordinates (for fisheyes, the angle in radians). Infinite for a pinhole, at most 10 (84°)
    /// for perspective lenses.
    pub(super) fn fold_radius(&self) -> f64 {
        if *self == Self::None {
            return f64::INFINITY;
        }
        let limit = if self.is_fisheye() {
            std::f64::consts::FRAC_PI_2
        } else {
            10.0
        };
        let unfolded = |radius: f64| {
            (0..8).all(|i| {
                let (sine, cosine) = (f64::from(i) * std::f64::consts::FRAC_PI_4).sin_cos();
                self.is_unfolded_at(DVec2::new(cosine, sine) * radius)
            })
        };
        (1..)
            .map(|i| f64::from(i) / 128.0)
            .find(|radius| *radius >= limit || !unfolded(*radius))
            .map_or(limit, |radius| radius.min(limit))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::lens::Lens;
    use glam::DVec3;

    #[test]
    fn folded_polynomials_are_not_inverted_nor_projected() {
        // 1 − r² folds back at r = 1/√3, where the distorted radius is 0.385.
        let fold = Distortion::perspective("RADIAL", &[-1.0], [0.0; 2]);
        let with = |model| Lens::new((100.0, 100.0), (50.0, 50.0), (100, 100), model).unwrap();
        let lens = with(fold);
        assert!(lens.unproject(DVec2::new(88.0, 50.0)).is_some());
        assert!(lens.unproject(DVec2::new(90.0, 50.0)).is_none());
        let outside = DVec3::new(1.0, 0.0, 1.0);
        assert!(lens.project(outside).is_some());
        assert!(lens.project_unfolded(outside).is_none());
        let fisheye = with(Distortion::OpenCvFisheye { k: [0.0; 4] });
        assert!(fisheye.unproject(DVec2::new(210.0, 50.0)).is_none());
        assert!(fisheye.unproject(DVec2::new(f64::NAN, 50.0)).is_none());
    }
}
