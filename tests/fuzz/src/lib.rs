//! Helpers for the fuzz targets.

#[path = "../parsers.rs"]
#[allow(
    dead_code,
    unused_imports,
    reason = "the test of mutants takes seeds from there too"
)]
pub mod parsers;

/// Runs one parser; panics on unknown names, which are mistakes in a target.
pub fn run(name: &str, bytes: &[u8]) {
    let parser = parsers::PARSERS.iter().find(|p| p.name == name);
    (parser.expect("a parser of that name").run)(bytes);
}
