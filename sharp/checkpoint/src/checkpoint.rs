//! Reading of every supported checkpoint format.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use crate::bytes::{Bytes, OpenFile};
use crate::error::{CheckpointError, Fault, malformed};
use crate::pickle::state_dict::{NamedTensors, resolve};
use crate::pickle::value::Heap;
use crate::tensor::{DType, TensorLayout};
use crate::zip::{Directory, ZipEntry};
use crate::{legacy, pickle, safetensors, zip};

/// An open checkpoint: a file and the validated table of its tensors.
///
/// Opening reads only the table of contents. If the file is modified afterwards, reads return the
/// new values, or an error if the file became shorter.
#[derive(Debug)]
pub struct Checkpoint {
    path: PathBuf,
    file: OpenFile,
    pub(crate) tensors: BTreeMap<String, TensorLayout>,
    pub(crate) others: Vec<String>,
    metadata: BTreeMap<String, String>,
}

impl Checkpoint {
    /// Opens a PyTorch or safetensors file. The format is detected from the content.
    ///
    /// Both of PyTorch's formats are supported: the zip file written since version 1.6, and the sequence of pickles
    /// written before.
    ///
    /// The pickled object is either the state dict itself, or contains exactly one dict of tensors (`state_dict`,
    /// `model`, …), which is then used.
    ///
    /// # Errors
    /// [`CheckpointError`] if the file is unreadable or malformed, if it requests code execution, or if it does not
    /// contain exactly one candidate state dict.
    pub fn open(path: impl AsRef<Path>) -> Result<Self, CheckpointError> {
        let path = path.as_ref();
        let file = OpenFile::open(path).map_err(|error| Fault::Io(error).at(path))?;
        let (named, metadata) = read(&file).map_err(|fault| fault.at(path))?;
        Ok(Self {
            path: path.to_path_buf(),
            file,
            tensors: named.tensors,
            others: named.others,
            metadata,
        })
    }

    pub fn path(&self) -> &Path {
        &self.path
    }

    /// Metadata of a safetensors header; empty for pickles.
    pub fn metadata(&self) -> &BTreeMap<String, String> {
        &self.metadata
    }

    /// Names of all tensors, sorted bytewise.
    pub fn names(&self) -> impl ExactSizeIterator<Item = &str> {
        self.tensors.keys().map(String::as_str)
    }

    /// Keys of the state dict whose values are not tensors, sorted bytewise.
    pub fn others(&self) -> &[String] {
        &self.others
    }

    pub fn contains(&self, name: &str) -> bool {
        self.tensors.contains_key(name)
    }

    /// Shape of a tensor in PyTorch's axis order.
    ///
    /// # Errors
    /// [`CheckpointError::NoTensor`] if the file has no tensor of this name.
    pub fn shape(&self, name: &str) -> Result<&[usize], CheckpointError> {
        Ok(&self.layout(name)?.shape)
    }

    /// Stored element type of a tensor.
    ///
    /// # Errors
    /// [`CheckpointError::NoTensor`] if the file has no tensor of this name.
    pub fn dtype(&self, name: &str) -> Result<DType, CheckpointError> {
        Ok(self.layout(name)?.dtype)
    }

    /// Elements of a tensor as f32 in C order. Half-precision types are widened exactly; doubles and integers are
    /// rounded to the nearest f32.
    ///
    /// # Errors
    /// [`CheckpointError::NoTensor`] if the file has no tensor of this name;
    /// [`CheckpointError::Io`] if the file cannot be read.
    pub fn tensor_f32(&self, name: &str) -> Result<Vec<f32>, CheckpointError> {
        let values = self.layout(name)?.f32(&self.file);
        values.map_err(|fault| fault.at(&self.path))
    }

    /// Elements of a tensor in their stored type, little-endian, in C order.
    ///
    /// # Errors
    /// [`CheckpointError::NoTensor`] if the file has no tensor of this name;
    /// [`CheckpointError::Io`] if the file cannot be read.
    pub fn tensor_bytes(&self, name: &str) -> Result<Vec<u8>, CheckpointError> {
        let bytes = self.layout(name)?.bytes(&self.file);
        bytes.map_err(|fault| fault.at(&self.path))
    }

    /// SHA-256 of the whole file, in lower-case hexadecimal. Reads the entire file.
    ///
    /// # Errors
    /// [`CheckpointError::Io`] if the file cannot be read.
    pub fn sha256(&self) -> Result<String, CheckpointError> {
        let hash = self.file.sha256();
        hash.map_err(|error| Fault::Io(error).at(&self.path))
    }

    fn layout(&self, name: &str) -> Result<&TensorLayout, CheckpointError> {
        self.tensors
            .get(name)
            .ok_or_else(|| CheckpointError::NoTensor {
                path: self.path.clone(),
                name: name.to_owned(),
            })
    }
}

type Read = (NamedTensors, BTreeMap<String, String>);

fn read(file: &(impl Bytes + ?Sized)) -> Result<Read, Fault> {
    let start = file.start(64)?;
    if safetensors::looks_like(&start, file.len()) {
        let contents = safetensors::read(file)?;
        let named = NamedTensors {
            tensors: contents.tensors,
            ..NamedTensors::default()
        };
        Ok((named, contents.metadata))
    } else if start.starts_with(b"PK") {
        Ok((read_zip(file)?, BTreeMap::new()))
    } else if start.first() == Some(&0x80) {
        Ok((legacy::read(file)?, BTreeMap::new()))
    } else {
        malformed!("neither a PyTorch nor a safetensors file{}", guess(&start))
    }
}

/// Guesses the kind of a file that is not a checkpoint from its first bytes.
fn guess(start: &[u8]) -> &'static str {
    let text = start.trim_ascii_start();
    if start.is_empty() {
        ": it is empty"
    } else if text.starts_with(b"<") {
        ": it looks like a web page"
    } else if text.starts_with(b"version https://git-lfs") {
        ": it is a Git LFS pointer; fetch the file that it points to"
    } else {
        " (or its header is damaged)"
    }
}

fn read_zip(file: &(impl Bytes + ?Sized)) -> Result<NamedTensors, Fault> {
    let entries = zip::read(file)?;
    let mut pickles = entries
        .keys()
        .filter_map(|name| name.strip_suffix("data.pkl"))
        .filter(|prefix| prefix.is_empty() || prefix.ends_with('/'));
    let (Some(prefix), None) = (pickles.next(), pickles.next()) else {
        return malformed!("not a checkpoint: the zip file must contain exactly one 'data.pkl'");
    };
    if let Some(ZipEntry::Stored(range)) = entries.get(format!("{prefix}byteorder").as_str())
        && range.len() < 16
        && file.get(range.clone())?.trim_ascii() == b"big"
    {
        return malformed!("written on a big-endian machine, which is not supported");
    }
    let program = file.get(stored(&entries, &format!("{prefix}data.pkl"))?)?;
    let mut heap = Heap::default();
    let (root, _) = pickle::load(&program, &mut heap)?;
    resolve(&heap, root, file.len(), |storage| {
        let range = stored(&entries, &format!("{prefix}data/{}", storage.key))?;
        let told = usize::try_from(storage.numel)
            .ok()
            .and_then(|n| n.checked_mul(storage.dtype.size()));
        if told != Some(range.len()) {
            return malformed!(
                "storage '{}' has {} bytes, but the pickle declares {} elements of {}",
                storage.key,
                range.len(),
                storage.numel,
                storage.dtype
            );
        }
        Ok(range)
    })
}

fn stored(entries: &Directory, name: &str) -> Result<std::ops::Range<usize>, Fault> {
    match entries.get(name) {
        Some(ZipEntry::Stored(range)) => Ok(range.clone()),
        Some(ZipEntry::Unreadable(why)) => malformed!("zip: '{name}' {why}"),
        None => malformed!("zip: '{name}' is missing"),
    }
}

#[cfg(test)]
mod tests;
