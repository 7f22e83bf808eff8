//! Renders whole frames of the speed scene. CPU times are seconds of the process, summed over
//! threads; a busy machine distorts them less than wall time. With the feature `gpu`, also measures
//! every adapter, in wall time.
//!
//! `cargo bench -p sharp --features gpu --bench render`

#![allow(clippy::print_stdout, reason = "a benchmark prints")]

mod cpu_time;
mod speed_scene;

use self::cpu_time::CpuTime;
use criterion::{BenchmarkId, Criterion, criterion_group, criterion_main};
use sharp::gaussians::Harmonics;
use sharp::render::{CpuRenderer, PictureGradient, Renderer, Rule, Simd};
use std::time::Duration;

fn frames(criterion: &mut Criterion<CpuTime>) {
    let mut group = criterion.benchmark_group("frame");
    group.sample_size(10).warm_up_time(Duration::from_secs(1));
    let cases = [
        (1.0, 1536, 1536),
        (2.0, 1536, 1536),
        (1.0, 640, 480),
        (1.0, 6048, 4032),
    ];
    for (sigma, width, height) in cases {
        let scene = speed_scene::scene(sigma);
        let view = speed_scene::view(width, height);
        for simd in Simd::available() {
            if simd.instruction_set().name() == "portable" && simd != Simd::detect() {
                continue;
            }
            let mut renderer = CpuRenderer::with_simd(simd);
            let id = BenchmarkId::new(renderer.name(), format!("{width}x{height} sigma {sigma}"));
            group.bench_function(id, |b| b.iter(|| renderer.render(&scene, &view)));
        }
    }
    group.finish();
}

/// Compares view-independent colours with harmonics of degree 3, by a rule that draws both.
fn harmonics(criterion: &mut Criterion<CpuTime>) {
    let mut group = criterion.benchmark_group("harmonics");
    group.sample_size(10).warm_up_time(Duration::from_secs(1));
    let mut view = speed_scene::view(1536, 1536);
    view.rule = Rule::GSPLAT_CLASSIC;
    let mut scene = speed_scene::scene(1.0);
    let mut renderer = CpuRenderer::new();
    for degree in [0, 3] {
        let each = Harmonics::coefficients_of(degree);
        let coefficient = |i: usize| [0, 1, 2].map(|c| ((i * 3 + c) % 101) as f32 * 4e-4 - 0.02);
        scene.harmonics = Harmonics {
            degree,
            coefficients: (0..scene.len() * each).map(coefficient).collect(),
        };
        group.bench_function(BenchmarkId::new("degree", degree), |b| {
            b.iter(|| renderer.render(&scene, &view));
        });
    }
    group.finish();
}

/// Times the forward pass, and the gradient (which includes a forward pass), for the same frames.
fn gradients(criterion: &mut Criterion<CpuTime>) {
    let mut group = criterion.benchmark_group("gradient");
    group.sample_size(10).warm_up_time(Duration::from_secs(1));
    let (width, height) = (1536, 1536);
    let pixels = width as usize * height as usize;
    let (rgb, plane) = (vec![[0.3; 3]; pixels], vec![-0.2; pixels]);
    let gradient = PictureGradient {
        width: width as usize,
        rgb_linear: &rgb,
        alpha: &plane,
        depth_acc: &plane,
    };
    for sigma in [1.0, 2.0] {
        let (scene, view) = (speed_scene::scene(sigma), speed_scene::view(width, height));
        let mut renderer = CpuRenderer::new();
        let title = |pass: &str| BenchmarkId::new(pass, format!("sigma {sigma}"));
        group.bench_function(title("forward"), |b| {
            b.iter(|| renderer.render(&scene, &view));
        });
        group.bench_function(title("backward"), |b| {
            b.iter(|| renderer.backward(&scene, &view, &gradient));
        });
    }
    group.finish();
}

/// Times frames of a scene that is already on the GPU, including reading the pictures back.
#[cfg(feature = "gpu")]
fn gpu_frames(criterion: &mut Criterion) {
    use sharp::render::{GpuAdapter, GpuRenderer};
    let mut group = criterion.benchmark_group("gpu-frame");
    group.sample_size(10).warm_up_time(Duration::from_secs(1));
    for adapter in GpuAdapter::all() {
        for (sigma, width, height) in [
            (1.0, 1536, 1536),
            (2.0, 1536, 1536),
            (1.0, 3000, 2000),
            (1.0, 6048, 4032),
        ] {
            let scene = speed_scene::scene(sigma);
            let view = speed_scene::view(width, height);
            let Ok(mut renderer) = GpuRenderer::new(&adapter) else {
                continue;
            };
            let title = format!("{width}x{height} sigma {sigma}");
            if let Ok(mut loaded) = renderer.load(&scene) {
                let id = BenchmarkId::new(adapter.name(), &title);
                group.bench_function(id, |b| b.iter(|| loaded.render(&view)));
            }
        }
    }
    group.finish();
}

#[cfg(not(feature = "gpu"))]
fn gpu_frames(_criterion: &mut Criterion) {}

criterion_group! {
    name = benches;
    config = Criterion::default().with_measurement(CpuTime);
    targets = frames, harmonics, gradients
}
criterion_group!(gpu, gpu_frames);
criterion_main!(benches, gpu);
