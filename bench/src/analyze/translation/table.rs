//! The comparisons as a table in the paper's layout, and the paper's published numbers.

use super::experiment::Experiment;
use crate::io::text::csv_bytes;
use crate::pictures::keyed_scores::csv_cells;
use crate::report::column::Column;
use crate::report::paper;
use crate::report::tables::csv::optional;
use crate::report::tables::{Cell, Group, Row, Table};

/// Tabulates an experiment on the picture called `name`.
pub fn table(experiment: &Experiment, name: &str) -> Table {
    let mut notes = vec![method_note(experiment)];
    let rows = experiment.comparisons.iter().map(|comparison| {
        let cells = comparison.scores.iter().map(|(key, score)| {
            let value = score.as_ref().ok().copied();
            let missing = score.as_ref().err().map(|reason| {
                let text = format!("No {} (`{key}`): {reason}.", key.label());
                Table::note(&mut notes, text)
            });
            Cell {
                infinite: usize::from(value.is_some_and(f64::is_infinite)),
                notes: missing.into_iter().collect(),
                ..Cell::of(value)
            }
        });
        Row {
            note: Some(0),
            ..Row::measured(comparison.label(), cells.collect())
        }
    });
    let rows = rows.collect();
    let (width, height) = experiment.reference.dimensions();
    let groups = vec![Group::titled(&format!("{name} ({width} × {height})"))];
    let columns = experiment.keys().into_iter().map(Column::from).collect();
    let title = "Sensitivity of metrics to small image shifts";
    Table {
        row_head: "comparison",
        notes,
        ..Table::new("translation", title, groups, columns, rows)
    }
}

/// The numbers published in the paper. These numbers have a separate table, because they were
/// measured on another picture and under conventions that the paper does not state.
pub fn published() -> Option<Table> {
    let mut table = paper::published("metrics_comparison")?.table(&[0]);
    table.name = "translation-published".to_owned();
    table.title = format!("Published: {}", table.title.to_lowercase());
    table.groups = vec![Group::titled("SHARP paper")];
    Some(table)
}

fn method_note(experiment: &Experiment) -> String {
    let shifts = experiment.comparisons.iter().filter_map(|c| c.shift);
    let pixels: Vec<String> = shifts.map(|(_, pixels)| format!("{pixels:.2}")).collect();
    format!(
        "Windows of this size, moved over the picture by a fraction of its width ({} pixels), are compared with the \
         window at the start. Pixels are linearly interpolated and rounded to 8 bits; no border is filled in. The mean \
         image has the mean sRGB colour of the window at the start.",
        pixels.join(", ")
    )
}

/// One row per comparison at full precision: `comparison,shift_percent,shift_px`, then one column
/// per metric. The cell of an unavailable score is empty, and the last column gives the reason.
pub fn csv(experiment: &Experiment) -> Vec<u8> {
    let mut heads: Vec<String> = ["comparison", "shift_percent", "shift_px"]
        .map(String::from)
        .into();
    heads.extend(experiment.keys().iter().map(ToString::to_string));
    heads.push("unavailable".to_owned());
    let rows = experiment.comparisons.iter().map(|comparison| {
        let (percent, pixels) = comparison.shift.unzip();
        let cells = [comparison.label(), optional(percent), optional(pixels)];
        cells.into_iter().chain(csv_cells(&comparison.scores))
    });
    csv_bytes(heads, rows)
}
