//! Every metric compared with the values of the reference implementations, one named test per
//! picture pair and key.
//!
//! Expected values are in `golden/metrics/golden.json`; if it has `null`, an error or a value that
//! is not a number, the metric must be unavailable here. Pairs whose pictures may not be
//! redistributed are read from the folder given by `SHARP_BENCH_SHARED` (default `../shared` next
//! to the checkout); without it, they are reported as ignored.

use std::path::{Path, PathBuf};
use std::sync::{Arc, LazyLock, OnceLock};

use libtest_mimic::{Arguments, Failed, Trial};
use safetensors::SafeTensors;
use serde_json::Value;
use sharp_metrics::{Backbone, Examined, MetricKey, Picture, Scorer, Selection, Terms, Weights};
use sharp_tests::{rows, shared_data};

/// Keys, the entries of `golden.json` that they must equal to 1e-9, which their authors compute in f64, and those to
/// 1e-5, which OpenCV and kornia compute in f32. In f64, dm_pix's bound (`cov=bounded`) changes less than its rounding
/// does.
const SSIM: &str = "\
ssim[gauss11,valid] | gauss11_valid skimage_gauss_popcov | kornia_valid
ssim[gauss11,valid,cov=bounded] | gauss11_valid |
ssim[gauss11,zero] | gauss11_zeropad_3dgs |
ssim[gauss11,reflect] | gauss11_reflect101 torchmetrics_1_9_data_range1 | kornia_same cv2_quality_ssim_uint8
ssim[uniform7,sample] | skimage_uniform7_samplecov skimage_uniform7_uint8 |
ssim[uniform7,population] | skimage_uniform7_popcov |
ssim[gauss11,valid,sample] | skimage_gauss_samplecov |
ssim[gauss11,valid,gray] | skimage_gauss_popcov_gray |
ssim[gauss11,reflect,range=data] | torchmetrics_1_9_data_range_none |";

/// kornia adds 1e-12 to the denominator, which is C1·C2 = 9e-8 where both windows are black; there,
/// its value is 1.11e-5 below the definition's.
const KORNIA_BLACK: f64 = 1.2e-5;

/// Tolerance of a learned metric: absolute, or relative if that is more.
type Tolerance = (f64, f64);
/// PSNR: sums of squares are exact integers.
const PSNR: Tolerance = (1e-9, 0.0);
const LPIPS: Tolerance = (1e-6, 2e-5);
/// LPIPS, if the reference itself is f32.
const LPIPS_F32: Tolerance = (2e-5, 5e-5);
const LPIPS_REAL: Tolerance = (2e-6, 0.0);
const DISTS: Tolerance = (1e-6, 0.0);
const PUBLISHED_WEIGHTS: Tolerance = (1e-6, 0.0);
const DISTS_F32: Tolerance = (2e-5, 0.0);

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments = Arguments::from_args();
    let text = std::fs::read_to_string(golden().join("golden.json"))?;
    let json: Value = serde_json::from_str(&text)?;
    let mut trials = Vec::new();
    let pairs = json["pairs"].as_array().ok_or("golden.json has no pairs")?;
    // Not every pair has these, but some must: if no pair had them, every trial would be ignored.
    for (net, reference) in [("vgg", "f64_torchmetrics_eps"), ("vgg", "f64_unscaled01")] {
        if pairs
            .iter()
            .all(|pair| pair["lpips"][net][reference].is_null())
        {
            return Err(format!("no pair has lpips {net} {reference}").into());
        }
    }
    for pair in pairs {
        let pair = Arc::new(Pair::of(pair).ok_or("a pair lacks its name or files")?);
        trials.extend(pair.classical());
        for net in ["alex", "vgg", "squeeze"] {
            trials.extend(pair.lpips(net));
        }
        trials.extend(pair.dists());
        trials.push(pair.real_squeeze());
    }
    trials.extend(spatial_maps(&json)?);
    trials.extend(published_weights()?);
    libtest_mimic::run(&arguments, trials).exit();
}

/// All metrics with the weights of the golden data, created once for all pairs.
static SCORER: LazyLock<Result<Scorer, String>> =
    LazyLock::new(|| scorer("all", &Weights::deterministic("")));
/// Metrics whose maps are compared.
static MAPPED: LazyLock<Result<Scorer, String>> = LazyLock::new(|| {
    scorer(
        "lpips-alex,lpips-vgg,lpips-squeeze",
        &Weights::deterministic(""),
    )
});
/// LPIPS with the published, trained weights of SqueezeNet.
static REAL: LazyLock<Result<Scorer, String>> = LazyLock::new(|| {
    let weights = Weights::none().with_file(Backbone::SqueezeNet1_1, real_squeezenet());
    scorer("lpips-squeeze", &weights)
});

/// The metrics as everyone uses them, with the published weights that ship with the product.
static PUBLISHED: LazyLock<Result<Scorer, String>> = LazyLock::new(|| {
    scorer(
        "lpips-alex,lpips-vgg,lpips-vgg-unscaled,dists",
        &Weights::at_hand(),
    )
});

fn scorer(list: &str, weights: &Weights) -> Result<Scorer, String> {
    let selection = Selection::parse(list).map_err(|e| e.to_string())?;
    Scorer::new(&selection, weights).map_err(|e| e.to_string())
}

fn real_squeezenet() -> PathBuf {
    shared_data().join("golden/metrics/weights/squeezenet1_1_features_real.safetensors")
}

fn golden() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("golden/metrics")
}

struct Pair {
    name: String,
    /// Prediction and target; `None` if a picture is neither here nor in the shared folder.
    files: Option<[PathBuf; 2]>,
    json: Value,
    examined: OnceLock<Result<Examined, String>>,
}

type Check = Box<dyn FnOnce(&Pair) -> Result<(), Failed> + Send>;

impl Pair {
    fn of(json: &Value) -> Option<Self> {
        let find = |file: &str| {
            [golden(), shared_data().join("golden/metrics")]
                .map(|folder| folder.join(file))
                .into_iter()
                .find(|path| path.exists())
        };
        let text = |field: &str| json[field].as_str();
        Some(Self {
            name: text("name")?.to_owned(),
            files: find(text("dist")?).zip(find(text("ref")?)).map(Into::into),
            json: json.clone(),
            examined: OnceLock::new(),
        })
    }

    fn trial(self: &Arc<Self>, what: &str, check: Check) -> Trial {
        let this = self.clone();
        Trial::test(format!("{} {what}", self.name), move || check(&this))
            .with_ignored_flag(self.files.is_none())
    }

    /// PSNR and every SSIM.
    fn classical(self: &Arc<Self>) -> Vec<Trial> {
        let psnr: Check =
            Box::new(|pair| compare(pair.score("psnr")?, &pair.json["psnr"]["psnr_f64"], PSNR));
        let mut trials = vec![self.trial("psnr", psnr)];
        for [key, exact, rounded] in rows(SSIM) {
            let exact = exact.split_whitespace().map(|name| (name, 1e-9));
            let rounded = rounded.split_whitespace().map(|name| (name, 1e-5));
            for (reference, tolerance) in exact.chain(rounded) {
                let black = self.name == "black_black" && reference.starts_with("kornia");
                let tolerance = if black { KORNIA_BLACK } else { tolerance };
                let check: Check = Box::new(move |pair| {
                    compare(
                        pair.score(key)?,
                        &pair.json["ssim"][reference],
                        (tolerance, 0.0),
                    )
                });
                trials.push(self.trial(&format!("{key} = {reference}"), check));
            }
        }
        trials
    }

    /// LPIPS with one network: every variant, and the layers' terms.
    fn lpips(self: &Arc<Self>, net: &'static str) -> Vec<Trial> {
        let key = format!("lpips[{net},v0.1]");
        let f64_only = |suffix: &str, reference: &'static str| {
            let key = format!("lpips[{net},v0.1{suffix}]");
            let golden = &self.json["lpips"][net];
            let recorded = !golden[reference].is_null() || !golden["error"].is_null();
            self.trial(
                &format!("{key} = {reference}"),
                Box::new(move |pair| {
                    compare(
                        pair.score(&key)?,
                        &pair.json["lpips"][net][reference],
                        LPIPS,
                    )
                }),
            )
            .with_ignored_flag(self.files.is_none() || !recorded)
        };
        let mut trials = vec![f64_only(",eps=tm", "f64_torchmetrics_eps")];
        if net == "vgg" {
            trials.push(f64_only(",unscaled", "f64_unscaled01"));
        }
        let whole = key.clone();
        let value: Check = Box::new(move |pair| {
            let golden = &pair.json["lpips"][net];
            let (expected, tolerance) = match &golden["f64"] {
                Value::Null => (&golden["f32"], LPIPS_F32),
                expected => (expected, LPIPS),
            };
            compare(pair.score(&whole)?, expected, tolerance)
        });
        trials.push(self.trial(&key, value));
        let layered = key.clone();
        let layers: Check = Box::new(move |pair| {
            let golden = &pair.json["lpips"][net];
            let (expected, tolerance) = match &golden["layers_f64"] {
                Value::Null => (&golden["layers_f32"], LPIPS_F32),
                expected => (expected, LPIPS),
            };
            match pair.terms(&layered)? {
                Ok(Terms::Lpips { layers }) => compare_all(&layers, expected, tolerance),
                other => compare(other.map(|_| f64::NAN), expected, tolerance),
            }
        });
        trials.push(self.trial(&format!("{key} layers"), layers));
        trials
    }

    /// DISTS, its terms, and its form on reduced pictures.
    fn dists(self: &Arc<Self>) -> Vec<Trial> {
        let value: Check = Box::new(|pair| {
            let golden = &pair.json["dists"];
            let (expected, tolerance) = match &golden["f64"] {
                Value::Null => (&golden["f32"], DISTS_F32),
                expected => (expected, DISTS),
            };
            compare(pair.score("dists")?, expected, tolerance)
        });
        let terms: Check = Box::new(|pair| {
            let golden = &pair.json["dists"];
            let Ok(Terms::Dists { structure, texture }) = pair.terms("dists")? else {
                return Err("no terms".into());
            };
            for (terms, name) in [(structure, "structure"), (texture, "texture")] {
                match &golden[format!("{name}_f64")] {
                    Value::Null => {
                        compare_all(&terms, &golden[format!("{name}_f32")], DISTS_F32)?;
                    }
                    expected => compare_all(&terms, expected, DISTS)?,
                }
            }
            Ok(())
        });
        let resized: Check = Box::new(|pair| {
            let expected = match &pair.json["dists"]["resize256_f32"] {
                // The shorter side is not above 256, so nothing is reduced.
                Value::Null => &Value::from(pair.score("dists")??),
                expected => expected,
            };
            compare(pair.score("dists[resize256]")?, expected, DISTS_F32)
        });
        vec![
            self.trial("dists", value),
            self.trial("dists terms", terms),
            self.trial("dists[resize256]", resized),
        ]
    }

    /// LPIPS with the published weights of SqueezeNet, which may not be part of the repository.
    fn real_squeeze(self: &Arc<Self>) -> Trial {
        let check: Check = Box::new(|pair| {
            let [prediction, target] = pair.pictures()?;
            let scores = REAL.as_ref()?.score(&prediction, &target, None)?;
            let expected = &pair.json["lpips_squeeze_real_weights"]["f64"];
            compare(find(&scores, "lpips-squeeze")?, expected, LPIPS_REAL)
        });
        let absent = self.files.is_none() || !real_squeezenet().exists();
        self.trial("lpips[squeeze,v0.1] with published weights", check)
            .with_ignored_flag(absent)
    }

    fn pictures(&self) -> Result<[Picture; 2], Failed> {
        let files = self.files.as_ref().ok_or("the pictures are absent")?;
        let [a, b] = files.each_ref().map(image::open);
        Ok([a?.to_rgb8().into(), b?.to_rgb8().into()])
    }

    /// Scores and terms of all metrics.
    fn examined(&self) -> Result<&Examined, Failed> {
        let examined = self.examined.get_or_init(|| {
            let [prediction, target] = self.pictures().map_err(|e| format!("{e:?}"))?;
            let scorer = SCORER.as_ref().map_err(Clone::clone)?;
            let examined = scorer.examine(&prediction, &target, None, false);
            examined.map_err(|e| e.to_string())
        });
        Ok(examined.as_ref()?)
    }

    /// Our value, or the reason why there is none.
    fn score(&self, key: &str) -> Result<Result<f64, String>, Failed> {
        find(&self.examined()?.scores, key)
    }

    fn terms(&self, key: &str) -> Result<Result<Terms, String>, Failed> {
        find(&self.examined()?.terms, key)
    }
}

/// LPIPS and DISTS as users publish them, compared with the values of their authors' packages in
/// f64, with torchvision's weights.
fn published_weights() -> Result<Vec<Trial>, Box<dyn std::error::Error>> {
    let text = std::fs::read_to_string(golden().join("published_weights.json"))?;
    let json: serde_json::Map<String, Value> = serde_json::from_str(&text)?;
    let mut trials = Vec::new();
    for (name, expected) in json {
        let (prediction, target) = match &*name {
            "ex_p0" | "ex_p1" => (name.clone(), "ex_ref".to_owned()),
            "dists_r" => ("dists_r1".to_owned(), "dists_r0".to_owned()),
            _ => (format!("{name}_dist"), format!("{name}_ref")),
        };
        let [dist, reference] = [prediction, target].map(|stem| format!("images/{stem}.png"));
        let pair = serde_json::json!({"name": name, "dist": dist, "ref": reference});
        let pair = Arc::new(Pair::of(&pair).ok_or("a pair lacks its name or files")?);
        for (field, key) in [
            ("lpips_alex", "lpips-alex"),
            ("lpips_vgg", "lpips-vgg"),
            ("lpips_vgg_unscaled", "lpips-vgg-unscaled"),
            ("dists", "dists"),
        ] {
            let expected = expected[field].clone();
            let check: Check = Box::new(move |pair| {
                let [prediction, target] = pair.pictures()?;
                let scores = PUBLISHED.as_ref()?.score(&prediction, &target, None)?;
                compare(find(&scores, key)?, &expected, PUBLISHED_WEIGHTS)
            });
            trials.push(pair.trial(&format!("{key} with published weights"), check));
        }
    }
    Ok(trials)
}

/// The spatial maps of LPIPS, for pairs that have recorded maps.
fn spatial_maps(json: &Value) -> Result<Vec<Trial>, Box<dyn std::error::Error>> {
    let bytes = Arc::new(std::fs::read(golden().join("spatial_maps.safetensors"))?);
    let names = SafeTensors::deserialize(&bytes)?;
    let mut trials = Vec::new();
    for name in names.names() {
        let (net, pair) = name.split_once('.').ok_or("a map has no network")?;
        let pairs = json["pairs"].as_array().ok_or("no pairs")?;
        let pair = pairs
            .iter()
            .find(|p| p["name"].as_str().is_some_and(|n| n.contains(pair)))
            .and_then(Pair::of)
            .ok_or("a map belongs to no pair")?;
        let real = net == "squeeze_real";
        let alias = format!("lpips-{}", net.trim_end_matches("_real"));
        let absent = pair.files.is_none() || (real && !real_squeezenet().exists());
        let (name, bytes) = (name.to_owned(), bytes.clone());
        let trial = Trial::test(format!("spatial map {name}"), move || {
            let scorer = if real { &REAL } else { &MAPPED }.as_ref()?;
            let [prediction, target] = pair.pictures()?;
            let maps = scorer.examine(&prediction, &target, None, true)?.maps;
            let map = find(&maps, &alias)??;
            let tensors = SafeTensors::deserialize(&bytes)?;
            let (expected, _) = tensors.tensor(&name)?.data().as_chunks::<4>();
            let ours = map.values.as_raw();
            if ours.len() != expected.len() {
                return Err(format!("{} values, not {}", ours.len(), expected.len()).into());
            }
            for (i, (ours, expected)) in ours.iter().zip(expected).enumerate() {
                let expected = f32::from_le_bytes(*expected);
                if (ours - expected).abs() > 2e-6 {
                    return Err(format!("value {i} is {ours}, not {expected}").into());
                }
            }
            Ok(())
        });
        trials.push(trial.with_ignored_flag(absent));
    }
    Ok(trials)
}

/// The entry of a key.
fn find<T: Clone, E: ToString>(
    entries: &[(MetricKey, Result<T, E>)],
    key: &str,
) -> Result<Result<T, String>, Failed> {
    let key: MetricKey = key.parse()?;
    let entry = entries.iter().find(|(k, _)| *k == key);
    let (_, result) = entry.ok_or("the metric was not computed")?;
    Ok(result.as_ref().map_err(ToString::to_string).cloned())
}

fn compare_all(ours: &[f64], expected: &Value, tolerance: Tolerance) -> Result<(), Failed> {
    let expected = expected.as_array().ok_or("no list of terms")?;
    if ours.len() != expected.len() {
        return Err(format!("{} terms, not {}", ours.len(), expected.len()).into());
    }
    for (&ours, expected) in ours.iter().zip(expected) {
        compare(Ok(ours), expected, tolerance)?;
    }
    Ok(())
}

/// `expected` is a number, `"inf"`, or anything else for an unavailable value.
fn compare(
    score: Result<f64, String>,
    expected: &Value,
    (absolute, relative): Tolerance,
) -> Result<(), Failed> {
    match (score, expected) {
        (Ok(score), Value::Number(expected)) => {
            let expected = expected.as_f64().ok_or("not an f64")?;
            let error = (score - expected).abs();
            let tolerance = absolute.max(relative * expected.abs());
            if error <= tolerance {
                Ok(())
            } else {
                Err(
                    format!("{score} is {error:.2e} from {expected}, more than {tolerance:.1e}")
                        .into(),
                )
            }
        }
        (Ok(score), Value::String(text)) if text == "inf" && score == f64::INFINITY => Ok(()),
        (Err(_), Value::Null) => Ok(()),
        (Err(_), Value::String(text)) if text == "nan" => Ok(()),
        (score, expected) => Err(format!("{score:?}, but expected {expected}").into()),
    }
}
