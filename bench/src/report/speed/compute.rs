//! Hours and hardware of runs, as forms for reporting compute ask for them, from the times in run folders.

use std::collections::BTreeSet;
use std::path::PathBuf;

use crate::evaluate::bundle::timings;
use crate::evaluate::unit::Timing;
use crate::evaluate::{EvaluateError, Results};
use crate::report::tables::grid::{GridCell, TextGrid};

/// Hours and hardware of each method in some runs, and of all methods together.
///
/// # Errors
/// If a run cannot be read, or is a bundle, which has no times.
pub fn compute(runs: &[PathBuf]) -> Result<TextGrid, EvaluateError> {
    let mut rows = Vec::new();
    for run in runs {
        let manifest = Results::read(run)?.manifest;
        for method in &manifest.methods {
            let timings = timings(run, &method.label)?;
            if timings.is_empty() {
                continue;
            }
            rows.push(MethodCompute {
                run: run.display().to_string(),
                method: method.label.clone(),
                renderer: manifest.renderer.backend.clone(),
                device: method.identity.settings.get("device").cloned(),
                timings: timings.into_values().collect(),
            });
        }
        if rows.is_empty() {
            return Err(EvaluateError::NotKept {
                folder: run.clone(),
                reason: "it has no times, because it is a bundle or has no predictions".to_owned(),
            });
        }
    }
    Ok(grid(&rows))
}

/// The times of a method in a run.
#[derive(Debug, Clone)]
pub(super) struct MethodCompute {
    pub(super) run: String,
    pub(super) method: String,
    pub(super) renderer: String,
    /// Device of the method's network; `None` for methods without a network.
    pub(super) device: Option<String>,
    pub(super) timings: Vec<Timing>,
}

pub(super) fn grid(methods: &[MethodCompute]) -> TextGrid {
    let heads = [
        "Run",
        "Method",
        "Processor and threads",
        "Network",
        "Renderer",
        "Predictions",
        "Predicting, h",
        "Scoring, h",
        "Peak, MiB",
    ];
    let hours = |secs: f64| GridCell::number(format!("{:.4}", secs / 3600.0), secs / 3600.0);
    let sums = |timings: &[&Timing]| {
        let peak = timings.iter().filter_map(|timing| timing.peak_bytes).max();
        // Several targets or methods may share an inference; count it once.
        let mut seen = BTreeSet::new();
        let inferences = timings.iter().filter(|timing| {
            let shared = timing.inference.as_deref();
            shared.is_none_or(|inference| seen.insert(inference))
        });
        let inferring: f64 = inferences.map(|timing| timing.predict_secs).sum();
        let rendering: f64 = timings.iter().map(|timing| timing.render_secs).sum();
        let scoring: f64 = timings.iter().map(|timing| timing.score_secs).sum();
        [
            GridCell::count(timings.len()),
            hours(inferring + rendering),
            hours(scoring),
            peak.map_or_else(GridCell::default, |bytes| {
                let mib = bytes as f64 / f64::from(1 << 20);
                GridCell::rounded(mib, 0)
            }),
        ]
    };
    let mut rows: Vec<Vec<GridCell>> = methods
        .iter()
        .map(|method| {
            let timings: Vec<&Timing> = method.timings.iter().collect();
            let machines = timings.iter().map(|timing| timing.machine.as_deref());
            let machines: BTreeSet<&str> = machines.map(|m| m.unwrap_or("unknown")).collect();
            let words = [
                method.run.clone(),
                method.method.clone(),
                machines.into_iter().collect::<Vec<_>>().join("; "),
                method.device.clone().unwrap_or_default(),
                method.renderer.clone(),
            ];
            let words = words.map(GridCell::words).into_iter();
            words.chain(sums(&timings)).collect()
        })
        .collect();
    let all: Vec<&Timing> = methods.iter().flat_map(|m| &m.timings).collect();
    let words = ["all", "", "", "", ""].map(GridCell::words).into_iter();
    rows.push(words.chain(sums(&all)).collect());
    TextGrid::new("Compute", &heads, rows).remarked([
            "Wall-clock time summed over the predictions in the run, without failures and earlier attempts. \
             Predicting is inference (once per source if several pairs or methods share it) and rendering. The \
             next pair is predicted while one is scored, so a run takes less time than predicting and scoring \
             together. Peak: largest resident size of the process up to the method's last prediction."
                .to_owned(),
        ])
}
