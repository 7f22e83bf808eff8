//! Scenes of Gaussians from files: PLY, or safetensors arrays.

use std::path::{Path, PathBuf};

use glam::DAffine3;
use sharp::camera::{CameraError, Intrinsics, affine_from_row_major};
use sharp::gaussians::{Gaussians, LengthMismatch};
use sharp::ply::{self, PlyError, ReadOptions};
use sharp_checkpoint::{Checkpoint, CheckpointError};

/// Gaussians and, where the file stores one, the camera to look from.
#[derive(Debug, Clone)]
pub struct GaussianFile {
    /// In whatever space the file's producer says.
    pub gaussians: Gaussians,
    /// Intrinsics and `camera_from_world`.
    pub camera: Option<(Intrinsics, DAffine3)>,
}

/// Why a scene could not be read; names the file.
#[derive(Debug, thiserror::Error)]
pub enum GaussianFileError {
    /// A `.ply` that is not one.
    #[error(transparent)]
    Ply(#[from] PlyError),
    /// A `.safetensors` that is not one or lacks an array.
    #[error(transparent)]
    Arrays(#[from] CheckpointError),
    /// An array of the wrong shape.
    #[error("{}: {name} has shape {shape:?}, [N, {columns}] is needed", path.display())]
    Shape {
        /// The file.
        path: PathBuf,
        /// The array.
        name: &'static str,
        /// What it has.
        shape: Vec<usize>,
        /// What a row needs.
        columns: usize,
    },
    /// Arrays of different lengths.
    #[error("{}: {source}", path.display())]
    Lengths {
        /// The file.
        path: PathBuf,
        /// All lengths.
        source: LengthMismatch,
    },
    /// The stored camera cannot be one.
    #[error("{}: {source}", path.display())]
    Camera {
        /// The file.
        path: PathBuf,
        /// What is wrong.
        source: CameraError,
    },
    /// Neither `.ply` nor `.safetensors`.
    #[error("{}: a scene is a .ply or .safetensors file", path.display())]
    Extension {
        /// The file.
        path: PathBuf,
    },
}

/// Reads `.ply` (with or without the release's extra elements) or `.safetensors` (`means` [N, 3], `quats_wxyz` [N, 4],
/// `scales` `[N, 3]`, `opacities` `[N]`, `colors_linear` `[N, 3]`).
///
/// # Errors
/// [`GaussianFileError`].
pub fn read(path: &Path) -> Result<GaussianFile, GaussianFileError> {
    match path.extension().and_then(|e| e.to_str()) {
        Some("ply") => {
            let scene = ply::load(path, ReadOptions::default())?;
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
            })
        }
        Some("safetensors") => Ok(GaussianFile {
            gaussians: read_arrays(path)?,
            camera: None,
        }),
        _ => Err(GaussianFileError::Extension {
            path: path.to_owned(),
        }),
    }
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
