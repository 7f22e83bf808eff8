//! `manifest.json`: facts common to all results of a folder.

use std::collections::{BTreeMap, BTreeSet};
use std::fmt;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use sharp::color::Quantization;
use sharp_datasets::left_out::LeftOutScenes;
use sharp_metrics::options::Arithmetic;
use sharp_metrics::{InstructionSet, MetricInfo};

use super::aggregation::Aggregation;
use super::error::EvaluateError;
use super::unit::Slot;
use crate::io::hash::StableHasher;
use crate::io::text::visible_line;
use crate::methods::{MethodIdentity, MethodSpec, Privilege};
use crate::pairs::dataset::DatasetReading;
use crate::pairs::{DatasetConfig, OpenDataset, PairProvenance};
use crate::rendering::{RenderSettings, SharedRenderer};
use crate::scoring::{Scoring, ScoringRules};

/// Version of a run folder's layout: manifest, units and plan.
pub const FORMAT: u32 = 2;

/// Facts common to all results of a folder. Contains no times, and no paths except those that the
/// user gave, so two identical runs have the same manifest.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct Manifest {
    /// [`FORMAT`] of the writer.
    pub format: u32,
    /// Version of the harness.
    pub version: String,
    /// Hashes of source code and locked dependencies, by the part of the program whose results they
    /// affect.
    pub sources: BTreeMap<String, String>,
    /// The renderer, one for the whole folder.
    pub renderer: RendererRecord,
    /// Instruction set of the CPU's kernels.
    #[schemars(with = "String")]
    pub kernels: InstructionSet,
    /// Device and precision of the networks behind the metrics.
    pub metric_networks: Arithmetic,
    /// The conventions that turn predictions into scored pictures, as text.
    pub scoring: BTreeMap<String, String>,
    /// Whether all methods of a pair are scored on the region that all of them predict.
    #[serde(default)]
    pub common_region: bool,
    /// How the tables average scores.
    #[serde(default)]
    pub aggregation: Aggregation,
    /// Selection of the compared pixels.
    #[serde(default)]
    pub rules: ScoringRules,
    /// The protocol that the run follows (`--protocol`).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub protocol: Option<ProtocolRecord>,
    /// Datasets, in the order given.
    pub datasets: Vec<DatasetRecord>,
    /// Pair counts and lists.
    pub pairs: PairsRecord,
    /// Methods, in the order of the tables.
    pub methods: Vec<MethodRecord>,
    /// Metrics, in the order of the columns.
    pub metrics: Vec<MetricRecord>,
}

/// A published evaluation that a run follows, and the differences from it.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct ProtocolRecord {
    /// Name, as in `--protocol`.
    pub name: String,
    /// Repository and commit from which its rules were taken.
    pub source: String,
    /// How the original treats failed targets. Here, failures are recorded and tables state their coverage.
    pub failures: String,
    /// Misleading rules of the original that the run follows nevertheless.
    pub traps: Vec<String>,
    /// Differences between this harness and the original.
    pub departures: Vec<String>,
}

/// The renderer, with every setting that affects pixels.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct RendererRecord {
    /// The exact backend: `cpu-avx512`, or `wgpu:<adapter, driver>`.
    pub backend: String,
    /// Minimum depth drawn, in metres.
    pub near: f64,
    /// Maximum depth drawn, in metres.
    pub far: f64,
    /// Added to the diagonal of projected covariances, pixels², for Gaussians without their own rendering rule.
    pub eps2d: f64,
    /// Background: `black`, `white`, `#rrggbb` in sRGB, or RGB in the rule's blending space.
    pub background: String,
    /// Rounding from 0..1 to 8 bit: `round` or `truncate`.
    #[serde(default = "rounded")]
    pub quantization: String,
}

fn rounded() -> String {
    Quantization::Round.to_string()
}

impl RendererRecord {
    pub fn of(renderer: &SharedRenderer) -> Self {
        let RenderSettings {
            eps2d,
            background,
            quantization,
        } = renderer.settings();
        Self {
            backend: renderer.name().to_owned(),
            near: 0.01,
            far: 1e10,
            // The decimal number that the user gave, not the nearest f32.
            eps2d: eps2d.to_string().parse().unwrap_or(f64::from(eps2d)),
            background: background.to_string(),
            quantization: quantization.to_string(),
        }
    }

    /// Every setting except the backend, with its name.
    pub(super) fn settings(&self) -> [(&'static str, String); 5] {
        [
            ("nearest depth", self.near.to_string()),
            ("farthest depth", self.far.to_string()),
            ("eps2d", self.eps2d.to_string()),
            ("background", self.background.clone()),
            ("rounding to 8 bit", self.quantization.clone()),
        ]
    }
}

impl fmt::Display for RendererRecord {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let Self {
            backend,
            near,
            far,
            eps2d,
            background,
            quantization,
        } = self;
        write!(
            f,
            "{backend}, near {near}, far {far:e}, eps2d {eps2d}, background {background}, 8 bit by {quantization}"
        )
    }
}

/// Facts about one dataset of a run.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct DatasetRecord {
    /// Name of the dataset, the heading of its column group in the tables.
    pub name: String,
    /// The spec as given, without pair options. `None` in digests of bundles, and if this version cannot parse it.
    #[serde(with = "spec_text")]
    #[schemars(with = "String")]
    pub spec: Option<DatasetConfig>,
    /// The format that the dataset is read as.
    pub format: String,
    /// Hash of reader and settings, without the path.
    pub identity: String,
    /// The pattern of `--scenes`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub only_scenes: Option<String>,
    /// Number of evaluated scenes.
    pub scenes: usize,
    /// Number of views in these scenes.
    pub views: usize,
    /// Width and height of the smallest and the largest view, pixels; one entry if all are equal.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub view_sizes: Vec<(u32, u32)>,
    /// The reader settings in force.
    pub readings: Vec<DatasetReading>,
    /// The reader's assumptions, and the frames that it left out.
    pub notes: Vec<String>,
    /// Scenes that exist but were not evaluated.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub left_out: Vec<LeftOutScenes>,
    /// Number of views without pairs because their files cannot be read; the notes name them.
    #[serde(default, skip_serializing_if = "is_zero")]
    pub unreadable_views: usize,
}

#[expect(clippy::trivially_copy_pass_by_ref, reason = "serde passes references")]
fn is_zero(count: &usize) -> bool {
    *count == 0
}

impl DatasetRecord {
    /// Sizes of the views as text: `720×496 pixels`, or a range. `None` if the manifest does not record them.
    pub fn sizes(&self) -> Option<String> {
        let sizes = self
            .view_sizes
            .iter()
            .map(|(width, height)| format!("{width}×{height}"));
        let sizes: Vec<String> = sizes.collect();
        (!sizes.is_empty()).then(|| format!("{} pixels", sizes.join(" to ")))
    }

    /// The spec as text; empty for `None`.
    pub fn spec_text(&self) -> String {
        self.spec
            .as_ref()
            .map(ToString::to_string)
            .unwrap_or_default()
    }

    /// Reopens the dataset with the recorded settings.
    ///
    /// # Errors
    /// If it cannot be opened from this working directory.
    pub fn open(&self, scenes: Option<&str>) -> Result<OpenDataset, EvaluateError> {
        let Some(config) = &self.spec else {
            return Err(EvaluateError::NoDatasetSpec(self.name.clone()));
        };
        OpenDataset::open_recorded(config, &self.readings, scenes).map_err(|reason| {
            let here = std::env::current_dir();
            EvaluateError::RunDataset {
                spec: config.to_string(),
                reason: Box::new(reason),
                from: match here {
                    Ok(here) if config.spec.path.is_relative() => format!(
                        "; the path is relative to the folder where `run` was started, and was looked up in {}",
                        here.display()
                    ),
                    _ => String::new(),
                },
            }
        })
    }
}

/// Serialises a spec as text, and `None` as an empty text.
mod spec_text {
    use serde::{Deserialize, Deserializer, Serializer};

    pub(super) fn serialize<T: ToString, S: Serializer>(
        spec: &Option<T>,
        serializer: S,
    ) -> Result<S::Ok, S::Error> {
        let text = spec.as_ref().map(ToString::to_string);
        serializer.serialize_str(&text.unwrap_or_default())
    }

    pub(super) fn deserialize<'de, T: std::str::FromStr, D: Deserializer<'de>>(
        deserializer: D,
    ) -> Result<Option<T>, D::Error> {
        Ok(String::deserialize(deserializer)?.parse().ok())
    }
}

/// The pairs of a folder.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct PairsRecord {
    /// SHA-256 of `pairs.csv`.
    pub sha256: String,
    /// Number of rows in `pairs.csv`.
    pub listed: usize,
    /// Number of planned pairs.
    pub evaluated: usize,
    /// The lists that `pairs.csv` was combined from.
    pub lists: Vec<ListRecord>,
}

/// A pair list and its origin.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct ListRecord {
    /// SHA-256 of the list.
    pub sha256: String,
    /// Number of rows in the list.
    pub listed: usize,
    /// Number of evaluated pairs from the list.
    pub evaluated: usize,
    /// The limit of the run (`--limit`); `None` for all selected pairs.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub limit: Option<usize>,
    pub origin: ListOrigin,
    /// How the pairs of each dataset were chosen, if known.
    pub choices: BTreeMap<String, PairProvenance>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum ListOrigin {
    /// Built from the datasets.
    Built,
    /// Given by `--pairs`.
    Given,
}

/// Facts about one method of a run.
#[derive(Debug, Clone, PartialEq, Eq, Serialize, Deserialize, JsonSchema)]
pub struct MethodRecord {
    /// Row label in the tables.
    pub label: String,
    /// The spec as given; `None` for methods passed in as code and in digests of bundles.
    #[serde(with = "spec_text")]
    #[schemars(with = "String")]
    pub spec: Option<MethodSpec>,
    /// Everything that determines the method's predictions.
    pub identity: MethodIdentity,
    #[serde(flatten)]
    pub privilege: Privilege,
    /// Hash of the code that makes the method's pictures.
    pub sources: String,
    /// Warnings about the method's options, one sentence each.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub notes: Vec<String>,
    /// Notes on the rendering rules that were chosen for the method's Gaussian files because neither the files nor the
    /// user stated one.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub drawn: Vec<String>,
    /// Warnings about the method's predictions, one of each kind.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub warnings: Vec<String>,
}

impl MethodRecord {
    /// Hash of the method; only pictures with the same hash share a table.
    pub(super) fn hash(&self) -> String {
        StableHasher::default()
            .add("identity", &self.identity.to_string())
            .add("privilege", &format!("{:?}", self.privilege))
            .add("sources", &self.sources)
            .finish()
    }
}

/// A metric of a run, one column of the tables.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize, JsonSchema)]
pub struct MetricRecord {
    /// Convention, weights and precision.
    #[serde(flatten)]
    pub info: MetricInfo,
    /// Hash of `info` and of the code that computes the metric.
    pub identity: String,
}

impl Manifest {
    /// Sets the rule by which tables average scores.
    pub fn aggregate(&mut self, aggregation: Aggregation) {
        self.aggregation = aggregation;
        let text = aggregation_convention(aggregation);
        self.scoring.insert(AGGREGATION.to_owned(), text);
    }

    /// Updates the manifest of a bundle of format 1, whose scores are from a version that did not convert colour profiles.
    /// Scores of sRGB pictures do not depend on this, so today's convention is recorded, and a note on each dataset says
    /// which scores differ.
    pub(super) fn restate_target_convention(&mut self) {
        self.scoring
            .insert(TARGET.to_owned(), TARGET_CONVENTION.to_owned());
        for dataset in &mut self.datasets {
            let note = "scored before colour profiles were converted to sRGB: scores of pictures with another profile \
                        are of the unconverted picture";
            dataset.notes.push(note.to_owned());
        }
    }

    /// Returns a predicate for the units that count: those whose method and dataset still have the identity recorded
    /// here.
    pub(super) fn counted_slots(&self) -> impl Fn(&Slot) -> bool + '_ {
        let methods = self.methods.iter();
        let methods: BTreeMap<&str, String> = methods
            .map(|method| (method.label.as_str(), method.hash()))
            .collect();
        let datasets: BTreeSet<&str> = self.datasets.iter().map(|d| d.identity.as_str()).collect();
        move |slot| {
            methods.get(slot.method.as_str()) == Some(&slot.method_identity)
                && datasets.contains(slot.dataset_identity.as_str())
        }
    }

    /// Rejects a metric whose direction, unit, label or decimals differ from those of its key, so
    /// that editing a manifest cannot change what counts as better.
    pub(super) fn check_metrics(&self) -> Result<(), String> {
        for MetricRecord { info, .. } in &self.metrics {
            let own = MetricInfo::new(info.key, &[]);
            let facts = |info: &MetricInfo| {
                [
                    ("direction", format!("{:?}", info.direction).to_lowercase()),
                    ("unit", info.unit.clone()),
                    ("decimals", info.decimals.to_string()),
                    ("label", info.label.clone()),
                    ("alias", info.alias.clone()),
                    ("family", info.family.name().to_owned()),
                    ("region", format!("{:?}", info.region).to_lowercase()),
                ]
            };
            let mut pairs = facts(info).into_iter().zip(facts(&own));
            if let Some(((what, said), (_, is))) = pairs.find(|(said, is)| said != is) {
                return Err(format!(
                    "manifest.json was changed: the {what} of {} is '{}' there, but should be \
                     '{is}'",
                    info.key,
                    visible_line(&said)
                ));
            }
        }
        Ok(())
    }

    /// Whether pairs are missing because scenes or views cannot be read.
    pub fn lacks_files(&self) -> bool {
        let lacks = |dataset: &DatasetRecord| {
            dataset.unreadable_views > 0 || dataset.left_out.iter().any(|group| !group.by_choice)
        };
        self.datasets.iter().any(lacks)
    }

    /// Metric keys with their identities, in the order of the columns.
    pub fn metric_identities(&self) -> Vec<(String, String)> {
        let metrics = self.metrics.iter();
        metrics
            .map(|metric| (metric.info.key.to_string(), metric.identity.clone()))
            .collect()
    }

    /// Whether any metric uses a network.
    pub(super) fn has_networks(&self) -> bool {
        self.metrics.iter().any(|m| m.info.backbone.is_some())
    }
}

pub(super) fn metric_records(scoring: &Scoring) -> Vec<MetricRecord> {
    let metrics = scoring.metrics.iter();
    metrics
        .map(|metric| MetricRecord {
            info: metric.info.clone(),
            identity: metric.identity.clone(),
        })
        .collect()
}

const TARGET: &str = "target";
const TARGET_CONVENTION: &str = "sRGB, 8 bit, as decoded; converted from other colour profiles, undistorted or masked where the dataset's notes say so";

/// Key of the averaging convention in [`Manifest::scoring`].
pub(super) const AGGREGATION: &str = "aggregation";

fn aggregation_convention(aggregation: Aggregation) -> String {
    format!("{aggregation}; a mean that holds inf is inf")
}

/// The conventions from prediction to score, as text. `renderings` is the rounding of renderings to 8 bit.
pub(super) fn scoring_conventions(
    renderings: Quantization,
    rules: ScoringRules,
    aggregation: Aggregation,
) -> BTreeMap<String, String> {
    let aggregation = aggregation_convention(aggregation);
    let (border, mask) = (rules.border.to_string(), rules.mask.to_string());
    [
        (
            "prediction",
            match renderings {
                Quantization::Round => "sRGB, 8 bit, rounded to nearest",
                Quantization::Truncate => {
                    "sRGB, 8 bit, rounded to nearest; renderings of Gaussians truncated"
                }
            },
        ),
        (TARGET, TARGET_CONVENTION),
        ("decoder", crate::io::fingerprints::DECODERS),
        // Runs and bundles are compared only if these texts are equal, so another wording would make stored runs and
        // bundles incomparable. "Resized up" here includes pictures that are resized down.
        (
            "resolution",
            "full resolution of the target, which is never resized; predictions are resized up or cropped only where a \
             method's identity says so, and are marked in the tables",
        ),
        (
            "median",
            "of an even count the mean of the middle two (torch.median takes the lower)",
        ),
        (AGGREGATION, aggregation.as_str()),
        ("border", border.as_str()),
        ("mask", mask.as_str()),
        (
            "excluded pixels",
            "where the dataset's mask excludes pixels of the target, both pictures take the mean colour of its other \
             pixels, and PSNR is over those",
        ),
        ("frustum mask", "margin 1.05, z > 0, invalid depth outside"),
    ]
    .map(|(name, value)| (name.to_owned(), value.to_owned()))
    .into()
}
