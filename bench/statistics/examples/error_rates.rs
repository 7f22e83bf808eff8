//! Error rates of the inference in simulated comparisons. Writes `reports/statistics.md` to standard output.
//!
//! usage: `error_rates [SIMULATIONS]`

use std::error::Error;
use std::f64::consts::TAU;
use std::fmt::Write as _;
use std::io::{Write, stdout};

use rayon::prelude::*;
use sharp::random::{SplitMix64, mix};
use sharp_statistics::{ALPHA, Clusters, Inference, NoInference, Resampling, infer};

/// Standard deviation of a pair's difference around that of its scene, as a fraction of the score.
const PAIR_NOISE: f64 = 0.05;
/// Standard deviation of the scenes' differences around the true mean, as a fraction of the score.
const SCENE_NOISE: f64 = 0.02;
/// Simulated change of every second scene, as a fraction of the score.
const SHIFT: f64 = 0.02;

/// Distribution of scenes around the true mean, with standard deviation `SCENE_NOISE`.
#[derive(Clone, Copy)]
enum Scenes {
    Normal,
    /// A shifted exponential: most scenes change a little, a few change much.
    Skewed,
    /// Every second scene varies three times as much as the others.
    Uneven,
}

#[derive(Clone)]
struct Design {
    name: String,
    /// Pairs per scene, for each dataset.
    datasets: Vec<Vec<usize>>,
    scenes: Scenes,
}

impl Design {
    fn new(name: impl Into<String>, datasets: Vec<Vec<usize>>) -> Self {
        Self {
            name: name.into(),
            datasets,
            scenes: Scenes::Normal,
        }
    }

    /// Equally many pairs in all scenes and datasets.
    fn equal(datasets: usize, scenes: usize, pairs: usize) -> Self {
        let name = format!("{datasets} × {scenes} × {pairs}");
        Self::new(name, vec![vec![pairs; scenes]; datasets])
    }
}

/// The designs that the method is meant for; the bounds hold for all of them.
fn regular() -> Vec<Design> {
    let one_large = |n: usize| {
        (0..n)
            .map(|k| if k == 0 { 10 * (n - 1) } else { 10 })
            .collect()
    };
    let growing = (0..10).map(|k| (5.0 * 1.5_f64.powi(k)) as usize).collect();
    let various = vec![4, 8, 10, 12, 15, 18, 20, 22, 25, 30, 36, 40, 60];
    let cycled = (0..45).map(|k| [4, 8, 16][k % 3]).collect();
    let mixed = vec![vec![70; 7], various.clone(), vec![8; 40]];
    vec![
        Design::equal(6, 10, 8),
        Design::equal(1, 7, 70),
        Design::equal(1, 3, 100),
        Design::new("13 scenes of 4 to 60 pairs", vec![various]),
        Design::new(
            "10 scenes of 5 to 192 pairs, each half as many again",
            vec![growing],
        ),
        Design::new(
            "4 scenes of 10, 20, 40, 80 pairs",
            vec![vec![10, 20, 40, 80]],
        ),
        Design::new("7 scenes, one with half of all pairs", vec![one_large(7)]),
        Design::new("20 scenes, one with half of all pairs", vec![one_large(20)]),
        Design::new("40 scenes, one with half of all pairs", vec![one_large(40)]),
        Design::new("7 × 70, 13 of 4 to 60, and 40 × 8: three datasets", mixed),
        Design::equal(1, 40, 8),
        Design::new("45 scenes of 4, 8 or 16 pairs", vec![cycled]),
    ]
}

/// Designs whose scenes are not normal or differ in spread.
fn irregular() -> Vec<Design> {
    let kinds = [(Scenes::Uneven, "uneven"), (Scenes::Skewed, "skewed")];
    let with = |(scenes, word): (Scenes, &str), design: Design| Design {
        name: format!("{}, {word}", design.name),
        scenes,
        ..design
    };
    let of_kind = |kind| {
        let sizes = [(1, 7, 70), (6, 10, 8), (1, 40, 8), (1, 100, 8)];
        sizes.map(|(datasets, scenes, pairs)| with(kind, Design::equal(datasets, scenes, pairs)))
    };
    kinds.into_iter().flat_map(of_kind).collect()
}

fn normal(random: &mut SplitMix64) -> f64 {
    let radius = (-2.0 * (1.0 - random.between(0.0, 1.0)).ln()).sqrt();
    radius * (TAU * random.between(0.0, 1.0)).cos()
}

impl Design {
    /// Simulates one comparison. `shift` gives the average change of scene k of each dataset.
    fn simulate(&self, seed: u64, shift: fn(usize) -> f64) -> Result<Inference, NoInference> {
        let mut random = SplitMix64::new(mix(!seed));
        let mut datasets = Vec::new();
        for sizes in &self.datasets {
            let mut pairs = Vec::new();
            for (scene, size) in sizes.iter().enumerate() {
                let deviation = match self.scenes {
                    Scenes::Normal => normal(&mut random),
                    Scenes::Skewed => -(1.0 - random.between(0.0, 1.0)).ln() - 1.0,
                    Scenes::Uneven => normal(&mut random) * [0.447, 1.342][scene % 2],
                };
                let of_scene = shift(scene) + SCENE_NOISE * deviation;
                pairs.extend((0..*size).map(|_| {
                    let difference = of_scene + PAIR_NOISE * normal(&mut random);
                    (scene, [1.0, 1.0 + difference])
                }));
            }
            datasets.push(Clusters::new(pairs));
        }
        let resampling = Resampling {
            seed,
            ..Default::default()
        };
        infer(&datasets.iter().collect::<Vec<_>>(), resampling)
    }

    /// Share of `simulations` for which `holds` is true. Each `series` uses its own seeds.
    fn rate(
        &self,
        (simulations, series): (u64, u64),
        shift: fn(usize) -> f64,
        holds: impl Fn(&Inference) -> bool + Sync,
    ) -> f64 {
        let seeds = (0..simulations).into_par_iter().map(|k| (series << 32) + k);
        let count = seeds
            .filter(|seed| {
                self.simulate(*seed, shift)
                    .is_ok_and(|inference| holds(&inference))
            })
            .count();
        count as f64 / simulations as f64
    }

    fn false_alarms(&self, simulations: u64) -> f64 {
        self.rate((simulations, 0), |_| 0.0, |inference| inference.p < ALPHA)
    }

    /// Coverage: how often the interval contains a true mean that is not zero.
    fn coverage(&self, simulations: u64) -> f64 {
        let holds =
            |inference: &Inference| inference.interval.0 <= SHIFT && inference.interval.1 >= SHIFT;
        self.rate((simulations, 1), |_| SHIFT, holds)
    }

    fn power(&self, simulations: u64) -> f64 {
        let every_second = |scene| if scene % 2 == 0 { SHIFT } else { 0.0 };
        self.rate((simulations, 2), every_second, |inference| {
            inference.p < ALPHA
        })
    }
}

const INTRODUCTION: &str = "\
# Error rates of the comparison

Simulated comparisons of two runs. Each pair's difference varies around its scene's with a standard deviation of 5 % of the
score, and scenes vary around the true mean by 2 %. `6 × 10 × 8` means 6 datasets of 10 scenes of 8 pairs. A false alarm is
p < 0.05 without any difference; coverage is how often the 95 % interval contains the true mean; power is how often p < 0.05
if every second scene changes by 2 %. Percentages of ";

const REGULAR: &str = "\
| design | false alarms | coverage | power |
|---|---:|---:|---:|
";

const IRREGULAR: &str = "
Student's t assumes that scenes are normally distributed with the same spread. If they are not, the rate of false alarms differs.
*Uneven*: every second scene varies three times as much as the others. *Skewed*: a shifted exponential, so that most scenes
change a little and a few change much. With few skewed scenes, the t test is too liberal, and seven numbers cannot reveal this.

| design | false alarms | coverage | power |
|---|---:|---:|---:|
";

const REACHED: &str = "
Number of scenes needed to detect the same change of every second scene 90 times out of 100:

| design | power |
|---|---:|
";

fn report(simulations: u64) -> Result<String, std::fmt::Error> {
    let mut text = format!(
        "{INTRODUCTION}{simulations} simulations each, computed by\n\n```console\n\
         $ cargo run --release -p sharp-statistics --example error_rates {simulations} > reports/statistics.md\n```\n\n"
    );
    let percent = |rate: f64| format!("{:.1}", 100.0 * rate);
    for (head, designs) in [(REGULAR, regular()), (IRREGULAR, irregular())] {
        text.push_str(head);
        for design in designs {
            let alarms = percent(design.false_alarms(simulations));
            let coverage = percent(design.coverage(simulations));
            let power = percent(design.power(simulations));
            writeln!(
                text,
                "| {} | {alarms} | {coverage} | {power} |",
                design.name
            )?;
        }
    }
    text.push_str(REACHED);
    for (datasets, scenes) in [(1, 20..), (6, 6..)] {
        for scenes in scenes.step_by(if datasets == 1 { 20 } else { 2 }) {
            let design = Design::equal(datasets, scenes, 8);
            let power = design.power(simulations);
            writeln!(text, "| {} | {} |", design.name, percent(power))?;
            if power >= 0.9 {
                break;
            }
        }
    }
    Ok(text)
}

fn main() -> Result<(), Box<dyn Error>> {
    let simulations = std::env::args().nth(1).map_or(Ok(1000), |n| n.parse())?;
    stdout().write_all(report(simulations)?.as_bytes())?;
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::*;

    /// With a true rate of 5 % and 1000 simulations, the observed rate is below this bound in 97.5
    /// % of cases. The tests run twice as many simulations, so that rounding on another machine
    /// cannot change their outcome.
    const MAX_ALARMS: f64 = 0.064;

    #[test]
    fn false_alarms_and_coverage_keep_their_bounds() {
        // The four kinds of designs: many scenes, few, very few, and scenes of unequal size.
        for design in &regular()[..6] {
            let (alarms, coverage) = (design.false_alarms(2000), design.coverage(2000));
            let name = &design.name;
            assert!(alarms <= MAX_ALARMS, "{name}: {alarms} false alarms");
            assert!(
                (0.93..=0.97).contains(&coverage),
                "{name}: coverage {coverage}"
            );
        }
    }

    #[test]
    fn a_change_is_found_more_often_than_by_chance() {
        assert!(Design::equal(1, 100, 8).power(200) > 0.8);
    }
}
