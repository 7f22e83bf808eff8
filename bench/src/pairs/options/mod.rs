//! Every choice that the paper leaves open, with its default and a text form.
//!
//! The text is one line of comma-separated `key=value`, in a fixed order. The command line accepts any subset in any
//! order; results and manifests contain all keys.
//!
//! * `keys`: the table for reading, writing and `pairs --help-all`.
//! * [`paper`]: values that are known to differ from the paper's.

mod keys;
pub mod paper;
#[cfg(test)]
mod tests;

use sharp_datasets::error::nearest_of;
use std::collections::BTreeMap;
use std::fmt;
use std::str::FromStr;

use clap::ValueEnum;
use serde::{Deserialize, Serialize};

use self::keys::MEANINGS;
use super::PairError;
use super::overlap::{DepthLookup, OverlapOptions, OverlapTest};
use super::sampling::SamplingOptions;
use super::sets::SetOptions;

/// Directions of the pairs between two views.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum PairOrder {
    Both,
    /// Only from the earlier view, in natural order of ids, to the later one.
    Once,
}

/// Treatment of views without depth.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum MissingDepth {
    /// Views without depth count when sets are formed, but are in no pair.
    Reject,
    /// Pairs of views without depth qualify without an overlap.
    Accept,
    /// Views without depth are excluded before sets are formed.
    LeaveOut,
}

/// The overlap that is compared with the threshold.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum OverlapDirection {
    /// The share of the target's pixels visible in the source, on which view synthesis depends.
    TargetInSource,
    /// The share of the source's pixels visible in the target.
    SourceInTarget,
    Min,
    Mean,
    Max,
}

impl OverlapDirection {
    /// The overlap to compare with the threshold: one of the two, or their combination.
    pub fn of(self, target_in_source: f64, source_in_target: f64) -> f64 {
        match self {
            Self::TargetInSource => target_in_source,
            Self::SourceInTarget => source_in_target,
            Self::Min => target_in_source.min(source_in_target),
            Self::Mean => 0.5 * (target_in_source + source_in_target),
            Self::Max => target_in_source.max(source_in_target),
        }
    }
}

/// Source of the depth that determines overlap.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub enum OverlapDepth {
    /// The default: [`Self::DepthPro`] on datasets for which the paper predicts depth, if its weights are found;
    /// otherwise [`Self::GroundTruth`]. Resolved before pairs are built.
    Auto,
    /// The dataset's own depth, pixel by pixel.
    GroundTruth,
    /// The dataset's own, sparse depth. A point counts as seen if any measured depth within `radius` pixels of its
    /// projection agrees.
    #[value(skip)]
    Sparse { radius: u32 },
    /// User-supplied maps, scaled to the dataset's own depth by the median of ratios, as in the paper for ETH3D.
    Given,
    /// User-supplied maps in metres, not scaled.
    GivenMetric,
    /// The first depth layer of SHARP's official checkpoint, scaled like [`Self::Given`].
    SharpRelease,
    /// Depth predicted by Depth Pro's checkpoint, scaled like [`Self::Given`], as in the paper for ETH3D.
    DepthPro,
}

impl OverlapDepth {
    pub fn is_ground_truth(self) -> bool {
        matches!(self, Self::Auto | Self::GroundTruth)
    }

    /// Whether user-supplied depth maps determine overlap.
    pub fn takes_maps(self) -> bool {
        matches!(self, Self::Given | Self::GivenMetric)
    }

    /// Whether a checkpoint predicts the depth that determines overlap.
    pub fn takes_checkpoint(self) -> bool {
        matches!(self, Self::SharpRelease | Self::DepthPro)
    }
}

impl fmt::Display for OverlapDepth {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match (self, self.to_possible_value()) {
            (Self::Sparse { radius }, _) => write!(f, "sparse:{radius}"),
            (_, word) => f.write_str(word.as_ref().map_or("", |word| word.get_name())),
        }
    }
}

/// How pairs are made from scenes. [`PairOptions::help`] lists the keys of the text form with their values and
/// defaults.
///
/// Sets, depth and overlap apply to multi-view scenes. A stereo scene has a single pair, which qualifies regardless of
/// its overlap. `min-baseline` and the keys that follow it in the text form apply to both kinds of scenes.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, schemars::JsonSchema)]
#[schemars(with = "BTreeMap<String, String>")]
#[serde(
    into = "BTreeMap<String, String>",
    try_from = "BTreeMap<String, String>"
)]
pub struct PairOptions {
    pub sets: SetOptions,
    pub order: PairOrder,
    pub missing_depth: MissingDepth,
    pub depth: OverlapDepth,
    pub overlap: OverlapOptions,
    pub direction: OverlapDirection,
    pub threshold: f64,
    pub threshold_qualifies: bool,
    pub min_baseline_m: f64,
    /// Maximum distance of the two cameras, metres; `None` for no limit.
    pub max_baseline_m: Option<f64>,
    pub sampling: SamplingOptions,
}

impl Default for PairOptions {
    fn default() -> Self {
        Self {
            sets: SetOptions::default(),
            order: PairOrder::Both,
            missing_depth: MissingDepth::Reject,
            depth: OverlapDepth::Auto,
            overlap: OverlapOptions::default(),
            direction: OverlapDirection::TargetInSource,
            threshold: 0.60,
            threshold_qualifies: false,
            min_baseline_m: 0.0,
            max_baseline_m: None,
            sampling: SamplingOptions::default(),
        }
    }
}

impl PairOptions {
    /// Whether a pair qualifies by its overlaps.
    pub fn overlap_qualifies(&self, target_in_source: f64, source_in_target: f64) -> bool {
        let overlap = self.direction.of(target_in_source, source_in_target);
        overlap > self.threshold || (self.threshold_qualifies && overlap == self.threshold)
    }

    /// Whether a pair whose cameras are `metres` apart qualifies.
    pub fn baseline_qualifies(&self, metres: f64) -> bool {
        metres >= self.min_baseline_m && self.max_baseline_m.is_none_or(|most| metres <= most)
    }

    /// A copy with the changes in `text`, a comma-separated list of `key=value`.
    ///
    /// # Errors
    /// [`PairError::Options`] if a change cannot be parsed or contradicts the other options.
    pub fn with(&self, text: &str) -> Result<Self, PairError> {
        let mut options = self.clone();
        let mut seen = Vec::new();
        for entry in text.split(',').map(str::trim).filter(|e| !e.is_empty()) {
            let (key, value) = entry.split_once('=').ok_or_else(|| {
                PairError::Options(format!("'{entry}' is not of the form key=value"))
            })?;
            if seen.contains(&key) {
                return Err(PairError::Options(format!("'{key}' is given twice")));
            }
            seen.push(key);
            options.set(key, value)?;
        }
        options.validate()?;
        Ok(options)
    }

    /// Options for measuring overlap, adjusted to the source of depth.
    pub fn measuring(&self) -> OverlapOptions {
        let mut options = self.overlap;
        if let OverlapDepth::Sparse { radius } = self.depth {
            options.lookup = DepthLookup::Window { radius };
        }
        options
    }

    /// Checks constraints that the types do not enforce.
    ///
    /// # Errors
    /// [`PairError::Options`] names the key and its valid values.
    pub fn validate(&self) -> Result<(), PairError> {
        let wrong =
            |key: &str, what: &str| Err(PairError::Options(format!("{key} must be {what}")));
        let not_negative = |v: f64| v.is_finite() && v >= 0.0;
        if self.sets.size < 2 {
            return wrong("size", "2 or more");
        }
        if self.overlap.stride == 0 {
            return wrong("stride", "1 or more");
        }
        let searches_window = matches!(self.depth, OverlapDepth::Sparse { .. });
        if searches_window && self.overlap.lookup != DepthLookup::Nearest {
            return wrong(
                "lookup",
                "left at its default with overlap=sparse, which already searches the neighbourhood",
            );
        }
        if self.overlap.max_side == Some(0) {
            return wrong("max-side", "1 or more");
        }
        let tolerances = match self.overlap.test {
            OverlapTest::Frustum => [0.0; 3],
            OverlapTest::Consistent { relative } => [relative, 0.0, 0.0],
            OverlapTest::AbsoluteRelative {
                absolute_m,
                relative,
                min_depth_m,
            } => [absolute_m, relative, min_depth_m],
        };
        if !tolerances.into_iter().all(not_negative) {
            return wrong("test", "given finite tolerances of 0 or more");
        }
        if !not_negative(self.threshold) {
            return wrong("threshold", "a number of 0 or more");
        }
        if !not_negative(self.min_baseline_m) {
            return wrong("min-baseline", "a number of 0 or more");
        }
        let farthest = self.max_baseline_m;
        if farthest.is_some_and(|most| !(most.is_finite() && most >= self.min_baseline_m)) {
            return wrong("max-baseline", "none or a number of min-baseline or more");
        }
        Ok(())
    }

    /// Changes one option.
    ///
    /// # Errors
    /// [`PairError::Options`] for an unknown key or a value that the key does not take.
    pub fn set(&mut self, key: &str, value: &str) -> Result<(), PairError> {
        let mut choices = self.choices();
        let Some((_, choice)) = choices.iter_mut().find(|(name, _)| *name == key) else {
            let known = nearest_of(key, &choices.map(|(name, _)| name));
            let reason = format!("unknown key '{key}'; {known}");
            return Err(PairError::Options(reason));
        };
        choice
            .set(value)
            .map_err(|reason| PairError::Options(format!("{key}={value}: {reason}")))
    }

    /// Every key with its value as text, in the order of [`PairOptions::help`].
    pub fn entries(&self) -> Vec<(&'static str, String)> {
        let mut options = self.clone();
        let choices = options.choices().into_iter();
        choices.map(|(key, choice)| (key, choice.text())).collect()
    }

    /// Help on every key: its values, default and meaning, two lines per key, indented by two spaces.
    pub fn help() -> String {
        let mut options = Self::default();
        let choices = options.choices().into_iter().zip(MEANINGS);
        let lines = choices.map(|((key, choice), meaning)| {
            let (values, default) = (choice.values(), choice.text());
            format!(
                "  {key:<14} {values}\n{:17}default {default}; {meaning}\n",
                ""
            )
        });
        lines.collect()
    }
}

impl fmt::Display for PairOptions {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let entries = self.entries().into_iter();
        let entries: Vec<String> = entries.map(|(key, v)| format!("{key}={v}")).collect();
        f.write_str(&entries.join(","))
    }
}

impl FromStr for PairOptions {
    type Err = PairError;

    /// The defaults with the given keys changed; an empty text gives the defaults. A repeated key is an error.
    fn from_str(text: &str) -> Result<Self, PairError> {
        Self::default().with(text)
    }
}

/// Every key with its value: the form stored in manifests.
impl From<PairOptions> for BTreeMap<String, String> {
    fn from(options: PairOptions) -> Self {
        let entries = options.entries().into_iter();
        entries
            .map(|(key, value)| (key.to_owned(), value))
            .collect()
    }
}

impl TryFrom<BTreeMap<String, String>> for PairOptions {
    type Error = PairError;

    fn try_from(entries: BTreeMap<String, String>) -> Result<Self, PairError> {
        let mut options = Self::default();
        for (key, value) in &entries {
            options.set(key, value)?;
        }
        options.validate()?;
        Ok(options)
    }
}
