//! Overlap measured on depth maps, compared with exact visibility in the procedural scene, which is
//! determined by casting rays.

#![allow(clippy::unwrap_used, reason = "test code outside of #[test] functions")]

use sharp_bench::pairs::build::{BuildContext, build_pairs};
use sharp_bench::pairs::depth::PosedDepth;
use sharp_bench::pairs::overlap::{OverlapOptions, OverlapTest, overlap};
use sharp_bench::pairs::{Pair, PairOptions};
use sharp_datasets::synthetic::{SyntheticOptions, SyntheticScene};

/// Maximum shortfall of the default definition from exact visibility: the largest of six pairs of
/// an independent scene, measured in numpy.
const MAX_BELOW: f64 = 0.017;

fn scene(width: u32, height: u32) -> SyntheticScene {
    SyntheticScene::new(SyntheticOptions {
        width,
        height,
        views: 10,
        ..SyntheticOptions::default()
    })
    .unwrap()
}

fn view(scene: &SyntheticScene, index: usize) -> PosedDepth {
    let view = &scene.views()[index];
    let depth = view.content.depth().unwrap().unwrap();
    PosedDepth::of_view(view, depth).unwrap()
}

/// Exact share of the target that is visible in the source, minus the measured share.
fn shortfall(scene: &SyntheticScene, source: usize, target: usize, how: &OverlapOptions) -> f64 {
    let measured = overlap(&view(scene, target), &view(scene, source), how);
    scene.visible_share(target, source).unwrap() - measured.share(how.denominator).unwrap()
}

fn index(id: &str) -> usize {
    id.strip_prefix("view_").unwrap().parse().unwrap()
}

#[test]
fn the_default_lies_just_below_exact_visibility_for_every_pair() {
    let scene = scene(320, 240);
    let options: PairOptions = "threshold=0".parse().unwrap();
    let build = build_pairs(&[scene.scene("d")], &options, &BuildContext::default()).unwrap();
    assert_eq!(build.pairs.len(), 90);
    let below = |pair: &Pair| {
        let exact = scene.visible_share(index(&pair.target), index(&pair.source));
        exact.unwrap() - pair.overlap.unwrap()
    };
    let differences: Vec<f64> = build.pairs.iter().map(below).collect();
    for (pair, &d) in build.pairs.iter().zip(&differences) {
        assert!((0.0..=MAX_BELOW).contains(&d), "{}: {d}", pair.pair_id);
    }
    let mean = differences.iter().sum::<f64>() / 90.0;
    assert!((0.001..=0.01).contains(&mean), "mean {mean}");
}

#[test]
fn the_other_column_is_the_other_direction() {
    let scene = scene(160, 120);
    let build = build_pairs(
        &[scene.scene("d")],
        &PairOptions::default(),
        &BuildContext::default(),
    )
    .unwrap();
    for pair in &build.pairs {
        let exact = scene
            .visible_share(index(&pair.source), index(&pair.target))
            .unwrap();
        let found = pair.overlap_source_to_target.unwrap();
        // Half the resolution doubles the discretisation error.
        assert!(
            (0.0..=2.0 * MAX_BELOW).contains(&(exact - found)),
            "{}: {exact} {found}",
            pair.pair_id
        );
    }
}

#[test]
fn pairs_are_those_that_exact_visibility_would_select_but_for_the_shortfall() {
    let scene = scene(320, 240);
    let options = PairOptions::default();
    let build = build_pairs(&[scene.scene("d")], &options, &BuildContext::default()).unwrap();
    for source in 0..10 {
        for target in 0..10 {
            let exact = scene.visible_share(target, source).unwrap();
            let listed = build
                .pairs
                .iter()
                .any(|p| index(&p.source) == source && index(&p.target) == target);
            if source == target || exact <= options.threshold {
                assert!(!listed, "{source} {target}: {exact}");
            } else if exact > options.threshold + MAX_BELOW {
                assert!(listed, "{source} {target}: {exact}");
            }
        }
    }
}

#[test]
fn the_shortfall_vanishes_with_resolution() {
    let (coarse, fine) = (scene(160, 120), scene(640, 480));
    let how = OverlapOptions::default();
    for (source, target) in [(0, 1), (6, 3), (9, 5)] {
        let (c, f) = (
            shortfall(&coarse, source, target, &how),
            shortfall(&fine, source, target, &how),
        );
        assert!(f < 0.5 * c, "{source} {target}: {c} {f}");
    }
}

#[test]
fn without_a_depth_test_overlap_is_overstated() {
    let scene = scene(160, 120);
    let frustum = OverlapOptions {
        test: OverlapTest::Frustum,
        ..OverlapOptions::default()
    };
    for (source, target) in [(0, 1), (6, 3), (9, 7)] {
        let over = -shortfall(&scene, source, target, &frustum);
        assert!(over > 0.02, "{source} {target}: {over}");
    }
}
