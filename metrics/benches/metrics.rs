//! Times the default variant of every metric on a pair of 512 × 384 pixels.

#![allow(missing_docs, reason = "criterion's macros define public functions")]

use criterion::{Criterion, criterion_group, criterion_main};
use image::{Rgb, RgbImage};
use sharp_metrics::{Picture, Scorer, Selection, Weights};

fn texture(seed: u32) -> Picture {
    Picture::from(RgbImage::from_fn(512, 384, |x, y| {
        let v = (x * 73 + y * 151 + x * y + seed).wrapping_mul(2_654_435_761) >> 20;
        Rgb([(v & 255) as u8, (x * 5 + seed) as u8, (v >> 4) as u8])
    }))
}

fn metrics(criterion: &mut Criterion) {
    let (prediction, target) = (texture(1), texture(90));
    let mut group = criterion.benchmark_group("512x384");
    group.sample_size(10);
    for key in [
        "psnr",
        "ssim-gauss11-valid",
        "ssim-gauss11-zero",
        "ssim-uniform7-sample",
        "lpips-alex",
        "lpips-squeeze",
        "lpips-vgg",
        "dists",
    ] {
        let selection = Selection::parse(key);
        let scorer = selection.map(|s| Scorer::new(&s, &Weights::deterministic("")));
        let Ok(Ok(scorer)) = scorer else {
            continue;
        };
        group.bench_function(key, |bencher| {
            bencher.iter(|| scorer.score(&prediction, &target, None));
        });
    }
    group.finish();
}

criterion_group!(benches, metrics);
criterion_main!(benches);
