//! The wgpu backend on every adapter of this machine: golden pictures, bytes, limits, and agreement
//! with the CPU. Without an adapter, each test is reported as ignored.

#![allow(
    clippy::unwrap_used,
    clippy::panic,
    clippy::print_stdout,
    reason = "test code outside of #[test] functions"
)]

mod render_support;
#[path = "../../sharp/benches/speed_scene/mod.rs"]
mod speed_scene;

use libtest_mimic::{Arguments, Trial};
use render_support::random::{self, Random, Recipe};
use render_support::{CASES, Golden, drops, reference};
use sharp::gaussians::Gaussians;
use sharp::render::{
    CpuRenderer, GpuAdapter, GpuRenderer, RenderError, RenderOutput, RenderView, Renderer, TileSize,
};
use std::process::ExitCode;

type Test = fn(&GpuAdapter);

fn main() -> ExitCode {
    let arguments = Arguments::from_args();
    let adapters = GpuAdapter::all();
    let mut trials = Vec::new();
    for (name, eps, _) in CASES {
        let title = format!("golden {name}{eps}");
        trials.extend(on_each(&adapters, &title, move |adapter| {
            golden(adapter, name, eps);
        }));
    }
    let tests: [(&str, Test); 13] = [
        ("three runs give the same bytes", repeated),
        ("tile sizes give the same bytes", tile_sizes),
        ("sub-frames give the same bytes", split_into_sub_frames),
        ("permuted input gives the same bytes", permuted),
        ("buffers grow from view to view", growth),
        ("one upload serves many views", many_views),
        ("degenerate scenes", degenerate),
        ("needles, and opacities of 0 and 1", needles),
        ("every reason to drop is counted as on the CPU", reasons),
        ("pictures of every shape", shapes),
        ("16384 wide", wide),
        (
            "the speed scene agrees with the CPU to 90 dB",
            speed_scene_psnr,
        ),
        ("6048x4032 takes half a gigabyte", large),
    ];
    for (name, test) in tests {
        trials.extend(on_each(&adapters, name, test));
    }
    libtest_mimic::run(&arguments, trials).exit_code()
}

/// One trial per adapter, or a single ignored trial if there is none.
fn on_each(
    adapters: &[GpuAdapter],
    title: &str,
    test: impl Fn(&GpuAdapter) + Copy + Send + 'static,
) -> Vec<Trial> {
    if adapters.is_empty() {
        let trial = Trial::test(format!("{title} (no adapter)"), || Ok(()));
        return vec![trial.with_ignored_flag(true)];
    }
    let trial = |adapter: &GpuAdapter| {
        let adapter = adapter.clone();
        Trial::test(format!("{title} on {adapter}"), move || {
            test(&adapter);
            Ok(())
        })
    };
    adapters.iter().map(trial).collect()
}

fn case(name: &str, suffix: &str) -> Golden {
    let (.., eps2d) = CASES
        .into_iter()
        .find(|(n, s, _)| (*n, *s) == (name, suffix))
        .unwrap();
    Golden::load(name, suffix, eps2d)
}

fn golden(adapter: &GpuAdapter, name: &str, suffix: &str) {
    let golden = case(name, suffix);
    let mut renderer = GpuRenderer::new(adapter).unwrap();
    let found = renderer.render(&golden.scene, &golden.view).unwrap();
    let deviation = golden.deviation(&found);
    println!("{name}{suffix}: {deviation:?}");
    assert!(deviation.is_within_bars(), "{name}{suffix}: {deviation:?}");
    let expected = CpuRenderer::new()
        .render(&golden.scene, &golden.view)
        .unwrap();
    // f32 may decide differently whether a Gaussian that touches a plane or the picture's edge is drawn.
    assert!(found.drawn.abs_diff(expected.drawn) <= 1, "{}", found.drawn);
    assert_eq!(found.dropped.invalid(), expected.dropped.invalid());
}

fn repeated(adapter: &GpuAdapter) {
    let golden = case("s5_degenerate20k", "");
    let render = || {
        let mut renderer = GpuRenderer::new(adapter).unwrap();
        renderer.render(&golden.scene, &golden.view).unwrap()
    };
    let first = render();
    assert!(first == render());
    assert!(first == render());
}

fn split_into_sub_frames(adapter: &GpuAdapter) {
    let golden = case("s5_degenerate20k", "");
    let mut view = golden.view;
    view.intrinsics = view.intrinsics.resized(517, 389);
    let render = |limit: u64| {
        let renderer = GpuRenderer::new(adapter).unwrap();
        let mut renderer = renderer.with_binding_limit(limit);
        renderer.render(&golden.scene, &view)
    };
    let whole = render(u64::MAX).unwrap();
    // 4 MiB can hold the picture but not the pairs; 20 000 Gaussians need 320 KB.
    for limit in [4 << 20, 1 << 20, 320_000] {
        assert!(whole == render(limit).unwrap(), "{limit}");
    }
    let error = render(300_000).unwrap_err();
    assert!(matches!(error, RenderError::OutOfMemory { .. }));
    assert!(error.to_string().contains("20000 Gaussians"), "{error}");
}

fn tile_sizes(adapter: &GpuAdapter) {
    for (name, suffix) in [("s4_rand2k", ".eps0.3"), ("s5_degenerate20k", "")] {
        let golden = case(name, suffix);
        let mut view = golden.view;
        view.intrinsics = view.intrinsics.resized(517, 389);
        let render = |tile: TileSize| {
            let renderer = GpuRenderer::new(adapter).unwrap();
            let mut renderer = renderer.with_tile_size(tile);
            renderer.render(&golden.scene, &view).unwrap()
        };
        let eight = render(TileSize::Px8);
        assert!(eight == render(TileSize::Px16), "{name}: 16");
        assert!(eight == render(TileSize::Px32), "{name}: 32");
    }
}

fn permuted(adapter: &GpuAdapter) {
    let golden = case("s5_degenerate20k", "");
    let scene = render_support::without_ties(&golden.scene, &golden.view);
    let shuffled = render_support::shuffled(&scene);
    let mut renderer = GpuRenderer::new(adapter).unwrap();
    let first = renderer.render(&scene, &golden.view).unwrap();
    assert!(first == renderer.render(&shuffled, &golden.view).unwrap());
}

/// A renderer keeps the buffers of a small view and a small scene; larger views and scenes must
/// still fit.
fn growth(adapter: &GpuAdapter) {
    let (small, large) = (case("s4_rand2k", ".eps0"), case("s5_degenerate20k", ""));
    let mut wide = large.view;
    wide.intrinsics = wide.intrinsics.resized(1023, 771);
    let tasks = [
        (&small.scene, small.view),
        (&large.scene, large.view),
        (&large.scene, wide),
        (&small.scene, small.view),
    ];
    let mut kept = GpuRenderer::new(adapter).unwrap();
    let mut peaks = Vec::new();
    for (scene, view) in tasks {
        let mut fresh = GpuRenderer::new(adapter).unwrap();
        assert!(kept.render(scene, &view).unwrap() == fresh.render(scene, &view).unwrap());
        peaks.push(kept.peak_bytes());
    }
    assert!(peaks[0] < peaks[1] && peaks[1] < peaks[2] && peaks[2] == peaks[3]);
}

fn many_views(adapter: &GpuAdapter) {
    let golden = case("s4_rand2k", ".eps0");
    let views: Vec<RenderView> = (0..4)
        .map(|i| {
            let mut view = golden.view;
            view.camera_from_scene.translation.x += 0.05 * f64::from(i);
            view.intrinsics = view.intrinsics.resized(128 - 9 * i as u32, 96 + i as u32);
            view
        })
        .collect();
    let mut renderer = GpuRenderer::new(adapter).unwrap();
    let mut found: Vec<RenderOutput> = Vec::new();
    renderer
        .render_views(&golden.scene, &views, &mut |index, picture| {
            assert_eq!(index, found.len());
            found.push(picture);
        })
        .unwrap();
    for (view, found) in views.iter().zip(&found) {
        // Drawing without copying leaves nothing behind for the next picture.
        let mut loaded = renderer.load(&golden.scene).unwrap();
        assert!(loaded.draw_on_device(view).unwrap());
        assert!(*found == loaded.render(view).unwrap());
    }
    assert_eq!(found.len(), 4);
}

fn degenerate(adapter: &GpuAdapter) {
    let mut renderer = GpuRenderer::new(adapter).unwrap();
    let view = random::view(70, 50);
    let empty = renderer.render(&Gaussians::default(), &view).unwrap();
    assert_eq!(empty.alpha, vec![0.0; 3500]);
    let recipe = Recipe {
        count: 4000,
        scales: (0.004, 0.2),
        opacities: (0.0, 1.0),
    };
    let mut scene = random::scene(&mut Random(10), recipe);
    random::make_extreme(&mut scene);
    let found = renderer.render(&scene, &view).unwrap();
    assert!(found.rgb.iter().flatten().all(|v| v.is_finite()));
    assert!(found.alpha.iter().all(|v| (0.0..=0.9999).contains(v)));
    assert_eq!(found.drawn + found.dropped.total(), 4000);
    let broken = CpuRenderer::new().render(&scene, &view).unwrap();
    assert_eq!(found.dropped.invalid(), broken.dropped.invalid());
    for mean in &mut scene.means {
        mean[2] = -mean[2].abs();
    }
    let behind = renderer.render(&scene, &view).unwrap();
    assert_eq!(behind.rgb, vec![[0.0; 3]; 3500]);
}

fn reasons(adapter: &GpuAdapter) {
    let mut renderer = GpuRenderer::new(adapter).unwrap();
    for (scene, dropped) in drops::scenes() {
        let view = random::view(16, 16);
        let found = renderer.render(&scene, &view).unwrap();
        let cpu = CpuRenderer::new().render(&scene, &view).unwrap();
        assert_eq!(found.dropped, dropped, "{scene:?}");
        assert_eq!(found.drawn + dropped.total(), 1, "{scene:?}");
        let seen = |output: &RenderOutput| output.alpha.iter().any(|a| *a > 0.0);
        assert_eq!(seen(&found), seen(&cpu), "{scene:?}");
        assert!(found.drawn == 1 || !seen(&found), "{scene:?}");
    }
}

fn needles(adapter: &GpuAdapter) {
    let mut renderer = GpuRenderer::new(adapter).unwrap();
    for seed in 100..112 {
        let mut random = Random(seed);
        // Elongations of up to 5000; most Gaussians are far thinner than a pixel.
        let recipe = Recipe {
            count: 400,
            scales: (0.0002, 1.0),
            opacities: (0.3, 1.0),
        };
        let mut scene = random::scene(&mut random, recipe);
        for (k, opacity) in scene.opacities.iter_mut().enumerate() {
            match k % 5 {
                0 => *opacity = 0.0,
                1 => *opacity = 1.0,
                _ => (),
            }
        }
        let mut view = random::view(81, 61);
        view.camera_from_scene = random::movement(&mut random);
        let found = renderer.render(&scene, &view).unwrap();
        reference::render(&scene, &view).assert_close(&found, &format!("seed {seed}"));
        let cpu = CpuRenderer::new().render(&scene, &view).unwrap();
        assert_eq!(found.dropped.transparent, cpu.dropped.transparent);
        assert!(found.dropped.transparent > 0);
    }
}

fn shapes(adapter: &GpuAdapter) {
    let mut renderer = GpuRenderer::new(adapter).unwrap();
    let recipe = Recipe {
        count: 60,
        scales: (0.004, 0.2),
        opacities: (0.0, 1.0),
    };
    let scene = random::scene(&mut Random(7), recipe);
    for (width, height) in [(1, 1), (1, 9), (9, 1), (3, 5), (63, 2), (129, 3), (67, 66)] {
        let view = random::view(width, height);
        let truth = reference::render(&scene, &view);
        let found = renderer.render(&scene, &view).unwrap();
        truth.assert_close(&found, &format!("{width}x{height}"));
    }
}

fn wide(adapter: &GpuAdapter) {
    let recipe = Recipe {
        count: 40,
        scales: (0.02, 0.1),
        opacities: (0.3, 1.0),
    };
    let mut scene = random::scene(&mut Random(8), recipe);
    for mean in &mut scene.means {
        mean[1] *= 1e-4;
    }
    let mut view = random::view(16_384, 3);
    view.intrinsics.cy = 1.3;
    let found = GpuRenderer::new(adapter).unwrap().render(&scene, &view);
    let cpu = CpuRenderer::new().render(&scene, &view).unwrap();
    assert!(psnr(&found.unwrap(), &cpu) > 90.0);
}

fn speed_scene_psnr(adapter: &GpuAdapter) {
    let scene = speed_scene::scene(1.0);
    let view = speed_scene::view(1536, 1536);
    let mut renderer = GpuRenderer::new(adapter).unwrap();
    let found = renderer.render(&scene, &view).unwrap();
    let cpu = CpuRenderer::new().render(&scene, &view).unwrap();
    let psnr = psnr(&found, &cpu);
    let mut largest = 0.0_f32;
    for (a, b) in found.rgb.iter().zip(&cpu.rgb) {
        for channel in 0..3 {
            largest = largest.max((a[channel] - b[channel]).abs());
        }
    }
    println!("{psnr:.1} dB, largest difference {largest:e}");
    assert!(psnr >= 90.0, "{psnr} dB");
    assert!(largest <= 1.0 / 255.0 + 1e-4, "{largest}");
}

/// Prints the size of the buffers; the pixels of a 24-megapixel picture need three bindings.
fn large(adapter: &GpuAdapter) {
    let scene = speed_scene::scene(1.0);
    let view = speed_scene::view(6048, 4032);
    let mut renderer = GpuRenderer::new(adapter).unwrap();
    let found = renderer.render(&scene, &view).unwrap();
    let megabytes = renderer.peak_bytes() as f64 / 1e6;
    println!("{megabytes:.1} MB of buffers on {adapter}");
    assert!(megabytes < 525.0, "{megabytes}");
    let cpu = CpuRenderer::new().render(&scene, &view).unwrap();
    assert!(psnr(&found, &cpu) >= 90.0);
}

/// PSNR of colour and alpha, range 1.
fn psnr(a: &RenderOutput, b: &RenderOutput) -> f64 {
    let mut sum = 0.0;
    for i in 0..a.alpha.len() {
        sum += f64::from(a.alpha[i] - b.alpha[i]).powi(2);
        for channel in 0..3 {
            sum += f64::from(a.rgb[i][channel] - b.rgb[i][channel]).powi(2);
        }
    }
    -10.0 * (sum / (4 * a.alpha.len()) as f64).log10()
}
