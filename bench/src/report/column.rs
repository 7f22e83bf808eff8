//! Table columns: metrics, and quantities that methods report about their predictions.

use sharp_metrics::identity::MetricRegion;
use sharp_metrics::{Direction, MetricInfo, MetricKey};

use super::error::ReportError;

/// Quantities that methods may report about their predictions: key, label, decimals and meaning.
const REPORTED: [(&str, &str, usize, &str); 10] = [
    (
        "mean_alpha",
        "Mean alpha",
        3,
        "mean coverage of the rendering, 0..1",
    ),
    (
        "hole_share",
        "Hole share",
        3,
        "share of pixels whose alpha is below 0.5",
    ),
    (
        "source_psnr",
        "Source PSNR",
        2,
        "PSNR of the source's photograph and the Gaussians rendered from its own camera, dB",
    ),
    (
        "file_mb",
        "File (MB)",
        3,
        "size of the file of Gaussians, millions of bytes",
    ),
    (
        "pose_rotation_deg",
        "Turned by (°)",
        3,
        "how far the target's camera was turned to fit its photograph, degrees",
    ),
    (
        "pose_translation_m",
        "Moved by (m)",
        4,
        "how far the target's camera was moved to fit its photograph, metres",
    ),
    (
        "median_scale",
        "Depth scale",
        3,
        "the factor by which median alignment scaled the predicted depth",
    ),
    (
        "dropped_blocks",
        "Dropped blocks",
        0,
        "blocks of pixels without a valid depth, for which no Gaussian was made",
    ),
    (
        "scored_share",
        "Scored share",
        3,
        "share of the target's pixels that a cropped prediction is scored on",
    ),
    (
        "best_scale",
        "Best scale",
        3,
        "the scale of the scene with the lowest DISTS, among the scales that the method rendered",
    ),
];

/// A table column: a metric with one specific identity, or a quantity that methods report.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Column {
    /// Key in a record's scores, such as `ssim[gauss11,valid]`, or in its reported values; unique among columns.
    pub key: String,
    /// Name with variant and region, such as `SSIM gauss11 valid (frustum)`.
    pub label: String,
    /// Like `label`, but without the variant if it is the family's default: `SSIM (frustum)`.
    pub short: String,
    /// Unit such as `dB`; empty for a number without unit.
    pub unit: String,
    /// Number of decimals shown. Numbers are rounded to this number of decimals before they are ranked.
    pub decimals: usize,
    /// Whether higher or lower values are better; `None` if values are not ranked.
    pub direction: Option<Direction>,
    /// How the number is computed, including everything that affects its value.
    pub convention: String,
    /// Name of the network and SHA-256 of its weights; `None` for the published weights and for metrics without a
    /// network.
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
    /// The quantities that methods report about their predictions.
    pub(in crate::report) fn extras() -> Vec<Self> {
        REPORTED
            .map(|(key, label, decimals, convention)| {
                Self::reported(key, label, decimals, convention)
            })
            .into()
    }

    /// A quantity that is not a metric: it has no direction and is never ranked.
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

    /// The direction in words, such as `higher is better`.
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

    /// The lower bound of LPIPS and DISTS; `None` for other metrics.
    pub(super) fn least(&self) -> Option<f64> {
        matches!(self.family(), "lpips" | "dists").then_some(0.0)
    }

    /// The key without variant and region: `ssim`.
    pub(super) fn family(&self) -> &str {
        self.key.split(['[', '@']).next().unwrap_or_default()
    }

    /// Names of the columns in one table. A default variant has the short name unless the table has another variant of
    /// the same family.
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

    /// The columns of the metrics in `keys`, in the order of `keys`; all columns if `keys` is empty.
    ///
    /// # Errors
    /// If a metric has no column.
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

    /// Formats a value with the column's decimals.
    pub fn shown(&self, value: f64) -> String {
        sharp_plots::scale::shown(value, self.decimals)
    }

    /// The part of file names that identifies the column.
    pub fn slug(&self) -> String {
        slug(&self.key)
    }
}

/// The column's key in lower case; every character other than a letter or a digit becomes a dash.
pub(super) fn slug(key: &str) -> String {
    let parts = key.split(|c: char| !c.is_ascii_alphanumeric());
    let parts: Vec<_> = parts.filter(|part| !part.is_empty()).collect();
    if parts.is_empty() {
        "x".into()
    } else {
        parts.join("-").to_lowercase()
    }
}
