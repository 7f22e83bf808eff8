//! The perceptual loss and its gradient, for pictures of 128² and 256² pixels.
//!
//! `cargo bench -p sharp-train`; set `RAYON_NUM_THREADS=1` to time a single core.

#![allow(clippy::expect_used, reason = "a benchmark may panic")]

use std::hint::black_box;

use criterion::{Criterion, criterion_group, criterion_main};
use sharp::model::{Algorithm, Compute};
use sharp::random::SplitMix64;
use sharp_train::losses::{Perceptual, PerceptualOptions};

fn perceptual(c: &mut Criterion) {
    let loss = Perceptual::new(
        PerceptualOptions::default(),
        Compute::cpu(Algorithm::Winograd),
    )
    .expect("the bundled weights");
    let mut random = SplitMix64::new(0);
    for side in [128, 256] {
        let mut picture = || -> Vec<[f32; 3]> {
            let pixel = |_| [0; 3].map(|_| random.between(0.0, 1.0) as f32);
            (0..side * side).map(pixel).collect()
        };
        let (x, y) = (picture(), picture());
        c.bench_function(&format!("perceptual loss, VGG16, {side}"), |b| {
            b.iter(|| black_box(loss.compare(&x, &y, side, None, 0)));
        });
    }
}

criterion_group! {
    name = losses;
    config = Criterion::default().sample_size(10);
    targets = perceptual
}
criterion_main!(losses);
