//! Chooses the paper's tables to show next to a run's.

use sharp_metrics::Family;

use crate::report::board::Board;
use crate::report::column::Column;
use crate::report::options::PublishedNumbers;
use crate::report::tables::Table;

use super::{TABLES, column};

/// The paper's tables over its six datasets, reduced to the run's own datasets and metrics for
/// [`PublishedNumbers::Matching`].
pub fn beside(board: &Board<'_>, metrics: &[Column], which: PublishedNumbers) -> Vec<Table> {
    let columns = super::columns();
    let mut wanted: Vec<usize> = match which {
        PublishedNumbers::Never => Vec::new(),
        PublishedNumbers::Always => (0..columns.len()).collect(),
        PublishedNumbers::Matching => {
            let datasets = board.datasets.iter();
            let names = datasets.filter_map(|board| column(&board.dataset));
            names
                .filter_map(|name| columns.iter().position(|c| *c == name))
                .collect()
        }
    };
    wanted.sort_unstable();
    wanted.dedup();
    if wanted.is_empty() {
        return Vec::new();
    }
    let is_scored = |name: &&str| {
        metrics
            .iter()
            .any(|m| m.family().eq_ignore_ascii_case(name))
    };
    let fidelity = TABLES.iter().filter(|table| {
        table.row_head == "method" && table.datasets == columns && is_family(table.metrics[0])
    });
    let belongs = fidelity
        .filter(|table| which == PublishedNumbers::Always || table.metrics.iter().any(is_scored));
    belongs
        .map(|paper| {
            let mut table = paper.table(&wanted);
            table.name = format!("published-{}", table.name);
            table.title = format!("Published: {}", table.title);
            table
        })
        .collect()
}

fn is_family(name: &str) -> bool {
    Family::ALL
        .iter()
        .any(|family| family.name().eq_ignore_ascii_case(name))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluate::test_records::record;
    use crate::report::paper::published::metric;
    use crate::report::test_results::results;

    #[test]
    fn a_run_gets_the_tables_of_its_datasets_and_families() {
        let scored = |name: &str| record(name, 0, 0);
        let results = results(&[], vec![scored("eth3d"), scored("synthetic")]);
        let mut board = Board::of(&results).unwrap();
        let psnr = [metric(Family::Psnr)];
        let tables = beside(&board, &psnr, PublishedNumbers::Matching);
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
        board.datasets.remove(0);
        let synthetic = beside(&board, &[metric(Family::Psnr)], PublishedNumbers::Matching);
        assert!(synthetic.is_empty());
        assert_eq!(beside(&board, &[], PublishedNumbers::Always).len(), 4);
    }
}
