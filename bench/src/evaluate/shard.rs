//! A process's share of a plan, given explicitly or by its scheduler.

use std::cmp::Reverse;
use std::collections::BTreeSet;
use std::str::FromStr;

use crate::pairs::pair_id::source_of;

/// One of `count` shares of a plan. Shares do not overlap, and together they cover the whole plan.
///
/// Units are independent, so a plan can be continued with another number of shares.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Shard {
    /// Index of the share, from 1.
    index: usize,
    count: usize,
}

const MAX_SHARDS: usize = 1_000_000;

impl Shard {
    /// The single share of an undivided plan.
    pub const WHOLE: Self = Self { index: 1, count: 1 };

    /// Creates a share.
    ///
    /// # Errors
    /// If `index` is not in 1..=`count`, or `count` exceeds `MAX_SHARDS`.
    pub fn new(index: usize, count: usize) -> Result<Self, ShardError> {
        if (1..=count).contains(&index) && count <= MAX_SHARDS {
            Ok(Self { index, count })
        } else {
            Err(ShardError::Range { index, count })
        }
    }

    /// This share of a list sorted by pair id. The pairs of a source form a group that is not split, because they share
    /// one prediction. Groups are assigned from the largest, each to the share with the fewest pairs so far.
    pub(super) fn of<T>(self, list: Vec<T>, pair_id: impl Fn(&T) -> &str) -> Vec<T> {
        self.deal(list, pair_id).swap_remove(self.index - 1)
    }

    /// Divides a list, sorted by pair id, into all shares.
    pub(super) fn deal<T>(self, list: Vec<T>, pair_id: impl Fn(&T) -> &str) -> Vec<Vec<T>> {
        let mut groups: Vec<std::ops::Range<usize>> = Vec::new();
        for at in 0..list.len() {
            match groups.last_mut() {
                Some(group)
                    if source_of(pair_id(&list[group.start])) == source_of(pair_id(&list[at])) =>
                {
                    group.end = at + 1;
                }
                _ => groups.push(at..at + 1),
            }
        }
        // The sort is stable, so equal groups stay in the order of their ids.
        groups.sort_by_key(|group| Reverse(group.len()));
        // The share with the smallest load gets the next group; ties go to the lowest number.
        let mut loads: BTreeSet<(usize, usize)> = (0..self.count).map(|share| (0, share)).collect();
        let mut share_of = vec![0; list.len()];
        for group in groups {
            let Some((load, share)) = loads.pop_first() else {
                break;
            };
            loads.insert((load + group.len(), share));
            share_of[group].fill(share);
        }
        let mut shares: Vec<Vec<T>> = Vec::new();
        shares.resize_with(self.count, Vec::new);
        for (item, share) in list.into_iter().zip(share_of) {
            shares[share].push(item);
        }
        shares
    }
}

impl std::fmt::Display for Shard {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}/{}", self.index, self.count)
    }
}

#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum ShardError {
    #[error("'{0}': expected I/N (such as 3/8), auto or auto/N")]
    Form(String),
    #[error(
        "shard {index} of {count}: shards are numbered from 1 to their count, which is at most {MAX_SHARDS}"
    )]
    Range { index: usize, count: usize },
    #[error(
        "auto: this is not an array task of Slurm (SLURM_ARRAY_TASK_ID), Kubernetes (JOB_COMPLETION_INDEX) or AWS \
         Batch (AWS_BATCH_JOB_ARRAY_INDEX)"
    )]
    NoArray,
    #[error("auto: {variable} is '{value}', which is not a number")]
    Variable {
        variable: &'static str,
        value: String,
    },
    #[error("auto: {0}")]
    Count(&'static str),
}

impl FromStr for Shard {
    type Err = ShardError;

    /// Parses `3/8`; `auto` if the scheduler provides index and count; `auto/8` if it provides only
    /// the index.
    fn from_str(text: &str) -> Result<Self, ShardError> {
        let form = || ShardError::Form(text.to_owned());
        let number = |text: &str| text.parse().map_err(|_| form());
        match text.split_once('/') {
            Some(("auto", count)) => of_array(Some(number(count)?), environment),
            Some((index, count)) => Self::new(number(index)?, number(count)?),
            None if text == "auto" => of_array(None, environment),
            None => Err(form()),
        }
    }
}

fn environment(name: &str) -> Option<String> {
    std::env::var(name).ok()
}

/// The share of this process, which a scheduler started as one task of a job array. `variable` reads an environment
/// variable.
fn of_array(
    count: Option<usize>,
    variable: impl Fn(&str) -> Option<String>,
) -> Result<Shard, ShardError> {
    let number = |name: &'static str| {
        let Some(value) = variable(name) else {
            return Ok(None);
        };
        match value.parse::<usize>() {
            Ok(number) => Ok(Some(number)),
            Err(_) => Err(ShardError::Variable {
                variable: name,
                value,
            }),
        }
    };
    if let Some(index) = number("SLURM_ARRAY_TASK_ID")? {
        let size = number("SLURM_ARRAY_TASK_COUNT")?;
        let last = number("SLURM_ARRAY_TASK_MAX")?;
        return match count {
            Some(count) => Shard::new(index, count),
            None if size.is_some() && size == last => Shard::new(index, size.unwrap_or(index)),
            // If only some tasks are submitted, such as 2 and 5 of 8, the environment does not state the total.
            None => Err(ShardError::Count(
                "the indices of this Slurm array are not 1 to N without gaps, so the number of \
                 shards is unknown: use --shard auto/N",
            )),
        };
    }
    let batch = match number("AWS_BATCH_JOB_ARRAY_INDEX")? {
        Some(index) => Some((index, number("AWS_BATCH_JOB_ARRAY_SIZE")?)),
        None => number("JOB_COMPLETION_INDEX")?.map(|index| (index, None)),
    };
    let (index, size) = batch.ok_or(ShardError::NoArray)?;
    let count = count.or(size).ok_or(ShardError::Count(
        "this job does not state its number of indices: use --shard auto/N",
    ))?;
    // These schedulers count from 0, shards from 1.
    Shard::new(index.saturating_add(1), count)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn array(count: Option<usize>, set: &[(&str, &str)]) -> Result<String, ShardError> {
        let variable = |name: &str| {
            let found = set.iter().find(|(key, _)| *key == name);
            found.map(|(_, value)| (*value).to_owned())
        };
        of_array(count, variable).map(|shard| shard.to_string())
    }

    #[test]
    fn schedulers_say_which_share_it_is() {
        let slurm = |id, count, max| {
            [
                ("SLURM_ARRAY_TASK_ID", id),
                ("SLURM_ARRAY_TASK_COUNT", count),
                ("SLURM_ARRAY_TASK_MAX", max),
            ]
        };
        assert_eq!(array(None, &slurm("3", "8", "8")).as_deref(), Ok("3/8"));
        assert_eq!(array(Some(8), &slurm("5", "2", "5")).as_deref(), Ok("5/8"));
        // Shards 2 and 5 of an unknown total, and an array that counts from 0.
        assert!(matches!(
            array(None, &slurm("5", "2", "5")),
            Err(ShardError::Count(_))
        ));
        assert!(array(None, &slurm("0", "8", "7")).is_err());
        assert!(array(Some(8), &slurm("0", "8", "7")).is_err());
        assert!(array(None, &slurm("x", "8", "8")).is_err());
        let kubernetes = [("JOB_COMPLETION_INDEX", "0")];
        assert_eq!(array(Some(4), &kubernetes).as_deref(), Ok("1/4"));
        assert!(array(None, &kubernetes).is_err());
        let aws = [
            ("AWS_BATCH_JOB_ARRAY_INDEX", "7"),
            ("AWS_BATCH_JOB_ARRAY_SIZE", "8"),
        ];
        assert_eq!(array(None, &aws).as_deref(), Ok("8/8"));
        assert_eq!(array(None, &[]), Err(ShardError::NoArray));
    }

    #[test]
    fn shards_count_from_one() {
        for text in [
            "0/3",
            "4/3",
            "1/0",
            "1",
            "a/b",
            "1/3/5",
            "-1/3",
            "",
            "1/9999999",
        ] {
            assert!(text.parse::<Shard>().is_err(), "{text}");
        }
        assert_eq!("2/3".parse::<Shard>().unwrap().to_string(), "2/3");
    }

    proptest! {
        #[test]
        fn shares_are_disjoint_whole_and_even(sizes in prop::collection::vec(1_usize..9, 1..30), count in 1_usize..12) {
            let list: Vec<String> = sizes
                .iter()
                .enumerate()
                .flat_map(|(source, size)| (0..*size).map(move |t| format!("D/s/{source:02}__{t}")))
                .collect();
            let shares: Vec<Vec<&str>> = (1..=count)
                .map(|index| {
                    let list = list.iter().map(String::as_str).collect();
                    Shard::new(index, count).unwrap().of(list, |id| *id)
                })
                .collect();
            let mut all: Vec<&str> = shares.concat();
            all.sort_unstable();
            prop_assert_eq!(&all, &list);
            for (i, share) in shares.iter().enumerate() {
                prop_assert!(share.is_sorted());
                let sources: BTreeSet<&str> = share.iter().map(|id| source_of(id)).collect();
                for other in &shares[i + 1..] {
                    prop_assert!(!other.iter().any(|id| sources.contains(source_of(id))));
                }
            }
            let loads: Vec<usize> = shares.iter().map(Vec::len).collect();
            let total: usize = loads.iter().sum();
            prop_assert_eq!(total, sizes.iter().sum::<usize>());
            // No share exceeds the average by more than one group.
            let largest = sizes.iter().max().copied().unwrap_or(0);
            let most = loads.iter().max().copied().unwrap_or(0);
            prop_assert!(most <= total / count + largest);
        }
    }
}
