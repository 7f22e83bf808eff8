//! A small scene of Gaussians as a file, for the tests of `render`.

use std::path::Path;

use sharp::camera::Intrinsics;
use sharp::gaussians::Gaussians;
use sharp::ply::{GaussianScene, PlyForm, to_bytes};

/// Width and height of the stored camera, pixels; its focal length is 60.
pub(crate) const SIZE: (u32, u32) = (64, 48);

/// Two layers of twelve Gaussians: the first at 3 m, the second behind it at 4 m.
pub(crate) fn gaussians() -> Gaussians {
    let mut scene = Gaussians::default();
    for k in 0..24_u8 {
        let (layer, place) = (f32::from(k / 12), k % 12);
        let (column, row) = (f32::from(place % 4), f32::from(place / 4));
        scene
            .means
            .push([0.5 * (column - 1.5), 0.5 * (row - 1.0), 3.0 + layer]);
        scene
            .quaternions
            .push([1.0, 0.1 * column, 0.2 * row, -0.1 * layer]);
        scene.scales.push([0.12, 0.2, 0.05 + 0.05 * layer]);
        scene.opacities.push(0.4 + 0.05 * column);
        scene
            .colors
            .push([0.2 * row + 0.1, 0.25 * column, 0.8 - 0.6 * layer]);
    }
    scene
}

/// Writes Gaussians with their camera, as the release does.
pub(crate) fn write(path: &Path, gaussians: Gaussians) {
    let (width, height) = (f64::from(SIZE.0), f64::from(SIZE.1));
    let camera = Intrinsics::new((60.0, 60.0), (width / 2.0, height / 2.0), SIZE).unwrap();
    let bytes = to_bytes(&GaussianScene::new(gaussians, camera), PlyForm::Release);
    std::fs::write(path, bytes).unwrap();
}

/// A folder with `scene.ply` in it.
pub(crate) fn folder() -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    write(&dir.path().join("scene.ply"), gaussians());
    dir
}
