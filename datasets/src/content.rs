//! The content of views whose pixels lie in files.

use std::fmt::Debug;
use std::path::{Path, PathBuf};
use std::sync::Arc;

use image::RgbImage;

use crate::format::{FloatMap, picture};
use crate::{DatasetError, DepthMap, ViewContent, files};

/// Where a view's depth comes from.
pub(crate) trait DepthSource: Send + Sync + Debug {
    /// Reads the depth map; it has the size that the view's intrinsics state.
    fn load(&self) -> Result<DepthMap, DatasetError>;

    /// The files it is made of.
    fn files(&self) -> Vec<PathBuf>;
}

/// A photograph in a file, used as it is.
#[derive(Debug)]
pub(crate) struct FileContent {
    /// The photograph.
    pub(crate) image: PathBuf,
    /// Its size according to the camera.
    pub(crate) size: (u32, u32),
    /// Depth, where the dataset has it.
    pub(crate) depth: Option<Arc<dyn DepthSource>>,
    /// The files that the camera was read from.
    pub(crate) cameras: Vec<PathBuf>,
}

impl ViewContent for FileContent {
    fn image(&self) -> Result<RgbImage, DatasetError> {
        let image = picture::read(&self.image)?;
        check_size(&self.image, image.dimensions(), self.size)?;
        Ok(image)
    }

    fn depth(&self) -> Result<Option<DepthMap>, DatasetError> {
        self.depth.as_ref().map(|depth| depth.load()).transpose()
    }

    fn image_file(&self) -> Option<&Path> {
        Some(&self.image)
    }

    fn files(&self) -> Vec<PathBuf> {
        let mut files = vec![self.image.clone()];
        files.extend(self.depth.iter().flat_map(|depth| depth.files()));
        files.extend(self.cameras.iter().cloned());
        files
    }

    fn image_sha256(&self) -> Result<String, DatasetError> {
        files::sha256(&self.image)
    }
}

/// Refuses a picture or map whose size is not the camera's.
pub(crate) fn check_size(
    path: &Path,
    found: (u32, u32),
    expected: (u32, u32),
) -> Result<(), DatasetError> {
    if found == expected {
        return Ok(());
    }
    Err(DatasetError::malformed(
        path,
        format!(
            "is {}x{}, but its camera is for {}x{}",
            found.0, found.1, expected.0, expected.1
        ),
    ))
}

/// What turns disparity into depth: `Z = baseline · f / (d + doffs)`.
#[derive(Debug, Clone, Copy)]
pub(crate) struct StereoGeometry {
    /// Focal length, pixels.
    pub(crate) focal: f64,
    /// Distance of the two cameras, metres.
    pub(crate) baseline_m: f64,
    /// Difference of the principal points, pixels.
    pub(crate) doffs: f64,
}

impl StereoGeometry {
    /// Depth in metres; 0 where the disparity is not finite, not positive, or stands for a point
    /// behind the cameras.
    pub(crate) fn depth(&self, disparity: f32) -> f32 {
        let shifted = f64::from(disparity) + self.doffs;
        if !disparity.is_finite() || disparity <= 0.0 || shifted <= 0.0 {
            return 0.0;
        }
        let depth = (self.baseline_m * self.focal / shifted) as f32;
        if depth.is_finite() { depth } else { 0.0 }
    }

    /// Converts a whole disparity map.
    ///
    /// A map without one disparity inside the picture, though it holds values, is refused: read
    /// in the wrong byte order, disparities become denormal or astronomical.
    pub(crate) fn depth_map(
        &self,
        path: &Path,
        disparity: &FloatMap,
    ) -> Result<DepthMap, DatasetError> {
        let widest = f64::from(disparity.width());
        let (mut sane, mut strange) = (0_u64, 0_u64);
        let depth: Vec<f32> = disparity
            .as_raw()
            .iter()
            .map(|&d| {
                // Zero and -1 are common marks of an invalid pixel and prove nothing.
                let magnitude = f64::from(d.abs());
                if d.is_finite() && (magnitude >= widest || (magnitude > 0.0 && magnitude < 1e-6)) {
                    strange += 1;
                } else if d.is_finite() && d > 0.0 {
                    sane += 1;
                }
                self.depth(d)
            })
            .collect();
        if sane == 0 && strange > 0 {
            return Err(DatasetError::malformed(
                path,
                format!(
                    "none of {strange} disparities lies within the picture's width of {widest} \
                     pixels (wrong byte order or unit?)"
                ),
            ));
        }
        DepthMap::from_vec(disparity.width(), disparity.height(), depth)
            .ok_or_else(|| DatasetError::malformed(path, "the map's size overflows"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const RIG: StereoGeometry = StereoGeometry {
        focal: 1000.0,
        baseline_m: 0.2,
        doffs: 30.0,
    };

    #[test]
    fn disparity_becomes_metric_depth() {
        assert_eq!(RIG.depth(20.0), 4.0);
        for invalid in [0.0, -1.0, f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
            assert_eq!(RIG.depth(invalid), 0.0);
        }
        let negative_offset = StereoGeometry {
            doffs: -30.0,
            ..RIG
        };
        assert_eq!(negative_offset.depth(20.0), 0.0);
    }

    #[test]
    fn disparities_in_the_wrong_byte_order_are_noticed() {
        let path = Path::new("d.pfm");
        let swapped = |v: f32| f32::from_bits(v.to_bits().swap_bytes());
        let map =
            FloatMap::from_vec(3, 1, vec![swapped(1.7), swapped(2.2), f32::INFINITY]).unwrap();
        let error = RIG.depth_map(path, &map).unwrap_err().to_string();
        assert!(error.contains("byte order"), "{error}");
        let unknown = FloatMap::from_vec(2, 1, vec![f32::INFINITY, 0.0]).unwrap();
        assert_eq!(RIG.depth_map(path, &unknown).unwrap().as_raw(), &[0.0, 0.0]);
    }
}
