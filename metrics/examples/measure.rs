//! Measures one metric and prints a line of JSON: CPU seconds, wall seconds, peak memory, and the memory that
//! `memory_bytes` predicts.
//!
//! ```text
//! measure KEY WIDTH HEIGHT [predictions=N] [apart] [repeat=N] [turns] [threads=N] [strip=N] [simd=NAME] [direct]
//! ```
//! The pictures are synthetic and the weights deterministic, since the measurement does not depend on values. Several
//! predictions of one target are scored together, or one after the other with `apart`. Preparation of weights and
//! pictures is not timed. With `turns`, a first call is not timed either, and then each line of standard input triggers
//! one measurement, which lets `benches/compare.py` alternate with PyTorch and scikit-image. Peak memory is read from
//! Linux's `/proc` and is 0 on other systems.

#![allow(clippy::print_stdout, reason = "an example that prints its result")]

use std::error::Error;
use std::time::Instant;

use cpu_time::ProcessTime;
use image::{Rgb, RgbImage};
use sharp_metrics::{
    Algorithm, MetricKey, Picture, Scorer, ScorerOptions, Selection, Simd, Weights,
};

fn main() -> Result<(), Box<dyn Error>> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let [key, width, height, rest @ ..] = &arguments[..] else {
        return Err("usage: measure KEY WIDTH HEIGHT [option=value]…".into());
    };
    let key: MetricKey = key.parse()?;
    let (width, height) = (width.parse()?, height.parse()?);
    let mut options = ScorerOptions::default();
    let (mut predictions, mut apart) = (1, false);
    let (mut repeat, mut turns) = (1_u32, false);
    for option in rest {
        match option.split_once('=') {
            Some(("predictions", n)) => predictions = n.parse()?,
            Some(("repeat", n)) => repeat = n.parse()?,
            Some(("strip", n)) => options.strip_rows = Some(n.parse()?),
            Some(("threads", n)) => rayon::ThreadPoolBuilder::new()
                .num_threads(n.parse()?)
                .build_global()?,
            Some(("simd", name)) => {
                options.simd = Simd::pin(name.parse()?)?;
            }
            None if option == "direct" => options.algorithm = Algorithm::Direct,
            None if option == "apart" => apart = true,
            None if option == "turns" => turns = true,
            _ => return Err(format!("unknown option '{option}'").into()),
        }
    }
    let scorer =
        Scorer::with_options(&Selection::of(&[key]), &Weights::deterministic(""), options)?;
    let pictures = (0..=predictions).map(|i| texture(width, height, 40 * i));
    let work = Work {
        scorer,
        pictures: pictures.collect(),
        apart,
        repeat,
    };
    if turns {
        work.score()?;
        for line in std::io::stdin().lines() {
            line?;
            println!("{}", work.measure()?);
        }
    } else {
        println!("{}", work.measure()?);
    }
    Ok(())
}

struct Work {
    scorer: Scorer,
    /// The target, then the predictions.
    pictures: Vec<Picture>,
    apart: bool,
    repeat: u32,
}

impl Work {
    /// The mean score of the predictions.
    fn score(&self) -> Result<f64, Box<dyn Error>> {
        let [target, predictions @ ..] = &self.pictures[..] else {
            return Err("no pictures".into());
        };
        let group = if self.apart { 1 } else { predictions.len() };
        let mut sum = 0.0;
        for group in predictions.chunks(group) {
            let group: Vec<&Picture> = group.iter().collect();
            for scores in self.scorer.score_all(target, &group, None) {
                let (_, value) = scores?.swap_remove(0);
                sum += value?;
            }
        }
        Ok(sum / predictions.len() as f64)
    }

    fn measure(&self) -> Result<String, Box<dyn Error>> {
        let (cpu, wall) = (ProcessTime::now(), Instant::now());
        let mut value = f64::NAN;
        for _ in 0..self.repeat {
            value = self.score()?;
        }
        let share = |seconds: f64| seconds / f64::from(self.repeat);
        let (width, height) = self.pictures[0].dimensions();
        let together = if self.apart {
            1
        } else {
            self.pictures.len() - 1
        };
        let counted = self.scorer.memory_bytes((width, height), together);
        Ok(format!(
            "{{\"key\": \"{}\", \"width\": {width}, \"height\": {height}, \"predictions\": {}, \
             \"apart\": {}, \"cpu_s\": {:.6}, \"wall_s\": {:.6}, \"peak_mib\": {:.0}, \
             \"counted_mib\": {:.0}, \"score\": {value:.9}, \"networks\": \"{}\"}}",
            self.scorer.keys()[0],
            self.pictures.len() - 1,
            self.apart,
            share(cpu.elapsed().as_secs_f64()),
            share(wall.elapsed().as_secs_f64()),
            peak_mib(),
            counted as f64 / f64::from(1 << 20),
            self.scorer.options().arithmetic(),
        ))
    }
}

/// Waves and noise, 8 bit.
fn texture(width: u32, height: u32, seed: u32) -> Picture {
    Picture::from(RgbImage::from_fn(width, height, |x, y| {
        let noise = (x * 1973 + y * 9277 + seed * 26_699).wrapping_mul(2_654_435_761) >> 27;
        let wave = |period: f32| ((x as f32 / period).sin() + (y as f32 / period).cos()) * 50.0;
        let level = |period: f32| (127.0 + wave(period)) as u32 + noise;
        Rgb([level(7.0), level(23.0), level(61.0)].map(|v| v.min(255) as u8))
    }))
}

fn peak_mib() -> f64 {
    let status = std::fs::read_to_string("/proc/self/status").unwrap_or_default();
    let line = status.lines().find_map(|line| line.strip_prefix("VmHWM:"));
    let kib = line.and_then(|line| line.trim().strip_suffix(" kB")?.trim().parse::<f64>().ok());
    kib.unwrap_or(0.0) / 1024.0
}
