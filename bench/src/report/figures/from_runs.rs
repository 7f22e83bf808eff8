//! Makes plots and sheets from results.

use std::path::PathBuf;

use sharp_datasets::Scene;
use sharp_metrics::MetricKey;

use super::choice::{PairsChoice, PathChoice, along_path, chosen};
use super::fidelity_time::SpeedSeconds;
use super::qualitative::SheetContent;
use super::sheet::Sheet;
use super::{failure, fidelity_time};
use crate::evaluate::Results;
use crate::report::board::Board;
use crate::report::column::Column;
use crate::report::error::ReportError;
use crate::report::pictures::ReportPictures;
use crate::report::plots;
use crate::scoring::Region;
use sharp_plots::Figure;
use sharp_plots::style::FigureStyle;

/// The parts of a sheet's pictures to enlarge.
#[derive(Debug, Clone, Default, clap::Args)]
pub struct SheetOptions {
    /// Part of the pictures to outline and enlarge, in pixels of the target; repeatable
    #[arg(long = "crop", value_name = "X,Y,W,H", value_parser = region)]
    pub crops: Vec<Region>,
}

fn region(text: &str) -> Result<Region, &'static str> {
    let numbers: Result<Vec<u32>, _> = text.split(',').map(|part| part.trim().parse()).collect();
    match numbers.as_deref() {
        Ok(&[x, y, width, height]) if width > 0 && height > 0 => Ok(Region {
            x,
            y,
            width,
            height,
        }),
        _ => Err("expected four whole numbers X,Y,WIDTH,HEIGHT, with width and height above zero"),
    }
}

/// Rows and columns of a sheet of pictures.
#[derive(Debug, Clone)]
pub enum SheetKind {
    /// Input, predictions and truth, one row per pair.
    Qualitative(PairsChoice),
    /// One row per method, one column per pair.
    Ablation(PairsChoice),
    /// Like `Ablation`, but with the targets of one source as columns, sorted by baseline.
    ExtendedMotion(PathChoice),
    /// Input, view and inverse depth of one method. Depth is read from the folder, if given; see
    /// [`failure::sheet`].
    Failure(PairsChoice, Option<PathBuf>),
}

impl SheetKind {
    /// Makes a sheet from results; `scenes` provide input and truth. Missing pictures are listed in its
    /// [problems](Sheet::problems).
    ///
    /// # Errors
    /// If a given pair or source is not in the results, or the results contradict each other.
    pub fn sheet(
        &self,
        shown: &SheetOptions,
        results: &Results,
        scenes: &[Scene],
    ) -> Result<Sheet, ReportError> {
        let pictures = ReportPictures::new(results, scenes);
        let board = Board::of(results)?;
        let pairs = match self {
            Self::ExtendedMotion(path) => along_path(&board, path)?,
            Self::Qualitative(pairs) | Self::Ablation(pairs) | Self::Failure(pairs, _) => {
                chosen(&board, &board.metrics, pairs)?
            }
        };
        let content = SheetContent {
            pairs,
            methods: board.plotted().collect(),
            board: &board,
            metrics: &board.metrics,
            pictures: &pictures,
            crops: shown.crops.clone(),
        };
        Ok(match self {
            Self::Qualitative(_) => content.pairs_as_rows(),
            Self::Ablation(_) => content.pairs_as_columns(false),
            Self::ExtendedMotion(_) => content.pairs_as_columns(true),
            Self::Failure(_, depth) => failure::sheet(&content, depth.as_deref())?,
        })
    }
}

/// Histogram of pairs by camera baseline; `None` if there are no pairs.
///
/// # Errors
/// If the results contradict each other, or the style has no room for a plot.
pub fn baselines(results: &Results, style: &FigureStyle) -> Result<Option<Figure>, ReportError> {
    let board = Board::of(results)?;
    Ok(plots::histogram(&board, Some(style))?)
}

/// Plots a metric against seconds per pair. Times measured by `speed` replace those of the runs for the methods that
/// `speed` measured. `None` if no method has both a score and a time.
///
/// # Errors
/// If the results contradict each other, the style has no room for a plot, the metric does not exist, or a folder
/// cannot be read.
pub fn fidelity_time(
    results: &Results,
    metric: MetricKey,
    speed: &SpeedSeconds,
    style: &FigureStyle,
) -> Result<Option<Figure>, ReportError> {
    let board = Board::of(results)?;
    let metric = Column::chosen(&board.metrics, &[metric])?.remove(0);
    let seconds = fidelity_time::seconds(results)?;
    Ok(fidelity_time::figure(
        &board, &metric, &seconds, speed, style,
    )?)
}
