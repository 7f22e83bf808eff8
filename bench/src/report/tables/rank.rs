//! Ranks the best, second and third number, as displayed.

use sharp_metrics::Direction;

/// A number to be ranked.
#[derive(Debug, Clone, PartialEq)]
pub struct RankedValue<'a> {
    /// The number to be ranked; `None` gets no rank.
    pub value: Option<f64>,
    /// Indices of the pairs that the number covers. Only numbers over the same pairs are ranked with each other.
    pub covers: &'a [usize],
    /// Whether the number covers every pair.
    pub complete: bool,
    /// Whether the row takes part in the ranking.
    pub ranked: bool,
}

/// Ranks the best three numbers after rounding to `decimals`. Equal numbers share a rank, and the next rank counts all
/// numbers before it (1, 1, 3). If some rows cover every pair, only these are ranked. Otherwise, rows are ranked only
/// if all cover the same pairs. A single row has no rank.
pub fn ranks(
    candidates: &[RankedValue<'_>],
    direction: Option<Direction>,
    decimals: usize,
) -> Vec<Option<u8>> {
    let none = vec![None; candidates.len()];
    let sign = match direction {
        Some(Direction::Higher) => -1.0,
        Some(Direction::Lower) => 1.0,
        None => return none,
    };
    // Negate numbers of which higher ones are better, so that smaller is better for all.
    let goodness: Vec<Option<f64>> = candidates
        .iter()
        .map(|c| {
            let value = c.value.filter(|v| c.ranked && !v.is_nan())?;
            Some(sign * rounded(value, decimals))
        })
        .collect();
    let entered = || {
        let pairs = candidates.iter().zip(&goodness);
        pairs.filter(|(_, g)| g.is_some()).map(|(c, _)| c)
    };
    let contest: Vec<Option<f64>> = if entered().any(|c| c.complete) {
        let pairs = candidates.iter().zip(&goodness);
        pairs.map(|(c, g)| g.filter(|_| c.complete)).collect()
    } else {
        let mut covers = entered().map(|c| c.covers);
        let first = covers.next();
        if covers.any(|c| Some(c) != first) {
            return none;
        }
        goodness
    };
    let field: Vec<f64> = contest.iter().flatten().copied().collect();
    if field.len() < 2 {
        return none;
    }
    contest
        .iter()
        .map(|goodness| {
            let own = (*goodness)?;
            let ahead = field.iter().filter(|other| **other < own).count();
            u8::try_from(ahead + 1).ok().filter(|rank| *rank <= 3)
        })
        .collect()
}

/// The number as it is displayed: rounded to `decimals`.
pub(crate) fn rounded(value: f64, decimals: usize) -> f64 {
    if value.is_finite() {
        format!("{value:.decimals$}").parse().unwrap_or(value)
    } else {
        value
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const HIGHER: Option<Direction> = Some(Direction::Higher);
    const LOWER: Option<Direction> = Some(Direction::Lower);

    fn of(values: &[f64], direction: Option<Direction>, decimals: usize) -> Vec<Option<u8>> {
        let candidates: Vec<_> = values
            .iter()
            .map(|v| RankedValue {
                value: Some(*v),
                covers: &[0, 1],
                complete: true,
                ranked: true,
            })
            .collect();
        ranks(&candidates, direction, decimals)
    }

    #[test]
    fn ranks_are_taken_after_rounding_and_ties_share() {
        assert_eq!(
            of(&[0.1231, 0.1229, 0.125, 0.2, 0.3], LOWER, 3),
            [Some(1), Some(1), Some(3), None, None]
        );
        // With more decimals they differ.
        assert_eq!(
            of(&[0.1231, 0.1229, 0.125, 0.2], LOWER, 4),
            [Some(2), Some(1), Some(3), None]
        );
    }

    #[test]
    fn direction_and_infinity() {
        assert_eq!(
            of(&[20.0, f64::INFINITY, 30.0], HIGHER, 2),
            [Some(3), Some(1), Some(2)]
        );
        assert_eq!(
            of(&[f64::INFINITY, f64::INFINITY, 30.0], HIGHER, 2),
            [Some(1), Some(1), Some(3)]
        );
        assert_eq!(of(&[1.0, 2.0], None, 2), [None, None]);
        assert_eq!(
            of(&[f64::NAN, 2.0, 3.0], LOWER, 2),
            [None, Some(1), Some(2)]
        );
        assert_eq!(of(&[-0.0001, 0.0001], LOWER, 3), [Some(1), Some(1)]);
    }

    #[test]
    fn a_single_row_is_no_contest() {
        assert_eq!(of(&[1.0], LOWER, 2), [None]);
    }

    #[test]
    fn incomplete_rows_are_not_ranked_against_complete_ones() {
        let row = |value, covers, complete| RankedValue {
            value: Some(value),
            covers,
            complete,
            ranked: true,
        };
        let mixed = [
            row(1.0, &[0][..], false),
            row(2.0, &[0, 1], true),
            row(3.0, &[0, 1], true),
        ];
        assert_eq!(ranks(&mixed, LOWER, 2), [None, Some(1), Some(2)]);
        let same = [row(1.0, &[0][..], false), row(2.0, &[0], false)];
        assert_eq!(ranks(&same, LOWER, 2), [Some(1), Some(2)]);
        let other = [row(1.0, &[0][..], false), row(2.0, &[1], false)];
        assert_eq!(ranks(&other, LOWER, 2), [None, None]);
    }

    #[test]
    fn rows_out_of_contest_do_not_count() {
        let mut rows: Vec<_> = [1.0, 2.0, 3.0]
            .map(|value| RankedValue {
                value: Some(value),
                covers: &[],
                complete: true,
                ranked: true,
            })
            .into();
        rows[0].ranked = false;
        assert_eq!(ranks(&rows, LOWER, 2), [None, Some(1), Some(2)]);
    }
}
