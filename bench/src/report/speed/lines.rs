//! `speed.csv`, read back.

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
    /// Empty if it is not known.
    pub format: String,
    /// `inference_secs`, `load_secs`, `render_secs`, ….
    pub quantity: String,
    /// Measurements behind the median.
    pub n: usize,
    /// Finite, 0 or more.
    pub median: f64,
}

impl SpeedLine {
    /// Reads a file that `speed` wrote, or that of a folder.
    ///
    /// # Errors
    /// When it cannot be read, is no such file, is empty, or holds an impossible number.
    pub fn read(path: &Path) -> Result<Vec<Self>, FileError> {
        let path = match path.is_dir() {
            true => path.join("speed.csv"),
            false => path.to_owned(),
        };
        let wrong = |reason: String| {
            let reason = format!("no table of `speed --out`: {reason}");
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
