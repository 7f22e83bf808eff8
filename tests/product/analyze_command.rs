//! `sharp-bench analyze` as people run it.

use image::{Rgb, RgbImage};

use crate::support::{read, sharp_bench, words};

fn folder() -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    let picture = RgbImage::from_fn(200, 60, |x, y| {
        let v = (x * 7 + y * 13 + x * y / 3) % 251;
        Rgb([v as u8, (v / 2 + x / 4) as u8, 255 - v as u8])
    });
    picture.save(dir.path().join("photo.png")).unwrap();
    dir
}

#[test]
fn the_table_of_translations_with_files_and_json() {
    let dir = folder();
    let args = words("analyze translation photo.png --out out --json");
    let json = sharp_bench(dir.path(), &args).ends_with(0).json();
    assert_eq!(json["window"], serde_json::json!([190, 60]));
    let rows = json["comparisons"].as_array().unwrap();
    let labels: Vec<&str> = rows
        .iter()
        .map(|row| row["comparison"].as_str().unwrap())
        .collect();
    assert_eq!(
        labels,
        [
            "Translated (0.1 %)",
            "Translated (1.0 %)",
            "Translated (5.0 %)",
            "Mean image"
        ]
    );
    assert_eq!(rows[2]["shift_px"], 10.0);
    assert!(rows[0]["scores"]["dists"].is_f64());
    let psnr = |i: usize| rows[i]["scores"]["psnr"].as_f64().unwrap();
    assert!(psnr(0) > psnr(1) && psnr(1) > psnr(2));

    let names = [
        "translation.md",
        "translation.csv",
        "translation.tex",
        "translation.svg",
    ];
    for name in names {
        assert!(
            !read(dir.path().join("out").join(name)).is_empty(),
            "{name}"
        );
    }
    for name in ["translation.png", "translation-pictures.png"] {
        image::open(dir.path().join("out").join(name)).unwrap();
    }
    let md = read(dir.path().join("out/translation.md"));
    assert!(
        md.contains("| Translated (0.1 %)") && !md.contains("n/a"),
        "{md}"
    );
    assert!(
        md.contains("[unstated]") && md.contains("does not name"),
        "{md}"
    );
    let csv = read(dir.path().join("out/translation.csv"));
    assert!(
        csv.starts_with("comparison,shift_percent,shift_px,dists,"),
        "{csv}"
    );
    assert_eq!(csv.lines().count(), 5);
}

#[test]
fn the_table_is_printed_and_bad_input_refused() {
    let dir = folder();
    let run = |more: &[&str]| {
        let args = [&["analyze", "translation", "photo.png"], more].concat();
        sharp_bench(dir.path(), &args)
    };
    let said = run(&["--shifts", "2", "--metrics", "psnr"]).ends_with(0);
    assert!(said.out.contains("Translated (2.0 %)") && said.out.contains("Mean image"));
    run(&["--metrics", "lpips-squeeze"]).is_error_with(&["weights fetch squeezenet1_1"]);
    run(&["--metrics", "psnr@mask"]).is_error_with(&["no mask"]);
    assert_eq!(run(&["--shifts", "0"]).code, 2);
    assert_eq!(run(&["--shifts", "60"]).code, 2);
    RgbImage::new(2, 2)
        .save(dir.path().join("photo.png"))
        .unwrap();
    run(&[]).is_error_with(&["photo.png", "2 pixels"]);
    std::fs::remove_file(dir.path().join("photo.png")).unwrap();
    run(&[]).is_error_with(&["photo.png"]);
}
