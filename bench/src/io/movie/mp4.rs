//! MP4 through an installed ffmpeg: H.264, which every player and browser supports.

use std::borrow::Cow;
use std::fs::File;
use std::io::{self, Read, Seek, Write};
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStdin, Command, Stdio};

use image::RgbImage;

use super::{Movie, MovieError, check_size};
use crate::io::atomic_files::{FileError, PartialFile};

const FFMPEG: &str = "ffmpeg";

/// Converts to YUV with BT.709's matrix in video range. The file declares matrix and range, so that
/// players need not guess. Transfer function and primaries stay sRGB's.
const FILTER: &str = "scale=out_color_matrix=bt709:out_range=tv,format=yuv420p";

/// First line of `ffmpeg -version`; `None` if ffmpeg is not installed.
pub fn ffmpeg_version() -> Option<String> {
    let said = Command::new(FFMPEG)
        .arg("-version")
        .stdin(Stdio::null())
        .stderr(Stdio::null())
        .output()
        .ok()?;
    let text = String::from_utf8_lossy(&said.stdout);
    said.status
        .success()
        .then(|| text.lines().next().map(str::to_owned))?
}

/// A running ffmpeg that receives frames.
pub struct Mp4Movie {
    ffmpeg: Running,
    input: Option<ChildStdin>,
    errors: File,
    file: PartialFile,
    size: (u32, u32),
}

/// Repeats the last row or column of a frame with an odd side, because chroma is shared by 2 × 2 pixels.
fn with_even_sides(frame: &RgbImage) -> Cow<'_, RgbImage> {
    let (width, height) = frame.dimensions();
    let (even_width, even_height) = (width.next_multiple_of(2), height.next_multiple_of(2));
    if (width, height) == (even_width, even_height) {
        return Cow::Borrowed(frame);
    }
    Cow::Owned(RgbImage::from_fn(even_width, even_height, |x, y| {
        *frame.get_pixel(x.min(width - 1), y.min(height - 1))
    }))
}

/// A child process that is killed when dropped.
struct Running(Child);

impl Drop for Running {
    fn drop(&mut self) {
        // The process may already have ended.
        let _ = self.0.kill();
        let _ = self.0.wait();
    }
}

impl Mp4Movie {
    /// Starts ffmpeg on a movie of `size` pixels; the file's sides are rounded up to even numbers.
    pub fn create(path: &Path, (width, height): (u32, u32), fps: u32) -> Result<Self, MovieError> {
        let failed = |error: io::Error| MovieError::Ffmpeg {
            path: path.to_owned(),
            reason: error.to_string(),
        };
        let file = PartialFile::create(path)?;
        // Use a file, not a pipe, so that ffmpeg never blocks on its error output.
        let errors = tempfile::tempfile().map_err(FileError::new(path, "write"))?;
        let mut command = Command::new(FFMPEG);
        command
            .args(["-hide_banner", "-loglevel", "error", "-nostdin", "-y"])
            .args(["-f", "rawvideo", "-pixel_format", "rgb24"])
            .args([
                "-video_size",
                &format!(
                    "{}x{}",
                    width.next_multiple_of(2),
                    height.next_multiple_of(2)
                ),
            ])
            .args(["-framerate", &fps.to_string(), "-i", "pipe:0"])
            .args(["-an", "-vf", FILTER, "-c:v", "libx264", "-crf", "16"])
            .args(["-colorspace", "bt709", "-color_primaries", "bt709"])
            .args(["-color_trc", "iec61966-2-1", "-color_range", "tv"])
            .args(["-movflags", "+faststart", "-f", "mp4"])
            .arg(file.temporary_path())
            .stdin(Stdio::piped())
            .stdout(Stdio::null())
            .stderr(errors.try_clone().map_err(failed)?);
        let mut ffmpeg = match command.spawn() {
            Ok(child) => Running(child),
            Err(error) if error.kind() == io::ErrorKind::NotFound => {
                return Err(MovieError::NoFfmpeg {
                    path: path.to_owned(),
                });
            }
            Err(error) => return Err(failed(error)),
        };
        Ok(Self {
            input: ffmpeg.0.stdin.take(),
            ffmpeg,
            errors,
            file,
            size: (width, height),
        })
    }

    /// ffmpeg's last error message, or `otherwise` if there is no message.
    fn failed(&mut self, otherwise: &str) -> MovieError {
        let mut said = String::new();
        // If ffmpeg's output cannot be read, use `otherwise`.
        let _ = self.errors.rewind();
        let _ = (&mut self.errors).take(1 << 16).read_to_string(&mut said);
        let last = said.lines().rfind(|line| !line.trim().is_empty());
        MovieError::Ffmpeg {
            path: self.path(),
            reason: last.unwrap_or(otherwise).trim().to_owned(),
        }
    }

    fn path(&self) -> PathBuf {
        self.file.path().to_owned()
    }
}

impl Movie for Mp4Movie {
    fn push(&mut self, frame: &RgbImage) -> Result<(), MovieError> {
        check_size(&self.path(), frame, self.size)?;
        let written = match &mut self.input {
            Some(input) => input.write_all(with_even_sides(frame).as_raw()),
            None => Err(io::ErrorKind::BrokenPipe.into()),
        };
        written.map_err(|error| {
            // ffmpeg closed its input: wait for its final error message.
            let _ = self.ffmpeg.0.wait();
            self.failed(&error.to_string())
        })
    }

    fn finish(mut self: Box<Self>) -> Result<(), MovieError> {
        drop(self.input.take());
        match self.ffmpeg.0.wait() {
            Ok(status) if status.success() => Ok(self.file.commit()?),
            Ok(status) => Err(self.failed(&status.to_string())),
            Err(error) => Err(self.failed(&error.to_string())),
        }
    }
}
