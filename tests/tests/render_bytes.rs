//! The picture's bytes depend only on the scene and the view.

#![allow(
    clippy::unwrap_used,
    clippy::panic,
    reason = "test code outside of #[test] functions"
)]

mod render_support;

use render_support::{CASES, Golden, shuffled, without_ties};
use sharp::gaussians::Gaussians;
use sharp::render::{CpuRenderer, RenderOutput, RenderView, Renderer, Simd, TileSize};

fn in_pool(threads: usize, scene: &Gaussians, view: &RenderView) -> RenderOutput {
    let pool = rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .unwrap();
    pool.install(|| CpuRenderer::new().render(scene, view).unwrap())
}

/// The largest scenes of the golden data, at a size that needs several bins in both directions.
fn scenes() -> impl Iterator<Item = (Gaussians, RenderView)> {
    let large = CASES
        .into_iter()
        .filter(|(name, ..)| !["s1_one", "s2_two"].contains(name));
    large.map(|(name, suffix, eps2d)| {
        let golden = Golden::load(name, suffix, eps2d);
        let mut view = golden.view;
        let k = view.intrinsics;
        view.intrinsics = k.resized(k.width * 2 + 1, k.height * 2 + 3);
        (golden.scene, view)
    })
}

#[test]
fn threads_do_not_matter() {
    for (scene, view) in scenes() {
        let one = in_pool(1, &scene, &view);
        for threads in [2, 3, 8] {
            assert!(one == in_pool(threads, &scene, &view), "{threads} threads");
        }
    }
}

#[test]
fn runs_and_what_was_rendered_before_do_not_matter() {
    let mut renderer = CpuRenderer::new();
    let all: Vec<_> = scenes().collect();
    let first: Vec<_> = all
        .iter()
        .map(|(scene, view)| CpuRenderer::new().render(scene, view).unwrap())
        .collect();
    for _ in 0..3 {
        for ((scene, view), expected) in all.iter().zip(&first) {
            assert!(*expected == renderer.render(scene, view).unwrap());
        }
    }
}

#[test]
fn tile_size_and_instruction_set_do_not_matter() {
    for (scene, view) in scenes() {
        let mut first = None;
        for simd in Simd::available() {
            for tile in [TileSize::Px4, TileSize::Px8, TileSize::Px16, TileSize::Px32] {
                let mut renderer = CpuRenderer::with_simd(simd).with_tile_size(tile);
                let found = renderer.render(&scene, &view).unwrap();
                assert!(
                    *first.get_or_insert_with(|| found.clone()) == found,
                    "{} {tile:?}",
                    renderer.name()
                );
            }
        }
    }
}

#[test]
fn memory_limits_do_not_matter() {
    for (scene, view) in scenes() {
        let expected = CpuRenderer::new().render(&scene, &view).unwrap();
        for pairs in [1, 500, 5000] {
            let mut small = CpuRenderer::new().with_pair_limit(pairs);
            assert!(expected == small.render(&scene, &view).unwrap(), "{pairs}");
        }
    }
}

#[test]
fn the_order_of_the_input_matters_only_for_exact_ties() {
    for (scene, view) in scenes() {
        let distinct = without_ties(&scene, &view);
        let shuffled = shuffled(&distinct);
        let a = CpuRenderer::new().render(&distinct, &view).unwrap();
        assert!(a == CpuRenderer::new().render(&shuffled, &view).unwrap());
    }
}
