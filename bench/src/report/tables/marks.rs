//! Footnotes of cells whose predictions were not simply pictures of the target's size, all of it: cropped, resized up, the
//! best of several scales, or in part excluded by masks. The records say so themselves, in what their methods report. And of columns that are not the
//! paper's, though they bear its dataset's name.

use std::collections::BTreeMap;

use crate::evaluate::record::{Record, Status};
use crate::report::input::{Dataset, Method};
use crate::report::paper;
use crate::report::records::DatasetBoard;

/// What a reader must know about the columns of a dataset of the paper that was not read or paired as in the paper.
pub(super) fn proxy_mark(dataset: &Dataset) -> Option<String> {
    if dataset.proxies.is_empty() || paper::position(dataset).is_none() {
        return None;
    }
    let proxies: Vec<String> = dataset.proxies.iter().map(|p| format!("`{p}`")).collect();
    Some(format!(
        "{}: a proxy of the paper's column, not the same quantity; known to differ from what the paper did: {}.",
        dataset.name,
        proxies.join(", ")
    ))
}

/// What a reader must know about method number `method` on a dataset, besides coverage.
pub(super) fn marks(dataset: &DatasetBoard<'_>, method: usize, facts: &Method) -> Vec<String> {
    let records: Vec<&Record> = dataset
        .pairs
        .iter()
        .filter_map(|pair| pair.by_method.get(method).copied().flatten())
        .filter(|record| record.status == Status::Ok)
        .collect();
    let (name, label) = (&dataset.dataset.name, &facts.label);
    let mut marks = Vec::new();
    let shares: Vec<f64> = records.iter().filter_map(|r| Some(r.crop?.share)).collect();
    if !shares.is_empty() {
        let mean = shares.iter().sum::<f64>() / shares.len() as f64;
        let scored = format!(
            "{} of {} pairs scored on a part of the target only, on average {:.1} % of its pixels",
            shares.len(),
            records.len(),
            100.0 * mean
        );
        marks.push(if dataset.dataset.common_region {
            // The same for every method that has all pairs: one footnote for all of them.
            format!("{name}: {scored}, the common region of all methods.")
        } else {
            format!(
                "{label} on {name}: cropped; {scored}, against the equally cropped ground truth."
            )
        });
    }
    let valid: Vec<f64> = records.iter().filter_map(|r| r.valid_share).collect();
    if !valid.is_empty() {
        let excluded = 1.0 - valid.iter().sum::<f64>() / valid.len() as f64;
        // The same for every method that has all pairs, as above.
        marks.push(format!(
            "{name}: masks of the dataset exclude pixels of {} of {} targets, on average {:.1} % of theirs; they are \
             excluded from scoring.",
            valid.len(),
            records.len(),
            100.0 * excluded
        ));
    }
    let resized = records.iter().filter(|r| r.resized_from.is_some()).count();
    if resized > 0 {
        let kernel = facts.resize_kernel.as_ref();
        marks.push(format!(
            "{label} on {name}: {resized} of {} predictions were smaller than the target and resized up{} before scoring.",
            records.len(),
            kernel.map_or_else(String::new, |kernel| format!(" (`{kernel}`)"))
        ));
    }
    let mut tried: BTreeMap<usize, usize> = BTreeMap::new();
    for scale in records.iter().filter_map(|record| record.scale) {
        *tried.entry(scale.tried).or_default() += 1;
    }
    for (count, pairs) in tried {
        marks.push(format!(
            "{label} on {name}: best of {count} scales by DISTS, chosen for each of {pairs} pairs with a look at the \
             target."
        ));
    }
    marks
}
