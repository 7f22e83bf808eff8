//! Whole evaluations of the procedural scene: which stages each change causes to be redone, and what a folder shows.

use std::collections::BTreeSet;
use std::path::Path;
use std::sync::Arc;
use std::sync::Mutex;
use std::sync::atomic::{AtomicU64, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use image::RgbImage;
use sharp::gaussians::Gaussians;
use sharp::random::SplitMix64;
use sharp::render::{CpuRenderer, LoadedScene, RenderError, Renderer};
use sharp_metrics::{Selection, Weights};

use super::record::{Score, Status};
use super::*;
use crate::config::Keep;
use crate::io::hash::sha256_hex;
use crate::io::observer::{Observer, Quiet};
use crate::methods::{
    self, Approach, BuiltMethod, Closure, GaussianPrediction, Method, MethodError, MethodIdentity,
    PicturePrediction, PredictGaussians, Privilege, SourceView, TargetCamera, TrueDepth,
};
use crate::pairs::{OpenDataset, PairList};
use crate::rendering::{RenderSettings, SharedRenderer};
use crate::scoring::Scoring;

const DATASET: &str = "S:synthetic=size=48x36,views=20";

type Methods = Vec<BuiltMethod>;

fn one(method: impl Method + 'static) -> Methods {
    vec![(None, Box::new(method))]
}

fn by_spec(specs: &[&str]) -> Methods {
    let parsed: Vec<_> = specs.iter().map(|text| text.parse().unwrap()).collect();
    methods::build(&parsed, None).unwrap()
}

fn request(methods: Methods, metrics: &str, limit: usize) -> Request {
    let selection = Selection::parse(metrics).unwrap();
    Request {
        limit: Some(limit),
        methods,
        ..Request::new(
            OpenDataset::open_all(&[DATASET.parse().unwrap()], None).unwrap(),
            Vec::new(),
            Scoring::new(&selection, &Weights::deterministic("")).unwrap(),
        )
    }
}

fn run(out: &Path, methods: Methods, metrics: &str, limit: usize) -> Finished {
    run_with(out, request(methods, metrics, limit), RunOptions::default())
}

fn run_with(out: &Path, request: Request, options: RunOptions) -> Finished {
    let evaluation = prepare(request, &Quiet).unwrap();
    evaluation.run(out, options, &Quiet).unwrap()
}

fn scores(out: &Path) -> String {
    std::fs::read_to_string(out.join("scores.csv")).unwrap()
}

/// Predicts the same grey for every pair and counts the calls.
fn grey(
    label: &str,
    level: u8,
    asked: &Arc<AtomicUsize>,
) -> Closure<impl Fn(&SourceView, &TargetCamera) -> Result<PicturePrediction, MethodError> + use<>>
{
    let asked = Arc::clone(asked);
    Closure::new(label, level.to_string(), move |_, target: &TargetCamera| {
        asked.fetch_add(1, Ordering::SeqCst);
        let (width, height) = target.size();
        Ok(RgbImage::from_pixel(width, height, image::Rgb([level; 3])).into())
    })
}

/// Stands in for a network: predicts the Gaussians of `depth-splat` under another identity, and counts the calls.
struct Network {
    label: &'static str,
    depth: TrueDepth,
    splat: Box<dyn Method>,
    asked: Arc<AtomicUsize>,
    /// A clock in milliseconds. Each inference advances it by more than the previous one did.
    clock: Option<&'static AtomicU64>,
}

impl Network {
    fn new(label: &'static str, depth: TrueDepth, asked: &Arc<AtomicUsize>) -> Self {
        let (_, splat) = by_spec(&["depth-splat:resolution=64"]).remove(0);
        Self {
            label,
            depth,
            splat,
            asked: Arc::clone(asked),
            clock: None,
        }
    }
}

impl Method for Network {
    fn label(&self) -> &str {
        self.label
    }

    fn identity(&self) -> MethodIdentity {
        MethodIdentity::new("network", [("checkpoint", "1".to_owned())])
    }

    fn privilege(&self) -> Privilege {
        Privilege::of_depth(self.depth)
    }

    fn approach(&self) -> Approach<'_> {
        Approach::Gaussians(self)
    }
}

impl PredictGaussians for Network {
    fn predict(
        &self,
        source: &SourceView,
        _: Option<&TargetCamera>,
    ) -> Result<GaussianPrediction, MethodError> {
        let before = self.asked.fetch_add(1, Ordering::SeqCst) as u64;
        if let Some(clock) = self.clock {
            clock.fetch_add(1000 * (before + 1), Ordering::SeqCst);
        }
        // Predicts a plane, because it never gets the true depth, whatever its privilege.
        assert!(source.depth().is_none());
        let (width, height) = source.image().dimensions();
        let plane = sharp_datasets::DepthMap::from_pixel(width, height, image::Luma([2.0]));
        let seen = SourceView::new(source.name(), source.camera(), source.image(), Some(&plane));
        let Approach::Gaussians(splat) = self.splat.approach() else {
            panic!("depth-splat makes Gaussians");
        };
        Ok(GaussianPrediction {
            first_layer: Some(plane.clone()),
            ..splat.predict(&seen, None)?
        })
    }
}

#[test]
fn a_shared_inference_is_charged_whole_to_every_method_in_any_order() {
    static CLOCK: AtomicU64 = AtomicU64::new(0);
    let folder = tempfile::tempdir().unwrap();
    let seconds = |out: &str, order: [(&'static str, TrueDepth); 2]| {
        let asked = Arc::new(AtomicUsize::new(0));
        let methods = order.map(|(label, depth)| {
            let network = Network {
                clock: Some(&CLOCK),
                ..Network::new(label, depth, &asked)
            };
            (None, Box::new(network) as Box<dyn Method>)
        });
        let mut evaluation = prepare(request(methods.into(), "psnr", 6), &Quiet).unwrap();
        evaluation.clock = || Duration::from_millis(CLOCK.load(Ordering::SeqCst));
        let out = folder.path().join(out);
        evaluation.run(&out, RunOptions::default(), &Quiet).unwrap();
        let sources = asked.load(Ordering::SeqCst);
        let of = |label| {
            let times = bundle::timings(&out, label).unwrap().into_iter();
            times
                .map(|(pair, timing)| (pair, (timing.predict_secs, timing.render_secs)))
                .collect::<std::collections::BTreeMap<_, _>>()
        };
        (sources, of("plain"), of("scaled"))
    };
    let plain = ("plain", TrueDepth::None);
    let scaled = ("scaled", TrueDepth::DepthScale);
    let (sources, one, other) = seconds("a", [plain, scaled]);
    assert_eq!(one, other);
    // Every inference took a different time, and each pair records the time of its source's inference.
    let different: BTreeSet<u64> = one.values().map(|(secs, _)| *secs as u64).collect();
    assert_eq!(different, (1..=sources as u64).collect());
    assert_eq!(seconds("b", [scaled, plain]), (sources, one, other));
}

#[test]
fn another_metric_predicts_and_renders_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("r");
    let asked = Arc::new(AtomicUsize::new(0));
    let network = |depth| one(Network::new("n", depth, &asked));
    let first = run(&out, network(TrueDepth::None), "psnr", 3).counts;
    assert_eq!((first.rendered, first.scored), (3, 3));
    let before = asked.load(Ordering::SeqCst);
    let psnr = scores(&out);

    let more = run(&out, network(TrueDepth::None), "psnr,ssim-gauss11-valid", 3).counts;
    assert_eq!(asked.load(Ordering::SeqCst), before);
    assert_eq!((more.predicted, more.rendered), (0, 0));
    assert_eq!(more.scored, 3);
    // Scoring kept pictures by metric name gives bit-identical results to a run with all metrics at once.
    let selection = Selection::parse("lpips-alex").unwrap();
    let scoring = Scoring::new(&selection, &Weights::deterministic("")).unwrap();
    let (counts, results) = rescore(&out, &scoring, MEMORY_LIMIT_BYTES, &Quiet).unwrap();
    assert_eq!((counts.scored, counts.waiting), (3, 0));
    assert_eq!(results.manifest.metrics.len(), 3);
    let whole = dir.path().join("whole");
    run(
        &whole,
        network(TrueDepth::None),
        "psnr,ssim-gauss11-valid,lpips-alex",
        3,
    );
    assert_eq!(scores(&out), scores(&whole));
    assert!(scores(&out).len() > psnr.len());
    // A run with fewer metrics does not hide the scores of others.
    let again = run(&out, network(TrueDepth::None), "psnr", 3);
    assert_eq!(again.counts.reused, 3);
    assert_eq!(scores(&out), scores(&whole));
}

#[test]
fn a_network_runs_once_a_source_for_all_targets_and_privileges() {
    let dir = tempfile::tempdir().unwrap();
    let asked = Arc::new(AtomicUsize::new(0));
    for (name, memory_limit_bytes) in [("memory", 1 << 30), ("disk", 0)] {
        asked.store(0, Ordering::SeqCst);
        let methods: Methods = vec![
            (
                None,
                Box::new(Network::new("plain", TrueDepth::None, &asked)),
            ),
            (
                None,
                Box::new(Network::new("aligned", TrueDepth::DepthScale, &asked)),
            ),
        ];
        let options = RunOptions {
            memory_limit_bytes,
            ..RunOptions::default()
        };
        let out = dir.path().join(name);
        let finished = run_with(&out, request(methods, "psnr", 12), options);
        let records = &finished.results.records;
        let sources: BTreeSet<&str> = records.iter().map(|r| r.source.as_str()).collect();
        assert!(records.len() == 24 && sources.len() < 12, "{sources:?}");
        assert_eq!(asked.load(Ordering::SeqCst), sources.len(), "{name}");
        assert_eq!(finished.counts.failed, 0);
        let aligned = records.iter().filter(|r| r.method == "aligned");
        assert!(
            aligned
                .clone()
                .all(|r| r.extras.contains_key("median_scale"))
        );
        assert!(std::fs::read_dir(&out).unwrap().all(|entry| {
            let name = entry.unwrap().file_name();
            !name.to_string_lossy().starts_with(".spill") && name != "gaussians"
        }));
    }
    assert_eq!(
        scores(&dir.path().join("memory")),
        scores(&dir.path().join("disk"))
    );
}

#[test]
fn stages_run_apart_and_give_the_same_bytes() {
    let dir = tempfile::tempdir().unwrap();
    let (whole, apart) = (dir.path().join("whole"), dir.path().join("apart"));
    let asked = Arc::new(AtomicUsize::new(0));
    let methods = || -> Methods {
        vec![
            (
                None,
                Box::new(Network::new("n", TrueDepth::DepthScale, &asked)),
            ),
            by_spec(&["copy"]).remove(0),
        ]
    };
    run(&whole, methods(), "psnr", 4);
    asked.store(0, Ordering::SeqCst);
    let stage = |stages| {
        let options = RunOptions {
            stages,
            ..RunOptions::default()
        };
        run_with(&apart, request(methods(), "psnr", 4), options).counts
    };
    let early = stage(Stages::Score);
    assert_eq!((early.waiting, early.scored), (8, 0));
    let predicted = stage(Stages::Predict);
    let networks = asked.load(Ordering::SeqCst);
    assert!(predicted.waiting == 8 && predicted.rendered == 0 && networks > 0);
    let rendered = stage(Stages::Render);
    assert_eq!((rendered.rendered, rendered.scored), (4, 0));
    let scored = stage(Stages::Score);
    assert_eq!(
        (scored.scored, scored.predicted, scored.rendered),
        (8, 0, 0)
    );
    assert_eq!(asked.load(Ordering::SeqCst), networks);
    assert_eq!(scores(&whole), scores(&apart));

    // If the network cannot be opened, kept pictures can still be scored.
    let elsewhere = dir.path().join("elsewhere");
    for stages in [Stages::Predict, Stages::Render] {
        let options = RunOptions {
            stages,
            ..RunOptions::default()
        };
        run_with(&elsewhere, request(methods(), "psnr", 4), options);
    }
    assert_eq!(Results::read(&elsewhere).unwrap().missing.len(), 8);
    let scoring = Scoring::new(&Selection::parse("psnr").unwrap(), &Weights::none()).unwrap();
    let (counts, results) = rescore(&elsewhere, &scoring, MEMORY_LIMIT_BYTES, &Quiet).unwrap();
    assert_eq!((counts.scored, results.missing.len()), (8, 0));
    assert_eq!(scores(&whole), scores(&elsewhere));
}

#[test]
fn another_renderer_runs_no_network() {
    let dir = tempfile::tempdir().unwrap();
    let asked = Arc::new(AtomicUsize::new(0));
    let options = RunOptions {
        keep_gaussians: true,
        ..RunOptions::default()
    };
    let network = || one(Network::new("n", TrueDepth::None, &asked));
    let out = dir.path().join("r");
    let first = run_with(&out, request(network(), "psnr", 3), options);
    let before = asked.load(Ordering::SeqCst);
    // Picture keys include the renderer. But a folder has only one renderer, so only the manifest differs.
    let mut evaluation = prepare(request(network(), "psnr", 3), &Quiet).unwrap();
    evaluation.renderer = mortal(usize::MAX);
    let mut manifest = first.results.manifest;
    manifest.renderer.backend = "wgpu:mortal".to_owned();
    drop(first.folder);
    RunFolder::create(&out)
        .unwrap()
        .write_manifest(&manifest)
        .unwrap();
    let other = evaluation.run(&out, options, &Quiet).unwrap();
    assert_eq!((other.counts.rendered, other.counts.predicted), (3, 0));
    assert_eq!(asked.load(Ordering::SeqCst), before);
}

#[test]
fn a_folder_keeps_what_it_has_when_methods_pairs_and_metrics_are_added() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("r");
    run(&out, by_spec(&["copy", "mean"]), "psnr", 3);
    run(&out, by_spec(&["depth-splat:resolution=64"]), "psnr", 2);
    let finished = run(&out, by_spec(&["mean"]), "psnr,ssim-gauss11-valid", 5);
    let count = |label: &str| {
        let records = finished.results.records.iter();
        records.filter(|r| r.method == label).count()
    };
    assert_eq!(
        (count("copy"), count("mean"), count("depth-splat")),
        (3, 5, 2)
    );
    assert_eq!((finished.counts.reused, finished.counts.scored), (0, 5));
    let labels: Vec<&str> = finished
        .results
        .manifest
        .methods
        .iter()
        .map(|m| m.label.as_str())
        .collect();
    assert_eq!(labels, ["copy", "mean", "depth-splat"]);
    assert_eq!(finished.results.missing.len(), 0);
    assert_eq!(finished.results.manifest.pairs.evaluated, 5);
    let standing = prepare(request(by_spec(&["copy"]), "psnr", 5), &Quiet).unwrap();
    let standing = standing.status(Some(&out)).unwrap();
    assert_eq!((standing.done, standing.missing, standing.units), (3, 2, 5));
}

#[test]
fn folders_join_unless_they_contradict_each_other() {
    let dir = tempfile::tempdir().unwrap();
    let path = |name: &str| dir.path().join(name);
    let whole = run(&path("whole"), by_spec(&["copy", "mean"]), "psnr", 3);
    run(&path("a"), by_spec(&["copy", "mean"]), "psnr", 2);
    run(&path("b"), by_spec(&["copy", "mean"]), "psnr", 3);
    assert!("a\nb=whole".parse::<Named>().is_err());
    let named = |text: &str| text.parse::<Named>().unwrap();
    let plain = |name: &str| named(&path(name).display().to_string());
    let joined = join(&[plain("a"), plain("b")]).unwrap();
    assert_eq!(joined.records, whole.results.records);
    // A unit missing in one folder but present in the other is not missing.
    std::fs::remove_dir_all(path("a").join("units")).unwrap();
    let joined = join(&[plain("a"), plain("b")]).unwrap();
    assert_eq!((joined.records.len(), joined.missing.len()), (6, 0));

    let merged = merge(&[path("a"), path("b")], Some(&path("m"))).unwrap();
    assert_eq!(merged.records, whole.results.records);
    assert_eq!(scores(&path("m")), scores(&path("whole")));
    assert!(
        merged
            .kept_picture(&merged.records[0])
            .is_some_and(|kept| kept.is_scored)
    );

    let asked = Arc::new(AtomicUsize::new(0));
    for (name, level) in [("v1", 10), ("v2", 20)] {
        run(&path(name), one(grey("grey", level, &asked)), "psnr", 2);
    }
    let error = join(&[plain("v1"), plain("v2")]).unwrap_err();
    let EvaluateError::Conflict { difference, .. } = &error else {
        panic!("{error}");
    };
    assert!(difference.contains("method 'grey'"), "{difference}");
    let apart = join(&[
        named(&format!("old={}", path("v1").display())),
        named(&format!("new={}", path("v2").display())),
        named(&format!("base={}", path("whole").display())),
    ])
    .unwrap();
    let labels: Vec<&str> = apart
        .manifest
        .methods
        .iter()
        .map(|m| m.label.as_str())
        .collect();
    assert_eq!(labels, ["old", "new", "base/copy", "base/mean"]);
    assert!(
        apart
            .records
            .iter()
            .all(|r| apart.kept_picture(r).is_some_and(|kept| kept.is_scored))
    );
}

#[test]
fn a_changed_identity_replaces_its_label_and_nothing_is_lost() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("r");
    let asked = Arc::new(AtomicUsize::new(0));
    for (level, reused) in [(10, 0), (200, 0), (10, 0), (10, 1)] {
        let finished = run(&out, one(grey("grey", level, &asked)), "psnr", 1);
        assert_eq!(finished.counts.reused, reused, "{level}");
        assert_eq!(finished.results.records.len(), 1);
        let kept = finished.results.kept_picture(&finished.results.records[0]);
        let kept = image::open(kept.unwrap().path).unwrap().into_rgb8();
        assert_eq!(kept.get_pixel(0, 0).0, [level; 3]);
    }
    // Without kept pictures, returning to the earlier settings finds the earlier result.
    let options = RunOptions {
        keep: Keep::None,
        ..RunOptions::default()
    };
    let out = dir.path().join("none");
    for (level, reused) in [(10, 0), (200, 0), (10, 1)] {
        let request = request(one(grey("grey", level, &asked)), "psnr", 1);
        assert_eq!(run_with(&out, request, options).counts.reused, reused);
    }
}

#[test]
fn a_damaged_unit_is_made_again() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("r");
    let expected = run(&out, by_spec(&["copy"]), "psnr", 1).results.records;
    let units = std::fs::read_dir(out.join("units")).unwrap().next();
    let unit = std::fs::read_dir(units.unwrap().unwrap().path())
        .unwrap()
        .next();
    let unit = unit.unwrap().unwrap().path();
    let text = std::fs::read_to_string(&unit).unwrap();
    let psnr = expected[0].scores["psnr"].value().unwrap().to_string();
    assert!(text.contains(&psnr));
    let last = if psnr.ends_with('1') { '2' } else { '1' };
    let changed = format!("{}{last}", &psnr[..psnr.len() - 1]);
    for damaged in [
        text[..text.len() / 2].to_owned(),
        text.replace(&psnr, &changed),
    ] {
        std::fs::write(&unit, damaged).unwrap();
        let again = run(&out, by_spec(&["copy"]), "psnr", 1);
        assert_eq!(
            (again.counts.reused, &again.results.records),
            (0, &expected)
        );
    }
    assert_eq!(run(&out, by_spec(&["copy"]), "psnr", 1).counts.reused, 1);
}

#[test]
fn a_truth_that_could_not_be_read_costs_no_prediction() {
    let dir = tempfile::tempdir().unwrap();
    let data = sharp_datasets::bundled::extract(&dir.path().join("data")).unwrap();
    let evaluate = || {
        let spec = format!("middlebury={}", data.display());
        let request = Request {
            datasets: OpenDataset::open_all(&[spec.parse().unwrap()], None).unwrap(),
            ..request(by_spec(&["mean"]), "psnr", 1)
        };
        run_with(&dir.path().join("r"), request, RunOptions::default())
    };
    let scene = std::fs::read_dir(&data).unwrap().next().unwrap().unwrap();
    let target = scene.path().join("im1.png");
    let whole = std::fs::read(&target).unwrap();
    // Chunks with correct checksums, so that only decoding detects the damage.
    let mut broken = whole.clone();
    let kind = broken.windows(4).position(|at| at == b"IDAT").unwrap();
    let length = u32::from_be_bytes(whole[kind - 4..kind].try_into().unwrap()) as usize;
    let end = kind + 4 + length;
    broken[kind + 4 + length / 2..end].fill(0);
    let crc = |crc: u32, byte: &u8| {
        let step = |crc: u32, _| (crc >> 1) ^ (0xEDB8_8320 & 0_u32.wrapping_sub(crc & 1));
        (0..8).fold(crc ^ u32::from(*byte), step)
    };
    let sum = !broken[kind..end].iter().fold(!0, crc);
    broken[end..end + 4].copy_from_slice(&sum.to_be_bytes());
    std::fs::write(&target, &broken).unwrap();
    let counts = evaluate().counts;
    assert_eq!((counts.predicted, counts.failed), (1, 1));
    std::fs::write(&target, &whole).unwrap();
    let mended = evaluate();
    assert_eq!((mended.counts.predicted, mended.counts.failed), (0, 0));
    assert!(mended.results.records[0].scores["psnr"].value().is_some());
    assert_eq!(evaluate().counts.reused, 1);
}

#[test]
fn a_file_that_changes_during_the_run_fails_its_unit_and_is_read_anew_afterwards() {
    let dir = tempfile::tempdir().unwrap();
    let data = sharp_datasets::bundled::extract(&dir.path().join("data")).unwrap();
    let scene = std::fs::read_dir(&data).unwrap().next().unwrap().unwrap();
    let [source, target] = ["im0.png", "im1.png"].map(|name| scene.path().join(name));
    let asked = Arc::new(AtomicUsize::new(0));
    let evaluate = || {
        let (asked, source, target) = (asked.clone(), source.clone(), target.clone());
        let replaces = move |view: &SourceView, _: &TargetCamera| {
            if asked.fetch_add(1, Ordering::SeqCst) == 0 {
                std::fs::copy(&target, &source).unwrap();
            }
            Ok(view.image().clone().into())
        };
        let spec = format!("middlebury={}", data.display());
        let request = Request {
            datasets: OpenDataset::open_all(&[spec.parse().unwrap()], None).unwrap(),
            ..request(one(Closure::new("r", "", replaces)), "psnr", 1)
        };
        run_with(&dir.path().join("r"), request, RunOptions::default())
    };
    let first = evaluate().results.records;
    let Status::Failed { reason } = &first[0].status else {
        panic!("{:?}", first[0]);
    };
    assert!(
        reason.contains("im0.png changed during the run"),
        "{reason}"
    );
    // The changed source is the target itself.
    let second = evaluate().results.records;
    assert_eq!(second[0].scores["psnr"].value(), Some(f64::INFINITY));
}

#[test]
fn the_common_region_is_that_of_all_pairs_and_can_be_scored_again() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("r");
    let common = |limit| {
        let request = Request {
            common_region: true,
            ..request(by_spec(&["copy", "mean"]), "psnr", limit)
        };
        let evaluation = prepare(request, &Quiet).unwrap();
        evaluation.run(&out, RunOptions::default(), &Quiet)
    };
    assert_eq!(common(3).unwrap().results.records.len(), 6);
    let error = common(2).err().unwrap();
    assert!(matches!(error, EvaluateError::NotKept { .. }), "{error}");
    let selection = Selection::parse("ssim-gauss11-valid").unwrap();
    let scoring = Scoring::new(&selection, &Weights::none()).unwrap();
    let (counts, results) = rescore(&out, &scoring, MEMORY_LIMIT_BYTES, &Quiet).unwrap();
    assert_eq!((counts.scored, counts.waiting), (6, 0));
    assert!(
        results
            .records
            .iter()
            .all(|record| record.scores.len() == 2)
    );
}

/// Renders on the CPU until its simulated device is lost.
struct Mortal {
    cpu: CpuRenderer,
    pictures_left: usize,
}

impl Renderer for Mortal {
    fn name(&self) -> String {
        "wgpu:mortal".to_owned()
    }

    fn load<'a>(
        &'a mut self,
        scene: &'a Gaussians,
    ) -> Result<Box<dyn LoadedScene + 'a>, RenderError> {
        if self.pictures_left == 0 {
            return Err(RenderError::DeviceLost {
                adapter: "mortal".to_owned(),
                what: "a test".to_owned(),
            });
        }
        self.pictures_left -= 1;
        self.cpu.load(scene)
    }
}

fn mortal(pictures_left: usize) -> SharedRenderer {
    let mortal = Mortal {
        cpu: CpuRenderer::new(),
        pictures_left,
    };
    SharedRenderer::new(Box::new(mortal), RenderSettings::default())
}

#[test]
fn a_lost_device_leaves_the_unit_undone_and_the_run_continues_from_there() {
    let dir = tempfile::tempdir().unwrap();
    let on = |renderer: SharedRenderer, name: &str| {
        let methods = by_spec(&["depth-splat:resolution=64"]);
        let mut evaluation = prepare(request(methods, "psnr", 5), &Quiet).unwrap();
        evaluation.renderer = renderer;
        evaluation.run(&dir.path().join(name), RunOptions::default(), &Quiet)
    };
    on(mortal(usize::MAX), "whole").unwrap();
    // Three renderings succeed: the source's own and two targets.
    let error = on(mortal(3), "cut").err().unwrap();
    let EvaluateError::Device { pair_id, .. } = &error else {
        panic!("{error}");
    };
    let whole = Results::read(&dir.path().join("whole")).unwrap();
    assert_eq!(*pair_id, whole.records[2].pair_id);
    assert!(error.to_string().contains("lost"));
    // An unfinished run can be read and lists what is missing.
    let cut = Results::read(&dir.path().join("cut")).unwrap();
    assert_eq!((cut.records.len(), cut.missing.len()), (2, 3));

    let resumed = on(mortal(usize::MAX), "cut").unwrap().counts;
    assert_eq!(resumed.reused, 2);
    assert_eq!(
        scores(&dir.path().join("cut")),
        scores(&dir.path().join("whole"))
    );
    // Another renderer needs another folder.
    let error = on(SharedRenderer::cpu(), "cut").err().unwrap();
    assert!(
        matches!(error, EvaluateError::OtherMachine { .. }),
        "{error}"
    );
}

/// Records how far prediction has progressed when each pair is scored.
struct Watch<'a> {
    predicted: &'a AtomicUsize,
    seen: Mutex<Vec<usize>>,
}

impl Observer for Watch<'_> {
    fn progress(&self, _done: usize, _current: &str) {
        // Wait until prediction is as far ahead as it may be, and then a little longer, to detect if it goes further.
        let mut seen = self.seen.lock().unwrap();
        let expected = (seen.len() + 2).min(6);
        let patience = Instant::now() + Duration::from_secs(20);
        while self.predicted.load(Ordering::SeqCst) < expected && Instant::now() < patience {
            std::thread::sleep(Duration::from_millis(1));
        }
        std::thread::sleep(Duration::from_millis(20));
        seen.push(self.predicted.load(Ordering::SeqCst));
    }
}

#[test]
fn prediction_runs_one_pair_ahead_of_scoring_and_no_further() {
    let dir = tempfile::tempdir().unwrap();
    let asked = Arc::new(AtomicUsize::new(0));
    let evaluation = prepare(request(one(grey("grey", 9, &asked)), "psnr", 6), &Quiet).unwrap();
    let watch = Watch {
        predicted: &asked,
        seen: Mutex::default(),
    };
    evaluation
        .run(&dir.path().join("r"), RunOptions::default(), &watch)
        .unwrap();
    // Once before each pair is scored, and once after the last.
    assert_eq!(*watch.seen.lock().unwrap(), [2, 3, 4, 5, 6, 6, 6]);
}

#[test]
fn pair_options_of_a_dataset_are_its_own() {
    let mut request = request(by_spec(&["copy"]), "psnr", 4);
    let specs = [
        "A:synthetic=size=48x36,views=20,seed=1,pairs.threshold=0.9"
            .parse()
            .unwrap(),
        "B:synthetic=size=48x36,views=20,seed=1".parse().unwrap(),
    ];
    request.datasets = OpenDataset::open_all(&specs, None).unwrap();
    let manifest = prepare(request, &Quiet).unwrap().manifest().unwrap();
    let choices = &manifest.pairs.lists[0].choices;
    assert_eq!(choices["A"].options.threshold, 0.9);
    assert_eq!(choices["B"].options.threshold, 0.6);
    assert!(
        choices["A"]
            .proxies("synthetic", 4)
            .contains(&"threshold=0.9".to_owned())
    );
    // Parses back to the same value.
    let text = serde_json::to_string(&manifest).unwrap();
    assert_eq!(serde_json::from_str::<Manifest>(&text).unwrap(), manifest);
}

#[test]
fn a_bundle_is_the_results_without_pictures() {
    let dir = tempfile::tempdir().unwrap();
    let path = |name: &str| dir.path().join(name);
    // One method fails on a pair, one metric is perfect, one has no number.
    let fails = Closure::new("fails", "1", |_, target: &TargetCamera| {
        let (width, height) = target.size();
        if target.pair_id().ends_with("view_01") {
            Err(MethodError::Model("not this one".to_owned()))
        } else {
            Ok(RgbImage::new(width, height).into())
        }
    });
    let mut methods = by_spec(&["target", "copy"]);
    methods.extend(one(fails));
    let mut request = request(methods, "psnr,ssim-all", 6);
    request.scoring = Scoring::new(
        &Selection::parse("psnr,ssim-all,lpips").unwrap(),
        &Weights::none(),
    )
    .unwrap();
    let finished = run_with(&path("r"), request, RunOptions::default());
    assert!(finished.results.failures() > 0);

    write_bundle(&path("r"), &path("a.zip"), false).unwrap();
    write_bundle(&path("r"), &path("b.zip"), false).unwrap();
    let bytes = std::fs::read(path("a.zip")).unwrap();
    assert!(bytes == std::fs::read(path("b.zip")).unwrap());
    let packed = Results::read(&path("a.zip")).unwrap();
    let mut expected = finished.results.records;
    for record in &mut expected {
        record.extras.clear();
    }
    assert_eq!(packed.records, expected);
    assert_eq!(packed.manifest, finished.results.manifest);
    assert_eq!(packed.missing, finished.results.missing);

    // A bundle damaged or truncated anywhere, or no bundle at all, always gives an error, never wrong numbers.
    for at in (0..bytes.len()).step_by(bytes.len() / 200) {
        let mut other = bytes.clone();
        other[at] ^= 0x10;
        std::fs::write(path("c.zip"), other).unwrap();
        if let Ok(read) = Results::read(&path("c.zip")) {
            assert_eq!(read.records, expected, "byte {at}");
        }
        std::fs::write(path("c.zip"), &bytes[..at]).unwrap();
        assert!(Results::read(&path("c.zip")).is_err(), "cut at {at}");
    }
    let error = Results::read(&path("r/scores.csv")).unwrap_err();
    assert!(error.to_string().contains("not a bundle"), "{error}");

    // The digest covers the times, which are those of the folder.
    write_bundle(&path("r"), &path("times.zip"), true).unwrap();
    let timings = Bundle::read(&path("times.zip")).unwrap().timings;
    assert_eq!(
        timings["copy"],
        bundle::timings(&path("r"), "copy").unwrap()
    );
    let mut other = Bundle::read(&path("times.zip")).unwrap();
    let head = other.head().unwrap().digest;
    for timing in other.timings.get_mut("copy").unwrap().values_mut() {
        timing.predict_secs += 1.0;
    }
    assert_ne!(other.head().unwrap().digest, head);
}

/// A bundle of 3000 pairs, 7 methods and 4 metrics, with all digits of all scores, is within the size limit for a
/// baseline in a repository.
#[test]
fn a_bundle_of_the_papers_size_is_below_a_megabyte() {
    let dir = tempfile::tempdir().unwrap();
    let out = dir.path().join("r");
    let results = run(
        &out,
        by_spec(&["copy"]),
        "psnr,ssim,ssim-uniform7-sample,ssim-uniform7-population",
        1,
    )
    .results;
    let list = PairList::read(&out.join("pairs.csv")).unwrap();
    let mut random = SplitMix64::new(7);
    let mut unit = move || random.between(0.0, 1.0);
    let (mut pairs, mut records) = (Vec::new(), Vec::new());
    let mut manifest = results.manifest;
    let methods = (0..7).map(|m| {
        let mut method = manifest.methods[0].clone();
        method.label = format!("method-{m}");
        method
    });
    manifest.methods = methods.collect();
    for at in 0..3000 {
        let (scene, source, target) = (format!("scene_{}", at / 8), at % 8, at % 7);
        let mut pair = list.pairs[0].clone();
        pair.scene.clone_from(&scene);
        pair.pair_id = format!("S/{scene}/{source:04}__{target:04}");
        pair.source_sha256 = sha256_hex(format!("{scene} {source}").as_bytes());
        pair.target_sha256 = sha256_hex(format!("{scene} {target}").as_bytes());
        pair.baseline_m = unit();
        pair.rotation_deg = unit();
        for method in &manifest.methods {
            let mut record = results.records[0].clone();
            record.pair_id.clone_from(&pair.pair_id);
            record.scene.clone_from(&scene);
            record.cluster.clone_from(&scene);
            record.method.clone_from(&method.label);
            for (key, score) in &mut record.scores {
                let value = unit();
                *score = Score::Value(if key == "psnr" {
                    10.0 + 20.0 * value
                } else {
                    value
                });
            }
            assert_eq!(record.scores.len(), 4);
            records.push(record);
        }
        pairs.push(pair);
    }
    let results = Results {
        manifest,
        records,
        missing: BTreeSet::new(),
        pictures: Vec::new(),
        damaged: Vec::new(),
        methods_listed: false,
    };
    let bundle = Bundle {
        results,
        pairs: PairList::new("pairs.csv", pairs),
        occasion: None,
        timings: std::collections::BTreeMap::new(),
    };
    let bytes = bundle.bytes().unwrap().len();
    assert!(bytes < 1_000_000, "{bytes}");
}
