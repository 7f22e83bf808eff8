//! Which pairs the page shows, and their pictures, within a number of bytes.

use image::{GrayImage, RgbImage};
use rayon::prelude::*;
use sharp_metrics::Direction;

use crate::evaluate::record::{Crop, Record, Status};

use super::board::{Board, PairBoard};
use super::error::MissingPicture;
use super::error_map;
use super::input::{Column, ReportInput};
use super::pictures::InlinePicture;
use super::statistics;

/// Pairs at most: half of them those with the worst scores, the others spread evenly.
const PAIRS: usize = 24;
/// Absolute error (0..1, mean over the channels) at the top of the error maps' colour scale.
pub(super) const ERROR_MAX: f32 = 0.5;
/// Change of the absolute error at both ends of its scale.
pub(super) const CHANGE_MAX: f32 = 0.2;
/// Nothing can be told from smaller pictures; fewer pairs are shown instead.
const MIN_SIDE: u32 = 240;
/// Measured on photographs at the quality used: bytes per pixel, as text.
const BYTES_PER_PIXEL: f64 = 0.5;

type Inlined = Result<InlinePicture, MissingPicture>;

/// The pairs shown.
#[derive(Debug)]
pub struct Gallery<'a> {
    /// By dataset as in the board, then by id.
    pub pairs: Vec<GalleryPair<'a>>,
    /// Pairs of the run.
    pub of: usize,
    /// Longest side of the pictures, pixels.
    pub side: u32,
}

/// A pair with its pictures.
#[derive(Debug)]
pub struct GalleryPair<'a> {
    /// Position of its dataset in the board.
    pub dataset: usize,
    pub pair: &'a PairBoard<'a>,
    pub source: Inlined,
    pub target: Inlined,
    /// By method; `None`: the method has no record of this pair.
    pub methods: Vec<Option<GalleryPrediction<'a>>>,
}

/// A method's prediction of a pair.
#[derive(Debug)]
pub struct GalleryPrediction<'a> {
    pub record: &'a Record,
    pub prediction: Inlined,
    pub error: Inlined,
    /// How the error changed against the method that it stands against, if any.
    pub change: Option<Inlined>,
}

impl GalleryPair<'_> {
    fn bytes(&self) -> usize {
        let methods = self.methods.iter().flatten();
        let pictures = methods.flat_map(|shown| {
            let own = [&shown.prediction, &shown.error];
            own.into_iter().chain(&shown.change)
        });
        let all = pictures.chain([&self.source, &self.target]).flatten();
        all.map(|picture| picture.uri.len()).sum()
    }
}

impl<'a> Gallery<'a> {
    /// Picks pairs, reduces and encodes their pictures. The longest side is chosen so that all of them are likely
    /// to fit; should they not, pairs at the end are left out.
    pub fn new(board: &'a Board<'a>, metrics: &[Column], input: &ReportInput<'_>) -> Self {
        let options = &input.options;
        let chosen = match &input.comparison {
            None => choose(board, PAIRS, true, |pair| badness(board, pair, metrics)),
            Some(comparison) => choose(board, PAIRS, false, |pair| {
                let losses = comparison.losses.get(&pair.facts.pair_id);
                let mut losses = metrics.iter().map(|metric| losses?.get(&metric.key));
                losses.find_map(|loss| loss.copied()).unwrap_or(0.0)
            }),
        };
        let changes = input
            .comparison
            .iter()
            .map(|comparison| comparison.against.len());
        let count = chosen.len() * (2 + 2 * board.methods.len() + changes.sum::<usize>());
        let area = options.picture_bytes as f64 / BYTES_PER_PIXEL / count.max(1) as f64;
        // Photographs are about 4:3.
        let side = ((area / 0.75).sqrt() as u32)
            .max(MIN_SIDE)
            .min(options.picture_side)
            .max(1);
        let mut pairs: Vec<GalleryPair<'a>> = chosen
            .into_par_iter()
            .map(|(dataset, pair)| load(dataset, pair, board, input, side))
            .collect();
        let mut used = 0;
        let fitting = pairs.iter().take_while(|pair| {
            used += pair.bytes();
            used <= options.picture_bytes
        });
        let fitting = fitting.count();
        pairs.truncate(fitting);
        Self {
            pairs,
            of: board.datasets.iter().map(|d| d.pairs.len()).sum(),
            side,
        }
    }
}

/// Position of the method that a method stands against.
pub(super) fn against(input: &ReportInput<'_>, board: &Board<'_>, method: usize) -> Option<usize> {
    let label = &board.methods.get(method)?.label;
    let mut against = input.comparison.as_ref()?.against.iter();
    let [other, _] = against.find(|[_, b]| b == label)?;
    board
        .methods
        .iter()
        .position(|method| method.label == *other)
}

fn load<'a>(
    dataset: usize,
    pair: &'a PairBoard<'a>,
    board: &Board<'_>,
    input: &ReportInput<'_>,
    side: u32,
) -> GalleryPair<'a> {
    let pictures = input.pictures;
    let inline = |picture: &RgbImage| InlinePicture::new(picture, side);
    let target = pictures.target(pair.facts);
    let valid = pictures.valid_pixels(pair.facts);
    let prediction = |record: &Record| match &record.status {
        Status::Failed { reason } => Err(MissingPicture::Failed(reason.clone())),
        Status::Ok => pictures.prediction(record),
    };
    let of_methods = pair.by_method.iter();
    let predictions: Vec<_> = of_methods.map(|record| record.map(prediction)).collect();
    let predicted = |at: usize| match predictions.get(at) {
        Some(Some(Ok(prediction))) => Ok(prediction),
        _ => Err(MissingPicture::Without("prediction")),
    };
    let truth = match (&target, &valid) {
        (Err(_), _) => Err(MissingPicture::Without("target")),
        (_, Err(reason)) => Err(reason.clone()),
        (Ok(target), Ok(valid)) => Ok((target, valid.as_ref())),
    };
    let error = |at: usize, crop: Option<Crop>| {
        let (prediction, (target, valid)) = (predicted(at)?, truth.clone()?);
        let scored = |x, y| is_scored(crop, valid, (x, y));
        let drawn = error_map::picture(prediction, target, scored, ERROR_MAX, side)?;
        inline(&drawn)
    };
    let change = |other: usize, at: usize, crop: Option<Crop>| {
        let sides = [predicted(other)?, predicted(at)?];
        let (target, valid) = truth.clone()?;
        let scored = |x, y| is_scored(crop, valid, (x, y));
        let drawn = error_map::change(sides, target, scored, CHANGE_MAX, side)?;
        inline(&drawn)
    };
    let shown = |(at, record): (usize, &Option<&'a Record>)| {
        let record = (*record)?;
        let prediction = predicted(at).and_then(inline);
        Some(GalleryPrediction {
            record,
            prediction: match &predictions[at] {
                Some(Err(reason)) => Err(reason.clone()),
                _ => prediction,
            },
            error: error(at, record.crop),
            change: against(input, board, at).map(|other| change(other, at, record.crop)),
        })
    };
    GalleryPair {
        dataset,
        pair,
        source: pictures.source(pair.facts).and_then(|p| inline(&p)),
        methods: pair.by_method.iter().enumerate().map(shown).collect(),
        target: target.as_ref().map_err(Clone::clone).and_then(inline),
    }
}

/// The rule of the scores: inside the crop that was scored, and not excluded by the dataset.
fn is_scored(crop: Option<Crop>, valid: Option<&GrayImage>, (x, y): (u32, u32)) -> bool {
    let in_crop = crop.is_none_or(|Crop { region, .. }| {
        let inside = |at: u32, start: u32, length: u32| at >= start && at - start < length;
        inside(x, region.x, region.width) && inside(y, region.y, region.height)
    });
    let level = |valid: &GrayImage| valid.get_pixel_checked(x, y).map(|level| level.0[0]);
    in_crop && valid.is_none_or(|valid| level(valid) == Some(255))
}

/// At most `limit` pairs with the positions of their datasets: the same number from each dataset as far as they have
/// them; from each, first half of the share by the largest `badness`, then the others: evenly through the rest, or those
/// of the least.
fn choose<'a>(
    board: &'a Board<'a>,
    limit: usize,
    evenly: bool,
    badness: impl Fn(&PairBoard<'a>) -> f64,
) -> Vec<(usize, &'a PairBoard<'a>)> {
    let mut shares = vec![0; board.datasets.len()];
    let mut left = limit;
    while left > 0 {
        let mut given = 0;
        for (share, dataset) in shares.iter_mut().zip(&board.datasets) {
            if *share < dataset.pairs.len() && given < left {
                *share += 1;
                given += 1;
            }
        }
        if given == 0 {
            break;
        }
        left -= given;
    }
    let mut chosen = Vec::new();
    for (d, (share, dataset)) in shares.into_iter().zip(&board.datasets).enumerate() {
        if share == dataset.pairs.len() {
            chosen.extend(dataset.pairs.iter().map(|pair| (d, pair)));
            continue;
        }
        let worst_first = worst_first(&dataset.pairs, &badness);
        let worst = share.div_ceil(2);
        let rest = worst_first.len() - worst;
        let others = share - worst;
        let other = |i: usize| match evenly {
            true => worst + (2 * i + 1) * rest / (2 * others),
            false => worst_first.len() - others + i,
        };
        let mut picked: Vec<&PairBoard<'a>> = (0..worst)
            .chain((0..others).map(other))
            .filter_map(|i| worst_first.get(i).copied())
            .collect();
        picked.sort_by(|a, b| a.facts.pair_id.cmp(&b.facts.pair_id));
        chosen.extend(picked.into_iter().map(|pair| (d, pair)));
    }
    chosen
}

/// The pairs of a dataset, those with the worst scores first; equally bad ones in the order of their ids.
pub(super) fn by_badness<'a>(
    board: &Board<'a>,
    pairs: &'a [PairBoard<'a>],
    metrics: &[Column],
) -> Vec<&'a PairBoard<'a>> {
    worst_first(pairs, &|pair| badness(board, pair, metrics))
}

fn worst_first<'a>(
    pairs: &'a [PairBoard<'a>],
    badness: &dyn Fn(&PairBoard<'a>) -> f64,
) -> Vec<&'a PairBoard<'a>> {
    let order = pairs.iter().map(|pair| (pair, badness(pair)));
    let mut order: Vec<(&PairBoard<'a>, f64)> = order.collect();
    order.sort_by(|a, b| b.1.total_cmp(&a.1));
    order.into_iter().map(|(pair, _)| pair).collect()
}

/// Mean over the ranked methods of the first metric that has finite numbers, larger meaning worse.
fn badness(board: &Board<'_>, pair: &PairBoard<'_>, metrics: &[Column]) -> f64 {
    let mean_of = |metric: &Column| {
        let sign = match metric.direction? {
            Direction::Higher => -1.0,
            Direction::Lower => 1.0,
        };
        let records = pair.by_method.iter().zip(&board.methods);
        let ranked = records.filter(|(_, method)| method.unranked.is_none());
        let values: Vec<f64> = ranked
            .filter_map(|(record, _)| (*record)?.scores.get(&metric.key)?.value())
            .filter(|v| v.is_finite())
            .collect();
        Some(sign * statistics::mean(&values)?)
    };
    metrics.iter().find_map(mean_of).unwrap_or(0.0)
}
