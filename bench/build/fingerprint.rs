//! The sources and dependencies of each stage. Part of the build script; also included in the
//! library's tests.

use std::collections::{BTreeMap, BTreeSet};

use sha2::{Digest, Sha256};

/// The code that determines the results of one stage.
pub(crate) struct SourceGroup {
    /// Name of the group; the build exports the fingerprint as environment variable `SHARP_BENCH_<name>`.
    pub(crate) name: &'static str,
    /// Workspace-relative files and folders that belong to this group.
    own: &'static [&'static str],
    /// Lists of files and folders shared by several groups.
    shared: &'static [&'static [&'static str]],
    /// Dependencies that affect results; their transitive dependencies are included.
    crates: &'static [&'static str],
}

impl SourceGroup {
    /// All workspace-relative files and folders of the group, own and shared.
    pub(crate) fn sources(&self) -> impl Iterator<Item = &'static str> {
        let shared = self.shared.iter().flat_map(|list| list.iter());
        self.own.iter().chain(shared).copied()
    }
}

/// Reading photographs, cameras and depth.
const READING: &[&str] = &[
    "datasets/src",
    "sharp/src/camera.rs",
    "sharp/src/image_file",
    "sharp/src/random.rs",
    "sharp/src/trajectory.rs",
    "bench/src/pairs/frame.rs",
    "metrics/src/resize",
];
/// From network layers and colours to Gaussians.
const COMPOSING: &[&str] = &[
    "sharp/src/camera.rs",
    "sharp/src/color.rs",
    "sharp/src/composer.rs",
    "sharp/src/gaussians.rs",
    "sharp/src/initializer.rs",
    "sharp/src/resize.rs",
    "sharp/src/unprojection.rs",
    "bench/src/io/pictures.rs",
];
/// Methods that supply pictures instead of Gaussians.
const PICTURES: &[&str] = &[
    "bench/src/methods/crop_and_resize.rs",
    "bench/src/io/pictures.rs",
    "datasets/src/format/picture.rs",
    "sharp/src/image_file",
    "metrics/src/resize",
];
/// From Gaussians to scored pictures, and the facts recorded about their source.
const RENDERING: &[&str] = &[
    "bench/src/evaluate/gaussians",
    "bench/src/rendering/pose_alignment.rs",
    "bench/src/rendering/shared.rs",
    "bench/src/pairs/alignment.rs",
    "bench/src/pairs/depth/mod.rs",
    "bench/src/pairs/valid_depth.rs",
    "metrics/src/psnr.rs",
    "sharp/src/render",
    "sharp/src/camera.rs",
    "sharp/src/color.rs",
    "sharp/src/gaussians.rs",
];
/// Code that all metrics use.
const SCORING: &[&str] = &[
    "bench/src/evaluate/score.rs",
    "bench/src/pairs/depth/mod.rs",
    "bench/src/pairs/valid_depth.rs",
    "bench/src/scoring",
    "metrics/src/scorer.rs",
    "metrics/src/picture.rs",
    "metrics/src/simd.rs",
    "sharp/src/camera.rs",
    "sharp/src/frustum_mask.rs",
];
/// Networks of the learned metrics.
const FEATURES: &[&str] = &[
    "metrics/src/backbone",
    "metrics/src/engines.rs",
    "metrics/src/maps.rs",
    "metrics/src/weights",
    "metrics/weights/dists.safetensors",
    "metrics/weights/lpips_v0.1_alex.safetensors",
    "metrics/weights/lpips_v0.1_squeeze.safetensors",
    "metrics/weights/lpips_v0.1_vgg.safetensors",
    "sharp/kernels/src",
    "sharp/checkpoint/src",
];

const READERS: &[&str] = &["image", "exr", "half", "flate2", "kamadak-exif", "moxcms"];

/// Readers of picture and Gaussian files.
const FILE_READERS: &[&str] = &[
    "image",
    "exr",
    "half",
    "flate2",
    "kamadak-exif",
    "moxcms",
    "ruzstd",
    "zip",
];

pub(crate) const GROUPS: [SourceGroup; 13] = [
    group("READING", &[], &[READING], READERS),
    group(
        "OVERLAP",
        &[
            "bench/src/pairs/overlap",
            "bench/src/pairs/depth",
            "bench/src/pairs/alignment.rs",
            "bench/src/pairs/valid_depth.rs",
            "sharp/src/model",
            "sharp/kernels/src",
        ],
        &[READING],
        READERS,
    ),
    group("TRIVIAL", &["bench/src/methods/trivial.rs"], &[], &[]),
    group(
        "DEPTH_SPLAT",
        &["bench/src/methods/depth_splat.rs"],
        &[COMPOSING],
        &["glam"],
    ),
    group(
        "NETWORK",
        &[
            "bench/src/methods/sharp.rs",
            "sharp/src/model",
            "sharp/kernels/src",
            "sharp/checkpoint/src",
        ],
        &[COMPOSING],
        &["candle-core", "candle-nn", "gemm", "half", "glam"],
    ),
    group(
        "FILES",
        &[
            "bench/src/methods/imported.rs",
            "bench/src/methods/file_reading.rs",
            "bench/src/methods/file_template.rs",
            "bench/src/methods/placement_file.rs",
            "bench/src/methods/gaussians.rs",
            "bench/src/methods/scale_sweep.rs",
            "bench/src/io/gaussian_files.rs",
            "sharp/src/color.rs",
            "sharp/src/gaussian_files",
            "sharp/src/gaussians.rs",
            "sharp/src/ply",
            "sharp/checkpoint/src",
        ],
        &[PICTURES],
        FILE_READERS,
    ),
    group(
        "COMMAND",
        &[
            "bench/src/methods/command",
            "bench/src/methods/scale_sweep.rs",
        ],
        &[PICTURES],
        READERS,
    ),
    group("RENDER_CPU", &[], &[RENDERING], &["glam", "rayon"]),
    group("RENDER_WGPU", &["shaders"], &[RENDERING], &["glam", "wgpu"]),
    group("PSNR", &["metrics/src/psnr.rs"], &[SCORING], &[]),
    group("SSIM", &["metrics/src/ssim"], &[SCORING], &[]),
    group(
        "LPIPS",
        &["metrics/src/lpips.rs"],
        &[SCORING, FEATURES],
        &["gemm", "candle-core", "safetensors"],
    ),
    group(
        "DISTS",
        &["metrics/src/dists.rs", "metrics/src/resize"],
        &[SCORING, FEATURES],
        &["gemm", "candle-core", "safetensors"],
    ),
];

const fn group(
    name: &'static str,
    own: &'static [&'static str],
    shared: &'static [&'static [&'static str]],
    crates: &'static [&'static str],
) -> SourceGroup {
    SourceGroup {
        name,
        own,
        shared,
        crates,
    }
}

/// The workspace crate that owns a source path; `None` for `sharp-bench` itself.
pub(crate) fn crate_of(source: &str) -> Option<&'static str> {
    // Longer prefixes first.
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
    /// Whether the other workspace crates are from a registry. If so, the hash contains their
    /// versions instead of their sources.
    packaged: bool,
}

struct Locked {
    version: String,
    /// `name` or `name version`.
    dependencies: Vec<String>,
}

impl Code {
    /// `files` by workspace-relative name; `lock` is the text of `Cargo.lock`; `compiler` identifies the compiler and
    /// target.
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
            group.sources().any(below)
        };
        for (name, bytes) in self.files.iter().filter(|(name, _)| belongs(name)) {
            add(name.as_bytes());
            add(bytes);
        }
        let released = group.sources().filter_map(crate_of);
        let released = released.filter(|_| self.packaged);
        let crates: Vec<&str> = group.crates.iter().copied().chain(released).collect();
        for dependency in self.closure(&crates) {
            add(dependency.as_bytes());
        }
        sha256_hex(&parts)
    }

    /// `name version` of the root crates and their transitive dependencies. A crate that is locked
    /// in several versions is included in all of them.
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
