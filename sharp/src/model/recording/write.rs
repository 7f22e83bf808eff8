//! Writing a recording.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::path::Path;

use sharp_checkpoint::deterministic::{fnv1a64, splitmix64};
use sharp_checkpoint::{DType, OutTensor, write_safetensors};

use super::{SAMPLES, observe};
use crate::model::ModelError;
use crate::model::observer::{StageObserver, StageValue};
use crate::model::predictor::{Planes, Predictor};

#[derive(Debug, Clone)]
pub struct RecordOptions {
    /// Prefix of the stages, which identifies the image.
    pub prefix: String,
    /// Stages with at most this many values are written completely, larger stages only at 512
    /// positions.
    pub whole_up_to: usize,
    /// Additional metadata for the file's header, such as the checkpoint's hash.
    pub metadata: BTreeMap<String, String>,
}

impl Default for RecordOptions {
    fn default() -> Self {
        Self {
            prefix: "image".into(),
            whole_up_to: 1 << 16,
            metadata: BTreeMap::new(),
        }
    }
}

/// Predicts from `image` and writes every stage to `out`, in the format that [`compare`](super::compare()) reads.
///
/// # Errors
/// [`ModelError`] of the prediction; [`ModelError::Checkpoint`] if `out` cannot be written.
pub fn record(
    predictor: &Predictor,
    image: Planes<'_>,
    focal_px: f64,
    options: &RecordOptions,
    out: &Path,
) -> Result<(), ModelError> {
    let mut recorder = Recorder {
        options,
        tensors: BTreeMap::new(),
    };
    observe(predictor, image, focal_px, &mut recorder)?;
    let mut metadata = options.metadata.clone();
    for (key, value) in [
        ("image", options.prefix.clone()),
        ("width", image.width.to_string()),
        ("height", image.height.to_string()),
        ("f_px", focal_px.to_string()),
    ] {
        metadata.insert(key.to_owned(), value);
    }
    let tensors = recorder.tensors;
    let list: Vec<OutTensor> = tensors
        .iter()
        .map(|(name, (dtype, shape, _))| OutTensor {
            name: name.clone(),
            dtype: *dtype,
            shape: shape.clone(),
        })
        .collect();
    Ok(write_safetensors(out, &metadata, &list, |tensor| {
        let bytes = tensors
            .get(&tensor.name)
            .map(|(_, _, bytes)| bytes.as_slice());
        Ok(Cow::Borrowed(bytes.unwrap_or_default()))
    })?)
}

struct Recorder<'a> {
    options: &'a RecordOptions,
    /// Type, shape and bytes of each tensor to write.
    tensors: BTreeMap<String, (DType, Vec<usize>, Vec<u8>)>,
}

impl StageObserver for Recorder<'_> {
    fn stage(&mut self, name: &str, value: StageValue<'_>) -> Result<(), ModelError> {
        let shape = value.shape()?;
        let values = value.to_vec()?;
        let key = format!("{}/{name}", self.options.prefix);
        let mut put = |suffix: &str, dtype, shape: Vec<usize>, bytes: Vec<u8>| {
            self.tensors
                .insert(format!("{key}{suffix}"), (dtype, shape, bytes));
        };
        let floats = |values: &[f32]| values.iter().flat_map(|v| v.to_le_bytes()).collect();
        let integers = |values: &[usize]| {
            values
                .iter()
                .flat_map(|&v| (v as i64).to_le_bytes())
                .collect()
        };
        put(".shape", DType::I64, vec![shape.len()], integers(&shape));
        let stats = statistics(&values);
        let stats = stats.iter().flat_map(|v| v.to_le_bytes()).collect();
        put(".stats", DType::F64, vec![5], stats);
        if values.len() <= self.options.whole_up_to {
            put("", DType::F32, shape, floats(&values));
        } else {
            let indices = sample_indices(name, values.len());
            let sampled: Vec<f32> = indices.iter().map(|&i| values[i]).collect();
            put(".values", DType::F32, vec![SAMPLES], floats(&sampled));
            put(".indices", DType::I64, vec![SAMPLES], integers(&indices));
        }
        Ok(())
    }
}

/// Positions at which a stage of `count` values is sampled; the same for all stages of this name
/// and size.
fn sample_indices(stage: &str, count: usize) -> Vec<usize> {
    let start = fnv1a64(&["idx:", stage]);
    (0..SAMPLES as u64)
        .map(|k| (splitmix64(start.wrapping_add(k)) % count as u64) as usize)
        .collect()
}

/// Mean, population standard deviation, absmax, min, max.
fn statistics(values: &[f32]) -> [f64; 5] {
    let n = values.len().max(1) as f64;
    let wide = || values.iter().map(|&v| f64::from(v));
    let mean = wide().sum::<f64>() / n;
    let variance = wide().map(|v| (v - mean).powi(2)).sum::<f64>() / n;
    let absmax = wide().map(f64::abs).fold(0.0, f64::max);
    let (min, max) = (wide().reduce(f64::min), wide().reduce(f64::max));
    [
        mean,
        variance.sqrt(),
        absmax,
        min.unwrap_or(0.0),
        max.unwrap_or(0.0),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn samples_lie_where_the_official_recordings_have_them() {
        let found = sample_indices("disparity", 4_718_592);
        let official = [
            3_092_882, 2_077_256, 34_532, 839_335, 3_654_126, 1_882_549, 3_927_743, 1_574_108,
        ];
        assert_eq!(found[..8], official);
    }

    #[test]
    fn statistics_are_those_of_a_population() {
        assert_eq!(statistics(&[1.0, -3.0]), [-1.0, 2.0, 3.0, -3.0, 1.0]);
        assert_eq!(statistics(&[]), [0.0; 5]);
    }
}
