//! Download of published weights: resumable, verified by size and hash, and reduced to the features.

use std::path::{Path, PathBuf};

use sharp_checkpoint::download::{Download, DownloadError, Progress, remove};
use sharp_checkpoint::hash::file_sha256;
use sharp_checkpoint::{Checkpoint, CheckpointError};

use super::{Published, Weights, WeightsError};

#[derive(Debug, thiserror::Error)]
pub enum FetchError {
    /// Network access is disabled.
    #[error("{address}: not downloaded, because --offline was given")]
    Offline { address: String },
    /// The transfer failed, or a file or folder of the cache could not be accessed.
    #[error(transparent)]
    Download(#[from] DownloadError),
    /// The server sent a file that differs from the published file.
    #[error(
        "{address}: the file's sha256 is {found}, but should begin with {expected}; it was deleted"
    )]
    Hash {
        address: String,
        found: String,
        expected: String,
    },
    /// The downloaded file is not a checkpoint.
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    /// The downloaded file is not this network.
    #[error(transparent)]
    Weights(#[from] WeightsError),
}

/// Downloads published weights into a cache folder and returns the path of the features-only copy.
/// Does nothing if a valid copy already exists.
///
/// A transfer that was interrupted during this or an earlier call is resumed. Before anything is
/// transferred, the size must equal the published one; afterwards, the hash must start with the
/// published digits. Invalid files are deleted. The copy records the full hash of the original.
/// Proxies are configured by the usual environment variables.
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
