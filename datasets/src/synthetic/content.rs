//! Pictures and depth of the procedural scene.

use std::sync::{Arc, OnceLock};

use glam::{DVec2, DVec3};
use image::RgbImage;
use rayon::prelude::*;
use sharp::camera::RigidTransform;

use super::arithmetic::srgb_level;
use super::candidates::Wedge;
use super::world::{Candidates, Sight, World};
use crate::lens::Lens;
use crate::{DatasetError, DepthMap, ViewContent};

/// Side in pixels of the tiles whose rays share a list of objects that they can hit.
const TILE: u32 = 8;

/// A procedural photograph, computed on first use and then cached.
#[derive(Debug)]
pub(super) struct ProceduralContent {
    world: Arc<World>,
    lens: Lens,
    world_from_camera: RigidTransform,
    /// Rays per pixel along each axis: colour is averaged over samples × samples rays in linear
    /// light; depth is taken from the ray through the pixel's centre.
    samples: u32,
    image: OnceLock<RgbImage>,
}

impl ProceduralContent {
    pub(super) fn new(
        world: Arc<World>,
        lens: Lens,
        camera_from_world: RigidTransform,
        samples: u32,
    ) -> Self {
        Self {
            world,
            lens,
            world_from_camera: camera_from_world.inverse(),
            samples,
            image: OnceLock::new(),
        }
    }

    /// Ray through a point of the picture. Its direction has z = 1 in camera space, so that distances along it are
    /// z-depths. `None` if the lens sees nothing there.
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

    /// Objects that the rays of a tile can hit; all objects if the lens distorts.
    fn candidates(&self, left: u32, top: u32) -> Candidates {
        let corner = |x, y| self.ray(f64::from(x), f64::from(y)).map(|ray| ray.1);
        let (right, bottom) = (left + TILE, top + TILE);
        let corners = match (
            corner(left, top),
            corner(right, top),
            corner(right, bottom),
            corner(left, bottom),
        ) {
            (Some(a), Some(b), Some(c), Some(d)) if self.lens.is_pinhole() => Some([a, b, c, d]),
            _ => None,
        };
        let eye = self.world_from_camera.translation;
        let wedge = corners.map(|corners| Wedge::between(eye, corners));
        let forward = self.world_from_camera.rotation.z_axis;
        self.world.candidates(eye, forward, wedge.as_ref())
    }

    /// Computes `channels` values for every pixel, tile by tile.
    fn fill<T: Send>(
        &self,
        values: &mut [T],
        channels: usize,
        pixel: impl Fn(&Candidates, u32, u32, &mut [T]) + Sync,
    ) {
        let row_len = self.size().0 as usize * channels;
        values
            .par_chunks_mut(row_len * TILE as usize)
            .zip(0..self.size().1.div_ceil(TILE))
            .for_each(|(band, tile_row)| {
                for left in (0..self.size().0).step_by(TILE as usize) {
                    let top = tile_row * TILE;
                    let candidates = self.candidates(left, top);
                    for (row, y) in band.chunks_exact_mut(row_len).zip(top..) {
                        let tile = row.chunks_exact_mut(channels).zip(0..);
                        for (value, x) in tile.skip(left as usize).take(TILE as usize) {
                            pixel(&candidates, x, y, value);
                        }
                    }
                }
            });
    }

    fn pixel(&self, candidates: &Candidates, x: u32, y: u32) -> [u8; 3] {
        let step = 1.0 / f64::from(self.samples);
        let size = step / self.lens.intrinsics().fx;
        let mut sum = DVec3::ZERO;
        let mut open: Option<Sight> = None;
        for j in 0..self.samples {
            for i in 0..self.samples {
                let ray = self.ray(
                    f64::from(x) + (f64::from(i) + 0.5) * step,
                    f64::from(y) + (f64::from(j) + 0.5) * step,
                );
                let Some((origin, direction)) = ray else {
                    continue;
                };
                let sight = self.world.sight(candidates, origin, direction);
                match &mut open {
                    Some(open) if self.world.shades_as_one(open, &sight) => open.join(&sight),
                    open => {
                        if let Some(done) = open.replace(sight) {
                            sum += self.world.radiance(&done, size);
                        }
                    }
                }
            }
        }
        if let Some(last) = open {
            sum += self.world.radiance(&last, size);
        }
        let mean = sum / f64::from(self.samples * self.samples);
        [srgb_level(mean.x), srgb_level(mean.y), srgb_level(mean.z)]
    }

    fn picture(&self) -> &RgbImage {
        self.image.get_or_init(|| {
            let mut image = RgbImage::new(self.size().0, self.size().1);
            self.fill(&mut image, 3, |candidates, x, y, value| {
                value.copy_from_slice(&self.pixel(candidates, x, y));
            });
            image
        })
    }
}

impl ViewContent for ProceduralContent {
    fn image(&self) -> Result<RgbImage, DatasetError> {
        Ok(self.picture().clone())
    }

    fn depth(&self) -> Result<Option<DepthMap>, DatasetError> {
        let mut depth = DepthMap::new(self.size().0, self.size().1);
        self.fill(&mut depth, 1, |candidates, x, y, value| {
            let ray = self.ray(f64::from(x) + 0.5, f64::from(y) + 0.5);
            let hit = ray.and_then(|(origin, direction)| {
                self.world.first_hit_among(candidates, origin, direction)
            });
            if let Some(hit) = hit {
                value[0] = hit.distance as f32;
            }
        });
        Ok(Some(depth))
    }
}
