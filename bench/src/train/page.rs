//! A page with the progress of a training run, which opens from disk: curves from the run's logs, and samples from its
//! last validation.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use askama::Template;

use super::{TrainError, TrainingFolder};
use crate::evaluate::Results;
use crate::io::atomic_files::{FileError, write_atomic};
use crate::io::observer::Observer;
use crate::io::text::visible;
use crate::report::html::{STYLE, VERSION, themed};
use crate::report::pictures::{ReportPictures, Thumbnail, scenes};
use crate::report::{MissingPicture, ReportError};
use sharp_plots::Figure;
use sharp_plots::axis::PlotAxis;
use sharp_plots::bins::{Binning, bins};
use sharp_plots::canvas::Surface;
use sharp_plots::curves::{Banded, curve, shade, vertical};
use sharp_plots::palette::{stroke, style};
use sharp_plots::panels::{Panel, PanelFrame, PlotArea, figure, point};

/// Maximum number of intervals of a curve; values are averaged within each interval.
const STRETCHES: usize = 30;
/// Maximum number of pairs shown.
const SAMPLES: usize = 8;
/// Longest side of a shown picture, in pixels.
const SIDE: u32 = 320;
const STEPS: &str = "steps";

#[derive(Template)]
#[template(path = "train.html")]
struct TrainPage {
    title: &'static str,
    /// Tiles with a label and a number.
    tiles: Vec<(&'static str, String)>,
    figures: Vec<Figure>,
    /// For each stage: its number, its number of steps, median seconds per step, and hours.
    stages: Vec<[String; 4]>,
    samples: Vec<Sample>,
    perceptual_network: Option<&'static str>,
    config: String,
}

/// A pair of the last validation.
struct Sample {
    pair: String,
    /// Source, target and prediction; each is a URL, or the reason why the picture is missing.
    pictures: [(&'static str, Result<String, String>); 3],
}

impl TrainPage {
    fn plot(&self, figure: &Figure) -> String {
        themed(&figure.svg)
    }
}

/// A CSV file of numbers, optionally with a name in the last column.
struct Log {
    columns: Vec<String>,
    rows: Vec<csv::StringRecord>,
    path: PathBuf,
}

/// Stage and step.
type Place = (u64, u64);

impl Log {
    fn read(path: PathBuf) -> Result<Self, TrainError> {
        let fault = |error: csv::Error| TrainError::Log {
            path: path.clone(),
            reason: error.to_string(),
        };
        let mut reader = csv::Reader::from_path(&path).map_err(fault)?;
        let columns = reader.headers().map_err(fault)?.iter();
        let columns = columns.map(str::to_owned).collect();
        let rows = reader.records().collect::<Result<_, _>>().map_err(fault)?;
        Ok(Self {
            columns,
            rows,
            path,
        })
    }

    fn number<T: std::str::FromStr>(
        &self,
        row: &csv::StringRecord,
        column: usize,
    ) -> Result<T, TrainError> {
        let cell = row.get(column).unwrap_or_default();
        cell.parse().map_err(|_| TrainError::Log {
            path: self.path.clone(),
            reason: format!("'{cell}' is not a number"),
        })
    }

    fn places(&self) -> Result<Vec<Place>, TrainError> {
        let rows = self.rows.iter();
        rows.map(|row| Ok((self.number(row, 0)?, self.number(row, 1)?)))
            .collect()
    }

    fn values(&self, column: usize) -> Result<Vec<f64>, TrainError> {
        let rows = self.rows.iter();
        rows.map(|row| self.number(row, column)).collect()
    }
}

/// Writes `index.html` into the folder; returns its path.
///
/// # Errors
/// If a log is damaged or the file cannot be written.
pub(super) fn write(
    folder: &TrainingFolder,
    perceptual_network: Option<&'static str>,
    observer: &dyn Observer,
) -> Result<PathBuf, TrainError> {
    let root = folder.root();
    let log = Log::read(root.join("log.csv"))?;
    let places = log.places()?;
    // Number the steps of all stages consecutively.
    let steps: BTreeMap<Place, f64> = places.iter().copied().zip((1..).map(f64::from)).collect();
    let validation = Log::read(root.join("validation.csv"))?;
    let stages = stages(&Log::read(root.join("timing.csv"))?)?;
    let config = root.join("config.toml");
    let config_text = sharp::files::read_text(&config).map_err(FileError::new(&config, "read"))?;
    let mut tiles = vec![("steps", places.len().to_string())];
    if let Some(loss) = log.columns.iter().position(|column| column == "total") {
        let last = log.values(loss)?.last().copied();
        tiles.extend(last.map(|loss| ("last loss", format!("{loss:.4}"))));
    }
    let figures = [losses(&log, places.len())?, validated(&validation, &steps)?];
    let page = TrainPage {
        title: "A training",
        tiles,
        figures: figures.into_iter().flatten().collect(),
        stages,
        samples: samples(&folder.validation(), observer)?,
        perceptual_network,
        config: config_text,
    };
    let html = page.render().map_err(ReportError::from)?;
    let path = root.join("index.html");
    write_atomic(&path, visible(&html).as_bytes())?;
    Ok(path)
}

/// Plots the loss, each of its terms, the gradient norm and the learning rate, one panel each.
fn losses(log: &Log, count: usize) -> Result<Option<Figure>, TrainError> {
    if count == 0 {
        return Ok(None);
    }
    let places = (1..=count).map(|step| step as f64);
    let cuts = Binning::Round(STRETCHES).cuts(places.clone(), Some(0.0));
    let axis = PlotAxis::over(STEPS, 0.0, count as f64, 5);
    let mut panels = Vec::new();
    for (column, name) in log.columns.iter().enumerate().skip(2) {
        let samples: Vec<(f64, f64)> = places.clone().zip(log.values(column)?).collect();
        let curves: Vec<Banded> = bins(&samples, &cuts)
            .into_iter()
            .map(Banded::deviation)
            .collect();
        panels.push(Panel {
            frame: PanelFrame::new(
                name.replace('_', " "),
                "",
                axis.clone(),
                vertical(curves.iter(), &[], ""),
            ),
            content: Ok(Box::new(move |surface: &mut Surface, area: &PlotArea| {
                shade(surface, &curves, area, style(0));
                curve(surface, &curves, area, style(0));
            })),
        });
    }
    let caption = "Mean over each stretch of steps; shade: ± one sample standard deviation; \
                   hollow: a single step. Losses are shown before weighting, the gradient's norm \
                   before clipping; steps are counted across both stages.";
    let figure = figure("Losses", caption, &[], &panels, None);
    Ok(Some(figure.map_err(ReportError::from)?))
}

/// Plots validation scores, one panel per metric.
fn validated(log: &Log, steps: &BTreeMap<Place, f64>) -> Result<Option<Figure>, TrainError> {
    let mut measures: Vec<(&str, Vec<(f64, f64)>)> = Vec::new();
    let values = log.places()?.into_iter().zip(log.values(2)?);
    for ((place, value), row) in values.zip(&log.rows) {
        let name = row.get(3).unwrap_or_default();
        // A validation in a stage without steps has no position on the axis and is left out.
        let Some(step) = steps.get(&place) else {
            continue;
        };
        match measures.iter_mut().find(|(known, _)| *known == name) {
            Some((_, points)) => points.push((*step, value)),
            None => measures.push((name, vec![(*step, value)])),
        }
    }
    let panels: Vec<Panel<'_>> = measures
        .iter()
        .map(|(name, points)| {
            let values: Vec<f64> = points.iter().map(|(_, value)| *value).collect();
            Panel {
                frame: PanelFrame::new(
                    *name,
                    "",
                    PlotAxis::over(STEPS, 0.0, steps.len() as f64, 5),
                    vertical([].iter(), &values, ""),
                ),
                content: Ok(Box::new(move |surface: &mut Surface, area: &PlotArea| {
                    let place = |(x, y): &(f64, f64)| (area.x.place(*x), area.height(*y));
                    let line: Vec<_> = points.iter().map(place).collect();
                    if line.len() > 1 {
                        stroke(surface, &line, 2.0, style(0));
                    }
                    for at in line {
                        point(surface, at, style(0), false);
                    }
                })),
            }
        })
        .collect();
    if panels.is_empty() {
        return Ok(None);
    }
    let caption =
        "Mean over the pairs of validation-pairs.csv, none of which is used for training.";
    let figure = figure("Validation", caption, &[], &panels, None);
    Ok(Some(figure.map_err(ReportError::from)?))
}

/// One row per stage with at least one step: number of the stage, number of steps, median seconds
/// per step, and hours.
fn stages(log: &Log) -> Result<Vec<[String; 4]>, TrainError> {
    let mut seconds: BTreeMap<u64, Vec<f64>> = BTreeMap::new();
    for ((stage, _), taken) in log.places()?.into_iter().zip(log.values(2)?) {
        seconds.entry(stage).or_default().push(taken);
    }
    let rows = seconds.into_iter().map(|(stage, mut taken)| {
        let hours = taken.iter().sum::<f64>() / 3600.0;
        taken.sort_by(f64::total_cmp);
        let median = taken.get(taken.len() / 2).copied().unwrap_or_default();
        [
            stage.to_string(),
            taken.len().to_string(),
            format!("{median:.2}"),
            format!("{hours:.2}"),
        ]
    });
    Ok(rows.collect())
}

/// Sample pictures of the last validation; empty if there was no validation.
fn samples(run: &Path, observer: &dyn Observer) -> Result<Vec<Sample>, TrainError> {
    if !run.join("manifest.json").is_file() {
        return Ok(Vec::new());
    }
    let results = Results::read(run)?;
    let scenes = scenes(&results.manifest, observer);
    let pictures = ReportPictures::new(&results, &scenes);
    let shown = |picture: Result<image::RgbImage, MissingPicture>| {
        let small = picture.and_then(|picture| Thumbnail::new(&picture, SIDE));
        small
            .map(|small| small.address())
            .map_err(|missing| missing.to_string())
    };
    let samples = results.records.iter().take(SAMPLES).map(|record| Sample {
        pair: record.pair_id.clone(),
        pictures: [
            ("source", shown(pictures.source(record))),
            ("target", shown(pictures.target(record))),
            ("prediction", shown(pictures.prediction(record))),
        ],
    });
    Ok(samples.collect())
}
