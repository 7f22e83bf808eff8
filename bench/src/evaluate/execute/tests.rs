//! Runs on the procedural scene with a device that fails, and with methods that watch the two threads.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Duration;

use sharp::gaussians::Gaussians;
use sharp::render::{CpuRenderer, LoadedScene, RenderError, Renderer};
use sharp_datasets::Scene;
use sharp_datasets::spec::DatasetSpec;
use sharp_metrics::{Selection, Weights};

use super::*;
use crate::methods::{self, Method, MethodError, PairInput, Prediction};
use crate::pairs::build::BuildContext;
use crate::pairs::{PairList, PairOptions, build_pairs};
use crate::rendering::SharedRenderer;
use crate::evaluate::plan::Scoring;
use crate::evaluate::scores::scores_csv;

/// Renders like the CPU until its device is lost.
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

fn renderer(pictures_left: usize) -> SharedRenderer {
    SharedRenderer::new(Box::new(Mortal {
        cpu: CpuRenderer::new(),
        pictures_left,
    }))
}

/// Scenes, their pair list and PSNR.
struct Bench {
    scenes: Vec<Scene>,
    list: PairList,
    scoring: Scoring,
}

impl Bench {
    fn new() -> Self {
        let spec = DatasetSpec::parse("S:synthetic=size=48x36,views=20").unwrap();
        let scenes = sharp_datasets::open(&spec).unwrap();
        let build =
            build_pairs(&scenes, &PairOptions::default(), &BuildContext::default()).unwrap();
        Self {
            scenes,
            list: PairList::new("pairs.csv", build.pairs),
            scoring: Scoring::new(&Selection::parse("psnr").unwrap(), &Weights::default()).unwrap(),
        }
    }

    fn plan<'a>(
        &'a self,
        methods: &'a [Box<dyn Method>],
        renderer: &'a SharedRenderer,
        pairs: usize,
    ) -> RunPlan<'a> {
        let mut resolved = self.list.resolve(&self.scenes).unwrap();
        resolved.truncate(pairs);
        RunPlan {
            pairs: resolved,
            methods,
            readings: BTreeMap::from([("S", "size=48x36".to_owned())]),
            scoring: &self.scoring,
            renderer,
            keep: Keep::None,
            common_region: false,
        }
    }
}

fn depth_splat() -> Vec<Box<dyn Method>> {
    methods::build(&["depth-splat:resolution=64".parse().unwrap()], None).unwrap()
}

#[test]
fn a_lost_device_leaves_the_unit_undone_and_the_run_goes_on_from_there() {
    let (bench, methods) = (Bench::new(), depth_splat());
    let dir = tempfile::tempdir().unwrap();
    let whole = RunFolder::create(&dir.path().join("whole")).unwrap();
    let healthy = renderer(usize::MAX);
    let expected = execute(&bench.plan(&methods, &healthy, 5), &whole, |_, _| {}).unwrap();
    assert_eq!(expected.failures(), 0);

    let cut = RunFolder::create(&dir.path().join("cut")).unwrap();
    let dying = renderer(2);
    let plan = bench.plan(&methods, &dying, 5);
    let error = execute(&plan, &cut, |_, _| {}).unwrap_err();
    let RunError::Device { pair_id, .. } = &error else {
        panic!("{error}");
    };
    assert_eq!(*pair_id, plan.pairs[2].pair.pair_id);
    assert!(error.to_string().contains("lost"));

    let resumed = execute(&bench.plan(&methods, &healthy, 5), &cut, |_, _| {}).unwrap();
    assert_eq!(resumed.reused, 2);
    let csv = |executed: &Executed| scores_csv(&executed.records(), &["psnr".to_owned()]).unwrap();
    assert_eq!(csv(&resumed), csv(&expected));
}

#[test]
fn units_of_another_backend_are_not_taken_over() {
    let (bench, methods) = (Bench::new(), depth_splat());
    let dir = tempfile::tempdir().unwrap();
    let folder = RunFolder::create(dir.path()).unwrap();
    let (cpu, other) = (SharedRenderer::cpu(), renderer(usize::MAX));
    for (renderer, reused) in [(&cpu, 0), (&other, 0), (&cpu, 2)] {
        let plan = bench.plan(&methods, renderer, 2);
        let executed = execute(&plan, &folder, |_, _| {}).unwrap();
        assert_eq!(executed.reused, reused);
    }
}

/// Counts predictions, and remembers how many there were when each unit came to be scored.
struct Counting(Arc<AtomicUsize>);

impl Method for Counting {
    fn label(&self) -> &str {
        "counting"
    }

    fn identity(&self) -> String {
        "counting".to_owned()
    }

    fn predict(&self, pair: &PairInput) -> Result<Prediction, MethodError> {
        self.0.fetch_add(1, Ordering::SeqCst);
        Ok(Prediction::plain(pair.source_image.clone()))
    }
}

#[test]
fn prediction_runs_one_step_ahead_of_scoring_and_no_further() {
    let bench = Bench::new();
    let dir = tempfile::tempdir().unwrap();
    let folder = RunFolder::create(dir.path()).unwrap();
    let predicted = Arc::new(AtomicUsize::new(0));
    let methods: Vec<Box<dyn Method>> = vec![Box::new(Counting(Arc::clone(&predicted)))];
    let cpu = SharedRenderer::cpu();
    let plan = bench.plan(&methods, &cpu, 6);
    let seen = Mutex::new(Vec::new());
    let executed = execute(&plan, &folder, |_, _| {
        // The other thread gets as far as it may, and time to go further, which it must not.
        let mut seen = seen.lock().unwrap();
        let expected = (seen.len() + 2).min(6);
        let patience = Instant::now() + Duration::from_secs(20);
        while predicted.load(Ordering::SeqCst) < expected && Instant::now() < patience {
            std::thread::sleep(Duration::from_millis(1));
        }
        std::thread::sleep(Duration::from_millis(20));
        seen.push(predicted.load(Ordering::SeqCst));
    })
    .unwrap();
    let ids = executed.units.iter().map(|(record, _)| &record.pair_id);
    assert!(ids.eq(plan.pairs.iter().map(|planned| &planned.pair.pair_id)));
    // When unit k is about to be scored, unit k + 1 is predicted and waits to be taken.
    assert_eq!(*seen.lock().unwrap(), [2, 3, 4, 5, 6, 6]);
}

/// Answers every pair with one grey.
struct Grey(u8);

impl Method for Grey {
    fn label(&self) -> &str {
        "grey"
    }

    fn identity(&self) -> String {
        format!("grey {}", self.0)
    }

    fn predict(&self, pair: &PairInput) -> Result<Prediction, MethodError> {
        let mut image = pair.source_image.clone();
        image.fill(self.0);
        Ok(Prediction::plain(image))
    }
}

#[test]
fn kept_pictures_are_those_that_were_scored() {
    let bench = Bench::new();
    let dir = tempfile::tempdir().unwrap();
    let folder = RunFolder::create(dir.path()).unwrap();
    let cpu = SharedRenderer::cpu();
    for (grey, reused) in [(10, 0), (200, 0), (10, 0), (10, 1)] {
        let methods: Vec<Box<dyn Method>> = vec![Box::new(Grey(grey))];
        let mut plan = bench.plan(&methods, &cpu, 1);
        plan.keep = Keep::All;
        let executed = execute(&plan, &folder, |_, _| {}).unwrap();
        assert_eq!(executed.reused, reused, "{grey}");
        let path = folder.prediction_path("grey", &plan.pairs[0].pair.pair_id);
        let kept = image::open(path).unwrap().into_rgb8();
        assert_eq!(kept.get_pixel(0, 0).0, [grey; 3]);
    }
}

#[test]
fn other_settings_of_a_dataset_are_other_units() {
    let (bench, cpu) = (Bench::new(), SharedRenderer::cpu());
    let dir = tempfile::tempdir().unwrap();
    let folder = RunFolder::create(dir.path()).unwrap();
    let methods: Vec<Box<dyn Method>> = vec![Box::new(Grey(10))];
    for (reading, reused) in [
        ("depth-unit=0.001", 0),
        ("depth-unit=0.002", 0),
        ("depth-unit=0.001", 1),
    ] {
        let mut plan = bench.plan(&methods, &cpu, 1);
        plan.readings.insert("S", reading.to_owned());
        let executed = execute(&plan, &folder, |_, _| {}).unwrap();
        assert_eq!(executed.reused, reused, "{reading}");
    }
}

#[test]
fn a_damaged_record_is_made_again() {
    let (bench, cpu) = (Bench::new(), SharedRenderer::cpu());
    let dir = tempfile::tempdir().unwrap();
    let folder = RunFolder::create(dir.path()).unwrap();
    let methods: Vec<Box<dyn Method>> = vec![Box::new(Grey(10))];
    let plan = bench.plan(&methods, &cpu, 1);
    let expected = execute(&plan, &folder, |_, _| {}).unwrap().records();
    let units = dir.path().join("records");
    let sub = std::fs::read_dir(units).unwrap().next().unwrap().unwrap();
    let unit = std::fs::read_dir(sub.path())
        .unwrap()
        .next()
        .unwrap()
        .unwrap();
    let whole = std::fs::read(unit.path()).unwrap();
    std::fs::write(unit.path(), &whole[..whole.len() / 2]).unwrap();
    let again = execute(&plan, &folder, |_, _| {}).unwrap();
    assert_eq!((again.reused, again.records()), (0, expected));
    assert_eq!(execute(&plan, &folder, |_, _| {}).unwrap().reused, 1);
}

#[test]
fn a_run_folder_has_one_writer_and_no_results_until_it_ended() {
    let dir = tempfile::tempdir().unwrap();
    let folder = RunFolder::create(dir.path()).unwrap();
    let error = RunFolder::create(dir.path()).unwrap_err().to_string();
    assert!(error.contains("another process"), "{error}");
    folder.write_records(&[]).unwrap();
    folder.reopen().unwrap();
    let error = folder.read_records().unwrap_err().to_string();
    assert!(error.contains("has not ended"), "{error}");
    drop(folder);
    RunFolder::create(dir.path()).unwrap();
}
