//! The content of views whose pixels lie in files.

use std::path::{Path, PathBuf};

use image::{GrayImage, RgbImage};
use sharp::camera::{Intrinsics, RigidTransform};

use crate::camera_size::check_size;
use crate::depth::ViewDepth;
use crate::format::picture;
use crate::mask::MaskFile;
use crate::processing::{Processing, Undistorted};
use crate::required_files::FileRole;
use crate::undistort::Undistortion;
use crate::{DatasetError, DepthMap, ViewContent, files};

/// A photograph in a file, resampled to a pinhole camera where its lens asks for it.
#[derive(Debug)]
pub(crate) struct FileContent {
    pub(crate) image: PathBuf,
    /// Its size as stored, according to the camera.
    pub(crate) size: (u32, u32),
    pub(crate) mask: Option<MaskFile>,
    /// From the lens to the pinhole camera of the view.
    pub(crate) undistortion: Option<Undistortion>,
    pub(crate) pinhole: Intrinsics,
    pub(crate) camera_from_world: RigidTransform,
    pub(crate) depth: Option<ViewDepth>,
    /// The files that the camera was read from.
    pub(crate) cameras: Vec<PathBuf>,
}

impl ViewContent for FileContent {
    fn image(&self) -> Result<RgbImage, DatasetError> {
        // By its header first: what is decoded is no larger than its camera.
        check_size(&self.image, picture::dimensions(&self.image)?, self.size)?;
        let mut image = picture::read(&self.image)?;
        if let Some(undistortion) = &self.undistortion {
            image = undistortion.image(&image);
        }
        // The picture is resampled first: black would else run into its neighbours.
        if let Some(mask) = self.valid_pixels()? {
            let pixels = image.chunks_exact_mut(3).zip(mask.iter());
            let excluded = pixels.filter(|(_, keep)| **keep == 0);
            excluded.for_each(|(pixel, _)| pixel.fill(0));
        }
        Ok(image)
    }

    fn valid_pixels(&self) -> Result<Option<GrayImage>, DatasetError> {
        let mask = self.mask.as_ref();
        mask.map(|mask| mask.read(self.size, self.undistortion.as_ref()))
            .transpose()
    }

    fn depth(&self) -> Result<Option<DepthMap>, DatasetError> {
        let Some(depth) = &self.depth else {
            return Ok(None);
        };
        // Depth takes the camera's size: that of the photograph, or a few bytes of text could ask
        // for any amount of memory.
        check_size(&self.image, picture::dimensions(&self.image)?, self.size)?;
        let mut depth = depth.load(self)?;
        if let Some(mask) = self.valid_pixels()? {
            let excluded = depth.iter_mut().zip(mask.iter());
            let excluded = excluded.filter(|(_, keep)| **keep == 0);
            excluded.for_each(|(z, _)| *z = 0.0);
        }
        Ok(Some(depth))
    }

    fn image_file(&self) -> Option<&Path> {
        Some(&self.image)
    }

    fn files_by_role(&self) -> Vec<(FileRole, PathBuf)> {
        let mask = self.mask.iter().map(|mask| mask.file.clone());
        let depth = self.depth.iter().map(|depth| depth.file().to_owned());
        let mut files = vec![(FileRole::Picture, self.image.clone())];
        files.extend(
            self.cameras
                .iter()
                .map(|file| (FileRole::Camera, file.clone())),
        );
        files.extend(mask.map(|file| (FileRole::Mask, file)));
        files.extend(depth.map(|file| (FileRole::Depth, file)));
        files.sort();
        files.dedup();
        files
    }

    fn processing(&self) -> Processing {
        Processing {
            undistorted: self.undistortion.map(|u| Undistorted {
                model: u.lens().distortion().name(),
                camera: u.rule(),
            }),
            masked: self.mask.is_some(),
            lacks_depth: self.depth.is_none(),
            depth_by_pose: matches!(self.depth, Some(ViewDepth::Scan(_) | ViewDepth::Points(..))),
        }
    }

    fn image_sha256(&self) -> Result<String, DatasetError> {
        files::sha256(&self.image)
    }
}
