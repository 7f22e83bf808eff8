//! Scores against seconds per pair.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

use crate::evaluate::bundle::timings;
use crate::evaluate::{EvaluateError, Results};
use crate::io::atomic_files::FileError;
use crate::pairs::valid_depth::median_of;
use crate::report::board::{Board, DatasetBoard};
use crate::report::column::Column;
use crate::report::speed::lines::SpeedLine;
use crate::report::statistics::of_metric;
use sharp_plots::axis::PlotAxis;
use sharp_plots::canvas::Surface;
use sharp_plots::palette::Style;
use sharp_plots::panels::{self, Panel, PanelFrame, PlotArea, point};
use sharp_plots::scale::finite_range;
use sharp_plots::style::FigureStyle;
use sharp_plots::{Figure, PlotError};

/// Seconds, keyed by method label, then by pair id.
pub type Seconds = BTreeMap<String, BTreeMap<String, f64>>;

/// A method's index, median seconds and mean score.
type Placed = (usize, f64, f64);

/// Seconds per prediction, as recorded in run folders. Bundles, which may contain no times, are left out.
///
/// # Errors
/// If a folder cannot be read.
pub fn seconds(results: &Results) -> Result<Seconds, EvaluateError> {
    let mut all = Seconds::new();
    for pictures in &results.pictures {
        for (label, own) in &pictures.labels {
            let taken = timings(pictures.folder.root(), own)?.into_iter();
            let by_pair = all.entry(label.clone()).or_default();
            by_pair.extend(taken.map(|(pair, timing)| (pair, timing.synthesis_secs())));
        }
    }
    Ok(all)
}

/// Times measured by `speed`: seconds of inference, upload and rendering together, keyed by method and dataset.
#[derive(Debug, Clone, Default)]
pub struct SpeedSeconds(BTreeMap<(String, String), f64>);

impl SpeedSeconds {
    /// Reads `speed.csv`, or the folder that contains it.
    ///
    /// # Errors
    /// If it cannot be read or was not written by `speed`.
    pub fn read(path: &Path) -> Result<Self, FileError> {
        let mut seconds = BTreeMap::new();
        for line in SpeedLine::read(path)? {
            if ["inference_secs", "load_secs", "render_secs"].contains(&line.quantity.as_str()) {
                *seconds.entry((line.method, line.dataset)).or_default() += line.median;
            }
        }
        Ok(Self(seconds))
    }

    fn of(&self, method: &str, dataset: &str) -> Option<f64> {
        self.0
            .get(&(method.to_owned(), dataset.to_owned()))
            .copied()
    }
}

/// Plots the mean of a metric against the median seconds per pair, one panel per dataset. `None` if no method has both
/// a score and a time.
///
/// # Errors
/// If the drawing library fails.
pub fn figure(
    board: &Board<'_>,
    metric: &Column,
    seconds: &Seconds,
    speed: &SpeedSeconds,
    style: &FigureStyle,
) -> Result<Option<Figure>, PlotError> {
    let mut by_speed = BTreeSet::new();
    let placed: Vec<(&DatasetBoard<'_>, Vec<Placed>)> = board
        .datasets
        .iter()
        .map(|dataset| {
            let points = board.plotted().filter_map(|m| {
                let label = board.methods[m].label.as_str();
                let in_run = || {
                    let taken = seconds.get(label)?;
                    let pairs = dataset.pairs.iter();
                    let taken = pairs.filter_map(|p| taken.get(&p.facts.pair_id).copied());
                    median_of(taken.collect::<Vec<f64>>())
                };
                let measured = speed.of(label, &dataset.dataset.name);
                if measured.is_some() {
                    by_speed.insert(label);
                }
                // A clock of low resolution may measure zero, which a logarithmic axis cannot show.
                let median = measured.or_else(in_run)?.max(1e-6);
                Some((m, median, of_metric(dataset, m, &metric.key).mean?))
            });
            (dataset, points.collect())
        })
        .collect();
    let all = || placed.iter().flat_map(|(_, points)| points);
    if all().next().is_none() {
        return Ok(None);
    }
    let (fastest, slowest) = finite_range(all().map(|(_, secs, _)| *secs)).unwrap_or((1.0, 1.0));
    let means = all().map(|(_, _, mean)| *mean);
    let y = PlotAxis::around(&metric.axis_label(), means, 0.1);
    let infinity = all().any(|(_, _, mean)| mean.is_infinite());
    let x = PlotAxis::logarithmic("synthesis time (s per pair)", fastest / 1.6, slowest * 1.6);
    let drawn = placed.iter().map(|(dataset, points)| Panel {
        frame: PanelFrame {
            infinity,
            ..PanelFrame::new(
                dataset.dataset.title(),
                metric.direction_words(),
                x.clone(),
                y.clone(),
            )
        },
        content: if points.is_empty() {
            Err("no times")
        } else {
            Ok(Box::new(move |surface: &mut Surface, area: &PlotArea| {
                for (m, secs, mean) in points {
                    let at = (area.x.place(secs.log10()), area.height(*mean));
                    let label = &board.methods[*m].label;
                    point(surface, at, style.of_method(label, *m), false);
                }
            }))
        },
    });
    let drawn: Vec<Panel<'_>> = drawn.collect();
    let methods = board.methods.iter().enumerate();
    let shown = methods.filter(|(m, _)| all().any(|(method, ..)| method == m));
    let shown: Vec<_> = shown.collect();
    let legend: Vec<(&str, Style)> = shown
        .iter()
        .map(|(m, method)| (method.label.as_str(), style.of_method(&method.label, *m)))
        .collect();
    let measured: Vec<&str> = by_speed.iter().copied().collect();
    let caption = caption(&measured, shown.len());
    let title = format!("{} against synthesis time", metric.label);
    panels::figure(&title, &caption, &legend, &drawn, Some(style)).map(Some)
}

/// States how the times were measured; `by_speed` names the methods measured by `speed`.
fn caption(by_speed: &[&str], shown: usize) -> String {
    const TIME: &str = "Time: median wall-clock seconds of inference and rendering per pair";
    const IN_RUN: &str = "recorded in the run, while the previous pair was being scored. An inference shared by \
                          several pairs counts in full for each.";
    match (by_speed, shown > by_speed.len()) {
        ([], _) => format!("{TIME}, {IN_RUN}"),
        (_, false) => format!("{TIME}; `speed` measured each method alone."),
        (some, true) => format!(
            "{TIME}. `speed` measured {} alone; the times of the other methods were {IN_RUN}",
            some.join(", ")
        ),
    }
}

#[cfg(test)]
mod tests {
    use sharp_metrics::MetricKey;

    use super::*;
    use crate::evaluate::record::{Record, Score};
    use crate::evaluate::test_records::record;
    use crate::report::test_results::results;

    #[test]
    fn methods_without_times_are_left_out_and_hostile_names_escaped() {
        let scored = |method: &str| Record {
            method: method.into(),
            scores: [("psnr".to_owned(), Score::Value(20.0))].into(),
            ..record("d", 0, 0)
        };
        let results = results(&[MetricKey::PSNR], vec![scored("<b>&"), scored("untimed")]);
        let board = Board::of(&results).unwrap();
        let psnr = Column::from(MetricKey::PSNR);
        let style = FigureStyle::default();
        let alone = SpeedSeconds::default();
        let none = figure(&board, &psnr, &Seconds::new(), &alone, &style).unwrap();
        assert_eq!(none, None);
        let taken = [("d/0/s__0".to_owned(), 0.0)].into();
        let seconds = [("<b>&".to_owned(), taken)].into();
        let svg = |alone: &SpeedSeconds| {
            let figure = figure(&board, &psnr, &seconds, alone, &style);
            figure.unwrap().unwrap().svg
        };
        let by_run = svg(&alone);
        assert!(by_run.contains("&lt;b&gt;&amp;") && !by_run.contains("untimed"));
        let folder = tempfile::tempdir().unwrap();
        let row = |what: &str, secs: &str| format!("untimed,d,,{what},1,{secs},1,1,1,1\n");
        let text = format!(
            "method,dataset,format,quantity,n,median,a,b,c,d\n{}{}{}",
            row("inference_secs", "2"),
            row("render_secs", "0.5"),
            row("tiles", "9")
        );
        std::fs::write(folder.path().join("speed.csv"), text).unwrap();
        let alone = SpeedSeconds::read(folder.path()).unwrap();
        assert_eq!(alone.of("untimed", "d"), Some(2.5));
        assert!(svg(&alone).contains("untimed"));
        assert!(caption(&[], 2).contains("recorded in the run"));
        assert!(!caption(&["a", "b"], 2).contains("recorded in the run"));
        assert!(
            caption(&["a"], 2).contains("`speed` measured a alone; the times of the other methods")
        );
    }
}
