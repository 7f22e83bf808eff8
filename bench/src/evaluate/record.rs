//! One result of a run: a pair, predicted by a method, scored or failed.
//!
//! Runs write records and reports read them; no averages are stored.

use std::collections::BTreeMap;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::picture_check::finding::{PictureChange, ShownCamera, ShownTarget};
use super::picture_check::measures::{Cell, ShiftEquations, Tone};
use crate::scoring::Region;

/// Outcome of a unit.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(tag = "status", rename_all = "snake_case")]
pub enum Status {
    /// Predicted and scored.
    Ok,
    /// A stage failed. The unit counts as missing.
    Failed {
        /// The reason, in one line, with the file or the stage.
        reason: String,
    },
}

/// The value of a metric for one prediction.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
#[serde(untagged)]
pub enum Score {
    /// A number; infinity (identical pictures under PSNR) is stored as the string `"inf"`.
    Value(
        #[serde(with = "finite_or_text")]
        #[schemars(with = "finite_or_text::Form")]
        f64,
    ),
    /// The metric could not be computed for this pair.
    Unavailable {
        /// The reason, in one line.
        unavailable: String,
    },
}

impl Score {
    /// The number; `None` if unavailable.
    pub fn value(&self) -> Option<f64> {
        match self {
            Self::Value(v) => Some(*v),
            Self::Unavailable { .. } => None,
        }
    }
}

/// The result of a unit, as used by tables, plots and comparisons.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Record {
    /// `dataset/scene/source__target`, each part percent-encoded.
    pub pair_id: String,
    /// Name of the dataset instance, a column group of the tables.
    pub dataset: String,
    /// Id of the scene.
    pub scene: String,
    /// The physical scene; see `sharp_datasets::Scene::cluster`.
    pub cluster: String,
    /// Id of the source view.
    pub source: String,
    /// Id of the target view.
    pub target: String,
    /// Label of the method instance, a row of the tables.
    pub method: String,
    /// Distance of the two camera centres, in metres.
    pub baseline_m: f64,
    /// Angle between the two cameras, in degrees.
    pub rotation_deg: f64,
    /// Median ground-truth depth of the target view, in metres. For stereo pairs whose target has no depth, it is the
    /// median of the source's depth.
    pub median_depth_m: Option<f64>,
    /// Share of the target's valid-depth pixels visible in the source, 0..1.
    pub overlap: Option<f64>,
    /// Whether the unit succeeded.
    #[serde(flatten)]
    pub status: Status,
    /// Score by metric key (`psnr`, `ssim[gauss11,valid]`, …).
    pub scores: BTreeMap<String, Score>,
    /// The scored part of the target; `None` for all of it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub crop: Option<Crop>,
    /// Share of the scored pixels that a mask includes, 0..1; `None` if no pixel is masked out.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub valid_share: Option<f64>,
    /// Width and height of the prediction before resizing, pixels; `None` if it was not resized.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub resized_from: Option<(u32, u32)>,
    /// The scale of the scene that was chosen among several; `None` if the method tries only one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub scale: Option<ChosenScale>,
    /// Hashes of the pair's files; `None` if a file is unreadable or an older version wrote the result.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub files: Option<PairFiles>,
    /// Extra values reported by the method (`mean_alpha`, `hole_share`, …).
    pub extras: BTreeMap<String, f64>,
    /// Warnings about the prediction, by topic.
    #[serde(default, skip_serializing_if = "BTreeMap::is_empty")]
    pub warnings: BTreeMap<String, String>,
    /// How the stored picture was probably altered.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub change: Option<PictureChange>,
    /// The target that the stored picture matches best; `None` if it was not compared with other targets.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub shows: Option<ShownTarget>,
    /// The camera from which the picture shows the scene, if measurable.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub camera: Option<ShownCamera>,
    /// A translation in world axes that explains the picture about as well as `camera`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub in_world: Option<ShownCamera>,
    /// Cells of a grid in which the stored picture differs from its target; `None` if they were not compared.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub wrong_cells: Option<Vec<Cell>>,
    /// Levels of the stored picture, its target and its source; `None` if they were not compared.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub tone: Option<Tone>,
    /// Equations of the stored picture's shift, from edges, in pixels; `None` if the picture was not compared or its
    /// edges do not allow a measurement.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub shift: Option<ShiftEquations>,
    /// Equations of the stored picture's shift, from blocks, in thousandths of the width; `None` if the picture was not
    /// compared or too few blocks were found.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub far_shift: Option<ShiftEquations>,
    /// Percentage of the content common to source and target where the stored picture is black, white or
    /// [filled](Self::filled); `None` if too little content was found.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub masked: Option<u8>,
    /// The exactly constant colour of a large part of the stored picture, such as holes or a background that was not
    /// rendered; `None` if the picture was not compared or has no such part.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub filled: Option<[u8; 3]>,
    /// A note on the rendering rule that was assumed for the Gaussians; `None` if the file or the user stated the rule.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub rule_note: Option<String>,
}

/// Hashes of a pair's files, 16 hexadecimal digits each. Results are shown together only if their hashes of each view,
/// and each method's hashes of each file of Gaussians, are equal.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct PairFiles {
    /// Hash of the source's camera, photograph, mask and depth.
    pub source: String,
    /// Hash of the target's camera, photograph, mask and depth.
    pub target: String,
    /// Hash of the external files that the method read for this pair; `None` if it read none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub pictures: Option<String>,
    /// The external file of Gaussians that the method read for this source; `None` if it read none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gaussians: Option<GaussiansRead>,
}

/// The file from which a prediction's Gaussians were read.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct GaussiansRead {
    /// The last three parts of the path, separated by `/`.
    pub file: String,
    /// Hash of the file's bytes, 16 hexadecimal digits.
    pub hash: String,
}

/// The part of the target that a prediction shows.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Crop {
    /// The region, in pixels of the target.
    pub region: Region,
    /// Share of the target's pixels in the region, 0..1.
    pub share: f64,
}

/// The best of several scales of the scene, chosen by comparison with the target.
#[derive(Debug, Clone, Copy, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ChosenScale {
    /// The chosen scale.
    pub best: f64,
    /// Number of scales tried.
    pub tried: usize,
}

/// Describes the first view or file of Gaussians whose hash differs between two successful results; `None` if all
/// agree.
pub(crate) fn file_difference<'a>(records: impl IntoIterator<Item = &'a Record>) -> Option<String> {
    let mut known: BTreeMap<(&str, &str, &str), (&str, &Record)> = BTreeMap::new();
    let mut gaussians: BTreeMap<[&str; 3], &str> = BTreeMap::new();
    for record in records {
        let (Status::Ok, Some(files)) = (&record.status, &record.files) else {
            continue;
        };
        for (view, hash) in [
            (&record.source, &files.source),
            (&record.target, &files.target),
        ] {
            let key = (
                record.dataset.as_str(),
                record.scene.as_str(),
                view.as_str(),
            );
            let (before, other) = *known.entry(key).or_insert((hash, record));
            if before != hash {
                return Some(format!(
                    "the photograph, mask, depth or camera of {}/{}/{view} differs between '{}' on {} and '{}' on {}",
                    record.dataset,
                    record.scene,
                    other.method,
                    other.pair_id,
                    record.method,
                    record.pair_id
                ));
            }
        }
        // Compare hashes per file, not per source, because a file of Gaussians may serve one source or all sources of a
        // scene.
        let Record {
            method, dataset, ..
        } = record;
        if let Some(GaussiansRead { file, hash }) = &files.gaussians
            && *gaussians.entry([method, dataset, file]).or_insert(hash) != hash
        {
            return Some(format!(
                "the Gaussians {file} of '{method}' have changed: pair {} was rendered from another version of the file \
                 than earlier pairs",
                record.pair_id
            ));
        }
    }
    None
}

impl Record {
    /// The name of the first geometric fact in which two records of a pair differ. Such facts must not depend on the
    /// method.
    pub(crate) fn differing_fact(&self, other: &Self) -> Option<&'static str> {
        let facts = |r: &Self| {
            [
                ("baseline", Some(r.baseline_m.to_bits())),
                ("rotation", Some(r.rotation_deg.to_bits())),
                ("median depth", r.median_depth_m.map(f64::to_bits)),
                ("overlap", r.overlap.map(f64::to_bits)),
            ]
        };
        let mut both = facts(self).into_iter().zip(facts(other));
        both.find(|(a, b)| a != b).map(|((what, _), _)| what)
    }

    /// All numbers other than scores, by column name: the method's extras, and the numbers in [`Self::crop`],
    /// [`Self::valid_share`], [`Self::resized_from`] and [`Self::scale`].
    pub fn reported(&self) -> BTreeMap<&str, f64> {
        let mut columns: BTreeMap<&str, f64> = self
            .extras
            .iter()
            .map(|(name, v)| (name.as_str(), *v))
            .collect();
        if let Some(Crop { region, share }) = self.crop {
            for (name, value) in [
                ("crop_x", region.x),
                ("crop_y", region.y),
                ("crop_width", region.width),
                ("crop_height", region.height),
            ] {
                columns.insert(name, f64::from(value));
            }
            columns.insert("scored_share", share);
        }
        if let Some(share) = self.valid_share {
            columns.insert("valid_share", share);
        }
        if let Some((width, height)) = self.resized_from {
            columns.insert("predicted_width", f64::from(width));
            columns.insert("predicted_height", f64::from(height));
        }
        if let Some(ChosenScale { best, tried }) = self.scale {
            columns.insert("best_scale", best);
            columns.insert("scales_tried", tried as f64);
        }
        columns
    }
}

/// Serialises finite numbers as numbers, and all others, which JSON numbers cannot represent, as
/// `"inf"`, `"-inf"` or `"nan"`.
pub mod finite_or_text {
    use serde::{Deserialize, Deserializer, Serializer, de};

    #[derive(Deserialize, schemars::JsonSchema)]
    #[serde(untagged)]
    pub enum Form {
        Number(f64),
        /// `inf`, `-inf` or `nan`.
        Text(String),
    }

    /// The text for a number that is not finite; `None` for a finite one.
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
    /// Errors of the serializer.
    pub fn serialize<S: Serializer>(value: &f64, serializer: S) -> Result<S::Ok, S::Error> {
        match text(*value) {
            None => serializer.serialize_f64(*value),
            Some(text) => serializer.serialize_str(text),
        }
    }

    /// For `#[serde(with = …)]`.
    ///
    /// # Errors
    /// If the value is neither a number nor one of the three texts.
    pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<f64, D::Error> {
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
pub(super) mod tests {
    use super::*;

    pub(in crate::evaluate) fn record() -> Record {
        Record {
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
            crop: None,
            valid_share: Some(0.5),
            resized_from: Some((4, 3)),
            scale: None,
            files: None,
            extras: BTreeMap::from([("mean_alpha".into(), 0.5)]),
            warnings: BTreeMap::new(),
            change: None,
            shows: None,
            camera: None,
            in_world: None,
            wrong_cells: None,
            tone: None,
            masked: None,
            filled: None,
            shift: None,
            far_shift: None,
            rule_note: None,
        }
    }

    #[test]
    fn records_survive_json_with_infinity_and_absence() {
        let record = record();
        let text = serde_json::to_string(&record).unwrap();
        assert!(text.contains(r#""psnr":"inf""#), "{text}");
        assert_eq!(serde_json::from_str::<Record>(&text).unwrap(), record);
    }
}
