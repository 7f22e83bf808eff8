//! Malformed and unusual files (`tests/fixtures/edge`), one named test per file: 35 are compared
//! with the results of NumPy and Pillow (`EXPECTED.json`), 22 with expectations stated here.

#![allow(clippy::unwrap_used, reason = "test code outside of #[test] functions")]

mod described;
mod expected;

use std::fmt::Debug;
use std::path::{Path, PathBuf};

use libtest_mimic::{Arguments, Failed, Trial};

type Outcome = Result<(), Failed>;

fn main() {
    let arguments = Arguments::from_args();
    let mut trials = expected::trials();
    trials.extend(described::trials());
    let mut named: Vec<_> = trials.iter().map(|t| t.name().to_owned()).collect();
    trials.push(Trial::test("every_file_has_its_test", move || {
        named.sort();
        let mut files: Vec<_> = std::fs::read_dir(folder())?
            .map(|entry| entry.unwrap().file_name().to_string_lossy().into_owned())
            .filter(|name| name != "EXPECTED.json")
            .collect();
        files.sort();
        check(files == named, || format!("{files:?}\n{named:?}"))?;
        check(files.len() == 57, || format!("{} files", files.len()))
    }));
    libtest_mimic::run(&arguments, trials).exit();
}

fn folder() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("fixtures/edge")
}

fn fixture(name: &str) -> PathBuf {
    folder().join(name)
}

fn check(holds: bool, what: impl Fn() -> String) -> Outcome {
    if holds { Ok(()) } else { Err(what().into()) }
}

fn equal<T: Debug + PartialEq<U>, U: Debug + ?Sized>(found: &T, expected: &U) -> Outcome {
    check(found == expected, || {
        format!("{found:?} instead of {expected:?}")
    })
}

/// Checks that the error names the file and gives the reason.
fn refused<T>(
    result: Result<T, sharp_datasets::DatasetError>,
    file: &str,
    reason: &str,
) -> Outcome {
    let error = result.err().ok_or("was read without an error")?.to_string();
    check(error.contains(file) && error.contains(reason), || {
        format!("'{error}' does not name both '{file}' and '{reason}'")
    })
}
