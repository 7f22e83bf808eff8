//! Output of an explanation, for readers and for programs.

use std::path::{Path, PathBuf};

use serde::Serialize;
use sharp_metrics::identity::MetricRegion;

use crate::evaluate::record::finite_or_text;
use crate::io::atomic_files::write_all_over_own;
use crate::io::text::visible;
use crate::report::ReportError;
use crate::report::tables::csv::csv_of;
use crate::report::tables::grid::{GridCell, TextGrid};
use crate::report::tables::markdown::{escape, rich};

use super::cells::{Agreement, CellExplanation};
use super::joint::JointReading;
use super::{ExplainedRun, Explanation};

/// Maximum number of joint readings shown per dataset; files contain all of them.
const SHOWN: usize = 6;
/// Maximum number of readings named per cell.
const NAMED: usize = 8;

/// One reading of one cell, as written to files.
#[derive(Debug, Clone, PartialEq, Serialize)]
pub struct ReadingLine<'a> {
    pub dataset: &'a str,
    pub metric: &'a str,
    pub key: String,
    pub picture: &'static str,
    pub scenes: &'static str,
    pub averaging: String,
    pub n: usize,
    #[serde(with = "finite_or_text")]
    pub value: f64,
    pub published: f64,
    #[serde(with = "finite_or_text")]
    pub difference: f64,
    /// Whether the value rounds to the published number.
    pub equal: bool,
}

impl Explanation {
    /// Every reading of every cell, one line each.
    pub fn lines(&self) -> Vec<ReadingLine<'_>> {
        let mut lines = Vec::new();
        for cell in &self.cells {
            for value in &cell.readings {
                let reading = value.reading;
                lines.push(ReadingLine {
                    dataset: &cell.dataset,
                    metric: &cell.metric.label,
                    key: reading.key.to_string(),
                    picture: reading.picture.name(),
                    scenes: reading.scenes.name(),
                    averaging: reading.averaging.name(),
                    n: value.n,
                    value: value.value,
                    published: cell.published,
                    difference: value.value - cell.published,
                    equal: cell.prints(value.value),
                });
            }
        }
        lines
    }

    /// A table of the cells with their verdicts, and for each dataset a table of the nearest joint
    /// readings.
    fn grids(&self) -> Vec<TextGrid> {
        let by_dataset = self.joint_readings.chunk_by(|a, b| a.column == b.column);
        [self.verdicts()]
            .into_iter()
            .chain(by_dataset.map(nearest))
            .collect()
    }

    /// Plain text for a terminal.
    pub fn text(&self) -> String {
        let mut parts: Vec<String> = self.grids().iter().map(TextGrid::text).collect();
        let absent = self.absent.iter().map(|text| format!("  {text}\n"));
        parts.push(format!("Not computed\n{}", absent.collect::<String>()));
        parts.join("\n")
    }

    /// GitHub-flavoured Markdown with second-level headings.
    pub fn markdown(&self) -> String {
        let grids = self.grids();
        let mut parts: Vec<String> = grids
            .iter()
            .map(|grid| format!("## {}\n\n{}", grid.title, grid.markdown()))
            .collect();
        let absent = self.absent.iter().map(|text| format!("- {}\n", rich(text)));
        parts.push(format!("## Not computed\n\n{}", absent.collect::<String>()));
        parts.join("\n")
    }

    fn verdicts(&self) -> TextGrid {
        let rows = self.cells.iter().map(|cell| {
            let shown = |value: Option<f64>| match value {
                Some(value) => GridCell::rounded(value, cell.metric.decimals),
                None => GridCell::number("n/a", f64::NAN),
            };
            let spread = cell.spread().map_or_else(String::new, |(low, high)| {
                format!("{} … {}", cell.metric.shown(low), cell.metric.shown(high))
            });
            vec![
                GridCell::words(cell.column),
                GridCell::words(&cell.metric.label),
                shown(Some(cell.published)),
                shown(cell.as_scored),
                shown(cell.as_scored.map(|value| value - cell.published)),
                GridCell::words(match cell.readings.first() {
                    Some(first) if first.n < cell.pairs => format!("{} of {}", first.n, cell.pairs),
                    Some(first) => first.n.to_string(),
                    None => format!("0 of {}", cell.pairs),
                }),
                GridCell::words(spread),
                GridCell::count(cell.readings.len()),
                GridCell::words(cell.verdict.words()),
            ]
        });
        let heads = [
            "dataset",
            "metric",
            "published",
            "here",
            "difference",
            "pairs",
            "all readings",
            "readings",
            "verdict",
        ];
        let title = "Published numbers and the readings of these predictions";
        TextGrid::new(title, &heads, rows).remarked(self.cells.iter().filter_map(candidates))
    }
}

impl ExplainedRun {
    fn title(&self) -> String {
        let (method, path) = (&self.method, self.path.display());
        format!("{method} of {path}, compared with {}", self.published)
    }
}

/// Plain text for a terminal.
pub fn terminal(runs: &[ExplainedRun]) -> String {
    let parts = runs
        .iter()
        .map(|run| format!("{}\n\n{}", run.title(), run.explanation.text()));
    parts.collect::<Vec<_>>().join("\n")
}

/// Start of an `explain.md` written by this program; other files of that name are not overwritten.
const MARK: &str = "<!-- sharp-bench explain -->";
/// Start of a `readings.csv` written by this program; other files of that name are not overwritten.
const CSV_MARK: &str = "dataset,metric,key,picture";

/// Writes `explain.md` and `readings.csv`, which has one line per reading.
///
/// # Errors
/// If a file cannot be written, or exists and was not written by this program.
pub fn write_explanations(runs: &[ExplainedRun], out: &Path) -> Result<Vec<PathBuf>, ReportError> {
    let mut page = format!("{MARK}\n");
    for run in runs {
        page += &format!(
            "\n# {}\n\n{}",
            escape(&run.title()),
            run.explanation.markdown()
        );
    }
    let csv = csv_of(runs.iter().flat_map(|run| run.explanation.lines()))?;
    let files = [
        ("explain.md", page.into(), MARK),
        ("readings.csv", String::from_utf8_lossy(&csv), CSV_MARK),
    ];
    let files = files.map(|(name, text, mark)| (out.join(name), visible(&text).into_owned(), mark));
    Ok(write_all_over_own(&files)?)
}

/// The readings that round to the published number, as text.
fn candidates(cell: &CellExplanation) -> Option<String> {
    if !matches!(cell.verdict, Agreement::Equal | Agreement::Ambiguous) {
        return None;
    }
    let found = cell.candidates();
    let named = found.iter().take(NAMED).map(|value| {
        let reading = value.reading;
        let value = format!("{:.*}", cell.metric.decimals + 2, value.value);
        format!("`{}` {} ({value})", reading.key, reading.words())
    });
    let named: Vec<String> = named.collect();
    let more = match found.len().saturating_sub(NAMED) {
        0 => String::new(),
        more => format!("; and {more} more"),
    };
    Some(format!(
        "{} {} {}: {}{more}.",
        cell.column,
        cell.metric.label,
        cell.metric.shown(cell.published),
        named.join("; ")
    ))
}

fn nearest(all: &[JointReading]) -> TextGrid {
    let mut heads = vec!["picture", "scenes", "averaging", "region"];
    heads.extend(all[0].variants.iter().map(|v| v.metric.as_str()));
    heads.push("farthest");
    let rows = all.iter().take(SHOWN).map(|joint| {
        let mut row = vec![
            GridCell::words(joint.picture.name()),
            GridCell::words(joint.scenes.name()),
            GridCell::words(joint.averaging.name()),
            GridCell::words(match joint.region {
                MetricRegion::Whole => "whole picture",
                _ => "frustum",
            }),
        ];
        row.extend(joint.variants.iter().map(|variant| {
            GridCell::words(format!(
                "{} {:.4} ({:+.4})",
                variant.key, variant.value, variant.distance
            ))
        }));
        row.push(GridCell::number(
            format!("{:.0}", joint.farthest),
            joint.farthest,
        ));
        row
    });
    let title = format!(
        "{}: the nearest of {} joint readings of all metrics",
        all[0].column,
        all.len()
    );
    TextGrid::new(title, &heads, rows).remarked([
        "For each metric, the nearest variant with its value and its distance to the published number. Farthest: \
         the largest of these distances, in halves of the last published digit; at 1 or less, all numbers round to \
         the published ones."
            .to_owned(),
    ])
}
