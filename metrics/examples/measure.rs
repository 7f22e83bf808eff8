//! Measures one metric on one pair: CPU seconds, wall seconds, peak memory, as a line of JSON.
//!
//! ```text
//! measure KEY WIDTH HEIGHT [repeat=N] [threads=N] [strip=N] [simd=portable|avx2|avx512] [direct]
//! ```
//! The pair is synthetic, the weights deterministic: what is measured does not depend on values.
//! CPU time and memory come from Linux's `/proc` and are 0 elsewhere. Preparing the weights and
//! the pictures is not counted as time. `benches/compare.py` sets the numbers beside those of
//! PyTorch and scikit-image.

#![allow(clippy::print_stdout, reason = "an example that prints its result")]

use std::error::Error;
use std::time::Instant;

use image::{Rgb, RgbImage};
use sharp_kernels::{Algorithm, Level, Simd};
use sharp_metrics::{MetricKey, Picture, Scorer, ScorerOptions, Selection, Weights};

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [key, width, height, rest @ ..] = &arguments[..] else {
        return Err("usage: measure KEY WIDTH HEIGHT [option=value]…".into());
    };
    let key: MetricKey = key.parse()?;
    let (width, height) = (width.parse()?, height.parse()?);
    let mut options = ScorerOptions::default();
    let mut repeat = 1_u32;
    for option in rest {
        match option.split_once('=') {
            Some(("repeat", n)) => repeat = n.parse()?,
            Some(("strip", n)) => options.strip_rows = Some(n.parse()?),
            Some(("threads", n)) => rayon::ThreadPoolBuilder::new()
                .num_threads(n.parse()?)
                .build_global()?,
            Some(("simd", name)) => {
                let level = Level::from_name(name).ok_or("no such instruction set")?;
                options.simd = Simd::new(level).ok_or("this machine lacks it")?;
            }
            None if option == "direct" => options.algorithm = Algorithm::Direct,
            _ => return Err(format!("unknown option '{option}'").into()),
        }
    }
    let scorer =
        Scorer::with_options(&Selection::of(&[key]), &Weights::deterministic(""), options)?;
    let (prediction, target) = (texture(width, height, 0), texture(width, height, 40));
    let (cpu, wall) = (cpu_seconds(), Instant::now());
    let mut score = f64::NAN;
    for _ in 0..repeat {
        let (_, value) = scorer.score(&prediction, &target, None)?.swap_remove(0);
        score = value?;
    }
    let repeat = f64::from(repeat);
    println!(
        "{{\"key\": \"{key}\", \"width\": {width}, \"height\": {height}, \"cpu_s\": {:.4}, \
         \"wall_s\": {:.4}, \"peak_mib\": {:.0}, \"score\": {score:.9}, \"simd\": \"{}\"}}",
        (cpu_seconds() - cpu) / repeat,
        wall.elapsed().as_secs_f64() / repeat,
        peak_mib(),
        options.simd.level(),
    );
    Ok(())
}

/// Waves and noise in 8 bits.
fn texture(width: u32, height: u32, seed: u32) -> Picture {
    Picture::from(RgbImage::from_fn(width, height, |x, y| {
        let noise = (x * 1973 + y * 9277 + seed * 26_699).wrapping_mul(2_654_435_761) >> 27;
        let wave = |period: f32| ((x as f32 / period).sin() + (y as f32 / period).cos()) * 50.0;
        let level = |period: f32| (127.0 + wave(period)) as u32 + noise;
        Rgb([level(7.0), level(23.0), level(61.0)].map(|v| v.min(255) as u8))
    }))
}

/// User and system time of the process, in the kernel's ticks of a hundredth of a second.
fn cpu_seconds() -> f64 {
    let stat = std::fs::read_to_string("/proc/self/stat").unwrap_or_default();
    let after_name = stat.rsplit(')').next().unwrap_or_default();
    let ticks = after_name.split_whitespace().skip(11).take(2);
    ticks.filter_map(|t| t.parse::<f64>().ok()).sum::<f64>() / 100.0
}

fn peak_mib() -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    let kib = line.and_then(|line| line.trim().strip_suffix(" kB")?.trim().parse::<f64>().ok());
    kib.unwrap_or(0.0) / 1024.0
}
