//! Round trips, other programs' files and hostile files.

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
    from_bytes(bytes, Some(ColorSpace::Linear)).or_else(|reason| match reason {
        PlyReason::ColorSpaceContradicted { .. } => from_bytes(bytes, None),
        other => Err(other),
    })
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

/// A text file with the given columns and one Gaussian; every value is 0 except z = 2.
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
        assert_eq!(found.color_space, Some(ColorSpace::Srgb));
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
    // The file does not state its colour encoding; `read` says that colours are linear.
    assert_eq!(found.gaussians.colors, [[0.5; 3]]);
}

#[test]
fn colours_are_never_guessed() {
    let plain = text(&COLUMNS, "");
    let unknown = from_bytes(&plain, None).unwrap_err();
    assert!(matches!(unknown, PlyReason::ColorSpaceUnknown), "{unknown}");
    let color = |space| from_bytes(&plain, Some(space)).unwrap().gaussians.colors[0][0];
    assert_eq!(color(ColorSpace::Linear), 0.5);
    assert!((color(ColorSpace::Srgb) - 0.214_041).abs() < 1e-6);
    // Our own files state their encoding, and another one is refused.
    let tagged = to_bytes(&scene(), PlyForm::Plain);
    assert!(from_bytes(&tagged, None).is_ok());
    let contradicted = from_bytes(&tagged, Some(ColorSpace::Linear)).unwrap_err();
    let is_contradicted = matches!(
        contradicted,
        PlyReason::ColorSpaceContradicted {
            stated: ColorSpace::Srgb,
            given: ColorSpace::Linear
        }
    );
    assert!(is_contradicted, "{contradicted}");
}

#[test]
fn coefficients_that_are_not_zero_make_colours_depend_on_the_view() {
    let mut columns = vec!["f_rest_0"];
    columns.extend(COLUMNS);
    let flat = String::from_utf8(text(&columns, "")).unwrap();
    assert!(!read(flat.as_bytes()).unwrap().is_view_dependent);
    let varied = flat.replace("end_header\n0 ", "end_header\n0.1 ");
    assert!(read(varied.as_bytes()).unwrap().is_view_dependent);
}

#[test]
fn view_dependent_coefficients_and_normals_are_counted_and_skipped() {
    let mut columns = vec!["nx", "f_rest_0", "f_rest_1"];
    columns.extend(COLUMNS);
    let found = read(&text(&columns, "")).unwrap();
    assert_eq!(found.color_coefficients, 2);
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
    let header = |line| Err(Some(line));
    let cases = [
        (Vec::new(), Err(None)),
        (b"PK\x03\x04".to_vec(), Err(None)),
        (b"GIF89a\n".to_vec(), Err(None)),
        (with("vertex 1", "vertex 18446744073709551615"), Ok("rows")),
        (
            with("vertex 1", "vertex 99999999999999999999999"),
            header(3),
        ),
        (with("vertex 1", "vertex -1"), header(3)),
        (with("vertex 1", "points 1"), Ok("vertex")),
        (with("ascii", "utf8"), header(2)),
        (with("format ascii 1.0\n", ""), header(17)),
        (with("float x", "quad x"), header(10)),
        (with("float x", "float y"), header(10)),
        (with("float rot_0", "list uchar float rot_0"), Ok("rot_0")),
        (b"ply\n".repeat(100_000), header(2)),
        (
            // A list whose stated length is four billion entries.
            b"ply\nformat binary_little_endian 1.0\nelement face 1\n\
              property list uint float v\nend_header\n\xff\xff\xff\xff\x00"
                .to_vec(),
            Ok("rows"),
        ),
        (
            // Rows without any property.
            b"ply\nformat ascii 1.0\nelement vertex 9999999999999\nend_header\n".to_vec(),
            Ok("x"),
        ),
    ];
    for (bytes, expected) in cases {
        // The error must name a line of the header (unless the file is not a PLY at all), or what is missing.
        let found = match read(&bytes).unwrap_err() {
            PlyReason::Table(TableError::NotPly) => Err(None),
            PlyReason::Table(TableError::Header { line, .. }) => Err(Some(line)),
            PlyReason::Table(TableError::Truncated { .. }) => Ok("rows"),
            PlyReason::NoVertices => Ok("vertex"),
            PlyReason::Missing(names) => Ok(names[0]),
            other => panic!("{other}"),
        };
        assert_eq!(found, expected);
    }
    let text = text(&COLUMNS, "");
    let word = [text.strip_suffix(b"0 ").unwrap(), b"zero"].concat();
    assert!(matches!(
        read(&word),
        Err(PlyReason::Table(TableError::NotANumber { row: 0, word, .. })) if word == "zero"
    ));
}

#[test]
fn lists_and_numbers_are_found_by_their_own_names() {
    let bytes = b"ply\nformat ascii 1.0\ncomment by hand\nelement face 2\nproperty int id\n\
        property list uchar int vertex_indices\nend_header\n7 3 0 1 2\n8 0\n";
    let (header, mut body) = table::Header::parse(bytes).unwrap();
    assert_eq!(header.comments, ["by hand"]);
    let face = &header.elements[0];
    assert_eq!((face.number("id"), face.list("id")), (Some(0), None));
    assert_eq!(face.list("vertex_indices"), Some(1));
    let mut found = Vec::new();
    body.rows::<TableError>(face, |row| {
        found.push((row.number(0), row.property(1).to_vec()));
        Ok(())
    })
    .unwrap();
    assert_eq!(found, [(7.0, vec![0.0, 1.0, 2.0]), (8.0, vec![])]);
}

#[test]
fn impossible_extras_are_named() {
    let release = to_bytes(&scene(), PlyForm::Release);
    let mut other_space = release.clone();
    let at = release.len() - 4;
    other_space[at] = 7;
    assert!(matches!(
        read(&other_space),
        Err(PlyReason::Extra {
            element: "color_space",
            ..
        })
    ));
    // The focal length lies 9 + 2 + 2 + 2 words and 4 bytes before the end.
    let mut no_focal = release.clone();
    let at = release.len() - 4 - 15 * 4;
    no_focal[at..at + 4].copy_from_slice(&0.0_f32.to_le_bytes());
    assert!(matches!(read(&no_focal), Err(PlyReason::Camera(_))));
}

/// Reads a file for the rendering rule of 3D Gaussian Splatting.
fn read_encoded(bytes: &[u8]) -> Result<GaussianScene, PlyReason> {
    let reading = StoredForm {
        blending: ColorSpace::Srgb,
        ..StoredForm::default()
    };
    from_bytes(bytes, reading)
}

#[test]
fn encoded_colours_are_kept_with_their_harmonics() {
    let rest: Vec<String> = (0..9).rev().map(|k| format!("f_rest_{k}")).collect();
    let mut columns: Vec<&str> = rest.iter().map(String::as_str).collect();
    columns.extend(COLUMNS);
    let flat = String::from_utf8(text(&columns, "")).unwrap();
    // Red's coefficients come first, whatever the order of the columns.
    let varied = flat.replace(
        "end_header\n0 0 0 0 0 0 0 0 0 ",
        "end_header\n9 8 7 6 5 4 3 2 1 ",
    );
    let found = read_encoded(varied.as_bytes()).unwrap();
    let [first, second, third] = [[1.0, 4.0, 7.0], [2.0, 5.0, 8.0], [3.0, 6.0, 9.0]];
    assert_eq!(found.gaussians.harmonics.of(0), [first, second, third]);
    assert_eq!(found.gaussians.colors, [[0.5; 3]]);
    // If all coefficients are zero, no harmonics are drawn, which saves time.
    let flat = read_encoded(flat.as_bytes()).unwrap();
    assert_eq!(flat.gaussians.harmonics.degree, 0);
    assert_eq!(flat.color_coefficients, 9);
    let written = read_encoded(&to_bytes(&found, PlyForm::Plain)).unwrap();
    assert_eq!(written.gaussians, found.gaussians);
    let incomplete = varied.replace("f_rest_8", "f_rest_9");
    let refused = read_encoded(incomplete.as_bytes());
    assert!(matches!(refused, Err(PlyReason::Degree(9))));
}

#[test]
fn linear_colours_are_encoded_where_they_are_blended_so() {
    let reading = StoredForm {
        blending: ColorSpace::Srgb,
        ..StoredForm::from(Some(ColorSpace::Linear))
    };
    let plain = text(&COLUMNS, "");
    let found = from_bytes(&plain, reading).unwrap().gaussians;
    assert!((found.colors[0][0] - 0.735_357).abs() < 1e-6, "{found:?}");
    let mut again = found;
    reading.or_of(&StoredForm::ply()).encode(&mut again);
    assert!(again.colors[0][0].abs() < 1e-6);
}

#[test]
fn marks_of_other_rules_are_read_only_where_these_can_be_drawn() {
    let mut columns = vec!["filter_3D"];
    columns.extend(COLUMNS);
    let filtered = String::from_utf8(text(&columns, "")).unwrap();
    let filtered = filtered.replace("end_header\n0 ", "end_header\n1 ");
    let refused = read(filtered.as_bytes()).unwrap_err();
    assert!(matches!(refused, PlyReason::OtherRule(_)), "{refused}");
    let folded = read_encoded(filtered.as_bytes()).unwrap();
    assert!(folded.marks.has_filter_3d);
    // Each standard deviation of 1 grows by √2.
    let [scale, ..] = folded.gaussians.scales[0];
    assert!((scale - 2.0_f32.sqrt()).abs() < 1e-6);
    let opacity = folded.gaussians.opacities[0];
    assert!((opacity - 0.5 / 8.0_f32.sqrt()).abs() < 1e-6);
    let flat = filtered.replace("element", "comment SplatRenderMode: 2DGS\nelement");
    assert!(matches!(
        read_encoded(flat.as_bytes()),
        Err(PlyReason::OtherRule(_))
    ));
}

#[test]
fn an_empty_scene_is_a_valid_file() {
    let mut empty = scene();
    empty.gaussians = Gaussians::default();
    for form in [PlyForm::Release, PlyForm::Plain] {
        assert!(read(&to_bytes(&empty, form)).unwrap().gaussians.is_empty());
    }
}

#[test]
fn interleaved_coefficients_are_put_in_order_and_back() {
    let degree = 2;
    let each = crate::gaussians::Harmonics::coefficients_of(degree);
    // Coefficient j of channel c is 10 j + c; the file has red, green and blue of each.
    let right: Vec<[f32; 3]> = (0..2 * each)
        .map(|j| [0.0, 1.0, 2.0].map(|c| 10.0 * j as f32 + c))
        .collect();
    let as_read = right.chunks(each).flat_map(|own| {
        let file = own.as_flattened();
        (0..each).map(|j| [0, 1, 2].map(|c| file[c * each + j]))
    });
    let mut gaussians = Gaussians::default();
    gaussians.harmonics.degree = degree;
    gaussians.harmonics.coefficients = as_read.collect();
    let stored = gaussians.clone();
    let form = StoredForm {
        harmonics: Some(Harmonics::Interleaved),
        ..StoredForm::default()
    };
    form.decode(&mut gaussians);
    assert_eq!(gaussians.harmonics.coefficients, right);
    form.encode(&mut gaussians);
    assert_eq!(gaussians, stored);
}

/// A plausible scene. Its opacities and colours have the range of a photograph's and are encoded by `store`.
fn varied(store: impl Fn(f32, f32) -> (f32, f32)) -> Gaussians {
    let share = |k: usize| 0.03 + 0.94 * (k as f32 + 0.5) / 400.0;
    let mut all = Gaussians::default();
    for k in 0..400 {
        let (opacity, color) = store(share(k * 7 % 400).sqrt(), share(k * 11 % 400));
        all.means.push([k as f32, (k * 3 % 400) as f32, 1.0]);
        all.quaternions.push([1.0, 0.0, 0.0, 0.0]);
        all.scales.push([-3.0, -3.1, -3.2]);
        all.opacities.push(opacity);
        all.colors.push([color; 3]);
    }
    all
}

#[test]
fn repeated_gaussians_are_told_and_placeholders_are_not() {
    let found = |stored: &Gaussians| {
        let all = suspicions(stored, &StoredForm::default(), &StoredForm::ply());
        let repetition = all.into_iter().find(|doubt| doubt.about == "repetition");
        repetition.map_or_else(String::new, |doubt| doubt.text)
    };
    let once = varied(|o, c| (o, c));
    assert_eq!(found(&once), "");
    let rows: Vec<usize> = (0..400).collect();
    let with = |more: Vec<usize>| once.subset(&[rows.clone(), more].concat());
    assert!(found(&with(rows.clone())).starts_with("50 % of its Gaussians repeat"));
    assert!(found(&with((0..40).collect())).starts_with("9 %"));
    assert_eq!(found(&with((0..19).collect())), "");
    assert_eq!(found(&with(vec![7; 400])), "");
}

#[test]
fn logarithms_of_opacities_and_signed_colours_are_suspected_and_mended() {
    let (logit, dc) = (
        |o: f32| (o / (1.0 - o)).ln(),
        |c: f32| (c - 0.5) / SH_CONSTANT,
    );
    let found = |stored: &Gaussians| {
        let all = suspicions(stored, &StoredForm::default(), &StoredForm::ply());
        all.into_iter().map(|doubt| doubt.about).collect::<Vec<_>>()
    };
    assert_eq!(found(&varied(|o, c| (logit(o), dc(c)))), [""; 0]);
    // Low opacities, up to half, and pale colours.
    let pale = varied(|o, c| (logit(0.5 * o), dc(0.3 + 0.4 * c)));
    assert_eq!(found(&pale), [""; 0]);
    let constant = varied(|_, c| (logit(0.1), dc(c)));
    assert_eq!(found(&constant), [""; 0]);
    for stored in [
        varied(|o, c| (o.ln(), dc(c))),
        varied(|_, c| (0.95_f32.ln(), dc(c))),
    ] {
        assert_eq!(found(&stored), ["opacity=log"]);
    }
    let signed = varied(|o, c| (logit(o), 2.0 * c - 1.0));
    assert_eq!(found(&signed), ["colors=rgb-signed"]);
    let mut reading = StoredForm::ply().or_of(&StoredForm::default());
    for setting in ["opacity=log", "colors=rgb-signed", "scales=log10"] {
        let (key, value) = setting.split_once('=').unwrap();
        reading.set(key, value).unwrap();
    }
    let mut decoded = varied(|o, c| (o.ln(), 2.0 * c - 1.0));
    check_stored(&decoded, &reading).unwrap();
    reading.blending = ColorSpace::Srgb;
    reading.decode(&mut decoded);
    let expected = varied(|o, c| (o, c));
    for k in 0..400 {
        assert!((decoded.opacities[k] - expected.opacities[k]).abs() < 1e-6);
        assert!((decoded.colors[k][0] - expected.colors[k][0]).abs() < 1e-6);
        assert!((decoded.scales[k][0] - 1e-3).abs() < 1e-8);
    }
    reading.encode(&mut decoded);
    assert!((decoded.scales[0][0] + 3.0).abs() < 1e-5);
    decoded.opacities[3] = 0.5;
    let refused = check_stored(&decoded, &reading).unwrap_err().to_string();
    assert!(
        refused.contains("the logarithm of an opacity is 0.5"),
        "{refused}"
    );
}
