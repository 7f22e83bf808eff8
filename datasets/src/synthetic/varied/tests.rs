use std::collections::{BTreeMap, BTreeSet};

use super::*;
use crate::synthetic::{SyntheticOptions, SyntheticScene, TRAINING_SEEDS, WorldKind};

const SEEDS: std::ops::Range<u64> = 1_000..1_060;
/// Marks the seed of a reflective scene.
const REFLECTIVE: u64 = 1 << 40;

fn options(seed: u64) -> SyntheticOptions {
    let varied = SyntheticOptions::varied(seed & !REFLECTIVE);
    match seed & REFLECTIVE {
        0 => varied,
        _ => SyntheticOptions {
            world: WorldKind::Reflective,
            ..varied
        },
    }
}

#[test]
fn every_family_occurs_as_often_as_it_is_listed() {
    let mut counts = BTreeMap::new();
    let seeds = *TRAINING_SEEDS.start()..*TRAINING_SEEDS.start() + 16_000;
    for seed in seeds {
        *counts.entry(family(seed)).or_insert(0) += 1;
    }
    assert_eq!(counts.len(), 7);
    for (family, count) in counts {
        let expected = 1000 * FAMILIES.iter().filter(|listed| **listed == family).count();
        let off = expected.abs_diff(count) as f64;
        // Five standard deviations of a count.
        assert!(off < 5.0 * (expected as f64).sqrt(), "{family:?}: {count}");
    }
}

#[test]
fn cameras_are_clear_of_surfaces_and_of_the_papers_distance() {
    for seed in SEEDS.chain(SEEDS.map(|seed| seed | REFLECTIVE)) {
        let (world, rig) = match seed & REFLECTIVE {
            0 => scene(seed),
            _ => reflective_scene(seed ^ REFLECTIVE),
        };
        let centers = rig.centers(11);
        for (i, a) in centers.iter().enumerate() {
            let shapes = world.objects().iter().map(|object| object.shape());
            let nearest = shapes.map(|shape| shape.distance_to(*a));
            let nearest = nearest.fold(f64::INFINITY, f64::min);
            assert!(nearest > 0.3, "seed {seed}: {nearest} m before camera {i}");
            let widest = centers.iter().map(|b| (*a - *b).length());
            assert!(widest.fold(0.0, f64::max) <= 0.6, "seed {seed}");
        }
    }
}

#[test]
fn pictures_show_enough() {
    for seed in SEEDS.chain(SEEDS.map(|seed| seed | REFLECTIVE)) {
        let options = SyntheticOptions {
            width: 48,
            height: 48,
            ..options(seed)
        };
        let scene = SyntheticScene::new(options).unwrap();
        assert_eq!(scene.views().len(), 11);
        for view in scene.views() {
            let depth = view.content.depth().unwrap().unwrap();
            let mut seen: Vec<f32> = depth.iter().copied().filter(|z| *z > 0.0).collect();
            seen.sort_unstable_by(f32::total_cmp);
            let share = seen.len() as f64 / f64::from(48 * 48);
            assert!(share > 0.3, "seed {seed} {}: {share} is not sky", view.id);
            assert!(seen[0] > 0.3, "seed {seed} {}: {} m", view.id, seen[0]);
            assert!(
                *seen.last().unwrap() > 1.2 * seen[0],
                "seed {seed} {}",
                view.id
            );
        }
        let picture = scene.views()[0].content.image().unwrap();
        let level = |share: usize| {
            let mut levels = picture.as_raw().clone();
            levels.sort_unstable();
            levels[levels.len() * share / 100]
        };
        assert!(
            level(95) - level(5) > 25,
            "seed {seed}: hardly any contrast"
        );
    }
}

fn hash(seed: u64, threads: usize) -> String {
    let options = SyntheticOptions {
        width: 64,
        height: 48,
        ..options(seed)
    };
    let pool = rayon::ThreadPoolBuilder::new().num_threads(threads);
    pool.build().unwrap().install(|| {
        let scene = SyntheticScene::new(options).unwrap();
        scene.views()[5].content.image_sha256().unwrap()
    })
}

#[test]
fn pictures_do_not_depend_on_threads_and_differ_between_seeds() {
    let mut seen = BTreeSet::new();
    let reflective = (1_000..1_012).map(|seed| seed | REFLECTIVE);
    for seed in (1_000..1_012).chain(reflective) {
        let one = hash(seed, 1);
        assert_eq!(one, hash(seed, 2));
        assert!(seen.insert(one), "seed {seed}");
    }
}

/// The hashes were recorded once, for the first training seed of each family. They change only with
/// the scenes themselves, never with the machine. If they change, weights trained on the old scenes
/// must be trained again.
#[test]
fn pictures_are_the_same_on_every_machine() {
    let families: BTreeSet<Family> = FAMILIES.into_iter().collect();
    let found = families.into_iter().map(|of| {
        let seed = TRAINING_SEEDS
            .clone()
            .find(|seed| family(*seed) == of)
            .unwrap();
        hash(seed, 2)
    });
    assert_eq!(found.collect::<Vec<_>>(), RECORDED);
}

/// A single hash of the pictures of thirty reflective scenes, recorded in the same way.
#[test]
fn reflective_pictures_are_the_same_on_every_machine() {
    let all: Vec<String> = (1_000..1_030)
        .map(|seed| hash(seed | REFLECTIVE, 2))
        .collect();
    assert_eq!(
        sharp_checkpoint::hash::sha256_hex(all.join(" ").as_bytes()),
        "0169c7dd91e827227901fe592c917003b1e2d5075d8c5254e7ee142eba753829"
    );
}

/// In the order of the families.
const RECORDED: [&str; 7] = [
    "1fd51bc8d2f705bae09671666b1e22d51508992d4f47822c6e62f5c1038953d9",
    "e9d9d9669616ec397b5883683725308bee6a3e20b09b7c432ad70b2abd2274d0",
    "021c77484af4803cfab2c34b3e76bdbd1e3ab07470d4f9f9e245978039f0917b",
    "e53c2697160943f57d40d8556594c95bd27b98911a09961249902f3674b045c3",
    "24e4f3ec5dd47bee75da7cddd71d090bf858a0102b5dfb398fe5be1e453f7392",
    "748c5bcd78ce9dcf437ab34c1f5f36b8ab431cf2ecde7a515859c419961aaf6c",
    "8167c544e7be43ef28cf0ea7e1619e8f9947381139d31f030a9a79f720d8e841",
];

#[test]
fn classic_seeds_are_the_classic_scene() {
    let seed = (1_000..)
        .find(|seed| family(*seed) == Family::Classic)
        .unwrap();
    let varied = SyntheticOptions::varied(seed);
    let classic = SyntheticOptions {
        world: WorldKind::Classic,
        ..varied
    };
    let [a, b] = [varied, classic].map(|options| SyntheticScene::new(options).unwrap());
    for (a, b) in a.views().iter().zip(b.views()) {
        assert_eq!(
            (a.camera_from_world, a.intrinsics),
            (b.camera_from_world, b.intrinsics)
        );
    }
    let picture = |scene: &SyntheticScene| scene.views()[3].content.image_sha256().unwrap();
    assert_eq!(picture(&a), picture(&b));
}

/// Most reflective scenes show a mirror, a pane or water in their central picture.
#[test]
fn reflective_scenes_show_what_they_are_for() {
    let mut shares = Vec::new();
    for seed in 1_000..1_120 {
        let (world, rig) = reflective_scene(seed);
        let forward = rig.target.normalize();
        let right = DVec3::Y.cross(forward).normalize();
        let down = forward.cross(right);
        let rays = (0..30 * 30).map(|place| {
            let at = |cell: i32| (f64::from(cell) + 0.5) / 30.0 - 0.5;
            right * (at(place % 30) / rig.focal) + down * (at(place / 30) / rig.focal) + forward
        });
        let seen = rays.filter(|ray| world.is_layered_along(DVec3::ZERO, *ray));
        shares.push(seen.count() as f64 / 900.0);
    }
    let visible = shares.iter().filter(|share| **share > 0.02).count();
    assert!(visible > 84, "{visible} of 120");
    let mean = shares.iter().sum::<f64>() / 120.0;
    assert!((0.08..0.3).contains(&mean), "{mean}");
}
