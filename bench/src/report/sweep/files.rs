//! A sweep into a folder.

use std::path::{Path, PathBuf};

use super::study::Sweep;
use super::{figure, table};
use crate::io::atomic_files::{FileError, write_over_own};
use crate::report::error::ReportError;
use crate::report::plots::style::FigureStyle;

/// Writes `sweep-METRIC.svg`, `.png` and `.pdf` of each metric, `sweep.csv`, `sweep.tex`, and where crossings were asked for
/// `crossings.csv`.
///
/// # Errors
/// When a file cannot be written, or one of those names is somebody else's.
pub fn write(sweep: &Sweep, out: &Path, style: &FigureStyle) -> Result<Vec<PathBuf>, ReportError> {
    let encoded = |bytes: Result<Vec<u8>, ::csv::Error>| {
        bytes.map_err(|error| FileError::new(out, "encode")(error.into()))
    };
    let mut files = Vec::new();
    for (metric, figure) in figure::figures(sweep, style)? {
        files.extend(figure.write(out, &format!("sweep-{}", metric.slug()))?);
    }
    let mut texts = vec![
        ("sweep.csv", encoded(table::csv(sweep))?, table::COLUMNS),
        ("sweep.tex", table::latex(sweep).into_bytes(), table::MARK),
    ];
    if !sweep.crossings.is_empty() {
        let bytes = encoded(table::crossings_csv(sweep))?;
        texts.push(("crossings.csv", bytes, table::CROSSINGS));
    }
    for (name, bytes, mark) in texts {
        let path = out.join(name);
        write_over_own(&path, &bytes, mark)?;
        files.push(path);
    }
    Ok(files)
}
