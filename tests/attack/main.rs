//! The attack: hostile invocations of the real binary, generated from seeds. Each must end as users
//! may expect: with a clean error, or with a number that an independent oracle confirms.
//!
//! * `case`: one invocation with its limits, and conditions that any invocation must meet.
//! * `oracle`: independently computed numbers.
//! * `spoil`: ways to damage files and texts.
//! * the others: kinds of attack, by the hostile input.
//!
//! `SHARP_ATTACK_CASES` is the number of cases of all kinds together, `SHARP_ATTACK_SEED` the first
//! seed; a case depends only on its kind and seed. A failing case reports how to repeat it, and
//! keeps its folder.

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

/// Runs one case; an error describes what went wrong.
type Attack = fn(&mut Case) -> Result<Verdict, String>;

/// The hostile input and the attack.
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

/// Default number of cases of all kinds together.
const CASES: u64 = 45;

/// For one kind: numbers of clean errors, right numbers and failures.
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
            if failures.is_empty() {
                Ok(())
            } else {
                Err(failures.join("\n\n").into())
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
