//! Files as their authors publish them: calibrations, models, logs and lists.

use std::collections::BTreeSet;
use std::path::Path;

use glam::DVec2;
use sharp_datasets::format::{calib, colmap, read_map, trajectory};
use sharp_datasets::{DatasetSpec, Pairing, Scene, open_each};

use super::{Outcome, check, reprojection_error};

fn open(spec: &str, folder: &Path) -> Result<Vec<Scene>, libtest_mimic::Failed> {
    let (format, settings) = spec.split_once(',').unwrap_or((spec, ""));
    let comma = if settings.is_empty() { "" } else { "," };
    let text = format!("{format}={}{comma}{settings}", folder.display());
    let found = open_each(&DatasetSpec::parse(&text)?)?;
    match found.left_out.iter().find(|scene| scene.why.is_fault()) {
        Some(scene) => Err(format!("{}: {}", scene.id, scene.why).into()),
        None => Ok(found.scenes),
    }
}

/// The number after `key=` and an opening bracket, with any blanks between them.
fn number(text: &str, key: &str) -> f64 {
    let line = text
        .lines()
        .find_map(|line| line.trim().strip_prefix(key))
        .unwrap();
    let value = line.trim_start_matches(['=', '[', ' ']);
    value
        .split([' ', ';', ']'])
        .next()
        .unwrap()
        .parse()
        .unwrap()
}

/// All 15 training scenes at a quarter of their size, from calibrations with stray blanks. Depth
/// must follow the published formula and warp the right picture onto the left one: with a few dB if
/// exposure or lighting differ (E, L), and always far better than without depth.
pub(super) fn middeval3(folder: &Path) -> Outcome {
    let scenes = open("middlebury", folder)?;
    check(scenes.len() == 15, || format!("{} scenes", scenes.len()))?;
    assert_eq!(open("middlebury,scenes=training15", folder)?.len(), 15);
    for scene in &scenes {
        let text = std::fs::read_to_string(folder.join(&scene.id).join("calib.txt"))?;
        let [focal, doffs] = ["cam0", "doffs"].map(|key| number(&text, key));
        let baseline_m = number(&text, "baseline") / 1000.0;
        let size = ["width", "height"].map(|key| number(&text, key) as u32);
        let pairing = Pairing::Stereo {
            source: 0,
            target: 1,
        };
        check(scene.pairing == pairing, || scene.id.clone())?;
        let (left, right) = (&scene.views[0], &scene.views[1]);
        for view in [left, right] {
            let k = view.intrinsics;
            let read = ([k.width, k.height], k.fx, k.fy);
            assert_eq!(read, (size, focal, focal), "{}", scene.id);
            let image = view.content.image()?;
            check([image.width(), image.height()] == size, || scene.id.clone())?;
        }
        let shift = right.intrinsics.cx - left.intrinsics.cx;
        check((shift - doffs).abs() < 0.0011, || {
            format!("{}: {shift}", scene.id)
        })?;
        let centre = right.camera_from_world.camera_center();
        assert_eq!(centre, glam::DVec3::X * baseline_m, "{}", scene.id);

        let disparity = read_map(&folder.join(&scene.id).join("disp0GT.pfm"))?;
        let depth = left.content.depth()?.ok_or("no depth")?;
        let mut known = 0;
        for (z, d) in depth.iter().zip(disparity.iter()) {
            assert_eq!(*z > 0.0, d.is_finite(), "{}", scene.id);
            if d.is_finite() {
                known += 1;
                let expected = baseline_m * focal / (f64::from(*d) + doffs);
                let error = (f64::from(*z) / expected - 1.0).abs();
                check(error < 1e-6, || {
                    format!("{}: {z} instead of {expected}", scene.id)
                })?;
            }
        }
        check(2 * known > depth.len(), || format!("{}: {known}", scene.id))?;
        let db = |(sum, count): (f64, f64)| 10.0 * (255.0 * 255.0 * count / sum).log10();
        let mask = image::open(folder.join(&scene.id).join("mask0nocc.png"))?.into_luma8();
        let seen_by_both = |x, y| mask.get_pixel(x, y).0[0] == 255;
        let warped = db(reprojection_error(left, right, &seen_by_both));
        let (a, b) = (left.content.image()?, right.content.image()?);
        let squares = a.iter().zip(b.iter());
        let squares = squares.map(|(p, q)| f64::from(p.abs_diff(*q)).powi(2));
        let unwarped = db((squares.sum(), a.len() as f64));
        check((15.0..35.0).contains(&warped), || {
            format!("{}: {warped} dB", scene.id)
        })?;
        check(warped > unwarped + 2.0, || {
            format!("{}: {warped} dB, and {unwarped} without depth", scene.id)
        })?;
    }
    Ok(())
}

/// Motorcycle-perfect at full size: focal length, offset and baseline as stated by Middlebury.
pub(super) fn calibrations_of_2014(folder: &Path) -> Outcome {
    let text = std::fs::read_to_string(folder.join("Motorcycle_perfect_F/calib.txt"))?;
    let rig = calib::parse(&text)?;
    let read = (rig.focal, rig.doffs, rig.baseline_m, rig.size);
    let expected = (3979.911, 124.343, 0.193_001, Some((2964, 2000)));
    check(read == expected, || format!("{read:?}"))
}

/// The mobile set: no offset, and a principal point far left of the picture.
pub(super) fn calibrations_of_2021(folder: &Path) -> Outcome {
    for scene in ["curule", "octagon", "pendulum"] {
        let text = std::fs::read_to_string(folder.join(scene).join("calib.txt"))?;
        let rig = calib::parse(&text)?;
        let read = (rig.focal, rig.baseline_m, rig.doffs, rig.size);
        let baseline_m = number(&text, "baseline") / 1000.0;
        let expected = (number(&text, "cam0"), baseline_m, 0.0, Some((1920, 1080)));
        check(read == expected, || format!("{scene}: {read:?}"))?;
    }
    // The other scenes are here without their pictures.
    let found = open_each(&DatasetSpec::parse(&format!(
        "middlebury={}",
        folder.display()
    ))?)?;
    let left_out: Vec<&str> = found
        .left_out
        .iter()
        .map(|scene| scene.id.as_str())
        .collect();
    assert_eq!(left_out, ["curule", "octagon"]);
    let view = &found.scenes[0].views[0];
    assert_eq!(view.intrinsics.cx, -364.24 + 0.5);
    let size = view.content.image()?.dimensions();
    check(size == (1920, 1080), || format!("{size:?}"))
}

/// The models of the undistorted pictures: every observation is where its camera sees the point.
/// COLMAP keeps observations with errors of up to 4 pixels.
pub(super) fn eth3d(folder: &Path) -> Outcome {
    const MAX_PX: f64 = 4.0;
    let set = tempfile::tempdir()?;
    let mut views = 0;
    for scene in ["office", "pipes", "relief_2"] {
        let model = colmap::read_model(&folder.join(scene))?;
        let (_, points) = colmap::read_points(&folder.join(scene))?.ok_or("no points")?;
        let at = set.path().join(scene);
        let calibration = at.join("dslr_calibration_undistorted");
        std::fs::create_dir_all(&calibration)?;
        for name in ["cameras.txt", "images.txt"] {
            std::fs::copy(folder.join(scene).join(name), calibration.join(name))?;
        }
        for image in &model.images {
            let picture = at.join("images").join(&image.name);
            std::fs::create_dir_all(picture.parent().unwrap())?;
            std::fs::write(picture, "")?;
        }
        views += model.images.len();
        let text = std::fs::read_to_string(folder.join(scene).join("images.txt"))?;
        let lines: Vec<&str> = text.lines().filter(|line| !line.starts_with('#')).collect();
        let by_id: std::collections::BTreeMap<_, _> =
            model.images.iter().map(|i| (i.id, i)).collect();
        let positions = observed_points(&folder.join(scene).join("points3D.txt"))?;
        assert_eq!(positions.len(), points.len(), "{scene}");
        let (mut close, mut all) = (0_u32, 0_u32);
        for pair in lines.chunks(2) {
            let id: u32 = pair[0].split(' ').next().unwrap().parse()?;
            let image = by_id[&id];
            let lens = model.cameras[&image.camera_id].lens()?;
            let pose = image.camera_from_world.ok_or("no pose")?;
            let numbers: Vec<f64> = pair[1]
                .split_whitespace()
                .map(str::parse)
                .collect::<Result<_, _>>()?;
            for observation in numbers.chunks(3).filter(|o| o[2] >= 0.0) {
                let Some(point) = positions.get(&(observation[2] as u64)) else {
                    continue;
                };
                all += 1;
                let seen = DVec2::new(observation[0], observation[1]);
                let found = lens.project(pose.apply(*point));
                close += u32::from(found.is_some_and(|p| p.distance(seen) < MAX_PX));
            }
        }
        check(
            all > 3000 && f64::from(close) > 0.99 * f64::from(all),
            || format!("{scene}: {close} of {all}"),
        )?;
    }
    let scenes = open("eth3d,images=undistorted", set.path())?;
    let read: usize = scenes.iter().map(|scene| scene.views.len()).sum();
    assert_eq!((scenes.len(), read), (3, views));
    let sizes: Vec<_> = scenes.iter().map(|s| s.views[0].intrinsics).collect();
    let sizes: Vec<_> = sizes
        .iter()
        .map(|k| (k.width, k.height, k.fx, k.cy))
        .collect();
    let expected = [
        (6221, 4146, 3437.84, 2066.98),
        (6220, 4141, 3430.27, 2057.75),
        (6212, 4139, 3413.07, 2064.52),
    ];
    check(sizes == expected, || format!("{sizes:?}"))
}

/// Positions by the points' ids, which the reader does not keep.
fn observed_points(
    file: &Path,
) -> Result<std::collections::BTreeMap<u64, glam::DVec3>, libtest_mimic::Failed> {
    let text = std::fs::read_to_string(file)?;
    let lines = text.lines().filter(|line| !line.starts_with('#'));
    lines
        .map(|line| {
            let mut words = line.split(' ');
            let id = words.next().unwrap_or_default().parse()?;
            let mut next = || words.next().unwrap_or_default().parse::<f64>();
            Ok((id, glam::DVec3::new(next()?, next()?, next()?)))
        })
        .collect()
}

/// Barn's log, alignment and first three pictures: metric baselines, and a focal length that was
/// never published and is only assumed on request.
pub(super) fn tanks_and_temples(folder: &Path) -> Outcome {
    let text = std::fs::read_to_string(folder.join("isl-org_test_data/test.log"))?;
    let log = trajectory::parse_log(&text)?;
    let valid = log
        .poses
        .iter()
        .filter(|pose| pose.world_from_camera.is_ok())
        .count();
    let counts = (log.blocks.len(), log.blocks.last(), valid);
    check(counts == (151, Some(&150), 151), || format!("{counts:?}"))?;
    let barn = folder.join("Barn_gtsfm");
    let refused = open("tanks-and-temples", &barn).unwrap_err();
    let refused = refused.message().unwrap_or_default().to_owned();
    check(refused.contains("intrinsics=0.7w"), || refused.clone())?;
    let scenes = open("tanks-and-temples,intrinsics=0.6w", &barn)?;
    let views = &scenes[0].views;
    let ids: Vec<&str> = views.iter().map(|view| view.id.as_str()).collect();
    check(ids == ["000001", "000002", "000003"], || format!("{ids:?}"))?;
    let k = views[0].intrinsics;
    let read = (k.width, k.height, k.fx, k.cx, k.cy);
    assert_eq!(read, (1920, 1080, 1152.0, 960.0, 540.0));
    let centres: Vec<_> = views
        .iter()
        .map(|v| v.camera_from_world.camera_center())
        .collect();
    for (other, expected) in [(1, 0.385), (2, 0.812)] {
        let baseline = centres[0].distance(centres[other]);
        check((baseline - expected).abs() < 5e-4, || {
            format!("{baseline} m")
        })?;
    }
    let left_out = scenes[0].left_out.iter().map(|group| group.views.len());
    assert_eq!(left_out.sum::<usize>(), 407);
    Ok(())
}

/// The published list of the training set: 228 pairs of 38 scenes.
pub(super) fn booster(folder: &Path) -> Outcome {
    let list = std::fs::read_to_string(folder.join("train_stereo.txt"))?;
    let set = tempfile::tempdir()?;
    let fixture =
        Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/datasets/booster/train/balanced/A");
    let balanced = set.path().join("train/balanced");
    let mut expected = BTreeSet::new();
    for line in list.lines() {
        let names: Vec<&str> = line.split(' ').collect();
        let [picture, map, calibration] = names[..] else {
            return Err(line.into());
        };
        for (name, from) in [
            (picture.to_owned(), "camera_00/im0.png"),
            (
                picture.replace("camera_00", "camera_02"),
                "camera_02/im0.png",
            ),
            (map.to_owned(), "disp_00.npy"),
            (calibration.to_owned(), "calib_00-02.xml"),
        ] {
            let target = balanced.join(name);
            std::fs::create_dir_all(target.parent().unwrap())?;
            std::fs::copy(fixture.join(from), target)?;
        }
        expected.insert(format!(
            "train/balanced/{}",
            picture.replace("camera_00/", "").replace(".png", "")
        ));
    }
    let scenes = open("booster", set.path())?;
    let found: BTreeSet<String> = scenes.iter().map(|scene| scene.id.clone()).collect();
    check(found == expected && found.len() == 228, || {
        format!("{} scenes", found.len())
    })?;
    let with_depth = scenes.iter().all(|scene| scene.notes.is_empty());
    check(with_depth, || "a map was not found".into())?;
    let first = open("booster,illuminations=first", set.path())?;
    let clusters: BTreeSet<&str> = first.iter().map(|scene| scene.cluster.as_str()).collect();
    assert_eq!((first.len(), clusters.len()), (38, 38));
    Ok(())
}

/// Lists of scenes: existing scenes are read, and every other name is reported.
pub(super) fn scannetpp(folder: &Path) -> Outcome {
    let set = tempfile::tempdir()?;
    let splits = set.path().join("splits");
    std::fs::create_dir_all(&splits)?;
    let fixture = Path::new(env!("CARGO_MANIFEST_DIR")).join("fuzz/datasets/scannetpp/data/s");
    for (split, count) in [("nvs_sem_train", 64), ("nvs_sem_val", 8)] {
        let list = format!("HUQiancheng/dataset/splits/{split}.txt");
        let text = std::fs::read_to_string(folder.join(list))?;
        std::fs::write(splits.join(format!("{split}.txt")), &text)?;
        let ids: Vec<&str> = text.split_whitespace().collect();
        for name in [
            "nerfstudio/transforms.json",
            "resized_images/0.JPG",
            "resized_images/1.JPG",
        ] {
            let target = set.path().join("data").join(ids[1]).join("dslr").join(name);
            std::fs::create_dir_all(target.parent().unwrap())?;
            std::fs::copy(fixture.join("dslr").join(name), target)?;
        }
        let text = format!("scannetpp={},split={split}", set.path().display());
        let found = open_each(&DatasetSpec::parse(&text)?)?;
        let broken = found.left_out.iter().filter(|scene| scene.why.is_fault());
        let broken: Vec<&str> = broken.map(|scene| scene.id.as_str()).collect();
        let others: Vec<&str> = [&ids[..1], &ids[2..]].concat();
        check(ids.len() == count && broken == others, || {
            format!("{split}: {broken:?}")
        })?;
        check(
            found.scenes.len() == 1 && found.scenes[0].id == ids[1],
            || split.to_owned(),
        )?;
    }
    Ok(())
}
