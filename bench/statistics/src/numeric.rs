//! Means, quadrature and root finding, as needed by the distributions.

use std::f64::consts::FRAC_PI_2;
use std::sync::LazyLock;

/// Arithmetic mean, summed in order; `None` if empty.
pub fn mean(values: &[f64]) -> Option<f64> {
    (!values.is_empty()).then(|| values.iter().sum::<f64>() / values.len() as f64)
}

/// Standard deviation with divisor n − 1; `None` for fewer than two values or if one is not finite.
pub fn sample_std(values: &[f64]) -> Option<f64> {
    let mean = mean(values)?;
    if values.len() < 2 || !mean.is_finite() {
        return None;
    }
    let squares: f64 = values.iter().map(|v| (v - mean) * (v - mean)).sum();
    Some((squares / (values.len() - 1) as f64).sqrt())
}

/// The integral of `f` over 0..`length` by the tanh–sinh rule (Takahasi and Mori, "Double exponential formulas for
/// numerical integration", 1974). Close to full precision for functions that are analytic inside the interval, whatever
/// their behaviour at its ends. Arguments close to 0 are exact, however small.
pub(crate) fn integrate(length: f64, f: impl Fn(f64) -> f64) -> f64 {
    /// Nodes in 0..1 and their weights.
    static NODES: LazyLock<[(f64, f64); 125]> = LazyLock::new(|| {
        const STEP: f64 = 1.0 / 16.0;
        std::array::from_fn(|k| {
            let t = (k as f64 - 62.0) * STEP;
            let u = FRAC_PI_2 * t.sinh();
            // (1 + tanh u) / 2 without cancellation, and its derivative.
            let place = 1.0 / (1.0 + (-2.0 * u).exp());
            (
                place,
                STEP * FRAC_PI_2 * t.cosh() / (2.0 * u.cosh().powi(2)),
            )
        })
    });
    let parts = NODES
        .iter()
        .map(|(place, weight)| weight * f(length * place));
    length * parts.sum::<f64>()
}

/// The point between `low` and `high` at which `f` changes sign, to 13 digits: false position with Illinois' halving
/// (Dowell and Jarratt, 1971). Without a sign change, the end at which `f` is closer to zero.
pub(crate) fn root(low: f64, high: f64, f: impl Fn(f64) -> f64) -> f64 {
    let (mut a, mut b) = (low, high);
    let (mut f_a, mut f_b) = (f(a), f(b));
    if f_a == 0.0 || f_a.signum() == f_b.signum() {
        return if f_a.abs() <= f_b.abs() { a } else { b };
    }
    for step in 0..200 {
        let width = (b - a).abs();
        if f_b == 0.0 || width <= 1e-14 * a.abs().max(b.abs()) {
            break;
        }
        // Every fourth step is a bisection, so that flat stretches cannot stall the search.
        let c = if step % 4 == 3 {
            0.5 * (a + b)
        } else {
            b - f_b * (b - a) / (f_b - f_a)
        };
        let f_c = f(c);
        if f_c.signum() == f_b.signum() {
            f_a *= 0.5;
        } else {
            (a, f_a) = (b, f_b);
        }
        (b, f_b) = (c, f_c);
    }
    b
}
