//! Footnotes of cells whose predictions were not simply pictures of the target's size: cropped, resized up, or the best
//! of several scales. The records say so themselves, in what their methods report.

use std::collections::BTreeMap;

use crate::record::{Record, Status};
use crate::report::records::DatasetBoard;

/// What a reader must know about method number `method` on a dataset, besides coverage.
pub(super) fn marks(dataset: &DatasetBoard<'_>, method: usize, label: &str) -> Vec<String> {
    let records: Vec<&Record> = dataset
        .pairs
        .iter()
        .filter_map(|pair| pair.by_method.get(method).copied().flatten())
        .filter(|record| record.status == Status::Ok)
        .collect();
    let values = |key: &str| -> Vec<f64> {
        let values = records.iter().filter_map(|record| record.extras.get(key));
        values.copied().collect()
    };
    let name = &dataset.dataset.name;
    let mut marks = Vec::new();
    let shares = values("scored_share");
    if !shares.is_empty() {
        let mean = shares.iter().sum::<f64>() / shares.len() as f64;
        marks.push(format!(
            "{label} on {name}: cropped; {} of {} pairs scored on a part of the target only, on average {:.1} % of its \
             pixels, against the equally cropped ground truth.",
            shares.len(),
            records.len(),
            100.0 * mean
        ));
    }
    let resized = values("predicted_width").len();
    if resized > 0 {
        marks.push(format!(
            "{label} on {name}: {resized} of {} predictions were smaller than the target and resized up before scoring.",
            records.len()
        ));
    }
    let mut tried: BTreeMap<u64, usize> = BTreeMap::new();
    for count in values("scales_tried") {
        *tried.entry(count as u64).or_default() += 1;
    }
    for (count, pairs) in tried {
        marks.push(format!(
            "{label} on {name}: best of {count} scales by DISTS, chosen for each of {pairs} pairs with a look at the \
             target."
        ));
    }
    marks
}
