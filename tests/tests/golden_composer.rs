//! Initializer, composer, unprojection and PLY writer compared with recordings of the official
//! network (`tests/golden/model`); their input is the recording's own disparity and deltas.

#![allow(clippy::unwrap_used, reason = "test code outside of #[test] functions")]

use std::path::{Path, PathBuf};

use safetensors::SafeTensors;
use sharp::composer::compose;
use sharp::gaussians::Gaussians;
use sharp::initializer::{BaseGaussians, Grid, InvalidDepth, NormalizedDepth};
use sharp::ply::{GaussianScene, PlyForm};
use sharp::resize::bilinear_align_corners;
use sharp::unprojection::{covariance, release_intrinsics, unproject};

/// Largest deviation divided by the stage's largest absolute value.
const TOLERANCE: f64 = 5e-6;

const TINY: Grid = Grid {
    layers: 2,
    width: 192,
    height: 192,
    stride: 2,
};

fn golden_dir() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("golden/model")
}

struct Golden(Vec<u8>);

impl Golden {
    fn load() -> Self {
        Self(std::fs::read(golden_dir().join("golden_tiny.safetensors")).unwrap())
    }

    fn bytes(&self, key: &str) -> Option<Vec<u8>> {
        let tensors = SafeTensors::deserialize(&self.0).unwrap();
        let view = tensors.tensor(&format!("tiny/{key}")).ok()?;
        Some(view.data().to_vec())
    }

    fn f32s(&self, key: &str) -> Option<Vec<f32>> {
        let bytes = self.bytes(key)?;
        let number = |b: &[u8]| f32::from_le_bytes(b.try_into().unwrap());
        Some(bytes.chunks_exact(4).map(number).collect())
    }

    fn whole(&self, stage: &str) -> Vec<f32> {
        self.f32s(stage).unwrap()
    }

    /// Compares `found` with a stage, completely or at its sampled indices.
    fn check(&self, stage: &str, found: &[f32]) {
        let stats = self.bytes(&format!("{stage}.stats")).unwrap();
        let absmax = f64::from_le_bytes(stats[16..24].try_into().unwrap());
        let pairs: Vec<(f32, f32)> = match self.f32s(stage) {
            Some(whole) => {
                assert_eq!(whole.len(), found.len(), "{stage}");
                whole.into_iter().zip(found.iter().copied()).collect()
            }
            None => {
                let indices = self.bytes(&format!("{stage}.indices")).unwrap();
                let at = |b: &[u8]| found[i64::from_le_bytes(b.try_into().unwrap()) as usize];
                let values = self.whole(&format!("{stage}.values"));
                values
                    .into_iter()
                    .zip(indices.chunks_exact(8).map(at))
                    .collect()
            }
        };
        let worst = pairs
            .iter()
            .map(|(a, b)| f64::from((a - b).abs()))
            .map(|d| if d.is_nan() { f64::INFINITY } else { d })
            .fold(0.0, f64::max);
        assert!(
            worst / absmax <= TOLERANCE,
            "{stage}: {:.2e}",
            worst / absmax
        );
    }
}

/// The bundled picture as planes in 0..1, resized as for the network.
fn resized_image() -> Vec<f32> {
    let path = golden_dir().join("inputs/main_640x480.png");
    let image = image::open(path).unwrap().into_rgb8();
    let plane = |c: usize| image.pixels().map(move |p| f32::from(p.0[c]) / 255.0);
    let planes: Vec<f32> = (0..3).flat_map(plane).collect();
    bilinear_align_corners(&planes, (640, 480), (192, 192))
}

fn depth(golden: &Golden) -> Vec<f32> {
    let factor = golden.whole("disparity_factor")[0];
    let disparity = golden.whole("disparity");
    disparity
        .iter()
        .map(|d| factor / d.clamp(1e-4, 1e4))
        .collect()
}

fn predicted(golden: &Golden) -> Gaussians {
    let (image, depth) = (resized_image(), depth(golden));
    let base = BaseGaussians::new(&image, &depth, TINY, InvalidDepth::Refuse).unwrap();
    compose(&base, Some(&golden.whole("deltas"))).unwrap()
}

fn covariance6(g: &Gaussians) -> Vec<f32> {
    let each = |(q, s): (&[f32; 4], &[f32; 3])| {
        let m = covariance(*q, *s);
        let (x, y, z) = (m.x_axis, m.y_axis, m.z_axis);
        [x.x, y.x, z.x, y.y, z.y, z.z]
    };
    g.quaternions.iter().zip(&g.scales).flat_map(each).collect()
}

#[test]
fn initializer_matches_the_recording() {
    let golden = Golden::load();
    let (image, depth) = (resized_image(), depth(&golden));
    golden.check("image_resized", &image);
    golden.check("monodepth", &depth);
    let normalized = NormalizedDepth::new(&depth, InvalidDepth::Refuse).unwrap();
    golden.check("normalized_depth", &normalized.depth);
    golden.check("global_scale", &[normalized.global_scale()]);
    golden.check("feature_input", &normalized.feature_input(&image));
    let base = BaseGaussians::from_normalized(&image, &normalized, TINY).unwrap();
    golden.check("base.inverse_z", &base.inverse_depth);
    golden.check("base.scales", &base.scales);
    golden.check("base.opacities", &[base.opacity]);
    // The recording repeats positions over rows, columns and layers, and colours over layers.
    let xs: Vec<f32> = (0..2 * 96).flat_map(|_| base.x.clone()).collect();
    golden.check("base.mean_x_ndc", &xs);
    let ys: Vec<f32> = (0..2)
        .flat_map(|_| base.y.iter().flat_map(|&y| [y; 96]))
        .collect();
    golden.check("base.mean_y_ndc", &ys);
    let colors: Vec<f32> = base
        .colors
        .chunks(96 * 96)
        .flat_map(|plane| plane.repeat(2))
        .collect();
    golden.check("base.colors", &colors);
}

#[test]
fn composer_matches_the_recording() {
    let golden = Golden::load();
    let ndc = predicted(&golden);
    golden.check("ndc.mean_vectors", ndc.means.as_flattened());
    golden.check("ndc.singular_values", ndc.scales.as_flattened());
    golden.check("ndc.quaternions", ndc.quaternions.as_flattened());
    golden.check("ndc.colors", ndc.colors.as_flattened());
    golden.check("ndc.opacities", &ndc.opacities);
}

#[test]
fn unprojection_matches_the_recording() {
    let golden = Golden::load();
    let camera = release_intrinsics(500.0, 640, 480).unwrap();
    let world = unproject(&predicted(&golden), &camera);
    golden.check("world.mean_vectors", world.means.as_flattened());
    golden.check("world.singular_values", world.scales.as_flattened());
    golden.check("world.covariance6", &covariance6(&world));
    golden.check("world.colors", world.colors.as_flattened());
    golden.check("world.opacities", &world.opacities);
}

#[test]
fn reader_takes_the_official_file() {
    let golden = Golden::load();
    let path = golden_dir().join("tiny_golden.ply");
    let scene = sharp::gaussian_files::load(&path, None).unwrap();
    golden.check("world.mean_vectors", scene.gaussians.means.as_flattened());
    golden.check("ndc.colors", scene.gaussians.colors.as_flattened());
    golden.check("ndc.opacities", &scene.gaussians.opacities);
    golden.check("world.covariance6", &covariance6(&scene.gaussians));
    assert_eq!(
        scene.intrinsics,
        Some(release_intrinsics(500.0, 640, 480).unwrap())
    );
    assert_eq!(scene.version, Some([1, 5, 0]));
}

/// Reads the official file and writes it again: the header and all further elements agree byte for
/// byte, positions and rotations bit for bit, and encoded attributes up to the rounding of one
/// decoding and one encoding.
#[test]
fn writer_repeats_the_official_file() {
    let path = golden_dir().join("tiny_golden.ply");
    let official = std::fs::read(&path).unwrap();
    let scene = sharp::gaussian_files::load(&path, None).unwrap();
    let ours = sharp::ply::to_bytes(&scene, PlyForm::Release);
    assert_eq!(ours.len(), official.len());
    let header = header_length(&official);
    assert_eq!(ours[..header], official[..header]);
    let tail = header + 18432 * 56;
    assert_eq!(ours[tail..], official[tail..]);
    for (row, (a, b)) in rows(&ours[header..])
        .zip(rows(&official[header..]))
        .enumerate()
    {
        assert_eq!(a[..3], b[..3], "row {row}");
        assert_eq!(a[10..], b[10..], "row {row}");
        for column in 3..10 {
            let off = (a[column] - b[column]).abs();
            assert!(off <= 1e-5, "row {row}, column {column}: {off:e}");
        }
    }
}

/// All steps from the recording's disparity and deltas. Rotations are compared through the
/// covariances above, because their signs are not determined. A small axis of an f32 covariance is
/// known only up to the rounding of the large one, so its bound is wider.
#[test]
fn writer_follows_the_official_file_from_disparity_and_deltas() {
    let golden = Golden::load();
    let camera = release_intrinsics(500.0, 640, 480).unwrap();
    let scene = GaussianScene::new(unproject(&predicted(&golden), &camera), camera);
    let ours = sharp::ply::to_bytes(&scene, PlyForm::Release);
    let official = std::fs::read(golden_dir().join("tiny_golden.ply")).unwrap();
    let header = header_length(&official);
    assert_eq!(ours.len(), official.len());
    assert_eq!(ours[..header], official[..header]);
    for (row, (a, b)) in rows(&ours[header..])
        .zip(rows(&official[header..]))
        .enumerate()
    {
        for column in 0..10 {
            let off = (a[column] - b[column]).abs();
            let condition = match column {
                7..10 => f32::exp(2.0 * (b[7] - b[column])),
                _ => 1.0,
            };
            let allowed = 2e-5 * b[column].abs().max(1.0) + 4.0 * f32::EPSILON * condition;
            assert!(off <= allowed, "row {row}, column {column}: {off:e}");
        }
    }
}

fn header_length(bytes: &[u8]) -> usize {
    let end = b"end_header\n";
    bytes.windows(end.len()).position(|w| w == end).unwrap() + end.len()
}

fn rows(data: &[u8]) -> impl Iterator<Item = [f32; 14]> {
    let number = |row: &[u8], c: usize| f32::from_le_bytes(row[4 * c..][..4].try_into().unwrap());
    data.chunks_exact(56)
        .take(18432)
        .map(move |row| std::array::from_fn(|c| number(row, c)))
}
