use super::*;

const TINY: &str = concat!(
    env!("CARGO_MANIFEST_DIR"),
    "/../../tests/golden/model/tiny_config.json#tiny"
);

fn load(text: &str) -> Result<TrainingConfig, String> {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("t.toml");
    std::fs::write(&path, text).unwrap();
    TrainingConfig::load(&path).map_err(|error| error.to_string())
}

#[test]
fn an_empty_file_is_the_papers_training() {
    let config = load("").unwrap();
    assert_eq!(config, TrainingConfig::default());
    assert_eq!((config.stage1.steps, config.stage1.batch), (100_000, 128));
    assert_eq!((config.stage2.steps, config.stage2.batch), (60_000, 32));
    assert_eq!(config.network, ModelConfig::release());
    let bundled = sharp::model::bundled::config().unwrap();
    assert_eq!(load("network = \"mini\"").unwrap().network, bundled);
}

/// The page's first file lists every key with its default; the second can be copied.
#[test]
fn the_files_of_the_page_are_configurations() {
    let page = include_str!("../../../../bench/docs/train.md");
    let files = page.split("```toml\n").skip(1);
    let files = files.map(|rest| load(rest.split("```").next().unwrap()).unwrap());
    let files: Vec<TrainingConfig> = files.collect();
    assert_eq!(files[0], TrainingConfig::default());
    let own = &files[1];
    assert_eq!(
        own.loss_options.splat_width,
        own.network.internal_resolution as f64
    );
    assert_eq!(
        (own.stage2.steps, own.initial.clone()),
        (0, Some("mini".into()))
    );
}

#[test]
fn everything_can_be_set() {
    let config = load(&format!(
        "network.file = {TINY:?}\n\
         trained.alignment = false\n\
         adam = {{ betas = [0.5, 0.9], epsilon = 1e-6, weight_decay = 0.01 }}\n\
         intervals = {{ validation = 0, checkpoint = 7, kept_checkpoints = 1 }}\n\
         [stage1]\nsteps = 20\nbatch = 2\nseed = 9\nclip_norm = inf\n\
         side = 192\ndata.datasets = [\"synthetic=seed=3\"]\n\
         schedule = {{ peak = 1e-3, last = 1e-5, warmup_steps = 5 }}\n\
         max_baseline_m = 2\n\
         [stage2]\nsteps = 0\ndata.photographs = \"mine\"\n"
    ))
    .unwrap();
    assert_eq!(config.network.internal_resolution, 192);
    assert!(!config.trained.alignment && config.trained.image_encoder);
    assert_eq!(config.adam.betas, [0.5, 0.9]);
    assert_eq!(config.intervals.checkpoint, 7);
    let stage = config.stage(Stage::Supervised);
    assert_eq!((stage.seed, stage.clip_norm), (9, f64::INFINITY));
    let specs = vec!["synthetic=seed=3".to_owned()];
    assert_eq!(
        (stage.side, &stage.data),
        (192, &TrainingData::Datasets(specs))
    );
    assert_eq!(
        (stage.schedule.warmup_steps, stage.max_baseline_m),
        (5, 2.0)
    );
    assert_eq!(
        (config.stage2.batch, config.stage2.max_baseline_m),
        (1, 0.6)
    );
    assert_eq!(config.stage2.data, TrainingData::Photographs("mine".into()));
}

#[test]
fn the_alignment_input_is_the_networks() {
    let both = load("alignment_input = \"both_layers\"").unwrap();
    assert_eq!(both.network.alignment_input, AlignmentInput::BothLayers);
    assert_ne!(both.sha256(), TrainingConfig::default().sha256());
    let first = load("alignment_input = \"first_layer\"\naligned = false").unwrap();
    assert_eq!(first.network, ModelConfig::release());
    // The hash is the same as before this key existed.
    assert_eq!(
        TrainingConfig::default().sha256(),
        "9ec774413cd04b0764a504dd7a101e5faa381d0432ac37cbe5a5967f3de6a503"
    );
}

#[test]
fn both_stages_may_have_reflective_scenes() {
    let stage = "steps = 20\nschedule.warmup_steps = 5\ndata = \"reflective\"\n";
    let config = load(&format!("[stage1]\n{stage}[stage2]\n{stage}")).unwrap();
    for stage in Stage::ALL {
        assert_eq!(config.stage(stage).data, TrainingData::Reflective);
    }
}

#[test]
fn errors_name_file_and_key() {
    let is_named = |text: &str, part: &str| {
        let error = load(text).unwrap_err();
        let named = error.contains("t.toml: ") && error.contains(part);
        assert!(named && !error.contains('\n'), "{text}: {error}");
    };
    let stage = "[stage1]\nsteps = 20\nbatch = 1\nschedule.warmup_steps = 5\n";
    for (text, part) in [
        ("stepz = 1", "line 1: unknown field `stepz`"),
        ("\n[stage1]\nbatch = 1", "line 2: missing field `steps`"),
        (
            stage,
            "`stage2` is required if `stage1` is given; `stage2.steps = 0` skips it",
        ),
        (
            "[stage2]\nsteps = 0",
            "`stage1` is required if `stage2` is given",
        ),
        ("[stage1]\nsteps = -1\nbatch = 1", "line 2: invalid value"),
        ("network = \"big\"", "line 1: unknown variant `big`"),
        ("network.file = \"absent.json\"", "`network`: absent.json"),
        (
            "initial = \"a\"\ninitial_depth = \"b\"",
            "`initial_depth` cannot be combined with",
        ),
        (
            "aligned = false\nalignment_input = \"both_layers\"",
            "`alignment_input` is \"both_layers\", but nothing is aligned",
        ),
        ("alignment_input = 2", "line 1: "),
        ("adam.betas = [0.9, 1.0]", "`adam.betas`"),
        ("adam.epsilon = 0.0", "`adam.epsilon`"),
        ("adam.weight_decay = -1.0", "`adam.weight_decay`"),
        ("intervals.checkpoint = 0", "`intervals.checkpoint`"),
        (
            "intervals.kept_checkpoints = 0",
            "`intervals.kept_checkpoints`",
        ),
        (
            "[stage2]\nsteps = 9\nbatch = 1",
            "`stage2.schedule.warmup_steps`",
        ),
        ("[stage2]\nsteps = 0\nbatch = 0", "`stage2.batch`"),
        ("[stage2]\nsteps = 0\nbatch = 65537", "`stage2.batch`"),
        ("[stage2]\nsteps = 4294967297\nbatch = 1", "`stage2.steps`"),
        (
            "[losses]\ncolor = 0\nalpha = 0\npercep = 0\ndepth = 0\ntv = 0\ngrad = 0\ndelta = 0\nsplat = 0\nscale = 0\nscale_gradient = 0",
            "`losses` are all 0",
        ),
        ("losses.tv = -1", "`losses.tv` is negative"),
        ("losses.tv = nan", "`losses.tv` is negative"),
        (
            "loss_options.alpha_floor = 0.0",
            "`loss_options.alpha_floor`",
        ),
        (
            "loss_options.splat_width = nan",
            "`loss_options.splat_width`",
        ),
        (
            "loss_options.percep.gram = -1",
            "`loss_options.percep.gram`",
        ),
        ("loss_options.percep.crop = 7", "`loss_options.percep.crop`"),
        (
            "[stage1]\nsteps = 0\n[stage2]\nsteps = 9\nschedule.warmup_steps = 1\n\
             data.split = { photographs = \"mine\", held_out = 1 }",
            "`stage2.data` holds out everything",
        ),
    ] {
        is_named(text, part);
    }
    for (text, part) in [
        ("clip_norm = nan", "`stage1.clip_norm`"),
        ("schedule.peak = inf", "`stage1.schedule.peak`"),
        ("schedule.last = 1.0", "`stage1.schedule.last`"),
        ("data.datasets = []", "`stage1.data` lists no"),
        ("data.datasets = [\"x=y\"]", "`stage1.data` has no"),
        (
            "data.photographs = \"mine\"",
            "`stage1.data` has photographs",
        ),
        ("side = 0", "`stage1.side` is not"),
        ("max_baseline_m = 0", "`stage1.max_baseline_m` is not"),
        ("data = \"all\"", "line 5: unknown variant"),
    ] {
        is_named(&format!("{stage}{text}"), part);
    }
    let absent = TrainingConfig::load(Path::new("absent.toml")).unwrap_err();
    assert!(absent.to_string().starts_with("absent.toml: "));
}

#[test]
fn the_hash_is_of_what_decides_results() {
    let hash = |change: fn(&mut TrainingConfig)| {
        let mut config = TrainingConfig::default();
        change(&mut config);
        config.sha256()
    };
    let plain = hash(|_| ());
    assert_eq!(plain, hash(|c| c.intervals.checkpoint = 5));
    let others = [
        hash(|c| c.network.vit.norm_eps = 1e-5),
        hash(|c| c.trained.alignment = false),
        hash(|c| c.adam.epsilon = 1e-7),
        hash(|c| c.stage1.seed = 1),
        hash(|c| c.stage2.steps = 1),
    ];
    assert!(others.iter().all(|other| *other != plain));
}
