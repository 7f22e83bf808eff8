//! Results arranged as a grid: datasets, their pairs, and each method's record of each pair.

use std::collections::{BTreeMap, BTreeSet};

use sharp::model::bundled;
use sharp_datasets::DatasetEntry;
use sharp_datasets::registry::ENTRIES;

use crate::evaluate::doubts::{doubts_of, rule_notes};
use crate::evaluate::manifest::{DatasetRecord, MethodRecord};
use crate::evaluate::record::{Record, Status};
use crate::evaluate::{Aggregation, Manifest, Results};
use crate::io::counts::counted;
use crate::methods::sharp::Sharp;
use crate::methods::{KINDS, MethodIdentity};

use super::column::Column;
use super::error::ReportError;

/// Results as a grid of datasets, pairs and methods, from which tables and plots are made.
#[derive(Debug)]
pub struct Board<'a> {
    /// Datasets, in the order of the run.
    pub datasets: Vec<DatasetBoard<'a>>,
    /// Methods, in the order of the run.
    pub methods: Vec<ReportMethod>,
    /// Metrics, in the order of the run, including those without scores.
    pub metrics: Vec<Column>,
}

#[derive(Debug)]
pub struct DatasetBoard<'a> {
    pub dataset: ReportDataset,
    /// Sorted bytewise by `pair_id`.
    pub pairs: Vec<PairBoard<'a>>,
}

#[derive(Debug)]
pub struct PairBoard<'a> {
    /// A record of the pair by some method, for facts that do not depend on the method.
    pub facts: &'a Record,
    /// The pair's records, in the order of [`Board::methods`]; `None` for methods without a record of the pair.
    pub by_method: Vec<Option<&'a Record>>,
}

/// A dataset of the report: a column group of the tables.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct ReportDataset {
    /// Name as in the records: the user's choice, or the format by default.
    pub name: String,
    /// Format that the dataset was read as; `None` if only its name is known.
    pub format: Option<String>,
    /// One line that describes the dataset and how much of it was read.
    pub description: String,
    /// Settings and pair options known to differ from the paper, as `key=value`; shown in a footnote of the column.
    pub proxies: Vec<String>,
    /// Whether scores are computed on the region of each target that all methods predict.
    pub common_region: bool,
    pub aggregation: Aggregation,
}

/// A method of the report: a row of the tables.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct ReportMethod {
    /// Label as in the records.
    pub label: String,
    /// One line that describes the method and its options.
    pub description: String,
    /// Why this row has no rank (`it is the ground truth itself`); `None` if it takes part in the ranking.
    pub unranked: Option<String>,
    /// Whether the method is trivial, so that every real method is expected to beat it.
    pub is_baseline: bool,
    /// Whether plots and sheets show the method. The methods `target` and `mean`, which would stretch the axes, are
    /// left out unless the user lists them or there are no other methods.
    pub is_plotted: bool,
    /// Name of the kernel that resized predictions of another size, if known.
    pub resize_kernel: Option<String>,
    /// Warnings about the method's predictions, shown below the first table with the method's label.
    pub doubt: Option<String>,
    /// Notes on the method, shown next to `doubt`.
    pub note: Option<String>,
}

impl<'a> DatasetBoard<'a> {
    pub fn records_of(&self, method: usize) -> impl Iterator<Item = &'a Record> {
        let slots = self
            .pairs
            .iter()
            .map(move |pair| pair.by_method.get(method));
        slots.filter_map(|slot| slot.copied().flatten())
    }
}

impl<'a> Board<'a> {
    /// Datasets whose terms forbid publishing their pictures.
    pub fn withheld(&self) -> impl Iterator<Item = &ReportDataset> {
        let datasets = self.datasets.iter().map(|board| &board.dataset);
        datasets.filter(|dataset| !dataset.may_publish())
    }

    /// Arranges results.
    ///
    /// # Errors
    /// If a pair has two records of one method, or two records of a pair disagree on its geometry: means would then be
    /// meaningless.
    pub fn of(results: &'a Results) -> Result<Self, ReportError> {
        let Results {
            manifest, records, ..
        } = results;
        let labels = manifest.methods.iter().map(|method| method.label.as_str());
        let places: BTreeMap<&str, usize> = labels.zip(0..).collect();
        let mut grouped: BTreeMap<&str, BTreeMap<&str, PairBoard<'a>>> = BTreeMap::new();
        for record in records {
            let pairs = grouped.entry(&record.dataset).or_default();
            let pair = pairs.entry(&record.pair_id).or_insert_with(|| PairBoard {
                facts: record,
                by_method: vec![None; places.len()],
            });
            let conflict = |reason: String| ReportError::Conflict {
                pair: record.pair_id.clone(),
                method: record.method.clone(),
                reason,
            };
            if let Some(what) = pair.facts.differing_fact(record) {
                return Err(conflict(format!(
                    "its {what} differs from the one in the record of '{}'",
                    pair.facts.method
                )));
            }
            let Some(place) = places.get(record.method.as_str()) else {
                continue;
            };
            if pair.by_method[*place].replace(record).is_some() {
                return Err(conflict("has two records".into()));
            }
        }
        let datasets = manifest.datasets.iter().map(|dataset| {
            let pairs = grouped.remove(dataset.name.as_str()).unwrap_or_default();
            DatasetBoard {
                dataset: ReportDataset::recorded(manifest, dataset, records),
                pairs: pairs.into_values().collect(),
            }
        });
        let datasets = datasets.collect();
        let methods = manifest.methods.iter();
        let mut methods: Vec<_> = methods.map(|m| ReportMethod::of(m, records)).collect();
        if results.methods_listed || methods.iter().all(|method| !method.is_plotted) {
            for method in &mut methods {
                method.is_plotted = true;
            }
        }
        Ok(Self {
            datasets,
            methods,
            metrics: manifest.metrics.iter().map(|m| (&m.info).into()).collect(),
        })
    }

    /// Indices of the methods that plots and sheets show.
    pub fn plotted(&self) -> impl Iterator<Item = usize> {
        let methods = self.methods.iter().enumerate();
        methods.filter_map(|(i, method)| method.is_plotted.then_some(i))
    }

    /// What the page's summary counts, as singular nouns with their numbers. `metrics` is the number of metrics.
    pub fn counts(&self, metrics: usize) -> [(&'static str, usize); 6] {
        let pairs = || self.datasets.iter().flat_map(|d| &d.pairs);
        let scenes = pairs().map(|pair| (&pair.facts.dataset, &pair.facts.scene));
        [
            ("dataset", self.datasets.len()),
            ("scene", scenes.collect::<BTreeSet<_>>().len()),
            ("pair", pairs().count()),
            ("method", self.methods.len()),
            ("metric", metrics),
            ("failure", self.failures().len()),
        ]
    }

    /// Failed records with their reasons, in the order of the board.
    pub fn failures(&self) -> Vec<(&'a Record, &'a str)> {
        let pairs = self.datasets.iter().flat_map(|d| &d.pairs);
        let records = pairs.flat_map(|pair| pair.by_method.iter().flatten());
        let failures = records.filter_map(|record| match &record.status {
            Status::Failed { reason } => Some((*record, reason.as_str())),
            Status::Ok => None,
        });
        failures.collect()
    }
}

impl ReportDataset {
    /// A dataset known only by its name and its format. `format` may be empty.
    pub fn of(name: &str, format: &str) -> Self {
        Self {
            name: name.to_owned(),
            format: Some(format.to_owned()).filter(|format| !format.is_empty()),
            ..Self::default()
        }
    }

    fn recorded(manifest: &Manifest, dataset: &DatasetRecord, records: &[Record]) -> Self {
        let only = dataset.only_scenes.as_ref();
        let what = match &dataset.spec {
            Some(spec) => spec.to_string(),
            None => dataset.format.clone(),
        };
        Self {
            description: format!(
                "{what} (read: {}{}, {})",
                counted(dataset.scenes, "scene"),
                only.map_or_else(String::new, |glob| format!(" matching {glob}")),
                counted(dataset.views, "view")
            ),
            proxies: proxies(manifest, dataset, records),
            common_region: manifest.common_region,
            aggregation: manifest.aggregation,
            ..Self::of(&dataset.name, &dataset.format)
        }
    }

    /// The name for headings: the user's choice unchanged, or the display name of a format (`ETH3D`).
    pub fn title(&self) -> &str {
        match self.entry() {
            Some(entry) if self.format.as_ref() == Some(&self.name) => entry.display_name,
            _ => &self.name,
        }
    }

    /// Whether the dataset's pictures may be published; false for an unknown dataset.
    pub(super) fn may_publish(&self) -> bool {
        self.entry().is_some_and(|entry| entry.may_publish)
    }

    /// The dataset's catalogue entry, found by format or, if the format is unknown, by name. The format comes first,
    /// because users choose names freely.
    pub(super) fn entry(&self) -> Option<&'static DatasetEntry> {
        let name = self.format.as_ref().unwrap_or(&self.name);
        let mut entries = ENTRIES.into_iter();
        entries.find(|entry| entry.format == name || entry.display_name == name)
    }
}

/// The dataset's settings and pair options that are known to differ from the paper, each listed once.
pub(super) fn proxies(
    manifest: &Manifest,
    dataset: &DatasetRecord,
    records: &[Record],
) -> Vec<String> {
    let readings = dataset.readings.iter().filter(|reading| reading.proxy);
    let mut proxies: Vec<String> = readings
        .map(|reading| format!("{}={}", reading.key, reading.value))
        .collect();
    let of_dataset = records.iter().filter(|r| r.dataset == dataset.name);
    let ids: BTreeSet<&str> = of_dataset.map(|record| record.pair_id.as_str()).collect();
    for list in &manifest.pairs.lists {
        // A run with a limit does not record how many pairs were selected without it, so assume that it excluded some.
        let selected = list.limit.map_or(ids.len(), |_| usize::MAX);
        let choices = list.choices.get(&dataset.name).into_iter();
        for proxy in choices.flat_map(|choices| choices.proxies(&dataset.format, selected)) {
            if !proxies.contains(&proxy) {
                proxies.push(proxy);
            }
        }
    }
    proxies
}

impl ReportMethod {
    fn of(record: &MethodRecord, records: &[Record]) -> Self {
        let identity = &record.identity;
        let of_method = records.iter().filter(|r| r.method == record.label);
        let known = record.privilege.phrases();
        let known: String = known.map(|phrase| format!(", {phrase}")).collect();
        let bundled = bundled_network(identity);
        let summary = KINDS.iter().find(|known| known.name == identity.kind);
        let summary = summary.map_or("", |known| known.summary);
        let said = identity.settings.get(Sharp::NOTE);
        let said = said.filter(|_| identity.kind == "sharp");
        let network = bundled.as_ref().or(said).into_iter();
        let drawn = rule_notes(of_method.clone());
        let notes = network.chain(&record.notes).chain(&drawn);
        let notes = notes.cloned().collect();
        let doubts = doubts_of(of_method, &identity.kind);
        let joined = |texts: Vec<String>| Some(texts.join("; ")).filter(|text| !text.is_empty());
        // The value is, for example, "bicubic [a = -0.75, …]"; footnotes need only the name.
        let kernel = identity.settings.get("resize");
        let kernel = kernel.and_then(|text| text.split(' ').next());
        Self {
            label: record.label.clone(),
            description: format!(
                "{} ({identity}{known})",
                bundled.as_deref().unwrap_or(summary)
            ),
            is_baseline: matches!(identity.kind.as_str(), "copy" | "mean"),
            is_plotted: !matches!(identity.kind.as_str(), "target" | "mean"),
            unranked: (identity.kind == "target")
                .then(|| "it is the ground truth itself".to_owned()),
            resize_kernel: kernel.map(str::to_owned),
            doubt: joined(doubts),
            note: joined(notes),
        }
    }
}

/// Description of the bundled network, if a method runs it.
pub(super) fn bundled_network(identity: &MethodIdentity) -> Option<String> {
    let checkpoint = identity.settings.get("checkpoint")?;
    let is_bundled = identity.kind == "sharp" && checkpoint == bundled::weights_sha256();
    is_bundled.then(|| bundled::description().ok())?
}
