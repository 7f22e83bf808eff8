//! Animated GIF with a palette of 256 colours per frame.

use std::io;
use std::path::{Path, PathBuf};

use gif::{EncodingError, Frame, Repeat};
use image::RgbImage;

use super::{Movie, MovieError, check_size};
use crate::io::atomic_files::{FileError, PartialFile};

/// Maximum frames per second, because players slow down a movie whose delays are below two hundredths of a second.
pub const MAX_FPS: u32 = 50;

/// NeuQuant's sampling factor, from 1 (every pixel) to 30.
const SPEED: i32 = 1;

/// A GIF that loops forever.
///
/// Frames with at most 256 colours are stored exactly; for frames with more, NeuQuant computes a
/// palette, without dithering. Delays are in hundredths of a second: at 30 frames per second, some
/// frames last 3 hundredths and some 4, so that the total duration is correct.
pub struct GifMovie {
    encoder: gif::Encoder<PartialFile>,
    path: PathBuf,
    size: (u32, u32),
    fps: u32,
    frames: u64,
}

impl GifMovie {
    /// Starts a movie of `size` pixels.
    ///
    /// # Errors
    /// [`MovieError::Format`] for a side above 65 535 pixels or a rate that is not in 1..=[`MAX_FPS`];
    /// [`MovieError::File`] if the file cannot be created.
    pub fn create(path: &Path, (width, height): (u32, u32), fps: u32) -> Result<Self, MovieError> {
        let format = |reason: String| MovieError::Format {
            path: path.to_owned(),
            reason,
        };
        if !(1..=MAX_FPS).contains(&fps) {
            return Err(format(format!(
                "a GIF can have 1 to {MAX_FPS} frames per second, not {fps}"
            )));
        }
        let (Ok(w), Ok(h)) = (u16::try_from(width), u16::try_from(height)) else {
            return Err(format(format!(
                "{width}x{height}: the sides of a GIF cannot exceed 65535 pixels"
            )));
        };
        let file = PartialFile::create(path)?;
        let mut encoder =
            gif::Encoder::new(file, w, h, &[]).map_err(|error| refused(path, error))?;
        encoder
            .set_repeat(Repeat::Infinite)
            .map_err(|error| refused(path, error))?;
        Ok(Self {
            encoder,
            path: path.to_owned(),
            size: (width, height),
            fps,
            frames: 0,
        })
    }

    /// Start time of frame `index` in hundredths of a second, rounded.
    fn start(&self, index: u64) -> u64 {
        let fps = u64::from(self.fps);
        (200 * index + fps) / (2 * fps)
    }
}

impl Movie for GifMovie {
    fn push(&mut self, image: &RgbImage) -> Result<(), MovieError> {
        check_size(&self.path, image, self.size)?;
        // Both sides fit into u16, as checked when the movie was created.
        let (width, height) = (self.size.0 as u16, self.size.1 as u16);
        let mut frame = Frame::from_rgb_speed(width, height, image.as_raw(), SPEED);
        frame.delay = (self.start(self.frames + 1) - self.start(self.frames)) as u16;
        self.frames += 1;
        self.encoder
            .write_frame(&frame)
            .map_err(|error| refused(&self.path, error))
    }

    fn finish(self: Box<Self>) -> Result<(), MovieError> {
        let Self { encoder, path, .. } = *self;
        let file = encoder
            .into_inner()
            .map_err(|error| refused(&path, error))?;
        Ok(file.commit()?)
    }
}

fn refused(path: &Path, error: EncodingError) -> MovieError {
    let error = match error {
        EncodingError::Io(error) => error,
        other => io::Error::other(other),
    };
    FileError::new(path, "write")(error).into()
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Decodes frames to RGB, with their delays.
    fn decode(path: &Path) -> Vec<(Vec<u8>, u16)> {
        let mut options = gif::DecodeOptions::new();
        options.set_color_output(gif::ColorOutput::RGBA);
        let mut decoder = options
            .read_info(std::fs::File::open(path).unwrap())
            .unwrap();
        let mut frames = Vec::new();
        while let Some(frame) = decoder.read_next_frame().unwrap() {
            let rgb = frame
                .buffer
                .chunks_exact(4)
                .flat_map(|p| p[..3].to_vec())
                .collect();
            frames.push((rgb, frame.delay));
        }
        frames
    }

    #[test]
    fn few_colours_survive_exactly_and_delays_add_up() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.gif");
        let frames: Vec<RgbImage> = (0..30_u8)
            .map(|k| RgbImage::from_fn(16, 9, |x, y| image::Rgb([k, x as u8 * 3, y as u8 * 7])))
            .collect();
        let mut movie = Box::new(GifMovie::create(&path, (16, 9), 30).unwrap());
        for frame in &frames {
            movie.push(frame).unwrap();
        }
        assert!(!path.exists());
        movie.finish().unwrap();
        let found = decode(&path);
        assert_eq!(found.len(), 30);
        for ((rgb, delay), frame) in found.iter().zip(&frames) {
            assert_eq!(rgb, frame.as_raw());
            assert!((3..=4).contains(delay));
        }
        let whole: u16 = found.iter().map(|(_, delay)| delay).sum();
        assert_eq!(whole, 100);
    }

    #[test]
    fn impossible_movies_are_refused() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.gif");
        let error = |size, fps| {
            let error = GifMovie::create(&path, size, fps).err().unwrap();
            error.to_string()
        };
        assert!(error((4, 4), 51).contains("1 to 50"));
        assert!(error((4, 4), 0).contains("not 0"));
        assert!(error((70_000, 4), 10).contains("65535"));
        let mut movie = GifMovie::create(&path, (4, 4), 10).unwrap();
        let other = movie.push(&RgbImage::new(4, 5)).unwrap_err().to_string();
        assert!(other.contains("4x5"));
    }
}
