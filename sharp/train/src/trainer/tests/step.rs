use sharp::composer::compose;
use sharp::model::config::AlignmentInput;
use sharp_checkpoint::Checkpoint;

use super::*;
use crate::data::Source;

/// Example `k` of a training, as a step receives it.
fn example(training: &Training, k: u64) -> Sample {
    let config = &training.trainer.config;
    let source = Examples::open(config, Stage::Supervised, Path::new(""));
    source.unwrap().get(k).unwrap()
}

#[test]
fn before_the_first_step_the_network_changes_nothing() {
    let training = Training::new(&config([1, 0], 96));
    let trainer = &training.trainer;
    let source = example(&training, 0).source;
    let values = planes_of(source.image.as_raw(), |v| f32::from(v) / 255.0);
    let known = known_depth(&source, trainer.config.network.internal_resolution);
    let input = TrainingInput {
        image: Planes {
            values: &values,
            width: 96,
            height: 96,
        },
        disparity_factor: 0.8,
        known_depth: Some(&known),
        zeros_return: false,
        depth_only: false,
    };
    let snapshot = Snapshot(Arc::clone(&trainer.state));
    let pass = trainer.network.forward(snapshot, |_| true, input).unwrap();
    assert!(pass.factors.iter().all(|factor| *factor == 1.0));
    assert!(pass.deltas.iter().all(|delta| *delta == 0.0));
    let zeros = vec![0.0; pass.deltas.len()];
    assert_eq!(pass.gaussians, compose(&pass.base, Some(&zeros)).unwrap());
    let (first, second) = pass.depth.split_at(pass.depth.len() / 2);
    assert_eq!(first, second);
}

/// Weights whose outputs are multiplied by zero weights have no gradient yet.
#[test]
fn the_first_step_changes_what_learns_and_nothing_else() {
    let mut training = Training::new(&config([1, 0], 96));
    let before = Arc::clone(&training.trainer.state);
    training.trainer.run(&mut Silent).unwrap();
    let (mut changed, mut frozen) = (0, 0);
    for (before, after) in before.weights.iter().zip(&training.trainer.state.weights) {
        let name = after.name.as_str();
        let last_of_alignment = "depth_alignment.scale_map_estimator.conv_out.";
        let behind_zeros = name.starts_with("feature_model")
            || (name.starts_with("depth_alignment") && !name.starts_with(last_of_alignment));
        let learns = training.trainer.config.trained.contain(name);
        assert_eq!(after.moments.is_some(), learns, "{name}");
        let is_same = before.values == after.values;
        assert_eq!(is_same, !learns || behind_zeros, "{name}");
        changed += usize::from(!is_same);
        frozen += usize::from(!learns);
    }
    assert!(changed > 50 && frozen > 50, "{changed} {frozen}");
}

/// [`StepSum`] of some examples, divided by their number.
fn mean(training: &mut Training, examples: std::ops::Range<u64>) -> StepSum {
    let mut sum = StepSum::default();
    let count = examples.clone().count();
    for k in examples {
        let seed = mix(training.trainer.config.stage1.seed ^ mix(k));
        let example = example(training, k);
        sum.add(training.trainer.example(&example, seed).unwrap());
    }
    sum.divide_by(count);
    sum
}

#[test]
fn a_batch_has_the_mean_of_its_examples_gradients() {
    let mut batched = config([1, 0], 96);
    batched.stage1.batch = 2;
    batched.stage1.clip_norm = f64::INFINITY;
    let mut training = Training::new(&batched);
    let [first, second] = [0..1, 1..2].map(|k| mean(&mut training, k));
    assert!(first.total != second.total);
    training.trainer.run(&mut Silent).unwrap();
    let log = std::fs::read_to_string(training.path("log.csv")).unwrap();
    let total: f64 = log
        .lines()
        .nth(1)
        .unwrap()
        .split(',')
        .rev()
        .nth(1)
        .unwrap()
        .parse()
        .unwrap();
    assert!((total - (first.total + second.total) / 2.0).abs() < 1e-12);
    let moments = training.trainer.state.weights.iter();
    let moments = moments.filter_map(|weights| weights.moments.as_ref());
    let both = first.gradients.iter().zip(&second.gradients);
    for (moments, (first, second)) in moments.zip(both) {
        let largest = first
            .iter()
            .chain(second)
            .fold(0.0_f32, |m, g| m.max(g.abs()));
        for (k, moment) in moments.first.iter().enumerate() {
            // Adam's first moment after one step is a tenth of the gradient.
            let expected = 0.1 * (first[k] + second[k]) / 2.0;
            assert!(
                (moment - expected).abs() <= 1e-7 * largest,
                "{moment} {expected}"
            );
        }
    }
}

#[test]
fn what_is_not_finite_ends_the_training_and_leaves_its_inputs() {
    let head = "prediction_head.geometry_prediction_head.bias";
    let cases = [
        (head, f32::NAN, "the gradient"),
        (head, f32::INFINITY, "the loss"),
        ("feature_model.fusion", 1e30, "the loss"),
        ("monodepth_predictor.head.4.bias", f32::NAN, "the depth"),
        ("scale_map_estimator.conv_out.bias", 200.0, "the depth"),
        ("image_encoder.blocks.0.norm1.weight", f32::NAN, "the depth"),
    ];
    for (part, value, expected) in cases {
        let mut training = Training::new(&config([3, 0], 48));
        training.overwrite(part, value);
        let before = Arc::clone(&training.trainer.state);
        let error = training.trainer.run(&mut Silent).unwrap_err();
        let TrainingError::NotFinite {
            position,
            what,
            folder,
        } = error
        else {
            panic!("{part} of {value}: {error}");
        };
        assert_eq!((what, position.step), (expected, 1), "{part} of {value}");
        assert!(Arc::ptr_eq(&before, &training.trainer.state));
        assert_eq!(folder, training.path("stopped-stage1-step1"));
        let saved = example(&training, 0);
        let id = saved.id.clone();
        for (role, view) in [("source", saved.source), ("target", saved.target)] {
            let picture = image::open(folder.join(format!("{role}.png"))).unwrap();
            assert_eq!(picture.into_rgb8(), view.image);
            let depth = std::fs::read(folder.join(format!("{role}-depth.f32"))).unwrap();
            let (depth, _) = depth.as_chunks::<4>();
            let depth = depth.iter().map(|bytes| f32::from_le_bytes(*bytes));
            assert!(depth.eq(view.depth.iter().copied()));
        }
        let text = std::fs::read_to_string(folder.join("step.json")).unwrap();
        let is_whole = text.contains(&id) && text.contains("camera_from_world");
        assert!(is_whole, "{text}");
        assert_eq!(text.contains("color"), what != "the depth", "{text}");
        // The state includes the steps since the last checkpoint.
        let again =
            Trainer::open(training.trainer.config, None, training.folder.path(), cpu()).unwrap();
        assert_eq!(*again.state == *before, value.is_finite(), "{part}");
    }
}

#[test]
fn an_alignment_of_both_layers_is_trained_and_its_weights_are_told_apart() {
    const FIRST: &str = "depth_alignment.scale_map_estimator.encoder.conv_in.0.weight";
    let first_layer = config([3, 0], 48);
    let mut both_layers = first_layer.clone();
    both_layers.network.alignment_input = AlignmentInput::BothLayers;
    let mut training = Training::new(&both_layers);
    let weights = |training: &Training| {
        let mut weights = training.trainer.state.weights.iter();
        let first = weights.find(|weights| weights.name == FIRST).unwrap();
        first.clone()
    };
    let before = weights(&training);
    training.trainer.run(&mut Silent).unwrap();
    let after = weights(&training);
    assert_eq!(after.shape[1], 3);
    assert!(after.values.iter().all(|value| value.is_finite()));
    // Every channel learns: kernels are [output, input, row, column].
    for channel in 0..3 {
        let kernels = |values: &[f32]| -> Vec<f32> {
            let kernels = values.chunks_exact(9).skip(channel).step_by(3);
            kernels.flatten().copied().collect()
        };
        assert_ne!(kernels(&before.values), kernels(&after.values), "{channel}");
    }
    let mut other = Training::new(&first_layer);
    other.trainer.run(&mut Silent).unwrap();
    let [log, other_log] = [&training, &other].map(|t| std::fs::read(t.path("log.csv")).unwrap());
    assert_ne!(log, other_log);

    let file = training.path("both.safetensors");
    training.trainer.export(&file, Precision::F32).unwrap();
    both_layers.initial = Some(file.clone());
    assert_eq!(weights(&Training::new(&both_layers)).values, after.values);
    let refused = TrainingConfig {
        initial: Some(file),
        ..first_layer
    };
    let folder = tempfile::tempdir().unwrap();
    let opened = Trainer::open(refused, None, folder.path(), cpu());
    let error = opened.err().unwrap().to_string();
    assert!(error.contains("set `alignment_input`"), "{error}");
}

/// The teacher is the network with its initial weights.
#[test]
fn the_second_stage_may_be_the_only_one() {
    let mut training = Training::new(&config([0, 1], 48));
    let ended = training.trainer.run(&mut Silent).unwrap();
    assert_eq!(ended, Ended::Complete);
    let stage = Stage::SelfSupervised;
    assert_eq!(training.trainer.position(), Position { stage, step: 1 });
}

/// Training on depth alone skips half of the network and trains the rest in the same way.
#[test]
fn depth_is_learnt_alone_as_with_everything_else() {
    let mut alone = config([1, 0], 96);
    alone.losses = LossWeights {
        color: 0.0,
        alpha: 0.0,
        grad: 0.0,
        delta: 0.0,
        splat: 0.0,
        ..alone.losses
    };
    let training = Training::new(&alone);
    let trainer = &training.trainer;
    assert!(trainer.objective.is_of_depth_alone());
    let sample = example(&training, 0);
    let source = &sample.source;
    let found = trainer.example(&sample, 1).unwrap();
    assert!(found.terms[3] > 0.0 && found.terms[..3] == [0.0; 3]);

    let values = planes_of(source.image.as_raw(), |v| f32::from(v) / 255.0);
    let known = known_depth(source, alone.network.internal_resolution);
    let input = TrainingInput {
        image: Planes {
            values: &values,
            width: 96,
            height: 96,
        },
        disparity_factor: (source.intrinsics.fx / 96.0) as f32,
        known_depth: Some(&known),
        zeros_return: false,
        depth_only: false,
    };
    let snapshot = Snapshot(Arc::clone(&trainer.state));
    let parts = alone.trained;
    let trains = move |name: &str| parts.contain(name);
    let pass = trainer.network.forward(snapshot, trains, input).unwrap();
    let whole = Example {
        source,
        target: &sample.target,
        seed: 1,
    };
    let cost = trainer.objective.cost(&pass, &whole).unwrap();
    let expected = pass.backward(&cost.gradient).unwrap();
    let learning = trainer.state.weights.iter().filter(|w| w.moments.is_some());
    let mut moved = 0;
    for (weights, found) in learning.zip(&found.gradients) {
        let zeros = vec![0.0; found.len()];
        let expected = expected.get(&weights.name).unwrap_or(&zeros);
        assert_eq!(found, expected, "{}", weights.name);
        moved += usize::from(*found != zeros);
    }
    assert!(moved > 50, "{moved}");
}

/// Parameters that have separate values for the two depth layers.
const LAYERED: &str = "monodepth_predictor.head.4.";

#[test]
fn a_trained_depth_network_goes_with_gaussians_of_any_stride() {
    let mut first = Training::new(&config([1, 0], 96));
    // Make the two layers differ.
    let state = Arc::make_mut(&mut first.trainer.state);
    for weights in &mut state.weights {
        if weights.name.contains(LAYERED) {
            let values = weights.values.iter_mut().enumerate();
            values.for_each(|(at, value)| *value += at as f32);
        }
    }
    let file = first.path("depth.safetensors");
    first.trainer.export(&file, Precision::F32).unwrap();
    let mut coarse = config([1, 0], 96);
    coarse.network.gaussian_stride = 4;
    coarse.stage1.seed += 1;
    let untrained = Training::new(&coarse);
    coarse.initial_depth = Some(file.clone());
    let second = Training::new(&coarse);
    let states = [&first, &untrained, &second].map(|t| &t.trainer.state.weights);
    let [first, untrained, second] = states;
    for ((first, untrained), second) in first.iter().zip(untrained).zip(second) {
        let mut expected = if second.name.starts_with("monodepth_model.") {
            first.values.clone()
        } else {
            untrained.values.clone()
        };
        if second.name.contains(LAYERED) {
            let layer = expected[..expected.len() / 2].to_vec();
            assert_ne!(expected, layer.repeat(2));
            expected = layer.repeat(2);
        }
        assert_eq!(second.values, expected, "{}", second.name);
    }

    let mut other = coarse;
    other.network.monodepth_dims_decoder = [8; 5];
    let opened = Trainer::open(other, None, tempfile::tempdir().unwrap().path(), cpu());
    let error = opened.err().unwrap().to_string();
    assert!(error.contains("monodepth_predictor.decoder"), "{error}");
}

#[test]
fn depth_pro_becomes_the_depth_network_with_its_layer_twice() {
    let golden = concat!(env!("CARGO_MANIFEST_DIR"), "/../../tests/golden");
    let file = PathBuf::from(format!("{golden}/depth_pro/narrow_model.pt"));
    let stored = Checkpoint::open(&file).unwrap();
    let mut config = config([1, 0], 96);
    config.network = ModelConfig::load(&format!("{golden}/model/tiny_config.json#narrow")).unwrap();
    // Of smaller pictures, so that only position embeddings differ.
    config.network.vit.img_size = 128;
    config.network.internal_resolution = 512;
    config.initial_depth = Some(file);
    let training = Training::new(&config);
    let mut layered = 0;
    for weights in &training.trainer.state.weights {
        let own = weights
            .name
            .strip_prefix("monodepth_model.monodepth_predictor.");
        let Some(own) = own.filter(|own| !own.ends_with("pos_embed")) else {
            continue;
        };
        let mut expected = stored.tensor_f32(own).unwrap();
        if weights.name.contains(LAYERED) {
            expected = expected.repeat(2);
            layered += 1;
        }
        assert_eq!(weights.values, expected, "{own}");
    }
    assert_eq!(layered, 2);
}

#[test]
fn a_network_goes_on_with_larger_pictures() {
    let small = Training::new(&config([1, 0], 96));
    let file = small.path("small.safetensors");
    small.trainer.export(&file, Precision::F32).unwrap();
    let mut large = config([1, 0], 96);
    large.network.vit.img_size *= 2;
    large.network.internal_resolution *= 2;
    large.stage1.seed += 1;
    let channels = large.network.vit.embed_dim;
    let tokens = large.network.vit.tokens_per_side();
    large.initial = Some(file.clone());
    let whole = Training::new(&large);
    (large.initial, large.initial_depth) = (None, Some(file));
    let depth = Training::new(&large);
    let mut resampled = 0;
    let [small, whole, depth] = [&small, &whole, &depth].map(|t| &t.trainer.state.weights);
    for (small, large) in small.iter().zip(whole) {
        if !large.name.ends_with("pos_embed") {
            assert_eq!(small.values, large.values, "{}", large.name);
            continue;
        }
        resampled += 1;
        assert_eq!(large.values.len(), (tokens * tokens + 1) * channels);
        // The class token and the corners are unchanged.
        let row = |values: &[f32], at: usize| values[at * channels..][..channels].to_vec();
        let (n, last) = (tokens / 2, tokens * tokens);
        for (there, here) in [(0, 0), (1, 1), (n, tokens), (n * n, last)] {
            assert_eq!(row(&small.values, there), row(&large.values, here));
        }
        // The second token of the first row is interpolated linearly.
        let at = (n - 1) as f32 / (tokens - 1) as f32;
        let [first, second] = [1, 2].map(|token| row(&small.values, token));
        let found = row(&large.values, 2);
        for ((first, second), found) in first.iter().zip(second).zip(found) {
            assert!((first + at * (second - first) - found).abs() < 1e-6);
        }
    }
    assert_eq!(resampled, 2);
    for (depth, whole) in depth.iter().zip(whole) {
        if depth.name.ends_with("pos_embed") {
            assert_eq!(depth.values, whole.values);
        }
    }
}

#[test]
fn weights_to_begin_with_are_finite() {
    let training = Training::new(&config([1, 0], 48));
    let file = training.path("w.safetensors");
    training.trainer.export(&file, Precision::F32).unwrap();
    let mut bytes = std::fs::read(&file).unwrap();
    // The first value of the first tensor.
    let header = u64::from_le_bytes(bytes[..8].try_into().unwrap()) as usize;
    bytes[8 + header..][..4].copy_from_slice(&f32::NAN.to_le_bytes());
    std::fs::write(&file, bytes).unwrap();
    let mut begun = config([1, 0], 48);
    begun.initial = Some(file);
    let opened = Trainer::open(begun, None, tempfile::tempdir().unwrap().path(), cpu());
    let error = opened.err().unwrap().to_string();
    assert!(
        error.contains("w.safetensors") && error.contains("NaN"),
        "{error}"
    );
}

#[test]
fn a_photograph_that_cannot_be_read_costs_no_step() {
    let folder = tempfile::tempdir().unwrap();
    let mut config = config([0, 50], 48);
    config.intervals.checkpoint = 1000;
    config.stage2.data = TrainingData::Photographs(folder.path().to_owned());
    for name in ["a.png", "b.png", "c.png", "d.png"] {
        let picture = image::RgbImage::from_fn(48, 48, |x, y| {
            image::Rgb([x as u8 * 5, y as u8 * 5, name.as_bytes()[0]])
        });
        picture.save(folder.path().join(name)).unwrap();
    }
    std::fs::write(folder.path().join("b.png"), "no picture").unwrap();
    std::fs::create_dir(folder.path().join("folder.png")).unwrap();
    let mut training = Training::new(&config);
    let error = training.trainer.run(&mut Silent).unwrap_err();
    assert!(error.to_string().contains("b.png"), "{error}");
    let made = training.trainer.position();
    assert!(made.step > 0, "the first photograph is the broken one");
    let taken_up = Trainer::open(config, None, training.folder.path(), cpu()).unwrap();
    assert_eq!(taken_up.position(), made);
}

#[test]
fn photographs_of_the_second_stage_are_looked_for_before_the_first() {
    let mut missing = config([1, 1], 48);
    missing.stage2.data = TrainingData::Photographs("absent".into());
    let opened = Trainer::open(missing, None, tempfile::tempdir().unwrap().path(), cpu());
    let error = opened.err().unwrap().to_string();
    assert!(error.contains("absent"), "{error}");
}

#[test]
fn gradients_that_are_finite_one_by_one_may_overflow_together() {
    let one = || StepSum {
        gradients: vec![vec![f32::MAX, 1.0]],
        ..StepSum::default()
    };
    let mut sum = one();
    assert_eq!(sum.not_finite(), None);
    sum.add(one());
    assert_eq!(sum.not_finite(), Some("the gradient"));
    sum.total = f64::NAN;
    assert_eq!(sum.not_finite(), Some("the loss"));
}
