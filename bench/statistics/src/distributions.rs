//! The normal distribution, and Student's t distribution with any positive degrees of freedom.

use std::f64::consts::{FRAC_PI_2, PI, SQRT_2};

use crate::numeric::{integrate, root};

/// P(Z > x) of a standard normal Z, to 14 digits in either tail.
pub fn normal_tail(x: f64) -> f64 {
    if x < 0.0 {
        return 1.0 - normal_tail(-x);
    }
    // exp(−(x + v)²/2) without its factor exp(−x²/2), which determines the magnitude of the tail.
    let rest = integrate(10.0 / (1.0 + 0.2 * x), |v| (-v * (x + 0.5 * v)).exp());
    (-0.5 * x * x).exp() * rest / (SQRT_2 * PI.sqrt())
}

/// The x with P(Z ≤ x) = `p`, for `p` in 0..1; infinite at the ends.
pub fn normal_quantile(p: f64) -> f64 {
    let tail = p.min(1.0 - p);
    if tail <= 0.0 {
        return if p > 0.5 {
            f64::INFINITY
        } else {
            f64::NEG_INFINITY
        };
    }
    let x = root(0.0, 37.0, |x| normal_tail(x).ln() - tail.ln());
    if p > 0.5 { x } else { -x }
}

/// P(|T| > t) of Student's T; `t` ≥ 0, infinite allowed.
pub fn t_two_sided(t: f64, degrees_of_freedom: f64) -> f64 {
    // T = √ν cot ψ with the density of ψ proportional to sin^(ν−1) ψ.
    let root = degrees_of_freedom.sqrt();
    let below = |end: f64| {
        // More than `reach` below `end`, the density is less than e⁻⁴⁴ of its value at `end`, and
        // is left out. The density falls at least as fast as a normal density, and at least at the
        // exponential rate that it has at `end`.
        let reach = (9.5 / root).min(45.0 * end.tan() / (degrees_of_freedom - 1.0).max(1e-9));
        let start = (end - reach).max(0.0);
        integrate(end - start, |v| {
            (start + v).sin().powf(degrees_of_freedom - 1.0)
        })
    };
    below(root.atan2(t)) / below(FRAC_PI_2)
}

/// The t with P(|T| > t) = `alpha`.
pub fn t_critical(alpha: f64, degrees_of_freedom: f64) -> f64 {
    let tail = |log: f64| t_two_sided(log.exp(), degrees_of_freedom).max(f64::MIN_POSITIVE);
    root(-20.0, 40.0, |log| tail(log).ln() - alpha.ln()).exp()
}

/// The true mean, in standard errors, that the two-sided t test at level `alpha` detects with probability `power`: the
/// noncentrality at which |T| exceeds its critical value with that probability.
pub fn detectable_shift(power: f64, alpha: f64, degrees_of_freedom: f64) -> f64 {
    let nu = degrees_of_freedom;
    let critical = t_critical(alpha, nu);
    // T = (Z + shift) / U, where U² is a χ² over its degrees of freedom, with mode 1 and this density, unnormalised.
    let density = |u: f64| ((nu - 1.0) * u.ln() - 0.5 * nu * (u * u - 1.0)).exp();
    let (start, end) = ((1.0 - 10.0 / nu.sqrt()).max(0.0), 1.0 + 10.0 / nu.sqrt());
    let mean = |g: &dyn Fn(f64) -> f64, step: f64| {
        // The quadrature resolves the ends of an interval best, so split at the mode and at the step of g.
        let step = step.clamp(start, end);
        let ends = [start, step.min(1.0), step.max(1.0), end];
        let parts = ends
            .windows(2)
            .filter(|part| part[0] < part[1])
            .map(|part| integrate(part[1] - part[0], |v| density(part[0] + v) * g(part[0] + v)));
        parts.sum::<f64>()
    };
    let all = mean(&|_| 1.0, 1.0);
    let missed = |shift: f64| {
        let exceeds =
            |u: f64| normal_tail(critical * u - shift) + normal_tail(critical * u + shift);
        power - mean(&exceeds, shift / critical) / all
    };
    root(0.0, 3.0 * (critical + 2.0), missed)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn assert_close(ours: f64, reference: f64, allowed: f64) {
        assert!(
            (ours / reference - 1.0).abs() < allowed,
            "{ours} for {reference}"
        );
    }

    // References were computed with scipy 1.17.1. Those of `detectable_shift` were computed with scipy's quadrature and
    // confirmed with statsmodels 0.15.

    #[test]
    fn normal() {
        let tails = [
            (0.0, 0.5),
            (0.5, 0.3085375387259869),
            (1.96, 0.024997895148220435),
            (5.0, 2.866515718791933e-7),
            (20.0, 2.7536241186061556e-89),
            (-1.0, 0.8413447460685429),
        ];
        for (x, tail) in tails {
            assert_close(normal_tail(x), tail, 1e-12);
            if x != 0.0 {
                assert_close(normal_quantile(tail), -x, 1e-12);
            }
        }
        assert_close(normal_quantile(1e-10), -6.361340902404056, 1e-12);
        assert_eq!(normal_quantile(0.5), 0.0);
        assert_eq!(normal_quantile(1.0), f64::INFINITY);
    }

    #[test]
    fn student() {
        let tails = [
            (0.1, 1.0, 0.936548965138893),
            (1.0, 1.0, 0.5),
            (2.5, 2.0, 0.12961172022151082),
            (4.3, 3.7, 0.014955969810392088),
            (12.0, 6.0, 2.0307406195373192e-5),
            (1.96, 1e5, 0.04999856319430168),
            (300.0, 1.05, 0.001612340658891003),
            (50.0, 40.0, 1.1117395583690465e-37),
        ];
        for (t, degrees, p) in tails {
            assert_close(t_two_sided(t, degrees), p, 1e-11);
            assert_close(t_critical(p, degrees), t, 1e-11);
        }
        assert_eq!(t_two_sided(0.0, 3.0), 1.0);
        assert_eq!(t_two_sided(f64::INFINITY, 3.0), 0.0);
    }

    #[test]
    fn shifts_that_are_found() {
        let shifts = [
            (1.0, 16.334008869921004),
            (2.0, 5.653489266197128),
            (9.5, 3.1286082855796846),
            (54.0, 2.852651464320075),
            (1000.0, 2.804275896375841),
        ];
        for (degrees, shift) in shifts {
            assert_close(detectable_shift(0.8, 0.05, degrees), shift, 1e-9);
        }
    }
}
