//! External pictures to be scored.

use exr::prelude::write_rgb_file;
use image::{ImageFormat, Rgb, RgbImage};
use sharp_tests::mutants::Random;
use sharp_tests::words;

use super::case::{Case, Verdict};
use super::oracle::{Known, judge_run, pixels, psnr, rows, same};
use super::spoil;

/// Random pixels of random size.
fn picture(random: &mut Random, (width, height): (u32, u32)) -> RgbImage {
    RgbImage::from_fn(width, height, |_, _| {
        Rgb([0; 3].map(|_: u8| random.below(256) as u8))
    })
}

/// `[H, W, 3]` as `.npy`, version 1.
fn npy(image: &RgbImage) -> Vec<u8> {
    let (width, height) = image.dimensions();
    let header =
        format!("{{'descr': '<f4', 'fortran_order': False, 'shape': ({height}, {width}, 3), }}");
    let mut out = b"\x93NUMPY\x01\x00\x76\x00".to_vec();
    out.extend(format!("{header:<117}\n").as_bytes());
    out.extend(floats(image));
    out
}

fn floats(image: &RgbImage) -> Vec<u8> {
    image
        .iter()
        .flat_map(|v| (f32::from(*v) / 255.0).to_le_bytes())
        .collect()
}

/// Writes a picture; formats with floats get multiples of 1/255, so that rounding gives the same
/// bytes again.
fn put(case: &Case, name: &str, image: &RgbImage) {
    let extension = name.rsplit('.').next().unwrap();
    let (width, height) = image.dimensions();
    match extension {
        "npy" => case.write(name, npy(image)),
        "safetensors" => {
            let bytes = floats(image);
            let shape = vec![height as usize, width as usize, 3];
            let view = safetensors::tensor::TensorView::new(safetensors::Dtype::F32, shape, &bytes)
                .unwrap();
            case.write(
                name,
                safetensors::serialize([("image", view)], None).unwrap(),
            );
        }
        "exr" => {
            case.write(name, "");
            write_rgb_file(case.path(name), width as usize, height as usize, |x, y| {
                let [r, g, b] = image
                    .get_pixel(x as u32, y as u32)
                    .0
                    .map(|v| f32::from(v) / 255.0);
                (r, g, b)
            })
            .unwrap();
        }
        _ => {
            case.write(name, "");
            let format = if extension == "png" {
                ImageFormat::Png
            } else {
                ImageFormat::Jpeg
            };
            image.save_with_format(case.path(name), format).unwrap();
        }
    }
}

const FORMS: [&str; 5] = ["png", "jpg", "npy", "safetensors", "exr"];

/// The possible score of a damaged picture, if it has 8 bits. For floats it is only known that
/// equal bytes give equal scores.
fn known(case: &Case, name: &str, before: &[u8], image: &RgbImage, target: &RgbImage) -> Known {
    let path = case.path(name);
    if std::fs::read(&path).is_ok_and(|bytes| bytes == before) {
        return psnr(image, target).map_or(Known::Nothing, Known::Number);
    }
    match (
        name.ends_with("png") || name.ends_with("jpg"),
        pixels(&path),
    ) {
        (false, _) => Known::Nothing,
        (true, None) => Known::Impossible("the picture cannot be decoded"),
        (true, Some(found)) => match psnr(&found, target) {
            Some(number) => Known::Number(number),
            None => Known::Impossible("the sizes differ"),
        },
    }
}

pub(crate) fn metrics(case: &mut Case) -> Result<Verdict, String> {
    let size = (
        12 + case.random.below(20) as u32,
        12 + case.random.below(20) as u32,
    );
    let (mut image, target) = (
        picture(&mut case.random, size),
        picture(&mut case.random, size),
    );
    let name = format!("a.{}", case.random.pick(&FORMS));
    put(case, &name, &image);
    if name.ends_with("jpg") {
        image = pixels(&case.path(&name)).unwrap();
    }
    put(case, "b.png", &target);
    case.write("mask.png", "");
    let half = image::GrayImage::from_fn(size.0, size.1, |x, _| {
        image::Luma([if x < 6 { 255 } else { 0 }])
    });
    half.save(case.path("mask.png")).unwrap();
    let before = std::fs::read(case.path(&name)).unwrap();
    let spoilt = if case.random.below(4) == 0 {
        "mask.png"
    } else {
        &name
    };
    let harmless = spoil::file(case, spoilt, spoil::binary);
    let line = format!("metrics {name} b.png --metrics psnr --json --csv s.csv");
    let mut args = words(&line);
    if spoilt == "mask.png" {
        args.extend(["--mask", "mask.png"]);
    }
    let said = case.run(&args)?;
    if said.code != 0 {
        return if harmless {
            Err(format!("refused an undamaged picture: {}", said.err))
        } else {
            Ok(Verdict::Error)
        };
    }
    let rows = rows(&case.path("s.csv"))?;
    match known(case, &name, &before, &image, &target) {
        Known::Number(expected) if same(&rows[0]["psnr"], expected) => Ok(Verdict::Number),
        // Floats are scored unchanged; rounding to f32 changes a level of 255 by at most 3e-8.
        Known::Number(expected) if !name.ends_with('g') => {
            let found: f64 = rows[0]["psnr"].parse().unwrap();
            if (found - expected).abs() < 1e-5 {
                Ok(Verdict::Number)
            } else {
                Err(format!("{found} instead of {expected}"))
            }
        }
        Known::Number(expected) => Err(format!("{} instead of {expected}", rows[0]["psnr"])),
        Known::Impossible(why) => Err(format!("{why}, and yet a score: {}", said.out)),
        Known::Nothing => {
            let found: f64 = rows[0]["psnr"]
                .parse()
                .map_err(|_| "no number".to_owned())?;
            if found.is_nan() {
                Err("nan".to_owned())
            } else {
                Ok(Verdict::Number)
            }
        }
    }
}

/// The four pairs of the procedural scene that have predictions.
const RUN: &str =
    "run --dataset S:synthetic=size=32x24,views=4 --metrics psnr --no-cache --limit 4";

pub(crate) fn predictions(case: &mut Case) -> Result<Verdict, String> {
    let truth = case.run(&[&words(RUN)[..], &["--method", "target", "--out", "t"]].concat())?;
    if truth.code != 0 {
        return Err(truth.err);
    }
    let ids: Vec<String> = rows(&case.path("t/scores.csv"))?
        .iter()
        .map(|row| row["pair_id"].clone())
        .collect();
    let form = *case.random.pick(&["png", "jpg", "exr"]);
    let crops = case.random.below(3) == 0;
    let mut made = Vec::new();
    for id in &ids {
        let target = pixels(&case.path(&format!("t/predictions/target/{id}.png"))).unwrap();
        let (x, y) = if crops {
            (case.random.below(8) as u32, case.random.below(8) as u32)
        } else {
            (0, 0)
        };
        let target = image::imageops::crop_imm(&target, x, y, 32 - x, 24 - y).to_image();
        let image = picture(&mut case.random, target.dimensions());
        let name = format!("mine/{id}.{form}");
        put(case, &name, &image);
        let image = if form == "jpg" {
            pixels(&case.path(&name)).unwrap()
        } else {
            image
        };
        case.write(
            &format!("mine/{id}.json"),
            format!("{{\"crop\": [{x}, {y}, {}, {}]}}", 32 - x, 24 - y),
        );
        let before = std::fs::read(case.path(&name)).unwrap();
        made.push((id.clone(), name, before, image, target));
    }
    let which = case.random.below(ids.len());
    let sidecar = crops && case.random.below(2) == 0;
    if sidecar {
        spoil::file(case, &format!("mine/{}.json", ids[which]), spoil::text);
    } else {
        spoil::file(case, &made[which].1.clone(), spoil::binary);
    }
    // Pairs without a picture fail for a reason that names the folder.
    case.may_name("mine");
    let method = if crops {
        "imported:dir=mine,crop=sidecar"
    } else {
        "imported:dir=mine"
    };
    let said = case.run(&[&words(RUN)[..], &["--method", method, "--out", "r"]].concat())?;
    judge_run(case, &said, "r", &|row| {
        let (id, name, before, image, target) =
            made.iter().find(|made| made.0 == row["pair_id"]).unwrap();
        // A damaged crop may still be valid.
        if sidecar && *id == ids[which] {
            return Known::Nothing;
        }
        known(case, name, before, image, target)
    })
}
