//! The records of a run as a grid: datasets, their pairs, and for each pair what each method did.

use std::cmp::Ordering;
use std::collections::{BTreeMap, BTreeSet};

use crate::evaluate::record::{Record, Status};

use super::error::ReportError;
use super::input::{Dataset, Method};

/// Everything that tables and plots read.
#[derive(Debug)]
pub struct Board<'a> {
    /// In the order shown.
    pub datasets: Vec<DatasetBoard<'a>>,
    /// In the order shown.
    pub methods: Vec<Method>,
}

/// The pairs of one dataset, sorted bytewise by id.
#[derive(Debug)]
pub struct DatasetBoard<'a> {
    /// Name and what is known of it.
    pub dataset: Dataset,
    /// Sorted by `pair_id`.
    pub pairs: Vec<PairBoard<'a>>,
}

/// One pair and its predictions.
#[derive(Debug)]
pub struct PairBoard<'a> {
    /// A record of the pair, for what does not depend on the method.
    pub facts: &'a Record,
    /// By method, as in [`Board::methods`]; `None`: no record.
    pub by_method: Vec<Option<&'a Record>>,
}

impl DatasetBoard<'_> {
    /// Pairs that a complete row has.
    pub fn total(&self) -> usize {
        self.pairs
            .len()
            .max(self.dataset.planned_pairs.unwrap_or(0))
    }
}

impl<'a> Board<'a> {
    /// Arranges records. Datasets and methods come in the order given, the others after them in natural order.
    ///
    /// # Errors
    /// When a name is given twice, when a pair and method has two records, or when two records of a pair
    /// disagree on its geometry (then they are not of the same pair, and their means would mean nothing).
    pub fn new(
        records: &'a [Record],
        datasets: &[Dataset],
        methods: &[Method],
    ) -> Result<Self, ReportError> {
        let datasets = completed(
            datasets,
            records.iter().map(|r| r.dataset.as_str()),
            "dataset",
            |d| &d.name,
            Dataset::named,
        )?;
        let methods = completed(
            methods,
            records.iter().map(|r| r.method.as_str()),
            "method",
            |m| &m.label,
            Method::named,
        )?;
        let row: BTreeMap<&str, usize> = methods
            .iter()
            .enumerate()
            .map(|(i, m)| (m.label.as_str(), i))
            .collect();
        let mut grouped: BTreeMap<&str, BTreeMap<&str, PairBoard<'a>>> = BTreeMap::new();
        for record in records {
            let pair = grouped
                .entry(&record.dataset)
                .or_default()
                .entry(&record.pair_id)
                .or_insert_with(|| PairBoard {
                    facts: record,
                    by_method: vec![None; methods.len()],
                });
            let conflict = |reason: String| ReportError::Conflict {
                pair: record.pair_id.clone(),
                method: record.method.clone(),
                reason,
            };
            if let Some(what) = differing_fact(pair.facts, record) {
                return Err(conflict(format!(
                    "its {what} differs from that in the record of '{}'",
                    pair.facts.method
                )));
            }
            let Some(slot) = row
                .get(record.method.as_str())
                .and_then(|&i| pair.by_method.get_mut(i))
            else {
                continue;
            };
            if slot.replace(record).is_some() {
                return Err(conflict("has two records".into()));
            }
        }
        let datasets = datasets
            .into_iter()
            .map(|dataset| DatasetBoard {
                pairs: grouped
                    .remove(dataset.name.as_str())
                    .map(|pairs| pairs.into_values().collect())
                    .unwrap_or_default(),
                dataset,
            })
            .collect();
        Ok(Self { datasets, methods })
    }

    /// Records that failed, in the order of the board.
    pub fn failures(&self) -> Vec<(&'a Record, &'a str)> {
        let mut failures = Vec::new();
        for pair in self.datasets.iter().flat_map(|d| &d.pairs) {
            for record in pair.by_method.iter().flatten() {
                if let Status::Failed { reason } = &record.status {
                    failures.push((*record, reason.as_str()));
                }
            }
        }
        failures
    }
}

/// The geometry of a pair must not depend on the method.
pub(super) fn differing_fact(a: &Record, b: &Record) -> Option<&'static str> {
    let bits = |v: Option<f64>| v.map(f64::to_bits);
    if a.baseline_m.to_bits() != b.baseline_m.to_bits() {
        Some("baseline")
    } else if a.rotation_deg.to_bits() != b.rotation_deg.to_bits() {
        Some("rotation")
    } else if bits(a.median_depth_m) != bits(b.median_depth_m) {
        Some("median depth")
    } else if bits(a.overlap) != bits(b.overlap) {
        Some("overlap")
    } else {
        None
    }
}

/// The given list, checked for repetitions, then the names that only the records have.
fn completed<'r, T: Clone>(
    given: &[T],
    found: impl Iterator<Item = &'r str>,
    what: &'static str,
    name: impl Fn(&T) -> &str,
    make: impl Fn(&'r str) -> T,
) -> Result<Vec<T>, ReportError> {
    let mut known = BTreeSet::new();
    for item in given {
        if !known.insert(name(item).to_owned()) {
            return Err(ReportError::Repeated {
                what,
                name: name(item).to_owned(),
            });
        }
    }
    let mut others: Vec<&str> = found
        .filter(|n| !known.contains(*n))
        .collect::<BTreeSet<_>>()
        .into_iter()
        .collect();
    others.sort_by(|a, b| natural(a, b));
    Ok(given
        .iter()
        .cloned()
        .chain(others.into_iter().map(make))
        .collect())
}

/// Order in which people count: runs of digits by value, everything else bytewise.
pub fn natural(a: &str, b: &str) -> Ordering {
    let (mut x, mut y) = (a.as_bytes(), b.as_bytes());
    while let (Some(p), Some(q)) = (x.first(), y.first()) {
        if p.is_ascii_digit() && q.is_ascii_digit() {
            let (m, rest_x) = digits(x);
            let (n, rest_y) = digits(y);
            // Without leading zeros, the longer number is the larger.
            let order = m.len().cmp(&n.len()).then_with(|| m.cmp(n));
            if order != Ordering::Equal {
                return order;
            }
            (x, y) = (rest_x, rest_y);
        } else if p == q {
            (x, y) = (&x[1..], &y[1..]);
        } else {
            return p.cmp(q);
        }
    }
    x.len().cmp(&y.len()).then_with(|| a.cmp(b))
}

/// Leading digits without their leading zeros, and the rest.
fn digits(text: &[u8]) -> (&[u8], &[u8]) {
    let end = text
        .iter()
        .position(|c| !c.is_ascii_digit())
        .unwrap_or(text.len());
    let (number, rest) = text.split_at(end);
    let zeros = number.iter().take_while(|c| **c == b'0').count();
    (&number[zeros..], rest)
}
