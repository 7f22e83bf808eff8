use std::sync::atomic::Ordering;

use super::super::test_scene::{Depth, row};
use super::*;

const WALL: Depth = Depth::Wall(2.0);

fn build(scenes: &[Scene], options: &str) -> PairBuild {
    build_pairs(scenes, &options.parse().unwrap(), &BuildContext::default()).unwrap()
}

fn ids(build: &PairBuild) -> Vec<&str> {
    build.pairs.iter().map(|p| p.pair_id.as_str()).collect()
}

#[test]
fn pairs_within_reach_qualify_both_ways() {
    // 0.3 m apart: neighbours overlap by 0.85, views two apart by 0.7, three apart by 0.55.
    let scene = row("d", "s", 0.3, &[WALL; 4]).scene;
    let build = build(std::slice::from_ref(&scene), "");
    assert_eq!(
        ids(&build),
        [
            "d/s/v0__v1",
            "d/s/v0__v2",
            "d/s/v1__v0",
            "d/s/v1__v2",
            "d/s/v1__v3",
            "d/s/v2__v0",
            "d/s/v2__v1",
            "d/s/v2__v3",
            "d/s/v3__v1",
            "d/s/v3__v2",
        ]
    );
    let pair = &build.pairs[0];
    assert!((pair.overlap.unwrap() - 0.85).abs() < 0.011);
    assert!((pair.baseline_m - 0.3001).abs() < 1e-12);
    assert_eq!(pair.rotation_deg, 0.0);
    assert_eq!(pair.median_depth_m, Some(2.0));
    assert_eq!(pair.set, Some(0));
    assert!(build.pairs.iter().all(|p| p.selected));
    let counts = build.summaries["d"];
    assert_eq!((counts.considered, counts.too_little_overlap), (12, 2));
    assert_eq!((counts.qualified, counts.selected), (10, 10));
}

#[test]
fn a_list_that_is_stopped_reads_no_more_depth() {
    let long = row("d", "s", 0.05, &[WALL; 40]);
    let reads = || long.reads.load(Ordering::Relaxed);
    let context = BuildContext {
        stop: &|| reads() >= 15,
        ..BuildContext::default()
    };
    let scenes = std::slice::from_ref(&long.scene);
    let stopped = build_pairs(scenes, &"limit=all".parse().unwrap(), &context);
    assert!(matches!(stopped, Err(PairError::Stopped)));
    // 15 reads, plus one that each thread may have begun by then.
    assert!(
        (15..=15 + rayon::current_num_threads()).contains(&reads()),
        "{}",
        reads()
    );
}

#[test]
fn each_depth_map_is_read_once_unless_memory_is_short() {
    let few = row("d", "s", 0.05, &[WALL; 25]);
    let plenty = build(std::slice::from_ref(&few.scene), "limit=all");
    assert_eq!(few.reads.load(Ordering::Relaxed), 25);

    let short = row("d", "s", 0.05, &[WALL; 25]);
    let context = BuildContext {
        // Four maps of 100 × 10 f32.
        depth_memory_bytes: 16_000,
        ..BuildContext::default()
    };
    let options = "limit=all".parse().unwrap();
    let blocked = build_pairs(std::slice::from_ref(&short.scene), &options, &context).unwrap();
    assert_eq!(blocked.pairs, plenty.pairs);
    // Each full set has five blocks of two, read 10 + 8 + 6 + 4 + 2 times. The last set, of five
    // views, has three blocks, read 5 + 3 times: by then its last view has been paired with all
    // others.
    assert_eq!(short.reads.load(Ordering::Relaxed), 30 + 30 + 8);
}

#[test]
fn sets_bound_the_pairs() {
    let scene = row("d", "s", 0.01, &[WALL; 12]).scene;
    let scenes = std::slice::from_ref(&scene);
    assert_eq!(build(scenes, "").pairs.len(), 90 + 2);
    assert_eq!(build(scenes, "remainder=drop").pairs.len(), 90);
    assert_eq!(build(scenes, "order=once").pairs.len(), 45 + 1);
    assert_eq!(build(scenes, "sets=whole").pairs.len(), 12 * 11);
    assert_eq!(build(scenes, "max-sets=1").pairs.len(), 90);
    assert_eq!(build(scenes, "sets=strided").pairs.len(), 2 * 30);
    let far = build(scenes, "min-baseline=0.05");
    assert!(far.pairs.iter().all(|p| p.baseline_m >= 0.05));
    assert_eq!(far.pairs.len() + far.summaries["d"].too_near, 92);
    let near = build(scenes, "max-baseline=0.045");
    assert!(near.pairs.iter().all(|p| p.baseline_m <= 0.045));
    assert_eq!(near.pairs.len() + near.summaries["d"].too_far, 92);
}

#[test]
fn sampling_is_per_dataset_and_marks_rows() {
    let scenes = [
        row("a", "s", 0.01, &[WALL; 10]).scene,
        row("b", "s", 0.01, &[WALL; 4]).scene,
    ];
    let build = build(&scenes, "limit=20");
    let selected = |name: &str| {
        let rows = build.pairs.iter().filter(|p| p.dataset == name);
        rows.filter(|p| p.selected).count()
    };
    assert_eq!((selected("a"), selected("b")), (20, 12));
    assert_eq!(build.summaries["a"].qualified, 90);
    assert_eq!(build.summaries["a"].selected, 20);
}

#[test]
fn views_without_depth_follow_the_option() {
    let mut depths = vec![WALL; 11];
    depths[3] = Depth::Absent;
    depths[4] = Depth::Wall(0.0);
    let scene = row("d", "s", 0.01, &depths).scene;
    let scenes = std::slice::from_ref(&scene);
    // Eight of the first ten views; the eleventh view is alone in its set.
    assert_eq!(build(scenes, "").pairs.len(), 8 * 7);
    assert_eq!(build(scenes, "").summaries["d"].without_depth, 90 - 56);
    let accepted = build(scenes, "missing-depth=accept");
    assert_eq!(accepted.pairs.len(), 90);
    let blind = accepted.pairs.iter().filter(|p| p.overlap.is_none());
    assert_eq!(blind.count(), 34);
    assert_eq!(build(scenes, "missing-depth=leave-out").pairs.len(), 9 * 8);
    assert!(build(scenes, "").problems.is_empty());
}

#[test]
fn a_broken_file_is_reported_once_and_the_rest_goes_on() {
    let mut depths = vec![WALL; 4];
    depths[1] = Depth::Broken;
    let scene = row("d", "s", 0.01, &depths).scene;
    let scenes = std::slice::from_ref(&scene);
    for options in ["", "missing-depth=leave-out"] {
        let build = build(scenes, options);
        assert_eq!(build.pairs.len(), 6);
        let lost = if options.is_empty() { 6 } else { 0 };
        assert_eq!(build.summaries["d"].unreadable, lost);
        assert_eq!(
            build.problems,
            [Problem {
                dataset: "d".into(),
                scene: "s".into(),
                view: "v1".into(),
                reason: "d.pfm: truncated".into(),
                is_left_out: true,
            }]
        );
    }
    // A broken file that is not needed excludes no view.
    let accepted = build(scenes, "missing-depth=accept");
    assert_eq!(accepted.pairs.len(), 12);
    assert_eq!(accepted.summaries["d"].unreadable, 0);
    assert_eq!(
        (accepted.problems.len(), accepted.left_out().count()),
        (1, 0)
    );
}

/// Pairs with a truncated photograph are not built.
#[test]
fn views_of_broken_photographs_are_left_out_with_their_pairs() {
    let folder = tempfile::tempdir().unwrap();
    let dataset = sharp_datasets::bundled::extract(folder.path()).unwrap();
    let text = format!("D:middlebury={}", dataset.display());
    let file = dataset.join("Motorcycle-quarter/im1.png");
    let bytes = std::fs::read(&file).unwrap();
    std::fs::write(&file, &bytes[..bytes.len() / 2]).unwrap();
    let scenes = sharp_datasets::open(&sharp_datasets::DatasetSpec::parse(&text).unwrap()).unwrap();
    let build = build(&scenes, "");
    assert_eq!(build.pairs, []);
    assert_eq!(build.summaries["D"].unreadable, 1);
    let problem = &build.left_out().next().unwrap();
    assert_eq!(problem.view, "im1");
    assert!(problem.reason.contains("truncated"), "{problem:?}");
}

#[test]
fn stereo_scenes_give_one_pair_whatever_the_overlap() {
    let stereo = |depths: &[Depth]| {
        let mut scene = row("m", "Motorcycle", 1.5, depths).scene;
        scene.pairing = Pairing::Stereo {
            source: 1,
            target: 0,
        };
        scene
    };
    let found = build(&[stereo(&[WALL, WALL])], "");
    assert_eq!(ids(&found), ["m/Motorcycle/v1__v0"]);
    let pair = &found.pairs[0];
    assert_eq!(pair.set, None);
    assert!(pair.overlap.unwrap() < 0.3);
    let broken = build(&[stereo(&[WALL, Depth::Broken])], "");
    assert_eq!(broken.pairs.len(), 1);
    assert_eq!(broken.pairs[0].overlap, None);
    assert_eq!(broken.pairs[0].median_depth_m, Some(2.0));
    assert_eq!(broken.problems.len(), 1);
    // A target without depth gets its source's median depth.
    let left_only = build(&[stereo(&[Depth::Absent, Depth::Wall(3.0)])], "");
    assert_eq!(left_only.pairs[0].median_depth_m, Some(3.0));
    assert_eq!(left_only.pairs[0].overlap, None);
}

#[test]
fn the_two_overlaps_are_not_confused() {
    // The later camera is closer to the wall and sees less of it.
    let mut scene = row("d", "s", 0.0, &[Depth::Wall(2.0), Depth::Wall(1.0)]).scene;
    scene.views[1].camera_from_world.translation = glam::DVec3::new(0.0, 0.0, -1.0);
    let build = build(std::slice::from_ref(&scene), "");
    assert_eq!(ids(&build), ["d/s/v0__v1"]);
    let pair = &build.pairs[0];
    assert_eq!(pair.overlap, Some(1.0));
    assert_eq!(pair.overlap_source_to_target, Some(0.25));
    assert_eq!(pair.median_depth_m, Some(1.0));
}

#[test]
fn files_are_relative_to_the_datasets_folder() {
    let scene = row("d", "s", 0.1, &[WALL; 2]).scene;
    let context = BuildContext {
        roots: BTreeMap::from([("d".into(), PathBuf::from("root/d"))]),
        ..BuildContext::default()
    };
    let options = PairOptions::default();
    let build = build_pairs(std::slice::from_ref(&scene), &options, &context).unwrap();
    assert_eq!(build.pairs[0].source_file, "s/v0.png");
    assert_eq!(build.pairs[0].target_file, "s/v1.png");
}

#[test]
fn scenes_of_one_name_are_an_error() {
    let scene = || row("d", "s", 0.1, &[WALL; 2]).scene;
    let options = PairOptions::default();
    let error = build_pairs(&[scene(), scene()], &options, &BuildContext::default()).unwrap_err();
    assert!(error.to_string().contains("'d/s/v0__v1'"), "{error}");
}

mod cache {
    use super::*;
    use crate::pairs::OverlapCache;

    fn cached(scenes: &[Scene], options: &str, cache: &OverlapCache) -> PairBuild {
        let context = BuildContext {
            cache: Some(cache),
            ..BuildContext::default()
        };
        build_pairs(scenes, &options.parse().unwrap(), &context).unwrap()
    }

    fn files(folder: &std::path::Path) -> Vec<PathBuf> {
        let mut found = Vec::new();
        for entry in std::fs::read_dir(folder).into_iter().flatten() {
            let path = entry.unwrap().path();
            if path.is_dir() {
                found.extend(files(&path));
            } else {
                found.push(path);
            }
        }
        found.sort();
        found
    }

    /// A scene whose files exist, so that they can be hashed.
    fn scene_in(
        dir: &std::path::Path,
        id: &str,
        views: usize,
    ) -> crate::pairs::test_scene::CameraRow {
        let row = row("d", id, 0.05, &vec![WALL; views]);
        for view in &row.scene.views {
            let path = dir.join(&view.id);
            std::fs::write(path, &view.id).unwrap();
        }
        crate::pairs::test_scene::with_files(row, dir)
    }

    #[test]
    fn nothing_changes_and_nothing_is_read_twice() {
        let dir = tempfile::tempdir().unwrap();
        let folder = dir.path().join("cache");
        let first = scene_in(dir.path(), "s", 25);
        let plain = build(std::slice::from_ref(&first.scene), "");
        let reads = || first.reads.swap(0, Ordering::Relaxed);
        reads();
        let scenes = std::slice::from_ref(&first.scene);
        let fresh = cached(scenes, "", &OverlapCache::in_folder(&folder));
        assert_eq!(fresh.pairs, plain.pairs);
        assert_eq!((reads(), files(&folder).len()), (25, 1));
        // Build again, as another process would.
        let again = cached(scenes, "", &OverlapCache::in_folder(&folder));
        assert_eq!(again.pairs, plain.pairs);
        assert_eq!(again.summaries, plain.summaries);
        assert_eq!(reads(), 0);
        // Other thresholds, sampling or smaller sets measure nothing new; larger sets measure only
        // the new couples.
        cached(
            scenes,
            "threshold=0.2,size=5,order=once,limit=3",
            &OverlapCache::in_folder(&folder),
        );
        assert_eq!(reads(), 0);
        let whole = cached(scenes, "sets=whole", &OverlapCache::in_folder(&folder));
        assert_eq!(whole.pairs, build(scenes, "sets=whole").pairs);
        assert_eq!(reads(), 25 + 25);
        cached(scenes, "sets=strided", &OverlapCache::in_folder(&folder));
        assert_eq!((reads(), files(&folder).len()), (0, 1));
        // Other measuring options use another table.
        cached(scenes, "test=frustum", &OverlapCache::in_folder(&folder));
        assert_eq!((reads(), files(&folder).len()), (25, 2));
    }

    #[test]
    fn a_changed_file_pose_or_setting_is_another_scene() {
        let dir = tempfile::tempdir().unwrap();
        let folder = dir.path().join("cache");
        let mut row = scene_in(dir.path(), "s", 4);
        let tables = |scene: &Scene, settings: &str| {
            let cache = OverlapCache::in_folder(&folder);
            let context = BuildContext {
                cache: Some(&cache),
                settings: BTreeMap::from([("d".to_owned(), settings.to_owned())]),
                ..BuildContext::default()
            };
            let options = PairOptions::default();
            build_pairs(std::slice::from_ref(scene), &options, &context).unwrap();
            assert!(cache.take_warnings().is_empty());
            files(&folder).len()
        };
        assert_eq!(tables(&row.scene, ""), 1);
        assert_eq!(tables(&row.scene, ""), 1);
        assert_eq!(tables(&row.scene, "depth=mesh"), 2);
        std::fs::write(dir.path().join("v2"), "mended").unwrap();
        assert_eq!(tables(&row.scene, ""), 3);
        row.scene.views[1].camera_from_world.translation.x += 1e-9;
        assert_eq!(tables(&row.scene, ""), 4);
    }

    #[test]
    fn a_damaged_table_is_said_and_measured_anew() {
        let dir = tempfile::tempdir().unwrap();
        let folder = dir.path().join("cache");
        let row = scene_in(dir.path(), "s", 4);
        let scenes = std::slice::from_ref(&row.scene);
        let plain = build(scenes, "");
        cached(scenes, "", &OverlapCache::in_folder(&folder));
        let [table] = files(&folder).try_into().unwrap();
        let good = std::fs::read(&table).unwrap();
        let text = String::from_utf8(good.clone()).unwrap();
        let forged = text.replacen("\"a_in_b\":0.", "\"a_in_b\":1.", 1);
        assert_ne!(forged, text);
        for bad in [&good[..good.len() / 2], b"", b"null", forged.as_bytes()] {
            std::fs::write(&table, bad).unwrap();
            let cache = OverlapCache::in_folder(&folder);
            assert_eq!(cached(scenes, "", &cache).pairs, plain.pairs);
            let warnings = cache.take_warnings();
            assert_eq!(warnings.len(), 1, "{warnings:?}");
            let name = table.file_name().unwrap().to_string_lossy().into_owned();
            assert!(warnings[0].contains(&name), "{warnings:?}");
            assert_eq!(std::fs::read(&table).unwrap(), good);
        }
        // An unwritable folder causes a warning, but loses no pair.
        std::fs::write(dir.path().join("file"), b"").unwrap();
        let cache = OverlapCache::in_folder(dir.path().join("file"));
        assert_eq!(cached(scenes, "", &cache).pairs, plain.pairs);
        assert!(!cache.take_warnings().is_empty());
    }

    #[test]
    fn a_broken_file_is_never_remembered() {
        let dir = tempfile::tempdir().unwrap();
        let mut depths = vec![WALL; 4];
        depths[1] = Depth::Broken;
        let broken = row("d", "s", 0.01, &depths);
        for view in &broken.scene.views {
            std::fs::write(dir.path().join(&view.id), "x").unwrap();
        }
        let broken = crate::pairs::test_scene::with_files(broken, dir.path());
        let cache = OverlapCache::in_folder(dir.path().join("cache"));
        let scenes = std::slice::from_ref(&broken.scene);
        for _ in 0..2 {
            let build = cached(scenes, "", &cache);
            assert_eq!((build.pairs.len(), build.problems.len()), (6, 1));
        }
    }
}
