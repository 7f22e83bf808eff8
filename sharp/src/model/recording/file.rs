//! Reading a recording.

use std::collections::BTreeSet;
use std::path::Path;

use serde_json::Value;
use sharp_checkpoint::{Checkpoint, DType};

use crate::model::ModelError;

#[derive(Debug)]
pub struct Recording {
    file: Checkpoint,
}

#[derive(Debug, Clone, PartialEq)]
pub struct RecordedInput {
    /// Name or path of the image.
    pub image: String,
    pub width: u32,
    pub height: u32,
    pub focal_px: f64,
}

#[derive(Debug, Clone, PartialEq)]
pub struct RecordedStage {
    pub shape: Vec<usize>,
    /// Largest absolute value of the whole stage.
    pub absmax: f64,
    pub values: RecordedValues,
}

#[derive(Debug, Clone, PartialEq)]
pub enum RecordedValues {
    /// All values, in C order.
    Whole(Vec<f32>),
    /// A sample of the values: positions in C order, all within the shape, and the values at these
    /// positions.
    Sampled(Vec<usize>, Vec<f32>),
}

impl Recording {
    /// Opens a recording.
    ///
    /// # Errors
    /// [`ModelError::Checkpoint`] if the file is not safetensors, [`ModelError::File`] if the file
    /// contains no stages.
    pub fn open(path: &Path) -> Result<Self, ModelError> {
        let recording = Self {
            file: Checkpoint::open(path)?,
        };
        if recording.prefixes().is_empty() {
            return Err(recording.error("it contains no stages, so it is not a recording"));
        }
        Ok(recording)
    }

    /// Prefixes, one per image, sorted.
    pub fn prefixes(&self) -> Vec<&str> {
        let prefix = |name: &'_ str| {
            let (prefix, rest) = name.split_once('/')?;
            rest.ends_with(".shape").then_some(prefix.len())
        };
        let found: BTreeSet<&str> = self
            .file
            .names()
            .filter_map(|name| prefix(name).map(|len| &name[..len]))
            .collect();
        found.into_iter().collect()
    }

    /// Names of the stages under `prefix`, sorted.
    pub fn stages(&self, prefix: &str) -> Vec<&str> {
        self.file
            .names()
            .filter_map(|name| name.strip_prefix(prefix)?.strip_prefix('/'))
            .filter_map(|name| name.strip_suffix(".shape"))
            .collect()
    }

    /// Input from which the stages under `prefix` were computed, if recorded in the file.
    pub fn input(&self, prefix: &str) -> Option<RecordedInput> {
        let metadata = self.file.metadata();
        let from_json = |text: &String| {
            let all: Value = serde_json::from_str(text).ok()?;
            let one = all.get(prefix)?;
            Some(RecordedInput {
                image: one.get("image")?.as_str()?.to_owned(),
                width: u32::try_from(one.get("width")?.as_u64()?).ok()?,
                height: u32::try_from(one.get("height")?.as_u64()?).ok()?,
                focal_px: one.get("f_px")?.as_f64()?,
            })
        };
        let flat = || {
            Some(RecordedInput {
                image: metadata.get("image")?.clone(),
                width: metadata.get("width")?.parse().ok()?,
                height: metadata.get("height")?.parse().ok()?,
                focal_px: metadata.get("f_px")?.parse().ok()?,
            })
        };
        metadata.get("inputs").map_or_else(flat, from_json)
    }

    /// Prefix for an image file: the only prefix, or the prefix whose recorded image has the file's
    /// name, or the prefix with which the file's name starts.
    ///
    /// # Errors
    /// [`ModelError::File`], listing the available prefixes, if none or several match.
    pub fn prefix_for(&self, image: &Path) -> Result<&str, ModelError> {
        let prefixes = self.prefixes();
        if let [only] = prefixes[..] {
            return Ok(only);
        }
        let file_name = image.file_name().unwrap_or_default().to_string_lossy();
        let fits = |prefix: &&&str| {
            let recorded = self.input(prefix).map(|input| input.image);
            let recorded = recorded.as_deref().map(Path::new);
            let same = recorded.and_then(Path::file_name);
            same.is_some_and(|name| name.to_string_lossy() == file_name)
                || file_name.starts_with(**prefix)
        };
        let fitting: Vec<&&str> = prefixes.iter().filter(fits).collect();
        match fitting[..] {
            [one] => Ok(one),
            _ => Err(self.error(format!(
                "cannot determine the prefix for {file_name}; available: {}",
                prefixes.join(", ")
            ))),
        }
    }

    /// Reads a stage.
    ///
    /// # Errors
    /// [`ModelError::Checkpoint`] if the stage is missing, [`ModelError::File`] if the stage's
    /// parts are inconsistent.
    pub fn stage(&self, prefix: &str, stage: &str) -> Result<RecordedStage, ModelError> {
        let key = format!("{prefix}/{stage}");
        let bad = |what: &str| self.error(format!("stage {key}: {what}"));
        let index = |v: i64| usize::try_from(v).map_err(|_| bad("a negative index"));
        let shape: Vec<usize> = self
            .numbers(&format!("{key}.shape"), DType::I64, i64::from_le_bytes)?
            .into_iter()
            .map(index)
            .collect::<Result<_, _>>()?;
        let count = shape.iter().try_fold(1_usize, |n, &d| n.checked_mul(d));
        let count = count.ok_or_else(|| bad("impossible shape"))?;
        let stats = self.numbers(&format!("{key}.stats"), DType::F64, f64::from_le_bytes)?;
        let absmax = match stats[..] {
            [_, _, absmax, _, _] if absmax.is_finite() && absmax >= 0.0 => absmax,
            _ => return Err(bad("statistics are not five finite numbers")),
        };
        let values = if self.file.contains(&key) {
            let values = self.file.tensor_f32(&key)?;
            if values.len() != count {
                return Err(bad("values do not fill the shape"));
            }
            RecordedValues::Whole(values)
        } else {
            let indices =
                self.numbers(&format!("{key}.indices"), DType::I64, i64::from_le_bytes)?;
            let indices: Vec<usize> = indices.into_iter().map(index).collect::<Result<_, _>>()?;
            let values = self.file.tensor_f32(&format!("{key}.values"))?;
            if values.len() != indices.len() || indices.iter().any(|&i| i >= count) {
                return Err(bad("samples do not fit the shape"));
            }
            RecordedValues::Sampled(indices, values)
        };
        Ok(RecordedStage {
            shape,
            absmax,
            values,
        })
    }

    fn numbers<T>(
        &self,
        key: &str,
        dtype: DType,
        decode: impl Fn([u8; 8]) -> T,
    ) -> Result<Vec<T>, ModelError> {
        if self.file.dtype(key)? != dtype {
            return Err(self.error(format!("{key} is not {}", dtype.name())));
        }
        let bytes = self.file.tensor_bytes(key)?;
        Ok(bytes.as_chunks().0.iter().map(|b| decode(*b)).collect())
    }

    pub(super) fn error(&self, reason: impl ToString) -> ModelError {
        ModelError::file(self.file.path(), reason)
    }
}
