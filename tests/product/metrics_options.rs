//! Options of `sharp-bench metrics`: masks, maps, terms, kernels, resizing, CSV, descriptions, and
//! their errors.

use std::path::Path;

use exr::prelude::read_first_flat_layer_from_file;
use image::{GrayImage, Luma, Rgb, RgbImage};
use safetensors::tensor::{Dtype, TensorView};
use sharp_checkpoint::deterministic::backbone_weights;

use crate::support::{Said, holds, sharp_bench};

const WIDTH: u32 = 48;
const HEIGHT: u32 = 40;

fn picture(seed: u32, (width, height): (u32, u32)) -> RgbImage {
    RgbImage::from_fn(width, height, |x, y| {
        let v = (x * 7 + y * 13 + seed * 29 + x * y) % 251;
        Rgb([v as u8, (v / 2 + x) as u8, 255 - v as u8])
    })
}

/// `p/` and `t/` with two pictures each.
fn folder() -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    for (side, seed) in [("p", 0), ("t", 1)] {
        std::fs::create_dir(dir.path().join(side)).unwrap();
        for (name, more) in [("a", 0), ("b", 5)] {
            let path = dir.path().join(side).join(format!("{name}.png"));
            picture(seed + more, (WIDTH, HEIGHT)).save(path).unwrap();
        }
    }
    dir
}

/// White in the left half.
fn half_mask(path: &Path) {
    GrayImage::from_fn(WIDTH, HEIGHT, |x, _| {
        Luma([if x < WIDTH / 2 { 255 } else { 0 }])
    })
    .save(path)
    .unwrap();
}

/// Deterministic weights of AlexNet's convolutions, as a user's file.
fn alexnet(path: &Path) {
    let layers: [(&str, &[usize]); 5] = [
        ("0", &[64, 3, 11, 11]),
        ("3", &[192, 64, 5, 5]),
        ("6", &[384, 192, 3, 3]),
        ("8", &[256, 384, 3, 3]),
        ("10", &[256, 256, 3, 3]),
    ];
    let mut tensors: Vec<(String, Vec<usize>, Vec<u8>)> = Vec::new();
    for (layer, shape) in layers {
        for (part, shape) in [("weight", shape), ("bias", &shape[..1])] {
            let name = format!("{layer}.{part}");
            let values = backbone_weights("", &format!("alexnet.features.{name}"), shape);
            let bytes = values.iter().flat_map(|v| v.to_le_bytes()).collect();
            tensors.push((format!("features.{name}"), shape.to_vec(), bytes));
        }
    }
    let views = tensors.iter().map(|(name, shape, bytes)| {
        (
            name,
            TensorView::new(Dtype::F32, shape.clone(), bytes).unwrap(),
        )
    });
    std::fs::write(path, safetensors::serialize(views, None).unwrap()).unwrap();
}

fn metrics(dir: &Path, args: &str) -> Said {
    let args: Vec<&str> = ["metrics"]
        .into_iter()
        .chain(args.split_whitespace())
        .collect();
    sharp_bench(dir, &args)
}

/// −10 log₁₀ of the mean squared error over the scored pixels, computed from the definition.
fn psnr(a: &RgbImage, b: &RgbImage, counts: impl Fn(u32) -> bool) -> f64 {
    let (mut sum, mut n) = (0.0, 0.0);
    for (x, y, pixel) in a.enumerate_pixels().filter(|(x, ..)| counts(*x)) {
        for (p, t) in pixel.0.iter().zip(b.get_pixel(x, y).0) {
            sum += ((f64::from(*p) - f64::from(t)) / 255.0).powi(2);
            n += 1.0;
        }
    }
    -10.0 * f64::log10(sum / n)
}

#[test]
fn a_mask_adds_keys_of_its_own_and_leaves_the_others() {
    let dir = folder();
    half_mask(&dir.path().join("mask.png"));
    let said = metrics(dir.path(), "p/a.png t/a.png --mask mask.png --json").ends_with(0);
    holds(&said.err, &["DISTS has no masked form"]);
    let json = said.json();
    let scores = &json["pairs"][0]["scores"];
    assert_eq!(json["pairs"][0]["mask"], "mask.png");
    let (p, t) = (picture(0, (WIDTH, HEIGHT)), picture(1, (WIDTH, HEIGHT)));
    let score = |key: &str| scores[key].as_f64().unwrap();
    assert!((score("psnr") - psnr(&p, &t, |_| true)).abs() < 1e-9);
    assert!((score("psnr@mask") - psnr(&p, &t, |x| x < WIDTH / 2)).abs() < 1e-9);
    assert_ne!(
        scores["ssim[gauss11,valid]"],
        scores["ssim[gauss11,valid]@mask"]
    );
    assert!(scores.get("psnr@frustum").is_none());
    // A list that names masked keys is used unchanged.
    let json = metrics(
        dir.path(),
        "p/a.png t/a.png --mask mask.png --metrics psnr@mask --json",
    )
    .json();
    assert_eq!(json["mean"].as_object().unwrap().len(), 1);
}

#[test]
fn masks_that_keep_little_are_warned_about_once() {
    let dir = folder();
    let masks = dir.path().join("masks");
    std::fs::create_dir(&masks).unwrap();
    for name in ["a.png", "b.png"] {
        let narrow = GrayImage::from_fn(WIDTH, HEIGHT, |x, _| Luma([255 * u8::from(x < 16)]));
        narrow.save(masks.join(name)).unwrap();
    }
    let warnings = |mask: &str| {
        let said = metrics(
            dir.path(),
            &format!("p t --mask {mask} --metrics psnr --json"),
        );
        let count = said.err.matches("invert the masks").count();
        (count, said.json()["warnings"].as_array().unwrap().len())
    };
    // A third of the pixels is not suspiciously few.
    assert_eq!(warnings("masks"), (0, 0));
    for name in ["a.png", "b.png"] {
        let narrow = GrayImage::from_fn(WIDTH, HEIGHT, |x, _| Luma([255 * u8::from(x < 6)]));
        narrow.save(masks.join(name)).unwrap();
    }
    assert_eq!(warnings("masks"), (1, 1));
}

#[test]
fn repeated_and_lossy_predictions_are_named() {
    let dir = tempfile::tempdir().unwrap();
    for (name, seed) in [("a", 0), ("b", 9), ("c", 20)] {
        for (side, shown, ending) in [
            ("t", seed, "png"),
            ("same", 0, "jpg"),
            ("good", seed, "png"),
        ] {
            let folder = dir.path().join(side);
            std::fs::create_dir_all(&folder).unwrap();
            let picture = RgbImage::from_fn(40, 30, |x, y| {
                Rgb([x * 6, y * 8, (x + y + shown) * 3].map(|level| level as u8))
            });
            picture
                .save(folder.join(name).with_extension(ending))
                .unwrap();
        }
    }
    let said = metrics(dir.path(), "same t --metrics psnr")
        .ends_with(0)
        .err;
    for named in [
        "3 of its 3 pictures are equal to another picture",
        "3 of 3 predictions are stored as JPEG",
    ] {
        assert!(said.contains(named), "{said}");
    }
    let said = metrics(dir.path(), "good t --metrics psnr")
        .ends_with(0)
        .err;
    assert!(
        !said.contains("equal to another") && !said.contains("JPEG"),
        "{said}"
    );
}

#[test]
fn a_change_that_all_predictions_have_in_common_is_named() {
    let dir = tempfile::tempdir().unwrap();
    for side in ["t", "good", "bgr", "gbr", "bgr-floats"] {
        std::fs::create_dir(dir.path().join(side)).unwrap();
    }
    for name in ["a", "b", "c", "d"] {
        let phase = f64::from(name.as_bytes()[0]);
        let scene = |moved: f64| {
            RgbImage::from_fn(96, 64, |x, y| {
                let (u, v) = ((f64::from(x) + moved) / 9.0 + phase, f64::from(y) / 13.0);
                Rgb([0.0, 0.9, 2.4]
                    .map(|c| (120.0 + 60.0 * (u + c).sin() + 50.0 * (v + 0.3 * u + c).cos()) as u8))
            })
        };
        let stored = |side: &str, picture: &RgbImage, order: [usize; 3]| {
            let mut picture = picture.clone();
            picture
                .pixels_mut()
                .for_each(|p| p.0 = order.map(|c| p.0[c]));
            picture
                .save(dir.path().join(side).join(format!("{name}.png")))
                .unwrap();
        };
        stored("t", &scene(0.0), [0, 1, 2]);
        stored("good", &scene(1.0), [0, 1, 2]);
        stored("bgr", &scene(1.0), [2, 1, 0]);
        stored("gbr", &scene(1.0), [1, 2, 0]);
        let header = "{'descr': '<f4', 'fortran_order': False, 'shape': (64, 96, 3), }";
        let mut floats = b"\x93NUMPY\x01\x00\x76\x00".to_vec();
        floats.extend(format!("{header:<117}\n").as_bytes());
        for pixel in scene(1.0).pixels() {
            floats.extend(
                [2, 1, 0]
                    .map(|c| (f32::from(pixel.0[c]) / 255.0).to_le_bytes())
                    .concat(),
            );
        }
        std::fs::write(dir.path().join(format!("bgr-floats/{name}.npy")), floats).unwrap();
    }
    for (side, named) in [
        ("good", ""),
        ("bgr", "have red and blue swapped; 4 of 4"),
        ("bgr-floats", "have red and blue swapped; 4 of 4"),
        ("gbr", "contain green, blue and red"),
    ] {
        let said = metrics(dir.path(), &format!("{side} t --metrics psnr --json")).ends_with(0);
        assert!(said.err.contains(named), "{side}: {}", said.err);
        assert_eq!(
            said.json()["warnings"].as_array().unwrap().len(),
            usize::from(!named.is_empty()),
            "{}",
            said.err
        );
    }
}

#[test]
fn masks_of_a_folder_are_matched_and_must_fit() {
    let dir = folder();
    let masks = dir.path().join("masks");
    std::fs::create_dir(&masks).unwrap();
    half_mask(&masks.join("a.png"));
    let args = "p t --mask masks --metrics psnr --json";
    metrics(dir.path(), args).is_error_with(&["p/b.png", "no picture with the same stem in masks"]);
    GrayImage::from_pixel(WIDTH, HEIGHT, Luma([255]))
        .save(masks.join("b.png"))
        .unwrap();
    let json = metrics(dir.path(), args).ends_with(0).json();
    let scores = |i: usize| &json["pairs"][i]["scores"];
    assert_ne!(scores(0)["psnr"], scores(0)["psnr@mask"]);
    assert_eq!(scores(1)["psnr"], scores(1)["psnr@mask"]);

    GrayImage::new(WIDTH + 1, HEIGHT)
        .save(masks.join("b.png"))
        .unwrap();
    metrics(dir.path(), args).is_error_with(&["masks/b.png", "49x40", "48x40"]);
    GrayImage::new(WIDTH, HEIGHT)
        .save(masks.join("b.png"))
        .unwrap();
    metrics(dir.path(), args).is_error_with(&["p/b.png", "psnr@mask", "no pixel"]);
    let one = "p/a.png t/a.png --mask p/a.png --metrics psnr";
    metrics(dir.path(), one).is_error_with(&["p/a.png", "coloured"]);
    let masked = |list: &str| {
        let args = format!("p/a.png t/a.png --mask masks/a.png --metrics {list}");
        metrics(dir.path(), &args)
    };
    masked("dists@mask").is_usage_error_with(&["no masked form"]);
    masked("psnr@frustum").is_error_with(&["@mask"]);
    metrics(dir.path(), "p/a.png t/a.png --metrics psnr@mask")
        .is_error_with(&["psnr@mask", "--mask"]);
}

#[test]
fn maps_are_pictures_and_floats_that_average_to_the_score() {
    let dir = folder();
    let args = "p t --metrics psnr,ssim-gauss11-valid,ssim-gauss11-zero --maps out/maps --json";
    let json = metrics(dir.path(), args).ends_with(0).json();
    for pair in json["pairs"].as_array().unwrap() {
        let maps = pair["maps"].as_object().unwrap();
        let keys: Vec<&String> = maps.keys().collect();
        assert_eq!(
            keys,
            ["difference", "ssim[gauss11,valid]", "ssim[gauss11,zero]"]
        );
        for (key, map) in maps {
            let at = |kind: &str| dir.path().join(map[kind].as_str().unwrap());
            let png = image::open(at("png")).unwrap();
            assert_eq!((png.width(), png.height()), (WIDTH, HEIGHT));
            let exr = read_first_flat_layer_from_file(at("exr"))
                .unwrap()
                .layer_data;
            assert_eq!((exr.size.0, exr.size.1), (WIDTH as usize, HEIGHT as usize));
            let [channel] = exr.channel_data.list.as_slice() else {
                panic!("{key}: one channel is expected");
            };
            assert_eq!(channel.name.to_string(), "Y");
            let values: Vec<f64> = channel.sample_data.values_as_f32().map(f64::from).collect();
            let known: Vec<f64> = values.iter().copied().filter(|v| !v.is_nan()).collect();
            let border = if key == "ssim[gauss11,valid]" { 5 } else { 0 };
            let inner = (WIDTH - 2 * border) * (HEIGHT - 2 * border);
            assert_eq!(known.len(), inner as usize, "{key}");
            let mean = known.iter().sum::<f64>() / known.len() as f64;
            if let Some(score) = pair["scores"][key].as_f64() {
                assert!((mean - score).abs() < 1e-6, "{key}: {mean} {score}");
            } else {
                let top = map["bright"].as_f64().unwrap();
                assert!(known.iter().all(|v| (0.0..=top).contains(v)), "{key}");
            }
        }
    }
    assert!(
        dir.path()
            .join("out/maps/b.ssim-gauss11-zero.png")
            .is_file()
    );
    std::fs::write(dir.path().join("file"), b"").unwrap();
    let args = "p t --metrics psnr --maps file/maps";
    metrics(dir.path(), args).is_error_with(&["file/maps", "cannot write into"]);
}

#[test]
fn learned_metrics_come_with_terms_maps_weights_and_kernels() {
    let dir = folder();
    alexnet(&dir.path().join("alexnet.safetensors"));
    let run = |more: &str| {
        let args = format!(
            "p/a.png t/a.png --metrics lpips-alex --weights alexnet=alexnet.safetensors --terms --json {more}"
        );
        metrics(dir.path(), &args).ends_with(0).json()
    };
    let key = "lpips[alex,v0.1]";
    let fast = run("--maps maps");
    let value = |json: &serde_json::Value| json["pairs"][0]["scores"][key].as_f64().unwrap();
    let terms = &fast["pairs"][0]["terms"][key];
    let layers: Vec<f64> = serde_json::from_value(terms["layers"].clone()).unwrap();
    assert_eq!(terms["names"].as_array().unwrap().len(), 5);
    assert!((layers.iter().sum::<f64>() - value(&fast)).abs() < 1e-12);
    assert!(dir.path().join("maps/a.lpips-alex.exr").is_file());

    let facts = &fast["metrics"][0];
    assert_eq!(facts["key"], key);
    assert_eq!(facts["input_range"], "-1..1");
    assert_eq!(facts["resize"], "none");
    assert!(
        facts["own_weights"]["sha256"]
            .as_str()
            .unwrap()
            .starts_with("df73285e")
    );
    let file = std::fs::read(dir.path().join("alexnet.safetensors")).unwrap();
    let sha256 = sharp_bench::io::hash::sha256_hex(&file);
    assert_eq!(facts["backbone"]["file_sha256"], sha256);
    let networks = |json: &serde_json::Value| {
        let text = json["conditions"]["networks"].as_str();
        text.unwrap().to_owned()
    };
    assert!(networks(&fast).ends_with(", winograd"));
    assert!(
        fast["conditions"]["decoder"]
            .as_str()
            .unwrap()
            .contains("png ")
    );
    assert_eq!(fast["pairs"][0]["bit_depth"]["target"], "8 bit");

    // Other arithmetic gives the same number within its tolerance.
    for (more, arithmetic) in [
        ("--exact", ", direct"),
        ("--simd portable", "portable, winograd"),
        ("--simd portable --exact", "portable, direct"),
    ] {
        let json = run(more);
        assert!(
            networks(&json).ends_with(arithmetic),
            "{more}: {}",
            networks(&json)
        );
        let allowed = (2e-5 * value(&fast)).max(1e-6);
        assert!((value(&json) - value(&fast)).abs() <= allowed, "{more}");
    }
    let args = "p/a.png t/a.png --device tpu";
    assert_eq!(metrics(dir.path(), args).code, 2);
}

#[test]
fn unequal_sizes_need_a_named_kernel_and_leave_a_trace() {
    let dir = folder();
    let small = image::imageops::thumbnail(&picture(0, (WIDTH, HEIGHT)), WIDTH / 2, HEIGHT / 2);
    small.save(dir.path().join("small.png")).unwrap();
    metrics(dir.path(), "small.png t/a.png --metrics psnr").is_error_with(&[
        "24x20, but the target is 48x40; set a kernel to resize it (--resize-prediction bilinear|",
    ]);
    let mut found = Vec::new();
    for kernel in ["bilinear", "bicubic", "lanczos"] {
        let args = format!("small.png t/a.png --metrics psnr --resize-prediction {kernel} --json");
        let json = metrics(dir.path(), &args).ends_with(0).json();
        assert_eq!(
            json["pairs"][0]["resized_from"],
            serde_json::json!([24, 20])
        );
        assert_eq!(json["conditions"]["resize_prediction"], kernel);
        found.push(json["mean"]["psnr"].as_f64().unwrap());
    }
    found.dedup();
    assert_eq!(
        found.len(),
        3,
        "three kernels give three numbers: {found:?}"
    );
    let args = "small.png t/a.png --metrics psnr --resize-prediction area";
    metrics(dir.path(), args).is_error_with(&["area only reduces"]);
    let args = "small.png t/a.png --metrics psnr --resize-prediction lanczos";
    let said = metrics(dir.path(), args).ends_with(0);
    holds(&said.out, &["1 prediction resized: lanczos, PIL"]);
    let json = metrics(
        dir.path(),
        "p/a.png t/a.png --metrics psnr --resize-prediction area --json",
    )
    .json();
    assert!(json["pairs"][0].get("resized_from").is_none());
    assert_eq!(metrics(dir.path(), "p t --resize-prediction cubic").code, 2);
}

#[test]
fn csv_has_a_row_a_pair_and_says_what_is_missing() {
    let dir = folder();
    metrics(dir.path(), "p t --metrics paper --csv out/scores.csv").ends_with(0);
    let text = std::fs::read_to_string(dir.path().join("out/scores.csv")).unwrap();
    let mut lines = csv::Reader::from_reader(text.as_bytes());
    let header = lines.headers().unwrap().clone();
    assert_eq!(
        header.iter().collect::<Vec<_>>(),
        [
            "prediction",
            "target",
            "dists",
            "lpips[alex,v0.1]",
            "psnr",
            "ssim[gauss11,valid]",
            "unavailable"
        ]
    );
    let rows: Vec<csv::StringRecord> = lines.records().map(Result::unwrap).collect();
    assert_eq!(rows.len(), 2);
    let (p, t) = (picture(5, (WIDTH, HEIGHT)), picture(6, (WIDTH, HEIGHT)));
    assert_eq!(&rows[1][0], "p/b.png");
    assert!((rows[1][4].parse::<f64>().unwrap() - psnr(&p, &t, |_| true)).abs() < 1e-9);
    assert!(rows[0][2].parse::<f64>().unwrap() > 0.0);
    metrics(dir.path(), "p t --metrics all --csv all.csv").ends_with(0);
    let all = std::fs::read_to_string(dir.path().join("all.csv")).unwrap();
    let missing = "lpips[squeeze,v0.1]: needs the weights of squeezenet1_1";
    assert!(all.contains(missing), "{all}");
    metrics(dir.path(), "p t --csv p/a.png/x.csv").is_error_with(&["p/a.png", "cannot write into"]);
}

#[test]
fn a_strangers_number_is_traced_to_its_convention() {
    let dir = folder();
    let json = metrics(dir.path(), "p/a.png t/a.png --metrics ssim-all --json")
        .ends_with(0)
        .json();
    let value = json["mean"]["ssim[gauss11,zero]"].as_f64().unwrap();
    let args = format!("p/a.png t/a.png --metrics all --find {value:.4}");
    let said = metrics(dir.path(), &args).ends_with(0);
    assert!(said.out.contains("is ssim[gauss11,zero]"), "{}", said.out);
    assert!(said.out.contains("3D Gaussian Splatting"), "{}", said.out);
    let json = metrics(dir.path(), &format!("{args} --json")).json();
    let found = json["found"].as_array().unwrap();
    assert!(found.contains(&"ssim[gauss11,zero]".into()), "{found:?}");
    let said = metrics(dir.path(), "p/a.png t/a.png --metrics all --find 77.123").ends_with(0);
    assert!(said.out.contains("77.123 matches none"), "{}", said.out);
}

#[test]
fn keys_are_explained_and_described_for_papers_without_any_picture() {
    let dir = folder();
    alexnet(&dir.path().join("alexnet.safetensors"));
    let said = metrics(dir.path(), "--explain --metrics all").ends_with(0);
    for part in [
        "scikit-image",
        "kornia",
        "--metrics dists-resize256",
        "Same as lpips.LPIPS",
        "alexnet=8eed026b364dd02bdf76d6ca5a9bfaa0efb090d22a8b79ad51186269c08605c7, torchvision's",
        "torchvision's squeezenet1_1-b8a52dc0.pth, a file that is missing",
    ] {
        assert!(said.out.contains(part), "{part}");
    }
    // With other features, no other program gives the same numbers.
    let args = "--explain --metrics lpips --weights alexnet=alexnet.safetensors";
    let said = metrics(dir.path(), args).ends_with(0);
    assert!(!said.out.contains("Same as") && said.out.contains("not those torchvision published"));
    let keys = metrics(dir.path(), "--explain --metrics all --json").json();
    assert_eq!(keys.as_array().unwrap().len(), 23);
    let args = "--methods-text --metrics lpips-alex,psnr --weights alexnet=alexnet.safetensors";
    let said = metrics(dir.path(), args).ends_with(0);
    let file = std::fs::read(dir.path().join("alexnet.safetensors")).unwrap();
    let sha256 = sharp_bench::io::hash::sha256_hex(&file);
    for part in [
        "version 0.1",
        "AlexNet",
        &sha256[..12],
        "scaled to -1..1",
        "% @inproceedings{zhang2018",
    ] {
        assert!(said.out.contains(part), "{part}: {}", said.out);
    }
    let said = metrics(dir.path(), "--methods-text --metrics lpips-squeeze").ends_with(0);
    assert!(said.err.contains("squeezenet1_1") && said.out.contains("[hash of the weights]"));
}
