//! Runs over time.

use std::path::Path;

use serde_json::Value;

use crate::incomplete_datasets::middlebury;
use crate::support::{Said, holds, read, sharp_bench};

fn run(dir: &Path, out: &str, method: &str, metrics: &str) {
    let method = format!("{method}:label=m");
    let args = ["run", "--dataset", "M:middlebury=set", "--out", out];
    let args = [&args[..], &["--method", &method, "--metrics", metrics]].concat();
    sharp_bench(dir, &args).ends_with(0);
}

fn history(dir: &Path, args: &[&str]) -> Said {
    sharp_bench(dir, &[&["history"], args].concat())
}

#[test]
fn a_history_holds_each_run_once_and_says_what_changed() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    // If all scenes have the same difference, it is significant from six scenes on.
    middlebury(dir, &["A", "B", "C", "D", "E", "F", "G", "H"]);
    run(dir, "base", "copy", "psnr");
    run(dir, "worse", "mean", "psnr");
    run(dir, "more", "mean", "psnr,ssim-uniform7-sample");
    let add = |run: &str, more: &[&str]| history(dir, &[&["add", "h", run], more].concat());

    let said = add("base", &["--commit", "abc1", "--date", "2026-01-31"]).ends_with(0);
    assert_eq!(said.out, "h/0001.zip  base\n");
    // Adding the same results again, from the folder or from its bundle, does not add an entry.
    let said = add("base", &["--commit", "abc1"]).ends_with(0);
    holds(&said.out, &["already added on 2026-01-31"]);
    sharp_bench(dir, &["bundle", "base", "--out", "base.zip"]).ends_with(0);
    let said = add("base.zip", &["--commit", "abc1", "--json"])
        .ends_with(0)
        .json();
    assert_eq!(
        (&said["entry"], &said["is_new"]),
        (&1.into(), &false.into())
    );
    // An entry consists of that bundle with its label, commit and date.
    sharp_bench(dir, &["bundle", "h/0001.zip", "--out", "plain.zip"]).ends_with(0);
    let bytes = |name: &str| std::fs::read(dir.join(name)).unwrap();
    assert!(bytes("plain.zip") == bytes("base.zip"));
    sharp_bench(dir, &["bundle", "base", "--out", "h/0001.zip"])
        .is_error_with(&["h/0001.zip", "not overwritten"]);
    // Other results with the same label and commit do add an entry.
    let said = add("worse", &["--label", "base", "--commit", "abc1", "--json"])
        .ends_with(0)
        .json();
    assert_eq!(
        (&said["file"], &said["is_new"]),
        (&"h/0002.zip".into(), &true.into())
    );
    add("more", &[]).ends_with(0);

    let shown = history(dir, &["show", "h", "--html", "page.html"])
        .ends_with(0)
        .out;
    for part in [
        "1  base   abc1    2026-01-31",
        "psnr, M: m",
        "worse than 1 (step)",
        "entry 2: worse by 21.",
        "ssim[uniform7,sample], M: m",
        "page.html",
    ] {
        assert!(shown.contains(part), "'{part}': {shown}");
    }
    let json = history(
        dir,
        &["show", "h", "--json", "--csv", "t.csv", "--html", "t.html"],
    )
    .ends_with(0)
    .json();
    assert_eq!(
        (&json["schema"], &json["damaged"]),
        (&1.into(), &Value::Array(Vec::new()))
    );
    assert_eq!(json["entries"][2]["label"], "more");
    let rows = json["rows"].as_array().unwrap();
    let of_psnr: Vec<&Value> = rows.iter().filter(|row| row["metric"] == "psnr").collect();
    assert_eq!((rows.len(), of_psnr.len()), (4, 3));
    let change = &of_psnr[1]["change"];
    assert_eq!(
        (&change["verdict"], &change["rule"]),
        (&"worse".into(), &"step".into())
    );
    assert_eq!(
        (&of_psnr[2]["follows"], &of_psnr[2]["change"]),
        (&2.into(), &Value::Null)
    );
    assert_eq!(
        (&of_psnr[0]["n_pairs"], &of_psnr[0]["n_scenes"]),
        (&8.into(), &8.into())
    );
    // The numbers equal those of `compare`.
    let compared = sharp_bench(dir, &["compare", "h/0001.zip", "worse", "--json"]);
    let compared = compared.ends_with(0).json();
    assert_eq!(compared["rows"][0]["difference"], change["difference"]);
    assert_eq!(compared["rows"][0]["p_holm"], change["p"]);

    let table = read(dir.join("t.csv"));
    assert_eq!(table.lines().count(), 5, "{table}");
    let columns = read(Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/compare.md"));
    for column in table.lines().next().unwrap().split(',') {
        assert!(
            columns.contains(&format!("`{column}`")),
            "{column} is not documented"
        );
    }
    let page = read(dir.join("t.html"));
    holds(&page, &["PSNR over entries", "worse by 21."]);
    assert!(!page.contains("<script") && !page.contains("href=\"http"));
}

#[test]
fn hostile_histories_end_in_one_error_or_name_their_damage() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    middlebury(dir, &["A"]);
    run(dir, "r", "copy", "psnr");
    std::fs::write(dir.join("file"), b"x").unwrap();
    for args in [["add", "file", "r"], ["add", "set", "r"]] {
        history(dir, &args).is_error_with(&[args[1]]);
    }
    history(dir, &["add", "h", "file"]).is_error_with(&["file", "not a bundle"]);
    history(dir, &["add", "h", "absent"]).is_error_with(&["absent"]);
    history(dir, &["show", "file"]).is_error_with(&["file"]);
    history(dir, &["show", "absent"]).is_error_with(&["absent"]);
    history(dir, &["show", "set"]).is_error_with(&["set", "history add DIR RUN"]);
    for wrong in [
        ["--date", "2026-02-30"],
        ["--label", ""],
        ["--commit", "a\nb"],
    ] {
        let args = [&["add", "h", "r"], &wrong[..]].concat();
        history(dir, &args).is_usage_error_with(&[wrong[0].trim_start_matches('-')]);
    }
    assert!(!dir.join("h").exists());

    history(dir, &["add", "h", "r"]).ends_with(0);
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink("0001.zip", dir.join("h/0002.zip")).unwrap();
        let pipe = std::process::Command::new("mkfifo")
            .arg(dir.join("h/0003.zip"))
            .status();
        assert!(pipe.unwrap().success());
    }
    std::fs::write(dir.join("h/0004.zip"), b"PK\x03\x04").unwrap();
    let said = history(dir, &["show", "h"]).ends_with(4);
    assert!(said.out.contains("psnr, M: m"), "{}", said.out);
    holds(&said.err, &["0002.zip", "0003.zip", "0004.zip"]);
    let said = history(dir, &["add", "h", "r", "--label", "later"]).ends_with(4);
    assert!(said.out.starts_with("h/0005.zip"), "{}", said.out);
}
