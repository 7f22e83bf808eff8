//! Predicts Gaussians from a photograph and renders them from five centimetres to the right.
//!
//! ```console
//! $ cargo run --release -p sharp --features model --example predict_and_render -- right.png photo.jpg sharp.pt
//! ```
//! Without a photograph and a checkpoint, it uses a test picture and the tests' tiny, untrained network.

use std::error::Error;
use std::path::Path;

use glam::DVec3;
use sharp::color::Quantization;
use sharp::model::preprocess::{PhotoOptions, load_photo};
use sharp::model::{ModelConfig, NetworkSpec, Predictor, Silent};
use sharp::render::{Background, CpuRenderer, RenderView, Renderer};
use sharp::trajectory::shifted;
use sharp::unprojection::{release_intrinsics, unproject};

const TINY: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/golden/model");

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let (out, image, spec) = match &arguments[..] {
        [out, image, checkpoint] => (out, image.clone(), NetworkSpec::release(checkpoint)),
        [out] => {
            let mut spec = NetworkSpec::release(format!("{TINY}/tiny_model.pt"));
            spec.config = ModelConfig::load(&format!("{TINY}/tiny_config.json#tiny"))?;
            (out, format!("{TINY}/inputs/main_640x480.png"), spec)
        }
        _ => return Err("usage: predict_and_render OUT.png [PHOTOGRAPH CHECKPOINT]".into()),
    };

    // The focal length determines the metric scale; here it is read from the file's EXIF tags.
    let photo = load_photo(Path::new(&image), &PhotoOptions::default())?;
    let predictor = Predictor::open(&spec)?;
    let factor = photo.disparity_factor();
    let predicted = predictor.predict(photo.planes(), factor, &mut Silent)?;

    // From the network's normalised space to metres, as in the SHARP release's PLY files.
    let camera = release_intrinsics(photo.focal_px, photo.width as u32, photo.height as u32)?;
    let gaussians = unproject(&predicted.gaussians, &camera);

    let right = shifted(DVec3::new(0.05, 0.0, 0.0));
    let view = RenderView::new(right.to_affine(), camera);
    let picture = CpuRenderer::new().render(&gaussians, &view)?;
    let pixels = picture.srgb8(Background::Black, Quantization::Round);
    Ok(pixels.save(out)?)
}
