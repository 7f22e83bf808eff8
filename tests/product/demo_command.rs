//! The output of `sharp-bench demo`, as a visitor reads it.

use std::path::Path;

use crate::support::read;

#[test]
#[ignore = "reads a finished demo: SHARP_BENCH_DEMO names a file with what its --json printed"]
fn the_demo_shows_the_papers_metrics_and_depth_splat_beats_copy_on_a_real_pair() {
    let json = read(std::env::var_os("SHARP_BENCH_DEMO").unwrap());
    let json: serde_json::Value = serde_json::from_str(&json).unwrap();
    let file = |name: &str| Path::new(json[name].as_str().unwrap());
    let page = read(file("report"));
    // Self-contained: nothing is fetched when the page is opened.
    for loads in ["src=\"http", "href=\"http", "@import", "url(http"] {
        let inside = page
            .split(loads)
            .nth(1)
            .map(|rest| rest.split('"').next().unwrap_or(""));
        assert!(
            inside.is_none() || loads == "href=\"http",
            "{loads}{inside:?}"
        );
    }
    assert!(page.contains("depth-splat"));

    let mut reader = csv::Reader::from_path(file("scores")).unwrap();
    let header = reader.headers().unwrap().clone();
    let at = |name: &str| header.iter().position(|column| column == name).unwrap();
    let [dataset, scene, method, psnr] = ["dataset", "scene", "method", "psnr"].map(at);
    let rows: Vec<csv::StringRecord> = reader.records().map(Result::unwrap).collect();
    let motorcycle = |label: &str| -> f64 {
        let row = rows
            .iter()
            .find(|r| r[scene].starts_with("Motorcycle") && &r[method] == label)
            .unwrap();
        row[psnr].parse().unwrap()
    };
    assert!(motorcycle("depth-splat") > motorcycle("copy") + 2.0);
    for network in ["sharp-mini", "sharp-mini-depth"] {
        assert!(motorcycle(network) > 5.0, "{network}");
    }
    for (name, pairs) in [("Middlebury", 4), ("Synthetic", 24)] {
        let copies = rows
            .iter()
            .filter(|row| &row[dataset] == name && &row[method] == "copy");
        assert_eq!(copies.count(), pairs, "{name}");
    }

    // The paper's four metrics, each with a number in every row.
    for metric in ["dists", "lpips[alex,v0.1]", "psnr", "ssim[gauss11,valid]"] {
        let empty = rows.iter().filter(|row| row[at(metric)].is_empty()).count();
        assert_eq!(empty, 0, "{metric}");
    }
    let report = read(file("report").with_file_name("report.md"));
    // Not every method reports extras, which are in the table after this one.
    let (scores, _) = report.split_once("Mean alpha").unwrap();
    assert!(!scores.contains("n/a"), "{scores}");
    // The network's description is next to its numbers.
    let network = "sharp-mini: SHARP architecture, ";
    assert!(
        report.contains(network) && report.contains("not Apple's model"),
        "{report}"
    );
}
