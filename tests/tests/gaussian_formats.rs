//! Files in common formats, written by other programs, compared with the results of an independent
//! reader. They are read from the folder given by `SHARP_BENCH_SHARED`; without it, the tests are
//! reported as ignored.

use std::path::Path;

use libtest_mimic::{Arguments, Failed, Trial};
use serde_json::Value;
use sharp::gaussian_files::{load, to_spz_bytes};
use sharp::ply::{
    ColorSpace, GaussianScene, Generator, PlyForm, PlyReason, SplatRenderMode, StoredForm,
    to_bytes, to_compressed_bytes,
};

/// The constant spherical harmonic.
const C0: f64 = 0.282_094_791_773_878_14;

fn main() {
    let folder = sharp_tests::shared_data().join("samples/gaussian_formats");
    let expected = std::fs::read(folder.join("expected.json")).unwrap_or_default();
    let expected: Value = serde_json::from_slice(&expected).unwrap_or_default();
    let mut trials = Vec::new();
    let mut add = |name: String, check: Box<dyn FnOnce() -> Result<(), Failed> + Send>| {
        trials.push(Trial::test(name, check).with_ignored_flag(!folder.is_dir()));
    };
    let samples = expected["files"].as_object().cloned().unwrap_or_default();
    for (name, about) in samples {
        let path = folder.join(&name);
        add(
            format!("sample::{name}"),
            Box::new(move || sample(&path, &about)),
        );
    }
    let variants = expected["ply_variants"]
        .as_object()
        .cloned()
        .unwrap_or_default();
    for (name, about) in variants {
        let path = folder.join("ply_variants").join(&name);
        add(
            format!("variant::{name}"),
            Box::new(move || variant(&path, &name, &about)),
        );
    }
    for name in ["src_d1.ply", "src_d3.ply", "src_d4.ply"] {
        let path = folder.join(name);
        add(
            format!("round_trip::{name}"),
            Box::new(move || round_trips(&path)),
        );
    }
    // Libtest's own check would pass without any sample.
    add("all_samples_are_listed".to_owned(), {
        let count = trials_of(&expected);
        Box::new(move || match count {
            (20.., 12..) => Ok(()),
            few => Err(format!("{few:?} samples").into()),
        })
    });
    libtest_mimic::run(&Arguments::from_args(), trials).exit();
}

fn trials_of(expected: &Value) -> (usize, usize) {
    let of = |key: &str| expected[key].as_object().map_or(0, serde_json::Map::len);
    (of("files"), of("ply_variants"))
}

fn encoded() -> StoredForm {
    StoredForm {
        blending: ColorSpace::Srgb,
        ..StoredForm::default()
    }
}

fn numbers(value: &Value) -> Vec<f64> {
    let all = value.as_array().into_iter().flatten();
    all.filter_map(Value::as_f64).collect()
}

fn near(
    what: &str,
    found: &[f64],
    expected: &[f64],
    tolerance: impl Fn(f64) -> f64,
) -> Result<(), Failed> {
    if found.len() != expected.len() {
        return Err(format!("{what}: {} values, not {}", found.len(), expected.len()).into());
    }
    for (found, expected) in found.iter().zip(expected) {
        // The expected numbers have seven digits.
        let off = (found - expected).abs();
        if off.is_nan() || off > tolerance(*expected) {
            return Err(format!("{what}: {found} where {expected} is expected").into());
        }
    }
    Ok(())
}

fn wide<const N: usize>(values: [f32; N]) -> [f64; N] {
    values.map(f64::from)
}

/// Unit length, the largest component positive.
fn canonical(quaternion: [f32; 4]) -> [f64; 4] {
    let q = wide(quaternion);
    let norm = q.iter().map(|v| v * v).sum::<f64>().sqrt();
    let largest = q.iter().fold(
        0.0_f64,
        |best, v| if v.abs() > best.abs() { *v } else { best },
    );
    q.map(|v| v / norm.copysign(largest))
}

/// All of red's coefficients, then green's, then blue's.
fn channel_major(scene: &GaussianScene, k: usize) -> Vec<f64> {
    let row = scene.gaussians.harmonics.of(k);
    let all = (0..3).flat_map(|channel| row.iter().map(move |c| f64::from(c[channel])));
    all.collect()
}

fn sample(path: &Path, about: &Value) -> Result<(), Failed> {
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    if let Some(format) = [(".ksplat", "KSPLAT"), (".glb", "glTF")]
        .into_iter()
        .find_map(|(end, format)| name.ends_with(end).then_some(format))
    {
        return match load(path, encoded()) {
            Err(error) if error.to_string().contains(format) => Ok(()),
            other => Err(format!("not refused by name: {other:?}").into()),
        };
    }
    let scene = load(path, encoded())?;
    let g = &scene.gaussians;
    let degree = g.harmonics.degree;
    if (g.len(), degree) != (of(&about["count"]), of(&about["sh_degree"])) {
        return Err(format!("{} Gaussians of degree {degree}", g.len()).into());
    }
    let tolerance = &about["tolerance_of_decoding"];
    let within = |key: &str| {
        let bound = match &tolerance[key] {
            Value::String(text) => text.split(':').next().and_then(|text| text.parse().ok()),
            value => value.as_f64(),
        };
        bound.ok_or_else(|| Failed::from(format!("no tolerance {key}")))
    };
    let (logs, turns) = (within("scale_log")?, within("rotation_wxyz")?);
    let (opacities, colors, rest) = (within("opacity")?, within("f_dc")?, within("f_rest")?);
    let rows = about["gaussians"].as_array().into_iter().flatten();
    for row in rows {
        let k = of(&row["index"]);
        let what = |attribute: &str| format!("{attribute} of Gaussian {k}");
        near(
            &what("position"),
            &wide(g.means[k]),
            &numbers(&row["position"]),
            |x| 1e-5 * x.abs() + 1e-6,
        )?;
        let log = wide(g.scales[k]).map(f64::ln);
        near(&what("scale"), &log, &numbers(&row["scale_log"]), |_| logs)?;
        let turn = canonical(g.quaternions[k]);
        near(
            &what("rotation"),
            &turn,
            &numbers(&row["rotation_wxyz"]),
            |_| turns,
        )?;
        let opacity = [row["opacity"].as_f64().unwrap_or(f64::NAN)];
        near(&what("opacity"), &[g.opacities[k].into()], &opacity, |_| {
            opacities
        })?;
        let color = wide(g.colors[k]).map(|c| (c - 0.5) / C0);
        near(&what("colour"), &color, &numbers(&row["f_dc"]), |_| colors)?;
        let harmonics = numbers(&row["f_rest_channel_major"]);
        near(
            &what("harmonics"),
            &channel_major(&scene, k),
            &harmonics,
            |_| rest,
        )?;
    }
    let is_spz = name.ends_with(".spz");
    let has = |about: &str| scene.doubts.iter().any(|doubt| doubt.about == about);
    if has("axes") != is_spz {
        return Err(format!("axes: {:?}", scene.doubts).into());
    }
    let is_antialiased = path.to_string_lossy().contains("_aa");
    if (scene.marks.antialiased == Some(true)) != is_antialiased {
        return Err(format!("{:?}", scene.marks).into());
    }
    Ok(())
}

fn of(value: &Value) -> usize {
    value.as_u64().map_or(usize::MAX, |v| v as usize)
}

/// Checks that each wrong file causes a warning that names the mistake. For correct files, checks
/// the marks.
fn variant(path: &Path, name: &str, about: &Value) -> Result<(), Failed> {
    let read = load(path, encoded());
    if name == "two_scales.ply" {
        return match read.map_err(|error| error.reason) {
            Err(PlyReason::OtherForm(form)) if form.contains("2D Gaussian") => Ok(()),
            other => Err(format!("{other:?}").into()),
        };
    }
    let scene = read?;
    let marks = scene.marks;
    let generator = match name {
        "brush_mip.ply" => Generator::Brush,
        "nerfstudio_rgb.ply" => Generator::Nerfstudio,
        "permuted_double_extra.ply" => Generator::GsplatLike,
        _ => Generator::InriaLike,
    };
    let mode = (name == "brush_mip.ply").then_some(SplatRenderMode::Mip);
    let is_antialiased = matches!(name, "brush_mip.ply" | "postshot_aa.ply");
    let facts = (
        marks.generator,
        marks.mode,
        marks.antialiased == Some(true),
        marks.has_filter_3d,
    );
    if facts
        != (
            Some(generator),
            mode,
            is_antialiased,
            name == "mip_filter_3D.ply",
        )
    {
        return Err(format!("{marks:?}").into());
    }
    let doubt = match name {
        "wrong_opacity_linear.ply" => Some("opacity=linear"),
        "wrong_scale_linear.ply" => Some("scales=linear"),
        "wrong_rot_xyzw_identity.ply" => Some("quaternions"),
        "wrong_f_dc_rgb01.ply" => Some("colors=rgb01"),
        _ => None,
    };
    let doubts: Vec<&str> = scene.doubts.iter().map(|doubt| doubt.about).collect();
    if doubts != Vec::from_iter(doubt) {
        return Err(format!("{:?}", scene.doubts).into());
    }
    if scene.gaussians.len() != of(&about["count"]) {
        return Err(format!("{} Gaussians", scene.gaussians.len()).into());
    }
    let is_wrong = |attribute: &str| name.starts_with("wrong_") && name.contains(attribute);
    let first = &about["first_three"];
    let g = &scene.gaussians;
    let relative = |x: f64| 1e-6 * x.abs() + 1e-6;
    for k in 0..3 {
        near(
            "position",
            &wide(g.means[k]),
            &numbers(&first["xyz"][k]),
            relative,
        )?;
        let scales = match about["folded_first_three"]["scale_linear"].get(k) {
            Some(folded) => numbers(folded),
            None => numbers(&first["scale"][k])
                .into_iter()
                .map(f64::exp)
                .collect(),
        };
        if !is_wrong("scale") {
            near("scale", &wide(g.scales[k]), &scales, |x| 2e-6 * x)?;
        }
        let opacity = match about["folded_first_three"]["opacity"][k].as_f64() {
            Some(folded) => folded,
            None => 1.0 / (1.0 + (-numbers(&first["opacity"][k])[0]).exp()),
        };
        if !is_wrong("opacity") {
            near("opacity", &[g.opacities[k].into()], &[opacity], relative)?;
        }
        if !is_wrong("rot") {
            near(
                "rotation",
                &wide(g.quaternions[k]),
                &numbers(&first["rot"][k]),
                relative,
            )?;
        }
        let colors = match about["rgb_first_three"].get(k) {
            Some(bytes) => numbers(bytes).into_iter().map(|b| b / 255.0).collect(),
            None => numbers(&first["f_dc"][k])
                .into_iter()
                .map(|c| c * C0 + 0.5)
                .collect::<Vec<_>>(),
        };
        if !is_wrong("f_dc") {
            near("colour", &wide(g.colors[k]), &colors, relative)?;
        }
        if name != "nerfstudio_rgb.ply" {
            near(
                "harmonics",
                &channel_major(&scene, k),
                &numbers(&first["f_rest"][k]),
                relative,
            )?;
        }
    }
    Ok(())
}

/// The loss of each writer stays within the bounds of its format. Rows keep their order, except in
/// compressed PLY, where Gaussians are matched by the nearest centre.
fn round_trips(path: &Path) -> Result<(), Failed> {
    let mut scene = load(path, encoded())?;
    // Values that every format can store.
    let (g, degree) = (&scene.gaussians, scene.gaussians.harmonics.degree);
    let holds = |k: usize| {
        let rest = g.harmonics.of(k).as_flattened();
        let log = |s: &f32| (-9.9..5.9).contains(&s.ln());
        rest.iter().all(|c| (-0.99..0.99).contains(c))
            && g.scales[k].iter().all(log)
            && g.colors[k].iter().all(|c| (-0.4..1.4).contains(c))
    };
    scene.gaussians = g.filtered(holds);
    if scene.gaussians.len() < 100 {
        return Err(format!("only {} rows", scene.gaussians.len()).into());
    }
    let folder = tempfile::tempdir()?;
    let written = |name: &str, bytes: &[u8]| -> Result<GaussianScene, Failed> {
        let path = folder.path().join(name);
        std::fs::write(&path, bytes)?;
        let read = load(&path, encoded())?;
        let (found, kept) = (read.gaussians.len(), scene.gaussians.len());
        if found == kept && read.gaussians.harmonics.degree == degree {
            Ok(read)
        } else {
            Err(format!("{name}: {found} of {kept}").into())
        }
    };
    let plain = written("plain.ply", &to_bytes(&scene, PlyForm::Plain))?;
    if plain.marks != scene.marks {
        return Err(format!("{:?}", plain.marks).into());
    }
    compare(&scene, &plain, [1e-9, 2e-7, 2e-6, 2e-6, 1e-6, 1e-7])?;
    let spz = written("scene.spz", &to_spz_bytes(&scene)?)?;
    let turned = GaussianScene {
        gaussians: spz.gaussians.clone().flipped([1.0, -1.0, -1.0]),
        ..spz
    };
    compare(
        &scene,
        &turned,
        [
            1.23e-4,
            1.5e-3,
            0.0314,
            0.5 / 255.0 + 1e-6,
            0.0132 * C0,
            0.5 / 128.0 + 1e-6,
        ],
    )?;
    let compressed = written("scene.ply", &to_compressed_bytes(&scene))?;
    let g = &compressed.gaussians;
    let nearest = |mean: &[f32; 3]| {
        let far = |k: &usize| {
            (0..3)
                .map(|axis| (g.means[*k][axis] - mean[axis]).powi(2))
                .sum::<f32>()
        };
        (0..g.len())
            .min_by(|a, b| far(a).total_cmp(&far(b)))
            .unwrap_or_default()
    };
    let order: Vec<usize> = scene.gaussians.means.iter().map(nearest).collect();
    let ordered = GaussianScene {
        gaussians: g.subset(&order),
        ..compressed.clone()
    };
    // Bounds from the samples that splat-transform wrote of the same scenes, except for opacity and
    // harmonics.
    compare(
        &scene,
        &ordered,
        [
            0.007,
            1.3e-3,
            0.0042,
            0.5 / 255.0 + 1e-6,
            0.5 / 255.0 * 2.0,
            1.0 / 64.0 + 1e-6,
        ],
    )
}

/// Bounds of positions, unit quaternions, log scales, opacities, colours and harmonics.
fn compare(a: &GaussianScene, b: &GaussianScene, bounds: [f64; 6]) -> Result<(), Failed> {
    let (own, other) = (&a.gaussians, &b.gaussians);
    let [position, turn, log, opacity, color, rest] = bounds;
    for k in 0..own.len() {
        near(
            "position",
            &wide(other.means[k]),
            &wide(own.means[k]),
            |_| position,
        )?;
        let [p, q] = [own, other].map(|g| canonical(g.quaternions[k]));
        let same = p.iter().zip(q).map(|(x, y)| x * y).sum::<f64>();
        near("rotation", &q.map(|v| v * same.signum()), &p, |_| turn)?;
        let [s, t] = [own, other].map(|g| wide(g.scales[k]).map(f64::ln));
        near("scale", &t, &s, |_| log)?;
        near(
            "opacity",
            &[other.opacities[k].into()],
            &[own.opacities[k].into()],
            |_| opacity,
        )?;
        near(
            "colour",
            &wide(other.colors[k]),
            &wide(own.colors[k]),
            |_| color,
        )?;
        near(
            "harmonics",
            &channel_major(b, k),
            &channel_major(a, k),
            |_| rest,
        )?;
    }
    Ok(())
}
