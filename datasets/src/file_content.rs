//! Content of views whose pixels are stored in files.

use std::path::{Path, PathBuf};

use image::{GrayImage, RgbImage};
use sharp::image_file::{OrientationRule, PictureRules};

use crate::camera_size::check_size;
use crate::depth::ViewDepth;
use crate::format::{FloatMap, picture};
use crate::mask::MaskFile;
use crate::processing::{Processing, Undistorted};
use crate::required_files::FileRole;
use crate::undistort::ViewGeometry;
use crate::view::FoundPicture;
use crate::{DatasetError, DepthMap, ViewContent};

/// A photograph in a file, resampled to a pinhole camera if its lens requires it.
#[derive(Debug)]
pub(crate) struct FileContent {
    pub(crate) image: PathBuf,
    pub(crate) rules: PictureRules,
    pub(crate) geometry: ViewGeometry,
    pub(crate) mask: Option<MaskFile>,
    pub(crate) depth: Option<ViewDepth>,
    /// Files from which the camera was read.
    pub(crate) cameras: Vec<PathBuf>,
    /// True if the dataset format offers the setting `camera-size`.
    pub(crate) has_camera_size: bool,
}

impl FileContent {
    /// Reads the photograph's header.
    ///
    /// # Errors
    /// If the picture does not fit the camera.
    fn fitting(&self) -> Result<FoundPicture, DatasetError> {
        let header = picture::header(&self.image)?;
        let turned = self.rules.turns(&header, Some(self.geometry.size));
        let (size, other) = if turned {
            (header.upright_size(), header.size)
        } else {
            (header.size, header.upright_size())
        };
        let checked = check_size(&self.image, size, self.geometry.size, self.has_camera_size);
        checked.map_err(|error| match error {
            DatasetError::Malformed { path, reason } if other == self.geometry.size => {
                let hint = format!(
                    "turned by its EXIF orientation {}, it would be {}x{} (orientation=auto)",
                    header.orientation, other.0, other.1
                );
                DatasetError::malformed(path, format!("{reason}; {hint}"))
            }
            error => error,
        })?;
        Ok(FoundPicture {
            turned,
            fits_both: header.orientation != 1 && other == self.geometry.size,
            header,
        })
    }

    /// The photograph read according to `rules`, resampled and masked.
    fn image_under(&self, rules: &PictureRules) -> Result<RgbImage, DatasetError> {
        let mut image = picture::read(&self.image, rules, Some(self.geometry.size))?;
        if let Some(undistortion) = &self.geometry.undistortion {
            image = undistortion.image(&image);
        }
        // Resample the picture before masking, because black would otherwise bleed into
        // neighbouring pixels.
        if let Some(mask) = self.valid_pixels()? {
            let pixels = image.chunks_exact_mut(3).zip(mask.iter());
            let excluded = pixels.filter(|(_, keep)| **keep == 0);
            excluded.for_each(|(pixel, _)| pixel.fill(0));
        }
        Ok(image)
    }
}

impl ViewContent for FileContent {
    fn image(&self) -> Result<RgbImage, DatasetError> {
        // Check the header first, so that a picture larger than its camera is not decoded.
        self.fitting()?;
        self.image_under(&self.rules)
    }

    fn found(&self) -> Result<Option<FoundPicture>, DatasetError> {
        self.fitting().map(Some)
    }

    fn image_otherwise_turned(&self) -> Result<Option<(RgbImage, &'static str)>, DatasetError> {
        let found = self.fitting()?;
        if !found.fits_both {
            return Ok(None);
        }
        let (orientation, setting) = if found.turned {
            (OrientationRule::Stored, "orientation=stored")
        } else {
            (OrientationRule::Upright, "orientation=upright")
        };
        let rules = PictureRules {
            orientation,
            ..self.rules
        };
        Ok(Some((self.image_under(&rules)?, setting)))
    }

    fn valid_pixels(&self) -> Result<Option<GrayImage>, DatasetError> {
        let mask = self.mask.as_ref();
        mask.map(|mask| mask.read(self.geometry.size, self.geometry.undistortion.as_ref()))
            .transpose()
    }

    fn depth(&self) -> Result<Option<DepthMap>, DatasetError> {
        let Some(depth) = &self.depth else {
            return Ok(None);
        };
        // Depth is allocated at the camera's size. Check this size against the photograph's,
        // because a few bytes of text could otherwise request any amount of memory.
        self.fitting()?;
        let mut depth = depth.load(&self.geometry)?;
        if let Some(mask) = self.valid_pixels()? {
            let excluded = depth.iter_mut().zip(mask.iter());
            let excluded = excluded.filter(|(_, keep)| **keep == 0);
            excluded.for_each(|(z, _)| *z = 0.0);
        }
        Ok(Some(depth))
    }

    fn stored_depth(&self) -> Result<Option<(PathBuf, FloatMap)>, DatasetError> {
        let stored = self
            .depth
            .as_ref()
            .map(|depth| depth.stored(&self.geometry));
        stored.transpose().map(Option::flatten)
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
            undistorted: self.geometry.undistortion.map(|u| Undistorted {
                model: u.lens().distortion().name(),
                camera: u.rule(),
            }),
            masked: self.mask.is_some(),
            lacks_depth: self.depth.is_none(),
            depth_by_pose: matches!(self.depth, Some(ViewDepth::Scan(_) | ViewDepth::Points(..))),
        }
    }

    fn image_sha256(&self) -> Result<String, DatasetError> {
        self.fitting()?;
        // The mask of a view with depth is read together with the depth, so check it here
        // only for views without depth.
        if self.depth.is_none() {
            self.valid_pixels()?;
        }
        picture::sha256_of_whole(&self.image)
    }
}
