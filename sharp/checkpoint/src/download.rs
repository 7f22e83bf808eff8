//! HTTP download of one large file. Interrupted transfers are resumed, and the size is checked before any data is
//! transferred.

use std::fs::{self, OpenOptions};
use std::io::{self, Read, Write};
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};
use std::time::Duration;

#[derive(Debug, thiserror::Error)]
pub enum DownloadError {
    /// A local file or folder cannot be read or written.
    #[error("{}: {source}", path.display())]
    Io { path: PathBuf, source: io::Error },
    /// The server could not be reached, or the transfer failed repeatedly.
    #[error("{address}: {reason}")]
    Transfer {
        address: String,
        /// Reason for the last failure.
        reason: String,
    },
    /// The server sent something other than the expected file.
    #[error("{address}: {reason}")]
    Unexpected {
        address: String,
        /// Description of what was sent and what was expected.
        reason: String,
    },
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Progress {
    /// Bytes received so far, including those of earlier attempts.
    pub done: u64,
    /// Total size of the file as announced by the server.
    pub total: u64,
}

/// A published file to download.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Download {
    pub address: String,
    /// Accepted sizes in bytes. The download is refused if the server announces any other size.
    pub sizes: RangeInclusive<u64>,
    /// The published size in words, for messages.
    pub size_text: String,
}

/// Maximum number of consecutive attempts that transfer no new byte.
pub const ATTEMPTS: usize = 3;

impl Download {
    /// Downloads the whole file to `part`.
    ///
    /// A transfer interrupted during this or an earlier call is resumed. The call gives up after [`ATTEMPTS`]
    /// consecutive attempts without a new byte. If the server reports that its file has changed in the meantime, the
    /// download starts over. Proxies are configured by the usual environment variables.
    ///
    /// # Errors
    /// [`DownloadError`] with the address and the reason. The bytes received so far stay in `part`.
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

    /// Performs one request, starting at byte `start`.
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
        // The server's answer if the partial file is already complete.
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
            // The partial file is unusable; the next call starts over.
            remove(part)?;
            remove(&tag_file(part))?;
        }
        if !matches!(status, 200 | 206) {
            return Err(self.unexpected(format!("the server answered with status {status}")));
        }
        if header("content-type").is_some_and(|kind| kind.starts_with("text/")) {
            return Err(self.unexpected(
                "the server sent text instead of the file (a login or proxy page?)".to_owned(),
            ));
        }
        let announced = header("content-length").and_then(|value| value.parse::<u64>().ok());
        let Some(announced) = announced else {
            return Err(self.unexpected("the server did not send the file's size".to_owned()));
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
        // Reads no more than the announced size, whatever is sent.
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
            return Err(self.broken(format!("interrupted after {done} of {total} bytes")));
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

/// Path of the file that stores the server's version tag for the partial file `part`.
fn tag_file(part: &Path) -> PathBuf {
    let mut name = part.as_os_str().to_owned();
    name.push(".etag");
    name.into()
}

/// Stores the server's version tag (ETag) if it is strong: only strong tags guarantee identical bytes.
fn remember_tag(part: &Path, tag: Option<String>) -> Result<(), DownloadError> {
    let file = tag_file(part);
    match tag.filter(|tag| tag.starts_with('"')) {
        Some(tag) => fs::write(&file, tag).map_err(|source| io_error(&file, source)),
        None => remove(&file),
    }
}

/// Removes a file if it exists.
///
/// # Errors
/// [`DownloadError::Io`] if an existing file cannot be removed.
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
