//! The published numbers of the SHARP paper, next to the user's own rows.
//!
//! The paper names neither the LPIPS backbone nor the SSIM window nor the resize kernel, and does not publish its pair
//! lists. Its numbers therefore have the identity `[unstated]` and are never ranked together with numbers measured
//! here.
//!
//! * [`mod@published`]: every published number; [`mod@beside`]: selects those to show next to a run.
//! * [`rows`]: the user's own rows; [`grid`]: both in one table; [`checklist`]: conditions under which the two are
//!   comparable; [`files`]: output files.

pub mod beside;
pub mod checklist;
pub mod files;
pub mod grid;
pub mod published;
pub mod rows;
#[cfg(test)]
mod tests;

use sharp_datasets::registry::ENTRIES;

use super::board::ReportDataset;

pub use beside::beside;
pub use files::write_table;
pub use grid::{Beside, numbers, paper_table};
pub use published::{PublishedTable, TABLES, published};
pub use rows::{OwnRow, RowError, RowSource};

/// Column groups of the paper's large tables.
pub fn columns() -> Vec<&'static str> {
    let columns = ENTRIES.into_iter().map(|entry| entry.paper_column);
    columns.filter(|column| !column.is_empty()).collect()
}

/// The paper's column group for a dataset; `None` if the paper has none.
pub fn column(dataset: &ReportDataset) -> Option<&'static str> {
    let column = dataset.entry()?.paper_column;
    (!column.is_empty()).then_some(column)
}
