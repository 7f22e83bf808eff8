//! The sources and dependencies of each stage. Part of the build script; also included in the
//! library's tests.

use std::collections::{BTreeMap, BTreeSet};
use std::sync::LazyLock;

use sha2::{Digest, Sha256};

/// The code that determines the results of one stage.
pub(crate) struct SourceGroup {
    /// Name of the group; the build exports the fingerprint as environment variable `SHARP_BENCH_<name>`.
    pub(crate) name: &'static str,
    /// Workspace-relative files and folders.
    pub(crate) sources: Vec<&'static str>,
    /// Dependencies that affect results; their transitive dependencies are included.
    crates: Vec<&'static str>,
}

pub(crate) static GROUPS: LazyLock<Vec<SourceGroup>> = LazyLock::new(|| {
    let mut lists: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
    let mut groups = Vec::new();
    for list in include_str!("groups.txt").split("\n\n") {
        let lines = list.lines().filter(|line| !line.starts_with('#'));
        let mut words = lines.flat_map(str::split_whitespace);
        let Some(name) = words.next() else { continue };
        let of_word = |word| lists.get(word).cloned().unwrap_or_else(|| vec![word]);
        let all: Vec<&str> = words.flat_map(of_word).collect();
        if name.starts_with('@') {
            lists.insert(name, all);
            continue;
        }
        let sources = all.iter().filter(|word| !word.starts_with('+'));
        groups.push(SourceGroup {
            name,
            sources: sources.copied().collect(),
            crates: all
                .iter()
                .filter_map(|word| word.strip_prefix('+'))
                .collect(),
        });
    }
    groups
});

/// The workspace crate that owns a source path; `None` for `sharp-bench` itself.
pub(crate) fn crate_of(source: &str) -> Option<&'static str> {
    // Longer prefixes come first, because the first match counts.
    let crates = [
        ("bench/", None),
        ("sharp/kernels/", Some("sharp-kernels")),
        ("sharp/checkpoint/", Some("sharp-checkpoint")),
        ("sharp/", Some("sharp")),
        ("metrics/", Some("sharp-metrics")),
        ("datasets/", Some("sharp-datasets")),
        ("shaders", Some("sharp-shaders")),
    ];
    let found = crates.iter().find(|(folder, _)| source.starts_with(folder));
    found.and_then(|(_, name)| *name)
}

/// All sources and locked dependencies of the build.
pub(crate) struct Code {
    files: BTreeMap<String, Vec<u8>>,
    /// Locked versions by crate name, each with its dependencies.
    locked: BTreeMap<String, Vec<Locked>>,
    compiler: String,
    /// Whether the other workspace crates are from a registry; the hash then contains their
    /// versions instead of their sources.
    packaged: bool,
}

struct Locked {
    version: String,
    /// Dependencies, each as `name` or `name version`.
    dependencies: Vec<String>,
}

impl Code {
    /// `files` are the sources by workspace-relative name; `lock` is the text of `Cargo.lock`;
    /// `compiler` identifies the compiler and target.
    pub(crate) fn new(
        files: BTreeMap<String, Vec<u8>>,
        lock: &str,
        compiler: String,
        packaged: bool,
    ) -> Self {
        let mut locked: BTreeMap<String, Vec<Locked>> = BTreeMap::new();
        for entry in lock.split("[[package]]").skip(1) {
            let quoted = |line: &str| line.split('"').nth(1).map(str::to_owned);
            let field = |name: &str| entry.lines().find(|l| l.starts_with(name)).and_then(quoted);
            let (Some(name), Some(version)) = (field("name = "), field("version = ")) else {
                continue;
            };
            let dependencies = entry
                .split_once("dependencies = [")
                .map_or("", |(_, list)| list);
            let dependencies = dependencies.lines().take_while(|line| *line != "]");
            locked.entry(name).or_default().push(Locked {
                version,
                dependencies: dependencies.filter_map(quoted).collect(),
            });
        }
        Self {
            files,
            locked,
            compiler,
            packaged,
        }
    }

    pub(crate) fn versions(&self, name: &str) -> impl Iterator<Item = &str> {
        let locked = self.locked.get(name).into_iter().flatten();
        locked.map(|locked| locked.version.as_str())
    }

    /// SHA-256 over the sources of a group, its transitive dependencies, and the compiler.
    pub(crate) fn fingerprint(&self, group: &SourceGroup) -> String {
        let mut parts = Vec::new();
        let mut add = |part: &[u8]| {
            parts.extend_from_slice(&(part.len() as u64).to_le_bytes());
            parts.extend_from_slice(part);
        };
        add(self.compiler.as_bytes());
        let belongs = |name: &str| {
            let below = |source: &str| name == source || name.starts_with(&format!("{source}/"));
            group.sources.iter().any(|source| below(source))
        };
        for (name, bytes) in self.files.iter().filter(|(name, _)| belongs(name)) {
            add(name.as_bytes());
            add(bytes);
        }
        let released = group.sources.iter().filter_map(|source| crate_of(source));
        let released = released.filter(|_| self.packaged);
        let crates: Vec<&str> = group.crates.iter().copied().chain(released).collect();
        for dependency in self.closure(&crates) {
            add(dependency.as_bytes());
        }
        sha256_hex(&parts)
    }

    /// `name version` of the root crates and their transitive dependencies. A crate that is locked
    /// in several versions is included in every version.
    fn closure(&self, roots: &[&str]) -> BTreeSet<String> {
        let mut found = BTreeSet::new();
        let mut open: Vec<&str> = roots.to_vec();
        while let Some(name) = open.pop() {
            for locked in self.locked.get(name).into_iter().flatten() {
                if found.insert(format!("{name} {}", locked.version)) {
                    let names = locked.dependencies.iter();
                    open.extend(names.filter_map(|dependency| dependency.split(' ').next()));
                }
            }
        }
        found
    }
}

/// SHA-256 of `bytes`, in hexadecimal.
pub(crate) fn sha256_hex(bytes: &[u8]) -> String {
    let digest = Sha256::digest(bytes);
    digest.iter().map(|byte| format!("{byte:02x}")).collect()
}
