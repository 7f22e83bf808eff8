//! One hash per stage, computed when the harness was built, of everything in the code that
//! determines the stage's results: sources, locked dependencies and compiler. Equal fingerprints
//! mean equal code. Changes to reports or help texts do not change a fingerprint.

use std::collections::BTreeMap;

use sharp_metrics::identity::Family;

macro_rules! groups {
    ($($(#[$doc:meta])* $name:ident $text:literal)+) => {
        $($(#[$doc])* pub const $name: &str = env!(concat!("SHARP_BENCH_", stringify!($name)));)+

        /// All fingerprints, keyed by group name, for manifests.
        pub fn all() -> BTreeMap<String, String> {
            [$(($text, $name)),+]
                .map(|(name, fingerprint)| (name.to_owned(), fingerprint.to_owned()))
                .into()
        }
    };
}

groups! {
    /// Code that reads photographs, cameras and depth.
    READING "reading"
    /// Code that measures how much of one view is visible in another.
    OVERLAP "overlap"
    /// Code of the methods `target`, `copy` and `mean`.
    TRIVIAL "trivial"
    DEPTH_SPLAT "depth-splat"
    /// Code of the method `sharp`.
    NETWORK "network"
    /// Code of the methods `imported` and `gaussians`.
    FILES "files"
    COMMAND "command"
    RENDER_CPU "render-cpu"
    RENDER_WGPU "render-wgpu"
    PSNR "psnr"
    SSIM "ssim"
    LPIPS "lpips"
    DISTS "dists"
}

/// Fingerprint of all groups together, which identifies the build.
pub const BUILD: &str = env!("SHARP_BENCH_BUILD");

/// Crates that decode pictures, with their versions. Two versions may decode a JPEG to levels that
/// differ by one.
pub const DECODERS: &str = env!("SHARP_BENCH_DECODERS");

pub fn of_metric(family: Family) -> &'static str {
    match family {
        Family::Psnr => PSNR,
        Family::Ssim => SSIM,
        Family::Lpips => LPIPS,
        Family::Dists => DISTS,
    }
}

/// Fingerprint of a renderer by its exact name (`cpu-avx512`, `wgpu:<adapter, driver>`).
pub fn of_renderer(name: &str) -> &'static str {
    if name.starts_with("wgpu") {
        RENDER_WGPU
    } else {
        RENDER_CPU
    }
}

#[cfg(test)]
#[path = "../../build/fingerprint.rs"]
mod fingerprint;

#[cfg(test)]
mod tests {
    use std::collections::BTreeSet;

    use super::fingerprint::{Code, GROUPS, crate_of};
    use super::*;

    const LOCK: &str = "\
version = 4

[[package]]
name = \"candle-core\"
version = \"0.11.1\"
dependencies = [
 \"gemm\",
 \"half 2.6.0\",
]

[[package]]
name = \"gemm\"
version = \"0.19.0\"

[[package]]
name = \"half\"
version = \"2.6.0\"

[[package]]
name = \"plotters\"
version = \"0.3.7\"
";

    const FILES: [&str; 9] = [
        "metrics/src/ssim/map.rs",
        "metrics/src/dists.rs",
        "metrics/src/picture.rs",
        "sharp/src/model/vit.rs",
        "sharp/src/color.rs",
        "shaders/raster.wgsl",
        "bench/src/scoring/region.rs",
        "bench/templates/style.css",
        "bench/src/cli/run.rs",
    ];

    /// Groups whose fingerprint changes with a file or with the lock file.
    fn changed(file: &str, lock: &str) -> BTreeSet<&'static str> {
        let code = |changed: &str, lock: &str| {
            let files = FILES.map(|name| {
                let content: &[u8] = if name == changed { b"new" } else { b"old" };
                (name.to_owned(), content.to_vec())
            });
            Code::new(files.into(), lock, "rustc 1".to_owned(), false)
        };
        let (before, after) = (code("", LOCK), code(file, lock));
        let groups = GROUPS.iter();
        groups
            .filter(|group| before.fingerprint(group) != after.fingerprint(group))
            .map(|group| group.name)
            .collect()
    }

    #[test]
    fn a_file_changes_what_stands_on_it_and_nothing_else() {
        let of = |file| changed(file, LOCK).into_iter().collect::<Vec<_>>();
        assert_eq!(of("metrics/src/ssim/map.rs"), ["SSIM"]);
        assert_eq!(of("metrics/src/dists.rs"), ["DISTS"]);
        assert_eq!(
            of("metrics/src/picture.rs"),
            ["DISTS", "LPIPS", "PSNR", "SSIM"]
        );
        assert_eq!(
            of("bench/src/scoring/region.rs"),
            ["DISTS", "LPIPS", "PSNR", "SSIM"]
        );
        assert_eq!(of("sharp/src/model/vit.rs"), ["NETWORK", "OVERLAP"]);
        assert_eq!(of("shaders/raster.wgsl"), ["RENDER_WGPU"]);
        assert_eq!(
            of("sharp/src/color.rs"),
            [
                "DEPTH_SPLAT",
                "FILES",
                "NETWORK",
                "RENDER_CPU",
                "RENDER_WGPU"
            ]
        );
        // The report, its style and the command line affect no result.
        assert!(of("bench/templates/style.css").is_empty());
        assert!(of("bench/src/cli/run.rs").is_empty());
    }

    #[test]
    fn a_dependency_changes_what_stands_on_it_through_others_too() {
        let with = |from: &str, to: &str| changed("", &LOCK.replace(from, to));
        // A transitive dependency of candle-core that is also a root.
        let of_half: Vec<_> = with("\"2.6.0\"", "\"2.7.0\"").into_iter().collect();
        assert_eq!(
            of_half,
            [
                "COMMAND", "DISTS", "FILES", "LPIPS", "NETWORK", "OVERLAP", "READING"
            ]
        );
        let of_gemm: Vec<_> = with("\"0.19.0\"", "\"0.19.1\"").into_iter().collect();
        assert_eq!(of_gemm, ["DISTS", "LPIPS", "NETWORK"]);
        assert!(with("\"0.3.7\"", "\"0.3.8\"").is_empty());
    }

    #[test]
    fn locked_versions_are_found() {
        let code = Code::new(Default::default(), LOCK, String::new(), false);
        assert_eq!(code.versions("half").collect::<Vec<_>>(), ["2.6.0"]);
        assert_eq!(code.versions("nothing").count(), 0);
    }

    #[test]
    fn a_released_crate_stands_for_its_sources() {
        // Every source is part of this crate or of a known one.
        for source in GROUPS.iter().flat_map(|group| group.sources.clone()) {
            assert!(
                source.starts_with("bench/") != crate_of(source).is_some(),
                "{source}"
            );
        }
        let lock = |sharp: &str| {
            format!(
                "{LOCK}\n[[package]]\nname = \"sharp\"\nversion = \"{sharp}\"\ndependencies = [\n]\n"
            )
        };
        let code = |sharp| Code::new(Default::default(), &lock(sharp), String::new(), true);
        let groups = GROUPS.iter();
        let changed =
            groups.filter(|g| code("1.0.0").fingerprint(g) != code("1.0.1").fingerprint(g));
        let changed: BTreeSet<_> = changed.map(|group| group.name).collect();
        // The metrics group depends on the crate's frustum mask.
        assert!(
            ["RENDER_CPU", "NETWORK", "SSIM"]
                .iter()
                .all(|group| changed.contains(group))
        );
        assert!(!changed.contains("TRIVIAL"));
    }

    /// Folders with code that affects results.
    const DECIDING: [&str; 12] = [
        "bench/src/evaluate",
        "bench/src/methods",
        "bench/src/pairs/depth",
        "bench/src/pairs/overlap",
        "bench/src/rendering",
        "bench/src/scoring",
        "datasets/src",
        "metrics/src",
        "shaders",
        "sharp/checkpoint/src",
        "sharp/kernels/src",
        "sharp/src",
    ];

    /// Files and folders in those folders that affect no result: they plan, store, name or describe results, or measure time.
    const UNDECIDING: [&str; 46] = [
        "bench/src/evaluate/aggregation.rs",
        "bench/src/evaluate/bundle.rs",
        "bench/src/evaluate/differences.rs",
        "bench/src/evaluate/doubts.rs",
        "bench/src/evaluate/error.rs",
        "bench/src/evaluate/estimate.rs",
        "bench/src/evaluate/folder.rs",
        "bench/src/evaluate/job.rs",
        "bench/src/evaluate/join.rs",
        "bench/src/evaluate/keys.rs",
        "bench/src/evaluate/manifest.rs",
        "bench/src/evaluate/mod.rs",
        "bench/src/evaluate/picture_check",
        "bench/src/evaluate/pipeline.rs",
        "bench/src/evaluate/plan.rs",
        "bench/src/evaluate/predict.rs",
        "bench/src/evaluate/prepare.rs",
        "bench/src/evaluate/readings.rs",
        "bench/src/evaluate/record.rs",
        "bench/src/evaluate/rescore.rs",
        "bench/src/evaluate/results.rs",
        "bench/src/evaluate/run.rs",
        "bench/src/evaluate/shard.rs",
        "bench/src/evaluate/shown.rs",
        "bench/src/evaluate/speed.rs",
        "bench/src/evaluate/status.rs",
        "bench/src/evaluate/test_records.rs",
        "bench/src/evaluate/unit.rs",
        "bench/src/methods/kinds.rs",
        "bench/src/methods/method.rs",
        "bench/src/methods/mod.rs",
        "bench/src/methods/privilege.rs",
        "bench/src/methods/spec.rs",
        "bench/src/methods/training_views.rs",
        "bench/src/rendering/batch.rs",
        "bench/src/rendering/mod.rs",
        "metrics/src/identity.rs",
        "metrics/src/info.rs",
        "metrics/src/lib.rs",
        "metrics/src/options.rs",
        "metrics/src/selection.rs",
        "metrics/src/unavailable.rs",
        "sharp/src/composer/backward.rs",
        "sharp/src/files.rs",
        "sharp/src/initializer/backward.rs",
        "sharp/src/lib.rs",
    ];

    #[test]
    fn every_file_that_decides_results_is_in_a_group() {
        let workspace = std::path::Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
        let held: Vec<&str> = GROUPS
            .iter()
            .flat_map(|group| group.sources.clone())
            .collect();
        for source in &held {
            assert!(workspace.join(source).exists(), "{source} is gone");
        }
        let mut open: Vec<String> = DECIDING.map(str::to_owned).into();
        let mut loose = BTreeSet::new();
        while let Some(name) = open.pop() {
            let below =
                |source: &&&str| name == **source || name.starts_with(&format!("{source}/"));
            if held.iter().any(|source| below(&source)) {
                continue;
            }
            if UNDECIDING.contains(&name.as_str()) {
                loose.insert(name);
                continue;
            }
            if let Ok(entries) = std::fs::read_dir(workspace.join(&name)) {
                let entries =
                    entries.map(|entry| entry.unwrap().file_name().into_string().unwrap());
                open.extend(
                    entries
                        .filter(|entry| entry != "tests")
                        .map(|entry| format!("{name}/{entry}")),
                );
            } else if (name.ends_with(".rs") || name.ends_with(".wgsl"))
                && !name.ends_with("/tests.rs")
            {
                loose.insert(name);
            }
        }
        let undeciding = BTreeSet::from(UNDECIDING.map(str::to_owned));
        let neither: Vec<&String> = loose.difference(&undeciding).collect();
        assert!(
            neither.is_empty(),
            "in no group of build/groups.txt: {neither:?}"
        );
        let gone: Vec<&String> = undeciding.difference(&loose).collect();
        assert!(gone.is_empty(), "gone, or in a group: {gone:?}");
    }

    #[test]
    fn this_build_has_them_all() {
        let all = all();
        assert_eq!(all.len(), GROUPS.len());
        assert!(all.values().all(|fingerprint| fingerprint.len() == 64));
        assert!(DECODERS.contains("image "));
    }
}
