//! Sources of the user's own rows in a table of the paper.

use std::collections::BTreeSet;
use std::convert::Infallible;
use std::path::{Path, PathBuf};

use serde::Deserialize;
use sharp_checkpoint::{Checkpoint, CheckpointError};
use sharp_metrics::MetricKey;

use crate::evaluate::join::{Named, join_results};
use crate::evaluate::{EvaluateError, Results};
use crate::report::board::ReportDataset;
use crate::report::column::Column;
use crate::report::tables::{Cell, Origin, Row};

use super::column;
use super::published::{MadeBy, PublishedTable};

/// Source of a row's numbers, `SOURCE[:METHOD]`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RowSource {
    /// A run folder or bundle, or the file that a table is made of.
    pub path: PathBuf,
    /// Of a source with several.
    pub method: Option<String>,
}

/// A row of one's own, `LABEL=SOURCE[:METHOD]`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct OwnRow {
    pub label: String,
    pub source: RowSource,
}

/// Why there is no such row.
#[derive(Debug, thiserror::Error)]
pub enum RowError {
    #[error("'{0}': LABEL=RUN or LABEL=RUN:METHOD is needed")]
    Form(String),
    #[error("the label '{}' holds a control character", .0.escape_debug())]
    Label(String),
    #[error("the label '{0}' is given twice")]
    Repeated(String),
    #[error("{}: it has {what}; name one of them, {}:METHOD", path.display(), path.display())]
    Method {
        path: PathBuf,
        /// The methods that are there, in words.
        what: String,
    },
    #[error("{}: {reason}", path.display())]
    Unusable { path: PathBuf, reason: String },
    #[error("the paper has one column of {column}, and the rows have the datasets {}", names.join(" and "))]
    Ambiguous {
        column: &'static str,
        names: Vec<String>,
    },
    #[error(transparent)]
    Evaluate(#[from] EvaluateError),
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    #[error(transparent)]
    Report(#[from] crate::report::ReportError),
}

impl std::str::FromStr for RowSource {
    type Err = Infallible;

    /// What follows the last colon is a method unless the path with it exists.
    fn from_str(text: &str) -> Result<Self, Infallible> {
        let source = |path: &str, method: Option<&str>| Self {
            path: path.into(),
            method: method.map(str::to_owned),
        };
        Ok(match text.rsplit_once(':') {
            Some((path, method))
                if !Path::new(text).exists() && !path.is_empty() && !method.is_empty() =>
            {
                source(path, Some(method))
            }
            _ => source(text, None),
        })
    }
}

impl RowSource {
    /// The method that is meant, of those that are there.
    ///
    /// # Errors
    /// When it is not there, or none is named of several.
    pub fn chosen<'a>(
        &self,
        methods: impl IntoIterator<Item = &'a str>,
    ) -> Result<&'a str, RowError> {
        let methods: BTreeSet<&str> = methods.into_iter().collect();
        let named = self.method.as_deref();
        let mut found = methods
            .iter()
            .filter(|method| named.is_none_or(|named| named == **method));
        match (found.next(), found.next()) {
            (Some(only), None) => Ok(only),
            _ => Err(RowError::Method {
                path: self.path.clone(),
                what: match methods.is_empty() {
                    true => "no methods".to_owned(),
                    false => format!("the methods {}", Vec::from_iter(methods).join(", ")),
                },
            }),
        }
    }
}

impl std::str::FromStr for OwnRow {
    type Err = RowError;

    fn from_str(text: &str) -> Result<Self, RowError> {
        let wrong = || RowError::Form(text.to_owned());
        let (label, source) = text.split_once('=').ok_or_else(wrong)?;
        if label.trim().is_empty() || source.is_empty() {
            return Err(wrong());
        }
        if label.contains(char::is_control) {
            return Err(RowError::Label(label.to_owned()));
        }
        let Ok(source) = source.parse();
        Ok(Self {
            label: label.to_owned(),
            source,
        })
    }
}

/// The numbers behind rows of one's own.
#[derive(Debug)]
pub enum OwnRows {
    /// Each method is a row.
    Scores(Box<Results>),
    /// Rows of a table without pairs, with its columns as they were measured.
    Measured {
        columns: Vec<Column>,
        rows: Vec<Row>,
    },
}

impl OwnRows {
    /// Reads what a table of the paper is made of.
    ///
    /// # Errors
    /// When a label is given twice, or a source cannot be read, is something else or contradicts another.
    pub fn read(paper: &PublishedTable, rows: &[OwnRow]) -> Result<Self, RowError> {
        for (at, row) in rows.iter().enumerate() {
            if rows[..at].iter().any(|before| before.label == row.label) {
                return Err(RowError::Repeated(row.label.clone()));
            }
        }
        match paper.made_by {
            MadeBy::Run | MadeBy::PrivilegedRun => scores(rows),
            MadeBy::Translation => translations(paper, rows),
            MadeBy::Checkpoint => checkpoints(paper, rows),
            MadeBy::Speed => speeds(paper, rows),
        }
    }
}

fn scores(rows: &[OwnRow]) -> Result<OwnRows, RowError> {
    let mut read = Vec::new();
    for row in rows {
        let mut results = Results::read(&row.source.path)?;
        let methods = &mut results.manifest.methods;
        let chosen = row
            .source
            .chosen(methods.iter().map(|m| m.label.as_str()))?
            .to_owned();
        methods.retain(|method| method.label == chosen);
        results.records.retain(|record| record.method == chosen);
        results.missing.retain(|(_, method)| *method == chosen);
        let named = Named {
            name: Some(row.label.clone()),
            path: row.source.path.clone(),
        };
        read.push((named, results));
    }
    Ok(OwnRows::Scores(Box::new(join_results(read)?)))
}

/// A row for each comparison in the output of `analyze translation --out`.
fn translations(paper: &PublishedTable, rows: &[OwnRow]) -> Result<OwnRows, RowError> {
    let mut columns: Vec<Column> = Vec::new();
    let mut measured = Vec::new();
    for row in rows {
        let (unusable, bytes) = file_of(row, "translation.csv")?;
        let mut csv = ::csv::Reader::from_reader(bytes.as_slice());
        let heads = csv
            .headers()
            .map_err(|error| unusable(error.to_string()))?
            .clone();
        if heads.get(0) != Some("comparison") {
            return Err(unusable(
                "no table of `analyze translation --out`".to_owned(),
            ));
        }
        let keys: Vec<Option<MetricKey>> = heads.iter().map(|head| head.parse().ok()).collect();
        // The default variant of each metric, or else the first that is there.
        let places = paper.metrics.iter().map(|name| {
            let of_family = |key: &MetricKey| key.family().name().eq_ignore_ascii_case(name);
            let found = keys
                .iter()
                .enumerate()
                .filter_map(|(at, key)| Some((at, (*key)?)));
            let found: Vec<(usize, MetricKey)> = found.filter(|(_, key)| of_family(key)).collect();
            let default = found
                .iter()
                .find(|(_, key)| key.family().name().parse() == Ok(*key));
            default.or(found.first()).copied()
        });
        let places: Option<Vec<(usize, MetricKey)>> = places.collect();
        let places = places
            .ok_or_else(|| unusable(format!("it lacks one of {}", paper.metrics.join(", "))))?;
        let of_row: Vec<Column> = places.iter().map(|(_, key)| Column::from(*key)).collect();
        if measured.is_empty() {
            columns = of_row;
        } else if columns != of_row {
            return Err(unusable(
                "its metrics are other variants than those of the rows before".to_owned(),
            ));
        }
        for line in csv.records() {
            let line = line.map_err(|error| unusable(error.to_string()))?;
            let cells = places.iter().map(|(at, _)| {
                let value = line.get(*at).unwrap_or_default().parse();
                Cell {
                    value: value.ok(),
                    ..Cell::default()
                }
            });
            measured.push(Row {
                label: format!("{}: {}", row.label, line.get(0).unwrap_or_default()),
                origin: Origin::Measured,
                note: None,
                cells: cells.collect(),
            });
        }
    }
    Ok(OwnRows::Measured {
        columns,
        rows: measured,
    })
}

/// A row for each checkpoint: the elements of its tensors.
fn checkpoints(paper: &PublishedTable, rows: &[OwnRow]) -> Result<OwnRows, RowError> {
    let mut measured = Vec::new();
    for row in rows {
        let checkpoint = Checkpoint::open(&row.source.path)?;
        let mut total = 0_usize;
        for name in checkpoint.names() {
            total += checkpoint.shape(name)?.iter().product::<usize>();
        }
        // A checkpoint does not say which of its parameters were trained.
        let millions = total as f64 / 1e6;
        let cells = paper.metrics.iter().map(|metric| match *metric {
            "total" => Cell {
                value: Some(millions),
                printed: Some(format!("{millions:.*}M", usize::from(millions < 10.0))),
                ..Cell::default()
            },
            _ => Cell {
                printed: Some("–".to_owned()),
                ..Cell::default()
            },
        });
        measured.push(Row {
            label: row.label.clone(),
            origin: Origin::Measured,
            note: None,
            cells: cells.collect(),
        });
    }
    let columns = paper.columns().into_iter().map(|column| Column {
        key: format!("parameters_{}", column.label),
        ..column
    });
    Ok(OwnRows::Measured {
        columns: columns.collect(),
        rows: measured,
    })
}

/// A line of `speed.csv`.
#[derive(Deserialize)]
struct SpeedLine {
    method: String,
    dataset: String,
    format: String,
    quantity: String,
    n: usize,
    median: f64,
}

/// A row for each method that `speed` measured.
fn speeds(paper: &PublishedTable, rows: &[OwnRow]) -> Result<OwnRows, RowError> {
    let mut measured = Vec::new();
    for row in rows {
        let (unusable, bytes) = file_of(row, "speed.csv")?;
        let lines: Result<Vec<SpeedLine>, _> = ::csv::Reader::from_reader(bytes.as_slice())
            .deserialize()
            .collect();
        let lines =
            lines.map_err(|error| unusable(format!("no table of `speed --out`: {error}")))?;
        if lines.is_empty() {
            return Err(unusable(
                "no table of `speed --out`: it is empty".to_owned(),
            ));
        }
        if let Some(line) = lines
            .iter()
            .find(|line| !(line.median.is_finite() && line.median >= 0.0))
        {
            let reason = format!(
                "the {} of {} is {}",
                line.quantity, line.method, line.median
            );
            return Err(unusable(reason));
        }
        let method = row
            .source
            .chosen(lines.iter().map(|line| line.method.as_str()))?;
        let column_of = |line: &SpeedLine| column(&ReportDataset::of(&line.dataset, &line.format));
        let cells = paper.datasets.iter().flat_map(|dataset| {
            paper.metrics.iter().map(|metric| {
                let (quantity, factor) = match *metric {
                    "Inference" => ("inference_secs", 1.0),
                    "Render" => ("render_secs", 1.0),
                    _ => ("render_secs", 1000.0),
                };
                let of_method = lines
                    .iter()
                    .filter(|line| line.method == method && line.quantity == quantity);
                let found = of_method
                    .into_iter()
                    .find(|line| column_of(line) == Some(*dataset));
                match found {
                    Some(line) => Cell {
                        value: Some(line.median * factor),
                        coverage: Some((line.n, line.n)),
                        ..Cell::default()
                    },
                    None => Cell {
                        printed: Some("–".to_owned()),
                        ..Cell::default()
                    },
                }
            })
        });
        measured.push(Row {
            label: row.label.clone(),
            origin: Origin::Measured,
            note: None,
            cells: cells.collect(),
        });
    }
    let columns = paper.columns().into_iter().map(|published| Column {
        key: format!("{}_median", published.label.to_lowercase()),
        convention: "median over rounds and pairs, measured by `speed`".to_owned(),
        ..published
    });
    Ok(OwnRows::Measured {
        columns: columns.collect(),
        rows: measured,
    })
}

/// The bytes of a row's source, or of the file of that name in it where it is a folder, and the error about it.
fn file_of(row: &OwnRow, name: &str) -> Result<(impl Fn(String) -> RowError, Vec<u8>), RowError> {
    let mut path = row.source.path.clone();
    if path.is_dir() {
        path.push(name);
    }
    let read = sharp::files::read(&path);
    let unusable = move |reason: String| RowError::Unusable {
        path: path.clone(),
        reason,
    };
    match read {
        Ok(bytes) => Ok((unusable, bytes)),
        Err(error) => Err(unusable(error.to_string())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rows_are_labels_sources_and_methods() {
        let row = |text: &str| text.parse::<OwnRow>().unwrap();
        let plain = row("mine=runs/a");
        let RowSource { path, method } = plain.source;
        assert_eq!(
            (plain.label.as_str(), path.to_str(), method),
            ("mine", Some("runs/a"), None)
        );
        let RowSource { path, method } = row("mine=runs/a:depth-splat").source;
        assert_eq!(
            (path.to_str(), method.as_deref()),
            (Some("runs/a"), Some("depth-splat"))
        );
        for wrong in ["runs/a", "=runs/a", "a=", "a\nb=runs/a", "\u{1b}[2J=runs/a"] {
            assert!(wrong.parse::<OwnRow>().is_err(), "{wrong}");
        }
        let folder = tempfile::tempdir().unwrap();
        let odd = folder.path().join("run:1");
        std::fs::create_dir(&odd).unwrap();
        let text = format!("mine={}", odd.display());
        assert_eq!(row(&text).source.path, odd);
    }
}
