//! Plots and sheets from results.

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

/// Contents of a sheet for its pairs.
#[derive(Debug, Clone, Default, clap::Args)]
pub struct SheetOptions {
    /// Methods to show, in this order; all that are ranked without it
    #[arg(long = "method", value_name = "METHOD")]
    pub methods: Vec<String>,
    /// Metrics whose scores stand below predictions, comma-separated; the first one decides what is worst; all without it
    #[arg(long, value_name = "LIST", value_delimiter = ',')]
    pub metrics: Vec<MetricKey>,
    /// A part that is framed and enlarged, pixels of the target; repeatable
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
        _ => Err("four whole numbers, X,Y,WIDTH,HEIGHT"),
    }
}

/// Rows and columns of a sheet of pictures.
#[derive(Debug, Clone)]
pub enum SheetKind {
    /// Input, predictions and truth, a row a pair.
    Qualitative(PairsChoice),
    /// A row a method, a column a pair.
    Ablation(PairsChoice),
    /// The same of one source's targets, by growing baseline.
    ExtendedMotion(PathChoice),
    /// Input, view and inverse depth of one method; depth from a folder, or without one the rendering's.
    Failure(PairsChoice, Option<PathBuf>),
}

impl SheetKind {
    /// The sheet of some results, whose scenes give input and truth. Pictures that are not there are among its
    /// [problems](Sheet::problems).
    ///
    /// # Errors
    /// When something that was named is not in the results, or the results contradict each other.
    pub fn sheet(
        &self,
        shown: &SheetOptions,
        results: &Results,
        scenes: &[Scene],
    ) -> Result<Sheet, ReportError> {
        let pictures = ReportPictures::new(results, scenes);
        let board = Board::of(results)?;
        let metrics = Column::chosen(&board.metrics, &shown.metrics)?;
        let pairs = match self {
            Self::ExtendedMotion(path) => along_path(&board, path)?,
            Self::Qualitative(pairs) | Self::Ablation(pairs) | Self::Failure(pairs, _) => {
                chosen(&board, &metrics, pairs)?
            }
        };
        let content = SheetContent {
            pairs,
            methods: methods(&board, &shown.methods)?,
            board: &board,
            metrics: &metrics,
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

/// Positions of the methods of these names, of all that are ranked without names.
fn methods(board: &Board<'_>, names: &[String]) -> Result<Vec<usize>, ReportError> {
    let labels = || board.methods.iter().map(|method| method.label.as_str());
    if names.is_empty() {
        return Ok(board.ranked().collect());
    }
    let of_name = |name: &String| {
        let found = labels().position(|label| label == name);
        found.ok_or_else(|| ReportError::absent("method", name, labels()))
    };
    names.iter().map(of_name).collect()
}

/// Pairs by camera baseline; `None` without a pair.
///
/// # Errors
/// When the results contradict each other, or the style has no room for a plot.
pub fn baselines(results: &Results, style: &FigureStyle) -> Result<Option<Figure>, ReportError> {
    let board = Board::of(results)?;
    Ok(plots::histogram(&board, Some(style))?)
}

/// A metric against seconds per pair, from `speed` where it measured the method; `None` if no method has both.
///
/// # Errors
/// As [`baselines`](baselines()), and when there is no such metric or a folder cannot be read.
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
