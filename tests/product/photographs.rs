//! `predict` on photographs of every kind, and on files that are not photographs.

use std::path::{Path, PathBuf};

use image::DynamicImage;

use crate::support::{Said, sharp_bench as run};
use crate::tiny::{golden, recorded_input, tiny};

fn predict(dir: &Path, args: &[&str]) -> Said {
    let tiny = tiny();
    let model: Vec<&str> = tiny.iter().map(String::as_str).collect();
    run(dir, &[&["predict"], args, &model].concat())
}

#[test]
fn every_kind_of_photograph_is_accepted_several_at_once() {
    let dir = tempfile::tempdir().unwrap();
    let folder = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../tests/golden/photographs");
    let names = [
        "grey.png",
        "grey_alpha.png",
        "rgba.png",
        "palette.png",
        "grey16.png",
        "cmyk.jpg",
    ];
    let files = names.map(|name| folder.join(name).display().to_string());
    let mut args: Vec<&str> = files.iter().map(String::as_str).collect();
    args.extend(["--out", "all", "--json"]);
    let said = predict(dir.path(), &args).ends_with(0);
    let json = said.json();
    let results = json.as_array().unwrap();
    assert_eq!(results.len(), names.len());
    for (result, name) in results.iter().zip(names) {
        assert!(result["image"].as_str().unwrap().ends_with(name));
        assert!(dir.path().join(result["ply"].as_str().unwrap()).is_file());
        assert!(result["seconds"].as_f64().unwrap() > 0.0);
        // None of them states its focal length, which is reported for each.
        let warned = |line: &str| line.contains(name) && line.contains("30 mm");
        assert!(said.err.lines().any(warned), "{name}: {}", said.err);
    }
    // Two photographs with the same name would be written to the same file.
    args[1] = args[0];
    predict(dir.path(), &args).is_error_with(&["grey.ply", "same name"]);
    args.truncate(2);
    args.extend(["--out", "one.ply"]);
    predict(dir.path(), &args).is_error_with(&["one.ply", "folder"]);
}

#[test]
fn what_is_no_photograph_is_one_line() {
    let dir = tempfile::tempdir().unwrap();
    let file = |name: &str| dir.path().join(name);
    std::fs::write(file("note.jpg"), b"hello").unwrap();
    std::fs::write(file("cut.png"), b"\x89PNG\r\n\x1a\n\0\0\0\rIHDR").unwrap();
    // A decoder alone would accept this as a picture with a grey lower half.
    image::RgbImage::new(64, 64).save(file("cut.jpg")).unwrap();
    let jpeg = std::fs::read(file("cut.jpg")).unwrap();
    std::fs::write(file("cut.jpg"), &jpeg[..jpeg.len() - 20]).unwrap();
    image::RgbImage::new(1, 1).save(file("dot.png")).unwrap();
    image::RgbImage::new(1, 9).save(file("line.png")).unwrap();
    image::RgbImage::new(9, 9).save(file("nine.png")).unwrap();
    exr::prelude::write_rgb_file(file("nan.exr"), 4, 4, |_, _| (f32::NAN, 0.5_f32, 0.5_f32))
        .unwrap();
    let mut npy = b"\x93NUMPY\x01\0\x46\0".to_vec();
    let header = "{'descr': '<f4', 'fortran_order': False, 'shape': (4, 4, 3), }";
    npy.extend(format!("{header:<69}\n").into_bytes());
    npy.extend(f32::NAN.to_le_bytes().repeat(48));
    std::fs::write(file("nan.npy"), npy).unwrap();
    for (name, reason, more) in [
        ("note.jpg", "not an image", &[][..]),
        ("cut.png", "not an image", &[]),
        ("cut.jpg", "truncated", &[]),
        ("absent.png", "No such file", &[]),
        ("dot.png", "1x1", &[]),
        ("line.png", "at least 2x2", &[]),
        ("nine.png", "more than 80 pixels", &["--max-pixels", "80"]),
        ("nine.png", "focal length", &["--focal-px", "0"]),
        ("nine.png", "focal length", &["--focal-px", "NaN"]),
        ("nan.exr", "OpenEXR", &[]),
        ("nan.npy", "NumPy", &[]),
        (".", "a folder", &[]),
    ] {
        let args = [&[name, "--out", "p.ply"][..], more].concat();
        predict(dir.path(), &args).is_error_with(&[name, reason]);
        assert!(!file("p.ply").exists(), "{name}");
    }
    let limit = ["nine.png", "--out", "p.ply", "--max-pixels", "81"];
    predict(dir.path(), &limit).ends_with(0);
}

#[test]
fn time_memory_and_focal_length_are_printed() {
    let dir = tempfile::tempdir().unwrap();
    let (image, focal) = recorded_input();
    let said = predict(
        dir.path(),
        &[&image, "--focal-px", &focal, "--out", "p.ply"],
    )
    .ends_with(0);
    for part in ["p.ply", "18432 Gaussians", "500.00 px (given)", " s"] {
        assert!(said.out.contains(part), "{part}: {}", said.out);
    }
    assert!(!said.err.contains("30 mm"), "{}", said.err);
    if cfg!(target_os = "linux") {
        assert!(said.out.contains("peak memory"), "{}", said.out);
    }
    // The parts are printed one by one, because there is no terminal for a progress bar.
    for part in ["patch encoder", "depth decoder", "Gaussian decoder"] {
        assert!(said.err.contains(part), "{part}: {}", said.err);
    }
}

/// The numbers of a PLY file in the release's form, one row per Gaussian, and the bytes before and
/// after them.
fn ply(bytes: &[u8]) -> (&[u8], Vec<[f32; 14]>, &[u8]) {
    let end = b"end_header\n";
    let at = bytes.windows(end.len()).position(|w| w == end).unwrap() + end.len();
    let header = std::str::from_utf8(&bytes[..at]).unwrap();
    let count = header
        .lines()
        .find_map(|line| line.strip_prefix("element vertex "));
    let count: usize = count.unwrap().parse().unwrap();
    let rows = bytes[at..at + count * 56].chunks_exact(56).map(|row| {
        let number = |k: usize| f32::from_le_bytes(row[4 * k..4 * k + 4].try_into().unwrap());
        std::array::from_fn(number)
    });
    (&bytes[..at], rows.collect(), &bytes[at + count * 56..])
}

#[test]
fn the_file_is_the_official_writers() {
    let dir = tempfile::tempdir().unwrap();
    let (image, focal) = recorded_input();
    let args = [&image, "--focal-px", &focal, "--exact", "--out", "p.ply"];
    predict(dir.path(), &args).ends_with(0);
    let ours = std::fs::read(dir.path().join("p.ply")).unwrap();
    let theirs = std::fs::read(golden("tiny_golden.ply")).unwrap();
    let ((our_head, our_rows, our_tail), (head, rows, tail)) = (ply(&ours), ply(&theirs));
    assert_eq!(our_head, head);
    assert_eq!(our_rows.len(), rows.len());
    // Compare positions, colours, opacities and scales. Rotations are compared only through covariances.
    for column in 0..10 {
        let largest = rows.iter().map(|row| row[column].abs()).fold(0.0, f32::max);
        for (a, b) in our_rows.iter().zip(&rows) {
            // A small axis of an f32 covariance is known only up to the rounding of the large one.
            let condition = match column {
                7..10 => f32::exp(2.0 * (b[7] - b[column])),
                _ => 0.0,
            };
            let allowed = 5e-6 * largest + 4.0 * f32::EPSILON * condition;
            let off = (a[column] - b[column]).abs();
            assert!(off <= allowed, "column {column}: {off:e}");
        }
    }
    // Camera, size, frame, quantiles of disparity, colour space and version are compared as bytes,
    // except for the rounding of two quantiles.
    assert_eq!(our_tail.len(), tail.len());
    let quantiles = tail.len() - 4 - 8;
    for (at, (a, b)) in our_tail.iter().zip(tail).enumerate() {
        assert!(
            a == b || (quantiles..quantiles + 8).contains(&at),
            "byte {at}"
        );
    }
}

#[test]
fn depth_is_metres_in_floats_and_millimetres_in_sixteen_bits() {
    let dir = tempfile::tempdir().unwrap();
    let (image, _) = recorded_input();
    let png = [&image, "--out", "p.ply", "--depth", "png16", "--json"];
    let json = predict(dir.path(), &png).ends_with(0).json();
    assert_eq!(json[0]["depth"].as_array().unwrap().len(), 2);
    predict(dir.path(), &[&image, "--out", "p.ply", "--depth", "exr"]).ends_with(0);
    let exr = exr::prelude::read_all_flat_layers_from_file(dir.path().join("p.depth.exr")).unwrap();
    let channels = &exr.layer_data[0].channel_data.list;
    let names: Vec<String> = channels.iter().map(|c| c.name.to_string()).collect();
    assert_eq!(names, ["layer0.Z", "layer1.Z"]);
    for (k, channel) in channels.iter().enumerate() {
        let file = dir.path().join(format!("p.depth{k}.png"));
        let DynamicImage::ImageLuma16(millimetres) = image::open(file).unwrap() else {
            panic!("16-bit grey");
        };
        assert_eq!(millimetres.dimensions(), (192, 192));
        let metres = channel.sample_data.values_as_f32();
        for (mm, metres) in millimetres.as_raw().iter().zip(metres) {
            let expected = (metres * 1000.0).round().min(65535.0);
            assert_eq!(f32::from(*mm), expected);
        }
    }
}
