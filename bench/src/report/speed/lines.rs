//! Reads `speed.csv`.

use std::io;
use std::path::Path;

use serde::Deserialize;

use crate::io::atomic_files::FileError;
use crate::io::text::csv_text;

/// A line of `speed.csv`.
#[derive(Debug, Clone, Deserialize)]
pub struct SpeedLine {
    pub method: String,
    pub dataset: String,
    /// Format of the dataset; empty if unknown.
    pub format: String,
    /// Name of the measured quantity: `inference_secs`, `load_secs`, `render_secs`, ….
    pub quantity: String,
    /// Number of measurements.
    pub n: usize,
    /// Median, finite and at least 0.
    pub median: f64,
}

impl SpeedLine {
    /// Reads a file written by `speed`, or the `speed.csv` in a folder.
    ///
    /// # Errors
    /// If the file cannot be read, was not written by `speed`, is empty, or has an impossible number.
    pub fn read(path: &Path) -> Result<Vec<Self>, FileError> {
        let path = if path.is_dir() {
            path.join("speed.csv")
        } else {
            path.to_owned()
        };
        let wrong = |reason: String| {
            let reason = format!("not a table of `speed --out`: {reason}");
            FileError::new(&path, "read")(io::Error::other(reason))
        };
        let bytes = sharp::files::read(&path).map_err(FileError::new(&path, "read"))?;
        let lines = csv::Reader::from_reader(bytes.as_slice()).into_deserialize();
        let lines: Result<Vec<Self>, csv::Error> = lines.collect();
        let mut lines = lines.map_err(|error| wrong(error.to_string()))?;
        if lines.is_empty() {
            return Err(wrong("it is empty".to_owned()));
        }
        for line in &mut lines {
            if !(line.median.is_finite() && line.median >= 0.0) {
                return Err(wrong(format!(
                    "the {} of {} is {}",
                    line.quantity, line.method, line.median
                )));
            }
            for name in [&mut line.method, &mut line.dataset] {
                *name = csv_text(name).to_owned();
            }
        }
        Ok(lines)
    }
}
