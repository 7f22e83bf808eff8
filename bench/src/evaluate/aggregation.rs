//! Means over the pairs of a dataset.

use std::collections::BTreeMap;
use std::fmt;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use sharp_statistics::mean;

use super::record::Record;

/// Rule for averaging scores over pairs. It determines the weight of a scene with many pairs, so means under different
/// rules cannot be compared.
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

    /// The mean of `values`, each given with its record. `None` if `values` is empty; infinite if one of the values is.
    pub fn of<'a>(self, values: impl IntoIterator<Item = (&'a Record, f64)>) -> Option<f64> {
        let units = self.units(values).into_iter();
        mean(&units.map(|(_, value)| value).collect::<Vec<_>>())
    }

    /// The values whose unweighted mean is the result of [`Self::of`], each with one of the records that it was
    /// computed from. For [`Self::Pairs`], these are the given values in the given order; for the other rules, the
    /// means of the groups, sorted by the groups' names.
    pub fn units<'a>(
        self,
        values: impl IntoIterator<Item = (&'a Record, f64)>,
    ) -> Vec<(&'a Record, f64)> {
        let parts: fn(&Record) -> [&str; 3] = match self {
            Self::Pairs => return values.into_iter().collect(),
            Self::Scenes => |record| [&record.dataset, &record.scene, ""],
            Self::Sources => |record| [&record.dataset, &record.scene, &record.source],
        };
        // For each group: its first record, and the sum and the number of its values.
        let mut groups: BTreeMap<[&str; 3], (&Record, f64, usize)> = BTreeMap::new();
        for (record, value) in values {
            let key = parts(record);
            let group = groups.entry(key).or_insert((record, 0.0, 0));
            *group = (group.0, group.1 + value, group.2 + 1);
        }
        let groups = groups.into_values();
        groups
            .map(|(record, sum, n)| (record, sum / n as f64))
            .collect()
    }
}

impl fmt::Display for Aggregation {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Pairs => "mean over pairs",
            Self::Scenes => "mean of the scenes' means",
            Self::Sources => "mean of the source views' means",
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
