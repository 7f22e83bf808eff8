use sharp::camera::{RigidTransform, target_camera_from_source_ndc};
use sharp::color::Quantization;
use sharp::model::{Algorithm, Engine, Predictor};
use sharp::render::{Background, CpuRenderer, RenderView, Renderer};

use super::*;
use crate::data::TrainingView;

struct Same(Sample);

impl Source<MaskedSample> for Same {
    fn get(&self, _: u64) -> Result<MaskedSample, DataError> {
        Ok(MaskedSample {
            sample: self.0.clone(),
            source_mask: None,
        })
    }
}

fn psnr(a: &RgbImage, b: &RgbImage) -> f64 {
    let both = a.as_raw().iter().zip(b.as_raw());
    let square: f64 = both
        .map(|(a, b)| ((f64::from(*a) - f64::from(*b)) / 255.0).powi(2))
        .sum();
    -10.0 * (square / a.as_raw().len() as f64).log10()
}

fn measured(trainer: &Trainer, sample: &Sample) -> [f64; 2] {
    let engine = Engine::cpu(Algorithm::Winograd);
    let predictor = Predictor::from_source(
        &trainer.config.network,
        Snapshot(Arc::clone(&trainer.state)),
        engine,
    )
    .unwrap();
    let k = sample.source.intrinsics;
    let out = predictor
        .predict_rgb8(&sample.source.image, (k.fx / f64::from(k.width)) as f32)
        .unwrap();
    [&sample.source, &sample.target].map(|view: &TrainingView| {
        let from_source: RigidTransform = view
            .camera_from_world
            .after(&sample.source.camera_from_world.inverse());
        let view_of = RenderView {
            eps2d: RenderView::EPS2D_CONFIG,
            ..RenderView::new(
                target_camera_from_source_ndc(&k, &from_source),
                view.intrinsics,
            )
        };
        let rendered = CpuRenderer::new().render(&out.gaussians, &view_of).unwrap();
        psnr(
            &rendered.srgb8(Background::Black, Quantization::Round),
            &view.image,
        )
    })
}

fn env(name: &str, default: f64) -> f64 {
    std::env::var(name).map_or(default, |v| v.parse().unwrap())
}

#[test]
#[ignore]
fn overfit() {
    let side = env("SIDE", 192.0) as u32;
    let steps = env("STEPS", 2000.0) as u64;
    let mut config = match std::env::var("NET") {
        Ok(file) => TrainingConfig {
            network: TrainingConfig::load(Path::new(&file)).unwrap().network,
            ..config([steps, 0], side)
        },
        _ => config([steps, 0], side),
    };
    config.network.vit.init_values = env("GAMMA", 0.1);
    config.stage1.schedule = Schedule {
        peak: env("LR", 2e-3),
        last: env("LAST", 1e-4),
        warmup_steps: env("WARM", 50.0) as u64,
    };
    config.stage1.clip_norm = env("CLIP", 1.0);
    config.loss_options.splat_width = env("SPLAT", 1536.0);
    config.losses.tv = env("TV", 1.0);
    config.losses.grad = env("GRAD", 0.5);
    config.losses.depth = env("DEPTH", 0.2);
    config.aligned = env("ALIGNED", 1.0) > 0.0;
    config.trained.patch_encoder = true;
    config.trained.encoder_norms = true;
    let sample = ProceduralSamples::new(env("SEED", 3.0) as u64, (side, side))
        .get(env("K", 0.0) as u64)
        .unwrap();
    let baseline = sharp::camera::baseline_m(
        &sample.source.camera_from_world,
        &sample.target.camera_from_world,
    );
    println!("{} baseline {baseline}", sample.id);
    let folder = tempfile::tempdir().unwrap();
    sample
        .source
        .image
        .save(format!(
            "/tmp/over-{}-source.png",
            sample.id.replace('/', "-")
        ))
        .unwrap();
    sample
        .target
        .image
        .save(format!(
            "/tmp/over-{}-target.png",
            sample.id.replace('/', "-")
        ))
        .unwrap();
    let mut trainer = Trainer::open(config.clone(), folder.path()).unwrap();
    println!("{:?}", trainer.parameter_counts());
    let mut log = TrainingLog::open(folder.path(), &TERMS, Position::START).unwrap();
    let mut samples = Prefetcher::start(Same(sample.clone()), 0, 1).unwrap();
    let started = Instant::now();
    struct P;
    impl Watcher for P {
        fn stepped(&mut self, r: &StepRecord<'_>, _: u64) {
            if r.position.step % 50 == 0 || r.position.step == 1 {
                let t: String = TERMS
                    .iter()
                    .zip(r.terms)
                    .map(|(n, v)| format!(" {n} {v:.4}"))
                    .collect();
                println!(
                    "{} {:.4}{t} g {:.3} {:.3}s",
                    r.position.step, r.total, r.gradient_norm, r.seconds
                );
            }
        }
        fn validate(
            &mut self,
            _: &Path,
            _: &ModelConfig,
            _: Position,
        ) -> Result<Vec<(String, f64)>, String> {
            Ok(vec![])
        }
        fn stop(&self) -> bool {
            false
        }
    }
    println!("{:?}", measured(&trainer, &sample));
    for step in 1..=steps {
        trainer
            .step(
                Position {
                    stage: Stage::Supervised,
                    step,
                },
                &config.stage1,
                &mut samples,
                &mut log,
                &mut P,
            )
            .unwrap();
        if step % 100 == 0 {
            println!(
                "{step}: {:?} after {:.0?}",
                measured(&trainer, &sample),
                started.elapsed()
            );
        }
    }
}
