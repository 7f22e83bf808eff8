//! Groups the views of a scene into sets; pairs are formed only within a set.

use clap::ValueEnum;
use sharp::random::SplitMix64;

/// Rule for grouping views into sets. Views are numbered in natural order of their ids.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Grouping {
    /// Consecutive views share a set: 0–9, 10–19, …
    Consecutive,
    /// View i is in set `i mod ⌈n / size⌉`, so every set spans the whole sequence. Set sizes differ by at most one, and
    /// there is no remainder.
    Strided,
    /// A seeded shuffle of the views, then consecutive sets; every scene uses the same seed.
    #[value(skip)]
    Random {
        seed: u64,
    },
    Whole,
}

/// Treatment of a last, smaller set.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum Remainder {
    /// The smaller set is kept if it has at least two views.
    Keep,
    /// The views of the smaller set are in no pair.
    Drop,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct SetOptions {
    pub grouping: Grouping,
    /// Views per set, ≥ 2; ignored for [`Grouping::Whole`].
    pub size: usize,
    pub remainder: Remainder,
    /// Maximum number of sets per scene; the first sets are kept.
    pub max_sets: Option<usize>,
}

impl Default for SetOptions {
    /// Sets of ten consecutive views; a smaller last set is kept, and the number of sets is not limited.
    fn default() -> Self {
        Self {
            grouping: Grouping::Consecutive,
            size: 10,
            remainder: Remainder::Keep,
            max_sets: None,
        }
    }
}

/// Splits views `0..n` into sets of at least two, each in ascending order.
pub fn view_sets(n: usize, options: &SetOptions) -> Vec<Vec<usize>> {
    let size = options.size.max(2);
    let mut order: Vec<usize> = (0..n).collect();
    let mut sets: Vec<Vec<usize>> = match options.grouping {
        Grouping::Whole => vec![order],
        Grouping::Strided => {
            let count = n.div_ceil(size);
            (0..count)
                .map(|s| (s..n).step_by(count).collect())
                .collect()
        }
        Grouping::Consecutive => order.chunks(size).map(<[usize]>::to_vec).collect(),
        Grouping::Random { seed } => {
            SplitMix64::new(seed).shuffle(&mut order);
            order.chunks(size).map(<[usize]>::to_vec).collect()
        }
    };
    // Strided sets are of about equal size, and Whole is one set, so neither leaves a remainder.
    let chunked = matches!(
        options.grouping,
        Grouping::Consecutive | Grouping::Random { .. }
    );
    let least = if chunked && options.remainder == Remainder::Drop {
        size
    } else {
        2
    };
    sets.retain(|set| set.len() >= least);
    sets.truncate(options.max_sets.unwrap_or(usize::MAX));
    for set in &mut sets {
        set.sort_unstable();
    }
    sets
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sizes(sets: &[Vec<usize>]) -> Vec<usize> {
        sets.iter().map(Vec::len).collect()
    }

    #[test]
    fn consecutive_sets_keep_a_remainder_of_two_but_not_of_one() {
        let options = SetOptions::default();
        let sets = view_sets(22, &options);
        assert_eq!(sizes(&sets), [10, 10, 2]);
        assert_eq!(sets[1], (10..20).collect::<Vec<_>>());
        assert_eq!(sizes(&view_sets(21, &options)), [10, 10]);
        assert!(view_sets(1, &options).is_empty());
        assert!(view_sets(0, &options).is_empty());
    }

    #[test]
    fn a_dropped_remainder_is_dropped_even_in_a_small_scene() {
        let options = SetOptions {
            remainder: Remainder::Drop,
            ..SetOptions::default()
        };
        assert_eq!(sizes(&view_sets(29, &options)), [10, 10]);
        assert!(view_sets(9, &options).is_empty());
    }

    #[test]
    fn strided_sets_span_the_sequence() {
        let options = SetOptions {
            grouping: Grouping::Strided,
            ..SetOptions::default()
        };
        let sets = view_sets(23, &options);
        assert_eq!(sizes(&sets), [8, 8, 7]);
        assert_eq!(sets[1], [1, 4, 7, 10, 13, 16, 19, 22]);
    }

    #[test]
    fn random_sets_partition_the_views_and_depend_on_the_seed() {
        let random = |seed| {
            let options = SetOptions {
                grouping: Grouping::Random { seed },
                ..SetOptions::default()
            };
            view_sets(25, &options)
        };
        assert_eq!(random(1), random(1));
        assert_ne!(random(1), random(2));
        let mut all: Vec<usize> = random(1).concat();
        all.sort_unstable();
        assert_eq!(all, (0..25).collect::<Vec<_>>());
        assert!(random(1).iter().all(|set| set.is_sorted()));
    }

    #[test]
    fn caps_and_whole_scenes() {
        let capped = SetOptions {
            max_sets: Some(1),
            ..SetOptions::default()
        };
        assert_eq!(sizes(&view_sets(40, &capped)), [10]);
        let whole = SetOptions {
            grouping: Grouping::Whole,
            ..SetOptions::default()
        };
        assert_eq!(sizes(&view_sets(40, &whole)), [40]);
    }
}
