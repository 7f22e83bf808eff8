//! `report RUN…`: tables, plots and a browsable page from runs.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use anyhow::{Context, bail};
use clap::Args;
use image::RgbImage;
use serde_json::json;
use sharp_datasets::{DatasetSpec, Scene, View};
use sharp_metrics::MetricKey;

use super::evaluate::Finished;
use super::usage::UsageError;
use super::{Outcome, data_args, output};
use crate::counted::counted;
use crate::methods::{KINDS, MethodSpec};
use crate::pictures::read_rgb8;
use crate::protocol::PairOptions;
use crate::protocol::options::paper::PROXY;
use crate::record::Record;
use crate::report::scores::merged;
use crate::report::{
    Dataset, FactGroup, Method, Metric, NoPictures, Options, Pictures, Published, ReportFiles,
    ReportInput, text_tables, write_report,
};
use crate::runs::device_class::check_one_class;
use crate::runs::execute::Executed;
use crate::runs::identity::identity_difference;
use crate::runs::manifest::{DatasetFacts, Manifest, MethodFacts};
use crate::runs::store::RunFolder;

/// Write tables, plots and a browsable page from runs
///
/// Several runs become one report when their method labels differ: the rows stand side by side.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  sharp-bench report runs/first
  sharp-bench report runs/sharp runs/baselines --out comparison

Writes report.md, index.html (one file that opens from disk), tables as .md, .csv and .tex, plots as .svg and .png.
Source and target pictures come from the datasets named in the run, where they are still in place.")]
pub(super) struct ReportArgs {
    /// Run folders
    #[arg(required = true, value_name = "RUN")]
    runs: Vec<PathBuf>,
    /// Where to write; RUN/report for a single run
    #[arg(long, value_name = "DIR")]
    out: Option<PathBuf>,
    /// Which of the paper's numbers stand beside ours
    #[arg(long, value_enum, default_value_t = PublishedChoice::Matching)]
    published: PublishedChoice,
    /// Print JSON: the files written
    #[arg(long)]
    json: bool,
}

#[derive(Debug, Clone, Copy, clap::ValueEnum)]
enum PublishedChoice {
    /// None
    Never,
    /// Those of the datasets that the runs have
    Matching,
    /// All
    Always,
}

/// A run with everything that a report shows of it.
pub(super) struct LoadedRun {
    folder: RunFolder,
    manifest: Manifest,
    records: Vec<Record>,
    scenes: Vec<Scene>,
}

impl LoadedRun {
    /// Reads a run folder; datasets that are gone cost the pictures, nothing else.
    fn open(root: &Path) -> anyhow::Result<Self> {
        let folder = RunFolder::open(root)?;
        let manifest = Manifest::read(&folder)?;
        let records = folder.read_records()?;
        let mut scenes = Vec::new();
        for dataset in &manifest.datasets {
            match data_args::open(std::slice::from_ref(&dataset.spec), None) {
                Ok(open) => scenes.extend(open.into_iter().flat_map(|d| d.scenes)),
                Err(error) => output::remark(format!(
                    "note: no source and target pictures of '{}': {error:#}",
                    dataset.name
                )),
            }
        }
        Ok(Self {
            folder,
            manifest,
            records,
            scenes,
        })
    }
}

impl From<Finished> for LoadedRun {
    fn from(finished: Finished) -> Self {
        Self {
            records: finished.executed.records(),
            folder: finished.folder,
            manifest: finished.manifest,
            scenes: finished.scenes,
        }
    }
}

pub(super) fn execute(args: &ReportArgs) -> anyhow::Result<Outcome> {
    let runs: Vec<LoadedRun> = args
        .runs
        .iter()
        .map(|root| LoadedRun::open(root))
        .collect::<Result<_, _>>()?;
    check_identities(&runs)?;
    let out = match (&args.out, runs.as_slice()) {
        (Some(out), _) => out.clone(),
        (None, [run]) => run.folder.root().join("report"),
        (None, _) => {
            let reason = "--out DIR is needed for a report on several runs";
            return Err(UsageError(reason.to_owned()).into());
        }
    };
    let published = match args.published {
        PublishedChoice::Never => Published::Never,
        PublishedChoice::Matching => Published::Matching,
        PublishedChoice::Always => Published::Always,
    };
    let files = write(&runs, &out, published, Options::default())?;
    if args.json {
        let files: Vec<String> = files.all.iter().map(|f| f.display().to_string()).collect();
        output::json(&json!({ "out": out.display().to_string(), "files": files }))?;
    } else {
        output::line(format!("report  {}", files.html.display()))?;
    }
    Ok(Outcome::Done)
}

/// Writes the report of one or several runs.
pub(super) fn write(
    runs: &[LoadedRun],
    out: &Path,
    published: Published,
    options: Options,
) -> anyhow::Result<ReportFiles> {
    let records = merged(runs.iter().map(|run| run.records.clone()).collect())?;
    let pictures = RunPictures { runs };
    let mut input = input(runs, &records, &pictures, published)?;
    input.options = options;
    write_report(&input, out).with_context(|| out.display().to_string())
}

/// Prints the tables of runs.
pub(super) fn print_tables(runs: &[LoadedRun]) -> anyhow::Result<()> {
    let records = merged(runs.iter().map(|run| run.records.clone()).collect())?;
    let input = input(runs, &records, &NoPictures, Published::Never)?;
    output::line(text_tables(&input)?)
}

/// Exit code 4 where units are recorded failures.
pub(super) fn outcome(executed: &Executed) -> Outcome {
    match executed.failures() {
        0 => Outcome::Done,
        failures => {
            output::remark(format!(
                "warning: {failures} of {} units failed; their reasons are in scores.csv and in the report",
                executed.units.len()
            ));
            Outcome::RecordedFailures
        }
    }
}

fn input<'a>(
    runs: &[LoadedRun],
    records: &'a [Record],
    pictures: &'a dyn Pictures,
    published: Published,
) -> anyhow::Result<ReportInput<'a>> {
    let manifests: Vec<&Manifest> = runs.iter().map(|run| &run.manifest).collect();
    check_one_class(&manifests)?;
    let methods = manifests
        .iter()
        .flat_map(|manifest| &manifest.methods)
        .map(|method| Method {
            label: method.label.clone(),
            description: description(method),
            unranked: (method.identity == "target")
                .then(|| "it is the ground truth itself".to_owned()),
            resize_kernel: method
                .spec
                .parse()
                .ok()
                .and_then(|spec: MethodSpec| spec.options.get("resize").cloned()),
        })
        .collect();
    let mut datasets: Vec<Dataset> = Vec::new();
    let of_runs = manifests.iter().flat_map(|manifest| {
        let datasets = manifest.datasets.iter();
        datasets.map(move |facts| (*manifest, facts))
    });
    for (manifest, facts) in of_runs {
        if datasets.iter().all(|d| d.name != facts.name) {
            datasets.push(Dataset {
                description: format!(
                    "{} ({}{}, {})",
                    facts.spec,
                    counted(facts.scenes, "scene"),
                    facts
                        .only_scenes
                        .as_ref()
                        .map_or_else(String::new, |glob| format!(" matching {glob}")),
                    counted(facts.views, "view")
                ),
                // A name is anyone's choice; the format says whose pictures they are.
                published_as: DatasetSpec::parse(&facts.spec)
                    .ok()
                    .map(|spec| spec.entry.format.to_owned()),
                proxies: proxies(manifest, facts, selected(manifest, facts, records)),
                common_region: manifest.scoring.contains_key("region"),
                ..Dataset::named(&facts.name)
            });
        }
    }
    Ok(ReportInput {
        title: "View synthesis from a single photograph".to_owned(),
        summary: format!(
            "{}, {}, evaluated by sharp-bench {}.",
            counted(
                manifests
                    .iter()
                    .map(|m| m.pairs.evaluated)
                    .max()
                    .unwrap_or(0),
                "pair"
            ),
            counted(manifests.iter().map(|m| m.methods.len()).sum(), "method"),
            manifests.first().map_or("", |m| &m.version)
        ),
        records,
        metrics: metrics(&manifests)?,
        extras: extras(),
        datasets,
        methods,
        facts: runs.iter().flat_map(facts).collect(),
        published,
        pictures,
        options: Options::default(),
    })
}

/// How many pairs of a dataset were selected, as the records tell: no number where the run left some out.
fn selected(manifest: &Manifest, facts: &DatasetFacts, records: &[Record]) -> usize {
    if manifest.pairs.limit.is_some() {
        return usize::MAX;
    }
    let of_dataset = records.iter().filter(|record| record.dataset == facts.name);
    let ids: BTreeSet<&str> = of_dataset.map(|record| record.pair_id.as_str()).collect();
    ids.len()
}

/// The readings of a dataset and the choices behind its pairs that are known to differ from the paper's.
fn proxies(manifest: &Manifest, facts: &DatasetFacts, selected: usize) -> Vec<String> {
    let Ok(spec) = DatasetSpec::parse(&facts.spec) else {
        return Vec::new();
    };
    let readings = spec.readings().into_iter();
    let readings = readings
        .filter(|reading| reading.proxy)
        .map(|reading| reading.to_string());
    let pairs = PairOptions::of_facts(&manifest.pairs.options);
    let kind = spec.entry.paper_overlap;
    let pairs = pairs.map_or_else(Vec::new, |options| options.proxies_on(kind, selected));
    readings.chain(pairs).collect()
}

fn description(method: &MethodFacts) -> String {
    let kind = method.spec.split(':').next().unwrap_or_default();
    let summary = KINDS
        .iter()
        .find(|known| known.name == kind)
        .map_or("", |known| known.summary);
    format!("{summary} ({})", method.identity)
}

/// Refuses to put numbers of different identity into one column.
fn check_identities(runs: &[LoadedRun]) -> anyhow::Result<()> {
    let Some((first, others)) = runs.split_first() else {
        return Ok(());
    };
    let name = |run: &LoadedRun| run.folder.root().display().to_string();
    for other in others {
        if let Some(difference) = identity_difference(&first.manifest, &other.manifest) {
            bail!(
                "{} and {} cannot stand in one report: {difference}",
                name(first),
                name(other)
            );
        }
        if first.manifest.source_fingerprint != other.manifest.source_fingerprint {
            output::remark(format!(
                "warning: {} and {} were evaluated by different builds",
                name(first),
                name(other)
            ));
        }
    }
    Ok(())
}

fn metrics(manifests: &[&Manifest]) -> anyhow::Result<Vec<Metric>> {
    let mut metrics: Vec<Metric> = Vec::new();
    for facts in manifests.iter().flat_map(|manifest| &manifest.metrics) {
        let key: MetricKey = facts.key.parse()?;
        if metrics.iter().any(|metric| metric.key == facts.key) {
            continue;
        }
        metrics.push(Metric {
            convention: facts.in_words(),
            ..Metric::from(key)
        });
    }
    Ok(metrics)
}

/// What methods report about their predictions.
fn extras() -> Vec<Metric> {
    let extra = |key, label, convention| Metric::reported(key, label, "", 3, convention);
    vec![
        extra(
            "mean_alpha",
            "Mean alpha",
            "mean coverage of the rendering, 0..1",
        ),
        extra(
            "hole_share",
            "Hole share",
            "share of pixels whose alpha is below 0.5",
        ),
        extra(
            "median_scale",
            "Depth scale",
            "the factor that median alignment put on the predicted depth",
        ),
        Metric {
            decimals: 0,
            ..extra(
                "dropped_blocks",
                "Dropped blocks",
                "blocks of pixels without a valid depth, for which no Gaussian was made",
            )
        },
        extra(
            "scored_share",
            "Scored share",
            "share of the target's pixels that a cropped prediction is scored on",
        ),
        extra(
            "best_scale",
            "Best scale",
            "the scale of the scene whose picture had the least DISTS, of those that the method rendered",
        ),
    ]
}

fn facts(run: &LoadedRun) -> Vec<FactGroup> {
    let manifest = &run.manifest;
    let text = |name: &str, value: &str| (name.to_owned(), value.to_owned());
    let group = |title: &str, facts: Vec<(String, String)>| FactGroup {
        title: title.to_owned(),
        facts,
    };
    let mut pair_facts = vec![
        text("sha256", &manifest.pairs.sha256),
        text("origin", &manifest.pairs.origin),
        text("listed", &manifest.pairs.listed.to_string()),
        text("evaluated", &manifest.pairs.evaluated.to_string()),
    ];
    if let Some(limit) = manifest.pairs.limit {
        pair_facts.push(text(
            "limit",
            &format!("{limit} (not all that are selected)"),
        ));
    }
    let proxies = PairOptions::of_facts(&manifest.pairs.options)
        .map_or_else(Vec::new, |options| options.proxies());
    pair_facts.extend(manifest.pairs.options.iter().map(|(key, value)| {
        if proxies.contains(&format!("{key}={value}")) {
            text(key, &format!("{value} ({PROXY})"))
        } else {
            text(key, value)
        }
    }));
    let notes: Vec<_> = manifest
        .datasets
        .iter()
        .flat_map(|d| d.notes.iter().map(|note| (d.name.clone(), note.clone())))
        .collect();
    let mut groups = vec![
        group("Scoring", manifest.scoring.clone().into_iter().collect()),
        group("Pair list", pair_facts),
        group(
            "Build",
            vec![
                text("sharp-bench", &manifest.version),
                text("sources", &manifest.source_fingerprint),
                text("backend", &manifest.backend),
            ],
        ),
    ];
    if !notes.is_empty() {
        groups.insert(0, group("Dataset notes", notes));
    }
    groups
}

/// Pictures of a record: source and target from the datasets, the prediction from the run folder.
struct RunPictures<'a> {
    runs: &'a [LoadedRun],
}

impl RunPictures<'_> {
    fn view(&self, record: &Record, id: &str) -> Result<RgbImage, String> {
        let view = self.find(record, id)?;
        view.content.image().map_err(|error| error.to_string())
    }

    fn find(&self, record: &Record, id: &str) -> Result<&View, String> {
        let scene = self
            .runs
            .iter()
            .flat_map(|run| &run.scenes)
            .find(|scene| scene.dataset == record.dataset && scene.id == record.scene);
        scene
            .and_then(|scene| scene.views.iter().find(|view| view.id == id))
            .ok_or_else(|| "the dataset is not at hand".to_owned())
    }

    /// A cropped prediction where it belongs in its target, black around it: for the eye only, scores know nothing of it.
    fn padded(&self, record: &Record, picture: RgbImage) -> RgbImage {
        let at = |key: &str| record.extras.get(key).map(|v| *v as i64);
        let (Some(x), Some(y)) = (at("crop_x"), at("crop_y")) else {
            return picture;
        };
        let Ok(target) = self.find(record, &record.target) else {
            return picture;
        };
        let mut whole = RgbImage::new(target.intrinsics.width, target.intrinsics.height);
        image::imageops::replace(&mut whole, &picture, x, y);
        whole
    }
}

impl Pictures for RunPictures<'_> {
    fn source(&self, record: &Record) -> Result<RgbImage, String> {
        self.view(record, &record.source)
    }

    fn target(&self, record: &Record) -> Result<RgbImage, String> {
        self.view(record, &record.target)
    }

    fn prediction(&self, record: &Record) -> Result<RgbImage, String> {
        let path = self
            .runs
            .iter()
            .map(|run| run.folder.prediction_path(&record.method, &record.pair_id))
            .find(|path| path.is_file())
            .ok_or("the prediction was not kept")?;
        let picture = read_rgb8(&path).map_err(|error| error.to_string())?;
        Ok(self.padded(record, picture))
    }
}
