//! Scenes of Gaussians from files: of the field's formats, or safetensors arrays.

use std::collections::HashMap;
use std::io;
use std::path::{Path, PathBuf};

use glam::DAffine3;
use safetensors::SafeTensorError;
use safetensors::tensor::{Dtype, TensorView};
use sharp::camera::{CameraError, Intrinsics, affine_from_row_major};
use sharp::gaussians::{Gaussians, LengthMismatch};
use sharp::ply::{
    self, ColorSpace, FileMarks, GaussianScene, Harmonics, PlyError, PlyReason, StoredForm,
    Suspicion,
};
use sharp_checkpoint::{Checkpoint, CheckpointError};

use super::atomic_files::{FileError, write_atomic};

/// Gaussians and, where the file stores one, the camera to look from.
#[derive(Debug, Clone)]
pub struct GaussianFile {
    /// In the space of the file's producer.
    pub gaussians: Gaussians,
    pub camera: Option<(Intrinsics, DAffine3)>,
    /// What the file says about how it was made to be drawn; nothing of arrays.
    pub marks: FileMarks,
    /// How its numbers were read.
    pub reading: StoredForm,
    /// What contradicts that reading.
    pub doubts: Vec<Suspicion>,
}

/// Why a scene could not be read; names the file.
#[derive(Debug, thiserror::Error)]
pub enum GaussianFileError {
    #[error(transparent)]
    Ply(#[from] PlyError),
    #[error(transparent)]
    Arrays(#[from] CheckpointError),
    #[error("{}: {name} has shape {shape:?}, [N, {columns}] is needed", path.display())]
    Shape {
        path: PathBuf,
        name: &'static str,
        shape: Vec<usize>,
        columns: usize,
    },
    #[error("{}: {source}", path.display())]
    Lengths {
        path: PathBuf,
        source: LengthMismatch,
    },
    #[error("{}: {source}", path.display())]
    Camera { path: PathBuf, source: CameraError },
    /// Values that a scene cannot have.
    #[error("{}: {source}", path.display())]
    Stored { path: PathBuf, source: PlyReason },
    /// Where colours are blended in linear light, they have to be equal from all sides.
    #[error(
        "{}: colours depend on the view ({coefficients} coefficients f_rest_*), which is not rendered; \
         `harmonics=drop` draws the constant term alone, or bake them into it for the source's view", path.display()
    )]
    ViewDependent { path: PathBuf, coefficients: usize },
}

/// Reads `.safetensors` (`means` [N, 3], `quats_wxyz` [N, 4], `scales` `[N, 3]`, `opacities` `[N]`, `colors_linear`
/// `[N, 3]`), whatever the case of the extension, or a file of another name by its content
/// ([`sharp::gaussian_files`]). `reading` is how numbers are read that are stored otherwise, how colours are encoded
/// where the file does not say, and what they are blended in.
pub fn read(
    path: &Path,
    reading: impl Into<StoredForm>,
) -> Result<GaussianFile, GaussianFileError> {
    let reading = reading.into();
    if is_arrays(path) {
        let mut gaussians = read_arrays(path)?;
        let stored = |source| GaussianFileError::Stored {
            path: path.to_owned(),
            source,
        };
        let format = reading.of_arrays();
        let doubts = ply::suspicions(&gaussians, &reading, &format);
        ply::check_stored(&gaussians, &format).map_err(stored)?;
        format.decode(&mut gaussians);
        if let Some(value) = ply::enormous_scale(&gaussians) {
            return Err(stored(PlyReason::Impossible {
                what: "a standard deviation",
                value,
                advice: "that is wider than any scene; `scales=log` reads logarithms",
            }));
        }
        return Ok(GaussianFile {
            gaussians,
            camera: None,
            marks: FileMarks::default(),
            reading: format,
            doubts,
        });
    }
    let scene = read_scene(path, reading)?;
    let camera_from_world = match scene.extrinsics {
        None => DAffine3::IDENTITY,
        Some(m) => affine_from_row_major(&m.map(f64::from)).map_err(|source| {
            GaussianFileError::Camera {
                path: path.to_owned(),
                source,
            }
        })?,
    };
    Ok(GaussianFile {
        camera: scene.intrinsics.map(|k| (k, camera_from_world)),
        gaussians: scene.gaussians,
        marks: scene.marks,
        reading: scene.reading,
        doubts: scene.doubts,
    })
}

fn is_arrays(path: &Path) -> bool {
    let extension = path.extension().unwrap_or_default();
    extension.eq_ignore_ascii_case("safetensors")
}

/// A scene of another form than arrays. View-dependent colours are refused where the blending has no place for them.
pub fn read_scene(path: &Path, reading: StoredForm) -> Result<GaussianScene, GaussianFileError> {
    let scene = sharp::gaussian_files::load(path, reading)?;
    let is_lost = scene.is_view_dependent && reading.blending == ColorSpace::Linear;
    if is_lost && reading.harmonics != Some(Harmonics::Drop) {
        return Err(GaussianFileError::ViewDependent {
            path: path.to_owned(),
            coefficients: scene.color_coefficients,
        });
    }
    Ok(scene)
}

/// Endings of files that hold Gaussians, in the order in which they are looked for.
pub const EXTENSIONS: [&str; 6] = [
    "ply",
    "safetensors",
    "compressed.ply",
    "spz",
    "sog",
    "splat",
];

/// Whether a folder is an unpacked SOG.
pub fn is_sog_folder(path: &Path) -> bool {
    path.join("meta.json").is_file()
}

/// An f32 array of a safetensors file, little endian on every machine.
pub(crate) struct Array {
    pub(crate) name: &'static str,
    pub(crate) shape: Vec<usize>,
    pub(crate) bytes: Vec<u8>,
}

impl Array {
    pub(crate) fn new(name: &'static str, shape: &[usize], values: &[f32]) -> Self {
        Self {
            name,
            shape: shape.to_vec(),
            bytes: values.iter().flat_map(|v| v.to_le_bytes()).collect(),
        }
    }
}

pub(crate) fn write_arrays(
    path: &Path,
    arrays: &[Array],
    metadata: Option<HashMap<String, String>>,
) -> Result<(), FileError> {
    let encode = || -> Result<Vec<u8>, SafeTensorError> {
        let mut views = Vec::new();
        for Array { name, shape, bytes } in arrays {
            views.push((*name, TensorView::new(Dtype::F32, shape.clone(), bytes)?));
        }
        safetensors::serialize(views, metadata)
    };
    let bytes = encode().map_err(|e| FileError::new(path, "encode")(io::Error::other(e)))?;
    write_atomic(path, &bytes)
}

pub fn read_arrays(path: &Path) -> Result<Gaussians, GaussianFileError> {
    let file = Checkpoint::open(path)?;
    let opacities = rows::<1>(&file, "opacities")?;
    Gaussians::new(
        rows(&file, "means")?,
        rows(&file, "quats_wxyz")?,
        rows(&file, "scales")?,
        opacities.into_iter().map(|[v]| v).collect(),
        rows(&file, "colors_linear")?,
    )
    .map_err(|source| GaussianFileError::Lengths {
        path: path.to_owned(),
        source,
    })
}

/// A tensor of shape [N, K], or [N] for K = 1.
fn rows<const K: usize>(
    file: &Checkpoint,
    name: &'static str,
) -> Result<Vec<[f32; K]>, GaussianFileError> {
    let shape = file.shape(name)?;
    if !(matches!(shape, [_, k] if *k == K) || (K == 1 && shape.len() == 1)) {
        return Err(GaussianFileError::Shape {
            path: file.path().to_owned(),
            name,
            shape: shape.to_vec(),
            columns: K,
        });
    }
    let values = file.tensor_f32(name)?;
    Ok(values.as_chunks::<K>().0.to_vec())
}
