//! Predictions of sources as files, for runs whose stages are apart and for more than memory holds.

use std::collections::HashMap;
use std::path::{Path, PathBuf};

use safetensors::SafeTensors;
use sharp_datasets::DepthMap;

use crate::io::atomic_files::FileError;
use crate::io::gaussian_files::{Array, GaussianFileError, read_arrays, write_arrays};
use crate::io::hash::{StableHasher, sha256_hex};
use crate::methods::{GaussianPrediction, GaussianSpace};

/// Why a prediction cannot be read back.
#[derive(Debug, thiserror::Error)]
pub(super) enum PredictionFileError {
    #[error(transparent)]
    File(#[from] FileError),
    #[error(transparent)]
    Gaussians(#[from] GaussianFileError),
    /// Cut off or changed.
    #[error("{}: not a whole prediction", .0.display())]
    Damaged(PathBuf),
}

/// Writes a prediction with everything that rendering it needs: arrays as `gaussians` takes them, its space, its depth
/// layer, what the method reported, the seconds it took, and a checksum.
pub(super) fn write_prediction(
    path: &Path,
    prediction: &GaussianPrediction,
    secs: f64,
) -> Result<(), FileError> {
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
        ("inference_secs".to_owned(), secs.to_string()),
        ("checksum".to_owned(), checksum(space, &extras, &arrays)),
    ]);
    write_arrays(path, &arrays, Some(metadata))
}

/// Reads what [`write_prediction`] wrote: the prediction, and the seconds it took.
///
/// # Errors
/// When the file cannot be read, or is not whole.
pub(super) fn read_prediction(
    path: &Path,
) -> Result<(GaussianPrediction, f64), PredictionFileError> {
    let damaged = || PredictionFileError::Damaged(path.to_owned());
    let bytes = std::fs::read(path).map_err(FileError::new(path, "read"))?;
    let (_, header) = SafeTensors::read_metadata(&bytes).map_err(|_| damaged())?;
    let metadata = header.metadata().clone().ok_or_else(damaged)?;
    let text = |name: &str| metadata.get(name).cloned().ok_or_else(damaged);
    let (space, extras) = (text("space")?, text("extras")?);
    let secs = text("inference_secs")?.parse().map_err(|_| damaged())?;
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
    let prediction = GaussianPrediction {
        gaussians: read_arrays(path)?,
        space: match space.as_str() {
            "camera" => GaussianSpace::Camera,
            _ => GaussianSpace::Normalized,
        },
        first_layer,
        extras: serde_json::from_str(&extras).map_err(|_| damaged())?,
    };
    Ok((prediction, secs))
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
