//! Fetching one large file over HTTP: resumed after a break, its size checked before anything is transferred.

use std::fs::{self, OpenOptions};
use std::io::{self, Read, Write};
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};
use std::time::Duration;

/// Why a file was not fetched.
#[derive(Debug, thiserror::Error)]
pub enum DownloadError {
    /// A file or folder here cannot be written or read.
    #[error("{}: {source}", path.display())]
    Io { path: PathBuf, source: io::Error },
    /// The server could not be reached, or the transfer broke again and again.
    #[error("{address}: {reason}")]
    Transfer {
        address: String,
        /// The last failure.
        reason: String,
    },
    /// The server sent something else.
    #[error("{address}: {reason}")]
    Unexpected {
        address: String,
        /// What was sent and what was expected.
        reason: String,
    },
}

/// Progress of a transfer.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Progress {
    /// Bytes there, those of earlier attempts included.
    pub done: u64,
    /// Bytes of the whole file, as the server says.
    pub total: u64,
}

/// A published file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Download {
    pub address: String,
    /// Sizes that it may have, bytes. A server that announces another one is not listened to.
    pub sizes: RangeInclusive<u64>,
    /// The published size in words, for messages.
    pub size_text: String,
}

/// Attempts that may fail one after the other without a single new byte.
pub const ATTEMPTS: usize = 3;

impl Download {
    /// Brings the whole file to `part`.
    ///
    /// A transfer that was broken off, now or by an earlier call, is resumed as often as that brings something, unless
    /// the server says that its file has changed meanwhile. Proxies are taken from the usual environment variables.
    ///
    /// # Errors
    /// [`DownloadError`] with the address and the reason. What arrived of a broken transfer stays in `part`.
    pub fn fetch(
        &self,
        part: &Path,
        mut progress: impl FnMut(Progress),
    ) -> Result<(), DownloadError> {
        let mut failures = 0;
        loop {
            let before = length(part)?;
            match self.attempt(part, before, &mut progress) {
                Ok(()) => return remove(&tag_file(part)),
                Err(DownloadError::Transfer { address, reason }) => {
                    failures = if length(part)? > before {
                        0
                    } else {
                        failures + 1
                    };
                    if failures == ATTEMPTS {
                        return Err(DownloadError::Transfer { address, reason });
                    }
                }
                Err(other) => return Err(other),
            }
        }
    }

    /// One request, from byte `start` on.
    fn attempt(
        &self,
        part: &Path,
        start: u64,
        progress: &mut impl FnMut(Progress),
    ) -> Result<(), DownloadError> {
        let config = ureq::Agent::config_builder()
            .http_status_as_error(false)
            .timeout_connect(Some(Duration::from_secs(30)))
            .timeout_recv_response(Some(Duration::from_secs(60)))
            .build();
        let mut request = config.new_agent().get(&self.address);
        if start > 0 {
            request = request.header("Range", format!("bytes={start}-"));
            if let Ok(tag) = fs::read_to_string(tag_file(part)) {
                request = request.header("If-Range", tag);
            }
        }
        let response = request.call().map_err(|e| self.broken(e.to_string()))?;
        let header = |name: &str| {
            let value = response.headers().get(name)?;
            Some(value.to_str().ok()?.to_owned())
        };
        let status = response.status().as_u16();
        // Nothing is left to send: the part is the whole file.
        let whole = format!("bytes */{start}");
        if status == 416
            && self.sizes.contains(&start)
            && header("content-range").as_deref() == Some(&whole)
        {
            return Ok(());
        }
        if status >= 500 {
            return Err(self.broken(format!("the server answered with status {status}")));
        }
        if status == 416 {
            // What is there is of no use; the next call starts anew.
            remove(part)?;
            remove(&tag_file(part))?;
        }
        if !matches!(status, 200 | 206) {
            return Err(self.unexpected(format!("the server answered with status {status}")));
        }
        if header("content-type").is_some_and(|kind| kind.starts_with("text/")) {
            return Err(self.unexpected(
                "the server sent a page of text, not weights (a login or proxy page?)".to_owned(),
            ));
        }
        let announced = header("content-length").and_then(|value| value.parse::<u64>().ok());
        let Some(announced) = announced else {
            return Err(self.unexpected("the server does not say how long the file is".to_owned()));
        };
        let range = format!("bytes {start}-");
        let resumed =
            status == 206 && header("content-range").is_some_and(|value| value.starts_with(&range));
        let start = if resumed { start } else { 0 };
        let total = start.saturating_add(announced);
        if (status == 206 && !resumed) || !self.sizes.contains(&total) {
            remove(part)?;
            return Err(self.unexpected(format!(
                "the server announced {total} bytes, but the published size is {}",
                self.size_text
            )));
        }
        if !resumed {
            remember_tag(part, header("etag"))?;
        }
        let mut file = OpenOptions::new()
            .create(true)
            .append(resumed)
            .write(true)
            .truncate(!resumed)
            .open(part)
            .map_err(|source| io_error(part, source))?;
        // Never more than announced, whatever is sent.
        let mut body = response.into_body().into_reader().take(announced);
        let mut buffer = vec![0; 1 << 16];
        let mut done = start;
        loop {
            let count = body
                .read(&mut buffer)
                .map_err(|e| self.broken(e.to_string()))?;
            if count == 0 {
                break;
            }
            file.write_all(&buffer[..count])
                .map_err(|source| io_error(part, source))?;
            done += count as u64;
            progress(Progress { done, total });
        }
        if done < total {
            return Err(self.broken(format!("broken off after {done} of {total} bytes")));
        }
        file.sync_all().map_err(|source| io_error(part, source))
    }

    fn broken(&self, reason: String) -> DownloadError {
        DownloadError::Transfer {
            address: self.address.clone(),
            reason,
        }
    }

    fn unexpected(&self, reason: String) -> DownloadError {
        DownloadError::Unexpected {
            address: self.address.clone(),
            reason,
        }
    }
}

/// The file that keeps the server's version tag of the partial file `part`.
fn tag_file(part: &Path) -> PathBuf {
    let mut name = part.as_os_str().to_owned();
    name.push(".etag");
    name.into()
}

/// Only strong tags promise equal bytes.
fn remember_tag(part: &Path, tag: Option<String>) -> Result<(), DownloadError> {
    let file = tag_file(part);
    match tag.filter(|tag| tag.starts_with('"')) {
        Some(tag) => fs::write(&file, tag).map_err(|source| io_error(&file, source)),
        None => remove(&file),
    }
}

/// Removes a file, which may be absent.
///
/// # Errors
/// [`DownloadError::Io`].
pub fn remove(path: &Path) -> Result<(), DownloadError> {
    match fs::remove_file(path) {
        Err(source) if source.kind() != io::ErrorKind::NotFound => Err(io_error(path, source)),
        _ => Ok(()),
    }
}

/// Length of the file; 0 if it does not exist.
fn length(path: &Path) -> Result<u64, DownloadError> {
    match fs::metadata(path) {
        Ok(metadata) => Ok(metadata.len()),
        Err(error) if error.kind() == io::ErrorKind::NotFound => Ok(0),
        Err(source) => Err(io_error(path, source)),
    }
}

fn io_error(path: &Path, source: io::Error) -> DownloadError {
    DownloadError::Io {
        path: path.to_owned(),
        source,
    }
}

#[cfg(test)]
mod tests;
