//! The numbers that the SHARP paper published, to stand beside ours.
//!
//! The paper names neither the LPIPS backbone nor the SSIM window nor the resize kernel, and its pair lists
//! are not published. So its numbers carry the identity `[unstated]`, have tables of their own and are never
//! ranked together with numbers measured here; the ranks shown are those among the paper's rows.

pub mod numbers;

use sharp_datasets::entry::ENTRIES;
use sharp_metrics::{Family, MetricKey};

use super::input::{Column, PublishedNumbers, ReportDataset};
use super::tables::rank::{RankedValue, ranks};
use super::tables::{Cell, Group, Row, Table};

use numbers::{PaperTable, TABLES};

/// Column groups of all four tables.
pub fn columns() -> Vec<&'static str> {
    let columns = ENTRIES.into_iter().map(|entry| entry.paper_column);
    columns.filter(|column| !column.is_empty()).collect()
}

/// Position in [`columns`] of the dataset that the paper means.
pub fn column(dataset: &ReportDataset) -> Option<usize> {
    let entry = dataset.entry()?;
    columns().iter().position(|c| *c == entry.paper_column)
}

/// A table of the paper reduced to some of its [`columns`].
pub fn table(paper: &PaperTable, datasets: &[usize]) -> Table {
    let mut note = format!(
        "Published in the SHARP paper (`{}`): means over its own pairs, whose list is not published. It states neither \
         the LPIPS backbone nor the SSIM window nor the resize kernel, so these numbers stand beside those measured \
         here and are never ranked together with them; ranks are among the paper's rows.",
        paper.label
    );
    if paper.label == "tab:quantitative-aligned" {
        note.push_str(
            " With privileged ground-truth depth: an approximate global scale factor, the median of true over predicted \
             depth; LVSM and SVC by a linear scale sweep per pair that minimises DISTS.",
        );
    }
    let metrics = paper.families.map(metric);
    let rows = paper.rows.iter().map(|(label, _)| Row {
        label: label.replace("(ours)", "(published)"),
        note: None,
        cells: Vec::new(),
    });
    let mut rows: Vec<Row> = rows.collect();
    for &dataset in datasets {
        for (m, metric) in metrics.iter().enumerate() {
            let values = paper.rows.map(|(_, numbers)| numbers[dataset * 2 + m]);
            let candidates = values.map(|value| RankedValue {
                value: Some(value),
                covers: &[],
                complete: true,
                ranked: true,
            });
            let ranks = ranks(&candidates, metric.direction, metric.decimals);
            for ((row, value), rank) in rows.iter_mut().zip(values).zip(ranks) {
                row.cells.push(Cell {
                    value: Some(value),
                    rank,
                    ..Cell::default()
                });
            }
        }
    }
    let columns = columns();
    Table {
        name: format!("published-{}", paper.name),
        title: format!("Published: {}", paper.title),
        row_head: "method",
        groups: datasets
            .iter()
            .map(|&d| Group::titled(columns[d]))
            .collect(),
        columns: metrics.into(),
        rows,
        remarks: vec![note],
        notes: Vec::new(),
    }
}

/// The paper's tables that belong beside a run: of its datasets and of the families that it scores.
pub fn beside(
    datasets: &[ReportDataset],
    metrics: &[Column],
    which: PublishedNumbers,
) -> Vec<Table> {
    let mut wanted: Vec<usize> = match which {
        PublishedNumbers::Never => Vec::new(),
        PublishedNumbers::Always => (0..columns().len()).collect(),
        PublishedNumbers::Matching => datasets.iter().filter_map(column).collect(),
    };
    wanted.sort_unstable();
    wanted.dedup();
    if wanted.is_empty() {
        return Vec::new();
    }
    let scored = |family: &Family| metrics.iter().any(|m| m.family() == family.name());
    let belongs = |paper: &&PaperTable| {
        which == PublishedNumbers::Always || paper.families.iter().any(scored)
    };
    let papers = TABLES.iter().filter(belongs);
    papers.map(|paper| table(paper, &wanted)).collect()
}

/// A metric of which only the family is known.
pub(crate) fn metric(family: Family) -> Column {
    let key = match family {
        Family::Psnr => MetricKey::PSNR,
        Family::Ssim => MetricKey::SSIM,
        Family::Lpips => MetricKey::LPIPS,
        Family::Dists => MetricKey::DISTS,
    };
    Column {
        key: format!("{}[unstated]", family.name()),
        label: family.name().to_uppercase(),
        short: family.name().to_uppercase(),
        convention: "as published; the paper does not state which variant".into(),
        ..key.into()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn datasets_are_recognised_by_format_or_display_name() {
        let at = |name: &str| column(&ReportDataset::named(name));
        assert_eq!(at("middlebury"), Some(0));
        assert_eq!(at("scannetpp"), Some(2));
        assert_eq!(at("ScanNet++"), Some(2));
        assert_eq!(at("tanks-and-temples"), Some(4));
        assert_eq!(at("synthetic"), None);
        let mut eth3d = ReportDataset::named("my-eth");
        eth3d.format = Some("eth3d".into());
        assert_eq!((column(&eth3d), eth3d.title()), (Some(5), "my-eth"));
        eth3d.name = "eth3d".into();
        assert_eq!(eth3d.title(), "ETH3D");
    }

    #[test]
    fn a_run_gets_the_tables_of_its_datasets_and_families() {
        let ours = [
            ReportDataset::named("synthetic"),
            ReportDataset::named("eth3d"),
        ];
        let psnr = [metric(Family::Psnr)];
        let tables = beside(&ours, &psnr, PublishedNumbers::Matching);
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
        assert!(
            beside(
                &ours[..1],
                &[metric(Family::Psnr)],
                PublishedNumbers::Matching
            )
            .is_empty()
        );
        assert_eq!(beside(&[], &[], PublishedNumbers::Always).len(), 4);
    }

    #[test]
    fn published_numbers_never_have_the_identity_of_measured_ones() {
        for paper in &TABLES {
            for metric in table(paper, &[0]).columns {
                assert!(metric.key.ends_with("[unstated]"), "{}", metric.key);
            }
        }
    }
}
