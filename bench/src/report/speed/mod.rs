//! Run time as tabulated in the paper, and a summary of the computing time behind a paper's numbers.
//!
//! * [`spread`]: median and spread of rounds; [`tables`]: methods by datasets, and details of the times; [`compute`]:
//!   hardware and hours of runs, from the times in their folders; [`lines`]: reads `speed.csv`.

pub mod compute;
pub mod lines;
pub mod spread;
pub mod tables;

use std::path::{Path, PathBuf};

use super::ReportError;
use super::tables::grid::TextGrid;
use super::tables::{latex, markdown};
use crate::evaluate::Manifest;
use crate::evaluate::speed::{Speed, SpeedOptions};
use crate::io::atomic_files::write_all_over_own;

/// The times that `speed` has measured, and how.
#[derive(Debug, Clone, PartialEq)]
pub struct Measured {
    pub speeds: Vec<Speed>,
    pub options: SpeedOptions,
    /// Manifest of the measured evaluation.
    pub manifest: Manifest,
    /// Processor and threads; `None` if the system does not report them.
    pub machine: Option<String>,
}

/// Everything that `speed` reports.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct SpeedReport {
    pub measured: Option<Measured>,
    /// Hardware and hours of runs.
    pub compute: Option<TextGrid>,
}

/// Marks files written by this program; other files are not overwritten.
const MARK: &str = "sharp-bench speed";

impl SpeedReport {
    fn grids(&self) -> Vec<TextGrid> {
        let details = self.measured.as_ref().map(tables::details);
        details.into_iter().chain(self.compute.clone()).collect()
    }

    /// Plain text for a terminal.
    pub fn text(&self) -> String {
        let table = self.measured.as_ref().map(|m| tables::table(m).text());
        let grids = self.grids();
        let parts = table.into_iter().chain(grids.iter().map(TextGrid::text));
        parts.collect::<Vec<_>>().join("\n")
    }

    /// Writes `speed.md`, `speed.tex` and, if there are measurements, `speed.csv`.
    ///
    /// # Errors
    /// If a file cannot be written, or exists and was not written by this program. In the second case, nothing is
    /// written.
    pub fn write(&self, folder: &Path) -> Result<Vec<PathBuf>, ReportError> {
        let mut md = format!("<!-- {MARK} -->\n");
        let mut tex = format!("% {MARK}\n");
        if let Some(measured) = &self.measured {
            let table = tables::table(measured);
            md += &format!("# {}\n\n{}", table.title, table.markdown());
            tex += &table.latex();
        }
        for grid in self.grids() {
            let title = markdown::escape(&grid.title);
            md += &format!("\n## {title}\n\n{}", grid.markdown());
            tex += &format!("\n{}", latex::grid(&grid));
        }
        let mut files = vec![
            (folder.join("speed.md"), md.into_bytes(), MARK),
            (folder.join("speed.tex"), tex.into_bytes(), MARK),
        ];
        if let Some(measured) = &self.measured {
            let csv = tables::csv(measured);
            files.push((folder.join("speed.csv"), csv, tables::CSV_HEAD));
        }
        Ok(write_all_over_own(&files)?)
    }
}

#[cfg(test)]
mod tests;
