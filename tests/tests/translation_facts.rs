//! Statements of the paper's table of small translations, checked on photographs: a shift by 1 %
//! costs PSNR nearly as much as replacing the picture by its mean colour, and SSIM cannot
//! distinguish even 5 % from that, while DISTS and LPIPS can.
//!
//! The statement about PSNR is true if the texture is finer than the shift, as in the garage behind
//! the motorcycle. It is false, and not required, for a smooth picture of the retina, or a portrait
//! so small that 1 % is one and a half pixels.
//!
//! Statements about DISTS and LPIPS are checked with the published weights. Those of SqueezeNet may not be
//! redistributed; without them, its tests are reported as ignored.

use std::path::Path;

use libtest_mimic::{Arguments, Failed, Trial};
use sharp_bench::analyze::translation::Experiment;
use sharp_metrics::{Backbone, MetricKey, Scorer, Selection, Weights};

const PHOTOGRAPHS: [(&str, &str); 3] = [
    (
        "motorcycle",
        "../datasets/bundled/middlebury/Motorcycle-quarter/im0.png",
    ),
    ("retina", "golden/metrics/images/large1024x768_ref.png"),
    ("astronaut", "golden/metrics/images/astro_identical_ref.png"),
];

/// A metric's values in the order of the shifts, and its value for the mean image.
struct Values {
    moved: Vec<f64>,
    mean: f64,
}

type Fact = fn(&Values) -> bool;

fn main() {
    let weightless = Some(Weights::none());
    let published = Weights::at_hand();
    let facts: [(&str, &str, Option<Weights>, Fact); 5] = [
        (
            "one_per_cent_costs_psnr_what_the_mean_does",
            "psnr",
            weightless.clone(),
            |v| (v.moved[1] - v.mean).abs() <= 3.0,
        ),
        (
            "ssim_does_not_tell_five_per_cent_from_the_mean",
            "ssim-gauss11-valid",
            weightless,
            |v| v.moved[2] <= v.mean + 0.1,
        ),
        (
            "dists_grows_and_stays_far_below_the_mean_with_published_weights",
            "dists",
            Some(published.clone()),
            grows_far_below,
        ),
        (
            "lpips_grows_below_the_mean_with_published_weights",
            "lpips-squeeze",
            squeezenet(),
            grows_below,
        ),
        (
            "lpips_alex_grows_below_the_mean_with_published_weights",
            "lpips-alex",
            Some(published),
            grows_below,
        ),
    ];
    let mut trials = Vec::new();
    for (name, file) in PHOTOGRAPHS {
        for (fact, metric, weights, holds) in facts.clone() {
            if metric == "psnr" && name != "motorcycle" {
                continue;
            }
            let absent = weights.is_none();
            let check = move || check(file, metric, weights.unwrap_or_default(), holds);
            trials.push(Trial::test(format!("{fact}::{name}"), check).with_ignored_flag(absent));
        }
    }
    libtest_mimic::run(&Arguments::from_args(), trials).exit();
}

fn grows_below(values: &Values) -> bool {
    let all: Vec<f64> = values.moved.iter().copied().chain([values.mean]).collect();
    all.is_sorted_by(|a, b| a < b)
}

/// Requires the value for the largest shift to be below a third of that for the mean image (in the
/// paper, 0.121 and 0.859).
fn grows_far_below(values: &Values) -> bool {
    grows_below(values) && values.moved[2] < values.mean / 3.0
}

/// The published weights of SqueezeNet 1.1, in the folder given by `SHARP_BENCH_SHARED`.
fn squeezenet() -> Option<Weights> {
    let shared = sharp_tests::shared_data();
    let file = shared.join("golden/metrics/weights/squeezenet1_1_features_real.safetensors");
    let found = file.is_file();
    found.then(|| Weights::none().with_file(Backbone::SqueezeNet1_1, file))
}

fn check(file: &str, metric: &str, weights: Weights, holds: Fact) -> Result<(), Failed> {
    let picture = image::open(Path::new(env!("CARGO_MANIFEST_DIR")).join(file))?.to_rgb8();
    let scorer = Scorer::new(&Selection::parse(metric)?, &weights)?;
    let shifts = "0.1,1,5".parse()?;
    let experiment = Experiment::run(&picture, &shifts, &scorer, || ())?;
    let key: MetricKey = metric.parse()?;
    let score = |c: &sharp_bench::analyze::translation::Comparison| {
        c.score(key).ok_or_else(|| format!("{metric} has no value"))
    };
    let mut all: Vec<f64> = experiment
        .comparisons
        .iter()
        .map(score)
        .collect::<Result<_, _>>()?;
    let mean = all.pop().ok_or("no comparison")?;
    let values = Values { moved: all, mean };
    if holds(&values) {
        return Ok(());
    }
    Err(format!("shifts {:?}, mean image {}", values.moved, values.mean).into())
}
