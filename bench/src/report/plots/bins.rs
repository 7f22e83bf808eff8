//! Samples by baseline: equal bins from zero, empty ones skipped.

use std::collections::BTreeMap;

use crate::report::statistics;

use super::scale::Step;

/// The samples with `low <= motion < high`.
#[derive(Debug, Clone, PartialEq)]
pub struct Bin {
    /// Lower edge, inclusive.
    pub low: f64,
    /// Upper edge, exclusive.
    pub high: f64,
    /// Samples.
    pub n: usize,
    /// Their mean; infinite as soon as one is.
    pub mean: f64,
    /// Sample standard deviation (divisor n − 1); `None` for a single sample or an infinite one.
    pub std: Option<f64>,
}

impl Bin {
    /// Where the bin is drawn.
    pub fn centre(&self) -> f64 {
        (self.low + self.high) / 2.0
    }
}

/// Bins of `(motion, value)`, by ascending motion; only those with a sample. Samples whose motion is not finite
/// or whose value is not a number are left out.
pub fn bins(samples: &[(f64, f64)], step: Step) -> Vec<Bin> {
    let mut groups: BTreeMap<i64, Vec<f64>> = BTreeMap::new();
    for (motion, value) in samples {
        if motion.is_finite() && !value.is_nan() {
            groups.entry(step.index(*motion)).or_default().push(*value);
        }
    }
    groups
        .into_iter()
        .filter_map(|(k, values)| {
            Some(Bin {
                low: step.at(k),
                high: step.at(k.saturating_add(1)),
                n: values.len(),
                mean: statistics::mean(&values)?,
                std: statistics::sample_std(&values),
            })
        })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn tenths(samples: &[(f64, f64)]) -> Vec<(f64, usize, f64, Option<f64>)> {
        bins(samples, Step::nice(1.0, 10))
            .into_iter()
            .map(|b| (b.low, b.n, b.mean, b.std))
            .collect()
    }

    #[test]
    fn edges_belong_to_the_bin_above_and_empty_bins_are_skipped() {
        let found = tenths(&[
            (0.0, 1.0),
            (0.1, 2.0),
            (0.0999, 3.0),
            (0.3, 4.0),
            (0.7, 5.0),
        ]);
        assert_eq!(
            found,
            [
                (0.0, 2, 2.0, Some(2_f64.sqrt())),
                (0.1, 1, 2.0, None),
                (0.3, 1, 4.0, None),
                (0.7, 1, 5.0, None),
            ]
        );
    }

    #[test]
    fn infinite_and_missing_values() {
        assert_eq!(
            tenths(&[
                (0.05, f64::INFINITY),
                (0.06, 30.0),
                (0.07, f64::NAN),
                (f64::NAN, 1.0)
            ]),
            [(0.0, 2, f64::INFINITY, None)]
        );
        assert!(tenths(&[]).is_empty());
    }

    #[test]
    fn the_deviation_is_that_of_a_sample() {
        let found = tenths(&[
            (0.0, 2.0),
            (0.0, 4.0),
            (0.0, 4.0),
            (0.0, 4.0),
            (0.0, 5.0),
            (0.0, 5.0),
            (0.0, 7.0),
            (0.0, 9.0),
        ]);
        assert_eq!(found[0].2, 5.0);
        assert!((found[0].3.unwrap() - (32.0_f64 / 7.0).sqrt()).abs() < 1e-15);
    }
}
