//! A small in-memory scene for the tests of this module.

use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

use glam::{DMat3, DVec3};
use image::{Luma, RgbImage};
use sharp::camera::{Intrinsics, RigidTransform};
use sharp_datasets::required_files::FileRole;
use sharp_datasets::{DatasetError, DepthMap, Pairing, Scene, View, ViewContent};

/// Depth of a view.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Depth {
    Wall(f32),
    Absent,
    Broken,
}

#[derive(Debug)]
struct Wall {
    file: PathBuf,
    depth: Depth,
    reads: Arc<AtomicUsize>,
}

impl ViewContent for Wall {
    fn image(&self) -> Result<RgbImage, DatasetError> {
        Ok(RgbImage::new(WIDTH, HEIGHT))
    }

    fn depth(&self) -> Result<Option<DepthMap>, DatasetError> {
        self.reads.fetch_add(1, Ordering::Relaxed);
        match self.depth {
            Depth::Wall(z) => Ok(Some(DepthMap::from_pixel(WIDTH, HEIGHT, Luma([z])))),
            Depth::Absent => Ok(None),
            Depth::Broken => Err(DatasetError::malformed("d.pfm", "truncated")),
        }
    }

    fn image_file(&self) -> Option<&Path> {
        Some(&self.file)
    }

    fn files_by_role(&self) -> Vec<(FileRole, PathBuf)> {
        vec![(FileRole::Picture, self.file.clone())]
    }

    fn image_sha256(&self) -> Result<String, DatasetError> {
        Ok(format!("{:0>64}", self.file.to_string_lossy().len()))
    }
}

const WIDTH: u32 = 100;
const HEIGHT: u32 = 10;

/// A row of parallel cameras, `step_m` apart, facing a wall 2 m away. One metre is 50 pixels, so two views d metres
/// apart overlap by 1 − d / 2.
pub(super) struct CameraRow {
    pub(super) scene: Scene,
    pub(super) reads: Arc<AtomicUsize>,
}

pub(super) fn row(dataset: &str, id: &str, step_m: f64, depths: &[Depth]) -> CameraRow {
    let reads = Arc::new(AtomicUsize::new(0));
    let intrinsics = Intrinsics::new((100.0, 100.0), (50.0, 5.0), (WIDTH, HEIGHT)).unwrap();
    let view = |(i, depth): (usize, &Depth)| View {
        id: format!("v{i}"),
        intrinsics,
        camera_from_world: RigidTransform::new(
            DMat3::IDENTITY,
            // Off the pixel grid, so that no projection falls on the edge of a pixel.
            DVec3::new(-(i as f64 * step_m + 1e-4 * (i * i) as f64), 0.0, 0.0),
        )
        .unwrap(),
        content: Arc::new(Wall {
            file: PathBuf::from(format!("root/{dataset}/{id}/v{i}.png")),
            depth: *depth,
            reads: reads.clone(),
        }),
    };
    let views = depths.iter().enumerate().map(view).collect();
    let scene = Scene::new(dataset, id, views, Pairing::MultiView);
    CameraRow { scene, reads }
}

/// The row with file `dir/v` for view `v`.
pub(super) fn with_files(mut row: CameraRow, dir: &Path) -> CameraRow {
    for view in &mut row.scene.views {
        let depth = view.content.depth();
        view.content = Arc::new(Wall {
            file: dir.join(&view.id),
            depth: match depth {
                Ok(Some(map)) => Depth::Wall(map.get_pixel(0, 0).0[0]),
                Ok(None) => Depth::Absent,
                Err(_) => Depth::Broken,
            },
            reads: row.reads.clone(),
        });
    }
    row.reads.store(0, Ordering::Relaxed);
    row
}
