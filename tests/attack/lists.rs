//! Pair lists, the files next to them, and cached overlaps.

use std::collections::BTreeMap;
use std::sync::LazyLock;

use sharp_tests::words;

use super::case::{Case, Verdict};
use super::oracle::{Known, judge_run, rows, same};
use super::spoil;

const DATASET: &str = "S:synthetic=size=32x24,views=5";

/// PSNR by source and target.
type Copies = BTreeMap<(String, String), f64>;

/// PSNR of a copy for every ordered pair, computed from the dataset's pictures.
static COPIES: LazyLock<Result<Copies, String>> = LazyLock::new(|| {
    let mut case = Case::new("copies", 0);
    let said = case.run(&words(&format!(
        "run --dataset {DATASET} --metrics psnr --no-cache --method target \
         --pair-options threshold=0,at-threshold=in --out r",
    )))?;
    if said.code != 0 {
        return Err(said.err);
    }
    let rows = rows(&case.path("r/scores.csv"))?;
    let pictures: BTreeMap<&str, _> = rows
        .iter()
        .map(|row| {
            let path = case.path(&format!("r/predictions/target/{}.png", row["pair_id"]));
            (
                row["target"].as_str(),
                super::oracle::pixels(&path).unwrap(),
            )
        })
        .collect();
    let copies = rows.iter().map(|row| {
        let (source, target) = (&row["source"], &row["target"]);
        let psnr = super::oracle::psnr(&pictures[source.as_str()], &pictures[target.as_str()]);
        ((source.clone(), target.clone()), psnr.unwrap())
    });
    Ok(copies.collect())
});

fn copies(row: &BTreeMap<String, String>) -> Known {
    match COPIES.as_ref() {
        Ok(copies) => match copies.get(&(row["source"].clone(), row["target"].clone())) {
            Some(number) => Known::Number(*number),
            None => Known::Impossible("there is no such pair"),
        },
        Err(_) => Known::Impossible("the run on the undamaged list failed"),
    }
}

pub(crate) fn pairs(case: &mut Case) -> Result<Verdict, String> {
    let said = case.run(&words(&format!(
        "pairs --dataset {DATASET} --no-cache --out p.csv"
    )))?;
    if said.code != 0 {
        return Err(said.err);
    }
    let listed = rows(&case.path("p.csv"))?;
    let spoilt = *case.random.pick(&["p.csv", "p.csv", "p.csv", "p.csv.json"]);
    let harmless = spoil::file(case, spoilt, spoil::text);
    case.may_name("p.csv");
    if case.random.below(3) == 0 {
        let command = *case.random.pick(&["diff", "verify"]);
        let said = match command {
            "diff" => case.run(&["pairs", "diff", "p.csv", "p.csv", "--json"])?,
            _ => case.run(&["pairs", "verify", "p.csv", "--dataset", DATASET, "--json"])?,
        };
        return Ok(match said.code {
            0 => Verdict::Number,
            _ => Verdict::Error,
        });
    }
    let said = case.run(&words(&format!(
        "run --dataset {DATASET} --metrics psnr --method copy --pairs p.csv --out r",
    )))?;
    let verdict = judge_run(case, &said, "r", &copies)?;
    if said.code != 0 {
        return Ok(verdict);
    }
    let found = rows(&case.path("r/scores.csv"))?;
    if (harmless || spoilt != "p.csv") && found.len() != listed.len() {
        return Err(format!(
            "{} of {} pairs, although the list's meaning is unchanged",
            found.len(),
            listed.len()
        ));
    }
    // The number of listed pairs in the manifest must be that of the list in the folder.
    let manifest: serde_json::Value = serde_json::from_str(&case.read("r/manifest.json")).unwrap();
    if manifest["pairs"]["listed"].as_u64() == Some(rows(&case.path("r/pairs.csv"))?.len() as u64) {
        Ok(verdict)
    } else {
        Err("the manifest and pairs.csv differ in their numbers of pairs".to_owned())
    }
}

pub(crate) fn caches(case: &mut Case) -> Result<Verdict, String> {
    let args = ["pairs", "--dataset", DATASET, "--cache", "c", "--out"];
    if case.run(&[&args[..], &["p.csv"]].concat())?.code != 0 {
        return Err("the run on the undamaged list failed".to_owned());
    }
    let mut names = Vec::new();
    for folder in std::fs::read_dir(case.path("c")).unwrap() {
        for file in std::fs::read_dir(folder.unwrap().path()).unwrap() {
            let path = file.unwrap().path();
            names.push(
                path.strip_prefix(case.path(""))
                    .unwrap()
                    .display()
                    .to_string(),
            );
        }
    }
    names.sort();
    let name = case.random.pick(&names).clone();
    spoil::file(case, &name, spoil::text);
    let said = case.run(&[&args[..], &["q.csv"]].concat())?;
    if said.code != 0 {
        return Ok(Verdict::Error);
    }
    let (before, after) = (rows(&case.path("p.csv"))?, rows(&case.path("q.csv"))?);
    let overlaps = before.iter().zip(&after);
    let equal = before.len() == after.len()
        && overlaps.into_iter().all(|(a, b)| {
            let overlap: f64 = a["overlap"].parse().unwrap_or(f64::NAN);
            a["pair_id"] == b["pair_id"] && same(&b["overlap"], overlap)
        });
    if equal {
        Ok(Verdict::Number)
    } else {
        Err("another list, from a spoiled cache".to_owned())
    }
}
