//! The numbers that the SHARP paper published, to stand beside ours.
//!
//! The paper names neither the LPIPS backbone nor the SSIM window nor the resize kernel, and its pair lists
//! are not published. So its numbers carry the identity `[unstated]`, have tables of their own and are never
//! ranked together with numbers measured here; the ranks shown are those among the paper's rows.

pub mod numbers;

use std::collections::BTreeSet;

use super::input::{Better, Dataset, Metric, Published};
use super::tables::rank::{Candidate, ranks};
use super::tables::{Cell, Group, Row, Table};

use numbers::{DATASETS, PaperTable, TABLES};

/// A table of the paper reduced to some datasets (positions in [`DATASETS`]).
pub fn table(paper: &PaperTable, datasets: &[usize]) -> Table {
    let metrics: Vec<Metric> = paper.families.iter().map(|family| metric(family)).collect();
    let mut note = format!(
        "Published in the SHARP paper (`{}`): means over its own pairs, whose list is not published. It states neither \
         the LPIPS backbone nor the SSIM window nor the resize kernel, so these numbers stand beside those measured \
         here and are never ranked together with them; ranks are among the paper's rows.",
        paper.label
    );
    if paper.label == "tab:quantitative-aligned" {
        note.push_str(
            " Given ground-truth depth: one scale per image, the median of the depth ratios; LVSM and SVC by a scale \
             sweep per pair that minimises DISTS.",
        );
    }
    let mut rows: Vec<Row> = paper
        .rows
        .iter()
        .map(|(label, _)| Row {
            label: match *label {
                "SHARP (ours)" => "SHARP (published)".into(),
                other => other.into(),
            },
            note: Some(0),
            cells: Vec::new(),
        })
        .collect();
    for &dataset in datasets {
        for (m, metric) in metrics.iter().enumerate() {
            let column: Vec<f64> = paper
                .rows
                .iter()
                .filter_map(|(_, numbers)| numbers.get(dataset * 2 + m).copied())
                .collect();
            let candidates: Vec<Candidate<'_>> = column
                .iter()
                .map(|value| Candidate {
                    value: Some(*value),
                    covers: &[],
                    complete: true,
                    ranked: true,
                })
                .collect();
            let ranks = ranks(&candidates, metric.better, metric.decimals);
            for ((row, value), rank) in rows.iter_mut().zip(column).zip(ranks) {
                row.cells.push(Cell {
                    value: Some(value),
                    rank,
                    coverage: None,
                    std: None,
                    infinite: 0,
                    failed: 0,
                    notes: Vec::new(),
                });
            }
        }
    }
    Table {
        name: format!("published-{}", paper.name),
        title: format!("Published: {}", paper.title),
        row_head: "method",
        groups: datasets
            .iter()
            .filter_map(|d| DATASETS.get(*d))
            .map(|name| Group {
                title: (*name).to_owned(),
                pairs: None,
                note: None,
            })
            .collect(),
        metrics,
        rows,
        notes: vec![note],
    }
}

/// The paper's tables that belong beside a run: of its datasets and of the families that it scores.
pub fn beside(datasets: &[Dataset], metrics: &[Metric], which: Published) -> Vec<Table> {
    let wanted: BTreeSet<usize> = match which {
        Published::Never => BTreeSet::new(),
        Published::Always => (0..DATASETS.len()).collect(),
        Published::Matching => datasets.iter().filter_map(position).collect(),
    };
    let wanted: Vec<usize> = wanted.into_iter().collect();
    if wanted.is_empty() {
        return Vec::new();
    }
    let scored = |family: &str| metrics.iter().any(|m| family_of(&m.key) == family);
    TABLES
        .iter()
        .filter(|paper| which == Published::Always || paper.families.iter().any(|f| scored(f)))
        .map(|paper| table(paper, &wanted))
        .collect()
}

/// Position in [`DATASETS`] of the dataset that the paper means, by `published_as` or else by name.
pub fn position(dataset: &Dataset) -> Option<usize> {
    let name = dataset.published_as.as_ref().unwrap_or(&dataset.name);
    let wanted = match plain(name).as_str() {
        "tnt" | "tanksandtemples" => plain("Tanks and Temples"),
        other => other.to_owned(),
    };
    DATASETS.iter().position(|d| plain(d) == wanted)
}

/// Letters and digits in lower case; `+` as `p`, so that `scannetpp` and `ScanNet++` are the same.
fn plain(name: &str) -> String {
    name.chars()
        .filter(|c| c.is_ascii_alphanumeric() || *c == '+')
        .map(|c| {
            if c == '+' {
                'p'
            } else {
                c.to_ascii_lowercase()
            }
        })
        .collect()
}

fn family_of(key: &str) -> &str {
    key.split(['[', '@']).next().unwrap_or(key)
}

pub(crate) fn metric(family: &str) -> Metric {
    let (better, decimals, unit) = match family {
        "psnr" => (Better::Higher, 2, "dB"),
        "ssim" => (Better::Higher, 3, ""),
        _ => (Better::Lower, 3, ""),
    };
    Metric {
        key: format!("{family}[unstated]"),
        label: family.to_uppercase(),
        unit: unit.into(),
        decimals,
        better,
        convention: "as published; the paper does not state which variant".into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn datasets_are_recognised_by_the_names_that_people_use() {
        let at = |name: &str| position(&Dataset::named(name));
        assert_eq!(at("middlebury"), Some(0));
        assert_eq!(at("scannetpp"), Some(2));
        assert_eq!(at("ScanNet++"), Some(2));
        assert_eq!(at("tanks_and_temples"), Some(4));
        assert_eq!(at("tnt"), Some(4));
        assert_eq!(at("synthetic"), None);
        let mut renamed = Dataset::named("my-eth");
        renamed.published_as = Some("ETH3D".into());
        assert_eq!(position(&renamed), Some(5));
    }

    #[test]
    fn a_run_gets_the_tables_of_its_datasets_and_families() {
        let ours = [Dataset::named("synthetic"), Dataset::named("eth3d")];
        let psnr = [metric("psnr")];
        let tables = beside(&ours, &psnr, Published::Matching);
        let names: Vec<_> = tables.iter().map(|t| t.name.as_str()).collect();
        assert_eq!(
            names,
            ["published-psnr-ssim", "published-privileged-psnr-ssim"]
        );
        assert_eq!(tables[0].groups.len(), 1);
        // Table PSNR/SSIM, ETH3D: LVSM 16.72 is best, SHARP 14.51 third.
        let psnr: Vec<_> = tables[0]
            .rows
            .iter()
            .map(|r| (r.cells[0].value, r.cells[0].rank))
            .collect();
        assert_eq!(psnr[2], (Some(16.72), Some(1)));
        assert_eq!(psnr[6], (Some(14.51), Some(3)));
        assert!(beside(&ours[..1], &[metric("psnr")], Published::Matching).is_empty());
        assert_eq!(beside(&[], &[], Published::Always).len(), 4);
    }

    #[test]
    fn published_numbers_never_have_the_identity_of_measured_ones() {
        for paper in &TABLES {
            for metric in table(paper, &[0]).metrics {
                assert!(metric.key.ends_with("[unstated]"), "{}", metric.key);
            }
        }
    }
}
