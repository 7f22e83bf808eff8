//! `bench/docs/security.md` lists every `unsafe` of the product, with existing tests.

#![allow(clippy::unwrap_used, reason = "test code outside of #[test] functions")]

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("..")
        .canonicalize()
        .unwrap()
}

fn rust_files(folder: &Path, into: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() && !path.ends_with("target") {
            rust_files(&path, into);
        } else if path.extension().is_some_and(|extension| extension == "rs") {
            into.push(path);
        }
    }
}

/// Whether the code, rather than a comment, contains `unsafe`.
fn is_unsafe(text: &str) -> bool {
    let code = text
        .lines()
        .map(|line| line.split("//").next().unwrap_or_default());
    code.flat_map(|line| line.split(|c: char| !c.is_alphanumeric() && c != '_'))
        .any(|word| word == "unsafe")
}

#[test]
fn every_unsafe_is_listed_with_a_test_that_exists() {
    let root = root();
    let page = std::fs::read_to_string(root.join("bench/docs/security.md")).unwrap();
    let table = page.split("## `unsafe`").nth(1).unwrap();
    let rows = table.lines().filter(|line| line.starts_with("| `"));
    let rows: Vec<Vec<&str>> = rows.map(|row| row.split('|').collect()).collect();
    let listed: BTreeSet<String> = rows
        .iter()
        .map(|row| row[1].trim().trim_matches('`').to_owned())
        .collect();

    let mut files = Vec::new();
    for folder in ["sharp", "metrics", "datasets", "bench"] {
        rust_files(&root.join(folder), &mut files);
    }
    let name = |path: &PathBuf| {
        path.strip_prefix(&root)
            .unwrap()
            .to_str()
            .unwrap()
            .to_owned()
    };
    let product = files.iter().filter(|path| {
        let name = name(path);
        name.contains("src/") && !name.contains("/benches/")
    });
    let found: BTreeSet<String> = product
        .filter(|path| is_unsafe(&std::fs::read_to_string(path).unwrap()))
        .map(name)
        .collect();
    assert_eq!(listed, found);

    rust_files(&root.join("tests"), &mut files);
    let all: String = files
        .iter()
        .map(|path| std::fs::read_to_string(path).unwrap())
        .collect();
    for row in rows {
        let tests: Vec<&str> = row[3].split('`').skip(1).step_by(2).collect();
        assert!(!tests.is_empty(), "{}: no test", row[1]);
        for test in tests {
            assert!(
                all.contains(&format!("fn {test}(")),
                "{}: there is no test {test}",
                row[1]
            );
        }
    }
}
