//! The depth that determines overlap, and the cache of overlaps.

use super::*;
use crate::tiny::{depth_pro, golden};

/// Evaluates a pair of the procedural scene.
fn run_one_pair(dir: &Path, out: &str, more: &[&str]) {
    let args = ["run", "--dataset", SYNTHETIC, "--method", "copy"];
    let rest = ["--metrics", "psnr", "--limit", "1", "--out", out];
    sharp_bench(dir, &[&args[..], &rest, more].concat()).ends_with(0);
}

#[test]
fn overlaps_are_kept_and_change_nothing() {
    let dir = tempfile::tempdir().unwrap();
    build(dir.path(), "fresh.csv", &["--no-cache"]).ends_with(0);
    assert!(!dir.path().join("c").exists());
    build(dir.path(), "first.csv", &["--cache", "c"]).ends_with(0);
    let tables = files(&dir.path().join("c"));
    assert_eq!(tables.len(), 1);
    let before = modified(&tables[0]);
    build(dir.path(), "second.csv", &["--cache", "c"]).ends_with(0);
    assert_eq!(modified(&tables[0]), before);
    std::fs::write(&tables[0], b"{").unwrap();
    let said = build(dir.path(), "third.csv", &["--cache", "c"]).ends_with(0);
    assert!(said.err.contains("warning: c/"), "{}", said.err);
    assert!(said.err.contains("measured again"), "{}", said.err);
    let fresh = read(dir.path().join("fresh.csv"));
    for list in ["first.csv", "second.csv", "third.csv"] {
        assert_eq!(read(dir.path().join(list)), fresh, "{list}");
    }
    let both = build(dir.path(), "x.csv", &["--cache", "c", "--no-cache"]);
    assert_eq!(both.code, 2, "{}", both.err);
}

fn files(folder: &Path) -> Vec<PathBuf> {
    let entries = std::fs::read_dir(folder)
        .unwrap()
        .map(|e| e.unwrap().path());
    let mut found = Vec::new();
    for path in entries {
        if path.is_dir() {
            found.extend(files(&path));
        } else {
            found.push(path);
        }
    }
    found
}

#[test]
fn somebody_elses_depth_decides_overlap_and_is_named() {
    let dir = tempfile::tempdir().unwrap();
    build(dir.path(), "truth.csv", &["--no-cache"]).ends_with(0);
    // The true depth in another unit, like a prediction of the right shape.
    let line =
        format!("pairs export --pairs truth.csv --all --dataset {SYNTHETIC} --out e --with depth",);
    sharp_bench(dir.path(), &words(&line)).ends_with(0);
    let list = read(dir.path().join("truth.csv"));
    for line in list.lines().skip(1) {
        let id = line.split(',').next().unwrap();
        let (stem, _) = id.split_once("__").unwrap();
        let from = dir.path().join("e").join(id).join("source_depth.npy");
        let mut depth = sharp_datasets::format::read_map(&from).unwrap();
        depth.iter_mut().for_each(|z| *z *= 0.25);
        let to = dir.path().join("mono").join(format!("{stem}.npy"));
        std::fs::create_dir_all(to.parent().unwrap()).unwrap();
        sharp_datasets::format::npy::write(&to, &depth).unwrap();
    }
    let mono = ["--overlap-depth", "mono", "--no-cache"];
    let json = build(dir.path(), "mono.csv", &[&mono[..], &["--json"]].concat())
        .ends_with(0)
        .json();
    assert_eq!(json["overlap_depth"], "given,median-scaled-to-ground-truth");
    assert!(json["options"].as_str().unwrap().contains("overlap=given"));
    let maps = &json["choices"]
        .as_object()
        .unwrap()
        .values()
        .next()
        .unwrap()["overlap_depth_maps"];
    assert!(maps["count"].as_u64() > Some(0) && maps["sha256"].as_str().unwrap().len() == 64);
    // Scaled back, it equals the true depth: the same pairs, with the same overlaps up to rounding.
    let ids = |name: &str| -> Vec<String> {
        let text = read(dir.path().join(name));
        let lines = text.lines().skip(1);
        lines
            .map(|l| l.split(',').next().unwrap().to_owned())
            .collect()
    };
    assert_eq!(ids("mono.csv"), ids("truth.csv"));
    // Unscaled, it would move every surface to a quarter of its distance.
    let metric = [&mono[..], &["--pair-options", "overlap=given-metric"]].concat();
    build(dir.path(), "metric.csv", &metric).ends_with(4);
    assert_ne!(ids("metric.csv"), ids("truth.csv"));

    // A run reports the source of its overlaps, even for a list that was built before.
    let run = |out: &str, pairs: &[&str]| {
        run_one_pair(dir.path(), out, pairs);
        let manifest: serde_json::Value =
            serde_json::from_str(&read(dir.path().join(out).join("manifest.json"))).unwrap();
        manifest["pairs"]["lists"][0]["choices"].clone()
    };
    let built = run("built", &mono);
    assert_eq!(
        built.as_object().unwrap().values().next().unwrap()["overlap_depth"],
        "given,median-scaled-to-ground-truth"
    );
    assert_eq!(run("given", &["--pairs", "mono.csv"]), built);
    sharp_bench(dir.path(), &["report", "built"]).ends_with(0);
    let report = read(dir.path().join("built/report/report.md"));
    assert!(report.contains("median-scaled-to-ground-truth"), "{report}");

    let wrong = |more: &[&str], parts: &[&str]| {
        build(dir.path(), "x.csv", more).is_error_with(parts);
        assert!(!dir.path().join("x.csv").exists());
    };
    wrong(
        &["--overlap-depth", "nowhere"],
        &["nowhere", "not a folder"],
    );
    std::fs::create_dir(dir.path().join("empty")).unwrap();
    wrong(
        &["--overlap-depth", "empty"],
        &["has no map for any view of"],
    );
    wrong(
        &["--pair-options", "overlap=given"],
        &["--overlap-depth DIR"],
    );
    let both = words("--overlap-depth mono --pair-options overlap=sparse");
    wrong(&both, &["does not take"]);
}

#[test]
fn a_checkpoint_decides_overlap_and_is_not_judged_on_its_own_choice() {
    let dir = tempfile::tempdir().unwrap();
    let golden = PathBuf::from(env!("CARGO_MANIFEST_DIR")).join("../tests/golden/model");
    let model = golden.join("tiny_model.pt").display().to_string();
    let config = golden.join("tiny_config.json#tiny").display().to_string();
    let options = [
        "--pair-options",
        "overlap=sharp-release,threshold=0",
        "--overlap-checkpoint",
        &model,
        "--overlap-config",
        &config,
        "--no-cache",
    ];
    let json = build(dir.path(), "p.csv", &[&options[..], &["--json"]].concat())
        .ends_with(0)
        .json();
    let depth = json["overlap_depth"].as_str().unwrap();
    assert!(
        depth.starts_with("first layer of another network(checkpoint sha256 "),
        "{depth}"
    );
    let method = format!("sharp:checkpoint={model},config={config}");
    let run = format!(
        "run --dataset {SYNTHETIC} --pairs p.csv --metrics psnr --limit 1 --out r --method copy"
    );
    let run = [&words(&run)[..], &["--method", &method]].concat();
    sharp_bench(dir.path(), &run).is_error_with(&["checkpoint of method 'sharp'"]);
    // Without the official file, no other checkpoint is used instead.
    let absent = words("--pair-options overlap=sharp-release --overlap-checkpoint no.pt");
    build(dir.path(), "q.csv", &absent).is_error_with(&["no.pt"]);
    let useless = ["--overlap-checkpoint", model.as_str()];
    build(dir.path(), "q.csv", &useless).is_error_with(&["overlap=sharp-release"]);
}

#[test]
fn depth_pro_decides_overlap_and_is_recorded() {
    let dir = tempfile::tempdir().unwrap();
    let [checkpoint, config] = depth_pro(&dir.path().join("d.safetensors"));
    let made = |list: &str, depth: &str, model: &[&str]| {
        let options = format!("overlap={depth},threshold=0");
        let args = [
            &["--pair-options", options.as_str(), "--cache", "c", "--json"],
            model,
        ];
        build(dir.path(), list, &args.concat())
    };
    let pro = [
        "--overlap-checkpoint",
        &checkpoint,
        "--overlap-config",
        &config,
    ];
    let json = made("pro.csv", "depth-pro", &pro).ends_with(0).json();
    let choices = json["choices"]
        .as_object()
        .unwrap()
        .values()
        .next()
        .unwrap();
    let depth = choices["overlap_depth"].as_str().unwrap();
    let sha256 = choices["overlap_checkpoint"].as_str().unwrap();
    let expected = format!(
        "depth-pro of other sizes(checkpoint sha256 {sha256}),median-scaled-to-ground-truth"
    );
    assert_eq!(depth, expected);
    assert_eq!(choices["options"]["overlap"], "depth-pro");
    // A second list is made from the cache, to the same bytes.
    let tables = files(&dir.path().join("c"));
    assert_eq!(tables.len(), 1);
    let before = modified(&tables[0]);
    made("again.csv", "depth-pro", &pro).ends_with(0);
    assert_eq!(modified(&tables[0]), before);
    assert_eq!(
        read(dir.path().join("again.csv")),
        read(dir.path().join("pro.csv"))
    );
    // Overlaps from another depth are cached in a table of their own.
    made("truth.csv", "ground-truth", &[]).ends_with(0);
    assert_eq!(files(&dir.path().join("c")).len(), 2);
    assert_ne!(
        read(dir.path().join("truth.csv")),
        read(dir.path().join("pro.csv"))
    );
    made("x.csv", "depth-pro", &[]).is_error_with(&["--overlap-checkpoint FILE"]);
    let sharps = ["--overlap-checkpoint", "mini"];
    made("x.csv", "depth-pro", &sharps).is_error_with(&["mini"]);
    let file = golden("tiny_model.pt");
    let sharps = ["--overlap-checkpoint", file.as_str()];
    made("x.csv", "depth-pro", &sharps).is_error_with(&["a checkpoint of SHARP", "Depth Pro"]);

    // Results on both lists do not share a folder or a table.
    run_one_pair(dir.path(), "a", &["--pairs", "pro.csv"]);
    let more = ["run", "--dataset", SYNTHETIC, "--method", "copy"];
    let list = ["--metrics", "psnr", "--pairs", "truth.csv", "--out", "a"];
    let what = "the depth that decides overlap in dataset 'S'";
    sharp_bench(dir.path(), &[&more[..], &list].concat()).is_error_with(&[what]);
    run_one_pair(dir.path(), "b", &["--pairs", "truth.csv"]);
    let both = ["report", "a", "b", "--out", "r"];
    sharp_bench(dir.path(), &both).is_error_with(&[what, "ground-truth"]);
}

#[test]
fn depth_pro_is_the_default_on_sparse_depth_where_its_weights_are_at_hand() {
    let dir = tempfile::tempdir().unwrap();
    let layout = concat!(env!("CARGO_MANIFEST_DIR"), "/../tests/fuzz/datasets/eth3d");
    let dataset = format!("eth3d={layout}");
    let run = |out: &str, options: &str| {
        let args = ["run", "--dataset", &dataset, "--pair-options", options];
        let rest = ["--method", "copy", "--metrics", "psnr", "--out", out];
        sharp_bench(dir.path(), &[&args[..], &rest].concat())
    };
    const ANY: &str = "threshold=0,missing-depth=accept";
    run("proxy", ANY).ends_with(0);
    let config = read(dir.path().join("proxy/run.toml"));
    assert!(config.contains(",pairs.overlap=ground-truth"), "{config}");
    // The file does not have the published size, so the run fails and names it.
    let weights = dir.path().join(".weights");
    std::fs::create_dir_all(&weights).unwrap();
    depth_pro(&weights.join("depth_pro.pt"));
    run("pro", ANY).is_error_with(&[".weights/depth_pro.pt"]);
    run("own", &format!("{ANY},overlap=ground-truth")).ends_with(0);
    // The configuration of a run keeps what was chosen.
    let again = ["run", "--config", "proxy/run.toml", "--out", "again"];
    sharp_bench(dir.path(), &again).ends_with(0);
    assert_eq!(
        read(dir.path().join("again/pairs.csv")),
        read(dir.path().join("proxy/pairs.csv"))
    );
}
