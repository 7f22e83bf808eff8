//! Search for the best-fitting factor.

/// Factors between the reciprocal of this factor and this factor are too close to 1 to be reported.
const MIN_FACTOR: f64 = 1.03;

pub(super) fn is_reportable(factor: f64) -> bool {
    factor.ln().abs() > MIN_FACTOR.ln()
}

/// The factor with the least loss: tries `step`^-n … `step`^n, then factors in between, and rounds the best factor if
/// the rounded one is about as good. The second argument of `loss` is true during the coarse search.
pub(super) fn least(n: i32, step: f64, loss: &dyn Fn(f64, bool) -> f64) -> f64 {
    let coarse = (-n..=n).map(|i| step.powi(i));
    let coarse = coarse.map(|factor| (loss(factor, true), factor));
    let middle = coarse.min_by(|a, b| a.0.total_cmp(&b.0));
    let middle = middle.map_or(1.0, |best| best.1);
    let (mut low, mut high) = ((middle / step).ln(), (middle * step).ln());
    let golden = (5_f64.sqrt() - 1.0) / 2.0;
    let at = |x: f64| loss(x.exp(), false);
    let (mut a, mut b) = (high - golden * (high - low), low + golden * (high - low));
    let (mut at_a, mut at_b) = (at(a), at(b));
    for _ in 0..12 {
        if at_a < at_b {
            (high, b, at_b) = (b, a, at_a);
            a = high - golden * (high - low);
            at_a = at(a);
        } else {
            (low, a, at_a) = (a, b, at_b);
            b = low + golden * (high - low);
            at_b = at(b);
        }
    }
    let (found, best) = if at_a < at_b {
        (a.exp(), at_a)
    } else {
        (b.exp(), at_b)
    };
    let round = rounded(found);
    if loss(round, false) <= 1.01 * best {
        round
    } else {
        found
    }
}

/// Rounds to a whole number of one digit, 1.25, 1.5 or 2.5, times a power of ten, if the result is
/// within 1 % of the factor. Otherwise, rounds to three digits.
fn rounded(factor: f64) -> f64 {
    let power = 10_f64.powf(factor.log10().floor());
    let round = [
        1.0, 1.25, 1.5, 2.0, 2.5, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0, 9.0, 10.0,
    ];
    let round = round.map(|digit| digit * power).into_iter();
    let near = round.min_by(|a, b| (a / factor).ln().abs().total_cmp(&(b / factor).ln().abs()));
    match near.filter(|near| (near / factor).ln().abs() < 0.01) {
        Some(near) => near,
        None => (factor / power * 100.0).round() / 100.0 * power,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn factors_are_rounded_where_they_are_near() {
        for (factor, round) in [
            (4.97, 5.0),
            (0.00101, 0.001),
            (0.3048, 0.305),
            (1.26, 1.25),
            (99.2, 100.0),
        ] {
            assert!((rounded(factor) / round - 1.0).abs() < 1e-9, "{factor}");
        }
    }
}
