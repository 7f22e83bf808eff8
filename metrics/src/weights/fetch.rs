//! Fetching published weights: resumed after a break, checked by size and hash, reduced to the
//! features.

use std::fs::{File, OpenOptions};
use std::io::{Read, Write};
use std::path::{Path, PathBuf};

use sha2::{Digest, Sha256};
use sharp_checkpoint::{Checkpoint, CheckpointError};

use super::{Backbone, Published, Weights, WeightsError};

/// Why weights were not fetched.
#[derive(Debug, thiserror::Error)]
pub enum FetchError {
    /// The network must not be used.
    #[error(
        "{address}: not fetched, because --offline was given; fetch it elsewhere and pass \
         --weights {backbone}=FILE"
    )]
    Offline {
        /// The network.
        backbone: Backbone,
        /// Where the file is.
        address: String,
    },
    /// A file or folder of the cache cannot be written or read.
    #[error("{}: {source}", path.display())]
    Io {
        /// The file or folder.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
    /// The server could not be reached, or the transfer broke again and again.
    #[error("{address}: {reason}")]
    Transfer {
        /// Where the file is.
        address: String,
        /// The last failure.
        reason: String,
    },
    /// The server sent something else.
    #[error("{address}: {reason}")]
    Unexpected {
        /// Where the file is.
        address: String,
        /// What was sent and what was expected.
        reason: String,
    },
    /// What was fetched is no checkpoint.
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    /// What was fetched is not this network.
    #[error(transparent)]
    Weights(#[from] WeightsError),
}

/// How far a transfer has come.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Progress {
    /// Bytes there, those of earlier attempts included.
    pub done: u64,
    /// Bytes of the whole file, as the server says.
    pub total: u64,
}

/// Attempts that may fail one after the other without a single new byte.
const ATTEMPTS: usize = 3;

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
    mut progress: impl FnMut(Progress),
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
            backbone: published.backbone,
            address: published.address.to_string(),
        });
    }
    std::fs::create_dir_all(cache).map_err(|source| io(cache, source))?;
    let part = cache.join(format!("{}.part", published.file));
    transfer(published, &part, &mut progress)?;
    let found = sha256(&part)?;
    if !found.starts_with(&*published.sha256_prefix) {
        remove(&part)?;
        return Err(unexpected(
            published,
            format!(
                "the file's sha256 is {found}, but should begin with {}; it was deleted",
                published.sha256_prefix
            ),
        ));
    }
    Checkpoint::open(&part)?.convert(&kept, |name| !name.starts_with("classifier."))?;
    check()?;
    remove(&part)?;
    Ok(kept)
}

/// Brings the whole file to `part`, resuming as often as that brings something.
fn transfer(
    published: &Published,
    part: &Path,
    progress: &mut impl FnMut(Progress),
) -> Result<(), FetchError> {
    let mut failures = 0;
    loop {
        let before = length(part)?;
        match attempt(published, part, before, progress) {
            Ok(()) => return Ok(()),
            Err(FetchError::Transfer { address, reason }) => {
                failures = if length(part)? > before {
                    0
                } else {
                    failures + 1
                };
                if failures == ATTEMPTS {
                    return Err(FetchError::Transfer { address, reason });
                }
            }
            Err(other) => return Err(other),
        }
    }
}

/// One request, from byte `start` on.
fn attempt(
    published: &Published,
    part: &Path,
    start: u64,
    progress: &mut impl FnMut(Progress),
) -> Result<(), FetchError> {
    if start > 0 && published.has_size(start) {
        return Ok(());
    }
    let broken = |reason: String| FetchError::Transfer {
        address: published.address.to_string(),
        reason,
    };
    let config = ureq::Agent::config_builder()
        .http_status_as_error(false)
        .timeout_connect(Some(std::time::Duration::from_secs(30)))
        .timeout_recv_response(Some(std::time::Duration::from_secs(60)))
        .build();
    let mut request = config.new_agent().get(&*published.address);
    if start > 0 {
        request = request.header("Range", format!("bytes={start}-"));
    }
    let response = request.call().map_err(|error| broken(error.to_string()))?;
    let header = |name: &str| {
        let value = response.headers().get(name)?;
        Some(value.to_str().ok()?.to_owned())
    };
    let status = response.status().as_u16();
    if status >= 500 {
        return Err(broken(format!("the server answered with status {status}")));
    }
    if !matches!(status, 200 | 206) {
        return Err(unexpected(
            published,
            format!("the server answered with status {status}"),
        ));
    }
    if header("content-type").is_some_and(|kind| kind.starts_with("text/")) {
        return Err(unexpected(
            published,
            "the server sent a page of text, not weights (a login or proxy page?)".to_owned(),
        ));
    }
    let announced: Option<u64> = header("content-length").and_then(|value| value.parse().ok());
    let Some(announced) = announced else {
        return Err(unexpected(
            published,
            "the server does not say how long the file is".to_owned(),
        ));
    };
    let range = format!("bytes {start}-");
    let resumed =
        status == 206 && header("content-range").is_some_and(|value| value.starts_with(&range));
    let start = if resumed { start } else { 0 };
    let total = start + announced;
    if (status == 206 && !resumed) || !published.has_size(total) {
        remove(part)?;
        return Err(unexpected(
            published,
            format!(
                "the server announced {total} bytes, but the published size is {:.3} MiB",
                published.size_milli_mib as f64 / 1000.0
            ),
        ));
    }
    let mut file = OpenOptions::new()
        .create(true)
        .append(resumed)
        .write(true)
        .truncate(!resumed)
        .open(part)
        .map_err(|source| io(part, source))?;
    // Never more than announced, whatever is sent.
    let mut body = response.into_body().into_reader().take(announced);
    let mut buffer = vec![0; 1 << 16];
    let mut done = start;
    loop {
        let count = body.read(&mut buffer).map_err(|e| broken(e.to_string()))?;
        if count == 0 {
            break;
        }
        file.write_all(&buffer[..count])
            .map_err(|source| io(part, source))?;
        done += count as u64;
        progress(Progress { done, total });
    }
    if done < total {
        return Err(broken(format!("broken off after {done} of {total} bytes")));
    }
    file.sync_all().map_err(|source| io(part, source))
}

fn sha256(path: &Path) -> Result<String, FetchError> {
    let mut file = File::open(path).map_err(|source| io(path, source))?;
    let mut hash = Sha256::new();
    let mut buffer = vec![0; 1 << 20];
    loop {
        let count = file.read(&mut buffer).map_err(|source| io(path, source))?;
        if count == 0 {
            break;
        }
        hash.update(&buffer[..count]);
    }
    let digest = hash.finalize();
    Ok(digest.iter().map(|byte| format!("{byte:02x}")).collect())
}

/// Length of the file; 0 if it does not exist.
fn length(path: &Path) -> Result<u64, FetchError> {
    match std::fs::metadata(path) {
        Ok(metadata) => Ok(metadata.len()),
        Err(error) if error.kind() == std::io::ErrorKind::NotFound => Ok(0),
        Err(source) => Err(io(path, source)),
    }
}

fn remove(path: &Path) -> Result<(), FetchError> {
    match std::fs::remove_file(path) {
        Err(source) if source.kind() != std::io::ErrorKind::NotFound => Err(io(path, source)),
        _ => Ok(()),
    }
}

fn io(path: &Path, source: std::io::Error) -> FetchError {
    FetchError::Io {
        path: path.to_owned(),
        source,
    }
}

fn unexpected(published: &Published, reason: String) -> FetchError {
    FetchError::Unexpected {
        address: published.address.to_string(),
        reason,
    }
}

#[cfg(test)]
mod tests;
