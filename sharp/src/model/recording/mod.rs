//! Recordings: files with every stage of a prediction, complete or sampled, and the comparison of a network with a
//! recording.
//!
//! A recording is a safetensors file with keys `<prefix>/<stage>` (complete, f32) or `<prefix>/<stage>.values` and
//! `.indices` (512 positions), always with `.shape` and `.stats` (f64: mean, population standard deviation, absmax,
//! min, max). Each prefix identifies an image.

mod compare;
mod file;
mod write;

use super::ModelError;
use super::observer::{StageObserver, StageValue};
use super::predictor::{NetworkOutput, Planes, Predictor, observe_gaussians};
use crate::gaussians::Gaussians;
use crate::unprojection::{covariance, release_intrinsics, unproject};

pub use compare::{RecordingComparison, StageComparison, compare};
pub use file::{RecordedInput, RecordedStage, RecordedValues, Recording};
pub use write::{RecordOptions, record};

/// Number of positions at which a large stage is sampled.
const SAMPLES: usize = 512;

/// Runs the SHARP release's complete prediction, up to metric space, with an observer.
fn observe(
    predictor: &Predictor,
    image: Planes<'_>,
    focal_px: f64,
    observer: &mut dyn StageObserver,
) -> Result<NetworkOutput, ModelError> {
    let factor = (focal_px / image.width as f64) as f32;
    let prediction = predictor.predict(image, factor, observer)?;
    let (width, height) = (image.width as u32, image.height as u32);
    let camera = release_intrinsics(focal_px, width, height)
        .map_err(|e| ModelError::Image(e.to_string()))?;
    let world = unproject(&prediction.gaussians, &camera);
    observe_gaussians("world", &world, observer)?;
    let covariances = covariance6(&world);
    let shape = [1, world.len(), 6];
    observer.stage("world.covariance6", StageValue::host(&shape, &covariances))?;
    Ok(prediction)
}

/// Upper triangles xx, xy, xz, yy, yz, zz of all covariances.
fn covariance6(gaussians: &Gaussians) -> Vec<f32> {
    let each = |(quaternion, scales): (&[f32; 4], &[f32; 3])| {
        let m = covariance(*quaternion, *scales);
        let (x, y, z) = (m.x_axis, m.y_axis, m.z_axis);
        [x.x, y.x, z.x, y.y, z.y, z.z]
    };
    let pairs = gaussians.quaternions.iter().zip(&gaussians.scales);
    pairs.flat_map(each).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::{Algorithm, Compute, ModelConfig, synth::Synth};

    fn tiny(salt: &str) -> Predictor {
        let file = "/../tests/golden/model/tiny_config.json#tiny";
        let config = ModelConfig::load(&format!("{}{file}", env!("CARGO_MANIFEST_DIR"))).unwrap();
        let source = Synth { salt: salt.into() };
        Predictor::from_source(&config, source, Compute::cpu(Algorithm::Direct)).unwrap()
    }

    #[test]
    fn a_network_equals_its_own_recording_and_no_other() {
        let values: Vec<f32> = (0..3 * 9 * 7)
            .map(|k| (k * 37 % 101) as f32 / 100.0)
            .collect();
        let image = Planes {
            values: &values,
            width: 9,
            height: 7,
        };
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("recording.safetensors");
        let predictor = tiny("");
        let options = RecordOptions {
            prefix: "dots".into(),
            ..RecordOptions::default()
        };
        record(&predictor, image, 10.0, &options, &path).unwrap();
        let recording = Recording::open(&path).unwrap();
        assert_eq!(recording.prefixes(), ["dots"]);
        let input = recording.input("dots").unwrap();
        assert_eq!((input.width, input.height, input.focal_px), (9, 7, 10.0));
        let same = compare(&predictor, image, 10.0, &recording, "dots").unwrap();
        assert!(same.passes(0.0), "{same:?}");
        assert!(same.stages.len() > 80);
        let other = compare(&tiny("x"), image, 10.0, &recording, "dots").unwrap();
        let first = other.first_divergence(1e-4).unwrap();
        assert_eq!(first.stage, "patch_encoder.patch_embed");
        // Another focal length changes only the stages after the image.
        let closer = compare(&predictor, image, 11.0, &recording, "dots").unwrap();
        let first = closer.first_divergence(1e-4).unwrap();
        assert_eq!(first.stage, "disparity_factor");
    }
}
