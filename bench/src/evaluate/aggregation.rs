//! Means over the pairs of a dataset.

use std::collections::BTreeMap;
use std::fmt;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::record::Record;

/// How scores are averaged. Part of a value's identity, because the rule determines the weight of a scene with many
/// pairs.
#[derive(
    Debug,
    Clone,
    Copy,
    PartialEq,
    Eq,
    PartialOrd,
    Ord,
    Hash,
    Default,
    Serialize,
    Deserialize,
    JsonSchema,
    clap::ValueEnum,
)]
#[serde(rename_all = "lowercase")]
pub enum Aggregation {
    /// The mean over all pairs, as stated in the SHARP paper.
    #[default]
    Pairs,
    /// The mean over scenes of the mean over a scene's pairs.
    Scenes,
    /// The mean over source views of the mean over a source's targets.
    Sources,
}

impl Aggregation {
    pub const ALL: [Self; 3] = [Self::Pairs, Self::Scenes, Self::Sources];

    /// The mean of `values`; `None` if there are none. Groups are summed in the given order, then averaged by name, so
    /// the result does not depend on threads. One infinite value makes the mean infinite.
    pub fn of<'a>(self, values: impl IntoIterator<Item = (&'a Record, f64)>) -> Option<f64> {
        // Sum and count by group.
        let mut groups: BTreeMap<[&str; 3], (f64, usize)> = BTreeMap::new();
        for (record, value) in values {
            let key: [&str; 3] = match self {
                Self::Pairs => [""; 3],
                Self::Scenes => [&record.dataset, &record.scene, ""],
                Self::Sources => [&record.dataset, &record.scene, &record.source],
            };
            let group = groups.entry(key).or_default();
            *group = (group.0 + value, group.1 + 1);
        }
        let means = groups.values().map(|(sum, n)| sum / *n as f64);
        (!groups.is_empty()).then(|| means.sum::<f64>() / groups.len() as f64)
    }
}

impl fmt::Display for Aggregation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Pairs => "mean over pairs",
            Self::Scenes => "mean over scenes of means over pairs",
            Self::Sources => "mean over source views of means over targets",
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::evaluate::test_records::record;

    #[test]
    fn scenes_and_sources_count_once_each() {
        // Scene a: source 0 with 1 and 3, source 1 with 8; scene b: 10.
        let of = |scene: &str, source: &str, target: &str| Record {
            scene: scene.into(),
            source: source.into(),
            target: target.into(),
            ..record("d", 0, 0)
        };
        let records = [
            (of("a", "0", "1"), 1.0),
            (of("a", "0", "2"), 3.0),
            (of("a", "1", "2"), 8.0),
            (of("b", "0", "1"), 10.0),
        ];
        let mean = |aggregation: Aggregation| aggregation.of(records.iter().map(|(r, v)| (r, *v)));
        assert_eq!(mean(Aggregation::Pairs), Some(5.5));
        assert_eq!(mean(Aggregation::Scenes), Some(7.0));
        assert_eq!(mean(Aggregation::Sources), Some((2.0 + 8.0 + 10.0) / 3.0));
        assert_eq!(Aggregation::Scenes.of([]), None);
        let infinite = [(&records[0].0, f64::INFINITY), (&records[3].0, 1.0)];
        assert_eq!(Aggregation::Scenes.of(infinite), Some(f64::INFINITY));
    }
}
