//! `pairs --ambiguity`: how the number of pairs changes over the open choices.

use std::collections::BTreeSet;

use serde_json::{Map, Value, json};

use super::super::{Outcome, output};
use crate::pairs::PairOptions;
use crate::pairs::ambiguity::{Alternative, Count};

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
