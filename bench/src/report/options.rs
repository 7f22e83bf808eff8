//! Options of a report.

use std::collections::BTreeMap;

use super::statistics::Uncertainty;
use super::tables::grid::TextGrid;

/// Which of the paper's numbers to show next to those of the runs.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum)]
pub enum PublishedNumbers {
    /// No numbers of the paper
    Never,
    /// The numbers for the datasets of the runs, matched by name
    #[default]
    Matching,
    /// All numbers of the paper
    Always,
}

/// Presentation options; they do not change any number.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ReportOptions {
    /// Location of the page's pictures; the default depends on the number of pairs.
    pub layout: Option<Layout>,
    /// Limits on the pictures; by default [`Layout::budget`].
    pub pictures: Option<PictureBudget>,
    /// Whether to omit paths on this machine, and pictures of datasets whose terms forbid
    /// publishing them.
    pub public: bool,
    pub published: PublishedNumbers,
    /// Uncertainty shown as ± after a mean; `None` shows [`Uncertainty::Ci95`] on the page and nothing elsewhere.
    pub uncertainty: Option<Uncertainty>,
    /// What the report adds if it compares two runs.
    pub comparison: Option<ReportComparison>,
}

/// Location of a page's pictures.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Layout {
    /// Embedded: one self-contained file, at most 24 pairs
    File,
    /// In thumbs/ next to the page, loaded on demand, all pairs
    Folder,
}

impl Layout {
    pub fn budget(self) -> PictureBudget {
        match self {
            Self::File => PictureBudget {
                bytes: 12 << 20,
                side: 960,
            },
            // Leaves room for tables, plots and the page itself in a total of 200 MB.
            Self::Folder => PictureBudget {
                bytes: 180_000_000,
                side: 480,
            },
        }
    }
}

/// Limits on the pictures of a page.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct PictureBudget {
    /// Total stored size, bytes; pictures are reduced to fit.
    pub bytes: usize,
    /// Longest side of a picture, in pixels.
    pub side: u32,
}

/// Tables and texts of a report that compares two runs. Differences are B minus A.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ReportComparison {
    /// Explains how to read the tables.
    pub lead: String,
    /// Labels `[A, B]` of the compared methods.
    pub against: Vec<[String; 2]>,
    pub grids: Vec<TextGrid>,
    /// Tables of differences by parts of the data, such as scenes.
    pub details: Vec<TextGrid>,
    /// By how much B is worse than A, keyed by pair id, then by column key; for selecting and sorting pairs.
    pub losses: BTreeMap<String, BTreeMap<String, f64>>,
    /// Additional files, keyed by name.
    pub files: Vec<(String, Vec<u8>)>,
}
