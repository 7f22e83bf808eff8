//! The attack: hostile invocations of the real binary, generated from seeds. Each has to end as users may expect of it:
//! with a clean error, or with a number that an oracle of its own finds right.
//!
//! * `case`: one invocation with its limits, and what must hold of any.
//! * `oracle`: numbers computed here, to compare with.
//! * `spoil`: what is done to files and texts.
//! * the others: the kinds of attack, by what is hostile.
//!
//! `SHARP_ATTACK_CASES` is how many there are of all kinds together, `SHARP_ATTACK_SEED` the first seed; a case depends on
//! its kind and seed alone. A failing one says how to repeat it, and keeps its folder.

#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::print_stdout,
    clippy::print_stderr,
    reason = "test code outside of #[test] functions"
)]

mod arguments;
mod bundles;
mod case;
mod datasets;
mod lists;
mod names;
mod oracle;
mod pictures;
mod programs;
mod runs;
mod scenes;
mod spoil;

use std::sync::Mutex;
use std::time::Instant;

use case::{Case, Verdict};
use libtest_mimic::{Arguments, Trial};

/// One case; what went wrong otherwise.
type Attack = fn(&mut Case) -> Result<Verdict, String>;

/// What is hostile, and the attack.
const KINDS: [(&str, Attack); 15] = [
    ("arguments", arguments::options),
    ("bundles", bundles::bundles),
    ("caches", lists::caches),
    ("cameras", scenes::cameras),
    ("checkpoints", scenes::checkpoints),
    ("dataset_depth", datasets::depth),
    ("dataset_metadata", datasets::metadata),
    ("dataset_pictures", datasets::pictures),
    ("gaussians", scenes::gaussians),
    ("metrics_pictures", pictures::metrics),
    ("names", names::names),
    ("pair_lists", lists::pairs),
    ("predictions", pictures::predictions),
    ("programs", programs::programs),
    ("run_folders", runs::runs),
];

/// Cases of all kinds together where no number is given.
const CASES: u64 = 45;

/// Of a kind: clean errors, right numbers, failures.
type Tally = [u64; 3];

static TALLIES: Mutex<[Tally; KINDS.len()]> = Mutex::new([[0; 3]; KINDS.len()]);

fn main() {
    let arguments = Arguments::from_args();
    let number = |name: &str, default: u64| match std::env::var(name) {
        Ok(text) => text.parse().expect(name),
        Err(_) => default,
    };
    let each = number("SHARP_ATTACK_CASES", CASES).div_ceil(KINDS.len() as u64);
    let first = number("SHARP_ATTACK_SEED", 1);
    let trials = KINDS.iter().enumerate().map(|(at, (kind, attack))| {
        Trial::test(*kind, move || {
            let mut failures = Vec::new();
            for seed in first..first + each {
                let mut case = Case::new(kind, seed);
                let verdict = attack(&mut case);
                TALLIES.lock().unwrap()[at][match &verdict {
                    Ok(Verdict::Error) => 0,
                    Ok(Verdict::Number) => 1,
                    Err(_) => 2,
                }] += 1;
                if let Err(what) = verdict {
                    failures.push(case.failure(&what));
                }
            }
            match failures.is_empty() {
                true => Ok(()),
                false => Err(failures.join("\n\n").into()),
            }
        })
    });
    let begin = Instant::now();
    let conclusion = libtest_mimic::run(&arguments, trials.collect());
    if !arguments.list {
        report(first, begin.elapsed().as_secs_f64());
    }
    conclusion.exit();
}

/// The table of `reports/reliability.md`.
fn report(seed: u64, secs: f64) {
    println!(
        "| kind | cases | clean errors | right numbers | failures |\n|---|---:|---:|---:|---:|"
    );
    let tallies = TALLIES.lock().unwrap();
    let mut all = [0; 3];
    for ((kind, _), tally) in KINDS.iter().zip(tallies.iter()) {
        let [errors, numbers, failures] = *tally;
        println!(
            "| {kind} | {} | {errors} | {numbers} | {failures} |",
            tally.iter().sum::<u64>()
        );
        all = [all[0] + errors, all[1] + numbers, all[2] + failures];
    }
    let [errors, numbers, failures] = all;
    println!(
        "| all | {} | {errors} | {numbers} | {failures} |",
        all.iter().sum::<u64>()
    );
    println!("first seed {seed}, {secs:.0} s");
}
