//! Scores against what a pair takes.

use std::collections::BTreeMap;

use crate::evaluate::results::timings;
use crate::evaluate::{EvaluateError, Results};
use crate::pairs::valid_depth::median_of;
use crate::report::board::{Board, DatasetBoard};
use crate::report::error::ReportError;
use crate::report::input::Column;
use crate::report::plots::Figure;
use crate::report::plots::canvas::Surface;
use crate::report::plots::palette::Style;
use crate::report::plots::panels::{Panel, PanelFrame, PlotArea, PlotAxis, draw, point};
use crate::report::plots::style::FigureStyle;
use crate::report::statistics::of_metric;

/// Seconds by label of the method and pair id.
pub type Seconds = BTreeMap<String, BTreeMap<String, f64>>;

/// A method by its position, its median seconds and its mean score.
type Placed = (usize, f64, f64);

/// What the predictions of some results took; nothing of bundles, which hold no times.
///
/// # Errors
/// When a folder cannot be read.
pub fn seconds(results: &Results) -> Result<Seconds, EvaluateError> {
    let mut all = Seconds::new();
    for pictures in &results.pictures {
        for (label, own) in &pictures.labels {
            let taken = timings(pictures.folder.root(), own)?.into_iter();
            let by_pair = all.entry(label.clone()).or_default();
            by_pair.extend(taken.map(|(pair, timing)| (pair, timing.predict_secs)));
        }
    }
    Ok(all)
}

/// The mean of a metric against the median seconds a pair, a panel a dataset; `None` without a method that has both.
///
/// # Errors
/// When the drawing library refuses.
pub fn figure(
    board: &Board<'_>,
    metric: &Column,
    seconds: &Seconds,
    style: &FigureStyle,
) -> Result<Option<Figure>, ReportError> {
    let panels: Vec<(&DatasetBoard<'_>, Vec<Placed>)> = board
        .datasets
        .iter()
        .map(|dataset| {
            let methods = 0..board.methods.len();
            let points = methods.filter_map(|m| {
                let taken = seconds.get(&board.methods[m].label)?;
                let pairs = dataset.pairs.iter();
                let taken = pairs.filter_map(|p| taken.get(&p.facts.pair_id).copied());
                // Clocks tick in nanoseconds: no time at all has no place on a logarithmic axis.
                let median = median_of(taken.collect::<Vec<f64>>())?.max(1e-6);
                Some((m, median, of_metric(dataset, m, &metric.key).mean?))
            });
            (dataset, points.collect())
        })
        .collect();
    let all = || panels.iter().flat_map(|(_, points)| points);
    if all().next().is_none() {
        return Ok(None);
    }
    let range = |values: &mut dyn Iterator<Item = f64>| {
        values
            .filter(|v| v.is_finite())
            .fold((f64::INFINITY, f64::NEG_INFINITY), |(low, high), v| {
                (low.min(v), high.max(v))
            })
    };
    let (fastest, slowest) = range(&mut all().map(|(_, secs, _)| *secs));
    let (low, high) = range(&mut all().map(|(_, _, mean)| *mean));
    let (low, high) = if low <= high { (low, high) } else { (0.0, 1.0) };
    let room = (high - low) * 0.1;
    let y = PlotAxis::over(&metric.axis_label(), low - room, high + room, 6);
    let infinity = all().any(|(_, _, mean)| mean.is_infinite());
    let x = PlotAxis::logarithmic("synthesis time (s a pair)", fastest / 1.6, slowest * 1.6);
    let drawn = panels.iter().map(|(dataset, points)| Panel {
        frame: PanelFrame {
            title: dataset.dataset.title().to_owned(),
            remark: metric.direction_words().to_owned(),
            x: x.clone(),
            y: y.clone(),
            infinity,
            counts: Vec::new(),
        },
        content: if points.is_empty() {
            Err("no times")
        } else {
            Ok(Box::new(
                move |surface: &mut dyn Surface, area: &PlotArea| {
                    for (m, secs, mean) in points {
                        let at = (area.x.place(secs.log10()), area.height(*mean));
                        point(surface, at, style.of_method(*m), false);
                    }
                },
            ))
        },
    });
    let drawn: Vec<Panel<'_>> = drawn.collect();
    let methods = board.methods.iter().enumerate();
    let shown = methods.filter(|(m, _)| all().any(|(method, ..)| method == m));
    let legend: Vec<(&str, Style)> = shown
        .map(|(m, method)| (method.label.as_str(), style.of_method(m)))
        .collect();
    let caption = "Time: median wall seconds of predicting and rendering a pair on the run's own machine, while the pair before \
                   was being scored; a source predicted for an earlier pair is not predicted again.";
    let title = format!("{} against synthesis time", metric.label);
    draw(&title, caption, &legend, &drawn, Some(style)).map(Some)
}

#[cfg(test)]
mod tests {
    use sharp_metrics::MetricKey;

    use super::*;
    use crate::evaluate::record::{Record, Score};
    use crate::evaluate::test_records::record;

    #[test]
    fn methods_without_times_are_left_out_and_hostile_names_escaped() {
        let scored = |method: &str| Record {
            method: method.into(),
            scores: [("psnr".to_owned(), Score::Value(20.0))].into(),
            ..record("d", 0, 0)
        };
        let records = [scored("<b>&"), scored("untimed")];
        let board = Board::new(&records, &[], &[]).unwrap();
        let psnr = Column::from(MetricKey::PSNR);
        let style = FigureStyle::default();
        let none = figure(&board, &psnr, &Seconds::new(), &style).unwrap();
        assert_eq!(none, None);
        let taken = [("d/0/s__0".to_owned(), 0.0)].into();
        let seconds = [("<b>&".to_owned(), taken)].into();
        let svg = figure(&board, &psnr, &seconds, &style)
            .unwrap()
            .unwrap()
            .svg;
        assert!(svg.contains("&lt;b&gt;&amp;") && !svg.contains("untimed"));
    }
}
