//! Reading scores files, and joining the records of several runs.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use crate::durable::FileError;
use crate::record::{Record, Score, Status};

use super::error::ReportError;
use super::records::differing_fact;

/// Joins the records of several runs. Records of the same pair and method are one unit when they agree:
/// their scores are united, so that a run that added metrics completes another.
///
/// # Errors
/// When two values of one score, or the outcomes, differ.
pub fn merged(runs: Vec<Vec<Record>>) -> Result<Vec<Record>, ReportError> {
    let mut units: BTreeMap<(String, String), Record> = BTreeMap::new();
    for record in runs.into_iter().flatten() {
        let key = (record.pair_id.clone(), record.method.clone());
        let Some(unit) = units.get_mut(&key) else {
            units.insert(key, record);
            continue;
        };
        let conflict = |reason: String| ReportError::Conflict {
            pair: key.0.clone(),
            method: key.1.clone(),
            reason,
        };
        if let Some(what) = differing_fact(unit, &record) {
            return Err(conflict(format!("its {what} differs between the runs")));
        }
        if unit.status != record.status {
            return Err(conflict(
                "succeeded in one run and failed in another".into(),
            ));
        }
        for (name, score) in record.scores {
            match unit.scores.get(&name) {
                Some(old)
                    if !same_score(old, &score)
                        && old.value().is_some()
                        && score.value().is_some() =>
                {
                    return Err(conflict(format!("its {name} differs between the runs")));
                }
                Some(old) if old.value().is_some() => {}
                _ => {
                    unit.scores.insert(name, score);
                }
            }
        }
        for (name, value) in record.extras {
            unit.extras.entry(name).or_insert(value);
        }
    }
    Ok(units.into_values().collect())
}

fn same_score(a: &Score, b: &Score) -> bool {
    match (a.value(), b.value()) {
        (Some(x), Some(y)) => x.to_bits() == y.to_bits(),
        _ => a == b,
    }
}

/// Columns of a scores file before the metrics.
const FACTS: [&str; 11] = [
    "pair_id",
    "dataset",
    "scene",
    "source",
    "target",
    "method",
    "baseline_m",
    "rotation_deg",
    "median_depth_m",
    "overlap",
    "status",
];

/// Reads `scores.csv`: the columns above, then one per metric key. An empty score is an unavailable one, a
/// status other than `ok` a failure with that text as its reason.
///
/// # Errors
/// Names file, line and reason.
pub fn read_scores(path: &Path) -> Result<Vec<Record>, ReportError> {
    let text = std::fs::read(path).map_err(FileError::new(path, "read"))?;
    let mut reader = csv::ReaderBuilder::new().from_reader(text.as_slice());
    let at = |line: u64, reason: String| ReportError::Scores {
        path: path.to_owned(),
        line,
        reason,
    };
    let header = reader.headers().map_err(|e| at(1, e.to_string()))?.clone();
    if !header.iter().take(FACTS.len()).eq(FACTS) {
        return Err(at(
            1,
            format!("the columns must begin with {}", FACTS.join(",")),
        ));
    }
    let keys: Vec<&str> = header.iter().skip(FACTS.len()).collect();
    if keys.iter().collect::<BTreeSet<_>>().len() < keys.len() {
        return Err(at(1, "a metric has two columns".into()));
    }
    let mut records = Vec::new();
    for row in reader.records() {
        let row = row.map_err(|e| {
            let line = e.position().map_or(1, csv::Position::line);
            at(line, e.to_string())
        })?;
        let line = row.position().map_or(1, csv::Position::line);
        let text = |i: usize| row.get(i).unwrap_or_default();
        let number = |i: usize, name: &str| {
            parse(text(i)).ok_or_else(|| at(line, format!("{name}: '{}' is not a number", text(i))))
        };
        let optional = |i: usize, name: &str| match text(i) {
            "" => Ok(None),
            _ => number(i, name).map(Some),
        };
        let mut scores = BTreeMap::new();
        for (i, key) in keys.iter().enumerate() {
            let score = match optional(FACTS.len() + i, key)? {
                Some(value) => Score::Value(value),
                None => Score::Unavailable {
                    unavailable: "no value in the scores file".into(),
                },
            };
            scores.insert((*key).to_owned(), score);
        }
        let status = match text(10) {
            "ok" => Status::Ok,
            reason => Status::Failed {
                reason: if reason.is_empty() {
                    "no status"
                } else {
                    reason
                }
                .to_owned(),
            },
        };
        records.push(Record {
            pair_id: text(0).to_owned(),
            dataset: text(1).to_owned(),
            scene: text(2).to_owned(),
            cluster: text(2).to_owned(),
            source: text(3).to_owned(),
            target: text(4).to_owned(),
            method: text(5).to_owned(),
            baseline_m: number(6, FACTS[6])?,
            rotation_deg: number(7, FACTS[7])?,
            median_depth_m: optional(8, FACTS[8])?,
            overlap: optional(9, FACTS[9])?,
            scores: if status == Status::Ok {
                scores
            } else {
                BTreeMap::new()
            },
            status,
            extras: BTreeMap::new(),
        });
    }
    Ok(records)
}

/// A number, or one of the texts that stand for those that are not finite.
fn parse(text: &str) -> Option<f64> {
    match text {
        "inf" => Some(f64::INFINITY),
        "-inf" => Some(f64::NEG_INFINITY),
        "nan" => Some(f64::NAN),
        _ => text.parse().ok().filter(|v: &f64| v.is_finite()),
    }
}
