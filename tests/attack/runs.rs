//! Run folders with one damaged file, read again by every command that reads them.

use std::path::Path;
use std::sync::LazyLock;

use sharp_tests::{copy_folder, words};

use super::case::{Case, Verdict};
use super::oracle::rows;
use super::spoil;

const RUN: &str = "run --dataset S:synthetic=size=32x24,views=4 --metrics psnr --no-cache --limit 5 \
     --method copy --method mean";

/// A finished run: its folder and scores.
static WHOLE: LazyLock<Result<(Case, String), String>> = LazyLock::new(|| {
    let mut case = Case::new("whole", 0);
    let said = case.run(&[&words(RUN)[..], &["--out", "r"]].concat())?;
    let report = case.run(&["report", "r"])?;
    match (said.code, report.code) {
        (0, 0) => {
            let scores = case.read("r/scores.csv");
            Ok((case, scores))
        }
        _ => Err(said.err + &report.err),
    }
});

pub(crate) fn runs(case: &mut Case) -> Result<Verdict, String> {
    let (whole, scores) = WHOLE.as_ref().map_err(Clone::clone)?;
    copy_folder(&whole.path("r"), &case.path("r")).unwrap();
    let files = [
        "manifest.json",
        "plan.json",
        "pairs.csv",
        "scores.csv",
        "units",
        "units",
        "units",
        "predictions",
    ];
    let name = match *case.random.pick(&files) {
        folder @ ("units" | "predictions") => {
            let mut found = Vec::new();
            find(&case.path("r").join(folder), &mut found);
            found.sort();
            let path = case.random.pick(&found).clone();
            path.strip_prefix(case.path(""))
                .unwrap()
                .display()
                .to_string()
        }
        file => format!("r/{file}"),
    };
    let is_picture = name.ends_with(".png");
    let harmless = spoil::file(
        case,
        &name,
        if is_picture {
            spoil::binary
        } else {
            spoil::text
        },
    );
    case.may_name("r/");
    case.may_name("r:");
    match case.random.below(4) {
        0 => {
            let said = case.run(&[&words(RUN)[..], &["--out", "r"]].concat())?;
            if harmless && said.code == 1 {
                // A file with an unchanged meaning may still be refused, for example because of a byte order mark.
                return Ok(Verdict::Error);
            }
            settle(case, said.code, scores)
        }
        1 => {
            let said = case.run(&["merge", "r"])?;
            settle(case, said.code, scores)
        }
        2 => {
            let said = case.run(&["score", "r", "--metrics", "psnr,ssim"])?;
            if said.code != 0 {
                return Ok(Verdict::Error);
            }
            let before = rows(&whole.path("r/scores.csv"))?;
            for row in rows(&case.path("r/scores.csv"))? {
                let same = before
                    .iter()
                    .find(|b| b["pair_id"] == row["pair_id"] && b["method"] == row["method"]);
                if same.is_none_or(|same| same["psnr"] != row["psnr"] && !row["psnr"].is_empty()) {
                    return Err(format!("another score: {row:?}"));
                }
            }
            Ok(Verdict::Number)
        }
        _ => {
            let said = case.run(&["report", "r"])?;
            match said.code {
                0 | 4 => reported(
                    case,
                    whole,
                    said.code == 4 || said.err.contains("units are done"),
                ),
                _ => Ok(Verdict::Error),
            }
        }
    }
}

fn find(folder: &Path, found: &mut Vec<std::path::PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            find(&path, found)
        } else {
            found.push(path)
        }
    }
}

/// If a command reports success, the scores must be unchanged.
fn settle(case: &Case, code: i32, scores: &str) -> Result<Verdict, String> {
    match code {
        0 if case.read("r/scores.csv") == scores => Ok(Verdict::Number),
        0 => Err("other scores".to_owned()),
        _ => Ok(Verdict::Error),
    }
}

/// Means of the same pairs must be equal; if pairs are missing, this must be reported.
fn reported(case: &Case, whole: &Case, is_partial: bool) -> Result<Verdict, String> {
    let (before, after) = ["r/report/tables/scores.csv"; 2].map(|name| name).into();
    let (before, after) = (rows(&whole.path(before))?, rows(&case.path(after))?);
    let mut verdict = Verdict::Error;
    for row in &before {
        let same = after
            .iter()
            .find(|a| a["method"] == row["method"] && a["metric"] == row["metric"]);
        match same {
            Some(same) if same["mean"] == row["mean"] && same["n"] == row["n"] => {
                verdict = Verdict::Number
            }
            Some(same) if same["mean"].is_empty() || is_partial => {}
            Some(same) if same["n"] != row["n"] && same["n"] == same["total"] => {
                return Err(format!(
                    "pairs are missing, but this is not reported: {same:?}"
                ));
            }
            Some(same) if same["n"] != row["n"] => {}
            Some(same) => return Err(format!("another mean: {same:?} instead of {row:?}")),
            // If a label was damaged, the report has another method, so no row is found.
            None => {}
        }
    }
    let page = case.read("r/report/index.html");
    match page.chars().find(|c| super::case::is_obeyed(*c)) {
        Some(found) => Err(format!("{found:?} in the page")),
        None => Ok(verdict),
    }
}
