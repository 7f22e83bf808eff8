//! Every picture of `golden/render3dgs`, by every rendering rule, on the CPU's instruction sets and
//! on every adapter. Also checks that a wrong rule, or a wrong reading of the scene, changes the
//! pictures.

#![allow(
    clippy::unwrap_used,
    clippy::panic,
    clippy::print_stdout,
    reason = "test code outside of #[test] functions"
)]

#[path = "golden_rules/colors.rs"]
mod colors;
#[path = "golden_rules/golden.rs"]
mod golden;
#[path = "golden_rules/mutations.rs"]
mod mutations;

use golden::{Golden, Picture, SCENES};
use libtest_mimic::{Arguments, Trial};
use sharp::render::{CpuRenderer, Renderer, Simd};
use std::process::ExitCode;

/// Largest permitted change of a fragile pixel: at a tile's edge or at the stopping threshold.
const FRAGILE_BOUND: f32 = 0.02;

fn main() -> ExitCode {
    let mut trials = Vec::new();
    let mut add = |title: String, test: Box<dyn FnOnce() + Send>| {
        let run = move || {
            test();
            Ok(())
        };
        trials.push(Trial::test(title, run));
    };
    for (name, tolerance, on_gpu) in SCENES {
        for simd in Simd::available() {
            let test = move || check(&mut CpuRenderer::with_simd(simd), name, tolerance);
            add(
                format!("{name} on cpu-{}", simd.instruction_set()),
                Box::new(test),
            );
        }
        #[cfg(feature = "gpu")]
        for adapter in sharp::render::GpuAdapter::all() {
            use sharp::render::{GpuRenderer, TileSize};
            let test = |tile: TileSize| {
                let adapter = adapter.clone();
                move || {
                    let renderer = GpuRenderer::new(&adapter).unwrap();
                    check(&mut renderer.with_tile_size(tile), name, on_gpu);
                }
            };
            add(
                format!("{name} on {adapter}"),
                Box::new(test(TileSize::Px8)),
            );
            add(
                format!("{name} in tiles of 32 on {adapter}"),
                Box::new(test(TileSize::Px32)),
            );
        }
        let _ = on_gpu;
    }
    for (name, mutation) in mutations::ALL {
        add(
            format!("{name} shows"),
            Box::new(move || mutations::shows(name, mutation)),
        );
    }
    libtest_mimic::run(&Arguments::from_args(), trials).exit_code()
}

fn check(renderer: &mut dyn Renderer, name: &str, tolerance: f32) {
    let golden = Golden::load(name);
    assert!(!golden.pictures.is_empty());
    for Picture { title, view, .. } in &golden.pictures {
        let found = renderer.render(&golden.scene, view).unwrap();
        let deviation = golden.deviation(title, &found);
        println!("{name} {title}: {deviation:?}");
        assert!(deviation.firm <= tolerance, "{name} {title}: {deviation:?}");
        assert!(
            deviation.depth <= tolerance,
            "{name} {title}: {deviation:?}"
        );
        assert!(
            deviation.fragile <= FRAGILE_BOUND,
            "{name} {title}: {deviation:?}"
        );
    }
}
