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

/// Choices of presentation. None of them changes a number.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ReportOptions {
    /// Where the page's pictures are; chosen by the number of pairs without it.
    pub layout: Option<Layout>,
    /// What they may take; [`Layout::budget`] without it.
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
    /// What pictures may take where nothing else is said.
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
    /// Of all together, as they are stored; they shrink to fit.
    pub bytes: usize,
    /// Longest side of one, pixels.
    pub side: u32,
}

/// Texts of a report on two runs besides their numbers. Differences are B minus A.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct ReportComparison {
    /// How to read the tables.
    pub lead: String,
    /// Labels `[A, B]` of the methods that stand against each other.
    pub against: Vec<[String; 2]>,
    /// What changed.
    pub grids: Vec<TextGrid>,
    /// Where.
    pub details: Vec<TextGrid>,
    /// By how much B is worse, by pair id and key of a column: what pairs are chosen and sorted by.
    pub losses: BTreeMap<String, BTreeMap<String, f64>>,
    /// Files besides, by name.
    pub files: Vec<(String, Vec<u8>)>,
}
