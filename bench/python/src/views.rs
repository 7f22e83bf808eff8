//! Datasets: scenes of posed views.

use glam::{DMat3, DVec3};
use numpy::{AllowTypeChange, PyArray1, PyArray2, PyArray3, PyArrayLike2, PyArrayMethods};
use pyo3::prelude::*;
use sharp::camera::{Intrinsics, RigidTransform};
use sharp_bench::pairs::{DatasetConfig, OpenDataset, PairError, PosedCamera};
use sharp_datasets as core;

use crate::arrays;
use crate::errors::{failed, refused};

/// A pinhole camera in OpenCV's axes (x right, y down, z forward), metres; pixel centres lie at half-integer
/// coordinates.
#[pyclass(frozen, module = "sharp_bench")]
#[derive(Clone, Copy)]
pub(crate) struct Camera {
    pub(crate) intrinsics: Intrinsics,
    pub(crate) camera_from_world: RigidTransform,
}

impl From<&PosedCamera> for Camera {
    fn from(camera: &PosedCamera) -> Self {
        Self {
            intrinsics: camera.intrinsics,
            camera_from_world: camera.camera_from_world,
        }
    }
}

#[pymethods]
#[allow(non_snake_case, reason = "K is the conventional name")]
impl Camera {
    /// K is 3×3 without skew; camera_from_world is 4×4 and defaults to the identity (the world is the camera's own
    /// space).
    #[new]
    #[pyo3(signature = (width, height, K, camera_from_world=None))]
    fn new(
        width: u32,
        height: u32,
        K: Matrix<'_>,
        camera_from_world: Option<Matrix<'_>>,
    ) -> PyResult<Self> {
        let k = matrix::<3>("K", &K)?;
        if [k[0][1], k[1][0], k[2][0], k[2][1]] != [0.0; 4] || k[2][2] != 1.0 {
            return Err(refused(anyhow::anyhow!(
                "K: expected [[fx, 0, cx], [0, fy, cy], [0, 0, 1]]"
            )));
        }
        let intrinsics = Intrinsics::new((k[0][0], k[1][1]), (k[0][2], k[1][2]), (width, height));
        let pose = match camera_from_world {
            None => RigidTransform::IDENTITY,
            Some(pose) => {
                let rows = matrix::<4>("camera_from_world", &pose)?;
                let row = |at: usize| DVec3::new(rows[at][0], rows[at][1], rows[at][2]);
                let rotation = DMat3::from_cols(row(0), row(1), row(2)).transpose();
                let translation = DVec3::new(rows[0][3], rows[1][3], rows[2][3]);
                if rows[3] != [0.0, 0.0, 0.0, 1.0] {
                    let reason = "camera_from_world: its last row must be 0, 0, 0, 1";
                    return Err(refused(anyhow::anyhow!(reason)));
                }
                RigidTransform::new(rotation, translation).map_err(refused)?
            }
        };
        Ok(Self {
            intrinsics: intrinsics.map_err(refused)?,
            camera_from_world: pose,
        })
    }

    #[getter]
    fn width(&self) -> u32 {
        self.intrinsics.width
    }

    #[getter]
    fn height(&self) -> u32 {
        self.intrinsics.height
    }

    /// Intrinsics as a 3×3 matrix, in pixels.
    #[getter]
    fn K<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let columns = self.intrinsics.matrix();
        PyArray1::from_slice(py, &columns.transpose().to_cols_array()).reshape([3, 3])
    }

    /// World-to-camera pose as a 4×4 matrix, in metres.
    #[getter]
    fn camera_from_world<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        PyArray1::from_slice(py, &self.camera_from_world.to_row_major()).reshape([4, 4])
    }

    fn __repr__(&self) -> String {
        let Intrinsics {
            fx,
            fy,
            cx,
            cy,
            width,
            height,
        } = self.intrinsics;
        let centre = self.camera_from_world.camera_center();
        format!(
            "Camera {width}×{height}, fx {fx:.2}, fy {fy:.2}, cx {cx:.2}, cy {cy:.2}, at {centre:.3} m"
        )
    }
}

/// A numeric NumPy array of two dimensions, converted to f64.
type Matrix<'py> = PyArrayLike2<'py, f64, AllowTypeChange>;

fn matrix<const N: usize>(name: &str, array: &Matrix<'_>) -> PyResult<[[f64; N]; N]> {
    let view = array.as_array();
    if view.dim() != (N, N) {
        return Err(refused(anyhow::anyhow!(
            "{name}: {:?}, expected {N}×{N}",
            view.dim()
        )));
    }
    Ok(std::array::from_fn(|row| {
        std::array::from_fn(|column| view[[row, column]])
    }))
}

/// A photograph with its camera.
#[pyclass(frozen, module = "sharp_bench")]
pub(crate) struct View {
    core: core::View,
}

#[pymethods]
impl View {
    #[getter]
    fn id(&self) -> &str {
        &self.core.id
    }

    #[getter]
    fn camera(&self) -> Camera {
        Camera::from(&PosedCamera::from(&self.core))
    }

    /// The photograph [H, W, 3], uint8 sRGB; decoded at each call.
    fn image<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray3<u8>>> {
        let image = py.detach(|| self.core.content.image()).map_err(failed)?;
        arrays::from_rgb8(py, image)
    }

    /// z-depth [H, W], float32 metres, 0 where unknown; None without ground truth. Decoded at each call.
    fn depth<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray2<f32>>>> {
        let depth = py.detach(|| self.core.content.depth()).map_err(failed)?;
        depth.map(|depth| arrays::from_depth(py, depth)).transpose()
    }

    /// [H, W] of bool, False where the dataset excludes a pixel; None if it excludes none.
    fn valid_pixels<'py>(&self, py: Python<'py>) -> PyResult<Option<Bound<'py, PyArray2<bool>>>> {
        let valid = py
            .detach(|| self.core.content.valid_pixels())
            .map_err(failed)?;
        let array = |valid: image::GrayImage| {
            let inside = valid.as_raw().iter().map(|level| *level == 255).collect();
            arrays::from_plane(py, inside, valid.dimensions())
        };
        valid.map(array).transpose()
    }

    fn __repr__(&self) -> String {
        let Intrinsics { width, height, .. } = self.core.intrinsics;
        format!("View {:?}, {width}×{height}", self.core.id)
    }
}

/// Views in one shared world space.
#[pyclass(frozen, module = "sharp_bench", get_all)]
pub(crate) struct Scene {
    id: String,
    /// The physical scene; scenes with the same cluster are not independent samples.
    cluster: String,
    views: Vec<Py<View>>,
    /// The reader's assumptions and omissions.
    notes: Vec<String>,
}

#[pymethods]
impl Scene {
    fn __repr__(&self) -> String {
        format!("Scene {:?} of {} views", self.id, self.views.len())
    }
}

/// A dataset as its reader opened it.
#[pyclass(frozen, module = "sharp_bench", get_all)]
pub(crate) struct Dataset {
    name: String,
    spec: String,
    format: &'static str,
    scenes: Vec<Py<Scene>>,
    /// Scenes that were left out, and why.
    notes: Vec<String>,
}

#[pymethods]
impl Dataset {
    fn __repr__(&self) -> String {
        format!(
            "Dataset {:?} ({}) of {} scenes",
            self.name,
            self.spec,
            self.scenes.len()
        )
    }
}

/// Parses specs of the form `[NAME:]FORMAT=PATH[,key=value…]`.
pub(crate) fn configs(specs: &[String]) -> Result<Vec<DatasetConfig>, PairError> {
    specs.iter().map(|spec| spec.parse()).collect()
}

/// Opens the datasets `specs`, with only the scenes that match `scenes` if given.
#[pyfunction]
#[pyo3(signature = (specs, scenes=None))]
pub(crate) fn datasets(
    py: Python<'_>,
    specs: Vec<String>,
    scenes: Option<String>,
) -> PyResult<Vec<Dataset>> {
    let open = py
        .detach(|| OpenDataset::open_all(&configs(&specs)?, scenes.as_deref()))
        .map_err(failed)?;
    let scene = |scene: core::Scene| {
        let views = scene
            .views
            .into_iter()
            .map(|core| Py::new(py, View { core }));
        let scene = Scene {
            id: scene.id,
            cluster: scene.cluster,
            views: views.collect::<PyResult<_>>()?,
            notes: scene.notes,
        };
        Py::new(py, scene)
    };
    let dataset = |dataset: OpenDataset| {
        Ok(Dataset {
            notes: dataset.left_out.iter().map(ToString::to_string).collect(),
            name: dataset.name,
            spec: dataset.config.without_pairs().to_string(),
            format: dataset.config.spec.entry.format,
            scenes: dataset
                .scenes
                .into_iter()
                .map(scene)
                .collect::<PyResult<_>>()?,
        })
    };
    open.into_iter().map(dataset).collect()
}

/// Unpacks the bundled pair of Middlebury 2014 into a folder; returns the path for `middlebury=`.
#[pyfunction]
pub(crate) fn bundled_data(folder: std::path::PathBuf) -> PyResult<std::path::PathBuf> {
    core::bundled::extract(&folder).map_err(failed)
}
