//! Every choice that the paper leaves open, with its default and a text form.
//!
//! The text is one line of `key=value` joined by commas, in a fixed order; it is what the command line
//! accepts (any subset, in any order), what is printed beside a result and what manifests store.

use std::fmt;
use std::str::FromStr;

use serde::{Deserialize, Serialize};

use super::ProtocolError;
use super::overlap::{Denominator, DepthLookup, OverlapOptions, OverlapTest};
use super::sampling::{SamplingOptions, SamplingRule};
use super::sets::{Grouping, Remainder, SetOptions};

/// Whether both directions between two views are pairs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PairOrder {
    /// Each way, judged on its own.
    Both,
    /// Only from the earlier view, in natural order, to the later one.
    Once,
}

/// What happens to views that have no depth.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MissingDepth {
    /// They count when sets are formed, but join no pair.
    Reject,
    /// Their pairs qualify without an overlap.
    Accept,
    /// They are left out before sets are formed.
    LeaveOut,
}

/// Which of a pair's two overlaps the threshold looks at.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OverlapDirection {
    /// The share of the target's pixels that the source sees: what view synthesis needs.
    TargetInSource,
    /// The share of the source's pixels that the target sees.
    SourceInTarget,
    /// The smaller of the two.
    Min,
    /// Their mean.
    Mean,
    /// The larger of the two.
    Max,
}

impl OverlapDirection {
    /// The number that is compared with the threshold.
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

/// Whose depth decides overlap.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OverlapDepth {
    /// The dataset's own, pixel by pixel.
    GroundTruth,
    /// The dataset's own where it is sparse: a point is seen if depth that was measured within so many pixels of where
    /// it lands agrees.
    Sparse {
        /// Pixels of the depth map.
        radius: u32,
    },
    /// Maps that someone else predicted, scaled to the dataset's own by the median of ratios: the paper's way on ETH3D.
    Given,
    /// The same as they are, in metres.
    GivenMetric,
    /// The first depth layer of SHARP's official checkpoint, scaled like [`Self::Given`].
    SharpRelease,
}

impl OverlapDepth {
    /// Radius of [`Self::Sparse`] unless given.
    const RADIUS: u32 = 8;

    /// True for the dataset's own depth, pixel by pixel.
    pub fn is_ground_truth(self) -> bool {
        self == Self::GroundTruth
    }
}

impl fmt::Display for OverlapDepth {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::GroundTruth => f.write_str("ground-truth"),
            Self::Sparse { radius } => write!(f, "sparse:{radius}"),
            Self::Given => f.write_str("given"),
            Self::GivenMetric => f.write_str("given-metric"),
            Self::SharpRelease => f.write_str("sharp-release"),
        }
    }
}

impl FromStr for OverlapDepth {
    type Err = ProtocolError;

    fn from_str(text: &str) -> Result<Self, ProtocolError> {
        Ok(match text {
            "ground-truth" => Self::GroundTruth,
            "sparse" => Self::Sparse {
                radius: Self::RADIUS,
            },
            "given" => Self::Given,
            "given-metric" => Self::GivenMetric,
            "sharp-release" => Self::SharpRelease,
            _ => match text.split_once(':') {
                Some(("sparse", radius)) => Self::Sparse {
                    radius: number("overlap", radius)?,
                },
                _ => {
                    return Err(ProtocolError::Options(format!(
                        "overlap={text}: expected ground-truth, sparse:PIXELS, given, given-metric or sharp-release"
                    )));
                }
            },
        })
    }
}

/// How pairs are made from scenes.
///
/// | key | values (default first) | meaning |
/// |---|---|---|
/// | `sets` | `consecutive`, `strided`, `random:SEED`, `whole` | [`Grouping`] |
/// | `size` | `10` | views in a set, ≥ 2 |
/// | `remainder` | `keep`, `drop` | [`Remainder`] |
/// | `max-sets` | `all`, a number | sets of a scene that are used, the first ones |
/// | `order` | `both`, `once` | [`PairOrder`] |
/// | `missing-depth` | `reject`, `accept`, `leave-out` | [`MissingDepth`] |
/// | `overlap` | `ground-truth`, `sparse:8`, `given`, `given-metric`, `sharp-release` | [`OverlapDepth`] |
/// | `test` | `consistent:0.05`, `frustum`, `absolute:METRES:RELATIVE:NEAREST`, `map-anything` | [`OverlapTest`] |
/// | `lookup` | `nearest`, `bilinear`, `window:PIXELS` | [`DepthLookup`] |
/// | `denominator` | `valid`, `all`, `valid-other` | [`Denominator`] |
/// | `stride` | `1` | subsampling of the projected pixels |
/// | `max-side` | `full`, a number | longer side of the depth maps, pixels |
/// | `direction` | `target-in-source`, `source-in-target`, `min`, `mean`, `max` | [`OverlapDirection`] |
/// | `threshold` | `0.6` | least overlap |
/// | `at-threshold` | `out`, `in` | whether an overlap equal to the threshold qualifies |
/// | `min-baseline` | `0` | least distance of the two cameras, metres; equal qualifies |
/// | `limit` | `512`, `all` | pairs of a dataset that are evaluated |
/// | `sampling` | `uniform`, `per-scene`, `first` | [`SamplingRule`] |
/// | `seed` | `0` | of the sampling |
///
/// Sets, depth and overlap concern multi-view scenes; a stereo scene's one pair has its overlap measured
/// and always qualifies. `min-baseline`, `limit` and what follows concern both.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(into = "String", try_from = "String")]
pub struct PairOptions {
    /// How views form sets.
    pub sets: SetOptions,
    /// Whether both directions are pairs.
    pub order: PairOrder,
    /// What happens to views without depth.
    pub missing_depth: MissingDepth,
    /// Whose depth decides overlap.
    pub depth: OverlapDepth,
    /// How overlap is measured.
    pub overlap: OverlapOptions,
    /// Which of the two overlaps counts.
    pub direction: OverlapDirection,
    /// Least overlap.
    pub threshold: f64,
    /// Whether an overlap equal to the threshold qualifies.
    pub threshold_qualifies: bool,
    /// Least distance of the two cameras, metres.
    pub min_baseline_m: f64,
    /// Which of the qualified pairs are evaluated.
    pub sampling: SamplingOptions,
}

impl Default for PairOptions {
    fn default() -> Self {
        Self {
            sets: SetOptions::default(),
            order: PairOrder::Both,
            missing_depth: MissingDepth::Reject,
            depth: OverlapDepth::GroundTruth,
            overlap: OverlapOptions::default(),
            direction: OverlapDirection::TargetInSource,
            threshold: 0.60,
            threshold_qualifies: false,
            min_baseline_m: 0.0,
            sampling: SamplingOptions::default(),
        }
    }
}

impl PairOptions {
    /// True if a pair of these two overlaps qualifies.
    pub fn overlap_qualifies(&self, target_in_source: f64, source_in_target: f64) -> bool {
        let overlap = self.direction.of(target_in_source, source_in_target);
        overlap > self.threshold || (self.threshold_qualifies && overlap == self.threshold)
    }

    /// These options with some changed; `text` is as for parsing.
    ///
    /// # Errors
    /// [`ProtocolError::Options`] if a change is none or makes no sense with the rest.
    pub fn with(&self, text: &str) -> Result<Self, ProtocolError> {
        let mut options = self.clone();
        let mut seen = Vec::new();
        for entry in text.split(',').map(str::trim).filter(|e| !e.is_empty()) {
            let (key, value) = entry.split_once('=').ok_or_else(|| {
                ProtocolError::Options(format!("'{entry}' is not of the form key=value"))
            })?;
            if seen.contains(&key) {
                return Err(ProtocolError::Options(format!("'{key}' is given twice")));
            }
            seen.push(key);
            options.set(key, value)?;
        }
        options.validate()?;
        Ok(options)
    }

    /// How overlap is measured, with what the source of depth asks for.
    pub fn measuring(&self) -> OverlapOptions {
        let mut options = self.overlap;
        if let OverlapDepth::Sparse { radius } = self.depth {
            options.lookup = DepthLookup::Window { radius };
        }
        options
    }

    /// Checks what the types leave open.
    ///
    /// # Errors
    /// [`ProtocolError::Options`] names the key and what it may be.
    pub fn validate(&self) -> Result<(), ProtocolError> {
        let wrong =
            |key: &str, what: &str| Err(ProtocolError::Options(format!("{key} has to be {what}")));
        let not_negative = |v: f64| v.is_finite() && v >= 0.0;
        if self.sets.size < 2 {
            return wrong("size", "2 or more");
        }
        if self.overlap.stride == 0 {
            return wrong("stride", "1 or more");
        }
        let looks_itself = matches!(self.depth, OverlapDepth::Sparse { .. });
        if looks_itself && self.overlap.lookup != DepthLookup::Nearest {
            return wrong(
                "lookup",
                "left alone with overlap=sparse, which looks around",
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
        Ok(())
    }

    fn set(&mut self, key: &str, value: &str) -> Result<(), ProtocolError> {
        match key {
            "sets" => {
                self.sets.grouping = match value.split_once(':') {
                    Some(("random", seed)) => Grouping::Random {
                        seed: number(key, seed)?,
                    },
                    _ => word(key, value, &GROUPINGS)?,
                }
            }
            "size" => self.sets.size = number(key, value)?,
            "remainder" => self.sets.remainder = word(key, value, &REMAINDERS)?,
            "max-sets" => self.sets.max_sets = number_unless(key, value, "all")?,
            "order" => self.order = word(key, value, &ORDERS)?,
            "missing-depth" => self.missing_depth = word(key, value, &MISSING_DEPTHS)?,
            "overlap" => self.depth = value.parse()?,
            "test" => self.overlap.test = parse_test(value)?,
            "lookup" => {
                self.overlap.lookup = match value.split_once(':') {
                    Some(("window", radius)) => DepthLookup::Window {
                        radius: number(key, radius)?,
                    },
                    _ => word(key, value, &LOOKUPS)?,
                }
            }
            "denominator" => self.overlap.denominator = word(key, value, &DENOMINATORS)?,
            "stride" => self.overlap.stride = number(key, value)?,
            "max-side" => self.overlap.max_side = number_unless(key, value, "full")?,
            "direction" => self.direction = word(key, value, &DIRECTIONS)?,
            "threshold" => self.threshold = number(key, value)?,
            "at-threshold" => {
                self.threshold_qualifies = word(key, value, &AT_THRESHOLD)?;
            }
            "min-baseline" => self.min_baseline_m = number(key, value)?,
            "limit" => self.sampling.limit = number_unless(key, value, "all")?,
            "sampling" => self.sampling.rule = word(key, value, &SAMPLINGS)?,
            "seed" => self.sampling.seed = number(key, value)?,
            _ => {
                let known: Vec<_> = self.entries().into_iter().map(|(key, _)| key).collect();
                return Err(ProtocolError::Options(format!(
                    "unknown key '{key}'; known: {}",
                    known.join(", ")
                )));
            }
        }
        Ok(())
    }

    /// Every key with its value as text, in the order of the table above.
    pub fn entries(&self) -> Vec<(&'static str, String)> {
        let or = |value: Option<u64>, none: &str| {
            value.map_or_else(|| none.to_owned(), |v| v.to_string())
        };
        let sets = match self.sets.grouping {
            Grouping::Random { seed } => format!("random:{seed}"),
            other => name_of(&GROUPINGS, &other),
        };
        let lookup = match self.overlap.lookup {
            DepthLookup::Window { radius } => format!("window:{radius}"),
            other => name_of(&LOOKUPS, &other),
        };
        let test = match self.overlap.test {
            OverlapTest::Frustum => "frustum".to_owned(),
            OverlapTest::Consistent { relative } => format!("consistent:{relative}"),
            test if test == OverlapTest::MAP_ANYTHING => "map-anything".to_owned(),
            OverlapTest::AbsoluteRelative {
                absolute_m,
                relative,
                min_depth_m,
            } => format!("absolute:{absolute_m}:{relative}:{min_depth_m}"),
        };
        vec![
            ("sets", sets),
            ("size", self.sets.size.to_string()),
            ("remainder", name_of(&REMAINDERS, &self.sets.remainder)),
            ("max-sets", or(self.sets.max_sets.map(|n| n as u64), "all")),
            ("order", name_of(&ORDERS, &self.order)),
            (
                "missing-depth",
                name_of(&MISSING_DEPTHS, &self.missing_depth),
            ),
            ("overlap", self.depth.to_string()),
            ("test", test),
            ("lookup", lookup),
            (
                "denominator",
                name_of(&DENOMINATORS, &self.overlap.denominator),
            ),
            ("stride", self.overlap.stride.to_string()),
            ("max-side", or(self.overlap.max_side.map(u64::from), "full")),
            ("direction", name_of(&DIRECTIONS, &self.direction)),
            ("threshold", self.threshold.to_string()),
            (
                "at-threshold",
                name_of(&AT_THRESHOLD, &self.threshold_qualifies),
            ),
            ("min-baseline", self.min_baseline_m.to_string()),
            ("limit", or(self.sampling.limit.map(|n| n as u64), "all")),
            ("sampling", name_of(&SAMPLINGS, &self.sampling.rule)),
            ("seed", self.sampling.seed.to_string()),
        ]
    }
}

impl fmt::Display for PairOptions {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        for (i, (key, value)) in self.entries().into_iter().enumerate() {
            let comma = if i == 0 { "" } else { "," };
            write!(f, "{comma}{key}={value}")?;
        }
        Ok(())
    }
}

impl FromStr for PairOptions {
    type Err = ProtocolError;

    /// Defaults, changed by the given keys; the empty text is all defaults. A repeated key is an error.
    fn from_str(text: &str) -> Result<Self, ProtocolError> {
        Self::default().with(text)
    }
}

impl From<PairOptions> for String {
    fn from(options: PairOptions) -> Self {
        options.to_string()
    }
}

impl TryFrom<String> for PairOptions {
    type Error = ProtocolError;

    fn try_from(text: String) -> Result<Self, ProtocolError> {
        text.parse()
    }
}

/// Words and what they mean, the default first.
type Words<T, const N: usize> = [(&'static str, T); N];

const GROUPINGS: Words<Grouping, 3> = [
    ("consecutive", Grouping::Consecutive),
    ("strided", Grouping::Strided),
    ("whole", Grouping::Whole),
];
const REMAINDERS: Words<Remainder, 2> = [("keep", Remainder::Keep), ("drop", Remainder::Drop)];
const ORDERS: Words<PairOrder, 2> = [("both", PairOrder::Both), ("once", PairOrder::Once)];
const MISSING_DEPTHS: Words<MissingDepth, 3> = [
    ("reject", MissingDepth::Reject),
    ("accept", MissingDepth::Accept),
    ("leave-out", MissingDepth::LeaveOut),
];
const LOOKUPS: Words<DepthLookup, 2> = [
    ("nearest", DepthLookup::Nearest),
    ("bilinear", DepthLookup::Bilinear),
];
const DENOMINATORS: Words<Denominator, 3> = [
    ("valid", Denominator::Valid),
    ("all", Denominator::All),
    ("valid-other", Denominator::ValidOther),
];
const DIRECTIONS: Words<OverlapDirection, 5> = [
    ("target-in-source", OverlapDirection::TargetInSource),
    ("source-in-target", OverlapDirection::SourceInTarget),
    ("min", OverlapDirection::Min),
    ("mean", OverlapDirection::Mean),
    ("max", OverlapDirection::Max),
];
const AT_THRESHOLD: Words<bool, 2> = [("out", false), ("in", true)];
const SAMPLINGS: Words<SamplingRule, 3> = [
    ("uniform", SamplingRule::Uniform),
    ("per-scene", SamplingRule::PerScene),
    ("first", SamplingRule::First),
];

fn word<T: Copy>(key: &str, value: &str, words: &[(&str, T)]) -> Result<T, ProtocolError> {
    let found = words.iter().find(|(name, _)| *name == value);
    found.map(|(_, meaning)| *meaning).ok_or_else(|| {
        let names: Vec<_> = words.iter().map(|(name, _)| *name).collect();
        ProtocolError::Options(format!(
            "{key}={value}: expected one of {}",
            names.join(", ")
        ))
    })
}

fn name_of<T: PartialEq>(words: &[(&str, T)], meaning: &T) -> String {
    let found = words.iter().find(|(_, m)| m == meaning);
    found.map_or_else(String::new, |(name, _)| (*name).to_owned())
}

fn number<T: FromStr>(key: &str, value: &str) -> Result<T, ProtocolError> {
    value
        .parse()
        .map_err(|_| ProtocolError::Options(format!("{key}={value}: not a number that fits")))
}

fn number_unless<T: FromStr>(
    key: &str,
    value: &str,
    none: &str,
) -> Result<Option<T>, ProtocolError> {
    if value == none {
        Ok(None)
    } else {
        number(key, value).map(Some)
    }
}

fn parse_test(value: &str) -> Result<OverlapTest, ProtocolError> {
    let parts: Vec<&str> = value.split(':').collect();
    match parts[..] {
        ["frustum"] => Ok(OverlapTest::Frustum),
        ["map-anything"] => Ok(OverlapTest::MAP_ANYTHING),
        ["consistent", relative] => Ok(OverlapTest::Consistent {
            relative: number("test", relative)?,
        }),
        ["absolute", absolute_m, relative, min_depth_m] => Ok(OverlapTest::AbsoluteRelative {
            absolute_m: number("test", absolute_m)?,
            relative: number("test", relative)?,
            min_depth_m: number("test", min_depth_m)?,
        }),
        _ => Err(ProtocolError::Options(format!(
            "test={value}: expected consistent:RELATIVE, frustum, absolute:METRES:RELATIVE:NEAREST or map-anything"
        ))),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_defaults_read_as_documented() {
        assert_eq!(
            PairOptions::default().to_string(),
            "sets=consecutive,size=10,remainder=keep,max-sets=all,order=both,missing-depth=reject,\
             overlap=ground-truth,test=consistent:0.05,lookup=nearest,denominator=valid,stride=1,max-side=full,\
             direction=target-in-source,threshold=0.6,at-threshold=out,min-baseline=0,limit=512,\
             sampling=uniform,seed=0"
        );
        assert_eq!("".parse::<PairOptions>().unwrap(), PairOptions::default());
    }

    #[test]
    fn every_value_survives_the_text_form() {
        for text in [
            "sets=strided,size=7,remainder=drop,max-sets=3,order=once",
            "sets=random:18446744073709551615,missing-depth=accept,test=frustum",
            "sets=whole,missing-depth=leave-out,test=map-anything,lookup=bilinear",
            "test=absolute:0.25:0.01:0,denominator=all,stride=4,max-side=512",
            "test=consistent:0.1,denominator=valid-other,direction=source-in-target",
            "overlap=sparse,test=consistent:0.1",
            "overlap=sparse:3,max-side=100",
            "overlap=given,lookup=window:4",
            "overlap=given-metric",
            "overlap=sharp-release",
            "direction=min,threshold=0.333333333333333314829616256247",
            "direction=mean,at-threshold=in,min-baseline=1e-9,limit=all,sampling=per-scene",
            "direction=max,sampling=first,seed=12,limit=0",
        ] {
            let options: PairOptions = text.parse().unwrap();
            assert_ne!(options, PairOptions::default());
            let back: PairOptions = options.to_string().parse().unwrap();
            assert_eq!(back, options, "{text}");
            let json = serde_json::to_string(&options).unwrap();
            assert_eq!(serde_json::from_str::<PairOptions>(&json).unwrap(), options);
        }
    }

    #[test]
    fn nonsense_is_refused_with_the_key() {
        for (text, part) in [
            ("size=1", "size"),
            ("size", "key=value"),
            ("sise=3", "known: sets, size"),
            ("sets=random", "consecutive, strided, whole"),
            ("threshold=NaN", "threshold"),
            ("threshold=-0.1", "threshold"),
            ("test=consistent:inf", "test"),
            ("test=consistent", "consistent:RELATIVE"),
            ("overlap=monodepth", "sharp-release"),
            ("overlap=sparse:x", "overlap"),
            ("overlap=sparse,lookup=bilinear", "lookup"),
            ("stride=0", "stride"),
            ("max-side=0", "max-side"),
            ("limit=-1", "limit"),
            ("seed=0,seed=1", "twice"),
        ] {
            let error = text.parse::<PairOptions>().unwrap_err().to_string();
            assert!(error.contains(part), "{text}: {error}");
        }
    }

    #[test]
    fn the_threshold_is_strict_unless_told() {
        let strict = PairOptions::default();
        assert!(!strict.overlap_qualifies(0.6, 1.0));
        assert!(strict.overlap_qualifies(0.600_000_1, 0.0));
        let inclusive: PairOptions = "at-threshold=in,direction=min".parse().unwrap();
        assert!(inclusive.overlap_qualifies(0.6, 0.7));
        assert!(!inclusive.overlap_qualifies(0.7, 0.59));
    }

    #[test]
    fn directions() {
        let all = DIRECTIONS.map(|(_, d)| d.of(0.25, 0.75));
        assert_eq!(all, [0.25, 0.75, 0.25, 0.5, 0.75]);
    }
}
