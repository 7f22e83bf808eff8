//! A sweep into a folder.

use std::path::{Path, PathBuf};

use super::study::Sweep;
use super::{figure, table};
use crate::io::atomic_files::{FileError, write_over_own};
use crate::report::error::ReportError;
use crate::report::plots::style::FigureStyle;

/// Writes `STEM-METRIC.svg`, `.png` and `.pdf` of each metric, `STEM.csv`, `STEM.tex`, and where crossings were asked for
/// `STEM-crossings.csv`.
///
/// # Errors
/// When a file cannot be written, or one of those names is somebody else's.
pub fn write(
    sweep: &Sweep,
    out: &Path,
    stem: &str,
    style: &FigureStyle,
) -> Result<Vec<PathBuf>, ReportError> {
    let encoded = |bytes: Result<Vec<u8>, ::csv::Error>| {
        bytes.map_err(|error| FileError::new(out, "encode")(error.into()))
    };
    let mut files = Vec::new();
    for (metric, figure) in figure::figures(sweep, style)? {
        files.extend(figure.write(out, &format!("{stem}-{}", metric.slug()))?);
    }
    let mut texts = vec![
        (".csv", encoded(table::csv(sweep))?, table::COLUMNS),
        (".tex", table::latex(sweep).into_bytes(), table::MARK),
    ];
    if !sweep.crossings.is_empty() {
        let bytes = encoded(table::crossings_csv(sweep))?;
        texts.push(("-crossings.csv", bytes, table::CROSSINGS));
    }
    for (end, bytes, mark) in texts {
        let path = out.join(format!("{stem}{end}"));
        write_over_own(&path, &bytes, mark)?;
        files.push(path);
    }
    Ok(files)
}
