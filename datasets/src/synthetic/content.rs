//! Pictures and depth of the procedural scene.

use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

use glam::{DVec2, DVec3};
use image::{GrayImage, RgbImage};
use rayon::prelude::*;
use sharp::camera::RigidTransform;

use super::arithmetic::srgb_level;
use super::world::World;
use crate::lens::Lens;
use crate::required_files::FileRole;
use crate::{DatasetError, DepthMap, ViewContent, files};

/// Rays a pixel and side: colour is averaged over 3×3 in linear light, depth is that of the one
/// through the centre.
const SAMPLES: u32 = 3;

/// One procedural photograph. It is computed when first asked for and then kept.
#[derive(Debug)]
pub(super) struct ProceduralContent {
    world: Arc<World>,
    lens: Lens,
    world_from_camera: RigidTransform,
    image: OnceLock<RgbImage>,
}

impl ProceduralContent {
    pub(super) fn new(world: Arc<World>, lens: Lens, camera_from_world: RigidTransform) -> Self {
        Self {
            world,
            lens,
            world_from_camera: camera_from_world.inverse(),
            image: OnceLock::new(),
        }
    }

    /// The ray through a point of the picture; its direction has z = 1 in camera space, so that
    /// distances along it are z-depths. `None` where the lens sees nothing.
    fn ray(&self, x: f64, y: f64) -> Option<(DVec3, DVec3)> {
        let direction = self.lens.unproject(DVec2::new(x, y))?;
        Some((
            self.world_from_camera.translation,
            self.world_from_camera.rotation * direction,
        ))
    }

    fn size(&self) -> (u32, u32) {
        let k = self.lens.intrinsics();
        (k.width, k.height)
    }

    fn pixel(&self, x: u32, y: u32) -> [u8; 3] {
        let step = 1.0 / f64::from(SAMPLES);
        let mut sum = DVec3::ZERO;
        for j in 0..SAMPLES {
            for i in 0..SAMPLES {
                let ray = self.ray(
                    f64::from(x) + (f64::from(i) + 0.5) * step,
                    f64::from(y) + (f64::from(j) + 0.5) * step,
                );
                if let Some((origin, direction)) = ray {
                    sum += self.world.radiance(origin, direction);
                }
            }
        }
        let mean = sum / f64::from(SAMPLES * SAMPLES);
        [srgb_level(mean.x), srgb_level(mean.y), srgb_level(mean.z)]
    }

    fn picture(&self) -> &RgbImage {
        self.image.get_or_init(|| {
            let mut image = RgbImage::new(self.size().0, self.size().1);
            image
                .par_chunks_exact_mut(self.size().0 as usize * 3)
                .zip(0..self.size().1)
                .for_each(|(row, y)| {
                    for (pixel, x) in row.chunks_exact_mut(3).zip(0..) {
                        pixel.copy_from_slice(&self.pixel(x, y));
                    }
                });
            image
        })
    }
}

impl ViewContent for ProceduralContent {
    fn image(&self) -> Result<RgbImage, DatasetError> {
        Ok(self.picture().clone())
    }

    fn valid_pixels(&self) -> Result<Option<GrayImage>, DatasetError> {
        Ok(None)
    }

    fn depth(&self) -> Result<Option<DepthMap>, DatasetError> {
        let mut depth = DepthMap::new(self.size().0, self.size().1);
        depth
            .par_chunks_exact_mut(self.size().0 as usize)
            .zip(0..self.size().1)
            .for_each(|(row, y)| {
                for (value, x) in row.iter_mut().zip(0..self.size().0) {
                    let hit = self
                        .ray(f64::from(x) + 0.5, f64::from(y) + 0.5)
                        .and_then(|(origin, direction)| self.world.first_hit(origin, direction));
                    if let Some(hit) = hit {
                        *value = hit.distance as f32;
                    }
                }
            });
        Ok(Some(depth))
    }

    fn image_file(&self) -> Option<&Path> {
        None
    }

    fn files_by_role(&self) -> Vec<(FileRole, PathBuf)> {
        Vec::new()
    }

    fn image_sha256(&self) -> Result<String, DatasetError> {
        Ok(files::sha256_of(self.picture()))
    }
}
