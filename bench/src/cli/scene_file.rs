//! Scenes of Gaussians from files: PLY, or safetensors arrays.

use std::path::Path;

use anyhow::{Context, bail, ensure};
use glam::DAffine3;
use sharp::camera::{Intrinsics, affine_from_row_major};
use sharp::gaussians::Gaussians;
use sharp::ply::{self, ReadOptions};
use sharp_checkpoint::Checkpoint;

/// Gaussians and, where the file stores one, the camera to look from.
pub(super) struct SceneFile {
    pub(super) gaussians: Gaussians,
    pub(super) camera: Option<(Intrinsics, DAffine3)>,
}

/// Reads `.ply` (with or without the release's extra elements) or `.safetensors` (`means` [N, 3], `quats_wxyz` [N, 4],
/// `scales` [N, 3], `opacities` [N], `colors_linear` [N, 3]).
pub(super) fn read(path: &Path) -> anyhow::Result<SceneFile> {
    match path.extension().and_then(|e| e.to_str()) {
        Some("ply") => {
            let scene = ply::load(path, ReadOptions::default())?;
            let camera_from_world = match scene.extrinsics {
                None => DAffine3::IDENTITY,
                Some(m) => affine_from_row_major(&m.map(f64::from))
                    .with_context(|| path.display().to_string())?,
            };
            Ok(SceneFile {
                camera: scene.intrinsics.map(|k| (k, camera_from_world)),
                gaussians: scene.gaussians,
            })
        }
        Some("safetensors") => Ok(SceneFile {
            gaussians: read_arrays(path).with_context(|| path.display().to_string())?,
            camera: None,
        }),
        _ => bail!("{}: a scene is a .ply or .safetensors file", path.display()),
    }
}

fn read_arrays(path: &Path) -> anyhow::Result<Gaussians> {
    let file = Checkpoint::open(path)?;
    Ok(Gaussians::new(
        rows(&file, "means")?,
        rows(&file, "quats_wxyz")?,
        rows(&file, "scales")?,
        rows::<1>(&file, "opacities")?
            .into_iter()
            .map(|[v]| v)
            .collect(),
        rows(&file, "colors_linear")?,
    )?)
}

/// A tensor of shape [N, K], or [N] for K = 1.
fn rows<const K: usize>(file: &Checkpoint, name: &str) -> anyhow::Result<Vec<[f32; K]>> {
    let shape = file.shape(name)?.to_vec();
    ensure!(
        matches!(shape.as_slice(), [_, k] if *k == K) || (K == 1 && shape.len() == 1),
        "{name} has shape {shape:?}, [N, {K}] is needed"
    );
    let values = file.tensor_f32(name)?;
    Ok(values.as_chunks::<K>().0.to_vec())
}
