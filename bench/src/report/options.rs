//! Options of a report.

use std::collections::BTreeMap;

use super::tables::grid::TextGrid;

/// Choice of the paper's numbers to show next to ours.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum)]
pub enum PublishedNumbers {
    /// None.
    Never,
    /// Those of the datasets that the run has, by name.
    #[default]
    Matching,
    /// All.
    Always,
}

/// Presentation options; none changes a number.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ReportOptions {
    /// Where the page's pictures are; by default chosen by the number of pairs.
    pub layout: Option<Layout>,
    /// Their budget; by default [`Layout::budget`].
    pub pictures: Option<PictureBudget>,
    /// Leave out the pictures of datasets whose terms do not let them be published, and where files lie on this machine.
    pub public: bool,
    pub published: PublishedNumbers,
    /// For a report on two runs against each other.
    pub comparison: Option<ReportComparison>,
}

/// Place of a page's pictures.
#[derive(Debug, Clone, Copy, PartialEq, Eq, serde::Serialize, clap::ValueEnum)]
#[serde(rename_all = "lowercase")]
pub enum Layout {
    /// In the page, one file: of at most 24 pairs
    File,
    /// Beside the page, in thumbs/, loaded as they are looked at: of all pairs
    Folder,
}

impl Layout {
    /// The default budget of pictures.
    pub fn budget(self) -> PictureBudget {
        match self {
            Self::File => PictureBudget {
                bytes: 12 << 20,
                side: 960,
            },
            // With tables, plots and the page itself below 200 MB.
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
    /// Total size as stored; pictures shrink to fit.
    pub bytes: usize,
    /// Longest side of one, pixels.
    pub side: u32,
}

/// Tables and texts of a report that compares two runs. Differences are B minus A.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ReportComparison {
    /// How to read the tables.
    pub lead: String,
    /// Labels `[A, B]` of the compared methods.
    pub against: Vec<[String; 2]>,
    /// What changed.
    pub grids: Vec<TextGrid>,
    /// Where.
    pub details: Vec<TextGrid>,
    /// By how much B is worse, by pair id and column key; pairs are selected and sorted by it.
    pub losses: BTreeMap<String, BTreeMap<String, f64>>,
    /// Additional files, by name.
    pub files: Vec<(String, Vec<u8>)>,
}
