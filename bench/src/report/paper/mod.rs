//! The numbers that the SHARP paper published, and rows of one's own beside them.
//!
//! The paper names neither the LPIPS backbone nor the SSIM window nor the resize kernel, and its pair lists
//! are not published. So its numbers carry the identity `[unstated]` and are never ranked together with numbers measured
//! here.
//!
//! * [`published`]: every published number; [`beside`]: those that belong beside a run.
//! * [`rows`]: where rows of one's own are from; [`grid`]: both in one table; [`checklist`]: what keeps the two from
//!   being comparable; [`files`]: all of it as files.

pub mod beside;
pub mod checklist;
pub mod files;
pub mod grid;
pub mod published;
pub mod rows;

use sharp_datasets::entry::ENTRIES;

use super::input::ReportDataset;

pub use beside::beside;
pub use files::write_table;
pub use grid::{Beside, numbers, paper_table};
pub use published::{PublishedTable, TABLES, published};
pub use rows::{OwnRow, RowError};

/// Column groups of the paper's large tables.
pub fn columns() -> Vec<&'static str> {
    let columns = ENTRIES.into_iter().map(|entry| entry.paper_column);
    columns.filter(|column| !column.is_empty()).collect()
}

/// The column group of the paper that a dataset belongs to.
pub fn column(dataset: &ReportDataset) -> Option<&'static str> {
    let column = dataset.entry()?.paper_column;
    (!column.is_empty()).then_some(column)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn datasets_are_recognised_by_format_or_display_name() {
        let at = |name: &str| column(&ReportDataset::named(name));
        assert_eq!(at("middlebury"), Some("Middlebury"));
        assert_eq!(at("scannetpp"), Some("ScanNet++"));
        assert_eq!(at("ScanNet++"), Some("ScanNet++"));
        assert_eq!(at("tanks-and-temples"), Some("Tanks and Temples"));
        assert_eq!(at("synthetic"), None);
        let mut eth3d = ReportDataset::named("my-eth");
        eth3d.format = Some("eth3d".into());
        assert_eq!((column(&eth3d), eth3d.title()), (Some("ETH3D"), "my-eth"));
        eth3d.name = "eth3d".into();
        assert_eq!(eth3d.title(), "ETH3D");
    }

    #[test]
    fn the_paper_has_the_datasets_that_we_say_it_has() {
        assert_eq!(
            published("quantitative").map(|t| t.datasets.clone()),
            Some(columns())
        );
    }
}
