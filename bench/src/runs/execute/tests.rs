//! Runs on the procedural scene with a device that fails, and with methods that watch the two threads.

use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex};

use sharp::gaussians::Gaussians;
use sharp::render::{CpuRenderer, LoadedScene, RenderError, Renderer};
use sharp_datasets::Scene;
use sharp_datasets::spec::DatasetSpec;
use sharp_metrics::{Selection, Weights};

use super::*;
use crate::methods::{self, Method, MethodError, PairInput, Prediction};
use crate::protocol::pairs::BuildContext;
use crate::protocol::{PairList, PairOptions, build_pairs};
use crate::rendering::SharedRenderer;
use crate::runs::plan::Scoring;
use crate::runs::scores::scores_csv;

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
            scoring: &self.scoring,
            renderer,
            keep: Keep::None,
            common_region: false,
        }
    }
}

fn depth_splat() -> Vec<Box<dyn Method>> {
    methods::build(&["depth-splat:resolution=64".parse().unwrap()]).unwrap()
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
        // Long enough for the other thread to get as far as it may.
        std::thread::sleep(std::time::Duration::from_millis(100));
        seen.lock().unwrap().push(predicted.load(Ordering::SeqCst));
    })
    .unwrap();
    let ids = executed.units.iter().map(|(record, _)| &record.pair_id);
    assert!(ids.eq(plan.pairs.iter().map(|planned| &planned.pair.pair_id)));
    // When unit k is about to be scored, unit k + 1 is predicted and waits to be taken.
    assert_eq!(*seen.lock().unwrap(), [2, 3, 4, 5, 6, 6]);
}
