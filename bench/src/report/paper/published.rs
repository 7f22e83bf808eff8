//! Every number published in the SHARP paper, from `data/paper_tables.csv`.

use std::sync::LazyLock;

use clap::ValueEnum as _;
use sharp_metrics::{Direction, Family, MetricKey};

use crate::report::column::Column;
use crate::report::tables::rank::{RankedValue, ranks};
use crate::report::tables::{Cell, Group, Origin, Row, Table};

/// Lines `table,part,row,dataset,metric,value`, transcribed from the paper's LaTeX: `part` is the
/// index of the `tabular` within the table, `value` the number as printed.
const NUMBERS: &str = include_str!("../../../data/paper_tables.csv");

/// Tables with results, in order of importance in the paper. Each has a name, LaTeX label, source of rows, heading of
/// rows and title.
const LIST: &str = include_str!("../../../data/paper_table_list.tsv");

/// The method that the paper names as the strongest earlier one.
const STRONGEST: &str = "Gen3C";

/// Kind of data that the user's own rows are read from.
#[derive(Debug, Clone, Copy, PartialEq, Eq, clap::ValueEnum)]
pub enum MadeBy {
    /// Scores of a run.
    Run,
    /// Scores of a run with privileged depth.
    PrivilegedRun,
    /// Times measured by `speed`.
    Speed,
    /// Output of `analyze translation`.
    Translation,
    /// Tensor shapes of a checkpoint.
    Checkpoint,
}

#[derive(Debug, Clone, PartialEq)]
pub struct PublishedTable {
    /// Name on the command line and in file names.
    pub name: &'static str,
    /// LaTeX label in the paper.
    pub label: &'static str,
    pub title: &'static str,
    /// Heading above the rows' labels.
    pub row_head: &'static str,
    pub made_by: MadeBy,
    /// Names of the column groups; a single empty name if the table has no datasets.
    pub datasets: Vec<&'static str>,
    /// Columns within each group, by their names in the paper.
    pub metrics: Vec<&'static str>,
    /// Row labels and printed numbers, `None` for a dash. The number of dataset d and metric m is at
    /// `d * metrics.len() + m`.
    pub rows: Vec<(&'static str, Vec<Option<&'static str>>)>,
}

/// All tables with results, in order of importance in the paper.
pub static TABLES: LazyLock<Vec<PublishedTable>> = LazyLock::new(|| {
    let tables = LIST.lines().skip(1).filter_map(|line| {
        let fields: [&str; 5] = line.split('\t').collect::<Vec<_>>().try_into().ok()?;
        let [name, label, made_by, row_head, title] = fields;
        let empty = PublishedTable {
            name,
            label,
            title,
            row_head,
            made_by: MadeBy::from_str(made_by, false).ok()?,
            datasets: Vec::new(),
            metrics: Vec::new(),
            rows: Vec::new(),
        };
        Some(empty.filled())
    });
    tables.collect()
});

pub fn published(name: &str) -> Option<&'static PublishedTable> {
    TABLES.iter().find(|table| table.name == name)
}

/// The six fields of each line of the file, without the header. No field contains a comma, so quotes need no handling.
fn lines() -> impl Iterator<Item = [&'static str; 6]> {
    let lines = NUMBERS.lines().skip(1);
    lines.filter_map(|line| line.split(',').collect::<Vec<_>>().try_into().ok())
}

impl PublishedTable {
    fn filled(mut self) -> Self {
        let own = || lines().filter(|line| line[0] == self.name);
        let distinct = |field: usize| {
            let mut values: Vec<&'static str> = Vec::new();
            for line in own() {
                if !values.contains(&line[field]) {
                    values.push(line[field]);
                }
            }
            values
        };
        let (labels, datasets, metrics) = (distinct(2), distinct(3), distinct(4));
        let value = |row: &str, dataset: &str, metric: &str| {
            own().find_map(|[_, _, r, d, m, value]| {
                (r == row && d == dataset && m == metric).then_some(value)
            })
        };
        let rows = labels.into_iter().map(|row| {
            let cells = datasets
                .iter()
                .flat_map(|dataset| metrics.iter().map(|metric| value(row, dataset, metric)));
            (row, cells.collect())
        });
        self.rows = rows.collect();
        self.datasets = datasets;
        self.metrics = metrics;
        self
    }

    /// The columns as published, with unstated identity and as many decimals as printed.
    pub fn columns(&self) -> Vec<Column> {
        let metrics = self.metrics.iter().enumerate();
        metrics
            .map(|(m, name)| {
                let printed = self.rows.iter().flat_map(|(_, cells)| {
                    cells.iter().skip(m).step_by(self.metrics.len()).flatten()
                });
                let decimals = printed.map(|text| decimals(text)).max().unwrap_or_default();
                Column {
                    decimals,
                    ..column(name)
                }
            })
            .collect()
    }

    /// The number in the row with the label `row`, for a dataset and a metric.
    pub fn number(&self, row: &str, dataset: &str, metric: &str) -> Option<f64> {
        let (_, cells) = self.rows.iter().find(|(label, _)| *label == row)?;
        let d = self.datasets.iter().position(|name| *name == dataset)?;
        let m = self.metrics.iter().position(|name| *name == metric)?;
        cells[d * self.metrics.len() + m].and_then(number)
    }

    /// The table, reduced to the datasets with these indices. Its rows are marked as published and ranked only among
    /// each other.
    pub fn table(&self, datasets: &[usize]) -> Table {
        let columns = self.columns();
        let rows = self.rows.iter().map(|(label, _)| Row {
            origin: Origin::Published,
            ..Row::measured(label.replace("(ours)", "(published)"), Vec::new())
        });
        let mut rows: Vec<Row> = rows.collect();
        for &dataset in datasets {
            for (m, column) in columns.iter().enumerate() {
                let printed = self
                    .rows
                    .iter()
                    .map(|(_, cells)| cells[dataset * columns.len() + m]);
                let printed: Vec<Option<&str>> = printed.collect();
                let candidates = printed.iter().map(|text| RankedValue {
                    value: text.and_then(number),
                    covers: &[],
                    complete: true,
                    ranked: true,
                });
                let candidates: Vec<RankedValue<'_>> = candidates.collect();
                let ranks = ranks(&candidates, column.direction, column.decimals);
                let cells = candidates.iter().zip(printed).zip(ranks);
                for (row, ((candidate, text), rank)) in rows.iter_mut().zip(cells) {
                    row.cells.push(Cell {
                        rank,
                        ..Cell::printed(candidate.value, text.unwrap_or("–"))
                    });
                }
            }
        }
        let groups = datasets.iter().map(|&d| Group::titled(self.datasets[d]));
        Table {
            row_head: self.row_head,
            remarks: vec![self.caveat()],
            ..Table::new(self.name, self.title, groups.collect(), columns, rows)
        }
    }

    /// A note on the published numbers, for readers who compare other numbers with them.
    fn caveat(&self) -> String {
        let is = match self.made_by {
            MadeBy::Run | MadeBy::PrivilegedRun => {
                "means over the paper's own pairs, whose list is not published. The paper states neither the LPIPS \
                 backbone nor the SSIM window nor the resize kernel, so these numbers are shown next to those \
                 measured here but never \
                 ranked with them"
            }
            MadeBy::Translation => {
                "measured on a picture that the paper does not name. The paper states neither the LPIPS network nor \
                 the SSIM window nor how pictures were shifted, so compare trends, not digits"
            }
            MadeBy::Speed if self.name == "ablation_loss_render" => {
                "median latency per frame, milliseconds, on a device that the paper does not name for this table"
            }
            MadeBy::Speed => {
                "seconds on an A100 (an H100 for SVC and TMPI on ETH3D), rendered at each dataset's own resolution"
            }
            MadeBy::Checkpoint => {
                "millions (M) and billions (B) of parameters, as reported by the methods or counted in their \
                 sources; trainable parameters are all except those of frozen modules; * marks a fine-tuned \
                 diffusion model"
            }
        };
        let mut text = format!(
            "Published in the SHARP paper (`{}`): {is}; ranks are among the paper's rows.",
            self.label
        );
        if self
            .columns()
            .iter()
            .all(|column| column.direction.is_none())
        {
            text = text.replace("; ranks are among the paper's rows", "");
        }
        let percent = |[ours, other]: [&str; 2], metric: &str| {
            let (least, most) = gains(self, [ours, other], metric)?;
            Some(format!("{:.0}–{:.0} %", 100.0 * least, 100.0 * most))
        };
        let strongest = ["SHARP (ours)", STRONGEST];
        if let (true, Some(dists), Some(lpips)) = (
            self.name == "quantitative",
            percent(strongest, "DISTS"),
            percent(strongest, "LPIPS"),
        ) {
            text.push_str(&format!(
                " The gains in the paper's abstract, from the smallest to the largest over its datasets, are \
                 relative to {STRONGEST}: DISTS {dists}, LPIPS {lpips}."
            ));
        }
        let percep = ["color+alpha+depth+percep", "color+alpha+depth"];
        for (name, metric, stated) in [
            ("ablation_loss", "DISTS", "47 and 62 %"),
            ("ablation_loss_render", "Latency", "36 and 49 %"),
        ] {
            if let (true, Some(found)) = (self.name == name, percent(percep, metric)) {
                text.push_str(&format!(
                    " By these numbers the perceptual loss lowers {metric} by {found}; the paper's text says {stated}."
                ));
            }
        }
        if self.label == "tab:quantitative-aligned" {
            text.push_str(
                " With privileged ground-truth depth: depth is multiplied by one factor, the median of true over \
                 predicted depth; for LVSM and SVC, a linear sweep over scales minimises DISTS per pair.",
            );
        }
        text
    }
}

fn decimals(printed: &str) -> usize {
    let digits = printed.split_once('.').map_or("", |(_, digits)| digits);
    digits.bytes().take_while(u8::is_ascii_digit).count()
}

/// Value of a printed number: `0.097`, or parameters in millions (`2.33B` is 2330).
pub fn number(printed: &str) -> Option<f64> {
    let plain = printed.trim_end_matches('*');
    match (plain.strip_suffix('M'), plain.strip_suffix('B')) {
        (Some(millions), _) => millions.parse().ok(),
        // Move the decimal point in the text, because 7.7 × 1000 may not be exactly 7700.
        (_, Some(billions)) => format!("{billions}e3").parse().ok(),
        _ => plain.parse().ok(),
    }
}

fn column(name: &str) -> Column {
    let family = Family::ALL
        .into_iter()
        .find(|f| f.name().eq_ignore_ascii_case(name));
    if let Some(family) = family {
        return metric(family);
    }
    let (unit, direction, convention) = match name {
        "Inference" => (
            "s",
            Some(Direction::Lower),
            "from a photograph to a renderable representation, or to the picture",
        ),
        "Render" => ("s", Some(Direction::Lower), "of a view"),
        "Latency" => ("ms", Some(Direction::Lower), "of rendering a frame, median"),
        _ => ("M", None, "parameters"),
    };
    Column {
        unit: unit.to_owned(),
        direction,
        ..Column::reported(
            &format!("{}[unstated]", name.to_lowercase()),
            name,
            0,
            convention,
        )
    }
}

/// A metric whose variant is unknown.
pub(crate) fn metric(family: Family) -> Column {
    let key = match family {
        Family::Psnr => MetricKey::PSNR,
        Family::Ssim => MetricKey::SSIM,
        Family::Lpips => MetricKey::LPIPS,
        Family::Dists => MetricKey::DISTS,
    };
    Column {
        key: format!("{}[unstated]", family.name()),
        label: family.name().to_uppercase(),
        short: family.name().to_uppercase(),
        convention: "as published; the paper does not state which variant".into(),
        ..key.into()
    }
}

/// The smallest and the largest relative reduction of a metric from the second row to the first, over the datasets; 0.1
/// is 10 %.
fn gains(table: &PublishedTable, rows: [&str; 2], metric: &str) -> Option<(f64, f64)> {
    let gains = table.datasets.iter().filter_map(|dataset| {
        let [ours, other] = rows.map(|row| table.number(row, dataset, metric));
        Some(1.0 - ours? / other?)
    });
    let gains: Vec<f64> = gains.collect();
    let smallest = gains.iter().copied().reduce(f64::min)?;
    Some((smallest, gains.into_iter().reduce(f64::max)?))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_number_of_the_file_is_in_a_table() {
        let cells = TABLES
            .iter()
            .flat_map(|t| &t.rows)
            .flat_map(|(_, cells)| cells);
        let numbers = cells.flatten().map(|text| number(text).unwrap_or(f64::NAN));
        let numbers: Vec<f64> = numbers.collect();
        assert_eq!(numbers.len(), NUMBERS.lines().count() - 1);
        assert_eq!(numbers.len(), 590);
        assert!(numbers.iter().all(|number| number.is_finite()));
    }

    #[test]
    fn the_abstracts_gains_are_those_over_gen3c() {
        let table = published("quantitative").unwrap();
        let percent = |metric: &str| {
            let (low, high) = gains(table, ["SHARP (ours)", "Gen3C"], metric).unwrap();
            ((100.0 * low).round(), (100.0 * high).round())
        };
        assert_eq!(percent("LPIPS"), (25.0, 34.0));
        assert_eq!(percent("DISTS"), (21.0, 43.0));
        let remark = &table.table(&[0]).remarks[0];
        assert!(remark.contains("DISTS 21–43 %, LPIPS 25–34 %"), "{remark}");
        // The gains are over Gen3C, not over the best row of each column: TMPI is ahead of Gen3C on Middlebury.
        assert!(gains(table, ["SHARP (ours)", "TMPI"], "LPIPS").unwrap().0 < 0.20);
    }

    /// The paper's text states a gain of 62 % for DISTS; its printed numbers give 61 %.
    #[test]
    fn the_texts_gains_of_the_perceptual_loss_are_computed() {
        let remark = |name: &str| published(name).unwrap().table(&[0]).remarks[0].clone();
        let [scores, latency] = ["ablation_loss", "ablation_loss_render"].map(remark);
        assert!(
            scores.ends_with("lowers DISTS by 47–61 %; the paper's text says 47 and 62 %."),
            "{scores}"
        );
        assert!(
            latency.ends_with("lowers Latency by 36–49 %; the paper's text says 36 and 49 %."),
            "{latency}"
        );
    }

    #[test]
    fn printed_numbers_are_read_and_shown_as_they_are() {
        assert_eq!(number("7.4B*"), Some(7400.0));
        assert_eq!(number("702M"), Some(702.0));
        assert_eq!(number("0.370"), Some(0.37));
        assert_eq!(number("-"), None);
        let table = published("psnr-ssim").unwrap();
        let decimals: Vec<usize> = table.columns().iter().map(|c| c.decimals).collect();
        assert_eq!(decimals, [2, 3]);
        assert_eq!(
            published("metrics_comparison").unwrap().columns()[2].decimals,
            1
        );
        let speed = published("timing-comparison").unwrap().table(&[0]);
        // LVSM has no rendering time.
        assert_eq!(speed.rows[2].cells[1].printed.as_deref(), Some("–"));
        assert_eq!(speed.rows[2].cells[1].value, None);
    }

    #[test]
    fn published_numbers_never_have_the_identity_of_measured_ones() {
        for column in TABLES.iter().flat_map(PublishedTable::columns) {
            assert!(column.key.ends_with("[unstated]"), "{}", column.key);
        }
    }
}
