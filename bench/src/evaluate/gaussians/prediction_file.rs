//! Files of predicted Gaussians, for stages run separately and predictions that do not fit into memory.

use std::collections::{BTreeMap, HashMap};
use std::path::{Path, PathBuf};

use glam::DAffine3;
use safetensors::SafeTensors;
use serde::{Deserialize, Serialize};
use sharp::gaussians::Harmonics;
use sharp_datasets::DepthMap;

use crate::io::atomic_files::FileError;
use crate::io::gaussian_files::{Array, GaussianFileError, read_arrays, write_arrays};
use crate::io::hash::{StableHasher, sha256_hex};
use crate::methods::file_reading::FileReading;
use crate::methods::{GaussianPrediction, GaussianSpace};

/// Why a prediction cannot be read back.
#[derive(Debug, thiserror::Error)]
pub(in crate::evaluate) enum PredictionFileError {
    #[error(transparent)]
    File(#[from] FileError),
    #[error(transparent)]
    Gaussians(#[from] GaussianFileError),
    /// The file is truncated or was changed since it was written.
    #[error("{}: not a complete prediction", .0.display())]
    Damaged(PathBuf),
}

/// Metadata of a prediction's file: everything except the arrays.
#[derive(Serialize, Deserialize)]
struct Said {
    /// Columns of the map to the source camera's space; `None` for SHARP's normalised space.
    camera_from_gaussians: Option<[f64; 12]>,
    extras: BTreeMap<String, f64>,
    /// Settings with which the original file was read.
    reading: Option<BTreeMap<String, String>>,
    warnings: BTreeMap<String, String>,
    #[serde(default)]
    rule_note: Option<String>,
    #[serde(default)]
    rule: Option<String>,
}

/// Writes a prediction with everything needed to render it: arrays (`colors_linear` are in the rule's blending space),
/// space, rule, depth layer, and the settings with which the original file was read. Also writes the method's extras,
/// the time that the prediction took in seconds, and a checksum.
pub(in crate::evaluate) fn write_prediction(
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
    let each = gaussians.harmonics.per_gaussian();
    if each > 0 {
        let values = gaussians.harmonics.coefficients.as_flattened();
        arrays.push(Array::new("harmonics", &[n, each, 3], values));
    }
    if let Some(layer) = &prediction.first_layer {
        let shape = [layer.height() as usize, layer.width() as usize];
        arrays.push(Array::new("first_layer", &shape, layer.as_raw()));
    }
    let said = Said {
        camera_from_gaussians: match prediction.space {
            GaussianSpace::Normalized => None,
            GaussianSpace::Camera(map) => Some(map.to_cols_array()),
        },
        extras: prediction.extras.clone(),
        reading: prediction.reading.map(|reading| {
            let settings = reading.settings().into_iter();
            settings.map(|(key, v)| (key.to_owned(), v)).collect()
        }),
        warnings: prediction.warnings.clone(),
        rule_note: prediction.rule_note.clone(),
        rule: prediction.rule.map(|rule| rule.to_string()),
    };
    let said = serde_json::to_string(&said).unwrap_or_default();
    let metadata = HashMap::from([
        ("inference_secs".to_owned(), secs.to_string()),
        ("checksum".to_owned(), checksum(&said, &arrays)),
        ("prediction".to_owned(), said),
    ]);
    write_arrays(path, &arrays, Some(metadata))
}

/// Reads a file of [`write_prediction`]: the prediction, and the time it took in seconds.
///
/// # Errors
/// If the file cannot be read or is damaged.
pub(in crate::evaluate) fn read_prediction(
    path: &Path,
) -> Result<(GaussianPrediction, f64), PredictionFileError> {
    let damaged = || PredictionFileError::Damaged(path.to_owned());
    let bytes = std::fs::read(path).map_err(FileError::new(path, "read"))?;
    let (_, header) = SafeTensors::read_metadata(&bytes).map_err(|_| damaged())?;
    let metadata = header.metadata().clone().ok_or_else(damaged)?;
    let text = |name: &str| metadata.get(name).cloned().ok_or_else(damaged);
    let said = text("prediction")?;
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
    if checksum(&said, &arrays) != text("checksum")? {
        return Err(damaged());
    }
    let first_layer = arrays.iter().find(|array| array.name == "first_layer");
    let first_layer = first_layer.and_then(|Array { shape, bytes, .. }| {
        let values = bytes.as_chunks().0.iter().map(|b| f32::from_le_bytes(*b));
        DepthMap::from_vec(shape[1] as u32, shape[0] as u32, values.collect())
    });
    let said: Said = serde_json::from_str(&said).map_err(|_| damaged())?;
    let reading = said.reading.map(|settings| {
        let mut reading = FileReading::default();
        let set = settings.iter().map(|(key, value)| reading.set(key, value));
        set.collect::<Result<(), String>>().map(|()| reading)
    });
    let rule = said.rule.map(|rule| rule.parse()).transpose();
    let mut gaussians = read_arrays(path)?;
    if let Some(Array { shape, bytes, .. }) = arrays.iter().find(|a| a.name == "harmonics") {
        let values = bytes.as_chunks().0.iter().map(|b| f32::from_le_bytes(*b));
        let values: Vec<f32> = values.collect();
        gaussians.harmonics = Harmonics {
            degree: (shape[1] + 1).isqrt() - 1,
            coefficients: values.as_chunks::<3>().0.to_vec(),
        };
    }
    let prediction = GaussianPrediction {
        gaussians,
        rule: rule.map_err(|_| damaged())?,
        rule_note: said.rule_note,
        space: said
            .camera_from_gaussians
            .map_or(GaussianSpace::Normalized, |map| {
                GaussianSpace::Camera(DAffine3::from_cols_array(&map))
            }),
        first_layer,
        extras: said.extras,
        reading: reading.transpose().map_err(|_| damaged())?,
        warnings: said.warnings,
    };
    Ok((prediction, secs))
}

/// Arrays of a prediction, in hashing order.
const ARRAYS: [&str; 7] = [
    "means",
    "quats_wxyz",
    "scales",
    "opacities",
    "colors_linear",
    "harmonics",
    "first_layer",
];

fn checksum(said: &str, arrays: &[Array]) -> String {
    let mut hasher = StableHasher::default();
    hasher.add("prediction", said);
    for Array { name, shape, bytes } in arrays {
        hasher.add(name, &format!("{shape:?} {}", sha256_hex(bytes)));
    }
    hasher.finish()
}
