//! Input of a report: plain values, so that any command can fill them.

use std::collections::BTreeMap;

use sharp_datasets::DatasetEntry;
use sharp_datasets::entry::ENTRIES;
use sharp_metrics::identity::MetricRegion;
use sharp_metrics::{Direction, MetricInfo, MetricKey};

use crate::evaluate::Aggregation;
use crate::evaluate::record::Record;

use super::error::ReportError;
use super::pictures::ReportPictures;
use super::tables::grid::TextGrid;
use super::tables::shown;

/// A column of a table: a metric of exactly one identity, or a quantity that methods report.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Column {
    /// Among a record's scores, such as `ssim[gauss11,valid]`, or among what it reports; two keys never share a column.
    pub key: String,
    /// Name with variant and region, such as `SSIM gauss11 valid (frustum)`.
    pub label: String,
    /// The same without a variant that is its family's default: `SSIM (frustum)`.
    pub short: String,
    /// `dB`, or empty for a number without unit.
    pub unit: String,
    /// Decimals shown; ranks are taken after rounding to them.
    pub decimals: usize,
    /// Which values are better; `None` is never ranked.
    pub direction: Option<Direction>,
    /// How the number is computed, with everything that changes its value.
    pub convention: String,
    /// Network and sha256 of the features that it was computed on, where they are not the published ones.
    pub stand_in: Option<String>,
}

impl From<MetricKey> for Column {
    fn from(key: MetricKey) -> Self {
        (&MetricInfo::new(key, &[])).into()
    }
}

impl From<&MetricInfo> for Column {
    fn from(info: &MetricInfo) -> Self {
        Self {
            key: info.key.to_string(),
            label: label(info.key, true),
            short: label(info.key, false),
            unit: info.unit.clone(),
            decimals: info.decimals,
            direction: Some(info.direction),
            convention: info.to_string(),
            stand_in: info
                .backbone
                .as_ref()
                .filter(|backbone| backbone.is_unpublished())
                .map(ToString::to_string),
        }
    }
}

fn label(key: MetricKey, with_default: bool) -> String {
    let whole = MetricKey::whole(key.metric());
    let family = key.family().name();
    let name = if family.parse() == Ok(whole) && !with_default {
        family.to_uppercase()
    } else {
        whole.label()
    };
    match key.region() {
        MetricRegion::Whole => name,
        MetricRegion::Frustum => format!("{name} (frustum)"),
        MetricRegion::Given => format!("{name} (mask)"),
    }
}

impl Column {
    /// A quantity that methods report about their predictions.
    pub fn reported(key: &str, label: &str, decimals: usize, convention: &str) -> Self {
        Self {
            key: key.into(),
            label: label.into(),
            short: label.into(),
            unit: String::new(),
            decimals,
            direction: None,
            convention: convention.into(),
            stand_in: None,
        }
    }

    /// `higher is better`, for those who cannot see an arrow.
    pub fn direction_words(&self) -> &'static str {
        match self.direction {
            Some(Direction::Higher) => "higher is better",
            Some(Direction::Lower) => "lower is better",
            None => "not ranked",
        }
    }

    /// The label with the unit, for an axis: `PSNR (dB)`, `PSNR (frustum, dB)`.
    pub fn axis_label(&self) -> String {
        let (label, unit) = (&self.label, &self.unit);
        match label.strip_suffix(')') {
            _ if unit.is_empty() => label.clone(),
            Some(open) => format!("{open}, {unit})"),
            None => format!("{label} ({unit})"),
        }
    }

    /// The key without variant and region: `ssim`.
    pub(super) fn family(&self) -> &str {
        self.key.split(['[', '@']).next().unwrap_or_default()
    }

    /// Names of columns that stand side by side: default variants by their short ones, unless there are two variants of
    /// the family.
    pub fn names(columns: &[Self]) -> Vec<&str> {
        let names = columns.iter().map(|column| {
            let mut family = columns.iter().filter(|c| c.family() == column.family());
            if family.all(|c| c.key.split('@').next() == column.key.split('@').next()) {
                column.short.as_str()
            } else {
                column.label.as_str()
            }
        });
        names.collect()
    }

    /// [`Self::names`] with arrows for the direction: `PSNR ↑`.
    pub fn heads(columns: &[Self]) -> Vec<String> {
        let named = columns.iter().zip(Self::names(columns));
        let heads = named.map(|(column, name)| match column.direction {
            Some(Direction::Higher) => format!("{name} ↑"),
            Some(Direction::Lower) => format!("{name} ↓"),
            None => name.to_owned(),
        });
        heads.collect()
    }

    /// The columns of some metrics, in the order of these; all without any.
    ///
    /// # Errors
    /// When one is none of the columns.
    pub fn chosen(columns: &[Self], keys: &[MetricKey]) -> Result<Vec<Self>, ReportError> {
        if keys.is_empty() {
            return Ok(columns.to_vec());
        }
        let column = |key: &MetricKey| {
            let key = key.to_string();
            let found = columns.iter().find(|column| column.key == key).cloned();
            let known = columns.iter().map(|column| column.key.as_str());
            found.ok_or_else(|| ReportError::absent("metric", &key, known))
        };
        keys.iter().map(column).collect()
    }

    /// A value as it is shown.
    pub fn shown(&self, value: f64) -> String {
        shown(value, self.decimals)
    }

    /// Part of a file name.
    pub fn slug(&self) -> String {
        slug(&self.key)
    }
}

/// Runs of letters and digits of a column's key, in lower case, joined by dashes.
pub(super) fn slug(key: &str) -> String {
    let parts = key.split(|c: char| !c.is_ascii_alphanumeric());
    let parts: Vec<_> = parts.filter(|part| !part.is_empty()).collect();
    if parts.is_empty() {
        "x".into()
    } else {
        parts.join("-").to_lowercase()
    }
}

/// A column group of the tables.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct ReportDataset {
    /// As in the records: the user's choice, or else the format.
    pub name: String,
    /// The format it was read as; `None` where only its name is known.
    pub format: Option<String>,
    /// One line: what it is, how its pairs were chosen; may be empty.
    pub description: String,
    /// `key=value` of the readings and pair choices that are known to differ from the paper's: a footnote of the column.
    pub proxies: Vec<String>,
    /// Whether scores are taken on the part of each target that all methods predict.
    pub common_region: bool,
    /// What its means are means of.
    pub aggregation: Aggregation,
}

impl ReportDataset {
    /// A dataset of which nothing but the name is known.
    pub fn named(name: impl Into<String>) -> Self {
        Self {
            name: name.into(),
            ..Self::default()
        }
    }

    /// The name for headings: the user's choice as it is, a format's by its display name (`ETH3D`).
    pub fn title(&self) -> &str {
        match self.entry() {
            Some(entry) if self.format.as_ref() == Some(&self.name) => entry.display_name,
            _ => &self.name,
        }
    }

    /// Whether pictures of it may be published, as far as is known; those of an unknown dataset may not.
    pub(super) fn may_publish(&self) -> bool {
        self.entry().is_some_and(|entry| entry.may_publish)
    }

    /// By format, for a name is anyone's choice; by name where there is nothing else.
    pub(super) fn entry(&self) -> Option<&'static DatasetEntry> {
        let name = self.format.as_ref().unwrap_or(&self.name);
        let mut entries = ENTRIES.into_iter();
        entries.find(|entry| entry.format == name || entry.display_name == name)
    }
}

/// A row of the tables.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct ReportMethod {
    /// As in the records.
    pub label: String,
    /// One line: what it does and with which options; may be empty.
    pub description: String,
    /// Why this row is shown without a rank (`it is the target itself`); `None` ranks it.
    pub unranked: Option<String>,
    /// Whether it marks what any method should surpass.
    pub is_baseline: bool,
    /// The kernel that smaller predictions are resized up with, where one is named.
    pub resize_kernel: Option<String>,
    /// What is odd about its predictions, as a sentence of which its label is the beginning: a remark of the first table.
    pub doubt: Option<String>,
    /// What it is and may be mistaken for, likewise.
    pub note: Option<String>,
}

impl ReportMethod {
    /// A ranked method of which nothing but the label is known.
    pub fn named(label: impl Into<String>) -> Self {
        Self {
            label: label.into(),
            ..Self::default()
        }
    }
}

/// Facts of the run under one heading, as name and value.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct FactGroup {
    /// `Scoring`, `Pair list`, ….
    pub title: String,
    /// In the order shown.
    pub facts: Vec<(String, String)>,
}

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

/// Everything that a report shows.
#[derive(Clone)]
pub struct ReportInput<'a> {
    pub title: String,
    /// One or two sentences under the title, after the counts: what was run.
    pub summary: String,
    /// One per pair and method, in any order.
    pub records: &'a [Record],
    /// Columns, in the order shown. One that no record has a number for is named under a table, with the reason.
    pub metrics: Vec<Column>,
    /// Quantities among [`Record::reported`] to show.
    pub extras: Vec<Column>,
    /// Column groups, in the order shown; datasets that only records name follow in natural order.
    pub datasets: Vec<ReportDataset>,
    /// Rows, in the order shown; methods that only records name follow in natural order.
    pub methods: Vec<ReportMethod>,
    /// How the numbers came about: options, versions, pair list and its sha256.
    pub facts: Vec<FactGroup>,
    pub published: PublishedNumbers,
    /// Where the report is on two runs against each other.
    pub comparison: Option<ReportComparison>,
    /// For the gallery.
    pub pictures: &'a dyn ReportPictures,
    pub options: ReportOptions,
}
