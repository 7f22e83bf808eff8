//! Tables, plots and a browsable page from the records of a run.
//!
//! Means are recomputed from the raw records each time; nothing averaged is ever averaged again.
//! The same input gives the same bytes: no clock, no random number, no order of a hash map.
//!
//! * [`assemble`]: from results to a report.
//! * [`input`]: what a report is made of, as plain values; [`error`]: what can go wrong.
//! * [`records`]: the run as a grid of pairs × methods.
//! * [`summary`]: mean, spread and coverage of a cell.
//! * [`tables`]: the paper's form in Markdown, CSV, LaTeX, HTML and plain text.
//! * [`paper`]: the numbers that the paper published, beside ours, never ranked with them.
//! * [`plots`]: motion against metric, histogram of baselines; SVG and PNG.
//! * [`error_map`]: what a prediction got wrong, as a picture; [`pictures`]: pictures inside a page;
//!   [`gallery`]: which pairs to show.
//! * [`qualitative`]: a figure of predictions side by side.
//! * [`mod@escape`]: text from outside on its way into markup.
//! * [`html`]: the self-contained page; [`markdown`]: the same as text.
//! * [`mod@write`]: all of it into a folder.

pub mod assemble;
pub mod error;
pub mod error_map;
pub mod escape;
pub mod gallery;
pub mod html;
pub mod input;
pub mod markdown;
pub mod paper;
pub mod pictures;
pub mod plots;
pub mod qualitative;
pub mod records;
pub mod summary;
pub mod tables;
pub mod write;

#[cfg(test)]
mod tests;

pub use assemble::report;
pub use error::ReportError;
pub use input::{
    Better, Dataset, FactGroup, Method, Metric, NoPictures, Options, Pictures, Published,
    ReportInput,
};
pub use write::{ReportFiles, text_tables, write_report};
