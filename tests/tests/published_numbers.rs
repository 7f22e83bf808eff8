//! The paper's tables, as typed in, against the paper's own source. The source may not be redistributed; it is read
//! from the folder that `SHARP_BENCH_SHARED` names, and without it the tests are reported as ignored.

use libtest_mimic::{Arguments, Failed, Trial};
use sharp_bench::report::paper;
use sharp_bench::report::paper::numbers::{PaperTable, TABLES};

fn main() {
    let shared = sharp_tests::shared_data();
    let source = std::fs::read_to_string(shared.join("paper/sharp-paper.tex")).ok();
    let mut trials = Vec::new();
    for table in &TABLES {
        let text = source.clone();
        let check = move || compare(text.as_deref().unwrap_or_default(), table);
        let trial = Trial::test(format!("published::{}", table.name), check);
        trials.push(trial.with_ignored_flag(source.is_none()));
    }
    libtest_mimic::run(&Arguments::from_args(), trials).exit();
}

/// Names, numbers and the marks of the first three, cell by cell.
fn compare(source: &str, table: &PaperTable) -> Result<(), Failed> {
    let (heads, rows) = parse(source, table)?;
    let expected: Vec<String> = paper::columns().into_iter().map(str::to_owned).collect();
    equal("datasets", &heads.datasets, &expected)?;
    equal(
        "metrics",
        &heads.families,
        &table
            .families
            .map(|family| family.name().to_owned())
            .to_vec(),
    )?;
    let all: Vec<usize> = (0..expected.len()).collect();
    let ours = paper::table(table, &all);
    equal("rows", &rows.len(), &ours.rows.len())?;
    for ((row, (name, numbers)), shown) in rows.iter().zip(table.rows).zip(&ours.rows) {
        equal("method", &row.method.as_str(), &name)?;
        equal(name, &row.numbers, &numbers.to_vec())?;
        let ranks: Vec<Option<u8>> = shown.cells.iter().map(|cell| cell.rank).collect();
        equal(&format!("{name}: marks"), &row.ranks, &ranks)?;
    }
    Ok(())
}

fn equal<T: PartialEq + std::fmt::Debug>(what: &str, paper: &T, ours: &T) -> Result<(), Failed> {
    if paper == ours {
        Ok(())
    } else {
        Err(format!("{what}: the paper has {paper:?}, we have {ours:?}").into())
    }
}

struct Heads {
    datasets: Vec<String>,
    families: Vec<String>,
}

struct Row {
    method: String,
    numbers: Vec<f64>,
    ranks: Vec<Option<u8>>,
}

/// The `tabular` that the table was typed in from.
fn parse(source: &str, table: &PaperTable) -> Result<(Heads, Vec<Row>), Failed> {
    let after = |text: &str, mark: &str| -> Result<String, Failed> {
        let (_, rest) = text.split_once(mark).ok_or_else(|| format!("no {mark}"))?;
        Ok(rest.to_owned())
    };
    let mut text = after(source, &format!("\\label{{{}}}", table.label))?;
    for _ in 0..=table.part {
        text = after(&text, "\\toprule")?;
    }
    let (head, rest) = text.split_once("\\midrule").ok_or("no \\midrule")?;
    let (body, _) = rest.split_once("\\bottomrule").ok_or("no \\bottomrule")?;
    let mut lines = head.split("\\\\");
    let datasets = lines.next().unwrap_or_default().split("{c}{").skip(1);
    let datasets = datasets
        .filter_map(|d| d.split('}').next())
        .map(str::to_owned)
        .collect();
    let families: Vec<String> = lines
        .next()
        .unwrap_or_default()
        .split('&')
        .skip(1)
        .map(|f| f.trim().trim_end_matches(['↓', '↑']).to_lowercase())
        .collect();
    if families.chunks(2).any(|pair| pair != &families[..2]) {
        return Err(format!("metrics differ between datasets: {families:?}").into());
    }
    let heads = Heads {
        datasets,
        families: families.into_iter().take(2).collect(),
    };
    let mut rows = Vec::new();
    for line in body.split("\\\\").map(str::trim).filter(|l| !l.is_empty()) {
        let mut cells = line.split('&').map(str::trim);
        let mut row = Row {
            method: cells.next().unwrap_or_default().to_owned(),
            numbers: Vec::new(),
            ranks: Vec::new(),
        };
        for cell in cells {
            let (rank, number) = match cell.strip_prefix("\\cellcolor{tab_") {
                None => (None, cell),
                Some(marked) => {
                    let (colour, number) = marked.split_once('}').ok_or("cellcolor without end")?;
                    let rank = match colour {
                        "first" => 1,
                        "second" => 2,
                        "third" => 3,
                        other => return Err(format!("mark '{other}'").into()),
                    };
                    (Some(rank), number.trim())
                }
            };
            row.numbers
                .push(number.parse().map_err(|_| format!("'{cell}'"))?);
            row.ranks.push(rank);
        }
        rows.push(row);
    }
    Ok((heads, rows))
}
