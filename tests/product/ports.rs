//! `parity --port`: Gaussians of a port compared with those of the release.

use std::path::Path;

use serde_json::Value;
use sharp::gaussian_files::load;
use sharp::gaussians::Gaussians;
use sharp::ply::{ColorSpace, GaussianScene, PlyForm, StoredForm, to_bytes};

use crate::support::{Said, sharp_bench};
use crate::tiny::{golden, recorded_input, tiny};

/// Number of Gaussians in the recorded prediction: two layers of 96×96.
const COUNT: usize = 18_432;
const SIDE: usize = 96;

fn release() -> GaussianScene {
    let reading = StoredForm {
        blending: ColorSpace::Srgb,
        ..StoredForm::default()
    };
    load(Path::new(&golden("tiny_golden.ply")), reading).unwrap()
}

fn parity(dir: &Path, port: &GaussianScene, more: &[&str]) -> Said {
    std::fs::write(dir.join("port.ply"), to_bytes(port, PlyForm::Plain)).unwrap();
    let reference = golden("tiny_golden.ply");
    let args = ["parity", "--port", "port.ply", "--against", &reference];
    sharp_bench(dir, &[&args[..], more].concat())
}

fn with(change: impl Fn(&mut Gaussians)) -> GaussianScene {
    let mut scene = release();
    change(&mut scene.gaussians);
    scene
}

#[test]
fn the_same_gaussians_pass_and_the_differences_have_units() {
    let dir = tempfile::tempdir().unwrap();
    let said = parity(dir.path(), &release(), &[]).ends_with(0);
    assert!(
        said.out.contains(
            "18432 Gaussians (18432 in the reference), in the same order; 0 extra, 0 missing"
        ),
        "{}",
        said.out
    );
    // All Gaussians are moved by a pixel to the right, 2 % wider, and more opaque by 0.01.
    let changed = with(|g| {
        for k in 0..g.len() {
            let [_, _, z] = g.means[k];
            g.means[k][0] += z / 500.0;
            g.scales[k] = g.scales[k].map(|s| s * 1.02_f32);
            g.opacities[k] = (g.opacities[k] + 0.01).min(0.999);
        }
    });
    let said = parity(dir.path(), &changed, &["--json", "--tolerance", "10"]).ends_with(0);
    let found: Value = serde_json::from_str(&said.out).unwrap();
    let medians: Vec<f64> = (0..5)
        .map(|field| found["as_read"][field]["median"].as_f64().unwrap())
        .collect();
    for (found, expected) in medians.iter().zip([1.0, 0.0, 4.04, 1.0, 0.0]) {
        assert!((found - expected).abs() < 0.02, "{medians:?}");
    }
    assert_eq!(found["settings"], serde_json::json!([["shift", "-1:0"]]));
    let said = parity(dir.path(), &changed, &[]).ends_with(1);
    for part in ["covariance", "`shift=-1:0` explains most of the difference"] {
        assert!(said.err.contains(part), "{}", said.err);
    }
}

#[test]
fn usual_differences_are_named_by_the_setting_that_explains_them() {
    let dir = tempfile::tempdir().unwrap();
    let logistic = |x: f32| 1.0 / (1.0 + (-x).exp());
    for (name, port) in [
        (
            "axes=rub",
            with(|g| {
                g.means.iter_mut().for_each(|m| *m = [m[0], -m[1], -m[2]]);
                g.quaternions
                    .iter_mut()
                    .for_each(|q| *q = [q[0], q[1], -q[2], -q[3]]);
            }),
        ),
        (
            "quaternions=xyzw",
            with(|g| g.quaternions.iter_mut().for_each(|q| q.rotate_left(1))),
        ),
        (
            "scales=linear",
            with(|g| g.scales.iter_mut().for_each(|s| *s = s.map(f32::exp))),
        ),
        (
            "opacity=linear",
            with(|g| g.opacities.iter_mut().for_each(|o| *o = logistic(*o))),
        ),
        (
            "channels=bgr",
            with(|g| g.colors.iter_mut().for_each(|c| c.reverse())),
        ),
        (
            "color_space=linear",
            with(|g| {
                let linear = sharp::color::linear_from_srgb;
                g.colors.iter_mut().for_each(|c| *c = c.map(linear));
            }),
        ),
        (
            "scale=0.001",
            with(|g| {
                g.means.iter_mut().for_each(|m| *m = m.map(|v| v * 1000.0));
                g.scales.iter_mut().for_each(|s| *s = s.map(|v| v * 1000.0));
            }),
        ),
    ] {
        let said = parity(dir.path(), &port, &[]).ends_with(1);
        assert!(
            said.err
                .contains(&format!("`{name}` explains most of the difference")),
            "{name}: {}{}",
            said.out,
            said.err
        );
    }
}

#[test]
fn another_order_is_named_and_gaussians_left_out_are_counted() {
    let dir = tempfile::tempdir().unwrap();
    let columns_first = |i: usize| {
        let (layer, rest) = (i / (SIDE * SIDE), i % (SIDE * SIDE));
        layer * SIDE * SIDE + rest % SIDE * SIDE + rest / SIDE
    };
    let side_by_side = |i: usize| i % 2 * (COUNT / 2) + i / 2;
    let shuffled = |i: usize| i * 4099 % COUNT;
    let of = |place: &dyn Fn(usize) -> usize| {
        let places: Vec<usize> = (0..COUNT).map(place).collect();
        GaussianScene {
            gaussians: release().gaussians.subset(&places),
            ..release()
        }
    };
    for (name, port) in [
        ("columns before rows", of(&columns_first)),
        ("both layers of a pixel side by side", of(&side_by_side)),
        ("another order, matched by position", of(&shuffled)),
    ] {
        let said = parity(dir.path(), &port, &[]).ends_with(0);
        assert!(said.out.contains(name), "{name}: {}", said.out);
    }
    // A port that drops nearly invisible Gaussians, and one that adds Gaussians.
    let mut fewer = release();
    let visible = fewer.gaussians.opacities.clone();
    fewer.gaussians = fewer.gaussians.filtered(|k| visible[k] > 0.2);
    let kept = fewer.gaussians.len();
    assert!(kept < COUNT && kept > COUNT / 2, "{kept}");
    let said = parity(dir.path(), &fewer, &[]);
    assert!(
        said.out.contains(&format!(
            "{kept} Gaussians ({COUNT} in the reference), in another order, matched by position; 0 extra, {} missing",
            COUNT - kept
        )),
        "{}",
        said.out
    );
}

#[test]
fn doubled_and_broken_gaussians_are_counted() {
    let dir = tempfile::tempdir().unwrap();
    let twice: Vec<usize> = (0..2 * COUNT).map(|i| i % COUNT).collect();
    let doubled = GaussianScene {
        gaussians: release().gaussians.subset(&twice),
        ..release()
    };
    let broken = with(|g| g.means[7][1] = f32::NAN);
    let far = with(|g| g.means.iter_mut().for_each(|m| m[2] += 0.02));
    for (port, said) in [
        (
            doubled,
            "18432 Gaussians without a counterpart in the reference",
        ),
        (broken, "1 Gaussians not finite"),
        // Gaussians that are far off, but in order, are not reported as reordered.
        (far, "depth"),
    ] {
        let found = parity(dir.path(), &port, &[]).ends_with(1);
        assert!(
            found.err.contains(said),
            "{said}: {}{}",
            found.out,
            found.err
        );
    }
}

#[test]
fn a_network_is_the_reference_where_none_is_given() {
    let dir = tempfile::tempdir().unwrap();
    let (image, focal) = recorded_input();
    let port = golden("tiny_golden.ply");
    let model = tiny();
    let mut args = vec![
        "parity",
        "--port",
        &port,
        "--image",
        &image,
        "--focal-px",
        &focal,
    ];
    args.extend(model.iter().map(String::as_str));
    sharp_bench(dir.path(), &args).ends_with(0);
    sharp_bench(
        dir.path(),
        &["parity", "--port", "gone.ply", "--image", &image],
    )
    .is_error_with(&["gone.ply"]);
    sharp_bench(dir.path(), &["parity", "--port", &port]).ends_with(2);
}
