//! Regressions planted in a model's pictures, and how `gate` and `compare` report them.

use std::path::Path;

use image::{ImageBuffer, Rgb, RgbImage};
use sharp::color::linear_from_srgb;
use sharp::gaussians::Gaussians;
use sharp::ply::{GaussianScene, PlyForm};
use sharp_bench::evaluate::record::Score;
use sharp_bench::evaluate::{Results, RunFolder};
use sharp_datasets::synthetic::{SyntheticOptions, SyntheticScene};

use crate::support::{Said, read, sharp_bench, words};

const SCENES: u64 = 8;
const VIEWS: usize = 6;
const LIMITS: [&str; 6] = [
    "--fail-if",
    "psnr < -0.05",
    "--fail-if",
    "lpips > +0.002",
    "--fail-if",
    "psnr < -1 per scene",
];

/// Runs two pairs of each scene, with pictures 96 pixels wide, or wider for a smaller regression.
fn run_at(width: u32, dir: &Path, out: &str, metrics: &str, more: &[&str]) -> Said {
    let height = width * 3 / 4;
    let dataset = format!("S:synthetic=size={width}x{height},views={VIEWS},scenes={SCENES}");
    let args = ["run", "--dataset", &dataset, "--limit", "16", "--metrics"];
    sharp_bench(dir, &[&args[..], &[metrics, "--out", out], more].concat())
}

fn run(dir: &Path, out: &str, metrics: &str, more: &[&str]) -> Said {
    run_at(96, dir, out, metrics, more)
}

fn gate(dir: &Path, baseline: &str, candidate: &str, more: &[&str]) -> Said {
    let args = ["gate", "--baseline", baseline, "--candidate", candidate];
    sharp_bench(dir, &[&args[..], more].concat())
}

/// A model: one Gaussian per pixel of a source, at its true distance times `scale`. Writes
/// `DIR/S/<scene>/<source>.ply` for the sources in a run.
fn model(dir: &Path, run: &Path, width: u32, scale: f64) {
    for record in Results::read(run).unwrap().records {
        let options = SyntheticOptions {
            seed: record.scene["seed".len()..].parse().unwrap(),
            width,
            height: width * 3 / 4,
            views: VIEWS,
            ..SyntheticOptions::default()
        };
        let scene = SyntheticScene::new(options).unwrap();
        let view = scene.views().iter().find(|view| view.id == record.source);
        let view = view.unwrap();
        let picture = view.content.image().unwrap();
        let mut gaussians = Gaussians::default();
        for (x, y, depth) in view.content.depth().unwrap().unwrap().enumerate_pixels() {
            // The sky is far.
            let depth = if depth.0[0] > 0.0 { depth.0[0] } else { 40.0 };
            let depth = f64::from(depth) * scale;
            let center = glam::DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
            let mean = view.intrinsics.unproject(center, depth);
            let sigma = (0.6 * depth / view.intrinsics.fx) as f32;
            let levels = picture.get_pixel(x, y).0;
            gaussians.means.push(mean.as_vec3().to_array());
            gaussians.quaternions.push([1.0, 0.0, 0.0, 0.0]);
            gaussians.scales.push([sigma; 3]);
            gaussians.opacities.push(0.95);
            gaussians
                .colors
                .push(levels.map(|level| linear_from_srgb(f32::from(level) / 255.0)));
        }
        let folder = dir.join(format!("S/{}", record.scene));
        std::fs::create_dir_all(&folder).unwrap();
        let file = folder.join(format!("{}.ply", record.source));
        let scene = GaussianScene::new(gaussians, view.intrinsics);
        scene.save(&file, PlyForm::Release).unwrap();
    }
}

/// The model's pictures, from a run that renders it: `OUT/predictions/model`.
fn rendered(dir: &Path, width: u32, out: &str, gaussians: &str, more: &[&str]) {
    let method = format!("gaussians:label=model,dir={gaussians}");
    let method = ["--method", &method, "--background", "0.3,0.3,0.3"];
    run_at(width, dir, out, "psnr", &[&method[..], more].concat()).ends_with(0);
}

/// A run with external pictures.
fn imported(dir: &Path, width: u32, out: &str, pictures: &str) {
    let method = format!("imported:label=model,dir={pictures}");
    let metrics = "psnr,psnr@frustum,ssim@frustum,lpips";
    run_at(width, dir, out, metrics, &["--method", &method]).ends_with(0);
}

/// Modified copies of the model's pictures, in another folder.
fn spoiled(dir: &Path, to: &str, spoil: impl Fn(&str, RgbImage) -> RgbImage) {
    let results = Results::read(&dir.join("good")).unwrap();
    for record in &results.records {
        let from = dir.join(format!("raw/predictions/model/{}.png", record.pair_id));
        let to = dir.join(to).join(format!("{}.png", record.pair_id));
        std::fs::create_dir_all(to.parent().unwrap()).unwrap();
        let picture = image::open(from).unwrap().to_rgb8();
        spoil(&record.scene, picture).save(to).unwrap();
    }
}

/// The picture, moved to the right by half a pixel with bilinear interpolation.
fn shifted(picture: &RgbImage) -> RgbImage {
    ImageBuffer::from_fn(picture.width(), picture.height(), |x, y| {
        let (a, b) = (
            picture.get_pixel(x.saturating_sub(1), y),
            picture.get_pixel(x, y),
        );
        Rgb(std::array::from_fn(|c| {
            (u16::from(a.0[c]) + u16::from(b.0[c])).div_ceil(2) as u8
        }))
    })
}

fn with_good_model(dir: &Path, width: u32) {
    run_at(width, dir, "pairs", "psnr", &["--method", "copy"]).ends_with(0);
    model(&dir.join("gaussians"), &dir.join("pairs"), width, 1.0);
    rendered(dir, width, "raw", "gaussians", &[]);
    imported(dir, width, "good", "raw/predictions/model");
}

/// Checks whose state is not `passed`, as `limit` or `limit scene`, in order.
fn told(said: &Said) -> Vec<String> {
    let json = said.json();
    let checks = json["gate"]["checks"].as_array().unwrap();
    let notable = checks.iter().filter(|check| check["state"] != "passed");
    let text = |check: &serde_json::Value| {
        let scene = check["scene"].as_str().unwrap_or("");
        let (state, limit) = (
            check["state"].as_str().unwrap(),
            check["limit"].as_str().unwrap(),
        );
        format!("{state}: {limit} {scene}").trim().to_owned()
    };
    notable.map(text).collect()
}

#[test]
fn planted_regressions_are_caught() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    // At 96 pixels, a 2 % error of the depth moves only few pixels by more than a quarter of a
    // pixel.
    let width = 192;
    with_good_model(dir, width);
    rendered(dir, width, "blurred-raw", "gaussians", &["--eps2d", "0.3"]);
    model(&dir.join("scaled"), &dir.join("pairs"), width, 1.02);
    rendered(dir, width, "scaled-raw", "scaled", &[]);
    spoiled(dir, "shift", |_, picture| shifted(&picture));
    let limits = [
        "psnr@frustum < -0.02",
        "ssim@frustum < -0.002",
        "lpips > +0.005",
    ];
    let args = limits.map(|limit| ["--fail-if", limit]).concat();
    let args = [&args[..], &["--json"]].concat();
    let found = [
        ("eps2d", "blurred-raw/predictions/model"),
        ("scale", "scaled-raw/predictions/model"),
        ("half a pixel", "shift"),
    ]
    .map(|(name, pictures)| {
        imported(dir, width, name, pictures);
        let said = gate(dir, "good", name, &args);
        (name, said.code, told(&said))
    });
    let all = limits.map(|limit| format!("fired: {limit}")).to_vec();
    assert_eq!(found[0], ("eps2d", 3, all.clone()));
    assert_eq!(found[2], ("half a pixel", 3, all.clone()));
    assert_eq!(found[1], ("scale", 3, all[..2].to_vec()));
    // A run with another low-pass is refused, because that is another convention, not a regression.
    gate(dir, "raw", "blurred-raw", &LIMITS[..2]).is_error_with(&["eps2d is"]);
}

#[test]
fn one_scene_that_broke_is_found_where_its_dataset_says_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    with_good_model(dir, 96);
    spoiled(dir, "one", |scene, picture| match scene {
        "seed5" => RgbImage::from_pixel(96, 72, Rgb([90, 90, 90])),
        _ => picture,
    });
    imported(dir, 96, "broken", "one");
    let said = gate(dir, "good", "broken", &[&LIMITS[..], &["--json"]].concat()).ends_with(3);
    assert_eq!(
        told(&said),
        [
            "not_significant: psnr < -0.05",
            "not_significant: lpips > +0.002",
            "fired: psnr < -1 per scene seed5"
        ]
    );
    let worst = &said.json()["gate"]["worst"][0]["pair_id"];
    assert!(worst.as_str().unwrap().starts_with("S/seed5/"), "{worst}");
    gate(dir, "good", "broken", &LIMITS[..4]).ends_with(0);

    // The scenes of the comparison show where it is.
    let json = sharp_bench(dir, &["compare", "good", "broken", "--json"])
        .ends_with(0)
        .json();
    let strata = json["breakdown"].as_array().unwrap().iter();
    let moved = strata.filter(|part| {
        (&part["by"], &part["metric"], &part["region"])
            == (&"scene".into(), &"psnr".into(), &"whole".into())
            && part["difference"] != 0.0
    });
    let moved: Vec<&str> = moved
        .map(|part| part["stratum"].as_str().unwrap())
        .collect();
    assert_eq!(moved, ["seed5"]);

    // A missing picture is reported even if no score got worse.
    let lost = format!("one/{}.png", worst.as_str().unwrap());
    std::fs::remove_file(dir.join(lost)).unwrap();
    run(
        dir,
        "lost",
        "psnr,lpips",
        &["--method", "imported:label=model,dir=one"],
    )
    .ends_with(4);
    let limits = ["--fail-if", "psnr < -90"];
    let said = gate(dir, "good", "lost", &limits).ends_with(3);
    assert!(
        said.out
            .contains("1 pair with a score in A but not in B; the first is S/seed5/"),
        "{}",
        said.out
    );
    std::fs::write(dir.join("one.toml"), "missing_pairs = 1").unwrap();
    gate(
        dir,
        "good",
        "lost",
        &[&limits[..], &["--config", "one.toml"]].concat(),
    )
    .ends_with(0);
}

/// LPIPS expects pictures in −1..1. A build that passes 0..1 instead stores the value of the
/// metric's own variant for that mistake.
#[test]
fn a_wrong_range_of_lpips_is_caught() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let (right, wrong) = ("lpips[vgg,v0.1]", "lpips[vgg,v0.1,unscaled]");
    for out in ["before", "after"] {
        run(
            dir,
            out,
            "lpips-vgg,lpips-vgg-unscaled",
            &["--method", "copy"],
        )
        .ends_with(0);
    }
    let folder = RunFolder::open(&dir.join("after")).unwrap();
    for mut unit in folder.units().unwrap().0 {
        let Score::Value(value) = unit.scores[wrong].score else {
            panic!("no score");
        };
        unit.scores.get_mut(right).unwrap().score = Score::Value(value);
        folder.save(unit).unwrap();
    }
    // The mistake makes distances smaller, so only a limit in both directions detects it.
    let limits = [
        "--fail-if",
        "lpips-vgg > +0.005",
        "--fail-if",
        "|lpips-vgg| > 0.005",
    ];
    let said = gate(dir, "before", "after", &[&limits[..], &["--json"]].concat()).ends_with(3);
    assert_eq!(told(&said), ["fired: |lpips-vgg| > 0.005"]);
    assert_eq!(said.json()["gate"]["worst"].as_array().unwrap().len(), 3);
}

#[test]
fn the_same_code_twice_is_the_same_to_the_byte() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    for (out, threads) in [("one", "1"), ("two", "2")] {
        let line = format!("--method copy --method depth-splat:resolution=64 --threads {threads}");
        run(dir, out, "psnr,lpips", &words(&line)).ends_with(0);
        sharp_bench(dir, &["bundle", out, "--out", &format!("{out}.zip")]).ends_with(0);
    }
    let bytes = |name: &str| std::fs::read(dir.join(name)).unwrap();
    assert_eq!(bytes("one/scores.csv"), bytes("two/scores.csv"));
    assert_eq!(bytes("one.zip"), bytes("two.zip"));
    let strict = [
        "--fail-if",
        "psnr<0",
        "--fail-if",
        "lpips>0",
        "--fail-if",
        "psnr<0 per scene",
    ];
    let strict = [&strict[..], &["--require-power", "psnr=0.001,lpips=0.0001"]].concat();
    for candidate in ["two", "two.zip"] {
        let said = gate(dir, "one", candidate, &strict).ends_with(0);
        assert!(
            said.out.ends_with("passed: none of 8 checks fired\n"),
            "{}",
            said.out
        );
    }
    let rows = sharp_bench(dir, &["compare", "one", "two", "--json"])
        .ends_with(0)
        .json();
    for row in rows["rows"].as_array().unwrap() {
        assert_eq!(
            (&row["verdict"], &row["difference"]),
            (&"none".into(), &0.0.into())
        );
    }

    // Times are not compared if the thread counts differ, and bundles have no times.
    let speed = ["--fail-if", "seconds_per_pair > +0 %"];
    let said = gate(dir, "one", "two", &speed).ends_with(0).out;
    assert!(
        said.contains("2 not compared") && said.contains("1 thread in A"),
        "{said}"
    );
    let said = gate(dir, "one.zip", "two", &speed).ends_with(0).out;
    assert!(said.contains("A has no times; a bundle has them"), "{said}");
    // A bundle with times is treated like its run.
    let with_times = ["bundle", "one", "--times", "--out", "times.zip"];
    sharp_bench(dir, &with_times).ends_with(0);
    let said = gate(dir, "times.zip", "two", &speed).ends_with(0).out;
    assert!(said.contains("1 thread in A"), "{said}");
    let same = ["--fail-if", "seconds_per_pair > +0 %", "--json"];
    let same = gate(dir, "times.zip", "one", &same).ends_with(0).json();
    let checks = same["gate"]["checks"].as_array().unwrap();
    let cost = checks
        .iter()
        .find(|check| check["quantity"] == "seconds_per_pair");
    let reason = cost.unwrap()["reason"].as_str().unwrap();
    assert!(!reason.contains("has no times"), "{reason}");
}

#[test]
fn files_exit_codes_and_errors() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    for (out, method) in [
        ("a", "depth-splat:label=m,resolution=64"),
        ("b", "copy:label=m"),
    ] {
        run(dir, out, "psnr", &["--method", method]).ends_with(0);
    }
    std::fs::write(dir.join("gate.toml"), "fail_if = [\"psnr < -0.1\"]\n").unwrap();
    let with = |more: &[&str]| gate(dir, "b", "a", &[&["--config", "gate.toml"], more].concat());
    let files = ["--junit", "gate.xml", "--markdown", "comment.md"];
    let said = with(&files).ends_with(3);
    assert!(said.out.contains("fired   psnr < -0.1"), "{}", said.out);
    let xml = read(dir.join("gate.xml"));
    let document = roxmltree::Document::parse(&xml).unwrap();
    let suite = document.root_element();
    assert_eq!(
        (suite.attribute("tests"), suite.attribute("failures")),
        (Some("2"), Some("1"))
    );
    let comment = read(dir.join("comment.md"));
    assert!(
        comment.starts_with("### Quality gate failed: 1 of 2 checks fired"),
        "{comment}"
    );
    let lines = comment
        .lines()
        .filter(|line| line.starts_with("| S/seed"))
        .count();
    assert_eq!(lines, 3, "{comment}");
    with(&files);
    assert_eq!(
        (read(dir.join("gate.xml")), read(dir.join("comment.md"))),
        (xml, comment)
    );

    // Other files are not overwritten.
    for option in ["--junit", "--markdown"] {
        let said = gate(
            dir,
            "b",
            "a",
            &["--fail-if", "psnr < -0.1", option, "a/manifest.json"],
        );
        said.is_error_with(&["a/manifest.json", "not overwritten"]);
    }

    gate(dir, "a", "b", &["--fail-if", "psnr < -0.1"]).ends_with(0);
    let power = ["--fail-if", "psnr < -0.1", "--require-power", "psnr=0.01"];
    let said = gate(dir, "a", "b", &power).ends_with(5);
    assert!(said.out.contains("not the required 0.01"), "{}", said.out);

    let any_loss = gate(dir, "a", "b", &[]).ends_with(0).out;
    assert!(any_loss.contains("psnr < 0"), "{any_loss}");
    gate(dir, "a", "b", &["--fail-if", "ssim < -0.1"])
        .is_usage_error_with(&["ssim < -0.1", "that both runs have: psnr"]);
    std::fs::write(dir.join("gate.toml"), "fail_if = []\nspeed = 1\n").unwrap();
    with(&[]).is_usage_error_with(&["gate.toml: line 2", "speed"]);
    gate(dir, "a", "b", &["--config", "absent.toml"]).is_error_with(&["absent.toml"]);
    gate(dir, "a", "absent", &["--fail-if", "psnr < -0.1"]).is_error_with(&["absent"]);
    assert_eq!(gate(dir, "a", "b", &["--fail-if", "psnr > 1"]).code, 2);
}
