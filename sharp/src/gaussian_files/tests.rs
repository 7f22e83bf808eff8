//! Hostile, truncated and malformed files. The tests of the whole product compare files of other
//! programs.

use std::io::Write;

use flate2::Compression;
use flate2::write::GzEncoder;

use super::*;
use crate::gaussians::{Gaussians, Harmonics};
use crate::ply::{ColorSpace, to_compressed_bytes};
use crate::unprojection::release_intrinsics;

fn encoded() -> StoredForm {
    StoredForm {
        blending: ColorSpace::Srgb,
        ..StoredForm::default()
    }
}

fn scene() -> GaussianScene {
    let n = 300;
    let along = |k: usize| k as f32 / 300.0;
    let mut gaussians = Gaussians::new(
        (0..n).map(|k| [along(k), 1.0 - along(k), 2.0]).collect(),
        vec![[0.9, 0.1, 0.2, -0.3]; n],
        vec![[0.1, 0.02, 0.3]; n],
        (0..n).map(along).collect(),
        vec![[0.1, 0.2, 0.3]; n],
    )
    .unwrap();
    gaussians.harmonics = Harmonics {
        degree: 1,
        coefficients: vec![[0.1, -0.2, 0.3]; 3 * n],
    };
    let mut scene = GaussianScene::new(gaussians, release_intrinsics(500.0, 640, 480).unwrap());
    scene.reading = encoded();
    scene
}

fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut out = GzEncoder::new(Vec::new(), Compression::default());
    out.write_all(bytes).unwrap();
    out.finish().unwrap()
}

/// A zip archive of stored files.
fn archive(files: &[(&str, &[u8])]) -> Vec<u8> {
    let mut out = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
    for (name, bytes) in files {
        let options = zip::write::SimpleFileOptions::default();
        out.start_file(*name, options).unwrap();
        out.write_all(bytes).unwrap();
    }
    out.finish().unwrap().into_inner()
}

fn reason(bytes: &[u8], name: &str) -> String {
    from_bytes(bytes, name, encoded()).unwrap_err().to_string()
}

#[test]
fn truncated_files_are_refused_wherever_they_end() {
    let scene = scene();
    let splat = vec![7; 320];
    let files = [
        ("scene.spz", to_spz_bytes(&scene).unwrap()),
        ("scene.ply", to_compressed_bytes(&scene)),
        ("scene.splat", splat),
    ];
    for (name, bytes) in files {
        assert!(from_bytes(&bytes, name, encoded()).is_ok(), "{name}");
        for end in (0..bytes.len()).step_by(7).filter(|end| end % 32 != 0) {
            let found = from_bytes(&bytes[..end], name, encoded());
            // Without its last bytes, a gzip file lacks only a checksum.
            assert!(found.is_err() || name.ends_with("spz") && end + 8 >= bytes.len());
        }
    }
}

#[test]
fn counts_that_a_file_cannot_hold_are_refused() {
    let mut start = b"NGSP".to_vec();
    for word in [3, u32::MAX, 0x0C04] {
        start.extend(word.to_le_bytes());
    }
    let found = reason(&gzip(&start), "a.spz");
    assert!(found.contains("cannot hold"), "{found}");
    start[4] = 4;
    start[15] = 6;
    start.extend([32, 0, 0, 0].iter().chain(&[0; 12]));
    start.extend([255; 96]);
    let found = reason(&start, "a.spz");
    assert!(found.contains("a stream of "), "{found}");
    let chunks = "ply\nformat binary_little_endian 1.0\nelement chunk 4000000000\nproperty float min_x\nend_header\n";
    let found = from_bytes(chunks.as_bytes(), "a.ply", encoded());
    assert!(matches!(found, Err(PlyReason::Missing(_))), "{found:?}");
}

#[test]
fn other_formats_are_named_with_what_converts_them() {
    for (bytes, name, part) in [
        (b"glTF\x02".as_slice(), "a", "glTF"),
        (b"\0\x01", "a.ksplat", "KSPLAT"),
        (&gzip(b"ply\nformat ascii 1.0\n"), "a.ply.gz", "gunzip"),
        (&gzip(&[7; 40]), "a.gz", "not an SPZ"),
        (b"\x1f\x8b\0", "a.spz", "it ends early: truncated?"),
        (b"PK\x03\x04", "a.sog", "truncated?"),
        (b"", "a.splat", "it is empty"),
        (
            b"ply\nformat ascii 1.0\nelement vertex 1\nelement vertex 1\n",
            "a.ply",
            "a second element `vertex`",
        ),
        (&archive(&[("a.txt", b"x")]), "a.zip", "so not a SOG"),
        (b"\x93NUMPY", "a.npy", "NumPy"),
        (b"text", "a.txt", "not a known format"),
        (b"\xef\xbb\xbfply\n", "a.ply", "byte order mark"),
        (
            b"ply\nformat ascii 1.0\nelement vertex 1\nproperty half x\nend_header\n",
            "a.ply",
            "convert it to float",
        ),
        (&[0; 33], "a.splat", "not a multiple of 32"),
    ] {
        let found = reason(bytes, name);
        assert!(found.contains(part), "{name}: {found}");
    }
}

#[test]
fn sog_reads_nothing_outside_its_folder_and_needs_every_picture() {
    let parts = r#""scales":{},"quats":{},"sh0":{}"#;
    for (means, part) in [
        (r#""means":{"files":["../a.webp"]}"#, "names the file"),
        (r#""means":{"files":["a.webp"]}"#, "a.webp"),
        (r#""means":{"files":[]}"#, "incomplete"),
    ] {
        let meta = format!(r#"{{"version":2,"count":4,{means},{parts}}}"#);
        let found = reason(&archive(&[("meta.json", meta.as_bytes())]), "a.sog");
        assert!(found.contains(part), "{found}");
    }
    let third = archive(&[("meta.json", br#"{"version":3}"#)]);
    assert!(reason(&third, "a.sog").contains("version 3"));
}

#[test]
fn what_is_made_for_another_rule_is_refused_where_colours_are_linear() {
    let mut scene = scene();
    scene.marks.antialiased = Some(true);
    let bytes = to_spz_bytes(&scene).unwrap();
    let found = from_bytes(&bytes, "a.spz", StoredForm::default());
    assert!(matches!(found, Err(PlyReason::OtherRule(_))));
    assert_eq!(
        from_bytes(&bytes, "a.spz", encoded())
            .unwrap()
            .marks
            .antialiased,
        Some(true)
    );
}

#[test]
fn flipped_harmonics_give_the_flipped_colours() {
    // Flipping x and y preserves the signs of z and x² − y², but not that of x.
    let mut one = scene().gaussians.subset(&[0]);
    one.harmonics = Harmonics {
        degree: 2,
        coefficients: (1..=8).map(|k| [k as f32; 3]).collect(),
    };
    let flipped = one.flipped([-1.0, -1.0, 1.0]);
    let signs: Vec<f32> = (0..8)
        .map(|k| flipped.harmonics.of(0)[k][0].signum())
        .collect();
    assert_eq!(signs, [-1.0, 1.0, -1.0, 1.0, -1.0, 1.0, -1.0, 1.0]);
    assert_eq!(flipped.quaternions[0], [0.9, -0.1, -0.2, -0.3]);
}

#[test]
fn errors_name_the_file() {
    let path = Path::new("/nonexistent/scene.ply");
    assert_eq!(load(path, None).unwrap_err().path, path);
}

#[test]
fn splat_quaternions_that_are_not_of_length_1_are_told() {
    let file = |byte: fn(f32) -> u8| {
        let rows = (0..200).flat_map(|k| {
            let (sin, cos) = (k as f32 * 0.1).sin_cos();
            let turn = [0.8 * cos, 0.8 * sin, -0.6 * cos, 0.6 * sin].map(byte);
            let mut row = [0_u8; 32];
            row[12..24].copy_from_slice(&[0.1_f32.to_le_bytes(); 3].concat());
            row[24..28].copy_from_slice(&[200; 4]);
            row[28..].copy_from_slice(&turn);
            row
        });
        rows.collect::<Vec<u8>>()
    };
    let about = |bytes: Vec<u8>| {
        let doubts = from_bytes(&bytes, "a.splat", encoded()).unwrap().doubts;
        doubts
            .into_iter()
            .map(|doubt| doubt.text)
            .collect::<String>()
    };
    assert_eq!(about(file(|q| (128.0 + 128.0 * q) as u8)), "");
    let wrapped: [fn(f32) -> u8; 2] = [
        |q| (128.0 * q) as i8 as u8,
        |q| (128.0 + 256.0 * q).rem_euclid(256.0) as u8,
    ];
    for wrong in wrapped {
        let text = about(file(wrong));
        assert!(text.contains("or their bytes overflowed"), "{text}");
    }
}
