//! The benchmark scene of renderers: 2 × 768 × 768 Gaussians in SHARP's layout, with smooth depth and one step, seen by
//! a slightly moved camera.

use glam::{DAffine3, DMat3, DVec3};
use sharp::camera::Intrinsics;
use sharp::gaussians::Gaussians;
use sharp::render::RenderView;

/// Number of Gaussians along a side of a layer.
const GRID: usize = 768;
/// Focal length at a width of 1536 pixels.
const FOCAL: f64 = 1536.0 * 0.85;

/// The scene, with Gaussians whose standard deviation is about `sigma_px` pixels at a picture width
/// of 1536.
///
/// Random numbers are splitmix64(1), splitmix64(2), …, twelve per Gaussian.
pub(crate) fn scene(sigma_px: f64) -> Gaussians {
    let mut scene = Gaussians::default();
    for index in 0..2 * GRID * GRID {
        let (layer, j, i) = (index / (GRID * GRID), index / GRID % GRID, index % GRID);
        let u: [f64; 12] = std::array::from_fn(|k| uniform((index * 12 + k + 1) as u64));
        let between = |k: usize, low: f64, high: f64| low + (high - low) * u[k];
        let place = |at: usize| ((at as f64 + 0.5) / GRID as f64 * 2.0 - 1.0) * 768.0 / FOCAL;
        let (x, y) = (place(i), place(j));
        let mut depth = 2.5 + 0.9 * (3.1 * x + 0.4).sin() * (2.7 * y).cos();
        depth += 0.3 * (11.0 * x * y).sin();
        if (x - 0.1).powi(2) + (y + 0.1).powi(2) < 0.06 {
            depth -= 0.9;
        }
        if layer == 1 {
            depth += 0.35 + 0.2 * (5.0 * x).cos();
        }
        depth += between(0, -0.004, 0.004);
        let size = depth / FOCAL * sigma_px;
        let color = [
            0.5 + 0.4 * (9.0 * x).sin(),
            0.5 + 0.4 * (7.0 * y).sin(),
            0.5 + 0.4 * (8.0 * (x + y)).cos(),
        ];
        scene
            .means
            .push([x * depth, y * depth, depth].map(|v| v as f32));
        scene
            .quaternions
            .push([4, 5, 6, 7].map(|k| between(k, -1.0, 1.0) as f32));
        scene
            .scales
            .push([1, 2, 3].map(|k| (size * between(k, 0.6, 1.5)) as f32));
        scene.opacities.push(if layer == 0 {
            between(8, 0.6, 0.99)
        } else {
            between(8, 0.3, 0.95)
        } as f32);
        scene.colors.push(std::array::from_fn(|c| {
            (color[c] + between(9 + c, -0.1, 0.1)).clamp(0.0, 1.0) as f32
        }));
    }
    scene
}

/// The moved camera at a picture size, with the SHARP release's principal point.
pub(crate) fn view(width: u32, height: u32) -> RenderView {
    let focal = FOCAL * f64::from(width) / 1536.0;
    let intrinsics = Intrinsics {
        fx: focal,
        fy: focal,
        cx: (f64::from(width) - 1.0) / 2.0,
        cy: (f64::from(height) - 1.0) / 2.0,
        width,
        height,
    };
    let camera_from_world = DAffine3::from_mat3_translation(
        DMat3::from_rotation_y(-0.03),
        DVec3::new(0.05, -0.02, 0.03),
    );
    RenderView::new(camera_from_world, intrinsics)
}

fn uniform(seed: u64) -> f64 {
    let mut z = seed.wrapping_add(0x9E37_79B9_7F4A_7C15);
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^= z >> 31;
    (z >> 40) as f64 / f64::from(1 << 24)
}
