//! Gaussians, cameras for rendering them, and checkpoints.

use std::path::Path;

use sharp::camera::Intrinsics;
use sharp::gaussians::Gaussians;
use sharp::ply::{GaussianScene, PlyForm, to_bytes};
use sharp_tests::{hostile_checkpoints, words};

use super::case::{Case, Verdict};
use super::spoil;

/// Twelve Gaussians in front of a camera of 32 x 24 pixels.
fn put(case: &Case) {
    let mut scene = Gaussians::default();
    for k in 0..12_u8 {
        let (column, row) = (f32::from(k % 4), f32::from(k / 4));
        scene
            .means
            .push([0.5 * (column - 1.5), 0.5 * (row - 1.0), 3.0]);
        scene.quaternions.push([1.0, 0.1 * column, 0.2 * row, 0.0]);
        scene.scales.push([0.12, 0.2, 0.05]);
        scene.opacities.push(0.4 + 0.05 * column);
        scene.colors.push([0.2 * row + 0.1, 0.25 * column, 0.8]);
    }
    let camera = Intrinsics::new((30.0, 30.0), (16.0, 12.0), (32, 24)).unwrap();
    case.write(
        "s.ply",
        to_bytes(&GaussianScene::new(scene, camera), PlyForm::Release),
    );
}

fn render(case: &mut Case, more: &[&str]) -> Result<super::case::Said, String> {
    case.run(
        &[
            &words("render s.ply --backend cpu --out x.png --json"),
            more,
        ]
        .concat(),
    )
}

pub(crate) fn gaussians(case: &mut Case) -> Result<Verdict, String> {
    put(case);
    spoil::file(case, "s.ply", spoil::binary);
    if case.random.below(2) == 0 {
        let said = case.run(&["gaussians", "info", "s.ply", "--json"])?;
        if said.code != 0 {
            return Ok(Verdict::Error);
        }
        // The number of Gaussians must be the one that the header states.
        let text = case.read("s.ply");
        let said_count = text
            .lines()
            .find_map(|line| line.strip_prefix("element vertex "));
        let found = said.json()?["gaussians"].as_u64();
        return if said_count.and_then(|count| count.trim().parse().ok()) == found {
            Ok(Verdict::Number)
        } else {
            Err(format!("{found:?} Gaussians instead of {said_count:?}"))
        };
    }
    let said = render(case, &[])?;
    if said.code != 0 {
        return Ok(Verdict::Error);
    }
    let alpha = said.json()?["mean_alpha"].as_f64();
    if alpha.is_some_and(|alpha| (0.0..=1.0).contains(&alpha)) {
        rendered(case, &said)
    } else {
        Err(format!("mean alpha {alpha:?}"))
    }
}

/// Checks that the picture has the reported size.
fn rendered(case: &Case, said: &super::case::Said) -> Result<Verdict, String> {
    let json = said.json()?;
    let size = image::image_dimensions(case.path("x.png")).map_err(|error| error.to_string())?;
    let stated = [&json["width"], &json["height"]].map(|n| n.as_u64());
    if stated == [size.0, size.1].map(|n| Some(u64::from(n))) {
        Ok(Verdict::Number)
    } else {
        Err(format!("{size:?} instead of {stated:?}"))
    }
}

pub(crate) fn cameras(case: &mut Case) -> Result<Verdict, String> {
    put(case);
    let camera = r#"{"width": 40, "height": 30, "K": [30, 0, 20, 0, 30, 15, 0, 0, 1],
 "camera_from_world": [1, 0, 0, 0.1, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1]}
"#;
    case.write("cam.json", camera);
    spoil::file(case, "cam.json", spoil::text);
    // A message about rendering may name the file of Gaussians instead of the size.
    case.may_name("s.ply");
    let said = render(case, &["--camera", "cam.json"])?;
    if said.code != 0 {
        return Ok(Verdict::Error);
    }
    let read: serde_json::Value =
        match serde_json::from_str(case.read("cam.json").trim_start_matches('\u{feff}')) {
            Ok(read) => read,
            Err(error) => return Err(format!("accepted a camera file that is not JSON: {error}")),
        };
    let json = said.json()?;
    for side in ["width", "height"] {
        if read[side].as_f64() != json[side].as_f64() {
            return Err(format!("{side} {} instead of {}", json[side], read[side]));
        }
    }
    rendered(case, &said)
}

pub(crate) fn checkpoints(case: &mut Case) -> Result<Verdict, String> {
    let golden = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/golden/model");
    let hostile = hostile_checkpoints::all();
    // Besides files with false claims, the tiny network with changed bytes.
    let is_mutant = case.random.below(2) == 0;
    if is_mutant {
        case.write("w.pt", std::fs::read(golden.join("tiny_model.pt")).unwrap());
        spoil::file(case, "w.pt", spoil::binary);
    } else {
        let (what, bytes) = case.random.pick(&hostile);
        case.write("w.pt", bytes);
        case.note(*what, "w.pt");
    }
    let config = golden.join("tiny_config.json#tiny").display().to_string();
    if case.random.below(2) == 0 {
        let args = ["weights", "check", "w.pt", "--config", &config, "--json"];
        return if is_mutant {
            match case.run(&args)? {
                said if said.code == 0 => match said.json()?["not_finite"].as_u64() {
                    Some(0) => Ok(Verdict::Number),
                    other => Err(format!("not finite: {other:?}")),
                },
                _ => Ok(Verdict::Error),
            }
        } else {
            case.refused(&args)
        };
    }
    let photo = golden.join("inputs/main_640x480.png").display().to_string();
    let args = [
        "predict",
        &photo,
        "--checkpoint",
        "w.pt",
        "--config",
        &config,
        "--out",
        "p.ply",
        "--json",
    ];
    if !is_mutant {
        return case.refused(&args);
    }
    let said = case.run(&args)?;
    match said.code {
        0 if said.json()?[0]["gaussians"].as_u64() == Some(2 * 96 * 96) => Ok(Verdict::Number),
        0 => Err(format!("another number of Gaussians: {}", said.out)),
        _ => Ok(Verdict::Error),
    }
}
