//! Overlap of walls.

use super::*;
use glam::DMat3;
use sharp::camera::{Intrinsics, RigidTransform};
use sharp_datasets::DepthMap;

/// A camera at `center`, looking along z.
fn camera(center: DVec3, depth: DepthMap) -> PosedDepth {
    let intrinsics = Intrinsics::new((100.0, 100.0), (50.0, 40.0), (100, 80)).unwrap();
    let pose = RigidTransform::new(DMat3::IDENTITY, -center).unwrap();
    PosedDepth::new("wall", intrinsics, pose, depth).unwrap()
}

fn flat(depth: f32) -> DepthMap {
    DepthMap::from_pixel(100, 80, Luma([depth]))
}

/// A wall at `depth` metres, seen from `x` metres to the right of the world's origin.
fn wall(x: f64, depth: f32) -> PosedDepth {
    camera(DVec3::new(x, 0.0, 0.0), flat(depth))
}

fn share(view: &PosedDepth, other: &PosedDepth, options: &OverlapOptions) -> Option<f64> {
    overlap(view, other, options).share(options.denominator)
}

#[test]
fn a_sideways_step_uncovers_its_disparity() {
    // 0.3 m at 2 m with f = 100 is 15 of 100 pixels; slightly more, so that no pixel lands on an edge.
    let (left, right) = (wall(0.0, 2.0), wall(0.301, 2.0));
    let options = OverlapOptions::default();
    assert_eq!(share(&right, &left, &options), Some(0.85));
    assert_eq!(share(&left, &right, &options), Some(0.85));
    assert_eq!(share(&left, &left, &options), Some(1.0));
}

#[test]
fn depth_that_disagrees_is_not_seen_but_still_inside() {
    let (near, far) = (wall(0.0, 2.0), wall(0.0, 2.11));
    let frustum = OverlapOptions {
        test: OverlapTest::Frustum,
        ..OverlapOptions::default()
    };
    // A difference of 0.11 exceeds 5 % of either depth (at most 0.1055), but not 6 %.
    assert_eq!(share(&near, &far, &OverlapOptions::default()), Some(0.0));
    assert_eq!(share(&near, &far, &frustum), Some(1.0));
    let looser = OverlapOptions {
        test: OverlapTest::Consistent { relative: 0.06 },
        ..OverlapOptions::default()
    };
    assert_eq!(share(&near, &far, &looser), Some(1.0));
    let map_anything = OverlapOptions {
        test: OverlapTest::MAP_ANYTHING,
        ..OverlapOptions::default()
    };
    assert_eq!(share(&near, &far, &map_anything), Some(1.0));
    assert_eq!(share(&near, &wall(0.0, 2.19), &map_anything), Some(0.0));
}

#[test]
fn denominators_differ_by_what_is_invalid() {
    let mut map = flat(2.0);
    for (i, depth) in map.iter_mut().enumerate() {
        if i % 100 < 25 {
            *depth = if i % 2 == 0 { 0.0 } else { f32::INFINITY };
        }
    }
    let holed = camera(DVec3::ZERO, map);
    let whole = wall(0.0, 2.0);
    let by = |denominator| OverlapOptions {
        denominator,
        ..OverlapOptions::default()
    };
    assert_eq!(share(&holed, &whole, &by(Denominator::Valid)), Some(1.0));
    assert_eq!(share(&holed, &whole, &by(Denominator::All)), Some(0.75));
    assert_eq!(
        share(&holed, &whole, &by(Denominator::ValidOther)),
        Some(0.75)
    );
    assert_eq!(share(&whole, &holed, &by(Denominator::Valid)), Some(0.75));
    let mask = seen_mask(&holed, &whole, &OverlapOptions::default());
    assert!(
        mask.iter()
            .enumerate()
            .all(|(i, &seen)| seen == (i % 100 >= 25))
    );
}

#[test]
fn nothing_valid_gives_no_share() {
    let empty = wall(0.0, 0.0);
    assert_eq!(
        share(&empty, &wall(0.0, 2.0), &OverlapOptions::default()),
        None
    );
    let by_other = OverlapOptions {
        denominator: Denominator::ValidOther,
        ..OverlapOptions::default()
    };
    assert_eq!(share(&wall(0.0, 2.0), &empty, &by_other), None);
}

#[test]
fn what_lies_behind_the_other_camera_is_not_seen() {
    let front = wall(0.0, 2.0);
    let past = camera(DVec3::new(0.0, 0.0, 3.0), flat(2.0));
    for test in [
        OverlapTest::Frustum,
        OverlapTest::Consistent { relative: 10.0 },
    ] {
        let options = OverlapOptions {
            test,
            ..OverlapOptions::default()
        };
        assert_eq!(share(&front, &past, &options), Some(0.0));
    }
}

#[test]
fn a_stride_takes_the_middle_of_each_cell() {
    let (left, right) = (wall(0.0, 2.0), wall(0.301, 2.0));
    let options = OverlapOptions {
        stride: 4,
        ..OverlapOptions::default()
    };
    let counts = overlap(&left, &right, &options);
    assert_eq!(counts.pixels, 25 * 20);
    // Of columns 2, 6, … 98, the columns 2, 6, 10 and 14 leave the image.
    assert_eq!(counts.seen, 21 * 20);
}

#[test]
fn sparse_depth_is_found_nearby() {
    // Every tenth pixel of every tenth row has depth, but at different points of the wall in the
    // two views.
    let sparse = |x: f64, offset: u32| {
        let map = DepthMap::from_fn(100, 80, |i, j| {
            let hit = i % 10 == offset && j % 10 == offset;
            Luma([if hit { 2.0 } else { 0.0 }])
        });
        camera(DVec3::new(x, 0.0, 0.0), map)
    };
    let (a, b) = (sparse(0.0, 2), sparse(0.301, 7));
    let with = |lookup| OverlapOptions {
        lookup,
        ..OverlapOptions::default()
    };
    assert_eq!(share(&a, &b, &with(DepthLookup::Nearest)), Some(0.0));
    let window = with(DepthLookup::Window { radius: 5 });
    // Columns 2 and 12 leave the picture; the other eight of ten remain.
    assert_eq!(share(&a, &b, &window), Some(0.8));
    // A radius of 0 is the nearest pixel.
    let dense = (wall(0.0, 2.0), wall(0.301, 2.0));
    assert_eq!(
        share(&dense.1, &dense.0, &with(DepthLookup::Window { radius: 0 })),
        Some(0.85)
    );
    // A nearer surface does not agree.
    let nearer = camera(DVec3::ZERO, flat(1.0));
    assert_eq!(share(&a, &nearer, &window), Some(0.0));
}

#[test]
fn bilinear_lookup_needs_four_valid_pixels() {
    let mut map = flat(2.0);
    map.put_pixel(50, 40, Luma([0.0]));
    let other = camera(DVec3::ZERO, map);
    let view = wall(0.001, 2.0);
    let with = |lookup| OverlapOptions {
        lookup,
        ..OverlapOptions::default()
    };
    let all = 100 * 80;
    // The camera is 0.05 px to the right, so every pixel reads itself and its right neighbour.
    let nearest = overlap(&view, &other, &with(DepthLookup::Nearest));
    assert_eq!(nearest.seen, all - 1);
    let bilinear = overlap(&view, &other, &with(DepthLookup::Bilinear));
    // Along y, the weight of the next row is exactly 0, but that row must still be valid, so two columns of two rows
    // read the hole.
    assert_eq!(bilinear.seen, all - 4);
}
