//! Writes a sweep to a folder.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use super::study::Sweep;
use super::{figure, table};
use crate::io::atomic_files::{remove_own, write_all_over_own};
use crate::io::text::csv_text;
use crate::report::column::slug;
use crate::report::error::ReportError;
use crate::report::plots;
use sharp_plots::style::FigureStyle;

/// Files that a sweep wrote into a folder, and removed from it.
#[derive(Debug)]
pub struct SweepFiles {
    pub written: Vec<PathBuf>,
    /// Removed files of an earlier sweep with other metrics or crossings, which would be mistaken for files of the new
    /// sweep.
    pub removed: Vec<PathBuf>,
}

/// Writes `STEM-METRIC.svg`, `.png` and `.pdf` of each metric, `STEM.csv`, `STEM.tex`, and `STEM-crossings.csv` if
/// crossings were requested.
///
/// # Errors
/// If a file cannot be written, or exists and was not written by this program. In the second case, nothing is written.
pub fn write(
    sweep: &Sweep,
    out: &Path,
    stem: &str,
    style: &FigureStyle,
) -> Result<SweepFiles, ReportError> {
    let mut files = Vec::new();
    for (metric, figure) in figure::figures(sweep, style)? {
        files.extend(plots::files(
            figure,
            out,
            &format!("{stem}-{}", metric.slug()),
        ));
    }
    let named = |end: &str| out.join(format!("{stem}{end}"));
    let tex = table::latex(sweep).into_bytes();
    files.push((named(".csv"), table::csv(sweep), table::COLUMNS));
    files.push((named(".tex"), tex, table::MARK));
    if !sweep.crossings.is_empty() {
        let bytes = table::crossings_csv(sweep);
        files.push((named("-crossings.csv"), bytes, table::CROSSINGS));
    }
    let earlier = earlier(out, stem);
    let written = write_all_over_own(&files)?;
    let mut removed = Vec::new();
    for (path, mark) in earlier {
        if !written.contains(&path) && remove_own(&path, mark)? {
            removed.push(path);
        }
    }
    Ok(SweepFiles { written, removed })
}

/// Files that an earlier sweep may have left in addition to its main table: its crossings, and a plot for each metric
/// in that table. Each has the mark that identifies it for [`remove_own`].
fn earlier(out: &Path, stem: &str) -> BTreeMap<PathBuf, &'static str> {
    let named = |end: &str| out.join(format!("{stem}{end}"));
    let table = sharp::files::read(&named(".csv")).unwrap_or_default();
    let mut rows = ::csv::Reader::from_reader(table.as_slice());
    let place = table::COLUMNS.split(',').position(|name| name == "metric");
    let mut files = BTreeMap::from([(named("-crossings.csv"), table::CROSSINGS)]);
    let metrics = rows.records().flatten();
    let metrics = metrics.filter_map(|row| Some(slug(csv_text(row.get(place?)?))));
    let names = metrics.flat_map(|metric| plots::FORMS.map(|form| format!("-{metric}.{form}")));
    files.extend(names.map(|name| (named(&name), plots::MARK)));
    files
}
