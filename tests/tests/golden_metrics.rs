//! Every metric against the values of the reference implementations, one named test per picture
//! pair and key.
//!
//! Expectations are those of `golden/metrics/golden.json`; `null`, an error or a value that is not
//! a number there means that the metric must be unavailable here. Pairs whose pictures may not be
//! redistributed are read from the folder named by `SHARP_BENCH_SHARED` (default `../shared`
//! beside the checkout) and reported as ignored where it is absent.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use libtest_mimic::{Arguments, Failed, Trial};
use serde_json::Value;
use sharp_metrics::{MetricKey, Picture, Scorer, Selection, Weights};

/// Keys, the entries of `golden.json` that they must equal, and how closely. Entries computed by
/// their authors in f64 hold to 1e-9, OpenCV's, which are f32, to 1e-5.
///
/// kornia adds 1e-12 to a denominator that can be as small as 9e-8 (both windows black), so its
/// values lie up to 1.112e-5 lower.
const KORNIA: f64 = 1.2e-5;
const SSIM: [(&str, &[(&str, f64)]); 8] = [
    (
        "ssim[gauss11,valid]",
        &[
            ("gauss11_valid", 1e-9),
            ("skimage_gauss_popcov", 1e-9),
            ("kornia_valid", KORNIA),
        ],
    ),
    ("ssim[gauss11,zero]", &[("gauss11_zeropad_3dgs", 1e-9)]),
    (
        "ssim[gauss11,reflect]",
        &[
            ("gauss11_reflect101", 1e-9),
            ("torchmetrics_1_9_data_range1", 1e-9),
            ("kornia_same", KORNIA),
            ("cv2_quality_ssim_uint8", 1e-5),
        ],
    ),
    (
        "ssim[uniform7,sample]",
        &[
            ("skimage_uniform7_samplecov", 1e-9),
            ("skimage_uniform7_uint8", 1e-9),
        ],
    ),
    (
        "ssim[uniform7,population]",
        &[("skimage_uniform7_popcov", 1e-9)],
    ),
    (
        "ssim[gauss11,valid,sample]",
        &[("skimage_gauss_samplecov", 1e-9)],
    ),
    (
        "ssim[gauss11,valid,gray]",
        &[("skimage_gauss_popcov_gray", 1e-9)],
    ),
    (
        "ssim[gauss11,reflect,range=data]",
        &[("torchmetrics_1_9_data_range_none", 1e-9)],
    ),
];

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let arguments = Arguments::from_args();
    let text = std::fs::read_to_string(golden().join("golden.json"))?;
    let json: Value = serde_json::from_str(&text)?;
    let mut trials = Vec::new();
    for pair in json["pairs"].as_array().ok_or("golden.json has no pairs")? {
        let pair = Arc::new(Pair::of(pair).ok_or("a pair lacks its name or files")?);
        let psnr = pair.clone();
        trials.push(pair.trial("psnr", move || {
            psnr.check("psnr", &psnr.json["psnr"]["psnr_f64"], 1e-4)
        }));
        for (key, references) in SSIM {
            for &(reference, tolerance) in references {
                let this = pair.clone();
                trials.push(pair.trial(&format!("{key} = {reference}"), move || {
                    this.check(key, &this.json["ssim"][reference], tolerance)
                }));
            }
        }
    }
    libtest_mimic::run(&arguments, trials).exit();
}

fn golden() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("golden/metrics")
}

/// The folder of data that the repository may not hold.
fn shared() -> PathBuf {
    std::env::var_os("SHARP_BENCH_SHARED").map_or_else(
        || Path::new(env!("CARGO_MANIFEST_DIR")).join("../../shared"),
        PathBuf::from,
    )
}

struct Pair {
    name: String,
    /// Prediction and target; `None` where a picture is neither here nor in the shared folder.
    files: Option<[PathBuf; 2]>,
    json: Value,
}

impl Pair {
    fn of(json: &Value) -> Option<Self> {
        let find = |file: &str| {
            [golden(), shared().join("golden/metrics")]
                .map(|folder| folder.join(file))
                .into_iter()
                .find(|path| path.exists())
        };
        let text = |field: &str| json[field].as_str();
        Some(Self {
            name: text("name")?.to_owned(),
            files: find(text("dist")?).zip(find(text("ref")?)).map(Into::into),
            json: json.clone(),
        })
    }

    fn trial(
        &self,
        what: &str,
        run: impl FnOnce() -> Result<(), Failed> + Send + 'static,
    ) -> Trial {
        Trial::test(format!("{} {what}", self.name), run).with_ignored_flag(self.files.is_none())
    }

    fn pictures(&self) -> Result<[Picture; 2], Failed> {
        let files = self.files.as_ref().ok_or("the pictures are absent")?;
        let [a, b] = files.each_ref().map(image::open);
        Ok([a?.to_rgb8().into(), b?.to_rgb8().into()])
    }

    fn check(&self, key: &str, expected: &Value, tolerance: f64) -> Result<(), Failed> {
        let key: MetricKey = key.parse()?;
        let scorer = Scorer::new(&Selection::of(&[key]), &Weights::none())?;
        let [prediction, target] = self.pictures()?;
        let (_, score) = scorer.score(&prediction, &target, None)?.swap_remove(0);
        compare(
            score.map_err(|reason| reason.to_string()),
            expected,
            tolerance,
        )
    }
}

/// `expected` is a number, `"inf"`, or something that stands for no value.
fn compare(score: Result<f64, String>, expected: &Value, tolerance: f64) -> Result<(), Failed> {
    match (score, expected) {
        (Ok(score), Value::Number(expected)) => {
            let expected = expected.as_f64().ok_or("not an f64")?;
            let error = (score - expected).abs();
            if error <= tolerance {
                Ok(())
            } else {
                Err(format!("{score} is {error:.2e} from {expected}, more than {tolerance}").into())
            }
        }
        (Ok(score), Value::String(text)) if text == "inf" && score == f64::INFINITY => Ok(()),
        (Err(_), Value::Null) => Ok(()),
        (Err(_), Value::String(text)) if text == "nan" => Ok(()),
        (score, expected) => Err(format!("{score:?}, but expected {expected}").into()),
    }
}
