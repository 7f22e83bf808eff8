//! Hashes what results depend on, sources and compiler, so that a unit's key changes with the code, and names the decoders.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use sha2::{Digest, Sha256};

/// Folders below the workspace, with the locked dependencies, that can change a number.
const SOURCES: [&str; 10] = [
    "sharp/src",
    "sharp/kernels/src",
    "sharp/checkpoint/src",
    "metrics/src",
    "metrics/weights",
    "datasets/src",
    "bench/src",
    "shaders",
    "Cargo.toml",
    "Cargo.lock",
];

/// Crates that turn files into pixels, and so decide a score's input.
const DECODERS: [&str; 4] = ["image", "png", "zune-jpeg", "exr"];

fn main() -> std::io::Result<()> {
    let bench = PathBuf::from(std::env::var("CARGO_MANIFEST_DIR").unwrap_or_default());
    let workspace = bench.parent().unwrap_or(&bench);
    let mut files = Vec::new();
    for source in SOURCES {
        let path = workspace.join(source);
        println!("cargo::rerun-if-changed={}", path.display());
        collect(&path, &mut files)?;
    }
    files.sort();
    let mut hasher = Sha256::new();
    for file in &files {
        let name = file.strip_prefix(workspace).unwrap_or(file);
        hasher.update(name.to_string_lossy().replace('\\', "/").as_bytes());
        hasher.update([0]);
        hasher.update(fs::read(file)?);
        hasher.update([0]);
    }
    // Compiler and target too: functions such as `powf` come from the platform's mathematics.
    let compiler = std::env::var("RUSTC").unwrap_or_else(|_| "rustc".to_owned());
    let version = Command::new(compiler).arg("-vV").output()?;
    hasher.update(&version.stdout);
    hasher.update(std::env::var("TARGET").unwrap_or_default().as_bytes());
    let digest: String = hasher
        .finalize()
        .iter()
        .map(|b| format!("{b:02x}"))
        .collect();
    println!("cargo::rustc-env=SHARP_BENCH_SOURCE_FINGERPRINT={digest}");
    let lock = fs::read_to_string(workspace.join("Cargo.lock"))?;
    let decoders: Vec<String> = DECODERS
        .iter()
        .filter_map(|name| Some(format!("{name} {}", locked_version(&lock, name)?)))
        .collect();
    println!(
        "cargo::rustc-env=SHARP_BENCH_DECODERS={}",
        decoders.join(", ")
    );
    Ok(())
}

/// The version of a package in `Cargo.lock`.
fn locked_version<'a>(lock: &'a str, name: &str) -> Option<&'a str> {
    let (_, entry) = lock.split_once(&format!("name = \"{name}\"\nversion = \""))?;
    entry.split_once('"').map(|(version, _)| version)
}

fn collect(path: &Path, files: &mut Vec<PathBuf>) -> std::io::Result<()> {
    if path.is_file() {
        files.push(path.to_owned());
    } else if path.is_dir() {
        for entry in fs::read_dir(path)? {
            collect(&entry?.path(), files)?;
        }
    }
    Ok(())
}
