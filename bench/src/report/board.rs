//! The records of a run as a grid: datasets, their pairs, and each method's record of each pair.

use std::collections::{BTreeMap, BTreeSet};

use sharp_datasets::natural_order;

use crate::evaluate::record::{Record, Status};

use super::error::ReportError;
use super::input::{ReportDataset, ReportMethod};

/// Everything that tables and plots read.
#[derive(Debug)]
pub struct Board<'a> {
    /// In the order shown, as the methods are.
    pub datasets: Vec<DatasetBoard<'a>>,
    pub methods: Vec<ReportMethod>,
}

/// The pairs of one dataset.
#[derive(Debug)]
pub struct DatasetBoard<'a> {
    pub dataset: ReportDataset,
    /// Sorted bytewise by `pair_id`.
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

impl<'a> DatasetBoard<'a> {
    /// The records of method number `method`.
    pub fn records_of(&self, method: usize) -> impl Iterator<Item = &'a Record> {
        let slots = self
            .pairs
            .iter()
            .map(move |pair| pair.by_method.get(method));
        slots.filter_map(|slot| slot.copied().flatten())
    }
}

impl<'a> Board<'a> {
    /// Positions of the methods that are ranked.
    pub fn ranked(&self) -> impl Iterator<Item = usize> {
        let methods = self.methods.iter().enumerate();
        methods.filter_map(|(i, method)| method.unranked.is_none().then_some(i))
    }

    /// Arranges records. Datasets and methods come in the order given, the others after them in natural order.
    ///
    /// # Errors
    /// When a name is given twice, when a pair and method has two records, or when two records of a pair
    /// disagree on its geometry (then they are not of the same pair, and their means would mean nothing).
    pub fn new(
        records: &'a [Record],
        datasets: &[ReportDataset],
        methods: &[ReportMethod],
    ) -> Result<Self, ReportError> {
        let datasets = completed(
            datasets,
            records.iter().map(|r| r.dataset.as_str()),
            "dataset",
            |d| &d.name,
            ReportDataset::named,
        )?;
        let methods = completed(
            methods,
            records.iter().map(|r| r.method.as_str()),
            "method",
            |m| &m.label,
            ReportMethod::named,
        )?;
        let rows = methods.iter().enumerate();
        let row: BTreeMap<&str, usize> = rows.map(|(i, m)| (m.label.as_str(), i)).collect();
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

    /// How much the report is about, as nouns with numbers; its lead and its tiles say the same.
    pub fn counts(&self, metrics: usize) -> [(&'static str, usize); 6] {
        let pairs = || self.datasets.iter().flat_map(|d| &d.pairs);
        let scenes = pairs().map(|pair| (&pair.facts.dataset, &pair.facts.scene));
        [
            ("dataset", self.datasets.len()),
            ("scene", scenes.collect::<BTreeSet<_>>().len()),
            ("pair", pairs().count()),
            ("method", self.methods.len()),
            ("metric", metrics),
            ("failure", self.failures().len()),
        ]
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
    let facts = |r: &Record| {
        [
            ("baseline", Some(r.baseline_m.to_bits())),
            ("rotation", Some(r.rotation_deg.to_bits())),
            ("median depth", r.median_depth_m.map(f64::to_bits)),
            ("overlap", r.overlap.map(f64::to_bits)),
        ]
    };
    let mut both = facts(a).into_iter().zip(facts(b));
    both.find(|(a, b)| a != b).map(|((what, _), _)| what)
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
    others.sort_by(|a, b| natural_order::compare(a, b));
    Ok(given
        .iter()
        .cloned()
        .chain(others.into_iter().map(make))
        .collect())
}
