//! Round trips, other programs' files and hostile ones.

use super::*;
use crate::unprojection::release_intrinsics;

fn scene() -> GaussianScene {
    let gaussians = Gaussians::new(
        vec![[0.5, -1.0, 2.0], [0.0, 0.25, 4.0]],
        vec![[0.9, 0.1, 0.2, -0.3], [1.0, 0.0, 0.0, 0.0]],
        vec![[0.1, 0.02, 0.3], [1.0, 2.0, 3.0]],
        vec![0.7, 0.01],
        vec![[0.1, 0.2, 0.3], [0.0, 1.0, 0.001]],
    )
    .unwrap();
    GaussianScene::new(gaussians, release_intrinsics(500.0, 640, 480).unwrap())
}

fn read(bytes: &[u8]) -> Result<GaussianScene, PlyReason> {
    from_bytes(bytes, ReadOptions::default())
}

fn assert_same(found: &Gaussians, expected: &Gaussians) {
    assert_eq!(found.means, expected.means);
    assert_eq!(found.quaternions, expected.quaternions);
    let pairs = |a: &[[f32; 3]], b: &[[f32; 3]]| {
        for (x, y) in a.as_flattened().iter().zip(b.as_flattened()) {
            assert!((x - y).abs() <= 2e-6 * y.abs().max(0.1), "{x} against {y}");
        }
    };
    pairs(&found.scales, &expected.scales);
    pairs(&found.colors, &expected.colors);
    for (x, y) in found.opacities.iter().zip(&expected.opacities) {
        assert!((x - y).abs() < 1e-6);
    }
}

/// A text file with the given columns, one Gaussian, every value 0 but z = 2.
fn text(columns: &[&str], rest: &str) -> Vec<u8> {
    let mut out = String::from("ply\nformat ascii 1.0\nelement vertex 1\n");
    for column in columns {
        out += &format!("property float {column}\n");
    }
    out += "end_header\n";
    for column in columns {
        out += if *column == "z" { "2 " } else { "0 " };
    }
    (out + rest).into_bytes()
}

const COLUMNS: [&str; 14] = [
    "rot_3", "rot_2", "rot_1", "rot_0", "z", "y", "x", "opacity", "scale_2", "scale_1", "scale_0",
    "f_dc_2", "f_dc_1", "f_dc_0",
];

#[test]
fn both_forms_survive_a_round_trip() {
    let scene = scene();
    for form in [PlyForm::Release, PlyForm::Plain] {
        let found = read(&to_bytes(&scene, form)).unwrap();
        assert_same(&found.gaussians, &scene.gaussians);
        assert_eq!(found.color_space, ColorSpace::Srgb);
        if form == PlyForm::Release {
            assert_eq!(found.intrinsics, scene.intrinsics);
            assert_eq!(found.extrinsics.unwrap()[0], 1.0);
            assert_eq!(found.version, Some([1, 5, 0]));
        } else {
            assert_eq!(found.intrinsics, None);
            assert_eq!(found.intrinsics_or_default().fx, 512.0);
        }
    }
}

#[test]
fn opacities_at_the_ends_become_infinite_logits_and_come_back() {
    let mut scene = scene();
    scene.gaussians.opacities = vec![0.0, 1.0];
    let found = read(&to_bytes(&scene, PlyForm::Plain)).unwrap();
    assert_eq!(found.gaussians.opacities, [0.0, 1.0]);
}

#[test]
fn text_in_any_order_of_columns() {
    let found = read(&text(&COLUMNS, "\n")).unwrap();
    assert_eq!(found.gaussians.means, [[0.0, 0.0, 2.0]]);
    assert_eq!(found.gaussians.opacities, [0.5]);
    assert_eq!(found.gaussians.scales, [[1.0; 3]]);
    // Linear unless the file or the caller says otherwise.
    assert_eq!(found.gaussians.colors, [[0.5; 3]]);
    let srgb = ReadOptions {
        default_color_space: ColorSpace::Srgb,
    };
    let found = from_bytes(&text(&COLUMNS, ""), srgb).unwrap();
    assert_eq!(found.gaussians.colors[0][0], linear(0.5));
}

fn linear(x: f32) -> f32 {
    crate::color::linear_from_srgb(x)
}

#[test]
fn view_dependent_coefficients_and_normals_are_counted_and_skipped() {
    let mut columns = vec!["nx", "f_rest_0", "f_rest_1"];
    columns.extend(COLUMNS);
    let found = read(&text(&columns, "")).unwrap();
    assert_eq!(found.ignored_color_coefficients, 2);
    assert_eq!(found.gaussians.means, [[0.0, 0.0, 2.0]]);
}

#[test]
fn big_endian_doubles_lists_and_legacy_cameras() {
    let mut bytes = b"ply\nformat binary_big_endian 1.0\nelement face 2\n\
        property list uchar int vertex_indices\nelement vertex 1\n"
        .to_vec();
    for column in COLUMNS {
        bytes.extend(format!("property double {column}\n").bytes());
    }
    bytes.extend(b"element intrinsic 4\nproperty float intrinsic\n");
    bytes.extend(b"element extrinsic 12\nproperty short extrinsic\nend_header\n");
    bytes.extend([1, 0, 0, 0, 7, 0]);
    for column in COLUMNS {
        bytes.extend(if column == "z" { 2.5_f64 } else { 0.0 }.to_be_bytes());
    }
    for value in [600.0_f32, 610.0, 320.0, 200.0] {
        bytes.extend(value.to_be_bytes());
    }
    for value in 0..12_i16 {
        bytes.extend(value.to_be_bytes());
    }
    let found = read(&bytes).unwrap();
    assert_eq!(found.gaussians.means, [[0.0, 0.0, 2.5]]);
    let k = found.intrinsics.unwrap();
    assert_eq!((k.fx, k.fy, k.cx, k.cy), (600.0, 610.0, 160.0, 100.0));
    assert_eq!((k.width, k.height), (320, 200));
    #[rustfmt::skip]
    let expected = [
        0.0, 4.0, 8.0, 3.0,
        1.0, 5.0, 9.0, 7.0,
        2.0, 6.0, 10.0, 11.0,
        0.0, 0.0, 0.0, 1.0,
    ];
    assert_eq!(found.extrinsics, Some(expected));
}

#[test]
fn every_truncation_is_an_error() {
    let bytes = to_bytes(&scene(), PlyForm::Release);
    for length in 0..bytes.len() {
        assert!(read(&bytes[..length]).is_err(), "{length}");
    }
    assert!(read(&bytes).is_ok());
}

#[test]
fn hostile_headers_fail_without_large_allocations() {
    let with = |old: &str, new: &str| {
        let text = String::from_utf8(text(&COLUMNS, "")).unwrap();
        assert!(text.contains(old));
        text.replacen(old, new, 1).into_bytes()
    };
    let cases: [(Vec<u8>, &str); 13] = [
        (Vec::new(), "not a PLY"),
        (b"PK\x03\x04".to_vec(), "not a PLY"),
        (b"GIF89a\n".to_vec(), "not a PLY"),
        (
            with("vertex 1", "vertex 18446744073709551615"),
            "ends before",
        ),
        (
            with("vertex 1", "vertex 99999999999999999999999"),
            "no count",
        ),
        (with("vertex 1", "vertex -1"), "no count"),
        (with("vertex 1", "points 1"), "lacks itself"),
        (with("ascii", "utf8"), "format"),
        (with("format ascii 1.0\n", ""), "no `format`"),
        (with("float x", "quad x"), "header line"),
        (with("float x", "float y"), "twice"),
        (with("float rot_0", "list uchar float rot_0"), "lacks"),
        (b"ply\n".repeat(100_000), "header line 2"),
    ];
    for (bytes, expected) in cases {
        let message = read(&bytes).unwrap_err().to_string();
        assert!(message.contains(expected), "{message} lacks {expected}");
    }
    let nan = text(&COLUMNS, "").strip_suffix(b"0 ").unwrap().to_vec();
    let message = read(&[&nan[..], b"zero"].concat()).unwrap_err().to_string();
    assert!(message.contains("`zero` is not a number"), "{message}");
    // A list that claims four billion entries, and rows without any property.
    let list = b"ply\nformat binary_little_endian 1.0\nelement face 1\n\
        property list uint float v\nend_header\n\xff\xff\xff\xff\x00";
    assert!(read(list).unwrap_err().to_string().contains("ends before"));
    let empty = b"ply\nformat ascii 1.0\nelement vertex 9999999999999\nend_header\n";
    assert!(read(empty).unwrap_err().to_string().contains("lacks"));
}

#[test]
fn impossible_extras_are_named() {
    let release = to_bytes(&scene(), PlyForm::Release);
    let mut other_space = release.clone();
    let at = release.len() - 4;
    other_space[at] = 7;
    let message = read(&other_space).unwrap_err().to_string();
    assert!(message.contains("color_space"), "{message}");
    // The focal length lies 9 + 2 + 2 + 2 words and 4 bytes before the end.
    let mut no_focal = release.clone();
    let at = release.len() - 4 - 15 * 4;
    no_focal[at..at + 4].copy_from_slice(&0.0_f32.to_le_bytes());
    let message = read(&no_focal).unwrap_err().to_string();
    assert!(message.contains("stored camera"), "{message}");
}

#[test]
fn errors_name_the_file() {
    let path = Path::new("/nonexistent/scene.ply");
    let message = load(path, ReadOptions::default()).unwrap_err().to_string();
    assert!(message.starts_with("/nonexistent/scene.ply: "), "{message}");
}

#[test]
fn an_empty_scene_is_a_valid_file() {
    let mut empty = scene();
    empty.gaussians = Gaussians::default();
    for form in [PlyForm::Release, PlyForm::Plain] {
        assert!(read(&to_bytes(&empty, form)).unwrap().gaussians.is_empty());
    }
}
