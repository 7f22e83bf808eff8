//! Builds a report's input from results.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};
use std::sync::Mutex;

use image::{GrayImage, RgbImage};
use sharp::model::bundled;
use sharp_datasets::format::read_map;
use sharp_datasets::{DepthMap, Scene, View};

use super::input::{
    Column, FactGroup, PublishedNumbers, ReportComparison, ReportDataset, ReportInput,
    ReportMethod, ReportOptions,
};
use super::pictures::{NoPictures, ReportPictures};
use super::tables::html::html;
use super::{MissingPicture, ReportError, ReportFiles, mean_tables, text_tables, write_report};
use crate::evaluate::Results;
use crate::evaluate::doubts::doubts_of;
use crate::evaluate::manifest::{
    DatasetRecord, ListRecord, Manifest, MethodRecord, ProtocolRecord,
};
use crate::evaluate::record::Record;
use crate::evaluate::results::KeptPicture;
use crate::io::counts::counted;
use crate::io::hash::sha256_hex;
use crate::io::observer::Observer;
use crate::io::pictures::{Alpha, read_linear, read_rgb8};
use crate::io::view_hashes::lock;
use crate::methods::sharp::Sharp;
use crate::methods::{KINDS, MethodIdentity, Privilege};
use crate::pairs::PairProvenance;
use crate::pairs::options::paper::PROXY;

/// Writes the report of some results. `scenes` give the source and target pictures. A kept picture that is not the one
/// that was scored is not shown, and [named](ReportFiles::not_scored).
///
/// # Errors
/// When a file cannot be written or the results contradict each other.
pub fn report(
    results: &Results,
    scenes: &[Scene],
    out: &Path,
    published: PublishedNumbers,
    options: ReportOptions,
) -> Result<ReportFiles, ReportError> {
    let pictures = RunPictures::new(results, scenes);
    let mut input = ReportInput {
        options,
        ..input(results, &pictures, published)
    };
    if input.options.public {
        for (shown, dataset) in input.datasets.iter_mut().zip(&results.manifest.datasets) {
            shown.description = description(dataset, &dataset.format);
        }
    }
    written(&input, &pictures, out)
}

/// Writes the report of two joined runs, one compared with the other.
///
/// # Errors
/// As [`report`].
pub fn comparison(
    results: &Results,
    scenes: &[Scene],
    out: &Path,
    comparison: ReportComparison,
    options: ReportOptions,
) -> Result<ReportFiles, ReportError> {
    let pictures = RunPictures::new(results, scenes);
    let input = ReportInput {
        title: "Two runs compared".to_owned(),
        comparison: Some(comparison),
        options,
        ..input(results, &pictures, PublishedNumbers::Never)
    };
    written(&input, &pictures, out)
}

fn written(
    input: &ReportInput<'_>,
    pictures: &RunPictures<'_>,
    out: &Path,
) -> Result<ReportFiles, ReportError> {
    let mut files = write_report(input, out)?;
    files.not_scored = pictures.not_scored();
    Ok(files)
}

/// The tables of some results, for a terminal.
///
/// # Errors
/// When the results contradict each other.
pub fn tables(results: &Results) -> Result<String, ReportError> {
    text_tables(&input(results, &NoPictures, PublishedNumbers::Never))
}

/// The tables as HTML for a page, each a `figure`.
///
/// # Errors
/// As [`tables`].
pub fn html_tables(results: &Results) -> Result<String, ReportError> {
    let tables = mean_tables(&input(results, &NoPictures, PublishedNumbers::Never))?;
    let figures = tables.iter().enumerate();
    let figures = figures.map(|(at, table)| html(table, &format!("means{at}")));
    Ok(figures.collect::<Result<String, _>>()?)
}

/// The scenes of results, for their pictures. A dataset that is gone costs the pictures, nothing else.
pub fn scenes(manifest: &Manifest, observer: &dyn Observer) -> Vec<Scene> {
    let mut scenes = Vec::new();
    for dataset in &manifest.datasets {
        match dataset.open(None) {
            Ok(open) => scenes.extend(open.scenes),
            Err(error) => observer.warn(&format!(
                "no source and target pictures of '{}': {error}",
                dataset.name
            )),
        }
    }
    scenes
}

/// A report's input for some results.
pub(crate) fn input<'a>(
    results: &'a Results,
    pictures: &'a dyn ReportPictures,
    published: PublishedNumbers,
) -> ReportInput<'a> {
    let Results {
        manifest, records, ..
    } = results;
    let going = match results.missing.len() {
        0 => String::new(),
        missing => format!(
            " The run has not ended: {} of {} are done.",
            records.len(),
            counted(records.len() + missing, "unit")
        ),
    };
    ReportInput {
        title: "View synthesis from a single photograph".to_owned(),
        summary: format!("Evaluated by sharp-bench {}.{going}", manifest.version),
        records,
        metrics: manifest.metrics.iter().map(|m| (&m.info).into()).collect(),
        extras: extras(),
        datasets: manifest
            .datasets
            .iter()
            .map(|dataset| ReportDataset {
                description: description(dataset, &dataset.spec_text()),
                format: Some(dataset.format.clone()),
                proxies: proxies(manifest, dataset, records),
                common_region: manifest.common_region,
                aggregation: manifest.aggregation,
                ..ReportDataset::named(&dataset.name)
            })
            .collect(),
        methods: manifest
            .methods
            .iter()
            .map(|m| method(m, records))
            .collect(),
        facts: facts(manifest),
        published,
        comparison: None,
        pictures,
        options: ReportOptions::default(),
    }
}

/// The dataset in words, with its numbers of scenes and views.
fn description(dataset: &DatasetRecord, what: &str) -> String {
    let only = dataset.only_scenes.as_ref();
    format!(
        "{what} (read: {}{}, {})",
        counted(dataset.scenes, "scene"),
        only.map_or_else(String::new, |glob| format!(" matching {glob}")),
        counted(dataset.views, "view")
    )
}

fn method(record: &MethodRecord, records: &[Record]) -> ReportMethod {
    let identity = &record.identity;
    let of_method = records.iter().filter(|r| r.method == record.label);
    let summary = KINDS.iter().find(|known| known.name == identity.kind);
    let privilege = match record.privilege {
        Privilege::DepthScale => ", its scale aligned to the source's true depth",
        _ => "",
    };
    let kernel = identity.settings.get("resize");
    let said = identity
        .settings
        .get(Sharp::NOTE)
        .filter(|_| identity.kind == "sharp");
    let note = bundled_network(identity).or_else(|| said.cloned());
    ReportMethod {
        label: record.label.clone(),
        description: format!(
            "{} ({identity}{privilege})",
            match (bundled_network(identity), summary) {
                (Some(note), _) => note,
                (None, summary) => summary.map_or("", |known| known.summary).to_owned(),
            }
        ),
        is_baseline: matches!(identity.kind.as_str(), "copy" | "mean"),
        unranked: (identity.kind == "target").then(|| "it is the ground truth itself".to_owned()),
        // "bicubic [a = -0.75, …]": the name is enough for a footnote.
        resize_kernel: kernel
            .and_then(|text| text.split(' ').next())
            .map(str::to_owned),
        doubt: Some(doubts_of(of_method, &identity.kind, record.privilege).join("; "))
            .filter(|text| !text.is_empty()),
        note: match (note, record.notes.join("; ")) {
            (None, notes) => (!notes.is_empty()).then_some(notes),
            (Some(note), notes) if notes.is_empty() => Some(note),
            (Some(note), notes) => Some(format!("{note}; {notes}")),
        },
    }
}

/// Description of the bundled network, if a method runs it.
pub(super) fn bundled_network(identity: &MethodIdentity) -> Option<String> {
    let checkpoint = identity.settings.get("checkpoint")?;
    let is_bundled = identity.kind == "sharp" && checkpoint == bundled::weights_sha256();
    is_bundled.then(|| bundled::description().ok())?
}

/// The readings of a dataset and the choices behind its pairs that are known to differ from the paper's, once each.
pub(super) fn proxies(
    manifest: &Manifest,
    dataset: &DatasetRecord,
    records: &[Record],
) -> Vec<String> {
    let readings = dataset.readings.iter().filter(|reading| reading.proxy);
    let mut proxies: Vec<String> = readings
        .map(|reading| format!("{}={}", reading.key, reading.value))
        .collect();
    let of_dataset = records
        .iter()
        .filter(|record| record.dataset == dataset.name);
    let ids: BTreeSet<&str> = of_dataset.map(|record| record.pair_id.as_str()).collect();
    for list in &manifest.pairs.lists {
        // How many pairs were selected, as the records tell: no number where the run left some out.
        let selected = list.limit.map_or(ids.len(), |_| usize::MAX);
        if let Some(choices) = list.choices.get(&dataset.name) {
            for proxy in choices.proxies(&dataset.format, selected) {
                if !proxies.contains(&proxy) {
                    proxies.push(proxy);
                }
            }
        }
    }
    proxies
}

/// Columns of the values that methods report about their predictions.
fn extras() -> Vec<Column> {
    let extras = [
        (
            "mean_alpha",
            "Mean alpha",
            3,
            "mean coverage of the rendering, 0..1",
        ),
        (
            "hole_share",
            "Hole share",
            3,
            "share of pixels whose alpha is below 0.5",
        ),
        (
            "source_psnr",
            "Source PSNR",
            2,
            "PSNR of the source's photograph and the Gaussians rendered from its own camera, dB",
        ),
        (
            "median_scale",
            "Depth scale",
            3,
            "the factor that median alignment put on the predicted depth",
        ),
        (
            "dropped_blocks",
            "Dropped blocks",
            0,
            "blocks of pixels without a valid depth, for which no Gaussian was made",
        ),
        (
            "scored_share",
            "Scored share",
            3,
            "share of the target's pixels that a cropped prediction is scored on",
        ),
        (
            "best_scale",
            "Best scale",
            3,
            "the scale of the scene whose picture had the least DISTS, of those that the method rendered",
        ),
    ];
    let extras = extras.into_iter();
    extras
        .map(|(key, label, decimals, convention)| {
            Column::reported(key, label, decimals, convention)
        })
        .collect()
}

fn facts(manifest: &Manifest) -> Vec<FactGroup> {
    let group = |title: &str, facts: Vec<(String, String)>| FactGroup {
        title: title.to_owned(),
        facts,
    };
    let mut groups = Vec::new();
    let mut notes = Vec::new();
    for dataset in &manifest.datasets {
        let readings = dataset.readings.iter();
        let readings = readings.map(|r| {
            let open = if r.open && !r.proxy {
                " (open in the paper)"
            } else {
                ""
            };
            format!("{}={}{}{open}", r.key, r.value, mark(r.proxy))
        });
        let left_out = dataset.left_out.iter().map(ToString::to_string);
        let notes_and_scenes = dataset.notes.iter().cloned().chain(left_out);
        let all = readings.chain(notes_and_scenes);
        notes.extend(all.map(|note| (dataset.name.clone(), note)));
    }
    if !notes.is_empty() {
        groups.push(group("Dataset notes", notes));
    }
    let mut scoring: Vec<(String, String)> = manifest.scoring.clone().into_iter().collect();
    scoring.extend([
        fact("kernels", format!("cpu-{}", manifest.kernels)),
        fact("metric networks", manifest.metric_networks),
        fact("renderer", &manifest.renderer),
    ]);
    if manifest.common_region {
        let rule = "on the part of a target that all methods predict (--common-region)";
        scoring.push(fact("region", rule));
    }
    scoring.sort();
    groups.push(group("Scoring", scoring));
    if let Some(protocol) = &manifest.protocol {
        groups.push(group("Protocol", protocol_facts(protocol)));
    }
    for list in &manifest.pairs.lists {
        groups.push(group("Pair list", list_facts(list)));
    }
    let sources: String = manifest.sources.values().map(String::as_str).collect();
    let sources = sha256_hex(sources.as_bytes());
    let build = vec![
        fact("sharp-bench", &manifest.version),
        fact("sources", format!("{sources} (by stage in manifest.json)")),
    ];
    groups.push(group("Build", build));
    groups
}

fn protocol_facts(protocol: &ProtocolRecord) -> Vec<(String, String)> {
    let mut facts = vec![
        fact("name", &protocol.name),
        fact("source", &protocol.source),
    ];
    facts.push(fact("failures", &protocol.failures));
    facts.extend(
        protocol
            .traps
            .iter()
            .map(|trap| fact("kept as it is", trap)),
    );
    let departures = protocol.departures.iter();
    facts.extend(departures.map(|departure| fact("not as theirs", departure)));
    facts
}

fn choice_facts(choices: &PairProvenance) -> Vec<(String, String)> {
    let proxies = choices.options.proxies();
    let mut facts = vec![("overlap depth".to_owned(), choices.overlap_depth.clone())];
    if let Some(maps) = &choices.overlap_depth_maps {
        let value = format!("{} maps, sha256 {}", maps.count, maps.sha256);
        facts.push(("overlap depth maps".to_owned(), value));
    }
    facts.extend(choices.options.entries().into_iter().map(|(key, value)| {
        let mark = mark(proxies.contains(&format!("{key}={value}")));
        (key.to_owned(), format!("{value}{mark}"))
    }));
    facts
}

fn list_facts(list: &ListRecord) -> Vec<(String, String)> {
    let mut facts = vec![
        fact("sha256", &list.sha256),
        fact("listed", list.listed),
        fact("evaluated", list.evaluated),
    ];
    if let Some(limit) = list.limit {
        let text = format!("{limit} (not all that are selected)");
        facts.push(fact("limit", text));
    }
    // What holds for all datasets is said once.
    let mut rows: BTreeMap<(String, String), Vec<&str>> = BTreeMap::new();
    for (dataset, choices) in &list.choices {
        for (key, value) in choice_facts(choices) {
            rows.entry((key, value)).or_default().push(dataset);
        }
    }
    facts.extend(rows.into_iter().map(|((key, value), datasets)| {
        if datasets.len() == list.choices.len() {
            (key, value)
        } else {
            (format!("{}: {key}", datasets.join(", ")), value)
        }
    }));
    facts
}

fn fact(name: impl Into<String>, value: impl ToString) -> (String, String) {
    (name.into(), value.to_string())
}

fn mark(proxy: bool) -> String {
    match proxy {
        true => format!(" ({PROXY})"),
        false => String::new(),
    }
}

/// Pictures of a record: source and target from the datasets, the prediction from the run folder.
pub(crate) struct RunPictures<'a> {
    results: &'a Results,
    /// By dataset and id.
    scenes: BTreeMap<(&'a str, &'a str), &'a Scene>,
    /// By pair and method: each is hashed once.
    kept: Mutex<BTreeMap<(String, String), Option<KeptPicture>>>,
    not_scored: Mutex<BTreeSet<PathBuf>>,
}

impl<'a> RunPictures<'a> {
    pub(crate) fn new(results: &'a Results, scenes: &'a [Scene]) -> Self {
        Self {
            results,
            scenes: scenes
                .iter()
                .map(|scene| ((scene.dataset.as_str(), scene.id.as_str()), scene))
                .collect(),
            kept: Mutex::default(),
            not_scored: Mutex::default(),
        }
    }

    /// Kept pictures that were asked for and are not those that were scored, sorted.
    pub(crate) fn not_scored(&self) -> Vec<PathBuf> {
        lock(&self.not_scored).iter().cloned().collect()
    }

    pub(crate) fn kept_file(&self, record: &Record) -> Result<PathBuf, MissingPicture> {
        let unit = (record.pair_id.clone(), record.method.clone());
        let known = lock(&self.kept).get(&unit).cloned();
        let kept = known.unwrap_or_else(|| {
            let kept = self.results.kept_picture(record);
            lock(&self.kept).insert(unit, kept.clone());
            kept
        });
        let KeptPicture { path, is_scored } = kept.ok_or(MissingPicture::NotKept)?;
        if is_scored {
            return Ok(path);
        }
        lock(&self.not_scored).insert(path);
        Err(MissingPicture::NotScored)
    }

    fn picture(&self, record: &Record, id: &str) -> Result<RgbImage, MissingPicture> {
        let image = self.view(record, id)?.content.image();
        image.map_err(|error| MissingPicture::Unusable(error.to_string()))
    }

    fn depth(&self, record: &Record, id: &str) -> Result<Option<DepthMap>, MissingPicture> {
        let Ok(view) = self.view(record, id) else {
            return Ok(None);
        };
        let depth = view.content.depth();
        depth.map_err(|error| MissingPicture::Unusable(error.to_string()))
    }

    /// The rendering behind a prediction, where it was kept as floats.
    fn rendering(&self, record: &Record) -> Result<Option<PathBuf>, MissingPicture> {
        match self.results.kept_rendering(record) {
            Some(kept) if !kept.is_scored => Err(MissingPicture::NotScored),
            kept => Ok(kept.map(|kept| kept.path)),
        }
    }

    pub(crate) fn view(&self, record: &Record, id: &str) -> Result<&'a View, MissingPicture> {
        let of = (record.dataset.as_str(), record.scene.as_str());
        let scene = self.scenes.get(&of);
        let view = scene.and_then(|scene| scene.views.iter().find(|view| view.id == id));
        view.ok_or(MissingPicture::NoDataset)
    }
}

impl ReportPictures for RunPictures<'_> {
    fn source(&self, record: &Record) -> Result<RgbImage, MissingPicture> {
        self.picture(record, &record.source)
    }

    fn target(&self, record: &Record) -> Result<RgbImage, MissingPicture> {
        self.picture(record, &record.target)
    }

    fn valid_pixels(&self, record: &Record) -> Result<Option<GrayImage>, MissingPicture> {
        let valid = self.view(record, &record.target)?.content.valid_pixels();
        valid.map_err(|error| MissingPicture::Unusable(error.to_string()))
    }

    fn target_depth(&self, record: &Record) -> Result<Option<DepthMap>, MissingPicture> {
        self.depth(record, &record.target)
    }

    fn source_depth(&self, record: &Record) -> Result<Option<DepthMap>, MissingPicture> {
        self.depth(record, &record.source)
    }

    fn rendered_depth(&self, record: &Record) -> Result<Option<DepthMap>, MissingPicture> {
        let Some(path) = self.rendering(record)? else {
            return Ok(None);
        };
        let unusable = |error: &dyn std::fmt::Display| MissingPicture::Unusable(error.to_string());
        let linear = read_linear(&path).map_err(|error| unusable(&error))?;
        let mut depth = read_map(&path).map_err(|error| unusable(&error))?;
        // The channel is accumulated: Σ w z.
        for (z, alpha) in depth.iter_mut().zip(linear.alpha.iter()) {
            *z = if *alpha > 0.0 { *z / alpha } else { 0.0 };
        }
        Ok(Some(depth))
    }

    fn alpha(&self, record: &Record) -> Result<Option<Alpha>, MissingPicture> {
        let Some(path) = self.rendering(record)? else {
            return Ok(None);
        };
        let linear = read_linear(&path);
        let linear = linear.map_err(|error| MissingPicture::Unusable(error.to_string()))?;
        Ok(Some(linear.alpha))
    }

    fn kept(&self, record: &Record) -> Option<PathBuf> {
        self.kept_file(record).ok()
    }

    fn photographs(&self, record: &Record) -> [Option<PathBuf>; 2] {
        [&record.source, &record.target].map(|id| {
            let content = &self.view(record, id).ok()?.content;
            let processing = content.processing();
            let is_stored = processing.undistorted.is_none() && !processing.masked;
            content
                .image_file()
                .filter(|_| is_stored)
                .map(Path::to_owned)
        })
    }

    /// A cropped prediction where it belongs in its target, black around it: for the eye only.
    fn prediction(&self, record: &Record) -> Result<RgbImage, MissingPicture> {
        let picture = read_rgb8(&self.kept_file(record)?)
            .map_err(|error| MissingPicture::Unusable(error.to_string()))?;
        let (Some(crop), Ok(target)) = (record.crop, self.view(record, &record.target)) else {
            return Ok(picture);
        };
        let mut whole = RgbImage::new(target.intrinsics.width, target.intrinsics.height);
        let (x, y) = (i64::from(crop.region.x), i64::from(crop.region.y));
        image::imageops::replace(&mut whole, &picture, x, y);
        Ok(whole)
    }
}
