//! Hashes the sources and locked dependencies of each stage, so that result keys change if and only
//! if the code behind the results changes. Also records the picture decoders.

mod fingerprint;

use std::collections::BTreeMap;
use std::fs;
use std::io;
use std::path::{Path, PathBuf};
use std::process::Command;

use fingerprint::{Code, GROUPS};

/// Crates that decode files into pixels, and so determine the input of every score.
const DECODERS: [&str; 4] = ["image", "png", "zune-jpeg", "exr"];

fn main() -> io::Result<()> {
    let variable = |name| std::env::var(name).unwrap_or_default();
    let bench = PathBuf::from(variable("CARGO_MANIFEST_DIR"));
    let workspace = bench.parent().unwrap_or(&bench);
    // A crate from a registry is not in a workspace and has its own lock file.
    let packaged = bench.join("Cargo.lock").is_file();
    let mut files = BTreeMap::new();
    let mut folders: Vec<&str> = GROUPS
        .iter()
        .flat_map(|group| group.sources.clone())
        .collect();
    folders.sort_unstable();
    folders.dedup();
    for folder in folders {
        let path = match folder.strip_prefix("bench/") {
            Some(own) => bench.join(own),
            None if packaged => continue,
            None => workspace.join(folder),
        };
        println!("cargo::rerun-if-changed={}", path.display());
        if !path.exists() {
            let reason = format!("bench/build/groups.txt names {folder}, which does not exist");
            return Err(io::Error::other(reason));
        }
        collect(folder, &path, &mut files)?;
    }
    let lock = if packaged { &bench } else { workspace }.join("Cargo.lock");
    println!("cargo::rerun-if-changed={}", lock.display());
    let lock = fs::read_to_string(lock)?;
    // Include the compiler and the target: functions such as `powf` come from the platform's maths library.
    let compiler = std::env::var("RUSTC").unwrap_or_else(|_| "rustc".to_owned());
    let version = Command::new(compiler).arg("-vV").output()?.stdout;
    let compiler = format!(
        "{}{}",
        String::from_utf8_lossy(&version),
        variable("TARGET")
    );
    let code = Code::new(files, &lock, compiler, packaged);
    let mut all = String::new();
    for group in GROUPS.iter() {
        let fingerprint = code.fingerprint(group);
        all += &fingerprint;
        println!("cargo::rustc-env=SHARP_BENCH_{}={fingerprint}", group.name);
    }
    println!(
        "cargo::rustc-env=SHARP_BENCH_BUILD={}",
        fingerprint::sha256_hex(all.as_bytes())
    );
    let decoders: Vec<String> = DECODERS
        .iter()
        .flat_map(|name| {
            code.versions(name)
                .map(move |version| format!("{name} {version}"))
        })
        .collect();
    println!(
        "cargo::rustc-env=SHARP_BENCH_DECODERS={}",
        decoders.join(", ")
    );
    Ok(())
}

/// Adds all files at or below `path` to `files` under their workspace-relative names; `path` itself is called `name`.
fn collect(name: &str, path: &Path, files: &mut BTreeMap<String, Vec<u8>>) -> io::Result<()> {
    if path.is_dir() {
        for entry in fs::read_dir(path)? {
            let entry = entry?;
            let below = format!("{name}/{}", entry.file_name().to_string_lossy());
            collect(&below, &entry.path(), files)?;
        }
    } else {
        files.insert(name.to_owned(), fs::read(path)?);
    }
    Ok(())
}
