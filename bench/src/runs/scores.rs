//! `scores.csv`: one row a record, and `timings.csv` beside it.

use std::collections::BTreeSet;

use super::store::Timing;
use crate::record::{Record, Score, Status, finite_or_text};

/// The columns before the metrics.
pub const FIXED_COLUMNS: [&str; 11] = [
    "pair_id",
    "dataset",
    "scene",
    "source",
    "target",
    "method",
    "baseline_m",
    "rotation_deg",
    "median_depth_m",
    "overlap",
    "status",
];

/// Shortest text that reads back as the same number; `inf`, `-inf` and `nan` otherwise.
pub fn number(value: f64) -> String {
    finite_or_text::text(value).map_or_else(|| value.to_string(), str::to_owned)
}

/// The table as CSV: [`FIXED_COLUMNS`], then a column per metric key in the given order, then what methods
/// report (`mean_alpha`, …) by name, and last the reason of a failure. A score that is not available, like any
/// unknown value, is an empty cell.
///
/// # Errors
/// Those of the CSV writer, which only writes to memory here.
pub fn scores_csv(records: &[Record], metric_keys: &[String]) -> Result<Vec<u8>, csv::Error> {
    let extras: BTreeSet<&str> = records
        .iter()
        .flat_map(|record| record.extras.keys().map(String::as_str))
        .collect();
    let mut out = csv::WriterBuilder::new().from_writer(Vec::new());
    let header = FIXED_COLUMNS
        .iter()
        .copied()
        .chain(metric_keys.iter().map(String::as_str))
        .chain(extras.iter().copied())
        .chain(["reason"]);
    out.write_record(header)?;
    let optional = |value: Option<f64>| value.map_or_else(String::new, number);
    for record in records {
        let (status, reason) = match &record.status {
            Status::Ok => ("ok", ""),
            Status::Failed { reason } => ("failed", reason.as_str()),
        };
        let mut row = vec![
            record.pair_id.clone(),
            record.dataset.clone(),
            record.scene.clone(),
            record.source.clone(),
            record.target.clone(),
            record.method.clone(),
            number(record.baseline_m),
            number(record.rotation_deg),
            optional(record.median_depth_m),
            optional(record.overlap),
            status.to_owned(),
        ];
        row.extend(
            metric_keys
                .iter()
                .map(|key| optional(record.scores.get(key).and_then(Score::value))),
        );
        row.extend(
            extras
                .iter()
                .map(|name| optional(record.extras.get(*name).copied())),
        );
        row.push(reason.to_owned());
        out.write_record(&row)?;
    }
    out.into_inner().map_err(|error| error.into_error().into())
}

/// `pair_id,method,predict_secs,score_secs`: wall seconds, for the curious; never compared.
///
/// # Errors
/// Those of the CSV writer, which only writes to memory here.
pub fn timings_csv(units: &[(Record, Timing)]) -> Result<Vec<u8>, csv::Error> {
    let mut out = csv::Writer::from_writer(Vec::new());
    out.write_record(["pair_id", "method", "predict_secs", "score_secs"])?;
    for (record, timing) in units {
        let row = [
            &record.pair_id,
            &record.method,
            &format!("{:.3}", timing.predict_secs),
            &format!("{:.3}", timing.score_secs),
        ];
        out.write_record(row)?;
    }
    out.into_inner().map_err(|error| error.into_error().into())
}
