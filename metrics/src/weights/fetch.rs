//! Fetching published weights: resumed after a break, checked by size and hash, reduced to the
//! features.

use std::path::{Path, PathBuf};

use sharp_checkpoint::download::{Download, DownloadError, Progress, remove};
use sharp_checkpoint::hash::file_sha256;
use sharp_checkpoint::{Checkpoint, CheckpointError};

use super::{Published, Weights, WeightsError};

/// Why weights were not fetched.
#[derive(Debug, thiserror::Error)]
pub enum FetchError {
    /// The network must not be used.
    #[error("{address}: --offline was given")]
    Offline { address: String },
    /// The transfer, or a file or folder of the cache.
    #[error(transparent)]
    Download(#[from] DownloadError),
    /// The server sent other bytes than those published.
    #[error(
        "{address}: the file's sha256 is {found}, but should begin with {expected}; it was deleted"
    )]
    Hash {
        address: String,
        found: String,
        expected: String,
    },
    /// What was fetched is no checkpoint.
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    /// What was fetched is not this network.
    #[error(transparent)]
    Weights(#[from] WeightsError),
}

/// Fetches published weights into a cache folder and returns the copy that holds the features
/// only. Does nothing if that copy is there and sound.
///
/// A transfer that was broken off, now or by an earlier call, is resumed. The size must be the
/// published one before anything is transferred, the hash must begin with the published digits
/// afterwards; what fails is deleted. The full hash of the original is kept inside the copy.
/// Proxies are taken from the usual environment variables.
///
/// # Errors
/// [`FetchError`] with the address and the reason.
pub fn fetch(
    published: &Published,
    cache: &Path,
    offline: bool,
    progress: impl FnMut(Progress),
) -> Result<PathBuf, FetchError> {
    let kept = published.cached(cache);
    let check = || {
        let weights = Weights::none().with_file(published.backbone, &kept);
        weights.load(published.backbone).map(drop)
    };
    if kept.is_file() && check().is_ok() {
        return Ok(kept);
    }
    if offline {
        return Err(FetchError::Offline {
            address: published.address.to_string(),
        });
    }
    std::fs::create_dir_all(cache).map_err(|source| DownloadError::Io {
        path: cache.to_owned(),
        source,
    })?;
    let part = cache.join(format!("{}.part", published.file));
    let download = Download {
        address: published.address.to_string(),
        sizes: published.sizes(),
        size_text: format!("{:.3} MiB", published.size_milli_mib as f64 / 1000.0),
    };
    download.fetch(&part, progress)?;
    let found = file_sha256(&part)?;
    if !found.starts_with(&*published.sha256_prefix) {
        remove(&part)?;
        return Err(FetchError::Hash {
            address: download.address,
            found,
            expected: published.sha256_prefix.to_string(),
        });
    }
    Checkpoint::open(&part)?.convert(&kept, |name| !name.starts_with("classifier."))?;
    check()?;
    remove(&part)?;
    Ok(kept)
}

#[cfg(test)]
mod tests;
