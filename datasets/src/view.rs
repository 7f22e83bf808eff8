//! Scenes of posed views whose pixels are loaded on demand: the output of every reader.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use image::{GrayImage, ImageBuffer, Luma, RgbImage};
use sharp::camera::{Intrinsics, RigidTransform};
use sharp::image_file::Header;

use crate::DatasetError;
use crate::left_out::LeftOutViews;
use crate::processing::Processing;
use crate::required_files::FileRole;

/// z-depth in metres, row-major, top row first; 0 marks an invalid pixel, every other value is
/// finite and positive.
pub type DepthMap = ImageBuffer<Luma<f32>, Vec<f32>>;

/// Facts from the file of a photograph.
#[derive(Debug, Clone, PartialEq)]
pub struct FoundPicture {
    pub header: Header,
    /// Whether it is turned by its EXIF orientation.
    pub turned: bool,
    /// Whether its camera also fits the reading that is not taken; false without an orientation.
    pub fits_both: bool,
}

/// The pixels behind a [`View`], read when asked for and not kept.
pub trait ViewContent: Send + Sync + std::fmt::Debug {
    /// The photograph: 8-bit sRGB, of the size that the view's intrinsics state.
    ///
    /// # Errors
    /// Names the file and why it cannot be read, or that its size disagrees with the intrinsics.
    fn image(&self) -> Result<RgbImage, DatasetError>;

    /// 255 where a pixel of the photograph is valid; `None` if the dataset excludes none. Excluded pixels are black in [`ViewContent::image`] and have no depth.
    ///
    /// # Errors
    /// Names the file and why it cannot be read.
    fn valid_pixels(&self) -> Result<Option<GrayImage>, DatasetError>;

    /// Ground-truth depth at the image's size; `None` if the dataset has none for this view.
    ///
    /// # Errors
    /// Names the file and why it cannot be read.
    fn depth(&self) -> Result<Option<DepthMap>, DatasetError>;

    /// The file that the photograph comes from; `None` for a procedural one.
    fn image_file(&self) -> Option<&Path>;

    /// Every file that the view is made of and what it is for, sorted; a file that serves twice is
    /// listed twice. Empty for a procedural view.
    fn files_by_role(&self) -> Vec<(FileRole, PathBuf)>;

    /// [`ViewContent::files_by_role`] without the roles, each file once, sorted.
    fn files(&self) -> Vec<PathBuf> {
        let mut files: Vec<PathBuf> = self.files_by_role().into_iter().map(|f| f.1).collect();
        files.sort();
        files.dedup();
        files
    }

    /// The processing between the files and the pixels.
    fn processing(&self) -> Processing {
        Processing::default()
    }

    /// Facts from the photograph's header; `None` for a procedural one.
    ///
    /// # Errors
    /// Names the file and why it cannot be read.
    fn found(&self) -> Result<Option<FoundPicture>, DatasetError> {
        Ok(None)
    }

    /// The photograph under the other reading of its EXIF orientation, of the size of [`ViewContent::image`], and the
    /// setting that reads it so; `None` if it has no orientation, or only one reading fits the camera.
    ///
    /// # Errors
    /// As [`ViewContent::image`].
    fn image_otherwise_turned(&self) -> Result<Option<(RgbImage, &'static str)>, DatasetError> {
        Ok(None)
    }

    /// Hash of the photograph: sha256 of the file's bytes, or of the RGB bytes of a procedural
    /// view, as 64 lower-case hexadecimal digits.
    ///
    /// # Errors
    /// Names the file and why it cannot be read: missing, incomplete (as far as that shows without decoding), or of another
    /// size than its camera.
    fn image_sha256(&self) -> Result<String, DatasetError>;
}

#[derive(Debug, Clone)]
pub struct View {
    /// Unique within the scene; the file's stem or the dataset's frame name.
    pub id: String,
    /// Pinhole intrinsics of [`ViewContent::image`].
    pub intrinsics: Intrinsics,
    pub camera_from_world: RigidTransform,
    pub content: Arc<dyn ViewContent>,
}

/// Rule by which the views of a scene form pairs.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Pairing {
    /// Exactly one pair: the paper's stereo protocol, left to right.
    Stereo { source: usize, target: usize },
    /// From one view to each of the others, whatever their overlap: a controlled sweep.
    Star { source: usize },
    /// Pairs come from sets of consecutive views and their overlap.
    MultiView,
}

/// Views that share one world space.
#[derive(Debug, Clone)]
pub struct Scene {
    /// Name of the dataset instance, as given or the format's own.
    pub dataset: String,
    /// Unique within the dataset; `/` separates levels.
    pub id: String,
    /// The physical scene. Scenes of one cluster (illuminations, exposures, two rectifications of
    /// one set-up) are not independent samples and are resampled together in statistics.
    pub cluster: String,
    /// In natural order of their ids.
    pub views: Vec<View>,
    pub pairing: Pairing,
    /// What the reader assumed or left out: lines shown before a run and kept in its manifest.
    pub notes: Vec<String>,
    /// Doubts about the files, each with the setting that mends it; shown as the notes are, and as warnings before a run.
    pub warnings: Vec<String>,
    /// Views that are not among the others because of their files.
    pub left_out: Vec<LeftOutViews>,
}

impl Scene {
    /// A scene that is a cluster of its own, with nothing to note.
    pub fn new(dataset: &str, id: impl Into<String>, views: Vec<View>, pairing: Pairing) -> Self {
        let id = id.into();
        Self {
            dataset: dataset.to_owned(),
            cluster: id.clone(),
            id,
            views,
            pairing,
            notes: Vec::new(),
            warnings: Vec::new(),
            left_out: Vec::new(),
        }
    }
}
