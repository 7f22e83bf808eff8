//! Median and spread of times.

use serde::Serialize;

/// Median and spread of a list of numbers.
#[derive(Debug, Clone, Copy, PartialEq, Serialize)]
pub struct Spread {
    pub n: usize,
    pub median: f64,
    /// First and third quartile, linearly interpolated.
    pub quartiles: [f64; 2],
    pub least: f64,
    pub most: f64,
}

impl Spread {
    /// Computes the spread; `None` if `numbers` is empty.
    pub fn of(numbers: &[f64]) -> Option<Self> {
        let mut sorted = numbers.to_vec();
        sorted.sort_by(f64::total_cmp);
        let quantile = |share: f64| {
            let at = share * (sorted.len() - 1) as f64;
            let (low, high) = (sorted[at.floor() as usize], sorted[at.ceil() as usize]);
            low + (high - low) * at.fract()
        };
        let (least, most) = (*sorted.first()?, *sorted.last()?);
        Some(Self {
            n: sorted.len(),
            median: quantile(0.5),
            quartiles: [quantile(0.25), quantile(0.75)],
            least,
            most,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn quartiles_lie_between_their_neighbours() {
        let of = |numbers: &[f64]| Spread::of(numbers).map(|s| (s.n, s.median, s.quartiles));
        assert_eq!(of(&[4.0, 1.0, 2.0, 3.0]), Some((4, 2.5, [1.75, 3.25])));
        assert_eq!(of(&[7.0]), Some((1, 7.0, [7.0, 7.0])));
        assert_eq!(of(&[]), None);
        let summary = Spread::of(&[3.0, 9.0, 5.0]).unwrap();
        assert_eq!(
            (summary.least, summary.median, summary.most),
            (3.0, 5.0, 9.0)
        );
    }
}
