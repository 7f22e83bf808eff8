//! The report as text: tables, plots by reference, and how the numbers came about.

use std::fmt::Write as _;

use super::input::{Metric, ReportInput};
use super::records::Board;
use super::tables::Table;
use super::tables::markdown::{escape, markdown};

/// A plot by its file, relative to the report.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct PlotFile {
    /// What it shows.
    pub title: String,
    /// Relative path of the PNG, with `/`.
    pub png: String,
}

/// GitHub-flavoured Markdown.
pub fn report(
    input: &ReportInput<'_>,
    board: &Board<'_>,
    ours: &[Table],
    published: &[Table],
    plots: &[PlotFile],
) -> String {
    let mut out = format!(
        "# {}\n\n{}\n\n",
        escape(&input.title),
        escape(&input.summary)
    );
    for table in ours {
        let _ = write!(out, "## {}\n\n{}\n", escape(&table.title), markdown(table));
    }
    let failures = board.failures();
    if !failures.is_empty() {
        let _ = write!(out, "## Failures ({})\n\n", failures.len());
        for (record, reason) in failures.iter().take(20) {
            let _ = writeln!(
                out,
                "- {}, {}: {}",
                escape(&record.pair_id),
                escape(&record.method),
                escape(reason)
            );
        }
        if failures.len() > 20 {
            let _ = writeln!(out, "- and {} more, in the records", failures.len() - 20);
        }
        out.push('\n');
    }
    if !published.is_empty() {
        out.push_str("## Published numbers\n\n");
        for table in published {
            let _ = write!(out, "### {}\n\n{}\n", escape(&table.title), markdown(table));
        }
    }
    if !plots.is_empty() {
        out.push_str("## Plots\n\n");
        for plot in plots {
            let _ = write!(out, "![{}]({})\n\n", escape(&plot.title), plot.png);
        }
    }
    out.push_str("## How the numbers came about\n\n");
    for metric in input.metrics.iter().chain(&input.extras) {
        let _ = writeln!(
            out,
            "- `{}` ({}{}): {}",
            metric.key.replace('`', "'"),
            metric.better.words(),
            unit(metric),
            escape(&metric.convention)
        );
    }
    for method in board.methods.iter().filter(|m| !m.description.is_empty()) {
        let _ = writeln!(
            out,
            "- Method {}: {}",
            escape(&method.label),
            escape(&method.description)
        );
    }
    for dataset in board.datasets.iter().map(|d| &d.dataset) {
        if !dataset.description.is_empty() {
            let _ = writeln!(
                out,
                "- Dataset {}: {}",
                escape(&dataset.name),
                escape(&dataset.description)
            );
        }
    }
    for group in &input.facts {
        let _ = write!(
            out,
            "\n### {}\n\n| | |\n|:---|:---|\n",
            escape(&group.title)
        );
        for (name, value) in &group.facts {
            let _ = writeln!(out, "| {} | {} |", escape(name), escape(value));
        }
    }
    out
}

fn unit(metric: &Metric) -> String {
    if metric.unit.is_empty() {
        String::new()
    } else {
        format!(", {}", metric.unit)
    }
}
