//! Sources of the user's own rows in a table of the paper.

use std::collections::BTreeSet;
use std::convert::Infallible;
use std::path::{Path, PathBuf};

use sharp_checkpoint::{Checkpoint, CheckpointError};
use sharp_metrics::MetricKey;
use sharp_train::parts::TrainedParts;

use crate::evaluate::join::{Named, join_results};
use crate::evaluate::{EvaluateError, Results};
use crate::io::atomic_files::FileError;
use crate::report::board::ReportDataset;
use crate::report::column::Column;
use crate::report::speed::lines::SpeedLine;
use crate::report::tables::{Cell, Row};

use super::column;
use super::published::{MadeBy, PublishedTable};

/// Source of a row's numbers, `SOURCE[:METHOD]`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct RowSource {
    /// A run folder or bundle; for tables that are not made from runs, the file or folder that their rows are read
    /// from.
    pub path: PathBuf,
    /// Method to use, if the source has several.
    pub method: Option<String>,
}

/// One of the user's rows, `LABEL=SOURCE[:METHOD]`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct OwnRow {
    pub label: String,
    pub source: RowSource,
}

/// Why a row cannot be read.
#[derive(Debug, thiserror::Error)]
pub enum RowError {
    #[error("'{0}': expected LABEL=RUN or LABEL=RUN:METHOD")]
    Form(String),
    #[error("the label '{}' contains a control character", .0.escape_debug())]
    Label(String),
    #[error("the label '{0}' is given twice")]
    Repeated(String),
    #[error("{}: it has {what}; select one of them with {}:METHOD", path.display(), path.display())]
    Method {
        path: PathBuf,
        /// Description of the available methods.
        what: String,
    },
    #[error("{}: {reason}", path.display())]
    Unusable { path: PathBuf, reason: String },
    #[error("the paper has only one column for {column}, but the rows have the datasets {}", names.join(" and "))]
    Ambiguous {
        column: &'static str,
        names: Vec<String>,
    },
    #[error(transparent)]
    Evaluate(#[from] EvaluateError),
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    #[error(transparent)]
    File(#[from] FileError),
    #[error(transparent)]
    Report(#[from] crate::report::ReportError),
}

impl std::str::FromStr for RowSource {
    type Err = Infallible;

    /// Takes the text after the last colon as the method, unless the whole text is an existing path.
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
    /// The selected method among the available ones.
    ///
    /// # Errors
    /// If the selected method is not available, or none is selected and several are available.
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
                what: if methods.is_empty() {
                    "no methods".to_owned()
                } else {
                    format!("the methods {}", Vec::from_iter(methods).join(", "))
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

/// The data behind the user's rows.
#[derive(Debug)]
pub enum OwnRows {
    /// Results with one row per method.
    Scores(Box<Results>),
    /// Rows of numbers that are not scores of pairs, such as times, with their columns.
    Measured {
        /// Datasets that are not in the paper's table. Their cells follow those of the table's datasets.
        datasets: Vec<String>,
        columns: Vec<Column>,
        rows: Vec<Row>,
    },
}

impl OwnRows {
    /// Reads the sources of the rows of a table.
    ///
    /// # Errors
    /// If a label is given twice, or a source cannot be read, has the wrong kind or contradicts another.
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

/// One row per comparison in the output of `analyze translation --out`.
fn translations(paper: &PublishedTable, rows: &[OwnRow]) -> Result<OwnRows, RowError> {
    let mut columns: Vec<Column> = Vec::new();
    let mut measured = Vec::new();
    for row in rows {
        let mut path = row.source.path.clone();
        if path.is_dir() {
            path.push("translation.csv");
        }
        let unusable = |reason: String| RowError::Unusable {
            path: path.clone(),
            reason,
        };
        let bytes = sharp::files::read(&path).map_err(|error| unusable(error.to_string()))?;
        let wrong = |error: ::csv::Error| unusable(error.to_string());
        let mut csv = ::csv::Reader::from_reader(bytes.as_slice());
        let heads = csv.headers().map_err(wrong)?.clone();
        if heads.get(0) != Some("comparison") {
            let reason = "not a table of `analyze translation --out`";
            return Err(unusable(reason.to_owned()));
        }
        let keys = heads.iter().map(|head| head.parse().ok()).enumerate();
        let keys: Vec<(usize, MetricKey)> = keys.filter_map(|(at, key)| Some((at, key?))).collect();
        // For each metric, the default variant or, if the file does not have it, the first variant.
        let places = paper.metrics.iter().map(|name| {
            let of_family =
                |(_, key): &&(usize, MetricKey)| key.family().name().eq_ignore_ascii_case(name);
            let mut found = keys.iter().filter(of_family);
            let first = found.clone().next();
            let default = found.find(|(_, key)| key.family().name().parse() == Ok(*key));
            default.or(first).copied()
        });
        let places: Option<Vec<(usize, MetricKey)>> = places.collect();
        let places = places.ok_or_else(|| {
            unusable(format!(
                "it must have all of the metrics {}",
                paper.metrics.join(", ")
            ))
        })?;
        let of_row: Vec<Column> = places.iter().map(|(_, key)| Column::from(*key)).collect();
        if measured.is_empty() {
            columns = of_row;
        } else if columns != of_row {
            let reason = "its metric variants differ from those of the previous rows";
            return Err(unusable(reason.to_owned()));
        }
        for line in csv.records() {
            let line = line.map_err(wrong)?;
            let text = |at: usize| line.get(at).unwrap_or_default();
            let cells = places
                .iter()
                .map(|(at, _)| Cell::of(text(*at).parse().ok()));
            let label = format!("{}: {}", row.label, text(0));
            measured.push(Row::measured(label, cells.collect()));
        }
    }
    Ok(OwnRows::Measured {
        datasets: Vec::new(),
        columns,
        rows: measured,
    })
}

/// One row per checkpoint: its number of parameters and, for SHARP's checkpoints, the number that the paper trains.
fn checkpoints(paper: &PublishedTable, rows: &[OwnRow]) -> Result<OwnRows, RowError> {
    let mut measured = Vec::new();
    for row in rows {
        let checkpoint = Checkpoint::open(&row.source.path)?;
        let (mut total, mut trained) = (0_usize, 0_usize);
        for name in checkpoint.names() {
            let count = checkpoint.shape(name)?.iter().product::<usize>();
            total += count;
            trained += usize::from(TrainedParts::default().contain(name)) * count;
        }
        let cell = |count: usize| {
            let millions = count as f64 / 1e6;
            let text = format!("{millions:.*}M", usize::from(millions < 10.0));
            Cell::printed(Some(millions), &text)
        };
        // Checkpoints do not record which parameters were trained. For SHARP, the parameters' names show it.
        let cells = paper.metrics.iter().map(|metric| match *metric {
            "total" => cell(total),
            "trainable" if trained > 0 => cell(trained),
            _ => Cell::dash(),
        });
        measured.push(Row::measured(&row.label, cells.collect()));
    }
    let columns = paper.columns().into_iter().map(|column| Column {
        key: format!("parameters_{}", column.label),
        ..column
    });
    Ok(OwnRows::Measured {
        datasets: Vec::new(),
        columns: columns.collect(),
        rows: measured,
    })
}

/// One row per method measured by `speed`.
fn speeds(paper: &PublishedTable, rows: &[OwnRow]) -> Result<OwnRows, RowError> {
    let mut read = Vec::new();
    for row in rows {
        let mut lines = SpeedLine::read(&row.source.path)?;
        let methods = lines.iter().map(|line| line.method.as_str());
        let method = row.source.chosen(methods)?.to_owned();
        lines.retain(|line| line.method == method);
        read.push((row, lines));
    }
    // The paper's name of the line's dataset, or the user's name if the paper has no such dataset.
    let place = |line: &SpeedLine| {
        let of_paper = column(&ReportDataset::of(&line.dataset, &line.format));
        let of_paper = of_paper.filter(|column| paper.datasets.contains(column));
        of_paper.map_or_else(|| line.dataset.clone(), str::to_owned)
    };
    let mut datasets: Vec<String> = Vec::new();
    for name in read.iter().flat_map(|(_, lines)| lines).map(place) {
        if !paper.datasets.contains(&name.as_str()) && !datasets.contains(&name) {
            datasets.push(name);
        }
    }
    let measured = read.iter().map(|(row, lines)| {
        let cell = |dataset: &str, metric: &str| {
            // Without a GPU, `speed` measures only the time until the picture is in the host's memory.
            let (quantities, factor): (&[&str], f64) = match metric {
                "Inference" => (&["inference_secs"], 1.0),
                "Render" => (&["device_secs", "render_secs"], 1.0),
                _ => (&["device_secs", "render_secs"], 1000.0),
            };
            let line = |quantity: &&str| {
                let mut lines = lines.iter();
                lines.find(|line| line.quantity == *quantity && place(line) == dataset)
            };
            let found = quantities.iter().find_map(line);
            found.map_or_else(Cell::dash, |line| Cell {
                coverage: Some((line.n, line.n)),
                ..Cell::of(Some(line.median * factor))
            })
        };
        let others = datasets.iter().map(String::as_str);
        let all = paper.datasets.iter().copied().chain(others);
        let cells = all.flat_map(|dataset| paper.metrics.iter().map(move |m| cell(dataset, m)));
        Row::measured(&row.label, cells.collect())
    });
    let measured = measured.collect();
    let columns = paper.columns().into_iter().map(|published| Column {
        key: format!("{}_median", published.label.to_lowercase()),
        convention: "median over rounds and pairs, measured by `speed`; rendering on a GPU without copying the \
                     picture back"
            .to_owned(),
        ..published
    });
    Ok(OwnRows::Measured {
        datasets,
        columns: columns.collect(),
        rows: measured,
    })
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
