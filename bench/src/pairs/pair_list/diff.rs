//! Differences between two pair lists.

use std::collections::BTreeMap;

use serde::Serialize;

use super::PairList;
use super::csv_form::{COLUMNS, fields};

#[derive(Debug, Clone, PartialEq, Eq, Default, Serialize)]
pub struct ListDiff {
    pub equal: usize,
    pub only_first: Vec<String>,
    pub only_second: Vec<String>,
    /// Pairs in both lists whose rows differ.
    pub changed: Vec<ChangedPair>,
}

/// A pair with different values in two lists.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct ChangedPair {
    pub pair_id: String,
    /// Values in the first and second list, keyed by column.
    pub columns: BTreeMap<&'static str, [String; 2]>,
}

impl ListDiff {
    /// Whether the lists have the same pairs with the same values.
    pub fn is_empty(&self) -> bool {
        self.only_first.is_empty() && self.only_second.is_empty() && self.changed.is_empty()
    }
}

impl PairList {
    /// Compares two lists, ignoring the order of rows.
    pub fn diff(&self, other: &Self) -> ListDiff {
        let index = |list: &Self| -> BTreeMap<String, [String; COLUMNS.len()]> {
            let rows = list.pairs.iter();
            rows.map(|p| (p.pair_id.clone(), fields(p))).collect()
        };
        let (a, mut b) = (index(self), index(other));
        let mut diff = ListDiff::default();
        for (pair_id, row) in a {
            let Some(other_row) = b.remove(&pair_id) else {
                diff.only_first.push(pair_id);
                continue;
            };
            let columns: BTreeMap<_, _> = COLUMNS
                .into_iter()
                .zip(row.into_iter().zip(other_row).map(<[String; 2]>::from))
                .filter(|(_, [first, second])| first != second)
                .collect();
            if columns.is_empty() {
                diff.equal += 1;
            } else {
                diff.changed.push(ChangedPair { pair_id, columns });
            }
        }
        diff.only_second = b.into_keys().collect();
        diff
    }
}
