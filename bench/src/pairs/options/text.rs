//! Words and numbers of the options' text form.

use std::fmt;
use std::str::FromStr;

use super::choices::{MissingDepth, OverlapDepth, OverlapDirection, PairOrder};
use crate::pairs::PairError;
use crate::pairs::overlap::{Denominator, DepthLookup, OverlapTest};
use crate::pairs::sampling::SamplingRule;
use crate::pairs::sets::{Grouping, Remainder};

/// Words and what they mean, the default first.
pub(super) type Words<T, const N: usize> = [(&'static str, T); N];

pub(super) const GROUPINGS: Words<Grouping, 3> = [
    ("consecutive", Grouping::Consecutive),
    ("strided", Grouping::Strided),
    ("whole", Grouping::Whole),
];
pub(super) const REMAINDERS: Words<Remainder, 2> =
    [("keep", Remainder::Keep), ("drop", Remainder::Drop)];
pub(super) const ORDERS: Words<PairOrder, 2> =
    [("both", PairOrder::Both), ("once", PairOrder::Once)];
pub(super) const MISSING_DEPTHS: Words<MissingDepth, 3> = [
    ("reject", MissingDepth::Reject),
    ("accept", MissingDepth::Accept),
    ("leave-out", MissingDepth::LeaveOut),
];
pub(super) const LOOKUPS: Words<DepthLookup, 2> = [
    ("nearest", DepthLookup::Nearest),
    ("bilinear", DepthLookup::Bilinear),
];
pub(super) const DENOMINATORS: Words<Denominator, 3> = [
    ("valid", Denominator::Valid),
    ("all", Denominator::All),
    ("valid-other", Denominator::ValidOther),
];
pub(super) const DIRECTIONS: Words<OverlapDirection, 5> = [
    ("target-in-source", OverlapDirection::TargetInSource),
    ("source-in-target", OverlapDirection::SourceInTarget),
    ("min", OverlapDirection::Min),
    ("mean", OverlapDirection::Mean),
    ("max", OverlapDirection::Max),
];
pub(super) const AT_THRESHOLD: Words<bool, 2> = [("out", false), ("in", true)];
pub(super) const SAMPLINGS: Words<SamplingRule, 3> = [
    ("uniform", SamplingRule::Uniform),
    ("per-scene", SamplingRule::PerScene),
    ("first", SamplingRule::First),
];

/// What a word of the list means.
pub(super) fn word<T: Copy>(key: &str, value: &str, words: &[(&str, T)]) -> Result<T, PairError> {
    let found = words.iter().find(|(name, _)| *name == value);
    found
        .map(|(_, meaning)| *meaning)
        .ok_or_else(|| expected(key, value, &format!("one of {}", names(words))))
}

/// The words, by commas.
pub(super) fn names<T>(words: &[(&str, T)]) -> String {
    let names: Vec<_> = words.iter().map(|(name, _)| *name).collect();
    names.join(", ")
}

/// The word of a meaning.
pub(super) fn name_of<T: PartialEq>(words: &[(&str, T)], meaning: &T) -> String {
    let found = words.iter().find(|(_, m)| m == meaning);
    found.map_or_else(String::new, |(name, _)| (*name).to_owned())
}

/// A number of any kind.
pub(super) fn number<T: FromStr>(key: &str, value: &str) -> Result<T, PairError> {
    value
        .parse()
        .map_err(|_| PairError::Options(format!("{key}={value}: not a number that fits")))
}

/// A number, or the word that stands for none.
pub(super) fn number_unless<T: FromStr>(
    key: &str,
    value: &str,
    none: &str,
) -> Result<Option<T>, PairError> {
    if value == none {
        Ok(None)
    } else {
        number(key, value).map(Some)
    }
}

/// As text, with the word that stands for none.
pub(super) fn or(value: Option<impl fmt::Display>, none: &str) -> String {
    value.map_or_else(|| none.to_owned(), |v| v.to_string())
}

pub(super) fn expected(key: &str, value: &str, what: &str) -> PairError {
    PairError::Options(format!("{key}={value}: expected {what}"))
}

/// Values of `test`.
pub(super) const TESTS: &str =
    "consistent:RELATIVE, frustum, absolute:METRES:RELATIVE:NEAREST or map-anything";

pub(super) fn parse_test(key: &str, value: &str) -> Result<OverlapTest, PairError> {
    let parts: Vec<&str> = value.split(':').collect();
    match parts[..] {
        ["frustum"] => Ok(OverlapTest::Frustum),
        ["map-anything"] => Ok(OverlapTest::MAP_ANYTHING),
        ["consistent", relative] => Ok(OverlapTest::Consistent {
            relative: number(key, relative)?,
        }),
        ["absolute", absolute_m, relative, min_depth_m] => Ok(OverlapTest::AbsoluteRelative {
            absolute_m: number(key, absolute_m)?,
            relative: number(key, relative)?,
            min_depth_m: number(key, min_depth_m)?,
        }),
        _ => Err(expected(key, value, TESTS)),
    }
}

pub(super) fn test_text(test: &OverlapTest) -> String {
    match *test {
        OverlapTest::Frustum => "frustum".to_owned(),
        OverlapTest::Consistent { relative } => format!("consistent:{relative}"),
        test if test == OverlapTest::MAP_ANYTHING => "map-anything".to_owned(),
        OverlapTest::AbsoluteRelative {
            absolute_m,
            relative,
            min_depth_m,
        } => format!("absolute:{absolute_m}:{relative}:{min_depth_m}"),
    }
}

/// Values of `overlap`.
pub(super) const DEPTHS: &str = "ground-truth, sparse:PIXELS, given, given-metric or sharp-release";

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

pub(super) fn parse_depth(key: &str, value: &str) -> Result<OverlapDepth, PairError> {
    Ok(match value {
        "ground-truth" => OverlapDepth::GroundTruth,
        "sparse" => OverlapDepth::Sparse {
            radius: OverlapDepth::RADIUS,
        },
        "given" => OverlapDepth::Given,
        "given-metric" => OverlapDepth::GivenMetric,
        "sharp-release" => OverlapDepth::SharpRelease,
        _ => match value.split_once(':') {
            Some(("sparse", radius)) => OverlapDepth::Sparse {
                radius: number(key, radius)?,
            },
            _ => return Err(expected(key, value, DEPTHS)),
        },
    })
}
