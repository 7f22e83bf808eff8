//! Writing safetensors files.

use std::borrow::Cow;
use std::collections::BTreeMap;
use std::fs::{self, File};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};

use serde_json::{Map, Value, json};

use crate::checkpoint::Checkpoint;
use crate::error::CheckpointError;
use crate::tensor::DType;

#[derive(Debug, Clone, PartialEq, Eq)]
pub struct OutTensor {
    pub name: String,
    pub dtype: DType,
    pub shape: Vec<usize>,
}

/// Writes a safetensors file, one tensor at a time, to a temporary file in the same folder that is renamed once
/// complete. The same input gives the same bytes: tensors are ordered by element size (largest first, so that all are
/// aligned), then by name.
///
/// `data(tensor)` returns the elements, little-endian, in C order.
///
/// # Errors
/// Any error of `data`; [`CheckpointError::Io`] if the file cannot be written; [`CheckpointError::Malformed`] if two
/// tensors share a name or the data does not fill the shape.
pub fn write_safetensors<'a>(
    path: &Path,
    metadata: &BTreeMap<String, String>,
    tensors: &[OutTensor],
    mut data: impl FnMut(&OutTensor) -> Result<Cow<'a, [u8]>, CheckpointError>,
) -> Result<(), CheckpointError> {
    let malformed = |reason: String| CheckpointError::Malformed {
        path: path.to_path_buf(),
        reason,
    };
    let mut order: Vec<&OutTensor> = tensors.iter().collect();
    order.sort_by(|a, b| (b.dtype.size(), &a.name).cmp(&(a.dtype.size(), &b.name)));
    let mut header = Map::new();
    if !metadata.is_empty() {
        header.insert("__metadata__".into(), json!(metadata));
    }
    let mut at = 0_usize;
    let mut lengths = Vec::with_capacity(order.len());
    for tensor in &order {
        let len = tensor
            .shape
            .iter()
            .try_fold(tensor.dtype.size(), |n, &s| n.checked_mul(s))
            .and_then(|len| Some((len, at.checked_add(len)?)));
        let Some((len, end)) = len else {
            return Err(malformed(format!("tensor '{}' is too large", tensor.name)));
        };
        let entry = json!({
            "dtype": tensor.dtype.name(), "shape": tensor.shape, "data_offsets": [at, end],
        });
        if header.insert(tensor.name.clone(), entry).is_some() {
            return Err(malformed(format!(
                "two tensors are named '{}'",
                tensor.name
            )));
        }
        lengths.push(len);
        at = end;
    }
    let mut text = Value::Object(header).to_string();
    while !text.len().is_multiple_of(8) {
        text.push(' ');
    }

    let partial = partial_path(path);
    let io = |source| CheckpointError::Io {
        path: partial.clone(),
        source,
    };
    let written = (|| {
        let mut out = BufWriter::new(File::create(&partial).map_err(io)?);
        out.write_all(&(text.len() as u64).to_le_bytes())
            .map_err(io)?;
        out.write_all(text.as_bytes()).map_err(io)?;
        for (tensor, len) in order.iter().zip(lengths) {
            let bytes = data(tensor)?;
            if bytes.len() != len {
                return Err(malformed(format!(
                    "tensor '{}' needs {len} bytes, but {} were given",
                    tensor.name,
                    bytes.len()
                )));
            }
            out.write_all(&bytes).map_err(io)?;
        }
        out.into_inner()
            .map_err(|e| io(e.into_error()))?
            .sync_all()
            .map_err(io)?;
        fs::rename(&partial, path).map_err(io)
    })();
    if written.is_err() {
        // The original error is more informative than a failure to clean up.
        let _ = fs::remove_file(&partial);
    }
    written
}

fn partial_path(path: &Path) -> PathBuf {
    let mut name = path.file_name().unwrap_or_default().to_os_string();
    name.push(".partial");
    path.with_file_name(name)
}

impl Checkpoint {
    /// Writes the tensors for which `keep(name)` is true to a safetensors file, in their stored
    /// types. The header records this checkpoint's hash as `source_sha256`, unless the metadata
    /// already contains that key; thus, the hash of the original survives repeated conversions.
    ///
    /// # Errors
    /// As for [`write_safetensors`].
    pub fn convert(&self, out: &Path, keep: impl Fn(&str) -> bool) -> Result<(), CheckpointError> {
        let mut metadata = self.metadata().clone();
        if !metadata.contains_key("source_sha256") {
            metadata.insert("source_sha256".to_owned(), self.sha256()?);
        }
        let mut tensors = Vec::new();
        for name in self.names().filter(|name| keep(name)) {
            tensors.push(OutTensor {
                name: name.to_owned(),
                dtype: self.dtype(name)?,
                shape: self.shape(name)?.to_vec(),
            });
        }
        write_safetensors(out, &metadata, &tensors, |t| {
            self.tensor_bytes(&t.name).map(Cow::Owned)
        })
    }
}
