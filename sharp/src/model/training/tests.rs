use std::collections::BTreeMap;

use super::*;
use crate::model::config::AlignmentInput;
use crate::model::predictor::Predictor;
use crate::model::synth::Synth;
use crate::random::SplitMix64;
use sharp_kernels::Algorithm;

type Weights = BTreeMap<String, Vec<f32>>;

struct Held(Weights);

impl WeightSource for Held {
    fn values(&self, name: &str, _: &[usize]) -> Result<Vec<f32>, ModelError> {
        Ok(self.0.get(name).cloned().unwrap_or_default())
    }
}

fn config() -> ModelConfig {
    let file = "/../tests/golden/model/tiny_config.json#tiny";
    ModelConfig::load(&format!("{}{file}", env!("CARGO_MANIFEST_DIR"))).unwrap()
}

fn network() -> TrainableNetwork {
    TrainableNetwork::new(&config(), Compute::cpu(Algorithm::Winograd)).unwrap()
}

/// A network whose alignment receives both depth layers.
fn both_layers() -> TrainableNetwork {
    let mut config = config();
    config.alignment_input = AlignmentInput::BothLayers;
    TrainableNetwork::new(&config, Compute::cpu(Algorithm::Winograd)).unwrap()
}

fn weights(network: &TrainableNetwork) -> Weights {
    let synth = Synth::default();
    let value = |p: &Parameter| (p.name.clone(), synth.values(&p.name, &p.shape).unwrap());
    network.parameters().iter().map(value).collect()
}

fn noise(seed: u64, len: usize) -> Vec<f32> {
    let mut random = SplitMix64::new(seed);
    (0..len)
        .map(|_| (random.below(2001) as f32 - 1000.0) / 1000.0)
        .collect()
}

/// A picture with structure, and a depth that differs from the network's.
struct Scene {
    image: Vec<f32>,
    known: Vec<f32>,
}

const SIDE: usize = 192;

fn scene() -> Scene {
    let noise = noise(5, 3 * SIDE * SIDE);
    let wave = |k: usize, f: f32| ((k % SIDE) as f32 * f).sin() * ((k / SIDE) as f32 * f).cos();
    let image =
        (0..3 * SIDE * SIDE).map(|k| 0.5 + 0.3 * wave(k % (SIDE * SIDE), 0.11) + 0.1 * noise[k]);
    // Depth is unknown in a third of the picture.
    let known = (0..SIDE * SIDE).map(|k| {
        if k % SIDE < SIDE / 3 {
            0.0
        } else {
            2.5 + wave(k, 0.05)
        }
    });
    Scene {
        image: image.collect(),
        known: known.collect(),
    }
}

impl Scene {
    fn input(&self) -> TrainingInput<'_> {
        TrainingInput {
            image: Planes {
                values: &self.image,
                width: SIDE,
                height: SIDE,
            },
            disparity_factor: 0.8,
            known_depth: Some(&self.known),
            zeros_return: false,
            depth_only: false,
        }
    }
}

/// A loss that is linear in every output of a pass, and its gradient.
struct Loss(PassGradient);

impl Loss {
    fn new(pass: &TrainingPass) -> Self {
        let n = pass.gaussians.len();
        let random = noise(11, 14 * n);
        let gaussians = random
            .chunks_exact(14)
            .map(|r| GaussianGradient {
                mean: [r[0], r[1], r[2]],
                quaternion: [r[3], r[4], r[5], r[6]],
                scales: [r[7] * 30.0, r[8] * 30.0, r[9] * 30.0],
                opacity: r[10],
                color: [r[11], r[12], r[13]],
                view_depth: 0.0,
            })
            .collect();
        Self(PassGradient {
            gaussians,
            inverse_depth: noise(15, pass.base.inverse_depth.len()),
            depth: noise(12, pass.depth.len()),
            factors: noise(13, pass.factors.len()),
            deltas: noise(14, pass.deltas.len()),
        })
    }

    fn of(&self, pass: &TrainingPass) -> f64 {
        let dot = |a: &[f32], b: &[f32]| -> f64 {
            let both = a.iter().zip(b);
            both.map(|(a, b)| f64::from(*a) * f64::from(*b)).sum()
        };
        let g = &pass.gaussians;
        let each = self.0.gaussians.iter().enumerate();
        let gaussians: f64 = each
            .map(|(k, u)| {
                dot(&u.mean, &g.means[k])
                    + dot(&u.quaternion, &g.quaternions[k])
                    + dot(&u.scales, &g.scales[k])
                    + f64::from(u.opacity * g.opacities[k])
                    + dot(&u.color, &g.colors[k])
            })
            .sum();
        gaussians
            + dot(&self.0.inverse_depth, &pass.base.inverse_depth)
            + dot(&self.0.depth, &pass.depth)
            + dot(&self.0.factors, &pass.factors)
            + dot(&self.0.deltas, &pass.deltas)
    }
}

/// Modules whose gradients are checked separately.
const MODULES: [&str; 9] = [
    "encoder.patch_encoder",
    "encoder.image_encoder",
    "encoder.upsample",
    "encoder.fuse_lowres",
    "monodepth_predictor.decoder",
    "monodepth_predictor.head",
    "feature_model",
    "prediction_head",
    "depth_alignment",
];

#[test]
fn gradients_of_every_module_are_those_of_central_differences() {
    assert_central_differences(&network(), &MODULES, [3e-4, 1e-4]);
}

#[test]
fn gradients_through_an_alignment_of_both_layers_are_those_of_central_differences() {
    let modules = ["monodepth_predictor.head", "depth_alignment"];
    assert_central_differences(&both_layers(), &modules, [1e-4, 3e-5]);
}

#[test]
fn an_alignment_of_both_layers_depends_on_the_second() {
    const HEAD: &str = "monodepth_model.monodepth_predictor.head.4.bias";
    let scene = scene();
    let factors = |network: &TrainableNetwork, second: f32| {
        let mut weights = weights(network);
        weights.get_mut(HEAD).unwrap()[1] += second;
        let pass = network.forward(Held(weights), |_| false, scene.input());
        pass.unwrap().factors
    };
    assert_eq!(factors(&network(), 0.0), factors(&network(), 0.5));
    assert_ne!(factors(&both_layers(), 0.0), factors(&both_layers(), 0.5));
}

/// Compares the gradient of each module with central differences along it. `steps` are small
/// compared with the weights; the step that agrees better counts.
fn assert_central_differences(network: &TrainableNetwork, modules: &[&str], steps: [f64; 2]) {
    let scene = scene();
    let weights = weights(network);
    let pass = |weights: Weights| {
        let all = |_: &str| true;
        network.forward(Held(weights), all, scene.input()).unwrap()
    };
    let first = pass(weights.clone());
    let loss = Loss::new(&first);
    let gradients = first.backward(&loss.0).unwrap();
    let used = |name: &str| {
        network
            .parameters()
            .iter()
            .any(|p| p.name == name && p.used)
    };
    for name in weights.keys() {
        let reached = gradients.contains_key(name);
        assert_eq!(reached, used(name), "{name}");
    }
    for &module in modules {
        let of_module: BTreeMap<&String, &Vec<f32>> = gradients
            .iter()
            .filter(|(name, _)| name.contains(module))
            .collect();
        assert!(!of_module.is_empty(), "{module}");
        let square: f64 = of_module
            .values()
            .flat_map(|g| g.iter())
            .map(|v| f64::from(*v).powi(2))
            .sum();
        let length = square.sqrt();
        assert!(length > 0.0, "{module}");
        let moved = |step: f64| {
            let mut moved = weights.clone();
            for (name, gradient) in &of_module {
                for (w, g) in moved.get_mut(*name).unwrap().iter_mut().zip(*gradient) {
                    *w += (step * f64::from(*g) / length) as f32;
                }
            }
            loss.of(&pass(moved))
        };
        let found = |step: f64| (moved(step) - moved(-step)) / (2.0 * step);
        let best = steps
            .map(|step| (found(step) / length - 1.0).abs())
            .into_iter()
            .fold(f64::INFINITY, f64::min);
        assert!(best < 0.01, "{module}: {best}, length {length}");
    }
}

#[test]
fn a_pass_is_the_prediction() {
    let network = network();
    let scene = scene();
    let weights = || Held(weights(&network));
    let input = TrainingInput {
        known_depth: None,
        ..scene.input()
    };
    let frozen = network.forward(weights(), |_| false, input).unwrap();
    let compute = Compute::cpu(Algorithm::Winograd);
    let predictor = Predictor::from_source(&config(), Synth::default(), compute).unwrap();
    let plain = predictor.predict(input.image, 0.8, &mut Silent).unwrap();
    let trained = network.forward(weights(), |_| true, input).unwrap();
    assert!(frozen.gaussians == trained.gaussians);
    // Training processes blocks as pixels, so the last bits differ.
    let pairs = trained.gaussians.means.iter().zip(&plain.gaussians.means);
    for (a, b) in pairs {
        let is_near = |k: usize| (a[k] - b[k]).abs() < 1e-4 * b[2];
        assert!((0..3).all(is_near), "{a:?} {b:?}");
    }
}

/// Compares gradients with those of candle's operations, and their bytes across numbers of threads.
#[test]
fn gradients_are_those_of_any_device_and_the_same_bytes_for_any_threads() {
    let scene = scene();
    let gradients = |compute: Compute| {
        let network = TrainableNetwork::new(&config(), compute).unwrap();
        let weights = Held(weights(&network));
        let pass = network.forward(weights, |_| true, scene.input()).unwrap();
        let loss = Loss::new(&pass);
        pass.backward(&loss.0).unwrap()
    };
    let [one, three] = [1, 3].map(|threads| {
        let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
        let pool = pool.build().unwrap();
        pool.install(|| gradients(Compute::cpu(Algorithm::Direct)))
    });
    assert!(one == three);
    let candle = gradients(Compute::candle(candle_core::Device::Cpu));
    assert_near(&one, &candle, 1e-2);
}

/// Compares the gradients of each parameter, relative to their length.
fn assert_near(found: &Weights, expected: &Weights, tolerance: f64) {
    assert!(found.keys().eq(expected.keys()));
    let length = |values: &mut dyn Iterator<Item = f32>| -> f64 {
        values.map(|v| f64::from(v).powi(2)).sum::<f64>().sqrt()
    };
    for (name, found) in found {
        let whole = length(&mut expected[name].iter().copied());
        let off = length(&mut found.iter().zip(&expected[name]).map(|(a, b)| a - b));
        // Before a group norm the gradients of a bias cancel except for rounding, so errors are
        // also compared with the gradient of the layer's weight.
        let weight = name.replace(".bias", ".weight");
        let of_layer = expected
            .get(&weight)
            .map_or(0.0, |weight| length(&mut weight.iter().copied()));
        let scale = whole.max(0.1 * of_layer);
        assert!(
            off <= tolerance * scale,
            "{name}: {off} of {whole} beside {of_layer}"
        );
    }
}

#[test]
fn frozen_parts_have_no_gradients_and_change_no_others() {
    let network = network();
    let scene = scene();
    let weights = || Held(weights(&network));
    let run = |trainable: fn(&str) -> bool| {
        let pass = network
            .forward(weights(), trainable, scene.input())
            .unwrap();
        let loss = Loss::new(&pass);
        pass.backward(&loss.0).unwrap()
    };
    let all = run(|name| !name.contains("patch_encoder"));
    let head =
        run(|name| name.contains("prediction_head") || name.contains("feature_model.fusion"));
    assert!(all.keys().all(|name| !name.contains("patch_encoder")));
    assert_eq!(head.len(), 4 + 10);
    for (name, gradient) in head {
        let largest = gradient.iter().fold(0.0_f32, |m, v| m.max(v.abs()));
        let both = gradient.iter().zip(&all[&name]);
        assert!(
            both.clone().all(|(a, b)| (a - b).abs() < 1e-4 * largest),
            "{name}"
        );
    }
}

#[test]
fn recomputing_changes_rounding_alone() {
    let scene = scene();
    let trained: [fn(&str) -> bool; 3] = [
        |_| true,
        |name| name.contains("image_encoder") && !name.contains("feature_model"),
        |name| name.contains("feature_model") || name.contains("depth_alignment"),
    ];
    let everywhere = [
        (Compute::cpu(Algorithm::Winograd), &trained[1..]),
        (Compute::candle(candle_core::Device::Cpu), &trained[..1]),
    ];
    for (compute, trained) in everywhere {
        for &trained in trained {
            let [kept, recomputed] = [false, true].map(|recomputes| {
                let mut network = TrainableNetwork::new(&config(), compute.clone()).unwrap();
                assert!(!network.recomputes());
                network.recomputes = recomputes;
                let weights = Held(weights(&network));
                let pass = network.forward(weights, trained, scene.input()).unwrap();
                let loss = Loss::new(&pass);
                (loss.of(&pass), pass.backward(&loss.0).unwrap())
            });
            assert!(!kept.1.is_empty() && kept.0 == recomputed.0);
            assert_near(&recomputed.1, &kept.1, 1e-5);
        }
    }
    let release = ModelConfig::release();
    let release = TrainableNetwork::new(&release, Compute::cpu(Algorithm::Winograd));
    assert!(release.unwrap().recomputes());
}

#[test]
fn depth_that_is_lost_everywhere_returns_where_it_may() {
    const BIAS: &str = "monodepth_model.monodepth_predictor.head.4.bias";
    let network = network();
    let scene = scene();
    let mut lost = weights(&network);
    lost.insert(BIAS.to_owned(), vec![-100.0; LAYERS]);
    // The loss falls when the depth does.
    let of_bias = |zeros_return: bool| {
        let input = TrainingInput {
            known_depth: None,
            zeros_return,
            ..scene.input()
        };
        let trainable = |name: &str| name == BIAS;
        let pass = network
            .forward(Held(lost.clone()), trainable, input)
            .unwrap();
        let mut upstream = pass.zero_gradient();
        upstream.depth.fill(1e-6);
        pass.backward(&upstream).unwrap().remove(BIAS)
    };
    assert_eq!(of_bias(false).unwrap(), [0.0; LAYERS]);
    assert!(of_bias(true).unwrap().iter().all(|g| *g < 0.0));
}

#[test]
fn gradients_of_another_size_are_refused() {
    let network = network();
    let scene = scene();
    let weights = || Held(weights(&network));
    let pass = network.forward(weights(), |_| true, scene.input()).unwrap();
    let mut upstream = Loss::new(&pass).0;
    upstream.depth.pop();
    let found = pass.backward(&upstream).unwrap_err().to_string();
    assert!(
        found.contains("73727") && found.contains("depth"),
        "{found}"
    );
    let lacking = Held(Weights::new());
    let found = network.forward(lacking, |_| true, scene.input());
    assert!(matches!(found, Err(ModelError::Weights { .. })));
}
