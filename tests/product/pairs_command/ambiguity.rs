//! `pairs --ambiguity`.

use super::*;

#[test]
fn the_open_choices_are_counted() {
    let dir = tempfile::tempdir().unwrap();
    let args = ["pairs", "--dataset", SYNTHETIC, "--ambiguity", "--no-cache"];
    let json = sharp_bench(dir.path(), &[&args[..], &["--json"]].concat())
        .ends_with(0)
        .json();
    let choices = json["choices"].as_array().unwrap();
    assert!(choices.len() > 25, "{}", choices.len());
    let of = |change: &str, what: &str| {
        let row = choices.iter().find(|c| c["change"] == change).unwrap();
        row["datasets"]["S"][what].as_u64().unwrap()
    };
    // The counts equal those of lists built with these options.
    for change in ["", "threshold=0.7", "test=frustum", "sets=strided"] {
        let list = build(dir.path(), "p.csv", &["--pair-options", change, "--json"])
            .ends_with(0)
            .json();
        assert_eq!(
            list["datasets"]["S"]["qualified"],
            of(change, "qualified"),
            "{change}"
        );
    }
    assert_eq!(of("", "shared"), of("", "selected"));
    assert!(of("threshold=0.7", "qualified") < of("", "qualified"));
    let said = sharp_bench(dir.path(), &args).ends_with(0);
    assert!(said.out.contains("order=once"), "{}", said.out);
    assert_eq!(
        build(dir.path(), "p.csv", &["--ambiguity"]).code,
        2,
        "--ambiguity writes no list"
    );
}

#[test]
fn readings_of_a_dataset_are_choices_too() {
    let dir = tempfile::tempdir().unwrap();
    let data = sharp_datasets::bundled::extract(&dir.path().join("data")).unwrap();
    let dataset = format!("M:middlebury={}", data.display());
    let args = ["pairs", "--dataset", &dataset, "--ambiguity", "--no-cache"];
    let json = sharp_bench(dir.path(), &[&args[..], &["--json"]].concat());
    let json = json.ends_with(0).json();
    let rows = json["choices"].as_array().unwrap();
    let of = |change: &str| {
        let found = rows.iter().find(|row| row["change"] == change);
        found.unwrap_or_else(|| panic!("no {change} in {json}"))
    };
    assert_eq!(of("")["datasets"]["M"]["selected"], 1);
    // The bundled scene has only one exposure.
    let other = of("right=im1E");
    assert!(other["unavailable"]["M"].is_string(), "{other}");
    assert!(rows.iter().all(|row| row["about"] != "threshold"));
    let said = sharp_bench(dir.path(), &args).ends_with(0);
    let line = said.out.lines().find(|line| line.contains("right=im1E"));
    assert!(line.unwrap().contains("cannot be opened"), "{}", said.out);
}
