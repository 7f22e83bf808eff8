//! A map's two files.

use std::path::{Path, PathBuf};

use super::drawing::drawing;
use super::map::LocalMap;
use crate::io::atomic_files::FileError;
use crate::io::rendering_files::{write_exr_channels, write_png};

/// Where a map lies.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MapFiles {
    /// In false colours with a colour bar.
    pub png: PathBuf,
    /// The values, one f32 channel `Y` at the picture's size; NaN where the metric has none.
    pub exr: PathBuf,
}

/// Writes `FOLDER/NAME.<alias>.png` and `.exr`.
///
/// # Errors
/// Names the file and the reason.
pub fn write_map(folder: &Path, name: &str, map: &LocalMap) -> Result<MapFiles, FileError> {
    let path = |extension| folder.join(format!("{name}.{}.{extension}", map.alias));
    let files = MapFiles {
        png: path("png"),
        exr: path("exr"),
    };
    write_png(&files.png, &drawing(map))?;
    let (width, height) = map.values.dimensions();
    let size = (width as usize, height as usize);
    let channel = ("Y".to_owned(), map.values.as_raw().as_slice());
    write_exr_channels(&files.exr, size, &[channel])?;
    Ok(files)
}
