//! Results of runs: scores, means, comparisons, sweeps.

use std::collections::BTreeSet;
use std::path::PathBuf;

use clap::ValueEnum;
use pyo3::prelude::*;
use sharp_bench::evaluate::record::{Record, Score, Status};
use sharp_bench::evaluate::{Named, Results, Shown, join};
use sharp_bench::report::mean_tables;
use sharp_bench::report::sweep::{Motion, Split, Sweep as Core, SweepSpec, figure, table};
use sharp_plots::style::FigureStyle;

use crate::errors::{failed, refused};
use crate::table::{Column, Table};

/// The records of a run, one row each, with the columns of scores.csv.
#[pyfunction]
pub(crate) fn load_scores(py: Python<'_>, run: PathBuf) -> PyResult<Table> {
    let results = py.detach(|| Results::read(&run)).map_err(failed)?;
    let records = &results.records;
    let text = |of: fn(&Record) -> &str| Column::text(records.iter().map(of));
    let number =
        |of: &dyn Fn(&Record) -> Option<f64>| Column::Number(records.iter().map(of).collect());
    let mut columns = vec![
        ("pair_id", text(|r| &r.pair_id)),
        ("dataset", text(|r| &r.dataset)),
        ("scene", text(|r| &r.scene)),
        ("source", text(|r| &r.source)),
        ("target", text(|r| &r.target)),
        ("method", text(|r| &r.method)),
        ("baseline_m", number(&|r| Some(r.baseline_m))),
        ("rotation_deg", number(&|r| Some(r.rotation_deg))),
        ("median_depth_m", number(&|r| r.median_depth_m)),
        ("overlap", number(&|r| r.overlap)),
        (
            "status",
            text(|r| {
                if r.status == Status::Ok {
                    "ok"
                } else {
                    "failed"
                }
            }),
        ),
    ];
    let keys = results
        .manifest
        .metrics
        .iter()
        .map(|metric| metric.info.key.to_string());
    let keys: Vec<String> = keys.collect();
    columns.extend(keys.iter().map(|key| {
        let score = |r: &Record| r.scores.get(key).and_then(Score::value);
        (key.as_str(), number(&score))
    }));
    let reported: BTreeSet<&str> = records
        .iter()
        .flat_map(|r| r.reported().into_keys())
        .collect();
    columns.extend(reported.iter().map(|name| {
        let value = |r: &Record| r.reported().get(name).copied();
        (*name, number(&value))
    }));
    let reason = |record: &Record| match &record.status {
        Status::Failed { reason } => Some(reason.clone()),
        Status::Ok => None,
    };
    columns.push(("reason", Column::Text(records.iter().map(reason).collect())));
    let columns = columns
        .into_iter()
        .map(|(name, column)| (name.to_owned(), column));
    Ok(Table::new(columns.collect()))
}

/// Tables of means as HTML, as on a report's page.
#[pyfunction]
pub(crate) fn means_html(py: Python<'_>, run: PathBuf) -> PyResult<String> {
    let html = || -> anyhow::Result<String> {
        let tables = mean_tables(&Results::read(&run)?, None)?;
        let figures = tables.iter().enumerate();
        let figures = figures.map(|(at, table)| table.html(&format!("means{at}")));
        Ok(figures.collect::<Result<String, _>>()?)
    };
    py.detach(html).map_err(failed)
}

/// Tables of means as text for a terminal.
#[pyfunction]
pub(crate) fn means_text(py: Python<'_>, run: PathBuf) -> PyResult<String> {
    let text = || -> anyhow::Result<String> {
        let tables = mean_tables(&Results::read(&run)?, None)?;
        let texts: Vec<String> = tables.iter().map(|table| table.text()).collect();
        Ok(texts.join("\n"))
    };
    py.detach(text).map_err(failed)
}

/// Scores against camera motion: a table, and one figure per metric.
#[pyclass(frozen, module = "sharp_bench")]
pub(crate) struct Sweep {
    /// Metric key and SVG of each figure.
    figures: Vec<(String, String)>,
    #[pyo3(get)]
    csv: String,
    #[pyo3(get)]
    latex: String,
}

#[pymethods]
impl Sweep {
    #[new]
    #[allow(
        clippy::too_many_arguments,
        reason = "keywords of a function in Python"
    )]
    #[pyo3(signature = (runs, x="baseline_m", bins=None, band="sd", split="dataset", metrics=Vec::new(), methods=Vec::new(), datasets=Vec::new(), renamed=Vec::new()))]
    fn new(
        py: Python<'_>,
        runs: Vec<String>,
        x: &str,
        bins: Option<String>,
        band: &str,
        split: &str,
        metrics: Vec<String>,
        methods: Vec<String>,
        datasets: Vec<String>,
        renamed: Vec<(String, String)>,
    ) -> PyResult<Self> {
        let default = SweepSpec::default();
        let metrics = metrics.iter().map(|key| key.parse().map_err(refused));
        let shown = Shown {
            methods,
            datasets,
            metrics: metrics.collect::<PyResult<_>>()?,
            renamed,
        };
        let spec = SweepSpec {
            x: choice::<Motion>("x", x)?,
            band: choice("band", band)?,
            split: choice::<Split>("split", split)?,
            binning: match bins {
                Some(bins) => bins
                    .parse()
                    .map_err(|reason| refused(anyhow::anyhow!("bins: {reason}")))?,
                None => default.binning.clone(),
            },
            ..default
        };
        let runs = runs.iter().map(|run| {
            run.parse::<Named>()
                .map_err(|e| refused(anyhow::anyhow!("{e}")))
        });
        let runs: Vec<Named> = runs.collect::<PyResult<_>>()?;
        let joined = py.detach(|| join(&runs)).map_err(failed)?;
        let [results] = shown.of([joined]).map_err(refused)?;
        let made = py.detach(|| -> anyhow::Result<Self> {
            let sweep = Core::of(&results, spec)?;
            let figures = figure::figures(&sweep, &FigureStyle::default())?;
            Ok(Self {
                figures: figures
                    .into_iter()
                    .map(|(column, figure)| (column.key, figure.svg))
                    .collect(),
                csv: String::from_utf8_lossy(&table::csv(&sweep)).into_owned(),
                latex: table::latex(&sweep),
            })
        });
        made.map_err(failed)
    }

    /// SVG figures by metric.
    #[getter]
    fn figures(&self) -> std::collections::BTreeMap<&str, &str> {
        self.figures
            .iter()
            .map(|(key, svg)| (key.as_str(), svg.as_str()))
            .collect()
    }

    fn _repr_html_(&self) -> String {
        self.figures.iter().map(|(_, svg)| svg.as_str()).collect()
    }
}

fn choice<T: ValueEnum>(name: &str, text: &str) -> PyResult<T> {
    T::from_str(text, false).map_err(|_| {
        let known = T::value_variants()
            .iter()
            .filter_map(ValueEnum::to_possible_value);
        let known: Vec<String> = known.map(|value| value.get_name().to_owned()).collect();
        refused(anyhow::anyhow!(
            "{name}={text:?}: expected one of {}",
            known.join(", ")
        ))
    })
}
