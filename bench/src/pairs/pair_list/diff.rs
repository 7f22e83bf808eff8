//! What differs between two pair lists.

use std::collections::BTreeMap;

use super::PairList;
use super::csv_form::{COLUMNS, fields};

impl PairList {
    /// What differs between two lists, by pair id; the order of rows does not count.
    pub fn diff(&self, other: &Self) -> ListDiff {
        let index = |list: &Self| -> BTreeMap<String, [String; COLUMNS.len()]> {
            let rows = list.pairs.iter();
            rows.map(|p| (p.pair_id.clone(), fields(p))).collect()
        };
        let (a, b) = (index(self), index(other));
        let mut diff = ListDiff::default();
        for (id, row) in &a {
            let Some(other_row) = b.get(id) else {
                diff.only_first.push(id.clone());
                continue;
            };
            let changes: Vec<FieldChange> = COLUMNS
                .iter()
                .zip(row.iter().zip(other_row))
                .filter(|(_, (first, second))| first != second)
                .map(|(column, (first, second))| FieldChange {
                    column,
                    first: first.clone(),
                    second: second.clone(),
                })
                .collect();
            if changes.is_empty() {
                diff.equal += 1;
            } else {
                diff.changed.push((id.clone(), changes));
            }
        }
        diff.only_second = b.into_keys().filter(|id| !a.contains_key(id)).collect();
        diff
    }
}

/// What differs between two lists.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct ListDiff {
    pub only_first: Vec<String>,
    pub only_second: Vec<String>,
    /// Pairs of both lists whose rows differ, and in what.
    pub changed: Vec<(String, Vec<FieldChange>)>,
    pub equal: usize,
}

impl ListDiff {
    /// True if the lists hold the same pairs with the same values.
    pub fn is_empty(&self) -> bool {
        self.only_first.is_empty() && self.only_second.is_empty() && self.changed.is_empty()
    }
}

/// One value that differs.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FieldChange {
    pub column: &'static str,
    pub first: String,
    pub second: String,
}
