//! Errors of opening and reading checkpoints; each names the file and one reason.

use std::path::{Path, PathBuf};

/// Maximum length of a pickle, in bytes. SHARP's 1038 tensors take 0.3 MB.
pub(crate) const MAX_PICKLE_LEN: usize = 32 << 20;

/// A checkpoint cannot be read, or does not contain what was requested.
#[derive(Debug, thiserror::Error)]
pub enum CheckpointError {
    #[error("{}: {source}", path.display())]
    Io {
        path: PathBuf,
        source: std::io::Error,
    },
    /// The file violates its format or is inconsistent.
    #[error("{}: {reason}", path.display())]
    Malformed { path: PathBuf, reason: String },
    /// The pickle refers to a function or class that a state dict does not need. Nothing is
    /// called.
    #[error("{}: the pickle refers to '{global}', which is not part of a plain state dict; \
             save the state dict alone (torch.save(model.state_dict(), …))", path.display())]
    ForbiddenGlobal {
        path: PathBuf,
        /// Module and name as written in the pickle.
        global: String,
    },
    /// The file contains several state dicts, or none.
    #[error("{}: {reason}", path.display())]
    StateDict {
        path: PathBuf,
        /// The state dicts found and their keys, or what was found instead.
        reason: String,
    },
    #[error("{}: no tensor '{name}'", path.display())]
    NoTensor { path: PathBuf, name: String },
}

/// An error without the file's name, which the caller adds.
#[derive(Debug)]
pub(crate) enum Fault {
    Io(std::io::Error),
    Malformed(String),
    /// The pickle continues beyond this many bytes; no more were read.
    CutOff(usize),
    ForbiddenGlobal(String),
    StateDict(String),
}

impl Fault {
    pub(crate) fn at(self, path: &Path) -> CheckpointError {
        let path = path.to_path_buf();
        match self {
            Self::Io(source) => CheckpointError::Io { path, source },
            Self::Malformed(reason) => CheckpointError::Malformed { path, reason },
            Self::CutOff(at) => {
                let reason = format!(
                    "pickle: no end within {at} bytes (the file is truncated, or the pickle exceeds \
                     {MAX_PICKLE_LEN} bytes)"
                );
                CheckpointError::Malformed { path, reason }
            }
            Self::ForbiddenGlobal(global) => CheckpointError::ForbiddenGlobal { path, global },
            Self::StateDict(reason) => CheckpointError::StateDict { path, reason },
        }
    }
}

/// Shorthand for `Err(Fault::Malformed(format!(…)))`.
macro_rules! malformed {
    ($($arg:tt)*) => {
        Err($crate::error::Fault::Malformed(format!($($arg)*)))
    };
}
pub(crate) use malformed;
