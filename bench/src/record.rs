//! One unit of a run: a pair, predicted by a method, scored or failed.
//!
//! Runs write records, reports read them; nothing is averaged in between.

use std::collections::BTreeMap;

use serde::{Deserialize, Serialize};

/// What became of a unit.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize)]
#[serde(tag = "status", rename_all = "snake_case")]
pub enum Status {
    /// Predicted and scored.
    Ok,
    /// Something failed; the reason names the file or stage. The unit counts as missing.
    Failed {
        /// One line.
        reason: String,
    },
}

/// The value of a metric for one prediction.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub enum Score {
    /// A number; infinity (identical pictures under PSNR) is stored as the string `"inf"`.
    Value(#[serde(with = "finite_or_text")] f64),
    /// The metric could not be computed for this pair.
    Unavailable {
        /// Why, in one line.
        unavailable: String,
    },
}

impl Score {
    /// The number, if there is one.
    pub fn value(&self) -> Option<f64> {
        match self {
            Self::Value(v) => Some(*v),
            Self::Unavailable { .. } => None,
        }
    }
}

/// Everything that a table, plot or comparison needs to know about one unit.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct Record {
    /// `dataset/scene/source__target`, each part percent-encoded.
    pub pair_id: String,
    /// Name of the dataset instance: a column group of the tables.
    pub dataset: String,
    /// The scene.
    pub scene: String,
    /// The physical scene; see `sharp_datasets::Scene::cluster`.
    pub cluster: String,
    /// Id of the source view.
    pub source: String,
    /// Id of the target view.
    pub target: String,
    /// Label of the method instance: a row of the tables.
    pub method: String,
    /// Distance of the two camera centres, metres.
    pub baseline_m: f64,
    /// Angle between the two cameras, degrees.
    pub rotation_deg: f64,
    /// Median ground-truth depth of the target view, metres.
    pub median_depth_m: Option<f64>,
    /// Share of the target's valid-depth pixels that the source sees, 0..1.
    pub overlap: Option<f64>,
    /// Whether the unit succeeded.
    #[serde(flatten)]
    pub status: Status,
    /// Score by metric key (`psnr`, `ssim[gauss11,valid]`, …).
    pub scores: BTreeMap<String, Score>,
    /// What the method reports about this prediction (`mean_alpha`, `hole_share`, …).
    pub extras: BTreeMap<String, f64>,
}

/// JSON has no infinity: finite numbers as numbers, the others as `"inf"`, `"-inf"`, `"nan"`.
pub mod finite_or_text {
    use serde::{Deserialize, Deserializer, Serializer, de};

    /// The text that stands for a number that is not finite; `None` for a finite one.
    pub fn text(value: f64) -> Option<&'static str> {
        if value.is_finite() {
            None
        } else if value.is_nan() {
            Some("nan")
        } else if value > 0.0 {
            Some("inf")
        } else {
            Some("-inf")
        }
    }

    /// For `#[serde(with = …)]`.
    ///
    /// # Errors
    /// The serializer's own.
    pub fn serialize<S: Serializer>(value: &f64, serializer: S) -> Result<S::Ok, S::Error> {
        match text(*value) {
            None => serializer.serialize_f64(*value),
            Some(text) => serializer.serialize_str(text),
        }
    }

    /// For `#[serde(with = …)]`.
    ///
    /// # Errors
    /// When the value is neither a number nor one of the three texts.
    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
        #[derive(Deserialize)]
        #[serde(untagged)]
        enum Form {
            Number(f64),
            Text(String),
        }
        match Form::deserialize(deserializer)? {
            Form::Number(v) => Ok(v),
            Form::Text(t) => match t.as_str() {
                "inf" => Ok(f64::INFINITY),
                "-inf" => Ok(f64::NEG_INFINITY),
                "nan" => Ok(f64::NAN),
                other => Err(de::Error::custom(format!("'{other}' is not a number"))),
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn records_survive_json_with_infinity_and_absence() {
        let record = Record {
            pair_id: "m/Motorcycle/im0__im1".into(),
            dataset: "m".into(),
            scene: "Motorcycle".into(),
            cluster: "Motorcycle".into(),
            source: "im0".into(),
            target: "im1".into(),
            method: "target".into(),
            baseline_m: 0.193_001,
            rotation_deg: 0.0,
            median_depth_m: Some(2.9),
            overlap: None,
            status: Status::Failed {
                reason: "x: truncated".into(),
            },
            scores: BTreeMap::from([
                ("psnr".into(), Score::Value(f64::INFINITY)),
                (
                    "dists".into(),
                    Score::Unavailable {
                        unavailable: "no weights".into(),
                    },
                ),
                ("ssim[gauss11,valid]".into(), Score::Value(0.1)),
            ]),
            extras: BTreeMap::from([("mean_alpha".into(), 0.5)]),
        };
        let text = serde_json::to_string(&record).unwrap();
        assert!(text.contains(r#""psnr":"inf""#), "{text}");
        assert_eq!(serde_json::from_str::<Record>(&text).unwrap(), record);
    }
}
