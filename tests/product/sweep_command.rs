//! `sharp-bench sweep` and `figure` as people run them.

use std::path::Path;

use crate::support::{ascii_ply, holds, read, sharp_bench, words};
use crate::tiny::{recorded_input, tiny};

/// Runs of a controlled sweep: two scenes, three steps of 5 cm each.
fn folder() -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    let args = words(
        "run --dataset S:synthetic=sweep=translation,size=48x36,views=4,scenes=2 --method copy \
         --method mean --metrics psnr --out run",
    );
    sharp_bench(dir.path(), &args).ends_with(0);
    dir
}

fn is_there(dir: &Path, name: &str) {
    assert!(dir.join(name).is_file(), "{name}");
    if name.ends_with(".pdf") {
        let file = hayro_syntax::Pdf::new(std::fs::read(dir.join(name)).unwrap());
        let file = file.unwrap_or_else(|_| panic!("{name} cannot be opened"));
        let page = &file.pages()[0];
        let mut operations = page.operations();
        let count = std::iter::from_fn(|| operations.next().map(|_| ())).count();
        assert!(file.pages().len() == 1 && count > 100, "{name}: {count}");
    }
}

#[test]
fn a_controlled_sweep_from_pictures_to_tables() {
    let dir = folder();
    let args = words(
        "sweep run --bins 0.05 --threshold psnr=99 --against copy --methods copy,mean --out out \
         --json",
    );
    let said = sharp_bench(dir.path(), &args).ends_with(0).json();
    assert_eq!(said["crossings"][0]["rule"], "below 99");
    assert_eq!(said["crossings"][0]["x"], "-inf");
    assert_eq!(said["crossings"].as_array().unwrap().len(), 3);
    for name in ["psnr.svg", "psnr.png", "psnr.pdf"] {
        is_there(dir.path(), &format!("out/sweep-{name}"));
    }
    let csv = read(dir.path().join("out/sweep.csv"));
    let of_copy: Vec<Vec<&str>> = csv
        .lines()
        .filter(|line| line.starts_with("S,copy,"))
        .map(|line| line.split(',').collect())
        .collect();
    let edges: Vec<(&str, &str, &str)> = of_copy.iter().map(|r| (r[5], r[6], r[7])).collect();
    // One bin per step, with two scenes each.
    assert_eq!(
        edges,
        [
            ("0.05", "0.1", "2"),
            ("0.1", "0.15", "2"),
            ("0.15", "0.2", "2")
        ]
    );
    let tex = read(dir.path().join("out/sweep.tex"));
    assert!(tex.contains("\\toprule") && tex.contains("0.05--0.1 & 2 &"));
    assert!(
        read(dir.path().join("out/sweep-crossings.csv")).contains("S,mean,S,psnr,behind copy,")
    );

    // A repetition gives the same files and replaces the earlier ones.
    let before = std::fs::read(dir.path().join("out/sweep-psnr.pdf")).unwrap();
    sharp_bench(dir.path(), &args).ends_with(0);
    assert!(before == std::fs::read(dir.path().join("out/sweep-psnr.pdf")).unwrap());
    let sweep = |more: &[&str]| {
        let common = ["sweep", "run", "--out", "out"];
        sharp_bench(dir.path(), &[&common, more].concat())
    };
    let limits = ["--metrics", "psnr", "--threshold", "ssim=0.5"];
    sweep(&limits).is_usage_error_with(&["--threshold ssim", "--metrics does not include"]);
    let said = sweep(&["--bins", "1e3"]).ends_with(2);
    assert!(said.err.contains("at most 15 digits"), "{}", said.err);
    // Without crossings, the earlier file of crossings is removed; pairs beyond the edges are
    // counted.
    let said = sweep(&["--bins", "0,0.11"]).ends_with(0);
    for part in [
        "sweep-crossings.csv was left by",
        "S: 2 of 6 pairs lie outside all",
    ] {
        assert!(said.err.contains(part), "{part}: {}", said.err);
    }
    assert!(!dir.path().join("out/sweep-crossings.csv").exists());
    // A user's own file is kept, and then nothing else is written either.
    let drawn = read(dir.path().join("out/sweep-psnr.svg"));
    std::fs::write(dir.path().join("out/sweep.csv"), "mine\n").unwrap();
    sharp_bench(dir.path(), &args).is_error_with(&["sweep.csv", "of another kind"]);
    assert_eq!(read(dir.path().join("out/sweep.csv")), "mine\n");
    assert_eq!(read(dir.path().join("out/sweep-psnr.svg")), drawn);
}

#[test]
fn figures_of_runs() {
    let dir = folder();
    std::fs::write(dir.path().join("style.toml"), "width_mm = 60\ndpi = 100\n").unwrap();
    let figure = |name: &str, more: &[&str]| {
        let common = ["figure", name, "run", "--out", "f", "--style", "style.toml"];
        sharp_bench(dir.path(), &[&common, more].concat())
    };
    for name in ["baselines", "fidelity-time"] {
        let more: &[&str] = if name == "baselines" {
            &[]
        } else {
            &["--metric", "psnr"]
        };
        figure(name, more).ends_with(0);
        is_there(dir.path(), &format!("f/{name}.pdf"));
    }
    for name in ["qualitative", "ablation", "extended-motion"] {
        figure(name, &["--crop", "4,4,12,9"]).ends_with(0);
        is_there(dir.path(), &format!("f/{name}.svg"));
        is_there(dir.path(), &format!("f/{name}.pdf"));
        let png = image::open(dir.path().join(format!("f/{name}.png"))).unwrap();
        // 60 mm at 100 dpi, minus the pixels that remain after division into equal columns.
        assert!(
            (230..=236).contains(&png.width()),
            "{name}: {}",
            png.width()
        );
    }
    figure("failure", &["--methods", "copy"]).ends_with(0);
    figure("failure", &["--methods", "copy,mean"]).is_usage_error_with(&["--methods"]);
    figure("motion", &[]).is_error_with(&["metric 'dists' is not in these runs", "psnr"]);
    figure("qualitative", &["--pair", "x"]).is_error_with(&["pair 'x'", "S/seed0/"]);
    let said = figure("qualitative", &["--crop", "1,2"]).ends_with(2);
    assert!(said.err.contains("X,Y,WIDTH,HEIGHT"), "{}", said.err);
    for name in ["qualitative", "ablation", "extended-motion"] {
        let said = figure(name, &["--count", "0"]).ends_with(2);
        assert!(said.err.contains("--count"), "{}", said.err);
    }
    let list = sharp_bench(dir.path(), &["figure", "list", "--json"])
        .ends_with(0)
        .json();
    assert!(
        list.as_array()
            .unwrap()
            .iter()
            .any(|f| f["name"] == "motion-privileged")
    );

    let misspelt = "[methods.kopy]\nmarker = \"up\"\n";
    std::fs::write(dir.path().join("style.toml"), misspelt).unwrap();
    for (name, more) in [("baselines", &[][..]), ("motion", &["--metrics", "psnr"])] {
        figure(name, more).is_usage_error_with(&["[methods.kopy]", "copy"]);
    }
    std::fs::write(dir.path().join("style.toml"), "font = 3\n").unwrap();
    figure("baselines", &[]).is_usage_error_with(&["--style: style.toml: line 1", "font"]);
    std::fs::write(
        dir.path().join("style.toml"),
        "width_mm = 20\nfont_pt = 40\n",
    )
    .unwrap();
    for name in ["baselines", "qualitative"] {
        figure(name, &[]).is_error_with(&["20 mm", "40 pt", "width_mm"]);
    }
}

#[test]
fn what_is_wrong_with_a_sheet_is_said() {
    let dir = folder();
    let figure = |name: &str, run: &str, more: &[&str]| {
        let common = ["figure", name, run, "--out", "f"];
        // Both methods are requested explicitly, because sheets leave out `mean` by default.
        let both = ["--methods", "copy,mean"];
        let more = if more.contains(&"--methods") {
            more.to_vec()
        } else {
            [&both, more].concat()
        };
        sharp_bench(dir.path(), &[&common, &more[..]].concat())
    };
    let said = figure("qualitative", "run", &["--crop", "40,0,12,9", "--json"]).ends_with(4);
    let outside = "extends beyond its 48 × 36 pixels";
    // Two predictions and the truth.
    assert_eq!(said.err.matches(outside).count(), 3, "{}", said.err);
    assert_eq!(said.json()["problems"].as_array().unwrap().len(), 3);
    is_there(dir.path(), "f/qualitative.png");

    let failure = |more: &[&str]| {
        let more = [&["--methods", "copy"], more].concat();
        figure("failure", "run", &more)
    };
    failure(&["--depth", "nowhere"]).is_error_with(&["nowhere: is not a folder"]);
    let said = failure(&["--depth", "run"]).ends_with(4);
    holds(&said.err, &["no depth map of this pair"]);

    // A bundle has no predictions, but the dataset is available.
    sharp_bench(dir.path(), &["bundle", "run", "--out", "b.zip"]).ends_with(0);
    let said = figure("ablation", "b.zip", &["--count", "6"]).ends_with(4);
    let warnings = said
        .err
        .lines()
        .filter(|line| line.starts_with("warning: "));
    let warnings: Vec<&str> = warnings.collect();
    assert_eq!(warnings.len(), 11, "{}", said.err);
    assert!(warnings[0].contains("S/seed0/") && warnings[0].contains("not kept"));
    assert_eq!(warnings[10], "warning: 2 more not shown");
}

/// Three vertical strips, at 2, 3 and 4 m; the middle one is half transparent. The panel shows
/// their inverse depth, not the dataset's, and alpha has no effect on it.
#[test]
fn the_depth_beside_a_failure_is_that_of_the_rendering() {
    let dir = tempfile::tempdir().unwrap();
    let mut rows = Vec::new();
    for i in 0..160 {
        for j in 0..120 {
            let (u, v) = (f64::from(i - 80) * 0.01, f64::from(j - 60) * 0.01);
            let (z, opacity): (f64, f64) = match u {
                u if u < -0.2 => (2.0, 5.0),
                u if u < 0.2 => (3.0, -3.0),
                _ => (4.0, 5.0),
            };
            let scale = (0.01 * z).ln();
            let row = [
                u * z,
                v * z,
                z,
                0.0,
                0.0,
                0.0,
                opacity,
                scale,
                scale,
                scale,
                1.0,
                0.0,
                0.0,
                0.0,
            ];
            rows.push(row.map(|v| v as f32));
        }
    }
    std::fs::create_dir_all(dir.path().join("g/S/seed0")).unwrap();
    for view in 0..8 {
        let file = dir.path().join(format!("g/S/seed0/view_0{view}.ply"));
        std::fs::write(file, ascii_ply(&rows)).unwrap();
    }
    let dataset = "S:synthetic=sweep=translation,size=48x36,views=4,scenes=1";
    let line = format!(
        "run --dataset {dataset} --method gaussians:dir=g,color_space=srgb --metrics psnr \
         --limit 1 --out run",
    );
    let run = words(&line);
    sharp_bench(dir.path(), &[&run[..], &["--keep", "float"]].concat()).ends_with(0);
    let figure = words("figure failure run --methods gaussians --out f");
    sharp_bench(dir.path(), &figure).ends_with(0);
    let sheet = image::open(dir.path().join("f/failure.png"))
        .unwrap()
        .into_rgb8();
    let (width, height) = sheet.dimensions();
    // Matplotlib's values of Inferno at 1, at (1/3 − 1/4) / (1/2 − 1/4) and at 0; the panel is the
    // last third.
    let strips = [[252, 255, 164], [120, 28, 109], [0, 0, 4]];
    for (strip, expected) in strips.into_iter().enumerate() {
        let x = width * 2 / 3 + width / 3 * [10, 50, 90][strip] / 100;
        let is_it = |y: &u32| {
            let found = sheet.get_pixel(x, *y).0;
            found.iter().zip(expected).all(|(a, b)| a.abs_diff(b) <= 8)
        };
        let rows = (0..height).filter(is_it).count();
        assert!(
            rows > height as usize / 2,
            "strip {strip}: {rows} of {height}"
        );
    }
}

#[test]
fn depth_against_that_of_the_mirrored_picture() {
    let dir = tempfile::tempdir().unwrap();
    let path = |name: &str| dir.path().join(name);
    image::RgbImage::new(8, 6).save(path("p.png")).unwrap();
    let depth = |name: &str, ahead: u16| {
        let map = image::ImageBuffer::from_fn(8, 6, |x, _| image::Luma([ahead + 100 * x as u16]));
        map.save(path(name)).unwrap();
    };
    depth("d.png", 1000);
    depth("m.png", 2000);
    let args_of_maps =
        words("figure uncertainty --picture p.png --depth d.png --mirrored m.png --out f");
    sharp_bench(dir.path(), &args_of_maps).ends_with(0);
    is_there(dir.path(), "f/uncertainty.png");
    // Both layers of a network, one row each.
    let (photo, _) = recorded_input();
    let mut args = vec!["figure", "uncertainty", "--picture", &photo, "--out", "n"];
    let network = tiny();
    args.extend(network.iter().map(String::as_str));
    sharp_bench(dir.path(), &args).ends_with(0);
    let size = |file: &str| image::open(path(file)).unwrap().height();
    // The column headings appear only once.
    assert!(2 * size("n/uncertainty.png") > 3 * size("f/uncertainty.png"));

    image::ImageBuffer::<image::Luma<u16>, _>::new(8, 6)
        .save(path("z.png"))
        .unwrap();
    let mut empty = args_of_maps;
    empty[7] = "z.png";
    sharp_bench(dir.path(), &empty).is_error_with(&["z.png: no pixel has a depth"]);

    let without = ["figure", "uncertainty", "--picture", "p.png", "--out", "f"];
    let said = sharp_bench(dir.path(), &without).ends_with(2);
    assert!(said.err.contains("--checkpoint"), "{}", said.err);
}
