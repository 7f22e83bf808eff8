//! Footnotes on cells, and on columns that differ from the paper's column of the same name.

use std::collections::BTreeMap;

use crate::evaluate::Aggregation;
use crate::evaluate::record::{Record, Status};
use crate::report::board::{DatasetBoard, ReportDataset, ReportMethod};
use crate::report::column::Column;
use crate::report::paper;
use crate::report::statistics::CellStatistics;
use sharp_statistics::mean;

use super::shown;

/// Footnote for a dataset of the paper whose settings or pairs differ from the paper's; `None` if they do not.
pub(super) fn proxy_mark(dataset: &ReportDataset) -> Option<String> {
    if dataset.proxies.is_empty() || paper::column(dataset).is_none() {
        return None;
    }
    let proxies: Vec<String> = dataset.proxies.iter().map(|p| format!("`{p}`")).collect();
    Some(format!(
        "{}: a proxy of the paper's column, not the same quantity, because these choices are known to differ from \
         the paper's: {}.",
        dataset.title(),
        proxies.join(", ")
    ))
}

/// Footnote on metrics computed with features other than the published ones.
pub(super) fn feature_mark(column: &Column) -> Option<String> {
    let features = column.stand_in.as_ref()?;
    Some(format!(
        "{} (`{}`): computed on `{features}` instead of the published features, so not comparable with published \
         numbers.",
        column.label, column.key
    ))
}

/// Sentences on how the predictions of method number `method` differ from whole pictures of the target's size: cropped,
/// resized, chosen among several scales, or partly excluded by masks.
pub(super) fn prediction_marks(
    dataset: &DatasetBoard<'_>,
    method: usize,
    facts: &ReportMethod,
) -> Vec<String> {
    let records = dataset.records_of(method);
    let records: Vec<&Record> = records.filter(|r| r.status == Status::Ok).collect();
    let (name, label, of) = (dataset.dataset.title(), &facts.label, records.len());
    let mut marks = Vec::new();
    let shares: Vec<f64> = records.iter().filter_map(|r| Some(r.crop?.share)).collect();
    if let Some(mean) = mean(&shares) {
        let scored = format!(
            "{} of {of} pairs scored only on part of the target (on average {:.1} % of the pixels)",
            shares.len(),
            100.0 * mean
        );
        marks.push(if dataset.dataset.common_region {
            // Leave out the method's name, so that methods share the footnote.
            format!("{name}: {scored}, the common region of all methods.")
        } else {
            format!(
                "{label} on {name}: cropped; {scored}, against the equally cropped ground truth."
            )
        });
    }
    let valid: Vec<f64> = records.iter().filter_map(|r| r.valid_share).collect();
    if let Some(mean) = mean(&valid) {
        // Leave out the method's name, so that methods share the footnote.
        marks.push(format!(
            "{name}: dataset masks cover part of {} of {of} targets (on average {:.1} % of the pixels); masked pixels are \
             not scored.",
            valid.len(),
            100.0 * (1.0 - mean)
        ));
    }
    let resized = records.iter().filter(|r| r.resized_from.is_some()).count();
    if resized > 0 {
        let kernel = facts.resize_kernel.as_ref();
        marks.push(format!(
            "{label} on {name}: {resized} of {of} predictions differed from the target in size and were resized{} \
             before scoring.",
            kernel.map_or_else(String::new, |kernel| format!(" (`{kernel}`)"))
        ));
    }
    let mut tried: BTreeMap<usize, usize> = BTreeMap::new();
    for scale in records.iter().filter_map(|record| record.scale) {
        *tried.entry(scale.tried).or_default() += 1;
    }
    for (count, pairs) in tried {
        marks.push(format!(
            "{label} on {name}: best of {count} scales by DISTS against the target, for each of \
             {pairs} pairs."
        ));
    }
    marks
}

pub(super) fn cell_notes(
    method: &str,
    dataset: &ReportDataset,
    column: &Column,
    cell: &CellStatistics,
) -> Vec<String> {
    let CellStatistics { n, total, .. } = *cell;
    let (aggregation, dataset) = (dataset.aggregation, dataset.title());
    let mut notes = Vec::new();
    if aggregation != Aggregation::Pairs && n > 0 {
        notes.push(format!(
            "{dataset}: {aggregation}; standard deviations are over pairs."
        ));
    }
    if total == 0 {
        notes.push(format!("{dataset} has no pairs."));
    } else if n == 0 {
        notes.push(match cell.absences.as_slice() {
            // Leave out method and dataset, so that all cells share the footnote.
            [(reason, _)] => format!("No {} (`{}`): {reason}.", column.label, column.key),
            absences => format!(
                "{method} on {dataset}: no number for any of {total} pairs: {}.",
                listed(&[&cell.failures, absences].concat())
            ),
        });
    } else if n < total {
        notes.push(format!(
            "{method} on {dataset}: mean over {n} of {total} pairs, not ranked against rows that cover other pairs. \
             Missing: {}.",
            listed(&[cell.failures.as_slice(), &cell.absences].concat())
        ));
    }
    if cell.infinite > 0 {
        let of = if cell.infinite == n {
            "every pair".to_owned()
        } else {
            format!("{} of {n} pairs", cell.infinite)
        };
        let others = cell.finite_mean.map_or_else(String::new, |mean| {
            format!(
                "; the mean of the other pairs is {}",
                shown(mean, column.decimals)
            )
        });
        notes.push(format!(
            "Infinite for {of}, so the mean is infinite{others}."
        ));
    }
    notes
}

/// The first three reasons with their counts.
fn listed(reasons: &[(String, usize)]) -> String {
    let mut parts: Vec<String> = reasons
        .iter()
        .take(3)
        .map(|(reason, count)| format!("{reason} ({count}×)"))
        .collect();
    if reasons.len() > 3 {
        parts.push(format!("and {} more reasons", reasons.len() - 3));
    }
    parts.join("; ")
}
