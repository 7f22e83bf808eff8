//! From results to what a report is made of.

use std::collections::BTreeSet;
use std::path::Path;

use image::RgbImage;
use sharp_datasets::{Scene, View};

use super::input::{
    Dataset, FactGroup, Method, Metric, NoPictures, Options, Pictures, Published, ReportInput,
};
use super::{ReportError, ReportFiles, text_tables, write_report};
use crate::evaluate::Results;
use crate::evaluate::manifest::{DatasetRecord, ListRecord, Manifest, MethodRecord};
use crate::evaluate::record::Record;
use crate::io::counts::counted;
use crate::io::observer::Observer;
use crate::io::pictures::read_rgb8;
use crate::methods::{KINDS, Privilege};
use crate::pairs::OpenDataset;
use crate::pairs::options::paper::PROXY;

/// Writes the report of some results. `scenes` give the source and target pictures.
///
/// # Errors
/// When a file cannot be written or the results contradict each other.
pub fn report(
    results: &Results,
    scenes: &[Scene],
    out: &Path,
    published: Published,
    options: Options,
) -> Result<ReportFiles, ReportError> {
    let pictures = RunPictures { results, scenes };
    let mut input = input(results, &pictures, published);
    input.options = options;
    write_report(&input, out)
}

/// The tables of some results, for a terminal.
///
/// # Errors
/// When the results contradict each other.
pub fn tables(results: &Results) -> Result<String, ReportError> {
    text_tables(&input(results, &NoPictures, Published::Never))
}

/// The scenes of results, for their pictures. A dataset that is gone costs the pictures, nothing else.
pub fn scenes(manifest: &Manifest, observer: &dyn Observer) -> Vec<Scene> {
    let mut scenes = Vec::new();
    for dataset in &manifest.datasets {
        match OpenDataset::open_all(std::slice::from_ref(&dataset.spec), None) {
            Ok(open) => scenes.extend(open.into_iter().flat_map(|d| d.scenes)),
            Err(error) => observer.warn(&format!(
                "no source and target pictures of '{}': {error}",
                dataset.name
            )),
        }
    }
    scenes
}

fn input<'a>(
    results: &'a Results,
    pictures: &'a dyn Pictures,
    published: Published,
) -> ReportInput<'a> {
    let Results {
        manifest, records, ..
    } = results;
    let going = match results.missing {
        0 => String::new(),
        missing => format!(
            " The run has not ended: {} of {} are done.",
            records.len(),
            counted(records.len() + missing, "unit")
        ),
    };
    ReportInput {
        title: "View synthesis from a single photograph".to_owned(),
        summary: format!(
            "{}, {}, evaluated by sharp-bench {}.{going}",
            counted(manifest.pairs.evaluated, "pair"),
            counted(manifest.methods.len(), "method"),
            manifest.version
        ),
        records,
        metrics: metrics(manifest),
        extras: extras(),
        datasets: manifest
            .datasets
            .iter()
            .map(|dataset| Dataset {
                description: format!(
                    "{} ({}{}, {})",
                    dataset.spec,
                    counted(dataset.scenes, "scene"),
                    dataset
                        .only_scenes
                        .as_ref()
                        .map_or_else(String::new, |glob| format!(" matching {glob}")),
                    counted(dataset.views, "view")
                ),
                // A name is anyone's choice; the format says whose pictures they are.
                published_as: Some(dataset.format.clone()),
                proxies: proxies(manifest, dataset, records),
                common_region: manifest.common_region,
                ..Dataset::named(&dataset.name)
            })
            .collect(),
        methods: manifest.methods.iter().map(method).collect(),
        facts: facts(manifest),
        published,
        pictures,
        options: Options::default(),
    }
}

fn method(record: &MethodRecord) -> Method {
    let identity = &record.identity;
    let summary = KINDS.iter().find(|known| known.name == identity.kind);
    let privilege = match record.privilege {
        Privilege::DepthScale => ", its scale aligned to the source's true depth",
        _ => "",
    };
    let kernel = identity.settings.get("resize");
    Method {
        label: record.label.clone(),
        description: format!(
            "{} ({identity}{privilege})",
            summary.map_or("", |known| known.summary)
        ),
        unranked: (identity.kind == "target").then(|| "it is the ground truth itself".to_owned()),
        // "bicubic [a = -0.75, …]": the name is enough for a footnote.
        resize_kernel: kernel
            .and_then(|text| text.split(' ').next())
            .map(str::to_owned),
    }
}

/// The readings of a dataset and the choices behind its pairs that are known to differ from the paper's, once each.
fn proxies(manifest: &Manifest, dataset: &DatasetRecord, records: &[Record]) -> Vec<String> {
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

fn metrics(manifest: &Manifest) -> Vec<Metric> {
    let metrics = manifest.metrics.iter().map(|metric| (&metric.info).into());
    metrics.collect()
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

fn facts(manifest: &Manifest) -> Vec<FactGroup> {
    let text = |name: &str, value: &str| (name.to_owned(), value.to_owned());
    let group = |title: &str, facts: Vec<(String, String)>| FactGroup {
        title: title.to_owned(),
        facts,
    };
    let mut groups = Vec::new();
    let readings = manifest.datasets.iter().flat_map(|dataset| {
        let readings = dataset.readings.iter().map(|reading| {
            let mark = if reading.proxy {
                format!(" ({PROXY})")
            } else {
                String::new()
            };
            format!("{}={}{mark}", reading.key, reading.value)
        });
        let notes = readings.chain(dataset.notes.iter().cloned());
        notes
            .map(|note| (dataset.name.clone(), note))
            .collect::<Vec<_>>()
    });
    let notes: Vec<(String, String)> = readings.collect();
    if !notes.is_empty() {
        groups.push(group("Dataset notes", notes));
    }
    let renderer = &manifest.renderer;
    let mut scoring: Vec<(String, String)> = manifest.scoring.clone().into_iter().collect();
    scoring.extend([
        text("kernels", &format!("cpu-{}", manifest.kernels)),
        text("metric networks", &manifest.metric_networks.to_string()),
        (
            "renderer".to_owned(),
            format!(
                "{}, near {}, far {:e}, eps2d {}, background {}",
                renderer.backend, renderer.near, renderer.far, renderer.eps2d, renderer.background
            ),
        ),
    ]);
    if manifest.common_region {
        let rule = "on the part of a target that all methods predict (--common-region)";
        scoring.push(text("region", rule));
    }
    scoring.sort();
    groups.push(group("Scoring", scoring));
    for list in &manifest.pairs.lists {
        groups.push(group("Pair list", list_facts(list)));
    }
    let mut build = vec![text("sharp-bench", &manifest.version)];
    build.extend(
        manifest
            .sources
            .iter()
            .map(|(stage, hash)| (format!("sources of {stage}"), hash.clone())),
    );
    groups.push(group("Build", build));
    groups
}

fn list_facts(list: &ListRecord) -> Vec<(String, String)> {
    let text = |name: &str, value: &str| (name.to_owned(), value.to_owned());
    let mut facts = vec![
        text("sha256", &list.sha256),
        text("listed", &list.listed.to_string()),
        text("evaluated", &list.evaluated.to_string()),
    ];
    if let Some(limit) = list.limit {
        facts.push(text(
            "limit",
            &format!("{limit} (not all that are selected)"),
        ));
    }
    for (dataset, choices) in &list.choices {
        let proxies = choices.options.proxies();
        facts.push((
            format!("{dataset}: overlap depth"),
            choices.overlap_depth.clone(),
        ));
        if let Some(maps) = &choices.overlap_depth_maps {
            let value = format!("{} maps, sha256 {}", maps.count, maps.sha256);
            facts.push((format!("{dataset}: overlap depth maps"), value));
        }
        facts.extend(choices.options.entries().into_iter().map(|(key, value)| {
            let mark = if proxies.contains(&format!("{key}={value}")) {
                format!(" ({PROXY})")
            } else {
                String::new()
            };
            (format!("{dataset}: {key}"), format!("{value}{mark}"))
        }));
    }
    facts
}

/// Pictures of a record: source and target from the datasets, the prediction from the run folder.
struct RunPictures<'a> {
    results: &'a Results,
    scenes: &'a [Scene],
}

impl RunPictures<'_> {
    fn view(&self, record: &Record, id: &str) -> Result<RgbImage, String> {
        let view = self.find(record, id)?;
        view.content.image().map_err(|error| error.to_string())
    }

    fn find(&self, record: &Record, id: &str) -> Result<&View, String> {
        let scene = self
            .scenes
            .iter()
            .find(|scene| scene.dataset == record.dataset && scene.id == record.scene);
        scene
            .and_then(|scene| scene.views.iter().find(|view| view.id == id))
            .ok_or_else(|| "the dataset is not at hand".to_owned())
    }

    /// A cropped prediction where it belongs in its target, black around it: for the eye only, scores know nothing of it.
    fn padded(&self, record: &Record, picture: RgbImage) -> RgbImage {
        let Some(crop) = record.crop else {
            return picture;
        };
        let Ok(target) = self.find(record, &record.target) else {
            return picture;
        };
        let mut whole = RgbImage::new(target.intrinsics.width, target.intrinsics.height);
        let (x, y) = (i64::from(crop.region.x), i64::from(crop.region.y));
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
        let path = self.results.picture_path(record);
        let path = path.ok_or("the prediction was not kept")?;
        let picture = read_rgb8(&path).map_err(|error| error.to_string())?;
        Ok(self.padded(record, picture))
    }
}
