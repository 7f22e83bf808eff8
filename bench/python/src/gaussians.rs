//! Creating, rendering and predicting Gaussians.

use std::collections::BTreeMap;
use std::path::PathBuf;

use numpy::{AllowTypeChange, PyArray1, PyArray2, PyArray3, PyArrayLike1, PyArrayLike2};
use pyo3::prelude::*;
use sharp::gaussian_files::turn;
use sharp::gaussians::Gaussians as Core;
use sharp::image_file::focal::focal_px_from_35mm;
use sharp::model::{ModelConfig, NetworkSpec, Predictor as Network};
use sharp::ply::{GaussianScene, PlyForm, StoredForm};
use sharp::render::{Backend, Background, RenderOutput, Rule};
use sharp::unprojection::{release_intrinsics, unproject};
use sharp_bench::io::checkpoint::find_checkpoint;
use sharp_bench::io::gaussian_files;
use sharp_bench::io::pictures::to_rgb8;
use sharp_bench::methods::file_reading::Axes;
use sharp_bench::rendering::{RenderSettings, SharedRenderer};
use sharp_metrics::Picture;

use crate::arrays;
use crate::errors::{failed, refused};
use crate::views::Camera;

/// 3D Gaussians, float32 arrays: means [N, 3] in metres, quaternions [N, 4] as w, x, y, z, scales [N, 3] (standard
/// deviations, metres), opacities [N] in 0..1, colors [N, 3] in linear RGB, or encoded if the file's rendering rule
/// blends encoded colours.
#[pyclass(frozen, module = "sharp_bench")]
#[derive(Clone)]
pub(crate) struct Gaussians {
    pub(crate) core: Core,
    /// Rendering rule; `None` for SHARP's.
    pub(crate) rule: Option<Rule>,
}

#[pymethods]
impl Gaussians {
    #[new]
    fn new(
        means: PyArrayLike2<'_, f32, AllowTypeChange>,
        quaternions: PyArrayLike2<'_, f32, AllowTypeChange>,
        scales: PyArrayLike2<'_, f32, AllowTypeChange>,
        opacities: PyArrayLike1<'_, f32, AllowTypeChange>,
        colors: PyArrayLike2<'_, f32, AllowTypeChange>,
    ) -> PyResult<Self> {
        let core = Core::new(
            arrays::rows("means", &means)?,
            arrays::rows("quaternions", &quaternions)?,
            arrays::rows("scales", &scales)?,
            opacities.as_array().to_vec(),
            arrays::rows("colors", &colors)?,
        );
        Ok(Self {
            core: core.map_err(refused)?,
            rule: None,
        })
    }

    /// Reads a PLY file of this program, of SHARP's release or of 3D Gaussian Splatting, a compressed PLY, SPZ, SOG,
    /// .splat or safetensors. Keyword arguments override how numbers are stored, as --read does (color_space="srgb",
    /// opacity="linear", harmonics="drop", …); rendering="inria" and the like set the rendering rule.
    #[staticmethod]
    #[pyo3(signature = (path, **reading))]
    fn load(path: PathBuf, reading: Option<BTreeMap<String, String>>) -> PyResult<Self> {
        let mut form = StoredForm::default();
        let (mut rule, mut axes) = (None, None);
        for (key, value) in reading.into_iter().flatten() {
            if key == "rendering" {
                rule = Some(value.parse().map_err(refused)?);
            } else if key == "axes" {
                let signs = Axes::parse_flip(&value);
                axes = Some(signs.map_err(|reason| refused(anyhow::anyhow!(reason)))?);
            } else if !form.set(&key, &value).map_err(refused)? {
                let known = StoredForm::KEYS.join(", ");
                return Err(refused(anyhow::anyhow!(
                    "unknown setting {key}; the settings are {known}, rendering, axes"
                )));
            }
        }
        let mut file = gaussian_files::read(&path, form, rule).map_err(failed)?;
        turn(&mut file.gaussians, &mut file.doubts, axes)
            .map_err(|reason| refused(anyhow::anyhow!("{}: {reason}", path.display())))?;
        Ok(Self {
            rule: (file.rule != Rule::SHARP).then_some(file.rule),
            core: file.gaussians,
        })
    }

    /// Writes a PLY file in the format of SHARP's release, including the camera's intrinsics.
    fn save(&self, path: PathBuf, camera: &Camera) -> PyResult<()> {
        if let Some(rule) = self.rule {
            return Err(refused(anyhow::anyhow!(
                "SHARP's format cannot store the rendering rule {rule}; `gaussians convert` writes other formats"
            )));
        }
        let scene = GaussianScene::new(self.core.clone(), camera.intrinsics);
        scene.save(&path, PlyForm::Release).map_err(failed)
    }

    #[getter]
    fn means<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        arrays::from_rows(py, &self.core.means)
    }

    #[getter]
    fn quaternions<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        arrays::from_rows(py, &self.core.quaternions)
    }

    #[getter]
    fn scales<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        arrays::from_rows(py, &self.core.scales)
    }

    #[getter]
    fn opacities<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f32>> {
        PyArray1::from_slice(py, &self.core.opacities)
    }

    #[getter]
    fn colors<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        arrays::from_rows(py, &self.core.colors)
    }

    fn __len__(&self) -> usize {
        self.core.len()
    }

    fn __repr__(&self) -> String {
        format!("{} Gaussians", self.core.len())
    }
}

/// A rendered view.
#[pyclass(frozen, module = "sharp_bench")]
pub(crate) struct Rendering {
    output: RenderOutput,
    background: Background,
}

#[pymethods]
impl Rendering {
    /// [H, W, 3], uint8 sRGB over the background, as a run scores it.
    #[getter]
    fn picture<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<u8>>> {
        let rule = RenderSettings::default().quantization;
        arrays::from_rgb8(py, self.output.srgb8(self.background, rule))
    }

    /// [H, W, 3], float32 RGB, premultiplied by alpha, without background: linear, or encoded if the rendering rule
    /// blends encoded values.
    #[getter]
    fn linear<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<f32>>> {
        arrays::from_values(py, self.output.rgb.as_flattened().to_vec(), self.size())
    }

    /// [H, W], float32: coverage in 0..0.9999.
    #[getter]
    fn alpha<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        arrays::from_plane(py, self.output.alpha.clone(), self.size())
    }

    /// [H, W], float32: expected z-depth, metres, 0 where nothing is drawn.
    #[getter]
    fn depth<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f32>>> {
        arrays::from_depth(py, self.output.expected_depth())
    }

    fn __repr__(&self) -> String {
        let (width, height) = self.size();
        format!(
            "Rendering {width}×{height} of {} Gaussians",
            self.output.drawn
        )
    }
}

impl Rendering {
    fn size(&self) -> (u32, u32) {
        (self.output.width, self.output.height)
    }
}

/// Renders with the settings of a run.
pub(crate) fn rendered(
    gaussians: &Gaussians,
    camera: &Camera,
    settings: RenderSettings,
    backend: &Backend,
) -> Result<RenderOutput, sharp::render::RenderError> {
    let renderer = SharedRenderer::open(backend, settings)?;
    let camera_from_world = camera.camera_from_world.to_affine();
    renderer.render(
        &gaussians.core,
        camera_from_world,
        camera.intrinsics,
        gaussians.rule,
    )
}

/// Renders Gaussians given in the world space of `camera`.
#[pyfunction]
#[pyo3(signature = (gaussians, camera, *, background="black", eps2d=0.0, backend="cpu"))]
pub(crate) fn render(
    py: Python<'_>,
    gaussians: &Gaussians,
    camera: &Camera,
    background: &str,
    eps2d: f32,
    backend: &str,
) -> PyResult<Rendering> {
    let background = match background {
        "black" => Background::Black,
        "white" => Background::White,
        other => {
            return Err(refused(anyhow::anyhow!(
                "background {other:?}: expected black or white"
            )));
        }
    };
    let backend: Backend = backend.parse().map_err(refused)?;
    let settings = RenderSettings {
        eps2d,
        background,
        ..RenderSettings::default()
    };
    let output = py.detach(|| rendered(gaussians, camera, settings, &backend));
    Ok(Rendering {
        output: output.map_err(failed)?,
        background,
    })
}

/// The SHARP network with the weights of a checkpoint.
#[pyclass(frozen, module = "sharp_bench")]
pub(crate) struct Predictor {
    network: Network,
}

#[pymethods]
impl Predictor {
    /// checkpoint defaults to the locally stored file of the release; config is FILE.json or FILE.json#NAME and
    /// defaults to the release's.
    #[new]
    #[pyo3(signature = (checkpoint=None, config=None))]
    fn new(py: Python<'_>, checkpoint: Option<PathBuf>, config: Option<String>) -> PyResult<Self> {
        let open = || -> anyhow::Result<Network> {
            let mut spec = NetworkSpec::release(match checkpoint {
                Some(file) => file,
                None => find_checkpoint()?,
            });
            if let Some(file) = &config {
                spec.config = ModelConfig::load(file)?;
            }
            Ok(Network::open(&spec)?)
        };
        Ok(Self {
            network: py.detach(open).map_err(failed)?,
        })
    }

    /// Gaussians in the metric space of a camera with this focal length and a centred principal point, as the release
    /// predicts them. The focal length defaults to that of a 30 mm lens on 35 mm film.
    #[pyo3(signature = (image, focal_px=None))]
    fn predict(
        &self,
        py: Python<'_>,
        image: &Bound<'_, PyAny>,
        focal_px: Option<f64>,
    ) -> PyResult<Gaussians> {
        let image = match arrays::picture(image)? {
            Picture::Rgb8(image) => image,
            Picture::RgbF32(image) => to_rgb8(&image),
        };
        let (width, height) = image.dimensions();
        let focal_px =
            focal_px.unwrap_or_else(|| focal_px_from_35mm(30.0, width as usize, height as usize));
        let intrinsics = release_intrinsics(focal_px, width, height).map_err(refused)?;
        let factor = (focal_px / f64::from(width)) as f32;
        let output = py
            .detach(|| self.network.predict_rgb8(&image, factor))
            .map_err(failed)?;
        Ok(Gaussians {
            core: unproject(&output.gaussians, &intrinsics),
            rule: None,
        })
    }
}
