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
    // 0.3 m apart: neighbours overlap by 0.85, next but one by 0.7, the third by 0.55.
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
    // Five blocks of two a full set: 10 + 8 + 6 + 4 + 2; three for five views: 5 + 3 + 1.
    assert_eq!(short.reads.load(Ordering::Relaxed), 30 + 30 + 9);
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
    // Eight of the first ten; the eleventh is alone.
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
        assert_eq!(
            build.problems,
            [Problem {
                dataset: "d".into(),
                scene: "s".into(),
                view: "v1".into(),
                reason: "d.pfm: truncated".into(),
            }]
        );
    }
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
}

#[test]
fn the_two_overlaps_are_not_confused() {
    // The later camera stands nearer to the wall and sees less of it.
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
