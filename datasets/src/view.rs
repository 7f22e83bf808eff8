//! Scenes of posed views whose pixels are loaded on demand: the output of every reader.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use image::{GrayImage, RgbImage};
use sharp::camera::{Intrinsics, RigidTransform};
use sharp::image_file::Header;
use sharp_checkpoint::hash::sha256_hex;

use crate::DatasetError;
use crate::depth_map::DepthMap;
use crate::format::FloatMap;
use crate::left_out::LeftOutViews;
use crate::processing::Processing;
use crate::required_files::{FileRole, RequiredFile};

/// Information from the header of a photograph's file.
#[derive(Debug, Clone, PartialEq)]
pub struct FoundPicture {
    pub header: Header,
    /// True if the picture is turned by its EXIF orientation.
    pub turned: bool,
    /// True if the picture's camera fits both orientations, as stored and turned; false without an EXIF orientation.
    pub fits_both: bool,
}

/// The pixels of a [`View`], read on demand and not cached.
pub trait ViewContent: Send + Sync + std::fmt::Debug {
    /// The photograph: 8-bit sRGB, with the size stated in the view's intrinsics.
    ///
    /// # Errors
    /// Names the file and the reason that it cannot be read, or that its size disagrees with the intrinsics.
    /// [`DatasetError::NoPhotograph`] for a virtual view.
    fn image(&self) -> Result<RgbImage, DatasetError>;

    /// False for a virtual view, which is only a camera: methods predict it, and no metric scores it.
    fn has_photograph(&self) -> bool {
        true
    }

    /// 255 for valid pixels of the photograph; `None` if the dataset excludes no pixels. Excluded
    /// pixels are black in [`ViewContent::image`] and have no depth.
    ///
    /// # Errors
    /// Names the file and why it cannot be read.
    fn valid_pixels(&self) -> Result<Option<GrayImage>, DatasetError> {
        Ok(None)
    }

    /// Ground-truth depth with the photograph's size; `None` if the dataset has no depth for this view.
    ///
    /// # Errors
    /// Names the file and why it cannot be read.
    fn depth(&self) -> Result<Option<DepthMap>, DatasetError> {
        Ok(None)
    }

    /// The depth map's file and its values as stored; `None` if the values are not whole numbers or
    /// the view has no stored depth.
    ///
    /// # Errors
    /// Names the file and why it cannot be read.
    fn stored_depth(&self) -> Result<Option<(PathBuf, FloatMap)>, DatasetError> {
        Ok(None)
    }

    /// File of the photograph; `None` if procedural.
    fn image_file(&self) -> Option<&Path> {
        None
    }

    /// Every file that the view depends on, with its role, sorted; a file with two roles is listed twice. Empty for a
    /// procedural view.
    fn files_by_role(&self) -> Vec<(FileRole, PathBuf)> {
        Vec::new()
    }

    /// [`ViewContent::files_by_role`] without the roles; each file once, sorted.
    fn files(&self) -> Vec<PathBuf> {
        let mut files: Vec<PathBuf> = self.files_by_role().into_iter().map(|f| f.1).collect();
        files.sort();
        files.dedup();
        files
    }

    /// Processing steps between the view's files and its pixels.
    fn processing(&self) -> Processing {
        Processing::default()
    }

    /// Information from the photograph's header; `None` if procedural.
    ///
    /// # Errors
    /// Names the file and why it cannot be read.
    fn found(&self) -> Result<Option<FoundPicture>, DatasetError> {
        Ok(None)
    }

    /// The photograph with the other interpretation of its EXIF orientation, at the size of
    /// [`ViewContent::image`], and the setting that selects this interpretation. `None` if the
    /// photograph has no EXIF orientation, or if only one interpretation matches the camera.
    ///
    /// # Errors
    /// As for [`ViewContent::image`].
    fn image_otherwise_turned(&self) -> Result<Option<(RgbImage, &'static str)>, DatasetError> {
        Ok(None)
    }

    /// Hash of the photograph: SHA-256 of the file's bytes or, for a procedural view, of the RGB
    /// bytes, as 64 lower-case hexadecimal digits.
    ///
    /// # Errors
    /// Names the file and the reason: the file is missing or incomplete (if that can be detected without decoding), or
    /// the photograph's size differs from the camera's.
    fn image_sha256(&self) -> Result<String, DatasetError> {
        Ok(sha256_hex(&self.image()?))
    }
}

#[derive(Debug, Clone)]
pub struct View {
    /// Id, unique within the scene: the file's stem or the dataset's frame name.
    pub id: String,
    /// Pinhole intrinsics of [`ViewContent::image`].
    pub intrinsics: Intrinsics,
    pub camera_from_world: RigidTransform,
    pub content: Arc<dyn ViewContent>,
}

impl View {
    /// The file with this name from which the camera was read, if any.
    pub(crate) fn camera_file(&self, name: &str) -> Option<PathBuf> {
        let mut files = self.content.files_by_role().into_iter();
        let found = files.find(|(role, file)| *role == FileRole::Camera && file.ends_with(name));
        found.map(|(_, file)| file)
    }

    /// The files of this view, as found by its reader. Paths are relative to `folder`; files
    /// outside `folder` keep their full paths.
    pub fn required_files(&self, folder: &Path) -> Vec<RequiredFile> {
        let relative = |file: &Path| {
            let inside = file.strip_prefix(folder).unwrap_or(file);
            let levels: Vec<_> = inside.iter().map(|level| level.to_string_lossy()).collect();
            levels.join("/")
        };
        let files = self.content.files_by_role().into_iter();
        files
            .map(|(role, file)| RequiredFile::new(role, relative(&file)))
            .collect()
    }
}

/// Rule by which the views of a scene form pairs.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum Pairing {
    /// Exactly one pair, left to right: the paper's stereo protocol.
    Stereo { source: usize, target: usize },
    /// From one view to each of the others, regardless of overlap: a controlled sweep.
    Star { source: usize },
    /// Pairs are chosen by overlap from sets of consecutive views.
    MultiView,
}

/// Views in a common world coordinate system.
#[derive(Debug, Clone)]
pub struct Scene {
    /// Name of the dataset instance: the user's choice, or the format's name by default.
    pub dataset: String,
    /// Id, unique within the dataset; `/` separates levels.
    pub id: String,
    /// The physical scene. Scenes of one cluster (illuminations, exposures, two rectifications of one set-up) are not
    /// independent samples, so statistics resample them together.
    pub cluster: String,
    /// Views in natural order of their ids.
    pub views: Vec<View>,
    pub pairing: Pairing,
    /// Assumptions and exclusions of the reader; shown before a run and stored in its manifest.
    pub notes: Vec<String>,
    /// Doubts about the files, each with the setting that resolves it; shown like notes, and as warnings before a run.
    pub warnings: Vec<String>,
    /// Views that were excluded because a file is missing, incomplete or unreadable.
    pub left_out: Vec<LeftOutViews>,
}

impl Scene {
    /// Creates a scene that is its own cluster, without notes.
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

pub(crate) fn without_depth(views: &[View]) -> usize {
    let lacking = views.iter().filter(|v| v.content.processing().lacks_depth);
    lacking.count()
}

/// At most `most` of `count` indices, evenly spaced and including the first.
pub(crate) fn evenly_spaced(count: usize, most: usize) -> Vec<usize> {
    let n = count.min(most.max(1));
    (0..n).map(|i| i * count / n).collect()
}
