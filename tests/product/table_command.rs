//! The paper's tables with a user's own rows, and explanations of differences.

use std::path::Path;

use crate::support::{holds, sharp_bench, words};
use crate::tiny::golden;

/// Middlebury's Motorcycle at quarter size.
fn middlebury() -> String {
    let data = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/fixtures/middeval3");
    format!("M:middlebury={}", data.display())
}

fn run(dir: &Path, out: &str, args: &[&str]) {
    let dataset = middlebury();
    let always = ["run", "--dataset", &dataset, "--out", out];
    sharp_bench(dir, &[&always[..], args].concat()).ends_with(0);
}

/// A label with special characters of every output format.
const ODD: &str = "<b>a_1 & 5 %</b>";

#[test]
fn rows_of_ones_own_stand_below_the_published_ones() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let methods = words("--method copy --method mean --metrics psnr,ssim");
    run(dir, "run", &methods);
    let rows = [
        format!("{ODD}=run:copy"),
        "=run:mean".replacen('=', "mean=", 1),
    ];
    let table = |extra: &[&str]| {
        let args = ["table", "psnr-ssim", "--row", &rows[0], "--row", &rows[1]];
        sharp_bench(dir, &[&args[..], extra].concat())
    };
    let json = table(&["--json", "--out", "out"]).ends_with(0).json();
    let cells = json["cells"].as_array().unwrap();
    // Seven published rows and two own rows, six datasets, two metrics.
    assert_eq!(cells.len(), 9 * 12);
    let cell = |row: &str, dataset: &str, metric: &str| {
        let found = cells.iter().find(|cell| {
            cell["row"] == row && cell["dataset"] == dataset && cell["metric"] == metric
        });
        found.unwrap_or_else(|| panic!("{row} {dataset} {metric}"))
    };
    let published = cell("SHARP (published)", "Middlebury", "psnr[unstated]");
    assert_eq!(
        (&published["value"], &published["rank"]),
        (&17.12.into(), &1.into())
    );
    let own = cell(ODD, "Middlebury", "psnr");
    assert_eq!((&own["origin"], &own["n"]), (&"measured".into(), &1.into()));
    // One of the two own rows is the best, whatever the published ones are.
    let ranks = [own, cell("mean", "Middlebury", "psnr")].map(|cell| cell["rank"].as_u64());
    assert!(
        ranks.contains(&Some(1)) && ranks.contains(&Some(2)),
        "{ranks:?}"
    );
    assert!(cell(ODD, "ETH3D", "psnr")["value"].is_null());
    let checks = json["checklist"].as_array().unwrap();
    let unmet = |text: &str| {
        checks
            .iter()
            .any(|c| c["met"] == false && c["text"].as_str().unwrap().contains(text))
    };
    assert!(
        unmet("ssim[gauss11,valid]") && unmet("Middlebury: 1 pair here"),
        "{checks:?}"
    );

    let read = |name: &str| std::fs::read_to_string(dir.join("out").join(name)).unwrap();
    let html = read("psnr-ssim.html");
    assert!(
        !html.contains("<b>a") && html.contains("&#60;b&#62;a_1 &#38; 5 %"),
        "{html}"
    );
    let tex = read("psnr-ssim.tex");
    holds(&tex, &[r"\textless{}b\textgreater{}a\_1 \& 5 \%"]);
    assert!(tex.matches("\\midrule").count() == 2, "{tex}");
    let csv = read("psnr-ssim.csv");
    assert!(
        csv.starts_with("row,origin,dataset,metric,value,n,total,rank\n"),
        "{csv}"
    );
    assert!(
        csv.contains("SHARP (published),published,Middlebury,psnr[unstated],17.12,,,1\n"),
        "{csv}"
    );
    let md = read("psnr-ssim.md");
    assert!(
        md.contains("| SHARP (published)† |") && md.contains("| *measured:* |"),
        "{md}"
    );
    assert!(md.contains("- [ ] Middlebury: 1 pair here"), "{md}");

    // `--only-measured` leaves out other datasets, and the earlier files are overwritten.
    let narrow = table(&["--only-measured", "--json", "--out", "out"])
        .ends_with(0)
        .json();
    assert_eq!(narrow["cells"].as_array().unwrap().len(), 9 * 2);
    std::fs::write(dir.join("out/psnr-ssim.md"), "mine").unwrap();
    table(&["--out", "out"]).is_error_with(&["psnr-ssim.md", "not overwritten"]);

    for (args, said) in [
        (["nope", "--row", "a=run:copy"], "no table 'nope'"),
        (["psnr-ssim", "--row", "run"], "LABEL=RUN"),
        (
            ["psnr-ssim", "--row", "a\nb=run:copy"],
            "'a\\nb' contains a control character",
        ),
    ] {
        sharp_bench(dir, &[&["table"], &args[..]].concat()).is_usage_error_with(&[said]);
    }
    for (args, said) in [
        (["psnr-ssim", "--row", "a=run"], "the methods copy, mean"),
        (["psnr-ssim", "--row", "a=nowhere"], "nowhere"),
        (["timing-comparison", "--row", "a=run"], "speed.csv"),
        (["metrics_comparison", "--row", "a=run"], "translation.csv"),
        (["param-count", "--row", "a=run/scores.csv"], "scores.csv"),
    ] {
        sharp_bench(dir, &[&["table"], &args[..]].concat()).is_error_with(&[said]);
    }
}

#[test]
fn tables_that_are_no_scores_take_rows_too() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let list = sharp_bench(dir, &["table", "list", "--json"])
        .ends_with(0)
        .json();
    assert_eq!(list.as_array().unwrap().len(), 15);

    let picture = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("../tests/fixtures/middeval3/trainingQ/Motorcycle/im0.png");
    let picture = picture.display().to_string();
    let args = words("analyze translation --metrics paper --out moved");
    sharp_bench(dir, &[&args[..], &[&*picture]].concat()).ends_with(0);
    let args = words("table metrics_comparison --row here=moved --json");
    let json = sharp_bench(dir, &args).ends_with(0).json();
    let cells = json["cells"].as_array().unwrap();
    assert_eq!(cells.len(), 8 * 4);
    let moved = cells
        .iter()
        .find(|c| c["row"] == "here: Mean image" && c["metric"] == "psnr")
        .unwrap();
    assert!(moved["value"].as_f64().unwrap() > 5.0, "{moved}");

    let head = "method,dataset,format,quantity,n,median,first_quartile,third_quartile,least,most\n";
    let lines = "m,M,middlebury,inference_secs,15,0.5,0.4,0.6,0.3,0.9\nm,M,middlebury,render_secs,15,0.02,0.01,0.03,0.01,0.04\n";
    std::fs::create_dir(dir.join("speed")).unwrap();
    std::fs::write(dir.join("speed/speed.csv"), format!("{head}{lines}")).unwrap();
    let args = words("table timing-comparison --row mine=speed --json");
    let json = sharp_bench(dir, &args).ends_with(0).json();
    let mine = json["cells"]
        .as_array()
        .unwrap()
        .iter()
        .filter(|c| c["row"] == "mine" && !c["value"].is_null());
    let mine: Vec<f64> = mine.map(|c| c["value"].as_f64().unwrap()).collect();
    assert_eq!(mine, [0.5, 0.02]);
    let narrow = sharp_bench(dir, &[&args[..], &["--only-measured"]].concat());
    let narrow = narrow.ends_with(0).json();
    let datasets = narrow["cells"].as_array().unwrap().iter();
    assert!(datasets.clone().count() > 0);
    for cell in datasets {
        assert_eq!(cell["dataset"], "Middlebury");
    }

    // Datasets that the paper does not have follow its own.
    let own = "m,mine,colmap,inference_secs,15,0.7,0.6,0.8,0.5,0.9\n";
    std::fs::create_dir(dir.join("more")).unwrap();
    std::fs::write(dir.join("more/speed.csv"), format!("{head}{lines}{own}")).unwrap();
    let table = |more: &[&str]| {
        let args = ["timing-comparison", "--row", "a=speed", "--row", "b=more"];
        sharp_bench(dir, &[&["table"], &args[..], more].concat()).ends_with(0)
    };
    let json = table(&["--json"]).json();
    let cells = json["cells"].as_array().unwrap().iter();
    let of_own: Vec<_> = cells.filter(|c| c["dataset"] == "mine").collect();
    assert!(of_own.iter().all(|c| c["origin"] == "measured"));
    let values: Vec<_> = of_own.iter().map(|c| c["value"].as_f64()).collect();
    assert_eq!(values, [None, None, Some(0.7), None]);
    let text = table(&["--datasets", "mine", "--out", "speeds"]).out;
    assert!(
        text.contains("mine") && !text.contains("Middlebury"),
        "{text}"
    );
    assert!(
        std::fs::read_to_string(dir.join("speeds/timing-comparison.tex"))
            .unwrap()
            .contains("mine")
    );

    let tiny = golden("tiny_model.pt");
    let row = format!("tiny={tiny}");
    let args = ["table", "param-count", "--row", &row];
    let text = sharp_bench(dir, &args).ends_with(0).out;
    let line = text.lines().find(|line| line.starts_with("tiny ")).unwrap();
    assert!(line.contains("M "), "{text}");
    sharp_bench(dir, &[&args[..], &["--only-measured"]].concat())
        .is_usage_error_with(&["param-count has no datasets"]);
}

#[test]
fn a_number_is_explained_by_the_readings_of_its_pictures() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    run(
        dir,
        "run",
        &words("--method depth-splat:resolution=256 --metrics psnr --keep float"),
    );
    let explain = |args: &[&str]| {
        sharp_bench(
            dir,
            &[
                &["explain", "psnr-ssim", "run", "--metrics", "psnr,ssim-all"],
                args,
            ]
            .concat(),
        )
    };
    let json = explain(&["--json", "--out", "why"]).ends_with(0).json();
    let run = &json["runs"][0];
    let readings = run["readings"].as_array().unwrap();
    let of = |key: &str, picture: &str, averaging: &str| {
        let found = readings
            .iter()
            .find(|r| r["key"] == key && r["picture"] == picture && r["averaging"] == averaging);
        found.unwrap_or_else(|| panic!("{key} {picture} {averaging}"))["value"]
            .as_f64()
            .unwrap()
    };
    let pairs = "mean over pairs";
    // The scores of the run.
    let scores = std::fs::read_to_string(dir.join("run/scores.csv")).unwrap();
    let at = scores
        .lines()
        .next()
        .unwrap()
        .split(',')
        .position(|head| head == "psnr")
        .unwrap();
    let scored: f64 = scores
        .lines()
        .nth(1)
        .unwrap()
        .split(',')
        .nth(at)
        .unwrap()
        .parse()
        .unwrap();
    assert_eq!(of("psnr", "as scored", pairs), scored);
    assert_eq!(run["cells"][0]["here"].as_f64(), Some(scored));
    // For a single pair, every mean equals the number itself.
    assert!((of("psnr", "as scored", "PSNR of the mean squared error") - scored).abs() < 1e-9);
    // Rounding changes it less than truncation; holes that are given a colour are no longer black.
    let moved = |picture: &str| (of("psnr", picture, pairs) - scored).abs();
    assert!(
        moved("not rounded") < moved("truncated"),
        "{} {}",
        moved("not rounded"),
        moved("truncated")
    );
    assert!(of("psnr", "divided by alpha", pairs) > scored);
    assert_ne!(of("psnr", "border cropped", pairs), scored);
    assert_eq!(run["cells"].as_array().unwrap().len(), 2);
    let text = explain(&[]).ends_with(0).out;
    holds(&text, &["right=im1E", "verdict"]);
    let title = "depth-splat of run, compared with SHARP (ours) in psnr-ssim";
    assert!(text.starts_with(title), "{text}");
    // The run folder is unchanged, and a repetition writes the same files.
    let before = std::fs::read(dir.join("why/readings.csv")).unwrap();
    explain(&["--out", "why"]).ends_with(0);
    assert_eq!(std::fs::read(dir.join("why/readings.csv")).unwrap(), before);
    assert_eq!(
        std::fs::read_to_string(dir.join("run/scores.csv")).unwrap(),
        scores
    );

    // Identical pictures.
    let dataset = middlebury();
    let (_, data) = dataset.split_once('=').unwrap();
    std::os::unix::fs::symlink(data, dir.join("data")).unwrap();
    let args = ["run", "--dataset", "middlebury=data", "--method", "target"];
    let args = [&args[..], &["--metrics", "psnr", "--out", "itself"]].concat();
    sharp_bench(dir, &args).ends_with(0);
    let itself = dir.join("itself").display().to_string();
    let args = [
        "explain",
        "psnr-ssim",
        &itself,
        "--metrics",
        "psnr",
        "--json",
    ];
    let json = sharp_bench(dir, &args).ends_with(0).json();
    let cell = &json["runs"][0]["cells"][0];
    assert_eq!(
        (&cell["here"], &cell["spread"][1]),
        (&"inf".into(), &"inf".into())
    );
    // The dataset's path is relative, so it does not exist when seen from another folder.
    sharp_bench(&dir.join("why"), &args).is_error_with(&[
        "cannot read the run's pictures from middlebury=data",
        "relative to the folder where `run` was started",
        "why",
    ]);
    // A prediction that is no longer kept is excluded from all numbers, in both forms.
    std::fs::remove_dir_all(dir.join("itself/predictions")).unwrap();
    for args in [&args[..], &args[..5]] {
        sharp_bench(dir, args).ends_with(4);
    }

    explain(&["--row", "Nobody"]).is_usage_error_with(&["--row Nobody", "Flash3D"]);
    sharp_bench(dir, &["explain", "param-count", "run"])
        .is_usage_error_with(&["no table of scores"]);
    sharp_bench(dir, &["bundle", "run", "--out", "run.zip"]).ends_with(0);
    sharp_bench(dir, &["explain", "psnr-ssim", "run.zip"])
        .is_error_with(&["run.zip", "no pictures"]);
}
