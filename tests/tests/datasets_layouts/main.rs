//! Writes the procedural scene in the layout of every dataset and reads it back: cameras agree to
//! 1e-9, pictures byte for byte, depth to the precision of the layout's files, and scores exactly.

#![allow(clippy::unwrap_used, reason = "test code outside of #[test] functions")]

#[cfg(test)]
mod choices;
#[cfg(test)]
mod incomplete;
#[cfg(test)]
mod multi_view;
#[cfg(test)]
mod processing;
#[cfg(test)]
mod remedies;
#[cfg(test)]
mod small;
#[cfg(test)]
mod stereo;
#[cfg(test)]
mod tanks;
#[cfg(test)]
mod too_large;
#[cfg(test)]
mod write;

use std::path::Path;

use sharp_datasets::check::advice::Units;
use sharp_datasets::check::contradictions;
use sharp_datasets::found_scenes::by_reason;
use sharp_datasets::lens::{Distortion, Lens};
use sharp_datasets::synthetic::{SyntheticOptions, SyntheticScene};
use sharp_datasets::{DatasetSpec, DepthMap, Pairing, Scene, View, open, open_each};
use sharp_metrics::{Picture, Scorer, Selection, Weights};

/// Required agreement of depth.
#[derive(Clone, Copy)]
enum Depth {
    /// Stored as f32 metres.
    Exact,
    /// Stored in millimetres: within half a millimetre, plus rounding.
    Millimetres,
    /// Not written.
    Absent,
}

fn scene() -> SyntheticScene {
    SyntheticScene::new(SyntheticOptions {
        seed: 11,
        width: 96,
        height: 72,
        views: 5,
        ..SyntheticOptions::default()
    })
    .unwrap()
}

fn spec(spec: &str, folder: &Path) -> DatasetSpec {
    let (format, settings) = spec.split_once(',').unwrap_or((spec, ""));
    let comma = if settings.is_empty() { "" } else { "," };
    let text = format!("{format}={}{comma}{settings}", folder.display());
    DatasetSpec::parse(&text).unwrap()
}

fn read(text: &str, folder: &Path) -> Scene {
    let mut scenes = open_each(&spec(text, folder)).unwrap().scenes;
    assert_eq!(scenes.len(), 1);
    // Proper files cause no warnings.
    assert!(scenes[0].warnings.is_empty(), "{:?}", scenes[0].warnings);
    scenes.remove(0)
}

/// One line for each reason why scenes are left out: first broken scenes, then scenes excluded by
/// settings.
fn left_out(text: &str, folder: &Path) -> [Vec<String>; 2] {
    let found = open_each(&spec(text, folder)).unwrap();
    let groups = by_reason(&found.left_out);
    [false, true].map(|by_choice| {
        let of_kind = groups.iter().filter(|group| group.by_choice == by_choice);
        of_kind.map(ToString::to_string).collect()
    })
}

/// The error for a folder that cannot be read.
fn refusal(text: &str, folder: &Path) -> String {
    open(&spec(text, folder)).unwrap_err().to_string()
}

/// Compares cameras, pictures and depth as read with those written.
fn compare(found: &[View], written: &[View], depth: Depth) {
    assert_eq!(found.len(), written.len());
    for (a, b) in found.iter().zip(written) {
        compare_cameras(a, b);
        assert_eq!(
            a.content.image().unwrap(),
            b.content.image().unwrap(),
            "{}",
            a.id
        );
        let (found, truth) = (a.content.depth().unwrap(), b.content.depth().unwrap());
        match depth {
            Depth::Absent => assert!(found.is_none()),
            _ => compare_depth(&found.unwrap(), &truth.unwrap(), depth),
        }
    }
    assert_eq!(scores(found), scores(written));
    let pairing = match found.len() {
        2 => Pairing::Stereo {
            source: 0,
            target: 1,
        },
        _ => Pairing::MultiView,
    };
    let scene = Scene::new("d", "s", found.to_vec(), pairing);
    let nothing: Vec<String> = Vec::new();
    assert_eq!(contradictions(&scene, Units::default()), nothing);
}

/// Scores, as bits, of every view predicted by a copy of the view before it.
fn scores(views: &[View]) -> Vec<Vec<u64>> {
    let selection = Selection::parse("psnr,ssim-all").unwrap();
    let scorer = Scorer::new(&selection, &Weights::none()).unwrap();
    let pictures: Vec<Picture> = views
        .iter()
        .map(|view| view.content.image().unwrap().into())
        .collect();
    let bits = |pair: &[Picture]| {
        let scores = scorer.score(&pair[0], &pair[1], None).unwrap();
        let values = scores
            .into_iter()
            .map(|(_, value)| value.unwrap().to_bits());
        values.collect()
    };
    pictures.windows(2).map(bits).collect()
}

fn compare_cameras(a: &View, b: &View) {
    let (k, l) = (a.intrinsics, b.intrinsics);
    assert_eq!((k.width, k.height), (l.width, l.height));
    let pairs = [(k.fx, l.fx), (k.fy, l.fy), (k.cx, l.cx), (k.cy, l.cy)];
    let poses = a
        .camera_from_world
        .to_row_major()
        .into_iter()
        .zip(b.camera_from_world.to_row_major());
    for (x, y) in pairs.into_iter().chain(poses) {
        assert!((x - y).abs() <= 1e-9, "{}: {x} instead of {y}", a.id);
    }
}

fn compare_depth(found: &DepthMap, truth: &DepthMap, depth: Depth) {
    assert_eq!(found.dimensions(), truth.dimensions());
    for (x, y, z) in truth.enumerate_pixels() {
        let (z, w) = (f64::from(z.0[0]), f64::from(found.get_pixel(x, y).0[0]));
        let tolerance = match depth {
            Depth::Millimetres => 0.5e-3 + 1e-6 * z,
            Depth::Exact | Depth::Absent => 0.0,
        };
        assert!((z - w).abs() <= tolerance, "({x}, {y}): {w} instead of {z}");
    }
}

/// A fisheye like ScanNet++'s, at the scene's size.
fn fisheye() -> Lens {
    let distortion = Distortion::OpenCvFisheye {
        k: [-0.0295, -0.0076, -0.00093, 0.00031],
    };
    Lens::new((62.0, 62.2), (48.3, 35.8), (96, 72), distortion).unwrap()
}

/// PSNR, for comparing a resampled picture of a lens with the pinhole picture.
fn psnr(a: &image::RgbImage, b: &image::RgbImage) -> f64 {
    let sum: f64 = a
        .iter()
        .zip(b.iter())
        .map(|(p, q)| (f64::from(*p) - f64::from(*q)).powi(2))
        .sum();
    10.0 * (255.0 * 255.0 * a.len() as f64 / sum).log10()
}

/// Share of the pixels with depth in both maps whose depth occurs in the other map at the same or
/// an adjacent pixel, because looking up the nearest stored value moves depth by up to a pixel.
fn agreement(found: &DepthMap, truth: &DepthMap) -> f64 {
    let (mut both, mut close) = (0, 0);
    for (x, y, z) in found.enumerate_pixels() {
        if z.0[0] <= 0.0 || truth.get_pixel(x, y).0[0] <= 0.0 {
            continue;
        }
        let (mut low, mut high) = (f32::MAX, 0.0_f32);
        for v in y.saturating_sub(1)..=(y + 1).min(truth.height() - 1) {
            for u in x.saturating_sub(1)..=(x + 1).min(truth.width() - 1) {
                let near = truth.get_pixel(u, v).0[0];
                if near > 0.0 {
                    (low, high) = (low.min(near), high.max(near));
                }
            }
        }
        both += 1;
        close += u32::from((low * 0.995..=high * 1.005).contains(&z.0[0]));
    }
    assert!(both > found.width() * found.height() / 4, "{both}");
    f64::from(close) / f64::from(both)
}
