//! Damaged bundles of scores, histories and gates.

use std::sync::LazyLock;

use sharp_tests::words;

use super::case::{Case, Verdict};
use super::spoil;

const RUN: &str = "run --dataset S:synthetic=size=32x24,views=4,scenes=3 --metrics psnr --no-cache --limit 9 \
     --method";

const GATE: &str = "fail_if = [\"psnr < -0.5\", \"|psnr| > 9 on S\", \"psnr < -90 per scene\"]\nmissing_pairs = 0\n";

/// Bundles of two runs, a history of both, a gate, and the result of `compare`.
static WHOLE: LazyLock<Result<(Case, serde_json::Value), String>> = LazyLock::new(|| {
    let mut case = Case::new("whole", 1);
    for (out, method) in [("a", "copy:label=m"), ("b", "mean:label=m")] {
        let bundle = format!("{out}.zip");
        case.run(&[&words(RUN)[..], &[method, "--out", out]].concat())?;
        case.run(&["bundle", out, "--out", &bundle])?;
        case.run(&["history", "add", "h", out, "--date", "2026-01-01"])?;
    }
    let said = case.run(&["compare", "a.zip", "b.zip", "--json"])?;
    let rows = said.json()?["rows"].clone();
    Ok((case, rows))
});

fn copied(case: &Case, names: &[&str]) -> Result<&'static serde_json::Value, String> {
    let (whole, rows) = WHOLE.as_ref().map_err(Clone::clone)?;
    for name in names {
        let bytes = std::fs::read(whole.path(name)).map_err(|e| format!("{name}: {e}"))?;
        case.write(name, bytes);
    }
    Ok(rows)
}

pub(crate) fn bundles(case: &mut Case) -> Result<Verdict, String> {
    let names = ["a.zip", "b.zip", "h/0001.zip", "h/0002.zip"];
    let rows = copied(case, &names)?;
    case.write("gate.toml", GATE);
    let name = *case
        .random
        .pick(&["b.zip", "b.zip", "h/0002.zip", "gate.toml"]);
    if name == "gate.toml" {
        spoil::file(case, name, spoil::text);
        let line = format!("gate --baseline a.zip --candidate b.zip --config {name}");
        let args = words(&line);
        let said = case.run(&[&args[..], &["--json"]].concat())?;
        if !matches!(said.code, 0 | 3 | 5) {
            return Ok(Verdict::Error);
        }
        // Whatever was requested, the gate's differences must equal those of `compare` on the undamaged runs.
        let psnr = rows[0]["difference"].as_f64();
        let json = said.json()?;
        let checks = json["gate"]["checks"].as_array().ok_or("no checks")?;
        let mut of_dataset = checks.iter().filter(|check| {
            check["quantity"] == "psnr" && check["dataset"] == "S" && check["scene"].is_null()
        });
        return if of_dataset.all(|check| check["difference"].as_f64() == psnr) {
            Ok(Verdict::Number)
        } else {
            Err(format!("another difference: {}", said.out))
        };
    }
    spoil::file(case, name, spoil::binary);
    if name == "b.zip" {
        let said = case.run(&["compare", "a.zip", name, "--json"])?;
        return match said.code {
            0 if said.json()?["rows"] == *rows => Ok(Verdict::Number),
            0 => Err(format!("other rows: {}", said.out)),
            _ => Ok(Verdict::Error),
        };
    }
    let said = case.run(&["history", "show", "h", "--json"])?;
    let json = said.json()?;
    let entries = json["entries"].as_array().map(Vec::len);
    match (said.code, entries) {
        (0, Some(2)) | (4, Some(1)) => {}
        (0, Some(1)) if !case.path(name).exists() => {}
        other => return Err(format!("{other:?}: {}{}", said.out, said.err)),
    }
    let first = |row: &serde_json::Value| row["entry"] == 1;
    let mut points = json["rows"].as_array().into_iter().flatten();
    let mean = points
        .find(|row| first(row))
        .and_then(|row| row["mean"].as_f64());
    let expected = rows[0]["mean_a"].as_f64();
    // A tolerance is needed, because sums over scenes and sums over pairs round differently.
    match mean.zip(expected) {
        Some((mean, expected)) if (mean - expected).abs() < 1e-12 => Ok(Verdict::Number),
        _ => Err(format!("another mean: {}", said.out)),
    }
}
