//! Which pairs the page shows, and their pictures, within a number of bytes.

use std::borrow::Cow;

use image::{RgbImage, imageops};
use rayon::prelude::*;

use crate::evaluate::record::{Record, Status};
use crate::scoring::Region;

use super::error_map;
use super::input::{Better, Metric, Options, Pictures};
use super::pictures::{Inlined, inlined};
use super::records::{Board, PairBoard};
use super::summary;

/// A picture, or why there is none.
pub type Shown = Result<Inlined, String>;

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
    /// Its records.
    pub pair: &'a PairBoard<'a>,
    /// The photograph that methods were given.
    pub source: Shown,
    /// What they should have predicted.
    pub target: Shown,
    /// Prediction and error by method; `None`: the method has no record of this pair.
    pub methods: Vec<Option<(Shown, Shown)>>,
}

impl GalleryPair<'_> {
    fn bytes(&self) -> usize {
        let size = |shown: &Shown| shown.as_ref().map_or(0, |p| p.uri.len());
        let predictions: usize = self
            .methods
            .iter()
            .flatten()
            .map(|(prediction, error)| size(prediction) + size(error))
            .sum();
        size(&self.source) + size(&self.target) + predictions
    }
}

/// Pictures smaller than this help nobody; rather fewer pairs are shown.
const MIN_SIDE: u32 = 240;
/// Measured on photographs at the quality used: bytes per pixel, as text.
const BYTES_PER_PIXEL: f64 = 0.5;

impl<'a> Gallery<'a> {
    /// Picks pairs, reduces and encodes their pictures. The longest side is chosen so that all of them are likely
    /// to fit; should they not, pairs at the end are left out.
    pub fn new(
        board: &'a Board<'a>,
        metrics: &[Metric],
        pictures: &dyn Pictures,
        options: &Options,
    ) -> Self {
        let chosen = choose(board, metrics, options.gallery_pairs);
        let count = chosen.len() * (2 + 2 * board.methods.len());
        let area = options.picture_bytes as f64 / BYTES_PER_PIXEL / count.max(1) as f64;
        // Photographs are about 4:3.
        let side = ((area / 0.75).sqrt() as u32)
            .max(MIN_SIDE)
            .min(options.picture_side)
            .max(1);
        let mut pairs: Vec<GalleryPair<'a>> = chosen
            .into_par_iter()
            .map(|pair| load(pair, pictures, options.error_max, side))
            .collect();
        let mut used = 0;
        let fitting = pairs
            .iter()
            .take_while(|pair| {
                used += pair.bytes();
                used <= options.picture_bytes
            })
            .count();
        pairs.truncate(fitting);
        Self {
            pairs,
            of: board.datasets.iter().map(|d| d.pairs.len()).sum(),
            side,
        }
    }
}

fn load<'a>(
    pair: &'a PairBoard<'a>,
    pictures: &dyn Pictures,
    error_max: f32,
    side: u32,
) -> GalleryPair<'a> {
    let target = pictures.target(pair.facts);
    let methods = pair
        .by_method
        .iter()
        .map(|record| {
            let record: &Record = (*record)?;
            if let Status::Failed { reason } = &record.status {
                return Some((
                    Err(format!("failed: {reason}")),
                    Err("no prediction".into()),
                ));
            }
            let prediction = match pictures.prediction(record) {
                Ok(prediction) => prediction,
                Err(reason) => return Some((Err(reason), Err("no prediction".into()))),
            };
            let error = match &target {
                Ok(target) => {
                    let truth = truth_of(record, &prediction, target);
                    error_map::picture(&prediction, &truth, error_max, side)
                        .and_then(|picture| inlined(&picture, side))
                }
                Err(_) => Err("no target".into()),
            };
            Some((inlined(&prediction, side), error))
        })
        .collect();
    GalleryPair {
        pair,
        source: pictures.source(pair.facts).and_then(|p| inlined(&p, side)),
        target: target.and_then(|p| inlined(&p, side)),
        methods,
    }
}

/// The target as a prediction is compared with it: outside the crop that it was scored on, the prediction's own padding,
/// which is no error.
fn truth_of<'a>(record: &Record, prediction: &RgbImage, target: &'a RgbImage) -> Cow<'a, RgbImage> {
    let Some(crop) = record.crop else {
        return Cow::Borrowed(target);
    };
    let Region {
        x,
        y,
        width,
        height,
    } = crop.region;
    let mut truth = prediction.clone();
    let cropped = imageops::crop_imm(target, x, y, width, height).to_image();
    imageops::replace(&mut truth, &cropped, i64::from(x), i64::from(y));
    Cow::Owned(truth)
}

/// At most `limit` pairs, the same number from each dataset as far as they have them; from each, first half of
/// the share by the worst mean score of the ranked methods, then evenly through the rest.
fn choose<'a>(board: &'a Board<'a>, metrics: &[Metric], limit: usize) -> Vec<&'a PairBoard<'a>> {
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
    for (share, dataset) in shares.into_iter().zip(&board.datasets) {
        if share == dataset.pairs.len() {
            chosen.extend(&dataset.pairs);
            continue;
        }
        let worst_first = by_badness(board, &dataset.pairs, metrics);
        let worst = share.div_ceil(2);
        let rest = worst_first.len() - worst;
        let spread = share - worst;
        let evenly = (0..spread).map(|i| worst + (2 * i + 1) * rest / (2 * spread));
        let mut picked: Vec<&PairBoard<'a>> = (0..worst)
            .chain(evenly)
            .filter_map(|i| worst_first.get(i).copied())
            .collect();
        picked.sort_by(|a, b| a.facts.pair_id.cmp(&b.facts.pair_id));
        chosen.extend(picked);
    }
    chosen
}

/// The pairs of a dataset, those with the worst scores first; equally bad ones in the order of their ids.
pub(super) fn by_badness<'a>(
    board: &Board<'a>,
    pairs: &'a [PairBoard<'a>],
    metrics: &[Metric],
) -> Vec<&'a PairBoard<'a>> {
    let mut order: Vec<(&PairBoard<'a>, f64)> = pairs
        .iter()
        .map(|pair| (pair, badness(board, pair, metrics)))
        .collect();
    order.sort_by(|a, b| b.1.total_cmp(&a.1));
    order.into_iter().map(|(pair, _)| pair).collect()
}

/// Mean over the ranked methods of the first metric that has finite numbers, larger meaning worse.
fn badness(board: &Board<'_>, pair: &PairBoard<'_>, metrics: &[Metric]) -> f64 {
    for metric in metrics {
        let sign = match metric.better {
            Better::Higher => -1.0,
            Better::Lower => 1.0,
            Better::Neither => continue,
        };
        let values: Vec<f64> = pair
            .by_method
            .iter()
            .zip(&board.methods)
            .filter(|(_, method)| method.unranked.is_none())
            .filter_map(|(record, _)| (*record)?.scores.get(&metric.key)?.value())
            .filter(|v| v.is_finite())
            .collect();
        if let Some(mean) = summary::mean(&values) {
            return sign * mean;
        }
    }
    0.0
}
