//! Camera files: JSON with `width`, `height`, `K` and `camera_from_world`.

use std::path::Path;

use anyhow::{Context, ensure};
use glam::{DAffine3, DMat4};
use serde::{Deserialize, Serialize};
use sharp::camera::{Intrinsics, affine_from_row_major};

use crate::durable::write_atomic;

/// A camera as people script it. Pixel (i, j) has its centre at (i + 0.5, j + 0.5).
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct CameraFile {
    /// Image width, pixels.
    pub(super) width: u32,
    /// Image height, pixels.
    pub(super) height: u32,
    /// 3×3 intrinsics, row by row, pixels.
    #[serde(rename = "K")]
    pub(super) k: [f64; 9],
    /// 4×4 extrinsics, row by row; any affine map.
    pub(super) camera_from_world: [f64; 16],
}

impl CameraFile {
    /// Reads and checks a camera.
    pub(super) fn read(path: &Path) -> anyhow::Result<(Intrinsics, DAffine3)> {
        let context = || path.display().to_string();
        let text = std::fs::read_to_string(path).with_context(context)?;
        let camera: Self = serde_json::from_str(&text).with_context(context)?;
        camera.check().with_context(context)
    }

    /// The file of a camera; [`Self::read`] gives the same camera back, bit for bit.
    pub(super) fn of(intrinsics: &Intrinsics, camera_from_world: &DAffine3) -> Self {
        let row_major = DMat4::from(*camera_from_world).transpose();
        Self {
            width: intrinsics.width,
            height: intrinsics.height,
            k: intrinsics.matrix().transpose().to_cols_array(),
            camera_from_world: row_major.to_cols_array(),
        }
    }

    /// Writes the file.
    pub(super) fn write(&self, path: &Path) -> anyhow::Result<()> {
        let mut text = serde_json::to_string(self)?;
        text.push('\n');
        Ok(write_atomic(path, text.as_bytes())?)
    }

    fn check(&self) -> anyhow::Result<(Intrinsics, DAffine3)> {
        let [fx, skew, cx, k10, fy, cy, k20, k21, k22] = self.k;
        ensure!(
            [skew, k10, k20, k21] == [0.0; 4] && k22 == 1.0,
            "K has a skew or a last row other than 0 0 1, which no renderer here supports"
        );
        let intrinsics = Intrinsics::new((fx, fy), (cx, cy), (self.width, self.height))?;
        Ok((intrinsics, affine_from_row_major(&self.camera_from_world)?))
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
        assert!(skewed.check().unwrap_err().to_string().contains("skew"));

        let mut nan = camera();
        nan.camera_from_world[3] = f64::NAN;
        assert!(nan.check().unwrap_err().to_string().contains("not finite"));
    }
}
