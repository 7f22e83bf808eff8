//! Real posed pictures that may not be redistributed. They are read from the folder given by the
//! environment variable `SHARP_BENCH_SHARED` (default `../shared` next to the checkout); without
//! it, the tests are reported as ignored.

#![allow(clippy::unwrap_used, reason = "test code outside of #[test] functions")]

mod published;

use std::path::Path;

use glam::{DVec2, DVec3};
use libtest_mimic::{Arguments, Failed, Trial};
use sharp_datasets::check::advice::Units;
use sharp_datasets::format::colmap;
use sharp_datasets::{DatasetSpec, Scene, View, open};

type Outcome = Result<(), Failed>;

fn main() {
    let arguments = Arguments::from_args();
    let trials = [
        trial("posed_rgbd_pair", rgbd_pair),
        trial("posed_rgb_rmvd", rgb_sequence),
        trial("colmap_text/unsorted_colmap", unsorted_model),
        trial("colmap_text/palace_root", palace_model),
        trial("colmap_text/crane_mast_8imgs_colmap_output", crane_model),
        trial("middlebury_eval3_q", published::middeval3),
        trial("real/middlebury_2014", published::calibrations_of_2014),
        trial("real/middlebury_2021", published::calibrations_of_2021),
        trial("real/eth3d", published::eth3d),
        trial("real/tanks_and_temples", published::tanks_and_temples),
        trial("real/booster", published::booster),
        trial("real/scannetpp", published::scannetpp),
    ];
    let proper = [
        ("middlebury", "middlebury"),
        ("middlebury", "middlebury_eval3_q"),
        ("booster", "booster"),
        ("nerfstudio", "posed_rgbd_pair"),
        ("nerfstudio", "posed_rgb_rmvd"),
    ];
    let proper = proper.map(|(format, name)| {
        let folder = sharp_tests::shared_data().join("samples").join(name);
        let absent = !folder.is_dir();
        let name = format!("{name} contradicts nothing");
        Trial::test(name, move || contradicts_nothing(format, &folder)).with_ignored_flag(absent)
    });
    let trials = trials.into_iter().chain(proper).collect();
    libtest_mimic::run(&arguments, trials).exit();
}

fn trial(name: &'static str, test: fn(&Path) -> Outcome) -> Trial {
    let shared = sharp_tests::shared_data();
    let folder = shared.join("samples").join(name);
    let absent = !folder.is_dir();
    Trial::test(name, move || test(&folder)).with_ignored_flag(absent)
}

fn check(holds: bool, what: impl Fn() -> String) -> Outcome {
    if holds { Ok(()) } else { Err(what().into()) }
}

fn read(folder: &Path) -> Result<Scene, Failed> {
    let spec = DatasetSpec::parse(&format!("nerfstudio={}", folder.display()))?;
    let scene = open(&spec)?.remove(0);
    let said = || format!("{:?} {:?}", scene.warnings, scene.notes);
    let doubts = |note: &String| note.contains("EXIF") || note.contains("colour profile");
    let is_silent = scene.warnings.is_empty() && !scene.notes.iter().any(doubts);
    check(is_silent, said)?;
    Ok(scene)
}

/// Neither the quick check before a run nor the thorough check finds problems in real data.
fn contradicts_nothing(format: &str, folder: &Path) -> Outcome {
    let spec = DatasetSpec::parse(&format!("{format}={}", folder.display()))?;
    let report = sharp_datasets::check::check(&spec, 2, &|_, _| {})?;
    check(report.problems == 0, || format!("{:?}", report.scenes))?;
    for scene in open(&spec)? {
        let found = sharp_datasets::check::contradictions(&scene, Units::of(&spec));
        check(found.is_empty(), || format!("{}: {found:?}", scene.id))?;
    }
    Ok(())
}

/// Each view is predicted from the other by its own depth and the two poses. PSNR over both is 41.7
/// dB if every convention (axes, pixel centres, millimetres, direction of the pose) is read as it
/// was written, and 20 dB if the pose is inverted.
fn rgbd_pair(folder: &Path) -> Outcome {
    let scene = read(folder)?;
    let ids: Vec<_> = scene.views.iter().map(|v| v.id.as_str()).collect();
    check(ids == ["a", "b"], || format!("{ids:?}"))?;
    let (a, b) = (&scene.views[0], &scene.views[1]);
    let all = |_, _| true;
    let there = reprojection_error(a, b, &all);
    let back = reprojection_error(b, a, &all);
    let mse = (there.0 + back.0) / (there.1 + back.1);
    let value = 10.0 * (255.0 * 255.0 / mse).log10();
    check((value - 41.7).abs() < 0.05, || format!("{value} dB"))
}

/// Sum of squared errors and number of samples over the pixels of `a` that satisfy `keep`.
fn reprojection_error(a: &View, b: &View, keep: &dyn Fn(u32, u32) -> bool) -> (f64, f64) {
    let (image, other) = (a.content.image().unwrap(), b.content.image().unwrap());
    let depth = a.content.depth().unwrap().unwrap();
    let b_from_a = b.camera_from_world.after(&a.camera_from_world.inverse());
    let (mut sum, mut count) = (0.0, 0.0);
    let kept = depth.enumerate_pixels();
    for (x, y, z) in kept.filter(|(x, y, z)| z.0[0] > 0.0 && keep(*x, *y)) {
        let center = DVec2::new(f64::from(x) + 0.5, f64::from(y) + 0.5);
        let point = b_from_a.apply(a.intrinsics.unproject(center, f64::from(z.0[0])));
        let Some(p) = b.intrinsics.project(point).map(|p| p - 0.5) else {
            continue;
        };
        let (w, h) = (f64::from(other.width()), f64::from(other.height()));
        if p.x < 0.0 || p.y < 0.0 || p.x >= w - 1.0 || p.y >= h - 1.0 {
            continue;
        }
        let (u, v) = (p.x as u32, p.y as u32);
        let blend = p - p.floor();
        for c in 0..3 {
            let at = |u, v| f64::from(other.get_pixel(u, v).0[c]);
            let value = (at(u, v) * (1.0 - blend.x) + at(u + 1, v) * blend.x) * (1.0 - blend.y)
                + (at(u, v + 1) * (1.0 - blend.x) + at(u + 1, v + 1) * blend.x) * blend.y;
            sum += (value - f64::from(image.get_pixel(x, y).0[c])).powi(2);
            count += 1.0;
        }
    }
    (sum, count)
}

fn rgb_sequence(folder: &Path) -> Outcome {
    let scene = read(folder)?;
    check(scene.views.len() == 7, || format!("{}", scene.views.len()))?;
    for view in &scene.views {
        check(view.content.depth()?.is_none(), || "depth".into())?;
        let size = view.content.image()?.dimensions();
        assert_eq!(size, (1280, 720), "{}", view.id);
    }
    check(scene.views[6].id == "006", || scene.views[6].id.clone())
}

/// Ids 100, 200 and 300, names in another order, one camera each.
fn unsorted_model(folder: &Path) -> Outcome {
    let model = colmap::read_model(folder)?;
    let found: Vec<_> = model
        .images
        .iter()
        .map(|i| (i.id, i.name.as_str(), model.cameras[&i.camera_id].size.0))
        .collect();
    let expected = [
        (100, "bbb.jpg", 4056),
        (200, "ccc.jpg", 800),
        (300, "aaa.jpg", 1024),
    ];
    check(found == expected, || format!("{found:?}"))?;
    let points = colmap::read_points(folder)?.ok_or("no points")?.1;
    assert_eq!(points[0].seen_by, [100, 200, 300]);
    Ok(())
}

/// A model with a camera of id 0. Its points must lie in front of the cameras that see them.
fn palace_model(folder: &Path) -> Outcome {
    let model = colmap::read_model(folder)?;
    assert_eq!(model.images.len(), 11);
    check(model.cameras.contains_key(&0), || "no camera 0".into())?;
    let points = colmap::read_points(folder)?.ok_or("no points")?.1;
    let (mut in_front, mut seen) = (0, 0);
    for point in &points {
        for image in model
            .images
            .iter()
            .filter(|i| point.seen_by.contains(&i.id))
        {
            let pose = image.camera_from_world.ok_or("no pose")?;
            let camera: DVec3 = pose.apply(point.position);
            seen += 1;
            in_front += u32::from(camera.z > 0.0);
        }
    }
    check(seen > 500, || format!("{seen}"))?;
    check(in_front * 100 >= seen * 99, || {
        format!("{in_front} of {seen}")
    })
}

fn crane_model(folder: &Path) -> Outcome {
    let model = colmap::read_model(folder)?;
    assert_eq!(model.images.len(), 8);
    let lens = model.cameras[&1].lens()?;
    check(!lens.is_pinhole(), || "k was lost".into())
}
