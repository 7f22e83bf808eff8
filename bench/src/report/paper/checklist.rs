//! Conditions under which measured and published numbers are comparable digit by digit.

use std::collections::BTreeSet;

use sharp_datasets::registry::ENTRIES;
use sharp_datasets::spec::PaperOverlap;

use crate::evaluate::Aggregation;
use crate::evaluate::manifest::{DatasetRecord, Manifest, MethodRecord};
use crate::evaluate::record::{Record, Status};
use crate::io::counts::counted;
use crate::methods::{MethodIdentity, TrueDepth};
use crate::report::board::{Board, DatasetBoard};
use crate::report::column::Column;
use crate::report::tables::Condition;

use super::column;
use super::published::{MadeBy, PublishedTable};

/// The paper's maximum number of pairs of a multi-view dataset.
const PAPERS_LIMIT: usize = 512;

/// A table of the paper and the rows to compare with it.
pub(super) struct ChecklistInput<'a> {
    pub(super) paper: &'a PublishedTable,
    pub(super) manifest: &'a Manifest,
    /// Number of units that have no result.
    pub(super) missing: usize,
    /// The measured rows, with the datasets as columns; empty if no row has any pair.
    pub(super) board: &'a Board<'a>,
    pub(super) columns: &'a [Column],
}

impl ChecklistInput<'_> {
    fn record(&self, dataset: &DatasetBoard<'_>) -> Option<&DatasetRecord> {
        let mut records = self.manifest.datasets.iter();
        records.find(|record| record.name == dataset.dataset.name)
    }
}

/// All conditions, each with whether it is met, and the evidence.
pub(super) fn checklist(compared: &ChecklistInput<'_>) -> Vec<Condition> {
    let measured = compared
        .board
        .datasets
        .iter()
        .filter(|d| !d.pairs.is_empty());
    let measured: Vec<&DatasetBoard<'_>> = measured.collect();
    let (papers, others): (Vec<&DatasetBoard<'_>>, Vec<_>) = measured
        .iter()
        .partition(|d| column(&d.dataset).is_some_and(|at| compared.paper.datasets.contains(&at)));
    let mut checks = vec![coverage(compared)];
    checks.extend(papers.iter().map(|dataset| pairs(compared, dataset)));
    checks.extend(papers.iter().map(|dataset| readings(compared, dataset)));
    checks.extend(compared.columns.iter().map(identity));
    checks.push(aggregation(compared));
    checks.push(privilege(compared));
    checks.push(whole_pictures(compared, &measured));
    if !others.is_empty() {
        let names: Vec<&str> = others.iter().map(|d| title(d)).collect();
        let names = names.join(", ");
        checks.push(unmet(format!(
            "The paper's table has no column for {names}, so there is no published number to compare with."
        )));
    }
    checks
}

fn check(is_met: bool, text: impl Into<String>) -> Condition {
    Condition {
        is_met,
        text: text.into(),
    }
}

fn unmet(text: impl Into<String>) -> Condition {
    check(false, text)
}

fn coverage(compared: &ChecklistInput<'_>) -> Condition {
    let mut partial = Vec::new();
    for (m, method) in compared.board.methods.iter().enumerate() {
        for dataset in compared
            .board
            .datasets
            .iter()
            .filter(|d| !d.pairs.is_empty())
        {
            let done = dataset
                .records_of(m)
                .filter(|r| r.status == Status::Ok)
                .count();
            if done < dataset.pairs.len() {
                let title = title(dataset);
                partial.push(format!(
                    "{} {done} of {} on {title}",
                    method.label,
                    dataset.pairs.len()
                ));
            }
        }
    }
    match (partial.is_empty(), compared.missing) {
        (true, 0) => check(true, "Every row covers all pairs of its datasets."),
        (true, missing) => unmet(format!(
            "A run is unfinished: {} missing.",
            counted(missing, "unit")
        )),
        _ => unmet(format!(
            "Some rows do not cover all pairs of a dataset and are not ranked there: {}.",
            partial.join("; ")
        )),
    }
}

/// The paper's name for a dataset.
fn title<'a>(dataset: &'a DatasetBoard<'_>) -> &'a str {
    column(&dataset.dataset).unwrap_or(dataset.dataset.title())
}

fn pairs(compared: &ChecklistInput<'_>, dataset: &DatasetBoard<'_>) -> Condition {
    let title = title(dataset);
    let n = dataset.pairs.len();
    let lists = compared.manifest.pairs.lists.iter();
    let lists = lists
        .filter(|list| list.choices.is_empty() || list.choices.contains_key(&dataset.dataset.name));
    // Several runs may have evaluated different parts of one list.
    let hashes: BTreeSet<String> = lists
        .map(|list| list.sha256.chars().take(12).collect())
        .collect();
    let hashes: Vec<String> = hashes.into_iter().collect();
    let list = if hashes.is_empty() {
        String::new()
    } else {
        format!(" (list sha256 {}…)", hashes.join("…, "))
    };
    let sizes = compared.record(dataset).and_then(DatasetRecord::sizes);
    let sizes = sizes.map_or_else(String::new, |sizes| {
        format!(", at {sizes} (the paper uses the dataset's full resolution)")
    });
    let is_stereo = dataset.dataset.format.as_ref().is_some_and(|format| {
        let mut entries = ENTRIES.into_iter();
        entries.any(|e| e.format == format.as_str() && e.paper_overlap == PaperOverlap::Stereo)
    });
    unmet(if is_stereo {
        format!(
            "{title}: {} here{list}{sizes}. The paper predicts each right frame from the left one, but does not say \
             which scenes, exposures and illuminations it uses.",
            counted(n, "pair")
        )
    } else {
        format!(
            "{title}: {} here{list}{sizes}. The paper evaluates at most {PAPERS_LIMIT} pairs of an unpublished list.",
            counted(n, "pair")
        )
    })
}

/// Condition on the reader settings and pair options of a dataset.
fn readings(compared: &ChecklistInput<'_>, dataset: &DatasetBoard<'_>) -> Condition {
    let title = title(dataset);
    let record = compared.record(dataset);
    let mut differing: Vec<String> = dataset
        .dataset
        .proxies
        .iter()
        .map(|p| format!("`{p}`"))
        .collect();
    if let Some(record) = record {
        let glob = record.only_scenes.as_ref();
        differing.extend(glob.map(|glob| format!("only scenes matching `{glob}`")));
        differing.extend(record.left_out.iter().map(ToString::to_string));
    }
    if differing.is_empty() {
        return check(
            true,
            format!("{title}: read and paired as in the paper, as far as the paper describes it."),
        );
    }
    unmet(format!(
        "{title}: these choices are known to differ from the paper's: {}.",
        differing.join(", ")
    ))
}

/// Condition on the variant of a column's metric.
fn identity(column: &Column) -> Condition {
    let features = column.stand_in.as_ref().map(|features| {
        format!(" Its features ({features}) are not the published ones, so no published number is comparable.")
    });
    let (is_met, unstated) = match column.family() {
        "psnr" => (
            true,
            "the paper does not state how it averages, but the mean over pictures is usual",
        ),
        "lpips" => (
            false,
            "the paper does not state the network, its version or the input range",
        ),
        "ssim" => (false, "the paper does not state window, border or channels"),
        "dists" => (
            false,
            "the paper does not state whether pictures are reduced to 256 pixels first",
        ),
        _ => (false, "the paper does not state which variant"),
    };
    let whole = !column.key.contains('@');
    let region = if whole {
        ""
    } else {
        ", and scores whole pictures"
    };
    check(
        is_met && whole && features.is_none(),
        format!(
            "{}: `{}` here; {unstated}{region}.{}",
            column.label,
            column.key,
            features.unwrap_or_default()
        ),
    )
}

fn aggregation(compared: &ChecklistInput<'_>) -> Condition {
    let aggregation = compared.manifest.aggregation;
    let whole = !compared.manifest.common_region;
    let region = if whole {
        ""
    } else {
        ", each on the part that all methods predict"
    };
    check(
        whole && aggregation == Aggregation::Pairs,
        format!(
            "Numbers are the {aggregation}{region}; the paper's are the mean over all test samples."
        ),
    )
}

/// Condition that the rows use true depth if and only if the paper's rows do.
fn privilege(compared: &ChecklistInput<'_>) -> Condition {
    let wants = compared.paper.made_by == MadeBy::PrivilegedRun;
    // The best of several scales counts as well: the paper tries several for methods whose depth cannot be aligned.
    let is_privileged = |method: &MethodRecord| {
        let sweeps = method
            .identity
            .settings
            .contains_key(MethodIdentity::CHOSEN_BY);
        method.privilege.depth != TrueDepth::None || (wants && sweeps)
    };
    let otherwise = |method: &&MethodRecord| is_privileged(method) != wants;
    let others = compared.manifest.methods.iter().filter(otherwise);
    let others: Vec<&str> = others.map(|method| method.label.as_str()).collect();
    match (others.is_empty(), wants) {
        (true, true) => check(
            true,
            "Every row uses the scale of the true depth, or the best of several scales, as do the paper's rows.",
        ),
        (true, false) => check(true, "Neither these rows nor the paper's use true depth."),
        (false, true) => unmet(format!(
            "Rows that use neither the scale of the true depth nor a sweep of scales, unlike the paper's: {}.",
            others.join(", ")
        )),
        (false, false) => unmet(format!(
            "Rows that use true depth, unlike the paper's: {}.",
            others.join(", ")
        )),
    }
}

/// Condition that pictures are not cropped, resized or masked.
fn whole_pictures(compared: &ChecklistInput<'_>, measured: &[&DatasetBoard<'_>]) -> Condition {
    let records = || {
        let pairs = measured.iter().flat_map(|dataset| &dataset.pairs);
        pairs
            .flat_map(|pair| pair.by_method.iter().flatten())
            .copied()
    };
    let count = |is: fn(&Record) -> bool| records().filter(|record| is(record)).count();
    let found = [
        (
            "cropped, as the paper does for methods that crop",
            count(|r| r.crop.is_some()),
        ),
        (
            "enlarged with a kernel that the paper does not name",
            count(|r| r.resized_from.is_some()),
        ),
        (
            "scored without the pixels that a mask of the dataset excludes",
            count(|r| r.valid_share.is_some()),
        ),
        (
            "the best of several scales",
            match compared.paper.made_by {
                // The paper takes the best of several scales for these rows, too; the condition by `privilege` states
                // this.
                MadeBy::PrivilegedRun => 0,
                _ => count(|r| r.scale.is_some()),
            },
        ),
    ];
    let found = found.into_iter().filter(|(_, n)| *n > 0);
    let found: Vec<String> = found
        .map(|(what, n)| format!("{} {what}", counted(n, "prediction")))
        .collect();
    if found.is_empty() {
        check(
            true,
            "Every prediction is scored whole, at the target's own size.",
        )
    } else {
        unmet(format!(
            "Some predictions are changed or selected before scoring: {}.",
            found.join("; ")
        ))
    }
}
