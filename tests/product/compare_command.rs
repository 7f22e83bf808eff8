//! Two runs, pair by pair.

use std::path::Path;

use crate::support::{Said, holds, read, sharp_bench, words};

const DATASET: &str = "S:synthetic=size=96x72,views=20";

fn run(dir: &Path, out: &str, limit: &str, method: &str) {
    let line = format!("run --dataset {DATASET} --limit {limit} --metrics psnr,ssim-gauss11-valid");
    let args = words(&line);
    let args = [&args[..], &["--method", method, "--out", out]].concat();
    sharp_bench(dir, &args).ends_with(0);
}

fn compare(dir: &Path, args: &[&str]) -> Said {
    sharp_bench(dir, &[&["compare"], args].concat())
}

#[test]
fn runs_are_compared_by_pair_and_unlike_ones_refused() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    run(dir, "a", "4", "copy");
    run(dir, "again", "4", "copy");
    run(dir, "b", "4", "depth-splat:resolution=64");
    run(dir, "other", "3", "copy");

    // A run compared with its repetition.
    let same = compare(dir, &["a", "again", "--json"]).ends_with(0).json();
    assert_eq!(
        (&same["schema"], &same["a"], &same["b"]),
        (&1.into(), &"a".into(), &"again".into())
    );
    let rows = same["rows"].as_array().unwrap();
    assert_eq!(rows.len(), 2);
    for row in rows {
        assert_eq!(
            (&row["verdict"], &row["difference"]),
            (&"none".into(), &0.0.into())
        );
        assert_eq!(
            (&row["p"], &row["n_pairs"], &row["dataset"]),
            (&1.0.into(), &4.into(), &"S".into())
        );
    }

    // Different methods: the only one of each run, or methods named explicitly within one folder.
    let json = compare(dir, &["a", "b", "--json"]).ends_with(0).json();
    let psnr = &json["rows"][0];
    assert_eq!(
        (&psnr["metric"], &psnr["method_a"], &psnr["method_b"]),
        (&"psnr".into(), &"copy".into(), &"depth-splat".into())
    );
    let number = |name: &str| psnr[name].as_f64().unwrap();
    assert!((number("mean_b") - number("mean_a") - number("difference")).abs() < 1e-9);
    let shown = compare(dir, &["a", "b"]).ends_with(0).out;
    assert!(shown.contains("psnr: copy (A), depth-splat (B)"), "{shown}");
    let note = "one scene does not show";
    assert_eq!(shown.matches(note).count(), 1, "{shown}");
    let first = shown.lines().next().unwrap();
    assert_eq!(
        first, "depth-splat (B) against copy (A): verdict on B, with the difference B − A",
        "{shown}"
    );
    let of_psnr = format!("inconclusive ({:+.3})", number("difference"));
    assert!(shown.contains(&of_psnr), "{of_psnr}: {shown}");
    let renamed = words("a b --rename depth-splat=Ours --metrics psnr");
    let shown = compare(dir, &renamed).ends_with(0).out;
    assert!(
        shown.contains("psnr: copy (A), Ours (B)") && !shown.contains("ssim"),
        "{shown}"
    );
    compare(dir, &["a", "b", "--methods", "copy,depth-splat"]).ends_with(0);
    compare(dir, &["a", "b", "--metrics", "dists"])
        .is_usage_error_with(&["--metrics", "known: psnr"]);
    // Nothing changed, so no pair lost or gained.
    let better = compare(dir, &["a", "a", "--method", "copy=copy"])
        .ends_with(0)
        .out;
    assert!(!better.contains("largest"), "{better}");
    sharp_bench(dir, &["merge", "a", "b", "--out", "both"]).ends_with(0);
    let within = compare(dir, &["both", "--method", "copy=depth-splat", "--json"])
        .ends_with(0)
        .json();
    assert_eq!(within["rows"], json["rows"]);
    compare(dir, &["a", "b", "--flips"]).is_usage_error_with(&["--flips needs two methods"]);
    let flips = words("both --method copy=depth-splat --method depth-splat=copy --flips");
    let flipped = compare(dir, &flips).ends_with(0).out;
    let title = "psnr: 4 of 4 pairs changed the order of depth-splat and copy";
    assert!(flipped.contains(title), "{flipped}");
    let written = [&flips[..], &["--json", "--out", "flips"]].concat();
    let listed = compare(dir, &written).ends_with(0).json();
    let of = &listed["flips"][0];
    assert_eq!((&of["metric"], &of["n_pairs"]), (&"psnr".into(), &4.into()));
    let pair = &of["pairs"][3];
    assert_eq!(
        [&pair["a"][0], &pair["a"][1]],
        [&pair["b"][1], &pair["b"][0]]
    );
    assert!(read(dir.join("flips/index.html")).contains(title));
    // The page plots what is compared, the mean included.
    run(dir, "m", "4", "mean");
    compare(dir, &["a", "m", "--out", "page"]).ends_with(0);
    let plot = read(dir.join("page/plots/motion-psnr.svg"));
    assert!(plot.contains("\nA\n") && plot.contains("\nB\n"), "{plot}");
    // A bundle can replace its run.
    sharp_bench(dir, &["bundle", "a", "--out", "a.zip"]).ends_with(0);
    let bundled = compare(dir, &["a.zip", "b", "--json"]).ends_with(0).json();
    assert_eq!(bundled["rows"], json["rows"]);

    // Runs that cannot be compared.
    compare(dir, &["a", "other"]).is_error_with(&["a and other cannot be compared", "only in A"]);
    compare(dir, &["a", "absent"]).is_error_with(&["absent"]);
    compare(dir, &["a"]).is_usage_error_with(&["--method OLD=NEW"]);
    compare(dir, &["both", "a", "--method", "mean=copy"])
        .is_usage_error_with(&["--method mean=copy", "run A has copy, depth-splat"]);
    let manifest = std::fs::read_to_string(dir.join("b/manifest.json")).unwrap();
    assert!(manifest.contains("\"eps2d\": 0.0"), "{manifest}");
    std::fs::write(
        dir.join("b/manifest.json"),
        manifest.replace("\"eps2d\": 0.0", "\"eps2d\": 0.3"),
    )
    .unwrap();
    compare(dir, &["a", "b"])
        .is_error_with(&["eps2d is \"0\" in the first and \"0.3\" in the second"]);
}

#[test]
fn where_it_changed_is_told() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    for (out, resolution, keep) in [("a", 128, "all"), ("b", 32, "all"), ("bare", 32, "none")] {
        let method = format!("depth-splat:label=splat,resolution={resolution}");
        let line = format!(
            "run --dataset {DATASET} --limit 6 --metrics psnr,ssim,dists --method {method} \
             --keep {keep} --out {out}",
        );
        sharp_bench(dir, &words(&line)).ends_with(0);
    }
    let said = compare(dir, &["a", "b", "--anatomy", "--out", "page", "--json"]).ends_with(0);
    holds(&said.err, &["dists compares statistics of whole pictures"]);
    let json = said.json();
    let strata = json["breakdown"].as_array().unwrap();
    let of = |by: &str, metric: &str| -> Vec<&serde_json::Value> {
        let strata = strata.iter();
        strata
            .filter(|s| s["by"] == by && s["metric"] == metric)
            .collect()
    };
    let psnr = of("pixels", "psnr");
    let shares: f64 = psnr
        .iter()
        .map(|s| s["pixel_share"].as_f64().unwrap())
        .sum();
    assert!((shares - 1.0).abs() < 1e-9, "{psnr:?}");
    let visible = &psnr[0];
    assert_eq!(visible["stratum"], "visible in the source");
    assert!(visible["difference"].as_f64().unwrap() < 0.0, "{visible}");
    assert!(of("pixels", "dists").is_empty());
    let scene = of("scene", "psnr")[0];
    assert_eq!(
        (&scene["n_pairs"], &scene["difference"]),
        (&6.into(), &json["rows"][0]["difference"])
    );
    let by_baseline: u64 = of("baseline_m", "psnr")
        .iter()
        .map(|s| s["n_pairs"].as_u64().unwrap())
        .sum();
    assert_eq!(by_baseline, 6);
    // Largest losses first.
    let pairs = json["pairs"].as_array().unwrap();
    let losses: Vec<f64> = pairs
        .iter()
        .filter(|pair| pair["metric"] == "psnr")
        .map(|pair| pair["loss"].as_f64().unwrap())
        .collect();
    assert!(
        losses.len() == 6 && losses.is_sorted_by(|a, b| a >= b),
        "{losses:?}"
    );
    // The page has both sides, the change of the error, and a link for each pair.
    let read = |name: &str| std::fs::read_to_string(dir.join("page").join(name)).unwrap();
    let page = read("index.html");
    for what in [
        "\"change\":[\"data:image/jpeg",
        "7 A | B",
        "\"losses\":[",
        "\"id\":\"S/seed0/",
        "id=\"comparison\"",
    ] {
        assert!(page.contains(what), "{what}");
    }
    assert!(read("report.md").contains("| S | visible in the source |"));
    for (name, head) in [
        ("comparison", "dataset,metric,"),
        ("breakdown", "dataset,metric,"),
        ("pairs", "pair_id,dataset,"),
    ] {
        assert!(
            read(&format!("tables/{name}.csv")).starts_with(head),
            "{name}"
        );
    }
    assert_eq!(read("tables/pairs.csv").lines().count(), 1 + 3 * 6);
    // Equal inputs give identical files.
    compare(dir, &["a", "b", "--anatomy", "--out", "again"]).ends_with(0);
    let again = |name: &str| std::fs::read(dir.join("again").join(name)).unwrap();
    assert_eq!(again("index.html"), page.as_bytes());
    assert_eq!(
        again("tables/breakdown.csv"),
        read("tables/breakdown.csv").as_bytes()
    );

    compare(dir, &["a", "bare", "--anatomy"])
        .is_usage_error_with(&["--anatomy needs pictures that both runs kept"]);
    std::fs::create_dir(dir.join("mine")).unwrap();
    std::fs::write(dir.join("mine/index.html"), "mine").unwrap();
    compare(dir, &["a", "b", "--out", "mine"]).is_error_with(&["is not a report of sharp-bench"]);
}

/// Compares numbers up to the differences between mathematical libraries, and everything else
/// exactly.
fn same_cells(found: &str, committed: &str) {
    assert_eq!(found.lines().count(), committed.lines().count());
    for (found, committed) in found.lines().zip(committed.lines()) {
        for (found, committed) in found.split(',').zip(committed.split(',')) {
            match (found.parse::<f64>(), committed.parse::<f64>()) {
                (Ok(a), Ok(b)) => assert!((a - b).abs() <= 1e-9 * b.abs().max(1e-6), "{a} {b}"),
                _ => assert_eq!(found, committed),
            }
        }
    }
}

#[test]
fn committed_bundles_still_say_what_was_published() {
    let reports = Path::new(env!("CARGO_MANIFEST_DIR")).join("../reports/comparison");
    let dir = tempfile::tempdir().unwrap();
    let bundle = |name: &str| reports.join(name).display().to_string();
    let (a, b) = (bundle("splat1536.zip"), bundle("splat768.zip"));
    let args = [a.as_str(), &b, "--breakdown", "--out", "page"];
    let said = compare(dir.path(), &args).ends_with(0);
    holds(
        &said.out,
        &["psnr: depth-splat (A), depth-splat (B) by scene"],
    );
    for name in ["comparison.csv", "breakdown.csv", "pairs.csv"] {
        let read = |path: &Path| std::fs::read_to_string(path.join(name)).unwrap();
        same_cells(&read(&dir.path().join("page/tables")), &read(&reports));
    }
}

#[test]
fn what_was_lost_or_damaged_is_named() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let scenes =
        |name: &str, seed: u32| format!("{name}:synthetic=size=48x36,views=6,scenes=3,seed={seed}");
    let evaluate = |out: &str, method: &str| {
        let (s, t) = (scenes("S", 0), scenes("T", 9));
        let line = format!("run --dataset {s} --dataset {t} --limit 12 --metrics psnr");
        let args = words(&line);
        sharp_bench(
            dir,
            &[&args[..], &["--method", method, "--out", out]].concat(),
        )
    };
    evaluate("a", "copy:label=m").ends_with(0);
    let kept = dir.join("a/predictions/m");
    std::fs::create_dir_all(dir.join("half")).unwrap();
    std::fs::rename(kept.join("S"), dir.join("half/S")).unwrap();
    evaluate("b", "imported:label=m,dir=half").ends_with(4);
    let said = compare(dir, &["a", "b"]).ends_with(0).out;
    assert!(said.contains("T: nothing to compare"), "{said}");
    let rows = compare(dir, &["a", "b", "--json"]).ends_with(0).json();
    let rows: Vec<_> = rows["rows"].as_array().unwrap().iter().collect();
    let told = rows.iter().map(|row| {
        (
            row["dataset"].as_str().unwrap(),
            row["verdict"].as_str().unwrap(),
            row["difference"].is_null(),
        )
    });
    let expected = [
        ("S", "none", false),
        ("T", "inconclusive", true),
        ("all", "inconclusive", true),
    ];
    assert_eq!(told.collect::<Vec<_>>(), expected);

    // A damaged unit.
    let unit = sharp_tests::files_below(&dir.join("b/units")).unwrap()[0].clone();
    let text = std::fs::read_to_string(&unit).unwrap();
    std::fs::write(&unit, text.replacen("\"pair_id\"", "\"pair\"", 1)).unwrap();
    let name = unit.file_name().unwrap().to_str().unwrap().to_owned();
    for args in [
        &["compare", "a", "b"][..],
        &["report", "b"],
        &["bundle", "b", "--out", "b.zip"],
    ] {
        let said = sharp_bench(dir, args).ends_with(4);
        assert!(
            said.err.contains(&name) && said.err.contains("damaged"),
            "{}",
            said.err
        );
    }

    // Names that would be confused with something else.
    let named = |name: &str| {
        let dataset = scenes(name, 0);
        let args = words("run --method copy --metrics psnr --out n --dataset");
        sharp_bench(dir, &[&args[..], &[&*dataset]].concat())
    };
    named("all").is_error_with(&["'all' is reserved for the mean over datasets"]);
    named("new\nline").is_usage_error_with(&["line breaks"]);
}
