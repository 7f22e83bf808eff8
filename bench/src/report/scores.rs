//! Joining the records of several runs.

use std::collections::BTreeMap;

use crate::record::{Record, Score};

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
