//! Scores kept predictions under several readings: ways to turn a prediction into the scored picture that a protocol
//! leaves open, such as rounding. Predicts and renders nothing, and does not change the folder.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use image::{Rgb, Rgb32FImage, RgbImage};
use sharp::color::{Quantization, quantize, srgb_from_linear};
use sharp_metrics::{MetricKey, Picture};

use super::error::EvaluateError;
use super::folder::RunFolder;
use super::manifest::Manifest;
use super::record::{Record, Status};
use super::rescore::open_datasets;
use super::results::{Current, units_folder};
use super::score::PairTruth;
use super::unit::Unit;
use crate::io::observer::Observer;
use crate::io::pictures::{LinearPicture, read_linear, read_rgb8, to_rgb8};
use crate::pairs::PairList;
use crate::pairs::dataset::scenes_of;
use crate::scoring::rules::{Border, ScoringRules};
use crate::scoring::{Region, Scoring};

/// Lower limit of the alpha by which colours are divided, as in UniSHARP's trainer.
const MIN_ALPHA: f32 = 1e-4;

/// A way to convert a prediction to the scored picture.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum PictureReading {
    /// The picture as the run scored it.
    AsScored,
    /// Floating-point values, not rounded to 8 bit.
    Unrounded,
    /// Floating-point values truncated to 8 bit.
    Truncated,
    /// Linear colour divided by alpha, so that partly covered pixels take the colour of the covering surface; rounded
    /// to 8 bit.
    AlphaDivided,
    /// As scored, but without the border ([`Border::Twentieth`]).
    BorderCropped,
}

impl PictureReading {
    pub const ALL: [Self; 5] = [
        Self::AsScored,
        Self::Unrounded,
        Self::Truncated,
        Self::AlphaDivided,
        Self::BorderCropped,
    ];

    /// Name of the reading in tables and files.
    pub fn name(self) -> &'static str {
        match self {
            Self::AsScored => "as scored",
            Self::Unrounded => "not rounded",
            Self::Truncated => "truncated",
            Self::AlphaDivided => "divided by alpha",
            Self::BorderCropped => "border cropped",
        }
    }

    /// Whether this conversion needs the linear picture that `run --keep float` keeps.
    fn needs_float(self) -> bool {
        matches!(self, Self::Unrounded | Self::Truncated | Self::AlphaDivided)
    }
}

/// A method's predictions scored under all readings.
#[derive(Debug, Clone, Default)]
pub struct Readings {
    /// The units that have a kept picture.
    pub records: Vec<Record>,
    /// Number of units, with and without a kept picture, by dataset.
    pub units: BTreeMap<String, usize>,
    /// For each reading and metric, the scores of `records` in order. Metrics without any score are left out.
    pub scores: BTreeMap<(PictureReading, MetricKey), Vec<Option<f64>>>,
    /// Number of pairs without a score, keyed by reading and reason.
    pub absent: BTreeMap<(String, String), usize>,
    /// Number of scores that differ from the run's when recomputed from the kept pictures.
    pub changed: usize,
}

/// Scores a method's kept predictions under every reading for which the necessary pictures were kept.
///
/// # Errors
/// If the folder or its datasets cannot be read, or `root` is a bundle, which contains no pictures.
pub fn score_readings(
    root: &Path,
    method: &str,
    scoring: &Scoring,
    observer: &dyn Observer,
) -> Result<Readings, EvaluateError> {
    let folder = RunFolder::open(root)?;
    let current = Current::read(&folder)?;
    let datasets = open_datasets(&current.manifest)?;
    let scenes = scenes_of(&datasets);
    let store = units_folder(&folder, &current.manifest).unlocked();
    let mut units: BTreeMap<&str, &Unit> = BTreeMap::new();
    for unit in current
        .units
        .iter()
        .filter(|unit| unit.slot.method == method)
    {
        units.insert(&unit.slot.pair_id, unit);
    }
    let mut list = PairList::read(&folder.pairs_path())?;
    list.pairs
        .retain(|pair| units.contains_key(pair.pair_id.as_str()));
    let list = PairList::new("pairs.csv", list.pairs);
    let metrics = current.manifest.metric_identities();
    let mut readings = Readings::default();
    observer.begin("reading again", list.pairs.len(), "pairs");
    for planned in list.resolve(&scenes)? {
        observer.step();
        let Some(unit) = units.get(planned.pair.pair_id.as_str()) else {
            continue;
        };
        *readings
            .units
            .entry(unit.record.dataset.clone())
            .or_default() += 1;
        if unit.record.status != Status::Ok {
            readings.lacks("every reading", "the prediction failed");
            continue;
        }
        if !store.has_picture(unit) {
            readings.lacks(
                "every reading",
                "the prediction was not kept, or differs from the one that was scored",
            );
            continue;
        }
        let record = Record {
            baseline_m: planned.pair.baseline_m,
            ..unit.record_with(&metrics)
        };
        let truth = PairTruth::new(planned);
        score_unit(
            &mut readings,
            unit,
            record,
            &truth,
            &store,
            &current.manifest,
            scoring,
        );
    }
    observer.end();
    readings
        .scores
        .retain(|_, scores| scores.iter().any(Option::is_some));
    Ok(readings)
}

fn score_unit(
    readings: &mut Readings,
    unit: &Unit,
    record: Record,
    truth: &PairTruth<'_>,
    store: &RunFolder,
    manifest: &Manifest,
    scoring: &Scoring,
) {
    let at = readings.records.len();
    let path = |extension| store.prediction_path(&unit.slot.method, &unit.slot.pair_id, extension);
    let kept = match read_rgb8(&path("png")) {
        Ok(kept) => kept,
        Err(error) => return readings.lacks("every reading", &error.to_string()),
    };
    let picture = unit.picture.as_ref();
    let linear = if store.has_float(unit) {
        read_linear(&path("exr")).map_err(|error| error.to_string())
    } else if picture.is_some_and(|picture| picture.float_sha256.is_some()) {
        Err("the linear picture is missing, or differs from the one that was rendered".to_owned())
    } else {
        Err("only runs with --keep float keep linear pictures, and only of renderings".to_owned())
    };
    let region = record.crop.map(|crop| crop.region);
    let mut pictures: Vec<(PictureReading, Picture)> = Vec::new();
    for reading in PictureReading::ALL {
        let made = match (&linear, reading.needs_float()) {
            (Err(reason), true) => Err(reason.clone()),
            (Ok(linear), true) => from_linear(linear, reading, manifest),
            (_, false) => Ok(Picture::Rgb8(kept.clone())),
        };
        match made {
            Ok(picture) => pictures.push((reading, picture)),
            Err(reason) => readings.lacks(reading.name(), &reason),
        }
    }
    let (cropped, others): (Vec<_>, Vec<_>) = pictures
        .iter()
        .partition(|(reading, _)| *reading == PictureReading::BorderCropped);
    let mut scored = Vec::new();
    for (border, group) in [
        (manifest.rules.border, others),
        (Border::Twentieth, cropped),
    ] {
        let masks = truth.masks(&scoring.under(ScoringRules {
            border,
            ..manifest.rules
        }));
        let shown: Vec<(&Picture, Option<Region>)> =
            group.iter().map(|(_, picture)| (picture, region)).collect();
        match (truth.get(), masks) {
            (Ok(truth), Ok(masks)) => {
                let scores = truth.score(&scoring.scorer, &shown, &masks);
                scored.extend(group.iter().map(|(reading, _)| *reading).zip(scores));
            }
            (Err(reason), _) | (_, Err(reason)) => return readings.lacks("every reading", &reason),
        }
    }
    for (reading, scores) in scored {
        let scores = match scores {
            Ok(scores) => scores,
            Err(reason) => {
                readings.lacks(reading.name(), &reason);
                continue;
            }
        };
        for (key, score) in scores {
            match score {
                Ok(value) => {
                    let before = record
                        .scores
                        .get(&key.to_string())
                        .and_then(|score| score.value());
                    let moved = before.is_some_and(|before| before.to_bits() != value.to_bits());
                    readings.changed += usize::from(reading == PictureReading::AsScored && moved);
                    let values = readings.scores.entry((reading, key)).or_default();
                    values.resize(at, None);
                    values.push(Some(value));
                }
                Err(reason) if reading == PictureReading::AsScored => {
                    readings.lacks(&key.to_string(), &reason.to_string());
                }
                Err(_) => {}
            }
        }
    }
    readings.records.push(record);
    for values in readings.scores.values_mut() {
        values.resize(at + 1, None);
    }
}

impl Readings {
    fn lacks(&mut self, what: &str, reason: &str) {
        *self
            .absent
            .entry((what.to_owned(), reason.to_owned()))
            .or_default() += 1;
    }

    pub fn datasets(&self) -> BTreeSet<&str> {
        self.units.keys().map(String::as_str).collect()
    }
}

/// Converts a kept linear rendering to the picture that `reading` scores. Errors say why it cannot be converted.
fn from_linear(
    linear: &LinearPicture,
    reading: PictureReading,
    manifest: &Manifest,
) -> Result<Picture, String> {
    let divides = reading == PictureReading::AlphaDivided;
    if divides && manifest.renderer.background != "black" {
        return Err("the background is not black".to_owned());
    }
    let (width, height) = linear.rgb.dimensions();
    let encoded = Rgb32FImage::from_fn(width, height, |x, y| {
        let alpha = linear.alpha.get_pixel(x, y).0[0].max(MIN_ALPHA);
        Rgb(linear.rgb.get_pixel(x, y).0.map(|value| {
            let value = value.clamp(0.0, 1.0);
            let value = if divides {
                (value / alpha).min(1.0)
            } else {
                value
            };
            srgb_from_linear(value).clamp(0.0, 1.0)
        }))
    });
    Ok(match reading {
        PictureReading::Unrounded => Picture::RgbF32(encoded),
        PictureReading::Truncated => Picture::Rgb8(RgbImage::from_fn(width, height, |x, y| {
            let levels = encoded
                .get_pixel(x, y)
                .0
                .map(|v| quantize(v, Quantization::Truncate));
            Rgb(levels)
        })),
        _ => Picture::Rgb8(to_rgb8(&encoded)),
    })
}
