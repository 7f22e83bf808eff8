//! Every published number compared with the paper's own source. The source may not be
//! redistributed; it is read from the folder given by `SHARP_BENCH_SHARED`, and without it the
//! tests are reported as ignored.

use libtest_mimic::{Arguments, Failed, Trial};
use sharp_bench::report::paper::{PublishedTable, TABLES};

fn main() {
    let shared = sharp_tests::shared_data();
    let source = std::fs::read_to_string(shared.join("paper/sharp-paper.tex")).ok();
    let mut trials = Vec::new();
    for table in TABLES.iter() {
        let text = source.clone();
        let check = move || compare(text.as_deref().unwrap_or_default(), table);
        let trial = Trial::test(format!("published::{}", table.name), check);
        trials.push(trial.with_ignored_flag(source.is_none()));
    }
    let text = source.clone();
    let all = move || every_table_of_numbers_is_there(text.as_deref().unwrap_or_default());
    let trial = Trial::test("published::every_table", all);
    trials.push(trial.with_ignored_flag(source.is_none()));
    libtest_mimic::run(&Arguments::from_args(), trials).exit();
}

/// Compares labels, numbers as printed, and the marks of the first three if the paper has any.
fn compare(source: &str, table: &PublishedTable) -> Result<(), Failed> {
    let grid = parse(source, table)?;
    equal("datasets", &grid.datasets, &strings(&table.datasets))?;
    equal("metrics", &grid.metrics, &strings(&table.metrics))?;
    let labels: Vec<String> = table
        .rows
        .iter()
        .map(|(label, _)| (*label).to_owned())
        .collect();
    let found: Vec<String> = grid.rows.iter().map(|row| row.label.clone()).collect();
    equal("rows", &found, &labels)?;
    let all: Vec<usize> = (0..table.datasets.len()).collect();
    let shown = table.table(&all);
    for ((row, (label, printed)), shown) in grid.rows.iter().zip(&table.rows).zip(&shown.rows) {
        let printed: Vec<Option<String>> = printed.iter().map(|p| p.map(str::to_owned)).collect();
        let numbers: Vec<Option<String>> =
            row.cells.iter().map(|cell| cell.number.clone()).collect();
        equal(label, &numbers, &printed)?;
        for (column, (cell, shown)) in row.cells.iter().zip(&shown.cells).enumerate() {
            // The paper ranks before rounding: of numbers that print alike, it marks one ahead of
            // the other.
            let marked = grid.rows.iter().any(|row| row.cells[column].rank.is_some());
            if marked && !grid.has_ties(column) {
                equal(
                    &format!("{label}: mark of column {column}"),
                    &cell.rank,
                    &shown.rank,
                )?;
            }
        }
    }
    Ok(())
}

/// Checks that every table of measured numbers in the source is one of our tables.
fn every_table_of_numbers_is_there(source: &str) -> Result<(), Failed> {
    let labels = source.split("\\label{tab:").skip(1);
    for label in labels.filter_map(|rest| rest.split('}').next()) {
        let label = format!("tab:{label}");
        if !TABLES.iter().any(|table| table.label == label) {
            return Err(format!("{label} is not transcribed").into());
        }
    }
    Ok(())
}

fn strings(texts: &[&str]) -> Vec<String> {
    texts.iter().map(|text| (*text).to_owned()).collect()
}

fn equal<T: PartialEq + std::fmt::Debug>(what: &str, paper: &T, ours: &T) -> Result<(), Failed> {
    if paper == ours {
        Ok(())
    } else {
        Err(format!("{what}: the paper has {paper:?}, we have {ours:?}").into())
    }
}

/// A `tabular` of the source.
struct Source {
    datasets: Vec<String>,
    metrics: Vec<String>,
    rows: Vec<SourceRow>,
}

struct SourceRow {
    label: String,
    cells: Vec<SourceCell>,
}

struct SourceCell {
    /// `None` for a dash.
    number: Option<String>,
    rank: Option<u8>,
}

impl Source {
    fn has_ties(&self, column: usize) -> bool {
        let mut numbers: Vec<_> = self
            .rows
            .iter()
            .map(|row| &row.cells[column].number)
            .collect();
        numbers.sort();
        numbers.windows(2).any(|pair| pair[0] == pair[1])
    }
}

fn parse(source: &str, table: &PublishedTable) -> Result<Source, Failed> {
    let after = |text: &str, mark: &str| -> Result<String, Failed> {
        let (_, rest) = text.split_once(mark).ok_or_else(|| format!("no {mark}"))?;
        Ok(rest.to_owned())
    };
    let mut text = after(source, &format!("\\label{{{}}}", table.label))?;
    let part = usize::from(table.name == "privileged-psnr-ssim");
    for _ in 0..=part {
        text = after(&text, "\\toprule")?;
    }
    let (head, rest) = text.split_once("\\midrule").ok_or("no \\midrule")?;
    let (body, _) = rest.split_once("\\bottomrule").ok_or("no \\bottomrule")?;
    let lines = |text: &str| -> Vec<Vec<String>> {
        let lines = text.split("\\\\").filter(|line| !line.trim().is_empty());
        lines
            .map(|line| {
                line.split(" &")
                    .map(|cell| cell.trim().to_owned())
                    .collect()
            })
            .collect()
    };
    let (heads, body) = (lines(head), lines(body));
    if table.name == "param-count" {
        return transposed(&heads, &body);
    }
    let titles: Vec<(usize, String)> = heads[0]
        .iter()
        .filter_map(|cell| {
            let (width, title) = cell.strip_prefix("\\multicolumn{")?.split_once("}{c}{")?;
            Some((width.parse().ok()?, title.trim_end_matches('}').to_owned()))
        })
        .collect();
    let names = heads[usize::from(!titles.is_empty())].iter();
    let names: Vec<String> = names
        .map(|name| name.trim_end_matches(['↓', '↑']).to_owned())
        .collect();
    let names: Vec<String> = names.into_iter().filter(|name| !name.is_empty()).collect();
    let datasets = if titles.is_empty() {
        vec![String::new()]
    } else {
        titles.iter().map(|(_, title)| title.clone()).collect()
    };
    let metrics: Vec<String> = names[..names.len() / datasets.len()].to_vec();
    if names
        .chunks(metrics.len())
        .any(|of_dataset| *of_dataset != metrics)
    {
        return Err(format!("metrics differ between datasets: {names:?}").into());
    }
    let mut rows = Vec::new();
    for line in body {
        let (label, cells) = line.split_at(line.len() - names.len());
        let label = match label {
            [one] => plain(one),
            terms => {
                // The terms of a loss are marked as in the table's head.
                let names = ["color+alpha", "depth", "percep", "reg"].iter().zip(terms);
                let present = names.filter(|(_, mark)| plain(mark) == "yes");
                present.map(|(name, _)| *name).collect::<Vec<_>>().join("+")
            }
        };
        let cells: Result<_, Failed> = cells.iter().map(|cell| self::cell(cell)).collect();
        rows.push(SourceRow {
            label,
            cells: cells?,
        });
    }
    Ok(Source {
        datasets,
        metrics,
        rows,
    })
}

/// The table of parameters has its methods as columns.
fn transposed(heads: &[Vec<String>], body: &[Vec<String>]) -> Result<Source, Failed> {
    let mut rows = Vec::new();
    for (column, method) in heads[0].iter().enumerate().skip(1) {
        let cells: Result<_, Failed> = body.iter().map(|line| cell(&line[column])).collect();
        rows.push(SourceRow {
            label: method.clone(),
            cells: cells?,
        });
    }
    let metrics = body
        .iter()
        .map(|line| plain(&line[0]).trim_start_matches("# ").to_owned());
    Ok(Source {
        datasets: vec![String::new()],
        metrics: metrics.collect(),
        rows,
    })
}

/// Text without the commands that the paper's labels use.
fn plain(text: &str) -> String {
    let text = text.replace("\\YesV", "yes").replace("\\NoX", "no");
    let text = text
        .replace("\\%", "%")
        .replace("\\#", "#")
        .replace("\\times", "x");
    if text.contains('$') {
        text.replace(['$', ' '], "")
    } else {
        text
    }
}

fn cell(text: &str) -> Result<SourceCell, Failed> {
    let (rank, number) = match text.strip_prefix("\\cellcolor{tab_") {
        None => (None, text),
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
    let number = number.trim_end_matches(" ms").replace("$^*$", "*");
    Ok(SourceCell {
        number: (number != "-").then_some(number),
        rank,
    })
}
