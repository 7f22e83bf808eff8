//! Pixels excluded by a dataset's masks do not affect scores.

use std::path::Path;

use image::{GrayImage, Luma, Rgb};
use serde_json::{Value, json};

use crate::own_pictures::own_pictures;
use crate::support::{Said, read, sharp_bench, words};

/// Excludes a block of 16 × 12 of the 64 × 48 pixels of each picture.
fn masks(folder: &Path) {
    let path = folder.join("transforms.json");
    let mut file: Value = serde_json::from_str(&read(&path)).unwrap();
    for frame in file["frames"].as_array_mut().unwrap() {
        let name = frame["file_path"]
            .as_str()
            .unwrap()
            .replace(".png", "-mask.png");
        let mask = GrayImage::from_fn(64, 48, |x, y| {
            Luma([if is_excluded(x, y) { 0 } else { 255 }])
        });
        mask.save(folder.join(&name)).unwrap();
        frame["mask_path"] = json!(name);
    }
    std::fs::write(path, file.to_string()).unwrap();
}

fn is_excluded(x: u32, y: u32) -> bool {
    (20..36).contains(&x) && (16..28).contains(&y)
}

fn run(dir: &Path, out: &str, dataset: &str, more: &[&str]) -> Said {
    let line =
        format!("run --dataset {dataset} --metrics psnr --out {out} --pair-options threshold=0");
    sharp_bench(dir, &[&words(&line)[..], more].concat())
}

#[test]
fn excluded_pixels_have_no_say_in_scores() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    own_pictures(&dir.join("own"), [1.0, -1.0, -1.0]);
    masks(&dir.join("own"));
    let masked = "nerfstudio=own,depth-unit=1,masks=apply";
    let list = format!("pairs --dataset {masked} --pair-options threshold=0 --out p.csv");
    sharp_bench(dir, &words(&list)).ends_with(0);
    let export = format!("pairs export --pairs p.csv --dataset {masked} --with target --out e");
    sharp_bench(dir, &words(&export)).ends_with(0);
    // The target, changed only in the excluded pixels.
    let ids: Vec<String> = read(dir.join("p.csv"))
        .lines()
        .skip(1)
        .map(|line| line.split(',').next().unwrap().to_owned())
        .collect();
    for id in &ids {
        let target = image::open(dir.join("e").join(id).join("target.png")).unwrap();
        let mut prediction = target.to_rgb8();
        for (x, y, pixel) in prediction.enumerate_pixels_mut() {
            if is_excluded(x, y) {
                assert_eq!(pixel.0, [0; 3]);
                *pixel = Rgb([255, 0, 255]);
            }
        }
        let path = dir.join("mine").join(format!("{id}.png"));
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        prediction.save(path).unwrap();
    }
    let methods = words("--method imported:label=mine,dir=mine --method copy --json");
    let said = run(dir, "r", masked, &methods).ends_with(0).json();
    let rule = said["manifest"]["scoring"]["excluded pixels"]
        .as_str()
        .unwrap();
    assert!(rule.contains("mean colour"), "{rule}");
    let scores = read(dir.join("r/scores.csv"));
    let mut rows = scores
        .lines()
        .map(|line| line.split(',').collect::<Vec<_>>());
    let header = rows.next().unwrap();
    let column = |name: &str| header.iter().position(|found| *found == name).unwrap();
    let (method, psnr, share) = (column("method"), column("psnr"), column("valid_share"));
    let (mine, copy): (Vec<_>, Vec<_>) = rows.partition(|row| row[method] == "mine");
    assert_eq!((mine.len(), copy.len()), (ids.len(), ids.len()));
    for row in &mine {
        assert_eq!(row[psnr], "inf");
        assert_eq!(row[share], "0.9375");
    }
    assert!(
        copy.iter()
            .all(|row| row[psnr].parse::<f64>().unwrap() < 60.0)
    );
    // If masks are not read, every pixel is scored.
    let plain = "nerfstudio=own,depth-unit=1";
    let said = run(
        dir,
        "s",
        plain,
        &["--method", "imported:label=mine,dir=mine"],
    );
    said.ends_with(0);
    assert!(!read(dir.join("s/scores.csv")).contains("inf"));
}
