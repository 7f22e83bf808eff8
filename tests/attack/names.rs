//! Names with a special meaning to terminals, pages, spreadsheets or file systems.

use std::path::Path;

use sharp_tests::words;

use super::case::{Case, Verdict, is_obeyed};
use super::oracle::{Known, judge_run, pixels, psnr, rows};

const NAMES: [&str; 24] = [
    "=cmd|' /C calc'!A0",
    "=HYPERLINK(\"http:\")",
    "+1+1",
    "-1+1",
    "@SUM(1)",
    "'=1",
    "\t=1",
    "\u{1b}[2Jclear",
    "\u{1b}]0;title\u{7}",
    "\u{9b}31m",
    "line\nerror: end",
    "return\rerror",
    "\u{202e}gnp.txt",
    "\u{2066}isolated",
    "森森森森森森森森森森森森森森森森森森森森森森森森森森森森森森森森森",
    "<script>alert(1)</script>",
    "\"><img src=x onerror=alert(1)>",
    "a,b;c|d\"e",
    "%2e%2e%2f",
    "..x..",
    "a__b",
    "con",
    "$(touch pwned)",
    "{{7*7}}",
];

pub(crate) fn names(case: &mut Case) -> Result<Verdict, String> {
    let name = *case.random.pick(&NAMES);
    let edge = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/fuzz/datasets/middlebury/A");
    for file in ["calib.txt", "disp0.pfm", "im0.png", "im1.png"] {
        case.write(
            &format!("data/{name}/{file}"),
            std::fs::read(edge.join(file)).unwrap(),
        );
    }
    let broken = case.random.below(4) == 0;
    if broken {
        case.write(&format!("data/{name}/im1.png"), "no picture");
    }
    case.note(format!("a scene {name:?}, broken: {broken}"), "im1.png");
    let dataset = words("--dataset D:middlebury=data --metrics psnr --method copy");
    let said = case.run(&[&["run"], &dataset[..], &["--out", "r"]].concat())?;
    let expected = psnr(
        &pixels(&edge.join("im0.png")).unwrap(),
        &pixels(&edge.join("im1.png")).unwrap(),
    );
    let verdict = judge_run(case, &said, "r", &|_| Known::Number(expected.unwrap()))?;
    if broken {
        return match verdict {
            Verdict::Error => Ok(verdict),
            Verdict::Number => Err("a score of a broken picture".to_owned()),
        };
    }
    if said.code != 0 {
        return Ok(verdict);
    }
    case.run(&["report", "r"])?;
    for file in [
        "index.html",
        "report.md",
        "tables/scores.md",
        "tables/scores.tex",
    ] {
        let text = case.read(&format!("r/report/{file}"));
        if let Some(found) = text.chars().find(|c| is_obeyed(*c)) {
            return Err(format!("{found:?} in {file}"));
        }
    }
    if case.read("r/report/index.html").contains("<script>alert") || case.path("pwned").exists() {
        return Err("the name was executed by the page or by a shell".to_owned());
    }
    for file in ["scores.csv", "pairs.csv"] {
        for cell in rows(&case.path("r").join(file))?
            .iter()
            .flat_map(|row| row.values())
        {
            if cell.starts_with(['=', '+', '@', '\t', '\r'])
                || (cell.starts_with('-') && cell.parse::<f64>().is_err())
            {
                return Err(format!("a formula in {file}: {cell:?}"));
            }
        }
    }
    // If the list is read again, it is the same.
    let again = case.run(
        &[
            &["run"],
            &dataset[..],
            &["--pairs", "r/pairs.csv", "--out", "s"],
        ]
        .concat(),
    )?;
    if again.code == 0 && case.read("r/scores.csv") == case.read("s/scores.csv") {
        Ok(verdict)
    } else {
        Err(format!("another run from its own list: {}", again.err))
    }
}
