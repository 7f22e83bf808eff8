//! Cases of pictures: alpha, orientation, colour, masks, names and formats.

use std::path::Path;

use image::RgbImage;
use image::imageops::flip_horizontal;
use sharp_tests::rows;

use super::{Case, case, empty, untried};
use crate::support::{Said, holds};

/// The terminal output, both streams.
fn both(said: &Said) -> String {
    format!("{}{}", said.out, said.err)
}

fn run_line(options: &str, out: &str) -> String {
    format!(
        "sharp-bench run -q --dataset nerfstudio=ns{options} --pairs pairs.csv --method imported:label=over-white,dir=pred \
         --metrics psnr --out {out}"
    )
}

/// The last number of a line of `metrics`.
fn psnr(said: &Said) -> f64 {
    let line = said.out.lines().find(|line| line.starts_with("psnr"));
    line.unwrap()
        .split_whitespace()
        .last()
        .unwrap()
        .parse()
        .unwrap()
}

#[test]
fn a_truth_with_alpha_is_refused_until_it_is_said_what_lies_behind_it() {
    for name in ["A04-rgba-garbage", "A04-rgba-premulblack"] {
        let case = case(name);
        holds(
            &both(&case.said[0]),
            &["view_00.png", "not opaque", "alpha=white"],
        );
        assert_eq!(
            [case.said[0].code, case.said[1].code, case.said[2].code],
            [4, 4, 1]
        );
        holds(&both(&case.said[1]), &["alpha=white"]);
        case.said[2].is_error_with(&["view_01.png", "--alpha white"]);
        // The prediction is exactly the truth composited over white.
        case.run(&run_line(",alpha=white", "w")).ends_with(0);
        assert_eq!(case.scores("w", "psnr"), ["inf"], "{name}");
        case.run(&run_line(",alpha=drop", "d")).ends_with(0);
        assert_ne!(case.scores("d", "psnr"), ["inf"], "{name}");
        let line = "sharp-bench metrics --alpha white --metrics psnr pred/nerfstudio/ns/view_00__view_01.png \
                    ns/images/view_01.png";
        let said = case.run(line).ends_with(0);
        holds(&said.out, &["inf"]);
        assert!(said.err.is_empty(), "{}", said.err);
        let check = case
            .run("sharp-bench datasets check nerfstudio=ns,alpha=white")
            .ends_with(0);
        holds(&check.out, &["reading alpha=white", "problems: 0"]);
    }
}

#[test]
fn pictures_of_nerf_synthetic_are_refused_with_the_setting() {
    let case = case("A04-nerf-synthetic");
    holds(&case.all(), &["r_0.png", "not opaque", "alpha=white"]);
    case.run("sharp-bench datasets check nerfstudio=lego,alpha=white")
        .ends_with(0);
}

#[test]
fn a_prediction_with_alpha_is_refused() {
    let case = case("X32-pred-alpha");
    assert_eq!(case.said[0].code, 4);
    holds(
        &case.all(),
        &["50.0 % of its pixels are not opaque", "alpha=drop"],
    );
    let dropped = "sharp-bench run -q --dataset nerfstudio=ns --pairs pairs.csv --method \
                   imported:label=mine,dir=pred,alpha=drop --metrics psnr --out d";
    case.run(dropped).ends_with(0);
    holds(&case.scores("d", "psnr")[0], &["30.910303467844745"]);
    let manifest = std::fs::read_to_string(case.path("d/manifest.json")).unwrap();
    holds(&manifest, &["\"alpha\": \"drop\""]);
}

#[test]
fn the_polarity_of_masks_is_a_setting_and_small_rests_are_doubted() {
    let case = case("A06-mask-inverted");
    holds(
        &case.said[0].out,
        &["they leave 9.8 % of the pixels", "masks=keep-black"],
    );
    case.is_said_everywhere("r", "they leave 9.8 % of the pixels");
    let line = "sharp-bench run -q --dataset nerfstudio=ns,masks=keep-black --pairs pairs.csv --method copy --metrics psnr@mask \
                --out k";
    let said = case.run(line).ends_with(0);
    assert!(!said.err.contains("they leave"), "{}", said.err);
    let found: f64 = case.scores("k", "psnr@mask")[0].parse().unwrap();
    assert!((found - 19.74).abs() < 0.005, "{found}");
    // It is not read, and this is reported.
    let ignored = case
        .run("sharp-bench datasets check nerfstudio=ns")
        .ends_with(0);
    holds(&ignored.out, &["8 frame(s) have a mask, which is not used"]);
}

#[test]
fn masks_stored_as_jpeg_are_cut_at_half_and_named() {
    let case = case("A06-mask-inverted");
    for k in 0..8 {
        let path = case.path(&format!("ns/masks/view_{k:02}.png"));
        let mask = image::open(&path).unwrap().to_luma8();
        let soft = image::imageops::fast_blur(&mask, 2.0);
        soft.save(path).unwrap();
    }
    let said = case
        .run("sharp-bench datasets check nerfstudio=ns,masks=keep-black")
        .ends_with(0);
    holds(&said.out, &["of their pixels are neither black nor white"]);
}

#[test]
fn masks_of_other_levels_are_named() {
    for name in ["X20-mask-01", "X20-mask-01-nodepth"] {
        let case = case(name);
        assert_eq!(case.said[0].code, 4);
        holds(
            &case.all(),
            &["masks/view_00.png", "its maximum level is 1", "255"],
        );
    }
}

#[test]
fn upright_photographs_fit_upright_cameras() {
    let case = case("X21-exif-rotated");
    assert_eq!(case.said[0].code, 0, "{}", case.all());
    holds(
        &case.all(),
        &[
            "8 of 8 have the EXIF orientation 6",
            "turned upright",
            "problems: 0",
        ],
    );
    let stored = case
        .run("sharp-bench datasets check nerfstudio=ns,orientation=stored")
        .ends_with(4);
    holds(
        &stored.out,
        &[
            "is 48x64, but its camera is for 64x48",
            "EXIF orientation 6, it would be 64x48",
        ],
    );
}

#[test]
fn metrics_turns_pictures_as_predict_does_and_says_so() {
    let case = case("X21-metrics-exif");
    // JPEG decoders differ by a level or two.
    assert!((psnr(&case.said[0]) - 34.09).abs() < 0.03, "{}", case.all());
    holds(
        &case.said[0].err,
        &["target.jpg", "EXIF orientation 3", "--orientation stored"],
    );
    let stored =
        case.run("sharp-bench metrics --orientation stored pred.png target.jpg --metrics psnr");
    assert!((psnr(&stored) - 13.842335941692669).abs() < 1e-9);
}

#[test]
fn crops_and_other_sensors_are_told_from_the_focal_length() {
    let case = case("A07-exif-crop");
    let warned: Vec<bool> = case
        .said
        .iter()
        .map(|said| said.err.contains("--focal-px"))
        .collect();
    assert_eq!(warned, [false, true, true, true], "{}", case.all());
    holds(
        &case.said[1].err,
        &["60.09 px if it was resized", "120.19 px if it was cropped"],
    );
    holds(&case.said[2].err, &["cropped", "120.19 px", "101.98 px"]);
    holds(&case.said[3].err, &["23.6 mm wide", "237", "161.79 px"]);
    let given = case
        .run("sharp-bench predict --checkpoint mini -q --out o.ply --focal-px 120 cropped.jpg")
        .ends_with(0);
    assert!(!given.err.contains("warning"), "{}", given.err);
}

#[test]
fn names_match_however_their_accents_are_composed() {
    let names = case("A28-nfd-names");
    assert_eq!(names.said[0].code, 0, "{}", names.all());
    holds(&names.all(), &["ns: 8 views", "depth in 8 of 8"]);
    let depth = case("A28-nfd-depth");
    holds(&depth.all(), &["depth in 8 of 8 decoded"]);
}

#[test]
fn extensions_are_of_any_case() {
    let case = case("X31-PNG-upper");
    assert_eq!(case.said[0].code, 0, "{}", case.all());
    holds(&case.scores("r", "psnr")[0], &["30.91"]);
}

#[test]
fn the_layout_that_finds_predictions_is_named() {
    let case = case("X31-target-name-in-scene");
    assert_eq!(case.said[0].code, 1);
    holds(
        &case.all(),
        &["1 of 1", "file={dataset}/{scene}/{target}.png"],
    );
}

#[test]
fn formats_are_read_or_refused_by_name() {
    let case = case("X34-predict-formats");
    let codes: Vec<i32> = case.said.iter().map(|said| said.code).collect();
    assert_eq!(codes, [1, 0, 0, 1, 0, 1], "{}", case.all());
    holds(&case.said[0].err, &["HEIC", "heif-convert"]);
    holds(&case.said[3].err, &["AVIF", "avifdec"]);
    case.said[5].is_error_with(&["a folder", "PHOTO.JPG"]);
    for (file, part) in [("p.gif", "a GIF"), ("p.jp2", "JPEG 2000")] {
        let said = case.run(&format!(
            "sharp-bench predict -q --checkpoint mini --out o.ply {file}"
        ));
        said.is_error_with(&[file, part]);
    }
    for file in ["PHOTO.JPG", "p.jfif", "jpeg_named.png", "cmyk.jpg", "p.png"] {
        case.run(&format!(
            "sharp-bench predict -q --checkpoint mini --out o.ply {file}"
        ))
        .ends_with(0);
    }
    // The same pixels in other formats.
    for file in ["p.bmp", "p.tiff"] {
        let said = case
            .run(&format!("sharp-bench metrics --metrics psnr p.png {file}"))
            .ends_with(0);
        holds(&said.out, &["inf"]);
    }
}

#[test]
fn what_an_exr_holds_is_asked_for() {
    let case = case("X35-exr-half-linear");
    assert_eq!(case.said[0].code, 4);
    holds(&case.all(), &["exr=linear", "exr=srgb"]);
    let under = |exr: &str| {
        let line = format!(
            "sharp-bench run -q --dataset nerfstudio=ns --pairs pairs.csv --method imported:label=mine,dir=pred,exr={exr} \
             --metrics psnr --out {exr}"
        );
        case.run(&line).ends_with(0);
        case.scores(exr, "psnr")[0].parse::<f64>().unwrap()
    };
    assert!((under("linear") - 30.91).abs() < 0.005);
    assert!((under("srgb") - 11.62).abs() < 0.005);
}

#[test]
fn display_p3_is_converted_and_named() {
    let case = case("X41-icc-display-p3");
    assert!((psnr(&case.said[0]) - 35.4).abs() < 0.05, "{}", case.all());
    holds(
        &case.said[0].err,
        &["target_p3.png", "colour profile", "--color as-stored"],
    );
    let stored = case
        .run("sharp-bench metrics --color as-stored pred_srgb.png target_p3.png --metrics psnr");
    assert!((psnr(&stored) - 29.634543173126495).abs() < 1e-9);
    holds(&stored.err, &["--color convert"]);
}

#[test]
fn one_broken_photograph_costs_itself() {
    let case = case("X67-predict-batch-one-bad");
    assert_eq!(case.said[0].code, 4, "{}", case.all());
    holds(&case.said[0].err, &["b.png", "1 of 3 photographs failed"]);
    assert!(case.path("o/a.ply").is_file() && case.path("o/c.ply").is_file());
    assert!(!case.path("o/b.ply").exists());
}

#[test]
fn metrics_goes_into_subfolders() {
    let case = case("X72-metrics-nested");
    assert_eq!(case.said[0].code, 0, "{}", case.all());
    holds(&case.all(), &["4 pairs"]);
    let maps = case
        .run("sharp-bench metrics p t --metrics psnr --maps maps --mask t")
        .code;
    assert_eq!(maps, 1, "pictures of colours are no masks");
    case.run("sharp-bench metrics p t --metrics psnr --maps maps")
        .ends_with(0);
    assert!(case.path("maps/a/0.difference.png").is_file());
}

#[test]
fn predict_names_its_own_options() {
    let case = untried("A04-rgba-garbage");
    let predict = |options: &str| {
        let line = "sharp-bench predict -q --checkpoint mini --focal-px 60 --out o.ply ns/images/view_00.png";
        case.run(&format!("{line} {options}"))
    };
    holds(
        &predict("").ends_with(0).err,
        &["its alpha is dropped", "--alpha white"],
    );
    predict("--alpha refuse").is_error_with(&["not opaque", "--alpha drop"]);
    assert!(predict("--alpha white").ends_with(0).err.is_empty());
}

/// Correct files cause no new messages.
#[test]
fn proper_pictures_are_read_in_silence() {
    let silent = |case: &Case, line: &str| {
        let said = case.run(line).ends_with(0);
        for word in ["alpha", "EXIF", "profile", "masks:", "exr="] {
            assert!(!both(&said).contains(word), "{line}: {}", both(&said));
        }
    };
    let case = untried("X31-PNG-upper");
    silent(&case, "sharp-bench datasets check nerfstudio=ns");
    let prediction = "pred/nerfstudio/ns/view_00__view_01.PNG";
    silent(
        &case,
        &format!("sharp-bench metrics {prediction} ns/images/view_01.png --metrics psnr"),
    );
    // A fully opaque alpha channel counts as none.
    let picture = image::open(case.path("ns/images/view_01.png"))
        .unwrap()
        .into_rgba8();
    picture.save(case.path("opaque.png")).unwrap();
    silent(
        &case,
        "sharp-bench metrics opaque.png ns/images/view_01.png --metrics psnr",
    );
    // A picture with the same levels in each format.
    for format in ["webp", "bmp", "tiff"] {
        image::open(case.path("ns/images/view_01.png"))
            .unwrap()
            .save(case.path(&format!("p.{format}")))
            .unwrap();
        let said = case.run(&format!(
            "sharp-bench metrics p.{format} ns/images/view_01.png --metrics psnr"
        ));
        holds(&said.ends_with(0).out, &["inf"]);
    }
}

#[test]
fn a_prediction_that_is_converted_from_its_profile_says_so() {
    use image::{ImageDecoder as _, ImageEncoder as _};
    let p3 = untried("X41-icc-display-p3");
    let file = std::io::BufReader::new(std::fs::File::open(p3.path("target_p3.png")).unwrap());
    let mut decoder = image::codecs::png::PngDecoder::new(file).unwrap();
    let profile = decoder.icc_profile().unwrap().unwrap();
    let case = untried("X32-pred-alpha");
    let path = case.path("pred/nerfstudio/ns/view_00__view_01.png");
    let picture = image::open(&path).unwrap().into_rgb8();
    let mut encoder = image::codecs::png::PngEncoder::new(std::fs::File::create(&path).unwrap());
    encoder.set_icc_profile(profile).unwrap();
    let (width, height) = picture.dimensions();
    encoder
        .write_image(
            picture.as_raw(),
            width,
            height,
            image::ExtendedColorType::Rgb8,
        )
        .unwrap();
    let run = |options: &str, out: &str| {
        case.run(&format!(
            "sharp-bench run -q --dataset nerfstudio=ns --pairs pairs.csv --method imported:label=mine,dir=pred{options} \
             --metrics psnr --out {out}"
        ))
        .ends_with(0)
    };
    let said = run("", "r");
    assert_ne!(case.scores("r", "psnr"), ["30.910303467844745"]);
    let stored = run(",color=as-stored", "stored");
    assert!(!stored.err.contains("profile"), "{}", stored.err);
    assert_eq!(case.scores("stored", "psnr"), ["30.910303467844745"]);
    case.having(vec![said])
        .is_said_everywhere("r", "converted from its colour profile");
}

#[test]
fn pictures_in_subfolders_count_beside_those_above_them() {
    let case = untried("X72-metrics-nested");
    case.run("for f in p t; do cp $(find $f -name '*.png' | sort | head -1) $f/top.png; done")
        .ends_with(0);
    let said = case
        .run("sharp-bench metrics p t --metrics psnr --json")
        .ends_with(0);
    assert_eq!(said.json()["pairs"].as_array().unwrap().len(), 5);
}

/// Predictions of a poor network, stored in another form than they are read in, and correct
/// pictures of several kinds.
#[test]
fn pictures_that_are_stored_otherwise_are_told_by_the_photographs_and_poor_ones_are_not() {
    let case = empty();
    let data = "synthetic=size=160x120,views=8 --limit 6";
    let run = |method: &str, out: &str| {
        let said = case.run(&format!(
            "sharp-bench run -q --dataset {data} --method {method} --metrics psnr --out {out}"
        ));
        assert_eq!(said.code, 0, "{}", said.err);
        said
    };
    run(
        "sharp:label=m,checkpoint=mini --method copy:label=c",
        "made",
    );
    let stored = |to: &str, of: &str, change: &dyn Fn(&RgbImage) -> RgbImage| {
        let rows = csv::Reader::from_path(case.path("made/scores.csv"));
        for row in rows.unwrap().records().map(Result::unwrap) {
            let from = case.path(&format!("made/predictions/{of}/{}.png", &row[0]));
            let picture = change(&image::open(from).unwrap().to_rgb8());
            let to = case.path(&format!("{to}/{}.png", &row[0]));
            std::fs::create_dir_all(to.parent().unwrap_or(Path::new("."))).unwrap();
            picture.save(to).unwrap();
        }
        run(&format!("imported:dir={to}"), &format!("r-{to}"))
    };
    for (of, kind) in [("m", "made"), ("c", "copies")] {
        let proper = stored(&format!("{kind}-again"), of, &RgbImage::clone);
        assert!(!proper.err.contains("look as if"), "{}", proper.err);
    }
    let swapped = |picture: &RgbImage| {
        let mut changed = picture.clone();
        changed.pixels_mut().for_each(|pixel| pixel.0.reverse());
        changed
    };
    let said = vec![
        stored("bgr", "m", &swapped),
        stored("mirrored", "m", &|picture| flip_horizontal(picture)),
    ];
    let all = case.having(said);
    all.is_said_everywhere("r-bgr", "look as if they have red and blue swapped; ");
    all.is_said_everywhere("r-mirrored", "look as if they are mirrored left to right; ");
}

/// Pictures named after other pairs, pictures with other value ranges, and poor pictures with
/// neither mistake.
#[test]
fn pictures_of_other_pairs_and_ranges_are_told_and_poor_ones_are_not() {
    let case = empty();
    let data = "synthetic=size=160x120,views=5";
    let run = |method: &str, out: &str| {
        case.run(&format!(
            "sharp-bench run -q --dataset {data} --method {method} --metrics psnr --out {out}"
        ))
        .ends_with(0)
    };
    run(
        "sharp:label=m,checkpoint=mini --method copy:label=c --method depth-splat:label=d --method target:label=t",
        "made",
    );
    let mut scored = csv::Reader::from_path(case.path("made/scores.csv")).unwrap();
    let ids = scored.records().map(|row| row.unwrap()[0].to_owned());
    let ids: std::collections::BTreeSet<String> = ids.collect();
    let ids: Vec<String> = ids.into_iter().collect();
    let n = ids.len();
    // Stores the changed picture of pair `from(k)` under the name of pair k.
    let store = |to: &str, of: &str, from: &dyn Fn(usize) -> usize, level: &dyn Fn(f64) -> f64| {
        for (k, id) in ids.iter().enumerate() {
            let made = format!("made/predictions/{of}/{}.png", ids[from(k) % n]);
            let mut picture = image::open(case.path(&made)).unwrap().to_rgb8();
            for (at, v) in picture.iter_mut().enumerate() {
                let noise = (at * 7919 % 17) as f64 - 8.0;
                *v = level((f64::from(*v) + noise).clamp(0.0, 255.0)).round() as u8;
            }
            let to = case.path(&format!("{to}/{id}.png"));
            std::fs::create_dir_all(to.parent().unwrap_or(Path::new("."))).unwrap();
            picture.save(to).unwrap();
        }
    };
    let stored = |to: &str, from: &dyn Fn(usize) -> usize, level: &dyn Fn(f64) -> f64| {
        store(to, "t", from, level);
        run(&format!("imported:dir={to}"), &format!("r-{to}"))
    };
    let (own, same) = (|k: usize| k, |v: f64| v);
    let levels: [(&str, &dyn Fn(f64) -> f64); 2] =
        [("as-made", &same), ("pale", &|v| 0.8 * v + 30.0)];
    let poor = ["m", "c", "d"].map(|of| {
        levels.map(|(name, level)| {
            let to = format!("{of}-{name}");
            store(&to, of, &own, level);
            format!("imported:label={to},dir={to}")
        })
    });
    let said = run(&poor.concat().join(" --method "), "r-poor");
    assert!(!said.err.contains("look as if"), "{}", said.err);
    let said = vec![
        stored("before", &|k| k + n - 1, &same),
        stored("after", &|k| k + 1, &same),
        stored("shuffled", &|k| 11 * k + 2, &same),
        stored("halved", &own, &|v| (v + 255.0) / 2.0),
        stored("clipped", &own, &|v| 2.0 * v - 255.0),
        stored("limited", &own, &|v| 16.0 + v * 219.0 / 255.0),
    ];
    let all = case.having(said);
    let told = "\
before | the target of the pair before theirs
after | the target of the pair after theirs
shuffled | the target of another pair
halved | have half their contrast
clipped | have their darker half cut off
limited | have the limited range of video";
    for [name, part] in rows(told) {
        all.is_said_everywhere(&format!("r-{name}"), part);
    }
}

/// Pictures rendered with translations of another sign or unit, and poor pictures without such a mistake.
#[test]
fn pictures_of_another_motion_are_told_and_poor_ones_are_not() {
    // A textured plane whose inverse depth is `plane` times a ray (z = 1), seen from (x, 0, 0).
    let texture = |x: f64, y: f64| {
        let level = |x: f64, y: f64| {
            let hash = (x as i64 * 7919 + y as i64 * 104_729) as u32;
            let hash = (hash ^ (hash >> 15)).wrapping_mul(2_246_822_519);
            f64::from((hash ^ (hash >> 13)) >> 8 & 255)
        };
        let (left, top) = (x.floor(), y.floor());
        let row = |y: f64| level(left, y) + (x - left) * (level(left + 1.0, y) - level(left, y));
        row(top) + (y - top) * (row(top + 1.0) - row(top))
    };
    let view = |at: f64, plane: [f64; 3]| {
        RgbImage::from_fn(160, 120, |x, y| {
            let [x, y] = [(f64::from(x) - 79.5) / 150.0, (f64::from(y) - 59.5) / 150.0];
            let depth = (1.0 - plane[0] * at) / (plane[0] * x + plane[1] * y + plane[2]);
            image::Rgb([texture(12.0 * (x * depth + at), 12.0 * y * depth) as u8; 3])
        })
    };
    let case = empty();
    let plane = [0.12, 0.25, 0.4];
    let place = |name: &str| name[5..].parse::<f64>().unwrap() * 0.1;
    std::fs::create_dir(case.path("ns")).unwrap();
    let frame = |k: usize| {
        let name = format!("view_{k}.png");
        view(place(&name[..6]), plane)
            .save(case.path(&format!("ns/{name}")))
            .unwrap();
        let pose = [
            [1.0, 0.0, 0.0, 0.1 * k as f64],
            [0.0, 1.0, 0.0, 0.0],
            [0.0, 0.0, 1.0, 0.0],
            [0.0, 0.0, 0.0, 1.0],
        ];
        serde_json::json!({"file_path": name, "transform_matrix": pose})
    };
    let frames: Vec<_> = (0..4).map(frame).collect();
    let transforms = serde_json::json!({
        "fl_x": 150.0, "fl_y": 150.0, "cx": 80.0, "cy": 60.0, "w": 160, "h": 120, "frames": frames,
    });
    std::fs::write(case.path("ns/transforms.json"), transforms.to_string()).unwrap();
    let run = |method: &str, out: &str| {
        case.run(&format!(
            "sharp-bench run -q --dataset nerfstudio=ns --pair-options missing-depth=accept --method {method} \
             --metrics psnr --out {out}"
        ))
        .ends_with(0)
    };
    run("copy", "made");
    let stored = |to: &str, shown: &dyn Fn(f64, f64) -> RgbImage| {
        let rows = csv::Reader::from_path(case.path("made/scores.csv"));
        for row in rows.unwrap().records().map(Result::unwrap) {
            let (_, views) = row[0].rsplit_once('/').unwrap();
            let (source, target) = views.split_once("__").unwrap();
            let to = case.path(&format!("{to}/{}.png", &row[0]));
            std::fs::create_dir_all(to.parent().unwrap()).unwrap();
            shown(place(source), place(target)).save(to).unwrap();
        }
        run(&format!("imported:dir={to}"), &format!("r-{to}"))
    };
    let moved = |factor: f64| move |from: f64, to: f64| view(from + factor * (to - from), plane);
    // A crop of four fifths, resized back.
    let cropped = |_, to: f64| {
        let part = image::imageops::crop_imm(&view(to, plane), 16, 12, 128, 96).to_image();
        image::imageops::resize(&part, 160, 120, image::imageops::FilterType::CatmullRom)
    };
    let said = vec![
        stored("sign", &moved(-1.0)),
        stored("half", &moved(0.5)),
        stored("cropped", &cropped),
    ];
    for (name, proper) in [
        ("right", &moved(1.0) as &dyn Fn(f64, f64) -> RgbImage),
        ("near", &moved(0.8)),
        ("copies", &moved(0.0)),
        ("blurred", &|_, to| {
            image::imageops::fast_blur(&view(to, plane), 3.0)
        }),
        ("steeper", &|from, to| view(to, [0.0, 0.4 + from, 0.4])),
    ] {
        let said = stored(name, proper);
        assert!(
            !said.err.contains("its pictures move") && !said.err.contains("its pictures show"),
            "{name}: {}",
            said.err
        );
    }
    let all = case.having(said);
    all.is_said_everywhere("r-sign", "move by -1.00 times the target's motion");
    all.is_said_everywhere("r-half", "move by 0.50 times the target's motion");
    all.is_said_everywhere("r-cropped", "with 1.25 times its focal length");
}

#[test]
fn values_of_14_bits_are_told_from_dark_pictures() {
    let case = empty();
    let check = |name: &str, level: &dyn Fn(u32, u32) -> u16| {
        std::fs::create_dir(case.path(name)).unwrap();
        let frames = (0..3).map(|k| {
            let file = format!("{k}.png");
            let picture =
                image::ImageBuffer::from_fn(32, 24, |x, y| image::Rgb([level(x + k, y); 3]));
            picture.save(case.path(&format!("{name}/{file}"))).unwrap();
            let pose = [[1, 0, 0, k], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]];
            serde_json::json!({"file_path": file, "transform_matrix": pose})
        });
        let transforms = serde_json::json!({
            "fl_x": 30.0, "fl_y": 30.0, "cx": 16.0, "cy": 12.0, "w": 32, "h": 24, "frames": frames.collect::<Vec<_>>(),
        });
        std::fs::write(
            case.path(&format!("{name}/transforms.json")),
            transforms.to_string(),
        )
        .unwrap();
        let said = case.run(&format!("sharp-bench datasets check nerfstudio={name}"));
        both(&said).contains("perhaps because 14-bit values were stored unscaled")
    };
    let unscaled = |x: u32, y: u32| (x * 397 + y * 101) as u16;
    assert!(check("unscaled", &unscaled));
    // A single bright pixel, like a lamp at night, shows that values are not unscaled.
    assert!(!check("night", &|x, y| if (x, y) == (9, 9) {
        48_000
    } else {
        unscaled(x, y)
    }));
    assert!(!check("bright", &|x, y| 4 * unscaled(x, y)));
}

#[test]
fn metrics_names_predictions_equal_to_their_targets_and_the_share_inside_masks() {
    let case = untried("X72-metrics-nested");
    let json = |line: &str| case.run(line).ends_with(0).json();
    let same = json("sharp-bench metrics t t --metrics psnr --json");
    holds(
        &same["warnings"].to_string(),
        &["all 4 predictions have exactly the pixels"],
    );
    for (line, name) in [
        ("sharp-bench metrics p t", "p"),
        ("sharp-bench metrics t/a/0.png t/a/0.png", "t"),
    ] {
        let said = json(&format!("{line} --metrics psnr --json"));
        assert!(
            !said["warnings"].to_string().contains("exactly the pixels"),
            "{name}"
        );
    }
    let target = image::open(case.path("t/a/0.png")).unwrap();
    let mask = image::GrayImage::from_fn(target.width(), target.height(), |x, _| {
        image::Luma([if x < target.width() / 4 { 255 } else { 0 }])
    });
    mask.save(case.path("mask.png")).unwrap();
    let line = "sharp-bench metrics p/a/0.png t/a/0.png --metrics psnr --mask mask.png";
    let share = json(&format!("{line} --json"))["pairs"][0]["mask_share"]
        .as_f64()
        .unwrap();
    let printed = format!(
        "mask: {:.1} % of the pixels count under @mask",
        100.0 * share
    );
    holds(&case.run(line).ends_with(0).out, &[&printed]);
    assert!((share - 0.25).abs() < 0.02, "{share}");
}
