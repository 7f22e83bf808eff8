//! Limits of a gate, as given on the command line and in `gate.toml`.
//!
//! ```text
//! lpips > +0.005              on each dataset and over all: fires if B − A is above it and significant
//! psnr < -0.1 on eth3d        on one dataset; `on all` is the mean of the datasets
//! psnr < -1 per scene         on the mean of each scene, significant or not
//! |lpips| > 0.005             also for improvements
//! seconds_per_pair > +10 %    relative to A, if both ran on the same class of device; also peak_memory
//! ```

use std::collections::BTreeMap;
use std::fmt;
use std::str::FromStr;

use serde::Deserialize;
use sharp_metrics::identity::MetricRegion;
use sharp_metrics::{Direction, Family, MetricInfo, MetricKey};

/// The contents of `gate.toml`; limits from the command line are added.
#[derive(Debug, Clone, Default, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct GateConfig {
    pub fail_if: Vec<Limit>,
    /// Maximum number of pairs per dataset with a score in A but none in B.
    pub missing_pairs: usize,
    /// The difference that the runs must be able to detect, by metric.
    pub require_power: BTreeMap<MetricName, f64>,
}

impl GateConfig {
    /// Parses `gate.toml`.
    ///
    /// # Errors
    /// If the text is invalid; states the mistake and the line.
    pub fn parse(text: &str) -> Result<Self, String> {
        toml::from_str(text).map_err(|error| {
            let line = error
                .span()
                .map_or(1, |at| 1 + text[..at.start].matches('\n').count());
            format!("line {line}: {}", error.message().replace('\n', ", "))
        })
    }
}

/// A metric as named in a limit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Deserialize)]
#[serde(try_from = "String")]
pub enum MetricName {
    /// A family such as `lpips`, which stands for all variants of the family in the runs.
    Family(Family, MetricRegion),
    Key(MetricKey),
}

impl MetricName {
    pub(super) fn names(self, metric: &MetricInfo) -> bool {
        match self {
            Self::Family(family, region) => (family, region) == (metric.family, metric.region),
            Self::Key(key) => key == metric.key,
        }
    }

    fn direction(self) -> Direction {
        let family = match self {
            Self::Family(family, _) => family,
            Self::Key(key) => key.family(),
        };
        match family {
            Family::Psnr | Family::Ssim => Direction::Higher,
            Family::Lpips | Family::Dists => Direction::Lower,
        }
    }
}

impl FromStr for MetricName {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let families = Family::ALL.into_iter();
        let mut named = families.flat_map(|f| MetricRegion::ALL.map(|region| (f, region)));
        match named.find(|(f, region)| text == format!("{}{}", f.name(), region.suffix())) {
            Some((family, region)) => Ok(Self::Family(family, region)),
            None => text.parse().map(Self::Key).map_err(|e| e.to_string()),
        }
    }
}

impl TryFrom<String> for MetricName {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse()
    }
}

impl fmt::Display for MetricName {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Family(family, region) => write!(f, "{}{}", family.name(), region.suffix()),
            Self::Key(key) => f.pad(&key.alias()),
        }
    }
}

/// The part of the data that a limit applies to.
#[derive(Debug, Clone, PartialEq)]
pub enum Scope {
    /// Each dataset, and the mean over them.
    Everywhere,
    /// One dataset, or [`ALL`](crate::track::compare::ALL) for the mean over the datasets.
    On(String),
    /// Each scene of the named dataset, or of all datasets.
    PerScene(Option<String>),
}

impl Scope {
    /// The dataset that the scope names, if any.
    pub(super) fn dataset(&self) -> Option<&str> {
        match self {
            Self::On(name) | Self::PerScene(Some(name)) => Some(name),
            Self::Everywhere | Self::PerScene(None) => None,
        }
    }
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Resource {
    SecondsPerPair,
    PeakMemory,
}

impl Resource {
    pub(super) const ALL: [Self; 2] = [Self::SecondsPerPair, Self::PeakMemory];

    /// Costs of A below this value, in seconds or MiB, are too small to be judged.
    pub(super) fn least(self) -> f64 {
        match self {
            Self::SecondsPerPair => 0.05,
            Self::PeakMemory => 1.0,
        }
    }

    pub(super) fn unit(self) -> &'static str {
        match self {
            Self::SecondsPerPair => "s",
            Self::PeakMemory => "MiB",
        }
    }

    pub(super) fn name(self) -> &'static str {
        match self {
            Self::SecondsPerPair => "seconds_per_pair",
            Self::PeakMemory => "peak_memory",
        }
    }
}

/// A limit on how much worse B may be than A.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(try_from = "String")]
pub enum Limit {
    Score {
        metric: MetricName,
        /// The limit, at least 0, in the metric's unit.
        bound: f64,
        /// Whether improvements beyond the bound also fire.
        either_way: bool,
        scope: Scope,
    },
    /// Largest increase from A to B, in percent.
    Cost { cost: Resource, percent: f64 },
}

impl Limit {
    /// A limit that fires at any significant loss in the metric `key`.
    pub(super) fn any_loss(key: MetricKey) -> Self {
        Self::Score {
            metric: MetricName::Key(key),
            bound: 0.0,
            either_way: false,
            scope: Scope::Everywhere,
        }
    }
}

impl FromStr for Limit {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let wrong = |reason: &str| format!("'{text}': {reason}");
        let sign = text.find(['<', '>']);
        let sign = sign
            .ok_or_else(|| wrong("expected a limit such as 'lpips > +0.005' or 'psnr < -0.1'"))?;
        let (name, rest) = (text[..sign].trim(), text[sign + 1..].trim());
        let is_above = text[sign..].starts_with('>');
        let (rest, per_scene) = match rest.strip_suffix("per scene") {
            Some(rest) => (rest.trim_end(), true),
            None => (rest, false),
        };
        let (value, dataset) = match rest.split_once(" on ") {
            Some((value, dataset)) => (value.trim_end(), Some(dataset.trim().to_owned())),
            None => (rest, None),
        };
        let number = |text: &str| {
            let value = text.trim_end().parse().ok().filter(|v: &f64| v.is_finite());
            value.ok_or_else(|| wrong(&format!("'{text}' is not a number")))
        };
        if let Some(cost) = Resource::ALL.into_iter().find(|cost| cost.name() == name) {
            let percent = value.strip_suffix('%').filter(|_| is_above);
            let percent = percent
                .filter(|_| dataset.is_none() && !per_scene)
                .ok_or_else(|| wrong(&format!("write this limit as '{name} > +10 %'")))?;
            let percent = number(percent)?;
            return if percent >= 0.0 {
                Ok(Self::Cost { cost, percent })
            } else {
                Err(wrong("expected a share of 0 % or more"))
            };
        }
        let inner = name.strip_prefix('|').and_then(|n| n.strip_suffix('|'));
        let (name, either_way) = (inner.unwrap_or(name), inner.is_some());
        let metric: MetricName = name.parse().map_err(|reason: String| {
            let costs = Resource::ALL.map(Resource::name).join(" ");
            format!("'{text}': {reason}; the costs are {costs}")
        })?;
        let bound = number(value)?;
        let (is_fitting, form) = match (either_way, metric.direction()) {
            (true, _) => (
                is_above && bound >= 0.0,
                format!("write a limit on either direction as '|{name}| > VALUE'"),
            ),
            (false, Direction::Higher) => (
                !is_above && bound <= 0.0,
                format!("higher is better for {name}, so write the limit as '{name} < -VALUE'"),
            ),
            (false, Direction::Lower) => (
                is_above && bound >= 0.0,
                format!("lower is better for {name}, so write the limit as '{name} > +VALUE'"),
            ),
        };
        if !is_fitting {
            return Err(wrong(&form));
        }
        let scope = match (dataset, per_scene) {
            (dataset, true) => Scope::PerScene(dataset),
            (Some(dataset), false) => Scope::On(dataset),
            (None, false) => Scope::Everywhere,
        };
        Ok(Self::Score {
            metric,
            bound: bound.abs(),
            either_way,
            scope,
        })
    }
}

impl TryFrom<String> for Limit {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse()
    }
}

impl fmt::Display for Limit {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Score {
                metric,
                bound,
                either_way,
                scope,
            } => {
                match (either_way, metric.direction()) {
                    (false, Direction::Higher) if *bound == 0.0 => write!(f, "{metric} < 0")?,
                    (true, _) => write!(f, "|{metric}| > {bound}")?,
                    (false, Direction::Higher) => write!(f, "{metric} < -{bound}")?,
                    (false, Direction::Lower) => write!(f, "{metric} > +{bound}")?,
                }
                match scope {
                    Scope::Everywhere => Ok(()),
                    Scope::On(name) => write!(f, " on {name}"),
                    Scope::PerScene(None) => f.write_str(" per scene"),
                    Scope::PerScene(Some(name)) => write!(f, " on {name} per scene"),
                }
            }
            Self::Cost { cost, percent } => write!(f, "{} > +{percent} %", cost.name()),
        }
    }
}
