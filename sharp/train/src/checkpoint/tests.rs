use std::fs;

use sharp::model::inventory::{CheckpointSource, inventory};
use sharp::model::synth::Synth;
use sharp::model::{ModelConfig, NetworkSpec, Predictor};

use super::*;

const TINY: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/../../tests/golden/model/tiny_config.json#tiny"
);
const PARTS: fn() -> TrainedParts = TrainedParts::default;

fn tiny() -> Vec<Parameter> {
    inventory(&ModelConfig::load(TINY).unwrap()).unwrap()
}

/// A state in the middle of the first stage, with non-zero moments.
fn state() -> TrainingState {
    let mut state = TrainingState::new(&tiny(), &PARTS(), &Synth::default()).unwrap();
    for weights in &mut state.weights {
        let ParameterState {
            values, moments, ..
        } = weights;
        if let Some(Moments { first, second }) = moments {
            first
                .iter_mut()
                .zip(&*values)
                .for_each(|(m, v)| *m = -2.0 * v);
            second
                .iter_mut()
                .zip(&*values)
                .for_each(|(m, v)| *m = v * v);
        }
    }
    state.position.step = 7;
    state
}

fn load(path: &Path, config: &str) -> Result<TrainingState, StateError> {
    TrainingState::load(path, config, &tiny(), &PARTS())
}

#[test]
fn a_state_comes_back_as_it_was_and_in_the_same_bytes() {
    let dir = tempfile::tempdir().unwrap();
    let [a, b] = ["a", "b"].map(|name| dir.path().join(name));
    let state = state();
    state.save(&a, "hash").unwrap();
    let loaded = load(&a, "hash").unwrap();
    assert_eq!(loaded, state);
    loaded.save(&b, "hash").unwrap();
    assert_eq!(fs::read(a).unwrap(), fs::read(b).unwrap());
    assert_eq!(fs::read_dir(dir.path()).unwrap().count(), 2);
    let trained = |weights: &&ParameterState| weights.moments.is_some();
    let count = state.weights.iter().filter(trained).count();
    assert!(count > 0 && count < state.weights.len());
}

#[test]
fn a_stage_begins_with_moments_of_zero() {
    let mut state = state();
    let before = state.clone();
    state.begin(Stage::SelfSupervised);
    let (stage, step) = (Stage::SelfSupervised, 0);
    assert_eq!(state.position, Position { stage, step });
    for (now, before) in state.weights.iter().zip(&before.weights) {
        assert_eq!(now.values, before.values);
        let zero = Moments::zero(now.values.len());
        assert_eq!(now.moments, before.moments.as_ref().map(|_| zero));
    }
}

#[test]
fn what_cannot_be_gone_on_from_is_refused_with_its_reason() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("s");
    let refused = |config: &str| load(&path, config).unwrap_err().to_string();
    assert!(refused("hash").contains("s: "));

    let mut state = state();
    state.save(&path, "hash").unwrap();
    assert!(refused("other").contains("another configuration (hash hash, now other)"));
    let mut more = PARTS();
    more.patch_encoder = true;
    let error = TrainingState::load(&path, "hash", &tiny(), &more).unwrap_err();
    assert!(
        error.to_string().contains("missing: first_moment."),
        "{error}"
    );
    let whole = fs::read(&path).unwrap();
    fs::write(&path, &whole[..whole.len() - 1]).unwrap();
    assert!(matches!(load(&path, "hash"), Err(StateError::File(_))));

    state
        .export(&path, Precision::F32, &BTreeMap::new())
        .unwrap();
    assert!(refused("hash").contains("no valid `stage`"));

    let trained = state
        .weights
        .iter()
        .position(|w| w.moments.is_some())
        .unwrap();
    let name = state.weights[trained].name.clone();
    state.weights[trained].values[1] = f32::NAN;
    // A state that cannot be written must not replace a good one.
    let unwritten = |state: &TrainingState| {
        let before = fs::read(&path).unwrap();
        let error = state.save(&path, "hash").unwrap_err().to_string();
        assert_eq!(fs::read(&path).unwrap(), before);
        error
    };
    let error = unwritten(&state);
    assert!(error.contains(&format!("'values.{name}' has a value of NaN")));
    state.weights[trained].values[1] = 0.0;
    state.weights[trained].moments.as_mut().unwrap().second[0] = -0.5;
    let error = unwritten(&state);
    assert!(error.contains(&format!("'second_moment.{name}' has a value of -0.5")));
}

#[test]
fn a_source_of_another_length_is_refused() {
    struct Short;
    impl WeightSource for Short {
        fn values(&self, _: &str, _: &[usize]) -> Result<Vec<f32>, ModelError> {
            Ok(vec![0.0])
        }
    }
    let made = TrainingState::new(&tiny(), &PARTS(), &Short);
    assert!(matches!(made, Err(ModelError::Weights { found: 1, .. })));
}

#[test]
fn exported_weights_are_a_networks_checkpoint_in_either_precision() {
    let dir = tempfile::tempdir().unwrap();
    let mut state = state();
    let metadata = BTreeMap::from([("licence".to_owned(), "MIT".to_owned())]);
    for precision in [Precision::F32, Precision::F16] {
        let path = dir.path().join("w.safetensors");
        state.export(&path, precision, &metadata).unwrap();
        let spec = NetworkSpec {
            config: ModelConfig::load(TINY).unwrap(),
            ..NetworkSpec::release(&path)
        };
        Predictor::open(&spec).unwrap();
        let source = CheckpointSource::open(&path).unwrap();
        for ParameterState {
            name,
            shape,
            values,
            ..
        } in &state.weights
        {
            let stored = |v: &f32| match precision {
                Precision::F32 => *v,
                Precision::F16 => f16::from_f32(*v).to_f32(),
            };
            let expected: Vec<f32> = values.iter().map(stored).collect();
            assert_eq!(source.values(name, shape).unwrap(), expected, "{name}");
        }
        assert_eq!(Checkpoint::open(&path).unwrap().metadata(), &metadata);
    }
    state.weights[0].values[0] = 1e5;
    let path = dir.path().join("large");
    state.export(&path, Precision::F32, &metadata).unwrap();
    let error = state.export(&path, Precision::F16, &metadata).unwrap_err();
    assert!(matches!(error, StateError::Value { value: 1e5, .. }));
}

#[test]
fn the_latest_states_are_kept_and_strangers_left_alone() {
    let dir = tempfile::tempdir().unwrap();
    let folder = CheckpointFolder::new(dir.path().join("states"));
    assert_eq!(folder.positions().unwrap(), []);
    let mut state = state();
    let at = |stage, step| Position { stage, step };
    let supervised = [2, 10, 9].map(|step| at(Stage::Supervised, step));
    let all = [
        supervised[0],
        supervised[2],
        supervised[1],
        at(Stage::SelfSupervised, 1),
    ];
    for (k, position) in all.into_iter().enumerate() {
        state.position = position;
        folder.save(&state, "hash", 2).unwrap();
        if k == 1 {
            for name in ["stage1-step1.safetensors", "notes.txt"] {
                fs::write(dir.path().join("states").join(name), "x").unwrap();
            }
        }
    }
    assert_eq!(folder.positions().unwrap(), all[2..]);
    let latest = load(&folder.file(all[3]), "hash").unwrap();
    assert_eq!(latest, state);
    assert_eq!(fs::read_dir(dir.path().join("states")).unwrap().count(), 4);
}
