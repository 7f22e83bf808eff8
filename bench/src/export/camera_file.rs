//! Camera files: JSON with `width`, `height`, `K` and `camera_from_world`.

use std::path::{Path, PathBuf};

use glam::{DAffine3, DMat4};
use serde::{Deserialize, Serialize};
use sharp::camera::{CameraError, Intrinsics, affine_from_row_major};

use crate::io::atomic_files::{FileError, write_atomic};

/// A camera file; unknown keys, such as the additional keys of `cameras export`, are ignored.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
pub struct CameraFile {
    pub width: u32,
    pub height: u32,
    /// 3×3 intrinsics, row by row, in pixels. Pixel (i, j) has its centre at (i + 0.5, j + 0.5).
    #[serde(rename = "K")]
    pub k: [f64; 9],
    pub camera_from_world: [f64; 16],
}

#[derive(Debug, thiserror::Error)]
#[error("{}: {reason}", path.display())]
pub struct CameraFileError {
    pub path: PathBuf,
    pub reason: NoCamera,
}

/// Why a text cannot be read as a camera.
#[derive(Debug, thiserror::Error)]
pub enum NoCamera {
    #[error(transparent)]
    Io(#[from] std::io::Error),
    #[error(transparent)]
    Json(#[from] serde_json::Error),
    #[error("K has a skew, or a last row other than 0 0 1; no renderer here supports either")]
    Skew,
    #[error(transparent)]
    Camera(#[from] CameraError),
}

impl CameraFile {
    /// Reads and validates a camera file.
    pub fn read(path: &Path) -> Result<(Intrinsics, DAffine3), CameraFileError> {
        let text = sharp::files::read_text(path).map_err(NoCamera::from);
        let camera = text.and_then(|text| Self::parse(&text));
        camera.map_err(|reason| CameraFileError {
            path: path.to_owned(),
            reason,
        })
    }

    /// Parses and validates a camera from JSON.
    pub fn parse(text: &str) -> Result<(Intrinsics, DAffine3), NoCamera> {
        serde_json::from_str::<Self>(text)?.check()
    }

    fn check(&self) -> Result<(Intrinsics, DAffine3), NoCamera> {
        let [fx, skew, cx, k10, fy, cy, k20, k21, k22] = self.k;
        if [skew, k10, k20, k21] != [0.0; 4] || k22 != 1.0 {
            return Err(NoCamera::Skew);
        }
        Ok((
            Intrinsics::new((fx, fy), (cx, cy), (self.width, self.height))?,
            affine_from_row_major(&self.camera_from_world)?,
        ))
    }

    /// The camera file's contents for a camera; [`Self::read`] returns exactly the same camera.
    pub fn of(intrinsics: &Intrinsics, camera_from_world: &DAffine3) -> Self {
        let row_major = DMat4::from(*camera_from_world).transpose();
        Self {
            width: intrinsics.width,
            height: intrinsics.height,
            k: intrinsics.matrix().transpose().to_cols_array(),
            camera_from_world: row_major.to_cols_array(),
        }
    }

    pub fn write(&self, path: &Path) -> Result<(), FileError> {
        let line = serde_json::to_string(self);
        let line = line.map_err(|error| FileError::new(path, "encode")(error.into()))?;
        write_atomic(path, format!("{line}\n").as_bytes())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn camera() -> CameraFile {
        let mut camera_from_world = [0.0; 16];
        for i in 0..4 {
            camera_from_world[5 * i] = 1.0;
        }
        CameraFile {
            width: 4,
            height: 3,
            k: [5.0, 0.0, 2.0, 0.0, 6.0, 1.5, 0.0, 0.0, 1.0],
            camera_from_world,
        }
    }

    #[test]
    fn a_written_camera_reads_back_bit_for_bit() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("cam.json");
        let mut moved = camera();
        moved.k[0] = 0.1 + 0.2;
        moved.camera_from_world[..4].copy_from_slice(&[1.0 / 3.0, -0.1, 1e-300, 2.0_f64.sqrt()]);
        let (intrinsics, camera_from_world) = moved.check().unwrap();
        CameraFile::of(&intrinsics, &camera_from_world)
            .write(&path)
            .unwrap();
        assert_eq!(
            CameraFile::read(&path).unwrap(),
            (intrinsics, camera_from_world)
        );
    }

    #[test]
    fn good_cameras_pass_and_bad_ones_say_why() {
        let (intrinsics, _) = camera().check().unwrap();
        assert_eq!((intrinsics.fx, intrinsics.fy), (5.0, 6.0));

        let mut skewed = camera();
        skewed.k[1] = 0.1;
        assert!(matches!(skewed.check(), Err(NoCamera::Skew)));

        let mut nan = camera();
        nan.camera_from_world[3] = f64::NAN;
        assert!(nan.check().unwrap_err().to_string().contains("not finite"));
    }
}
