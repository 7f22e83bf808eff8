//! Evaluates a Python function as a method.

use std::collections::BTreeMap;
use std::path::PathBuf;
use std::sync::Mutex;
use std::sync::atomic::{AtomicBool, AtomicUsize, Ordering};
use std::time::{Duration, Instant};

use numpy::{PyArray2, PyArray3};
use pyo3::prelude::*;
use sharp::render::Backend;
use sharp_bench::config::{ConfigError, RunConfig};
use sharp_bench::evaluate::{Request, RunOptions, Shard, prepare};
use sharp_bench::io::observer::Observer;
use sharp_bench::methods::{
    self, Approach, GaussianPrediction, GaussianSpace, Method, MethodError, MethodIdentity,
    PicturePrediction, PredictGaussians, PredictPicture, SourceView, TargetCamera,
};
use sharp_bench::rendering::RenderSettings;
use sharp_datasets::DepthMap;
use sharp_metrics::Picture;

use crate::arrays;
use crate::errors::{failed, refused};
use crate::gaussians::{Gaussians, rendered};
use crate::pairs::{Warnings, lock};
use crate::views::Camera;

/// The source view of a method.
#[pyclass(frozen, module = "sharp_bench")]
pub(crate) struct Source {
    name: String,
    camera: Camera,
    image: image::RgbImage,
    depth: Option<DepthMap>,
}

#[pymethods]
impl Source {
    /// Name of the view, dataset/scene/view.
    #[getter]
    fn name(&self) -> &str {
        &self.name
    }

    #[getter]
    fn camera(&self) -> Camera {
        self.camera
    }

    /// The photograph [H, W, 3], uint8 sRGB.
    fn image<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<u8>>> {
        arrays::from_rgb8(py, self.image.clone())
    }

    /// The true z-depth [H, W], float32 metres, 0 where unknown; only with privilege="source-depth", else None.
    fn depth<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray2<f32>>>> {
        self.depth
            .clone()
            .map(|depth| arrays::from_depth(py, depth))
            .transpose()
    }
}

impl From<&SourceView<'_>> for Source {
    fn from(view: &SourceView<'_>) -> Self {
        Self {
            name: view.name().to_owned(),
            camera: Camera::from(view.camera()),
            image: view.image().clone(),
            depth: view.depth().cloned(),
        }
    }
}

struct Function {
    label: String,
    version: String,
    privileged: bool,
    /// If true, the function takes a source and returns Gaussians. If false, it takes a source and
    /// a camera, and returns a picture or Gaussians.
    of_source: bool,
    function: Py<PyAny>,
}

impl Function {
    fn model(error: impl ToString) -> MethodError {
        MethodError::Model(error.to_string())
    }

    /// Calls the function; `camera` is `None` for a function of the source alone.
    fn call<T>(
        &self,
        source: &SourceView<'_>,
        camera: Option<Camera>,
        take: impl FnOnce(&Bound<'_, PyAny>) -> PyResult<T>,
    ) -> Result<T, MethodError> {
        Python::attach(|py| {
            let source = Py::new(py, Source::from(source))?;
            let answer = match camera {
                Some(camera) => self.function.bind(py).call1((source, camera)),
                None => self.function.bind(py).call1((source,)),
            };
            take(&answer?)
        })
        .map_err(Self::model)
    }
}

/// A picture, or Gaussians in the source camera's space.
enum Answer {
    Picture(Picture),
    Gaussians(Gaussians),
}

impl Method for Function {
    fn label(&self) -> &str {
        &self.label
    }

    fn identity(&self) -> MethodIdentity {
        MethodIdentity::new("python", [("version", self.version.clone())])
    }

    fn privilege(&self) -> methods::Privilege {
        methods::Privilege::of_depth(if self.privileged {
            methods::TrueDepth::SourceDepth
        } else {
            methods::TrueDepth::None
        })
    }

    fn approach(&self) -> Approach<'_> {
        if self.of_source {
            Approach::Gaussians(self)
        } else {
            Approach::Pictures(self)
        }
    }
}

impl PredictPicture for Function {
    fn predict(
        &self,
        source: &SourceView,
        target: &TargetCamera,
    ) -> Result<PicturePrediction, MethodError> {
        let camera = Camera {
            intrinsics: *target.intrinsics(),
            camera_from_world: target.target_from_source(source),
        };
        let answer = self.call(source, Some(camera), |answer| {
            match answer.cast::<Gaussians>() {
                Ok(gaussians) => Ok(Answer::Gaussians(gaussians.get().clone())),
                Err(_) => arrays::picture(answer).map(Answer::Picture),
            }
        })?;
        let picture = match answer {
            Answer::Picture(picture) => picture,
            Answer::Gaussians(gaussians) => {
                let settings = RenderSettings::default();
                let output =
                    rendered(&gaussians, &camera, settings, &Backend::Cpu).map_err(Self::model)?;
                Picture::Rgb8(output.srgb8(settings.background, settings.quantization))
            }
        };
        Ok(PicturePrediction {
            picture,
            region: None,
            resized_from: None,
            extras: BTreeMap::new(),
            notes: Vec::new(),
        })
    }
}

impl PredictGaussians for Function {
    fn predict(
        &self,
        source: &SourceView,
        _: Option<&TargetCamera>,
    ) -> Result<GaussianPrediction, MethodError> {
        let (gaussians, rule) = self.call(source, None, |answer| {
            let gaussians = answer.cast::<Gaussians>()?.get();
            Ok((gaussians.core.clone(), gaussians.rule))
        })?;
        Ok(GaussianPrediction {
            rule,
            gaussians,
            space: GaussianSpace::CAMERA,
            reading: Some(methods::file_reading::FileReading::of_arrays()),
            ..GaussianPrediction::default()
        })
    }
}

/// Requests that an evaluation stop after the current unit.
#[pyclass(frozen)]
#[derive(Default)]
pub(crate) struct Stop(AtomicBool);

#[pymethods]
impl Stop {
    #[new]
    fn new() -> Self {
        Self::default()
    }

    fn set(&self) {
        self.0.store(true, Ordering::Relaxed);
    }
}

/// Minimum time between two calls of a progress function.
const PAUSE: Duration = Duration::from_millis(200);

/// Reports progress to a function `(phase, done, of)` and collects warnings.
struct Progress<'a> {
    stop: &'a AtomicBool,
    function: Option<&'a Py<PyAny>>,
    warnings: &'a Warnings,
    phase: Mutex<(String, usize, Option<Instant>)>,
    done: AtomicUsize,
}

impl Progress<'_> {
    fn tell(&self, done: usize, at_once: bool) {
        let Some(function) = self.function else {
            return;
        };
        let told = {
            let mut phase = lock(&self.phase);
            if !at_once && phase.2.is_some_and(|at| at.elapsed() < PAUSE) {
                return;
            }
            phase.2 = Some(Instant::now());
            (phase.0.clone(), done, phase.1)
        };
        // An exception in a progress display must not stop the evaluation.
        Python::attach(|py| drop(function.call1(py, told)));
    }
}

impl Observer for Progress<'_> {
    fn warn(&self, text: &str) {
        self.warnings.push(text);
    }

    fn begin(&self, phase: &str, steps: usize, _unit: &'static str) {
        *lock(&self.phase) = (phase.to_owned(), steps, None);
        self.done.store(0, Ordering::Relaxed);
        self.tell(0, true);
    }

    fn progress(&self, done: usize, _current: &str) {
        self.done.store(done, Ordering::Relaxed);
        self.tell(done, false);
    }

    fn step(&self) {
        let done = self.done.fetch_add(1, Ordering::Relaxed) + 1;
        self.tell(done, false);
    }

    fn end(&self) {
        self.tell(self.done.load(Ordering::Relaxed), true);
    }

    fn stop(&self) -> bool {
        self.stop.load(Ordering::Relaxed)
    }
}

/// Arguments of an evaluation.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub(crate) struct Asked {
    out: PathBuf,
    label: String,
    version: String,
    of_source: bool,
    privileged: bool,
    /// The shard to evaluate, in the syntax of `--shard`.
    shard: Option<String>,
    /// Path of a `run.toml`.
    config: Option<PathBuf>,
    /// Keys of a `run.toml` as JSON; they override the keys in the file `config`.
    keys: String,
}

/// Evaluates `function`, if given, along with the methods of the configuration. Returns named counts, and the warnings.
#[pyfunction]
pub(crate) fn evaluate(
    py: Python<'_>,
    function: Option<Py<PyAny>>,
    asked: Asked,
    stop: &Stop,
    progress: Option<Py<PyAny>>,
) -> PyResult<(BTreeMap<&'static str, usize>, Vec<String>)> {
    let warnings = Warnings::default();
    let observer = Progress {
        stop: &stop.0,
        function: progress.as_ref(),
        warnings: &warnings,
        phase: Mutex::default(),
        done: AtomicUsize::default(),
    };
    let keys = serde_json::from_str(&asked.keys).map_err(refused)?;
    let mut config = RunConfig::from_keys(keys).map_err(refused)?;
    if let Some(file) = &asked.config {
        let file = RunConfig::read(file).map_err(refused)?;
        config = file.overlaid(&config).map_err(refused)?;
    }
    let shard = asked.shard.as_deref().map(str::parse::<Shard>);
    let shard = shard.transpose().map_err(|error| {
        let reason = format!("shard: {error}");
        refused(anyhow::anyhow!(reason))
    })?;
    let own = function.map(|function| Function {
        label: asked.label.clone(),
        version: asked.version,
        privileged: asked.privileged,
        of_source: asked.of_source,
        function,
    });
    let run = || -> anyhow::Result<_> {
        let mut request = Request::of(&config, None)?;
        if let Some(own) = own {
            request.methods.insert(0, (None, Box::new(own)));
        }
        let evaluation = prepare(request, &observer)?;
        let options = RunOptions::from(&config);
        let Some(shard) = shard else {
            return Ok(evaluation.run(&asked.out, options, &observer)?.counts);
        };
        evaluation.plan_shards(&asked.out, &observer)?;
        Ok(evaluation.run_shard(&asked.out, shard, options, &observer)?)
    };
    let counts = py.detach(run).map_err(|error| {
        let config = error.downcast_ref::<ConfigError>();
        if config.is_some_and(ConfigError::is_usage) {
            refused(error)
        } else {
            failed(error)
        }
    })?;
    let counts = [
        ("units", counts.units),
        ("reused", counts.reused),
        ("scored", counts.scored),
        ("failed", counts.failed),
        ("left", counts.left),
    ];
    Ok((counts.into(), warnings.take()))
}
