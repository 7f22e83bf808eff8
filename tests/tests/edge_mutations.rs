//! Mutants of the fixtures as input of every parser, which may refuse them but must not panic, hang
//! or use memory that the bytes do not justify. Mutants are seeded; `SHARP_FUZZ_SECONDS` sets the
//! time per parser.

#![allow(
    clippy::unwrap_used,
    clippy::expect_used,
    clippy::print_stderr,
    reason = "test code outside of #[test] functions"
)]

#[path = "../fuzz/parsers.rs"]
mod parsers;

use std::alloc::{GlobalAlloc, Layout, System};
use std::cell::Cell;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::{Path, PathBuf};
use std::time::{Duration, Instant};

use libtest_mimic::{Arguments, Failed, Trial};
use parsers::{DATASET_FILES, PARSERS, Parser};
use sharp_tests::mutants::{Random, mutate};

/// Number of mutants per parser if no time is given.
const MUTANTS: usize = 20_000;

/// Parsers that read folders are slow; if no time is given, they stop after this time.
const PATIENCE: Duration = Duration::from_secs(5);

/// Counts the bytes that each thread allocates, to detect allocations based only on a header.
struct Counting;

thread_local! {
    static LARGEST: Cell<usize> = const { Cell::new(0) };
}

// SAFETY: every call is passed to the system's allocator unchanged.
unsafe impl GlobalAlloc for Counting {
    unsafe fn alloc(&self, layout: Layout) -> *mut u8 {
        LARGEST.with(|largest| largest.set(largest.get().max(layout.size())));
        // SAFETY: the caller fulfils `alloc`'s contract.
        unsafe { System.alloc(layout) }
    }

    unsafe fn dealloc(&self, pointer: *mut u8, layout: Layout) {
        // SAFETY: the caller fulfils `dealloc`'s contract.
        unsafe { System.dealloc(pointer, layout) }
    }
}

#[global_allocator]
static ALLOCATOR: Counting = Counting;

fn main() {
    let arguments = Arguments::from_args();
    let trials = PARSERS
        .iter()
        .map(|parser| Trial::test(parser.name, move || attack(parser)))
        .collect();
    libtest_mimic::run(&arguments, trials).exit();
}

fn attack(parser: &Parser) -> Result<(), Failed> {
    let seeds = seeds(parser);
    if seeds.is_empty() {
        return Err("no seeds".into());
    }
    for (path, seed) in &seeds {
        feed(parser, seed, &path.display().to_string())?;
    }
    let limit = std::env::var("SHARP_FUZZ_SECONDS")
        .ok()
        .and_then(|s| s.parse().ok())
        .map(Duration::from_secs);
    let begin = Instant::now();
    let mut random = Random::new(0x5EED);
    for i in 0_usize.. {
        let over = match limit {
            Some(limit) => begin.elapsed() >= limit,
            None => i >= MUTANTS || begin.elapsed() >= PATIENCE,
        };
        if over {
            if limit.is_some() {
                eprintln!(
                    "{}: {i} mutants in {} s",
                    parser.name,
                    begin.elapsed().as_secs()
                );
            }
            break;
        }
        let (_, seed) = &seeds[random.below(seeds.len())];
        let other = &seeds[random.below(seeds.len())].1;
        let mutant = mutate(seed, other, &mut random);
        feed(parser, &mutant, &format!("mutant {i}"))?;
    }
    Ok(())
}

/// Runs the parser; a mutant that breaks it is saved in the system's folder for temporary files.
fn feed(parser: &Parser, bytes: &[u8], what: &str) -> Result<(), Failed> {
    LARGEST.with(|largest| largest.set(0));
    let begin = Instant::now();
    let outcome = catch_unwind(AssertUnwindSafe(|| (parser.run)(bytes)));
    let largest = LARGEST.with(Cell::get);
    // Deflate's maximum factor of 1032, times eight one-bit pixels per byte, times three bytes of
    // colour.
    let justified = (bytes.len() + 4096) * 1032 * 24;
    let reason = if outcome.is_err() {
        "panicked"
    } else if largest > justified {
        "allocated more than the bytes justify"
    } else if begin.elapsed() > Duration::from_secs(20) {
        "took more than 20 seconds"
    } else {
        return Ok(());
    };
    let kept = std::env::temp_dir().join(format!("sharp-{}-mutant", parser.name));
    std::fs::write(&kept, bytes)?;
    Err(format!("{what}: {reason}; its bytes are in {}", kept.display()).into())
}

fn seeds(parser: &Parser) -> Vec<(PathBuf, Vec<u8>)> {
    let tests = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut files = Vec::new();
    let folders = ["fixtures/edge", "fixtures/gaussian_formats"].map(|folder| tests.join(folder));
    let entries = folders
        .iter()
        .flat_map(|folder| std::fs::read_dir(folder).unwrap());
    for entry in entries {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        let mut endings = parser.seeds.split_whitespace();
        if endings.any(|end| name.ends_with(end)) {
            files.push(path);
        }
    }
    if let Ok(corpus) = std::fs::read_dir(tests.join("fuzz/corpus").join(parser.name)) {
        files.extend(corpus.map(|entry| entry.unwrap().path()));
    }
    files.sort();
    let mut seeds: Vec<(PathBuf, Vec<u8>)> = files
        .into_iter()
        .map(|path| (path.clone(), std::fs::read(path).unwrap()))
        .collect();
    if parser.name == "catalogue" {
        let datasets = DATASET_FILES.iter().zip(0_u8..);
        seeds.extend(datasets.map(|((name, bytes), i)| (name.into(), [&[i], *bytes].concat())));
    }
    seeds
}
