//! The learned metrics compared with the f64 references, with every instruction set and algorithm
//! forced, one named test per pair; also the equality of their bits for any number of threads and
//! any strips. Candle's tensors on the CPU, the code that GPUs run, are checked in the same way.
//!
//! What a machine does not support is reported as ignored. `golden_metrics` checks every pair and
//! variant with the machine's default; here, a few pairs of each kind suffice.

use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::sync::{Arc, OnceLock};

use libtest_mimic::{Arguments, Failed, Trial};
use serde_json::Value;
use sharp_metrics::{
    Algorithm, Device, InstructionSet, Picture, Scorer, ScorerOptions, Selection, Simd, Weights,
};

/// Odd sides, minimum sides, grey, and a strong and a barely visible difference.
const PAIRS: [&str; 6] = [
    "rocket_odd97x131",
    "tiny33x20",
    "tiny31",
    "gray_L",
    "black_white",
    "one_lsb",
];
const KEYS: [&str; 4] = ["lpips-alex", "lpips-vgg", "lpips-squeeze", "dists"];
const ALGORITHMS: [(&str, Algorithm); 2] = [
    ("winograd", Algorithm::Winograd),
    ("direct", Algorithm::Direct),
];

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments = Arguments::from_args();
    let text = std::fs::read_to_string(golden().join("golden.json"))?;
    let json: Value = serde_json::from_str(&text)?;
    let pairs = json["pairs"].as_array().ok_or("golden.json has no pairs")?;
    let mut trials = Vec::new();
    for level in InstructionSet::ALL {
        for (name, algorithm) in ALGORITHMS {
            let absent = Simd::new(level).is_none();
            let shared: Arc<OnceLock<Result<Scorer, String>>> = Arc::default();
            for pair in PAIRS {
                let recorded = pairs.iter().find(|p| p["name"] == pair);
                let recorded = recorded.ok_or("a pair is not in golden.json")?.clone();
                let shared = shared.clone();
                let trial = Trial::test(format!("{level} {name} {pair}"), move || {
                    let scorer = shared.get_or_init(|| scorer(level, algorithm, None));
                    agrees(&recorded, scorer.as_ref()?)
                });
                trials.push(trial.with_ignored_flag(absent));
            }
            let trial = Trial::test(format!("{level} {name} same bits"), move || {
                same_bits(level, algorithm)
            });
            trials.push(trial.with_ignored_flag(absent));
        }
    }
    let shared: Arc<OnceLock<Result<Scorer, String>>> = Arc::default();
    for pair in PAIRS {
        let recorded = pairs.iter().find(|p| p["name"] == pair);
        let recorded = recorded.ok_or("a pair is not in golden.json")?.clone();
        let shared = shared.clone();
        trials.push(Trial::test(format!("candle-cpu {pair}"), move || {
            let scorer = shared.get_or_init(|| on_tensors(None));
            agrees(&recorded, scorer.as_ref()?)
        }));
    }
    trials.push(Trial::test("candle-cpu strips", strips_of_tensors));
    libtest_mimic::run(&arguments, trials).exit();
}

fn on_tensors(strip: Option<usize>) -> Result<Scorer, String> {
    let options = ScorerOptions {
        device: Device::CandleCpu,
        strip_rows: strip.and_then(NonZeroUsize::new),
        ..ScorerOptions::default()
    };
    with_options(options)
}

/// The height of strips may change results only by the rounding of f32 features; a misplaced row
/// changes them more.
fn strips_of_tensors() -> Result<(), Failed> {
    let pair = ["ref", "dist"]
        .map(|side| picture(&Value::from(format!("images/rocket_odd97x131_{side}.png"))));
    let [a, b] = pair;
    let pair = [a?, b?];
    let whole = scores(&on_tensors(Some(131))?, &pair)?;
    for strip in [7, 100] {
        let found = scores(&on_tensors(Some(strip))?, &pair)?;
        for ((key, whole), found) in KEYS.iter().zip(&whole).zip(found) {
            let off = (whole.clone()? - found?).abs();
            if off > 1e-7 {
                return Err(format!("{key}: strips of {strip} rows are {off:.1e} off").into());
            }
        }
    }
    Ok(())
}

fn golden() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("golden/metrics")
}

fn picture(file: &Value) -> Result<Picture, Failed> {
    let file = file.as_str().ok_or("a pair lacks a picture")?;
    Ok(image::open(golden().join(file))?.to_rgb8().into())
}

fn scorer(
    level: InstructionSet,
    algorithm: Algorithm,
    strip: Option<usize>,
) -> Result<Scorer, String> {
    let options = ScorerOptions {
        simd: Simd::new(level).ok_or("this machine does not support the instruction set")?,
        algorithm,
        strip_rows: strip.and_then(NonZeroUsize::new),
        ..ScorerOptions::default()
    };
    with_options(options)
}

fn with_options(options: ScorerOptions) -> Result<Scorer, String> {
    let selection = Selection::parse(&KEYS.join(",")).map_err(|e| e.to_string())?;
    Scorer::with_options(&selection, &Weights::deterministic(""), options)
        .map_err(|e| e.to_string())
}

fn scores(scorer: &Scorer, pair: &[Picture; 2]) -> Result<Vec<Result<f64, String>>, Failed> {
    let scores = scorer.score(&pair[0], &pair[1], None)?.into_iter();
    Ok(scores
        .map(|(_, score)| score.map_err(|e| e.to_string()))
        .collect())
}

/// LPIPS must be within max(1e-6, 2e-5 relative) and DISTS within 1e-6 of the f64 references, and
/// there must be no value if the reference has none.
fn agrees(recorded: &Value, scorer: &Scorer) -> Result<(), Failed> {
    let pair = [picture(&recorded["dist"])?, picture(&recorded["ref"])?];
    let lpips = &recorded["lpips"];
    let references = [
        &lpips["alex"],
        &lpips["vgg"],
        &lpips["squeeze"],
        &recorded["dists"],
    ];
    let scored = KEYS.iter().zip(scores(scorer, &pair)?);
    for ((key, score), reference) in scored.zip(references) {
        match (score, reference["f64"].as_f64()) {
            (Ok(score), Some(expected)) => {
                let relative = if *key == "dists" { 0.0 } else { 2e-5 };
                let tolerance = f64::max(1e-6, relative * expected);
                let error = (score - expected).abs();
                if error > tolerance {
                    return Err(format!("{key}: {score} is {error:.1e} from {expected}").into());
                }
            }
            (Err(_), None) => {}
            (score, expected) => {
                return Err(format!("{key}: {score:?}, but expected {expected:?}").into());
            }
        }
    }
    Ok(())
}

/// Compares one thread and the whole picture at once with other numbers of threads and strips.
fn same_bits(level: InstructionSet, algorithm: Algorithm) -> Result<(), Failed> {
    let pair = ["ref", "dist"]
        .map(|side| picture(&Value::from(format!("images/rocket_odd97x131_{side}.png"))));
    let [a, b] = pair;
    let pair = [a?, b?];
    let mut first: Option<Vec<u64>> = None;
    for (strip, threads) in [(Some(131), &[1, 3][..]), (Some(1), &[3]), (None, &[8])] {
        let scorer = scorer(level, algorithm, strip)?;
        for &threads in threads {
            let pool = rayon::ThreadPoolBuilder::new()
                .num_threads(threads)
                .build()?;
            let scores = pool.install(|| scores(&scorer, &pair))?.into_iter();
            let bits: Vec<u64> = scores
                .map(|score| score.map(f64::to_bits))
                .collect::<Result<_, _>>()?;
            if first.get_or_insert_with(|| bits.clone()) != &bits {
                return Err(format!("{threads} threads, strips of {strip:?} rows: others").into());
            }
        }
    }
    Ok(())
}
