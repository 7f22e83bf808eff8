//! Tables, plots and a browsable page from the records of a run.
//!
//! Means are recomputed from the raw records each time; averages are never averaged again. The same input gives the
//! same bytes: nothing depends on a clock, random numbers or the order of a hash map.
//!
//! * [`mod@write`]: writes a report into a folder; [`options`]: its options; [`error`]: errors.
//! * [`board`]: results as a grid of pairs × methods; [`mod@column`]: a metric or a reported quantity; [`statistics`]:
//!   mean, spread and coverage of a cell; [`facts`]: how the numbers were computed.
//! * [`tables`]: tables in the paper's form in Markdown, CSV, LaTeX, HTML and plain text.
//! * [`paper`]: the paper's published numbers next to ours, never ranked with ours; [`explain`]: why the two differ.
//! * [`plots`]: metric against baseline, histogram of baselines; SVG, PNG and PDF.
//! * [`pictures`]: pictures of records; [`error_map`]: prediction errors in false colour; [`view_maps`]: mask, depth
//!   and coverage; [`gallery`]: the pairs shown on the page; `choice`: selects them if the page cannot show all.
//! * [`sweep`]: scores against camera motion, as a study; [`figures`]: the other figures of a paper.
//! * [`speed`]: run time and compute; [`mod@methods_text`]: a paragraph for a paper on how the numbers were computed;
//!   [`metrics_text`]: sentences on the metrics.
//! * [`page`]: the page, with the data for its script; [`markdown`]: the page's contents as Markdown; [`html`]: what all
//!   pages share.

pub mod board;
mod choice;
pub mod column;
pub mod error;
pub mod error_map;
pub mod explain;
pub mod facts;
pub mod figures;
pub mod gallery;
pub mod html;
pub mod markdown;
pub mod methods_text;
pub mod metrics_text;
pub mod options;
pub mod page;
pub mod paper;
pub mod pictures;
pub mod plots;
pub mod speed;
pub mod statistics;
pub mod sweep;
pub mod tables;
pub mod view_maps;
pub mod write;

#[cfg(test)]
pub(crate) mod test_results;
#[cfg(test)]
mod tests;

pub use board::{Board, ReportDataset, ReportMethod};
pub use column::Column;
pub use error::{MissingPicture, ReportError};
pub use options::{Layout, PictureBudget, PublishedNumbers, ReportComparison, ReportOptions};
pub use pictures::{ReportPictures, scenes};
pub use write::{ReportFiles, mean_tables, report};
