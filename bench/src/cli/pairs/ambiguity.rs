//! `pairs --ambiguity`: how the number of pairs changes over the open choices.

use std::collections::BTreeSet;

use serde_json::{Map, Value, json};
use sharp_datasets::DatasetSpec;

use super::super::data_args::{self, OpenDataset};
use super::super::{Outcome, output};
use crate::protocol::PairOptions;
use crate::protocol::ambiguity::{Alternative, Count, Reading};

pub(super) fn print(
    rows: &[Alternative],
    base: &PairOptions,
    json: bool,
) -> anyhow::Result<Outcome> {
    if json {
        let rows: Vec<Value> = rows.iter().map(row_json).collect();
        output::json(&json!({ "options": base.to_string(), "choices": rows }))?;
        return Ok(Outcome::Done);
    }
    let datasets: BTreeSet<&String> = rows
        .iter()
        .flat_map(|row| row.counts.keys().chain(row.unavailable.keys()))
        .collect();
    for dataset in datasets {
        output::line(format!("{dataset}, one choice changed at a time:"))?;
        output::line(format!(
            "  {:<18} {:<28} {:>8} {:>8} {:>8}",
            "about", "choice", "qualify", "selected", "shared"
        ))?;
        for row in rows {
            let change = if row.change.is_empty() {
                "(as given)"
            } else {
                &row.change
            };
            if let Some(count) = row.counts.get(dataset) {
                output::line(format!(
                    "  {:<18} {change:<28} {:>8} {:>8} {:>8}",
                    row.about, count.qualified, count.selected, count.shared
                ))?;
            } else if let Some(reason) = row.unavailable.get(dataset) {
                output::line(format!(
                    "  {:<18} {change:<28} cannot be opened: {reason}",
                    row.about
                ))?;
            }
        }
    }
    output::line(
        "shared: pairs that are selected as given, too; a choice that does not concern a dataset is left out",
    )?;
    output::line(format!("as given: {base}"))?;
    Ok(Outcome::Done)
}

fn row_json(row: &Alternative) -> Value {
    let counts: Map<String, Value> = row
        .counts
        .iter()
        .map(|(dataset, count)| {
            let Count {
                qualified,
                selected,
                shared,
            } = count;
            let count = json!({ "qualified": qualified, "selected": selected, "shared": shared });
            (dataset.clone(), count)
        })
        .collect();
    json!({
        "about": row.about,
        "change": row.change,
        "datasets": counts,
        "unavailable": row.unavailable,
    })
}

/// Settings that are no readings of the paper: which files may be opened, and what becomes of pictures that are not their
/// camera's size.
const NO_READINGS: [&str; 2] = ["outside", "camera-size"];

/// Each dataset under every other choice of its settings, opened as far as its files allow.
pub(super) fn readings(
    datasets: &[OpenDataset],
    only_scenes: Option<&str>,
) -> anyhow::Result<Vec<Reading>> {
    let mut readings = Vec::new();
    for dataset in datasets {
        let spec = DatasetSpec::parse(&dataset.spec)?;
        let settings = spec.entry.settings.iter();
        let of_paper = settings.filter(|s| !NO_READINGS.contains(&s.key));
        for setting in of_paper {
            let others = setting.choices.iter().map(|choice| choice.value);
            for value in others.filter(|value| *value != spec.setting(setting.key)) {
                let mut other = spec.clone();
                other.settings.insert(setting.key, value.to_owned());
                let opened = data_args::open(&[other.to_string()], only_scenes);
                let opened = opened.map(|mut opened| opened.pop());
                readings.push(Reading {
                    dataset: dataset.name.clone(),
                    change: format!("{}={value}", setting.key),
                    settings: format!("{} {:?}", other.entry.format, other.settings),
                    scenes: match opened {
                        Ok(opened) => Ok(opened.map_or_else(Vec::new, |found| found.scenes)),
                        Err(error) => Err(error.to_string()),
                    },
                });
            }
        }
    }
    Ok(readings)
}
