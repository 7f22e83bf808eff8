//! Tables of the numbers behind the plots.

use std::fmt::Write as _;

use sharp_metrics::Direction;

use super::Band;
use super::study::{CrossingRule, FoundCrossing, Sweep, SweepBin};
use crate::evaluate::results::number;
use crate::io::text::csv_bytes;
use crate::report::column::Column;
use crate::report::tables::csv::{optional, text};
use crate::report::tables::latex::{Environment, escape, noted};
use sharp_plots::panels::BinCount;

/// The columns of the table of bins.
pub(super) const COLUMNS: &str =
    "dataset,method,split,metric,x,x_low,x_high,n,mean,sd,ci_low,ci_high";
/// Header of the table of crossings.
pub(super) const CROSSINGS: &str =
    "dataset,method,split,metric,rule,x,ci_low,ci_high,clusters,resamples,seed";

/// First line of the LaTeX file.
pub(super) const MARK: &str = "% by sharp-bench sweep";

/// One row per bin at full precision: `x` is the mean position of its pairs, `sd` the sample standard deviation of
/// their scores, `ci_low` and `ci_high` a 95 % interval of the mean over clusters. Unknown values are empty.
pub fn csv(sweep: &Sweep) -> Vec<u8> {
    let lines = sweep
        .panels
        .iter()
        .flat_map(|panel| panel.lines.iter().map(move |line| (panel, line)));
    let rows = lines.flat_map(|(panel, line)| {
        let metrics = sweep.metrics.iter().zip(&line.bins);
        let bins = metrics.flat_map(|(metric, bins)| bins.iter().map(move |bin| (metric, bin)));
        bins.map(move |(metric, SweepBin { banded, interval })| {
            let bin = &banded.bin;
            [
                text(&line.dataset),
                text(&line.method),
                text(&panel.split),
                text(&metric.key),
                number(bin.x),
                number(bin.low),
                number(bin.high),
                bin.n().to_string(),
                number(bin.mean),
                optional(bin.std),
                optional(interval.map(|(low, _)| low)),
                optional(interval.map(|(_, high)| high)),
            ]
        })
    });
    csv_bytes(COLUMNS.split(','), rows)
}

/// One row per crossing. The position is `-inf` if the method is worse in every bin, and `inf` if it is not worse in
/// the last bin.
pub fn crossings_csv(sweep: &Sweep) -> Vec<u8> {
    let rows = sweep.crossings.iter().map(|crossing| {
        let interval = crossing.found.interval;
        [
            text(&crossing.dataset),
            text(&crossing.method),
            text(&crossing.split),
            text(&sweep.metrics[crossing.metric].key),
            text(&rule(sweep, crossing)),
            number(crossing.found.x),
            optional(interval.map(|(low, _)| low)),
            optional(interval.map(|(_, high)| high)),
            crossing.found.clusters.to_string(),
            sweep.resampling.count.to_string(),
            sweep.resampling.seed.to_string(),
        ]
    });
    csv_bytes(CROSSINGS.split(','), rows)
}

/// The rule as text: `behind METHOD`, `below VALUE` if higher is better, or `above VALUE` if lower is better.
pub fn rule(sweep: &Sweep, crossing: &FoundCrossing) -> String {
    let side = match sweep.metrics[crossing.metric].direction {
        Some(Direction::Higher) => "below",
        _ => "above",
    };
    match &crossing.rule {
        CrossingRule::Behind(name) => format!("behind {name}"),
        CrossingRule::Beyond(limit) => format!("{side} {limit}"),
    }
}

/// A sentence on the camera motion from which a method is worse than a threshold or another method.
pub fn sentence(sweep: &Sweep, crossing: &FoundCrossing) -> String {
    let metric = &sweep.metrics[crossing.metric];
    let x = crossing.found.x;
    let (is, from) = match x {
        f64::NEG_INFINITY => ("is", "in every bin".to_owned()),
        f64::INFINITY => ("is not", "in the last bin".to_owned()),
        x => {
            let place = sweep.spec.x.phrase(&short(x));
            ("is", format!("from {place} on"))
        }
    };
    let end = |x: f64| match x {
        f64::NEG_INFINITY => "the first bin".to_owned(),
        f64::INFINITY => "beyond the last bin".to_owned(),
        x => short(x),
    };
    let interval = match crossing.found.interval {
        Some((low, high)) if low == high && low == x => {
            " (and so in the central 95 % of resamples)".to_owned()
        }
        Some((low, high)) => format!(" (95 % interval: {} to {})", end(low), end(high)),
        None => " (no interval, because there is a single scene)".to_owned(),
    };
    format!(
        "{}: in {}, {} {is} {} {from}{interval}",
        crossing.split,
        metric.label,
        crossing.method,
        rule(sweep, crossing),
    )
}

/// One `table` environment per metric, with bins as rows and methods as columns.
pub fn latex(sweep: &Sweep) -> String {
    let mut out = "% \\usepackage{booktabs,graphicx}\n".to_owned();
    for (k, metric) in sweep.metrics.iter().enumerate() {
        let mut labels: Vec<&str> = Vec::new();
        for line in sweep.lines_with(k) {
            if !labels.contains(&line.label.as_str()) {
                labels.push(&line.label);
            }
        }
        if !labels.is_empty() {
            out += &table(sweep, k, metric, &labels);
        }
    }
    format!("{MARK}\n{}", noted(out))
}

fn table(sweep: &Sweep, k: usize, metric: &Column, labels: &[&str]) -> String {
    let note = format!(
        "Rows: {}, {}. {}",
        sweep.spec.x.label(),
        sweep.spec.binning,
        sweep.spec.x.definition()
    );
    let spread = match sweep.spec.band {
        Band::Sd => " Mean ± one sample standard deviation.",
        Band::Ci95 => " Mean and its 95 % interval over scenes.",
        Band::None => "",
    };
    let mut out = format!("{} & $n$", escape(sweep.spec.x.title()));
    for label in labels {
        let _ = write!(out, " & {}", escape(label));
    }
    out.push_str(" \\\\\n");
    for panel in &sweep.panels {
        let counts = panel.counts(k);
        if counts.is_empty() {
            continue;
        }
        let _ = write!(
            out,
            "\\midrule\n\\multicolumn{{{}}}{{l}}{{\\emph{{{}}}}} \\\\\n",
            labels.len() + 2,
            escape(&panel.split)
        );
        for (number, BinCount { low, high, n }) in counts {
            let range = format!("{}–{}", short(low), short(high));
            let n = match n {
                (least, most) if least == most => most.to_string(),
                (least, most) => format!("{least}--{most}"),
            };
            let _ = write!(out, "{} & {n}", escape(&range));
            for label in labels {
                let line = panel.lines.iter().find(|line| line.label == *label);
                let bins = line.and_then(|line| {
                    let mut bins = line.bins[k].iter();
                    bins.find(|bin| bin.banded.bin.number == number)
                });
                let cell =
                    bins.map_or_else(|| "–".to_owned(), |bin| cell(bin, metric, sweep.spec.band));
                let _ = write!(out, " & {}", escape(&cell));
            }
            out.push_str(" \\\\\n");
        }
    }
    let caption = format!(
        "{} against {}.{}",
        escape(&metric.label),
        escape(sweep.spec.x.label()),
        escape(spread)
    );
    let below = format!(
        "{}: \\texttt{{{}}}. {}\n",
        escape(&metric.label),
        escape(&metric.key),
        escape(&note),
    );
    let environment = Environment {
        caption: &caption,
        label: Some(&format!("sweep-{}", metric.slug())),
        columns: &format!("lr{}", "c".repeat(labels.len())),
        is_wide: true,
    };
    environment.around(&out, &below)
}

fn cell(bin: &SweepBin, metric: &Column, band: Band) -> String {
    let mean = metric.shown(bin.banded.bin.mean);
    match (band, bin.banded.bin.std, bin.interval) {
        (Band::Sd, Some(std), _) => format!("{mean} ± {}", metric.shown(std)),
        (Band::Ci95, _, Some((low, high))) => {
            format!("{mean} [{}, {}]", metric.shown(low), metric.shown(high))
        }
        _ => mean,
    }
}

/// Four decimals, without trailing zeros.
fn short(value: f64) -> String {
    let text = format!("{value:.4}");
    text.trim_end_matches('0').trim_end_matches('.').to_owned()
}
