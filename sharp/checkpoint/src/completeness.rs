//! Two-way completeness check: every expected tensor is present with its shape, and every tensor present is expected.

use std::collections::BTreeMap;
use std::fmt;
use std::path::PathBuf;

use crate::checkpoint::Checkpoint;

/// A tensor that a model needs.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Expected {
    /// Full name in the state dict.
    pub name: String,
    /// Shape in PyTorch's axis order.
    pub shape: Vec<usize>,
}

/// A tensor whose shape differs from the expected one.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Misshaped {
    pub name: String,
    /// The shape the model needs.
    pub expected: Vec<usize>,
    /// The shape in the file.
    pub found: Vec<usize>,
}

/// All differences between a checkpoint and a model; each list is sorted by name.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub struct Incomplete {
    pub path: PathBuf,
    /// Tensors that are expected, but not in the file.
    pub missing: Vec<Expected>,
    /// Tensors in the file that are neither expected nor allowed to be unused.
    pub surplus: Vec<String>,
    /// Tensors whose shape in the file differs from the expected one.
    pub misshaped: Vec<Misshaped>,
}

impl Incomplete {
    /// Number of tensors that are empty in the file (shape `[0]`) although the model needs values. Training that shares
    /// the weights among processes leaves these placeholders in the file of a single process.
    pub fn placeholders(&self) -> usize {
        self.misshaped.iter().filter(|m| m.found == [0]).count()
    }
}

impl fmt::Display for Incomplete {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(
            f,
            "{}: does not fit the model ({} missing, {} surplus, {} of another shape)",
            self.path.display(),
            self.missing.len(),
            self.surplus.len(),
            self.misshaped.len()
        )?;
        let missing = self.missing.iter();
        list(
            f,
            "missing",
            missing.map(|e| format!("{} {:?}", e.name, e.shape)),
        )?;
        list(f, "surplus", self.surplus.iter().cloned())?;
        let misshaped = self.misshaped.iter();
        let misshaped =
            misshaped.map(|m| format!("{} {:?}, expected {:?}", m.name, m.found, m.expected));
        list(f, "another shape", misshaped)?;
        match self.placeholders() {
            0 => Ok(()),
            empty => write!(
                f,
                "; {empty} of its tensors are empty placeholders (shape [0]), as in the state dict of one process under \
                 DeepSpeed ZeRO-3 or FSDP; gather the whole weights into one file first, with DeepSpeed's \
                 `zero_to_fp32.py` or with FSDP's full state dict"
            ),
        }
    }
}

/// Lists only the first few tensors, so that another network's checkpoint produces one line, not a thousand.
fn list(
    f: &mut fmt::Formatter<'_>,
    what: &str,
    tensors: impl ExactSizeIterator<Item = String>,
) -> fmt::Result {
    const SHOWN: usize = 3;
    let more = tensors.len().saturating_sub(SHOWN);
    for tensor in tensors.take(SHOWN) {
        write!(f, "; {what}: {tensor}")?;
    }
    match more {
        0 => Ok(()),
        more => write!(f, "; {what}: {more} more"),
    }
}

impl Checkpoint {
    /// Compares the file with what a model needs. Entries that are not tensors count as surplus.
    ///
    /// `allow_unused`: prefixes of names. The file may contain tensors with these prefixes even if the model does not
    /// need them.
    ///
    /// # Errors
    /// One [`Incomplete`] with all missing, surplus and misshaped tensors.
    pub fn check(
        &self,
        expected: &[Expected],
        allow_unused: &[impl AsRef<str>],
    ) -> Result<(), Incomplete> {
        let wanted: BTreeMap<&str, &Expected> =
            expected.iter().map(|e| (e.name.as_str(), e)).collect();
        let mut found = Incomplete {
            path: self.path().to_path_buf(),
            missing: Vec::new(),
            surplus: Vec::new(),
            misshaped: Vec::new(),
        };
        for (&name, &tensor) in &wanted {
            match self.shape(name) {
                Err(_) => found.missing.push(tensor.clone()),
                Ok(shape) if shape != tensor.shape => found.misshaped.push(Misshaped {
                    name: name.to_owned(),
                    expected: tensor.shape.clone(),
                    found: shape.to_vec(),
                }),
                Ok(_) => {}
            }
        }
        let allowed = |name: &str| {
            allow_unused
                .iter()
                .any(|prefix| name.starts_with(prefix.as_ref()))
        };
        found.surplus = self
            .names()
            .chain(self.others().iter().map(String::as_str))
            .filter(|name| !wanted.contains_key(name) && !allowed(name))
            .map(str::to_owned)
            .collect();
        found.surplus.sort_unstable();
        if found.missing.is_empty() && found.surplus.is_empty() && found.misshaped.is_empty() {
            Ok(())
        } else {
            Err(found)
        }
    }
}
