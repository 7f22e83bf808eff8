//! Scenes of Gaussians from files: PLY, or safetensors arrays.

use std::collections::HashMap;
use std::io;
use std::path::{Path, PathBuf};

use glam::DAffine3;
use safetensors::tensor::{Dtype, TensorView};
use safetensors::{SafeTensorError, SafeTensors};
use sharp::camera::{CameraError, Intrinsics, affine_from_row_major};
use sharp::gaussians::{Gaussians, LengthMismatch};
use sharp::ply::{self, PlyError, ReadOptions};
use sharp_checkpoint::{Checkpoint, CheckpointError};
use sharp_datasets::DepthMap;

use super::atomic_files::{FileError, write_atomic};
use super::hash::{StableHasher, sha256_hex};
use crate::methods::{GaussianPrediction, GaussianSpace};

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
    #[error(transparent)]
    File(#[from] FileError),
    #[error("{}: not a whole prediction", path.display())]
    Damaged { path: PathBuf },
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
    #[error("{}: a scene is a .ply or .safetensors file", path.display())]
    Extension { path: PathBuf },
}

/// Reads `.ply` (with or without the release's extra elements) or `.safetensors` (`means` [N, 3], `quats_wxyz` [N, 4],
/// `scales` `[N, 3]`, `opacities` `[N]`, `colors_linear` `[N, 3]`).
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

/// Writes a prediction with everything that rendering it needs: arrays as [`read`] takes them, its space, its depth
/// layer, what the method reported, and a checksum.
pub fn write_prediction(path: &Path, prediction: &GaussianPrediction) -> Result<(), FileError> {
    let gaussians = &prediction.gaussians;
    let n = gaussians.len();
    let mut arrays = vec![
        Array::new("means", &[n, 3], gaussians.means.as_flattened()),
        Array::new("quats_wxyz", &[n, 4], gaussians.quaternions.as_flattened()),
        Array::new("scales", &[n, 3], gaussians.scales.as_flattened()),
        Array::new("opacities", &[n], &gaussians.opacities),
        Array::new("colors_linear", &[n, 3], gaussians.colors.as_flattened()),
    ];
    if let Some(layer) = &prediction.first_layer {
        let shape = [layer.height() as usize, layer.width() as usize];
        arrays.push(Array::new("first_layer", &shape, layer.as_raw()));
    }
    let space = match prediction.space {
        GaussianSpace::Normalized => "normalized",
        GaussianSpace::Camera => "camera",
    };
    let extras = serde_json::to_string(&prediction.extras).unwrap_or_default();
    let metadata = HashMap::from([
        ("space".to_owned(), space.to_owned()),
        ("extras".to_owned(), extras.clone()),
        ("checksum".to_owned(), checksum(space, &extras, &arrays)),
    ]);
    write_arrays(path, &arrays, Some(metadata))
}

/// An f32 array of a safetensors file, which stores little endian on every machine.
pub(super) struct Array {
    name: &'static str,
    shape: Vec<usize>,
    bytes: Vec<u8>,
}

impl Array {
    pub(super) fn new(name: &'static str, shape: &[usize], values: &[f32]) -> Self {
        Self {
            name,
            shape: shape.to_vec(),
            bytes: values.iter().flat_map(|v| v.to_le_bytes()).collect(),
        }
    }
}

pub(super) fn write_arrays(
    path: &Path,
    arrays: &[Array],
    metadata: Option<HashMap<String, String>>,
) -> Result<(), FileError> {
    let encode = || -> Result<Vec<u8>, SafeTensorError> {
        let view = |a: &Array| TensorView::new(Dtype::F32, a.shape.clone(), &a.bytes);
        let named = |array| Ok::<_, SafeTensorError>((array.name, view(array)?));
        let views: Vec<_> = arrays.iter().map(named).collect::<Result<_, _>>()?;
        safetensors::serialize(views, metadata)
    };
    let bytes = encode().map_err(|e| FileError::new(path, "encode")(io::Error::other(e)))?;
    write_atomic(path, &bytes)
}

/// Reads what [`write_prediction`] wrote.
///
/// # Errors
/// When the file cannot be read, or is not whole.
pub fn read_prediction(path: &Path) -> Result<GaussianPrediction, GaussianFileError> {
    let damaged = || GaussianFileError::Damaged {
        path: path.to_owned(),
    };
    let bytes = std::fs::read(path).map_err(FileError::new(path, "read"))?;
    let (_, header) = SafeTensors::read_metadata(&bytes).map_err(|_| damaged())?;
    let metadata = header.metadata().clone().ok_or_else(damaged)?;
    let text = |name: &str| metadata.get(name).cloned().ok_or_else(damaged);
    let (space, extras) = (text("space")?, text("extras")?);
    let tensors = SafeTensors::deserialize(&bytes).map_err(|_| damaged())?;
    let arrays: Vec<Array> = ARRAYS
        .into_iter()
        .filter_map(|name| {
            let tensor = tensors.tensor(name).ok()?;
            let (shape, bytes) = (tensor.shape().to_vec(), tensor.data().to_vec());
            Some(Array { name, shape, bytes })
        })
        .collect();
    if checksum(&space, &extras, &arrays) != text("checksum")? {
        return Err(damaged());
    }
    let first_layer = arrays.iter().find(|array| array.name == "first_layer");
    let first_layer = first_layer.and_then(|Array { shape, bytes, .. }| {
        let values = bytes.as_chunks().0.iter().map(|b| f32::from_le_bytes(*b));
        DepthMap::from_vec(shape[1] as u32, shape[0] as u32, values.collect())
    });
    Ok(GaussianPrediction {
        gaussians: read_arrays(path)?,
        space: match space.as_str() {
            "camera" => GaussianSpace::Camera,
            _ => GaussianSpace::Normalized,
        },
        first_layer,
        extras: serde_json::from_str(&extras).map_err(|_| damaged())?,
    })
}

/// The arrays of a prediction, in the order that they are hashed in.
const ARRAYS: [&str; 6] = [
    "means",
    "quats_wxyz",
    "scales",
    "opacities",
    "colors_linear",
    "first_layer",
];

fn checksum(space: &str, extras: &str, arrays: &[Array]) -> String {
    let mut hasher = StableHasher::default();
    hasher.add("space", space).add("extras", extras);
    for Array { name, shape, bytes } in arrays {
        hasher.add(name, &format!("{shape:?} {}", sha256_hex(bytes)));
    }
    hasher.finish()
}

fn read_arrays(path: &Path) -> Result<Gaussians, GaussianFileError> {
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
