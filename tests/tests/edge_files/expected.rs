//! The files with an entry in `EXPECTED.json`.

use libtest_mimic::Trial;
use serde_json::Value;
use sharp::image_file::{AlphaRule, ColorRule, OrientationRule, PictureRules};
use sharp_datasets::files::parse;
use sharp_datasets::format::{FloatMap, npy, picture, raw_floats, read_map};

use crate::{Outcome, check, equal, fixture, folder, refused};

/// The reasons why broken files are refused.
const REASONS: [(&str, &str); 9] = [
    ("bad_crc.png", "CRC"),
    ("empty.pfm", "empty"),
    ("html_error.jpg", "HTML"),
    ("huge_dims.pfm", "truncated"),
    ("lfs_pointer.png", "LFS pointer"),
    ("object_pickle.npy", "unpickled"),
    ("truncated.pfm", "truncated"),
    ("truncated.png", "truncated"),
    ("zero_bytes.png", "empty"),
];

pub(crate) fn trials() -> Vec<Trial> {
    let text = std::fs::read_to_string(folder().join("EXPECTED.json")).unwrap();
    let expected: Value = serde_json::from_str(&text).unwrap();
    let entries = expected.as_object().unwrap().clone();
    entries
        .into_iter()
        .map(|(name, entry)| Trial::test(name.clone(), move || one(&name, &entry)))
        .collect()
}

const SIZE: (u32, u32) = (80, 60);
const DROP: PictureRules = PictureRules {
    alpha: AlphaRule::Drop,
    color: ColorRule::Convert,
    orientation: OrientationRule::Auto,
};

fn one(name: &str, entry: &Value) -> Outcome {
    let path = fixture(name);
    if entry.get("error").is_some() {
        let reason = REASONS.iter().find(|r| r.0 == name).ok_or("no reason")?.1;
        return if name.ends_with(".pfm") || name.ends_with(".npy") {
            refused(read_map(&path), name, reason)
        } else {
            refused(picture::read(&path, &DROP, Some(SIZE)), name, reason)
        };
    }
    if entry.get("bytes").is_some() {
        return raw(name);
    }
    if name == "gray16_depth_mm.png" {
        return sixteen_bits(name, entry);
    }
    if entry.get("format").is_some() {
        return photograph(name, entry);
    }
    if name.ends_with(".npy") || name.ends_with(".npz") {
        let array = npy::parse(&std::fs::read(&path)?)?;
        let shape: Vec<u64> = array.shape.iter().map(|n| *n as u64).collect();
        equal(&entry["shape"], &serde_json::json!(shape))?;
    }
    values(&read_map(&path)?, entry)
}

/// Compares first, last, count and sum of the finite values, exactly except for the sum's rounding.
fn values(map: &FloatMap, entry: &Value) -> Outcome {
    equal(&map.dimensions(), &(80, 60))?;
    let same = |value: f32, key: &str| {
        let value = f64::from(value);
        let holds = match entry[key].as_f64() {
            Some(number) => number == value,
            None => entry[key] == "nan" && value.is_nan(),
        };
        check(holds, || {
            format!("{key}: {value} instead of {}", entry[key])
        })
    };
    same(map.get_pixel(0, 0).0[0], "first")?;
    same(map.get_pixel(79, 59).0[0], "last")?;
    let finite: Vec<f64> = map
        .iter()
        .filter(|v| v.is_finite())
        .map(|v| f64::from(*v))
        .collect();
    check(entry["finite"] == finite.len(), || {
        format!("{} finite", finite.len())
    })?;
    let (sum, expected) = (
        finite.iter().sum::<f64>(),
        entry["sum_finite"].as_f64().unwrap(),
    );
    check((sum - expected).abs() <= 1e-12 * expected.abs(), || {
        format!("{sum}")
    })
}

fn sixteen_bits(name: &str, entry: &Value) -> Outcome {
    let map = read_map(&fixture(name))?;
    equal(&map.dimensions(), &(80, 60))?;
    let first = f64::from(map.get_pixel(0, 0).0[0]);
    equal(&entry["first_px"][0], &(first as u64))?;
    let mean = map.iter().map(|v| f64::from(*v)).sum::<f64>() / 4800.0;
    check(
        (mean - entry["mean"].as_f64().unwrap()).abs() < 1e-9,
        || format!("{mean}"),
    )?;
    // No photograph has such values.
    let picture = picture::read(&fixture(name), &DROP, Some(SIZE));
    refused(picture, name, "12-bit values had been stored unscaled")
}

/// Lossless files must agree exactly; JPEG to 2 levels, and its mean to 0.5, because decoders
/// differ.
fn photograph(name: &str, entry: &Value) -> Outcome {
    let image = picture::read(&fixture(name), &DROP, Some(SIZE))?;
    let lossy = entry["format"] == "JPEG";
    let (levels, mean_tolerance) = if lossy { (2, 0.5) } else { (0, 1e-9) };
    equal(&image.dimensions(), &(80, 60))?;
    check(picture::dimensions(&fixture(name))? == (80, 60), || {
        "header".into()
    })?;
    let first = image.get_pixel(0, 0).0;
    for (found, expected) in first.iter().zip(entry["first_px"].as_array().unwrap()) {
        let difference = i64::from(*found) - expected.as_i64().unwrap();
        check(difference.abs() <= levels, || format!("{first:?}"))?;
    }
    let mean = image.iter().map(|v| f64::from(*v)).sum::<f64>() / (3.0 * 4800.0);
    let expected = entry["mean"].as_f64().unwrap();
    check((mean - expected).abs() <= mean_tolerance, || {
        format!("mean {mean}, {expected}")
    })
}

/// ETH3D's depth named like a photograph: if no pixel has depth, this is not an error, but a wrong
/// file length is.
fn raw(name: &str) -> Outcome {
    let found = parse(&fixture(name), |bytes| raw_floats::parse(bytes, (6, 4)));
    if name.contains("wrong_size") {
        return refused(
            found,
            name,
            "has 92 bytes, but the depth of a 6x4 picture takes exactly 96",
        );
    }
    check(found?.iter().all(|v| *v == f32::INFINITY), || {
        "not all infinite".into()
    })
}
