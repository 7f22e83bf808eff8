//! What a report is made of: plain values, so that any command can fill them.

use image::RgbImage;
use sharp_metrics::{Direction, MetricInfo, MetricKey};

use crate::evaluate::record::Record;

/// Which way a metric is better.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Better {
    /// PSNR, SSIM.
    Higher,
    /// LPIPS, DISTS.
    Lower,
    /// A quantity that is only reported, never ranked.
    Neither,
}

impl Better {
    /// `↑`, `↓` or nothing.
    pub fn arrow(self) -> &'static str {
        match self {
            Self::Higher => "↑",
            Self::Lower => "↓",
            Self::Neither => "",
        }
    }

    /// In words, for those who cannot see an arrow.
    pub fn words(self) -> &'static str {
        match self {
            Self::Higher => "higher is better",
            Self::Lower => "lower is better",
            Self::Neither => "not ranked",
        }
    }
}

/// One column of a table: a metric of exactly one identity.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Metric {
    /// Key of the scores, such as `ssim[gauss11,valid]`; two keys never share a column.
    pub key: String,
    /// Short name for a column's head, such as `SSIM`.
    pub label: String,
    /// `dB`, or empty for a number without unit.
    pub unit: String,
    /// Decimals shown; ranks are taken after rounding to them.
    pub decimals: usize,
    /// Which way is better.
    pub better: Better,
    /// How the number is computed, in a sentence, with everything that changes its value.
    pub convention: String,
}

impl From<MetricKey> for Metric {
    fn from(key: MetricKey) -> Self {
        (&MetricInfo::new(key, &[])).into()
    }
}

impl From<&MetricInfo> for Metric {
    fn from(info: &MetricInfo) -> Self {
        Self {
            key: info.key.to_string(),
            label: info.label.clone(),
            unit: info.unit.clone(),
            decimals: info.decimals,
            better: match info.direction {
                Direction::Higher => Better::Higher,
                Direction::Lower => Better::Lower,
            },
            convention: info.to_string(),
        }
    }
}

impl Metric {
    /// A quantity that methods report about their predictions; shown, never ranked.
    pub fn reported(key: &str, label: &str, unit: &str, decimals: usize, convention: &str) -> Self {
        Self {
            key: key.into(),
            label: label.into(),
            unit: unit.into(),
            decimals,
            better: Better::Neither,
            convention: convention.into(),
        }
    }

    /// Label with the unit, for an axis: `PSNR (dB)`.
    pub fn axis_label(&self) -> String {
        if self.unit.is_empty() {
            self.label.clone()
        } else {
            format!("{} ({})", self.label, self.unit)
        }
    }

    /// Label with the arrow: `PSNR ↑`.
    pub fn heading(&self) -> String {
        match self.better {
            Better::Neither => self.label.clone(),
            better => format!("{} {}", self.label, better.arrow()),
        }
    }

    /// Part of a file name: the key with everything but letters and digits as dashes.
    pub fn slug(&self) -> String {
        slug(&self.key)
    }
}

/// Letters, digits, single dashes; `x` where nothing of the kind is left.
pub fn slug(text: &str) -> String {
    let parts: Vec<_> = text
        .split(|c: char| !c.is_ascii_alphanumeric())
        .filter(|part| !part.is_empty())
        .collect();
    if parts.is_empty() {
        "x".into()
    } else {
        parts.join("-").to_lowercase()
    }
}

/// A column group of the tables.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Dataset {
    /// The name that the records carry.
    pub name: String,
    /// One line for the reader: what it is, how its pairs were chosen; may be empty.
    pub description: String,
    /// Pairs that the run set out to score; `None`: as many as have a record.
    pub planned_pairs: Option<usize>,
    /// The paper's name of this dataset; `None`: recognised by [`Dataset::name`].
    pub published_as: Option<String>,
    /// `key=value` of the readings and pair choices that are known to differ from the paper's: a footnote of the column.
    pub proxies: Vec<String>,
    /// Whether scores are taken on the part of each target that all methods predict.
    pub common_region: bool,
}

impl Dataset {
    /// A dataset of which nothing but the name is known.
    pub fn named(name: impl Into<String>) -> Self {
        Self {
            name: name.into(),
            description: String::new(),
            planned_pairs: None,
            published_as: None,
            proxies: Vec::new(),
            common_region: false,
        }
    }
}

/// A row of the tables.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Method {
    /// The label that the records carry.
    pub label: String,
    /// One line: what it does and with which options; may be empty.
    pub description: String,
    /// Why this row is shown without a rank (`it is the target itself`); `None` ranks it.
    pub unranked: Option<String>,
    /// The kernel that smaller predictions are resized up with, where one is named.
    pub resize_kernel: Option<String>,
}

impl Method {
    /// A ranked method of which nothing but the label is known.
    pub fn named(label: impl Into<String>) -> Self {
        Self {
            label: label.into(),
            description: String::new(),
            unranked: None,
            resize_kernel: None,
        }
    }
}

/// Facts of the run under one heading, shown as name and value.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FactGroup {
    /// `Protocol`, `Versions`, `Pair list`, ….
    pub title: String,
    /// In the order shown.
    pub facts: Vec<(String, String)>,
}

/// Which of the paper's numbers stand beside ours.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, clap::ValueEnum)]
pub enum Published {
    /// None.
    Never,
    /// Those of the datasets that the run has, by name.
    #[default]
    Matching,
    /// All.
    Always,
}

/// Where the pictures of a record come from: sRGB, 8 bit, or the reason why there is none. Called from several
/// threads, and only for what the gallery shows; the source and the target once per pair.
pub trait Pictures: Sync {
    /// The photograph that the method was given.
    ///
    /// # Errors
    /// Why there is none, in a few words (`not kept`).
    fn source(&self, record: &Record) -> Result<RgbImage, String>;

    /// What it should have predicted, at the size at which predictions are scored.
    ///
    /// # Errors
    /// Why there is none.
    fn target(&self, record: &Record) -> Result<RgbImage, String>;

    /// What it predicted.
    ///
    /// # Errors
    /// Why there is none.
    fn prediction(&self, record: &Record) -> Result<RgbImage, String>;
}

/// A report without pictures.
#[derive(Debug, Clone, Copy, Default)]
pub struct NoPictures;

impl Pictures for NoPictures {
    fn source(&self, _record: &Record) -> Result<RgbImage, String> {
        Err("this report was made without pictures".into())
    }

    fn target(&self, record: &Record) -> Result<RgbImage, String> {
        self.source(record)
    }

    fn prediction(&self, record: &Record) -> Result<RgbImage, String> {
        self.source(record)
    }
}

/// Choices of presentation. None of them changes a number.
#[derive(Debug, Clone, PartialEq)]
pub struct Options {
    /// Pairs in the gallery at most: half of them those with the worst scores, the others spread evenly.
    pub gallery_pairs: usize,
    /// Bytes that all pictures in the page may take together, encoded; pictures shrink to fit.
    pub picture_bytes: usize,
    /// Longest side of a picture in the page at most, pixels.
    pub picture_side: u32,
    /// Absolute error (0..1, mean over the channels) at the top of the error pictures' colour scale.
    pub error_max: f32,
    /// Width of the bins of the motion plots, metres; `None` picks 1, 2 or 5 × 10ⁿ for at most ten bins.
    pub bin_width_m: Option<f64>,
    /// Whether each metric is also plotted against the baseline in units of the target's median depth.
    pub relative_motion: bool,
}

impl Default for Options {
    fn default() -> Self {
        Self {
            gallery_pairs: 24,
            picture_bytes: 12 << 20,
            picture_side: 960,
            error_max: 0.5,
            bin_width_m: None,
            relative_motion: false,
        }
    }
}

/// All that a report shows.
pub struct ReportInput<'a> {
    /// Of the page.
    pub title: String,
    /// One or two sentences under the title: what was run.
    pub summary: String,
    /// One per pair and method, in any order.
    pub records: &'a [Record],
    /// Columns, in the order shown. A key that no record has a number for is shown with the reason.
    pub metrics: Vec<Metric>,
    /// Quantities among `Record::extras` to show (`mean_alpha`, …); the key is the name there.
    pub extras: Vec<Metric>,
    /// Column groups, in the order shown; datasets that only records name follow in natural order.
    pub datasets: Vec<Dataset>,
    /// Rows, in the order shown; methods that only records name follow in natural order.
    pub methods: Vec<Method>,
    /// How the numbers came about: options, versions, pair list and its sha256.
    pub facts: Vec<FactGroup>,
    /// The paper's numbers.
    pub published: Published,
    /// For the gallery.
    pub pictures: &'a dyn Pictures,
    /// Presentation.
    pub options: Options,
}
