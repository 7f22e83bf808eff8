//! Selects the pairs of the page and encodes their pictures within a byte budget.

use std::collections::BTreeMap;

use image::{GrayImage, RgbImage};
use rayon::prelude::*;

use crate::evaluate::record::{Crop, Record, Status};
use crate::io::hash::sha256_hex;

use super::board::{Board, PairBoard};
use super::choice::{badness, choose};
use super::column::Column;
use super::error::MissingPicture;
use super::options::{Layout, PictureBudget, ReportOptions};
use super::pictures::{ReportPictures, Thumbnail};
use super::{error_map, view_maps};

/// Maximum number of pairs in a single-file page: half have the worst scores, the others are spread evenly.
pub(super) const PAIRS_IN_FILE: usize = 24;
/// Absolute error (0..1, mean over the channels) at the top of the error maps' colour scale.
pub(super) const ERROR_MAX: f32 = 0.5;
/// Change of the absolute error (0..1) at the ends of its colour scale, which reaches from minus to plus this value.
pub(super) const CHANGE_MAX: f32 = 0.2;
/// Minimum longer side of pictures in a single-file page, in pixels. To save space, the page shows fewer pairs rather
/// than smaller pictures.
const MIN_SIDE: u32 = 240;
/// Minimum longer side of pictures in a folder, in pixels. It is smaller than [`MIN_SIDE`], because a folder must show
/// all pairs.
const MIN_SIDE_IN_FOLDER: u32 = 96;
/// Number of pairs per dataset that are encoded to estimate the size of all pictures.
const PROBES: usize = 5;
/// Sizes of pictures are chosen to fill this share of the byte budget. The rest is a margin, because file sizes are
/// estimates.
const TARGET_FILL: f64 = 0.9;

/// Kind of a pair's picture: first the kinds that show a view, then those that show a prediction.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub enum PictureKind {
    Source,
    Target,
    /// The target, hatched at pixels that are not scored.
    Mask,
    /// Inverse depth of the target in colour; [`Self::SourceDepth`] is that of the source.
    Depth,
    SourceDepth,
    Prediction,
    Error,
    /// Change of the error relative to the compared method.
    Change,
    /// Coverage of a rendering, black to white.
    Alpha,
}

impl PictureKind {
    /// Name in the page's data and in file names.
    pub(super) fn name(self) -> &'static str {
        match self {
            Self::Source => "source",
            Self::Target => "target",
            Self::Mask => "mask",
            Self::Depth => "depth",
            Self::SourceDepth => "source-depth",
            Self::Prediction => "prediction",
            Self::Error => "error",
            Self::Change => "change",
            Self::Alpha => "alpha",
        }
    }
}

/// Pictures by kind, or the reasons why they are missing. Kinds that do not apply are left out.
pub type Pictures = BTreeMap<PictureKind, Result<Thumbnail, MissingPicture>>;

#[derive(Debug)]
pub struct Gallery<'a> {
    pub layout: Layout,
    /// Pairs, sorted by dataset as in the board, then by id.
    pub pairs: Vec<GalleryPair<'a>>,
    /// Number of pairs in the run, including those that are not shown.
    pub of: usize,
    /// Longest side of the pictures, in pixels.
    pub side: u32,
}

#[derive(Debug)]
pub struct GalleryPair<'a> {
    /// Index of the pair's dataset in the board.
    pub dataset: usize,
    pub pair: &'a PairBoard<'a>,
    /// Pictures of the two views.
    pub views: Pictures,
    /// Pictures of the predictions, by method; `None` if the method has no record of this pair.
    pub methods: Vec<Option<GalleryPrediction<'a>>>,
}

#[derive(Debug)]
pub struct GalleryPrediction<'a> {
    pub record: &'a Record,
    pub pictures: Pictures,
}

impl GalleryPair<'_> {
    /// Pictures of the pair's views and predictions.
    fn all_pictures(&self) -> impl Iterator<Item = &Pictures> {
        let methods = self.methods.iter().flatten();
        std::iter::once(&self.views).chain(methods.map(|shown| &shown.pictures))
    }

    fn pictures(&self) -> impl Iterator<Item = &Thumbnail> {
        self.all_pictures().flat_map(Pictures::values).flatten()
    }

    fn bytes(&self, layout: Layout) -> usize {
        let bytes: usize = self.pictures().map(|picture| picture.jpeg.len()).sum();
        match layout {
            // Base64 encodes three bytes as four characters.
            Layout::File => bytes.div_ceil(3) * 4,
            Layout::Folder => bytes,
        }
    }
}

impl<'a> Gallery<'a> {
    /// Selects pairs and encodes their pictures, reduced to a size at which they probably fit the budget. If a
    /// single-file page still exceeds the budget, drops pairs from its end.
    pub fn new(
        board: &'a Board<'a>,
        metrics: &[Column],
        options: &ReportOptions,
        pictures: &ReportPictures<'_>,
    ) -> Self {
        let of = board.datasets.iter().map(|d| d.pairs.len()).sum();
        let layout = options.layout.unwrap_or(match of {
            0..=PAIRS_IN_FILE => Layout::File,
            _ => Layout::Folder,
        });
        let limit = match layout {
            Layout::File => PAIRS_IN_FILE,
            Layout::Folder => usize::MAX,
        };
        let chosen = match &options.comparison {
            None => choose(board, limit, true, |pair| badness(board, pair, metrics)),
            Some(comparison) => choose(board, limit, false, |pair| {
                let losses = comparison.losses.get(&pair.facts.pair_id);
                let mut losses = metrics.iter().map(|metric| losses?.get(&metric.key));
                losses.find_map(|loss| loss.copied()).unwrap_or(0.0)
            }),
        };
        let budget = options.pictures.unwrap_or(layout.budget());
        let load = |(dataset, pair), side| load(dataset, pair, board, options, pictures, side);
        let side = side(&chosen, layout, budget, &load);
        let mut pairs: Vec<GalleryPair<'a>> = chosen
            .into_par_iter()
            .map(|pair| load(pair, side))
            .collect();
        if layout == Layout::File {
            let mut used = 0;
            let fitting = pairs.iter().take_while(|pair| {
                used += pair.bytes(layout);
                used <= budget.bytes
            });
            let fitting = fitting.count();
            pairs.truncate(fitting);
        }
        Self {
            layout,
            pairs,
            of,
            side,
        }
    }

    /// Whether any pair has a picture of the kind `kind`.
    pub(super) fn has(&self, kind: PictureKind) -> bool {
        let mut pictures = self.pairs.iter().flat_map(GalleryPair::all_pictures);
        pictures.any(|pictures| matches!(pictures.get(&kind), Some(Ok(_))))
    }

    /// Names and contents of the picture files next to the page.
    pub(super) fn files(&self) -> BTreeMap<String, &[u8]> {
        if self.layout == Layout::File {
            return BTreeMap::new();
        }
        let pictures = self.pairs.iter().flat_map(GalleryPair::pictures);
        let files = pictures.map(|picture| (file_name(picture), picture.jpeg.as_slice()));
        files.collect()
    }
}

/// Path of a picture relative to the page. Pairs that share a view share its file.
pub(super) fn file_name(picture: &Thumbnail) -> String {
    format!("{THUMBNAILS}/{}.jpg", &sha256_hex(&picture.jpeg)[..16])
}

/// The folder of pictures next to the page.
pub(super) const THUMBNAILS: &str = "thumbs";

/// The longest side at which all pictures are likely to fit the budget, estimated by encoding a few pairs of each
/// dataset. File sizes are only roughly proportional to the area, so the estimate is corrected twice.
fn side<'a>(
    chosen: &[(usize, &'a PairBoard<'a>)],
    layout: Layout,
    budget: PictureBudget,
    load: &(impl Fn((usize, &'a PairBoard<'a>), u32) -> GalleryPair<'a> + Sync),
) -> u32 {
    let least = match layout {
        Layout::File => MIN_SIDE,
        Layout::Folder => MIN_SIDE_IN_FOLDER,
    };
    // Each probe is weighted by the number of pairs that it represents.
    let probes: Vec<_> = chosen
        .chunk_by(|a, b| a.0 == b.0)
        .flat_map(|pairs| {
            let count = pairs.len().min(PROBES);
            let share = pairs.len() as f64 / count as f64;
            let each = (0..count).map(move |i| (2 * i + 1) * pairs.len() / (2 * count));
            each.map(move |at| (pairs[at], share))
        })
        .collect();
    let mut side = MIN_SIDE.min(budget.side).max(1);
    for _ in 0..3 {
        let probes = probes.par_iter();
        let bytes: Vec<f64> = probes
            .map(|(pair, share)| share * load(*pair, side).bytes(layout) as f64)
            .collect();
        let needed = bytes.iter().sum::<f64>().max(1.0);
        let fitting = f64::from(side) * (TARGET_FILL * budget.bytes as f64 / needed).sqrt();
        let before = side;
        // `as` saturates: a value out of range becomes the nearest u32.
        side = (fitting as u32).max(least).min(budget.side).max(1);
        if side == before {
            break;
        }
    }
    side
}

/// Index of the method that the report compares with method number `method`; `None` if there is none.
pub(super) fn against(options: &ReportOptions, board: &Board<'_>, method: usize) -> Option<usize> {
    let label = &board.methods.get(method)?.label;
    let mut against = options.comparison.as_ref()?.against.iter();
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
    options: &ReportOptions,
    pictures: &ReportPictures<'_>,
    side: u32,
) -> GalleryPair<'a> {
    let small = |picture: &RgbImage| Thumbnail::new(picture, side);
    let target = pictures.target(pair.facts);
    let valid = pictures.valid_pixels(pair.facts);
    let mut views = Pictures::new();
    let source = pictures.source(pair.facts);
    views.insert(
        PictureKind::Source,
        source.and_then(|picture| small(&picture)),
    );
    let shown = target.as_ref().map_err(Clone::clone);
    views.insert(PictureKind::Target, shown.and_then(small));
    if let (Ok(target), Ok(Some(valid))) = (&target, &valid) {
        let scored = |x, y| is_scored(None, Some(valid), (x, y));
        let drawn = view_maps::masked(target, scored);
        views.insert(PictureKind::Mask, small(&drawn));
    }
    for (kind, depth) in [
        (
            PictureKind::Depth,
            pictures.depth(pair.facts, &pair.facts.target),
        ),
        (
            PictureKind::SourceDepth,
            pictures.depth(pair.facts, &pair.facts.source),
        ),
    ] {
        if let Some(depth) = depth.transpose() {
            let drawn = depth.map(|depth| view_maps::inverse_depth(&depth, side));
            views.insert(kind, drawn.and_then(|picture| small(&picture)));
        }
    }
    let prediction = |record: &Record| match &record.status {
        Status::Failed { reason } => Err(MissingPicture::Failed(reason.clone())),
        Status::Ok => pictures.prediction(record),
    };
    let of_methods = pair.by_method.iter();
    let predictions: Vec<_> = of_methods.map(|record| record.map(prediction)).collect();
    let predicted = |at: usize| match predictions.get(at) {
        Some(Some(Ok(prediction))) => Ok(prediction),
        Some(Some(Err(MissingPicture::NotPublic))) => Err(MissingPicture::NotPublic),
        _ => Err(MissingPicture::Without("prediction")),
    };
    let truth = match (&target, &valid) {
        (Err(MissingPicture::NotPublic), _) => Err(MissingPicture::NotPublic),
        (Err(_), _) => Err(MissingPicture::Without("target")),
        (_, Err(reason)) => Err(reason.clone()),
        (Ok(target), Ok(valid)) => Ok((target, valid.as_ref())),
    };
    let error = |at: usize, crop: Option<Crop>| {
        let (prediction, (target, valid)) = (predicted(at)?, truth.clone()?);
        let scored = |x, y| is_scored(crop, valid, (x, y));
        let drawn = error_map::picture(prediction, target, scored, ERROR_MAX, side)?;
        small(&drawn)
    };
    let change = |other: usize, at: usize, crop: Option<Crop>| {
        let sides = [predicted(other)?, predicted(at)?];
        let (target, valid) = truth.clone()?;
        let scored = |x, y| is_scored(crop, valid, (x, y));
        let drawn = error_map::change(sides, target, scored, CHANGE_MAX, side)?;
        small(&drawn)
    };
    let shown = |(at, record): (usize, &Option<&'a Record>)| {
        let record = (*record)?;
        let prediction = match &predictions[at] {
            Some(Err(reason)) => Err(reason.clone()),
            _ => predicted(at).and_then(small),
        };
        let mut shown = Pictures::from([
            (PictureKind::Prediction, prediction),
            (PictureKind::Error, error(at, record.crop)),
        ]);
        if let Some(other) = against(options, board, at) {
            shown.insert(PictureKind::Change, change(other, at, record.crop));
        }
        if let Some(alpha) = pictures.alpha(record).transpose() {
            let drawn = alpha.map(|alpha| view_maps::coverage(&alpha));
            shown.insert(
                PictureKind::Alpha,
                drawn.and_then(|picture| small(&picture)),
            );
        }
        Some(GalleryPrediction {
            record,
            pictures: shown,
        })
    };
    GalleryPair {
        dataset,
        pair,
        methods: pair.by_method.iter().enumerate().map(shown).collect(),
        views,
    }
}

/// Whether a pixel is scored: inside the scored crop and not excluded by the dataset.
fn is_scored(crop: Option<Crop>, valid: Option<&GrayImage>, (x, y): (u32, u32)) -> bool {
    let in_crop = crop.is_none_or(|Crop { region, .. }| {
        let inside = |at: u32, start: u32, length: u32| at >= start && at - start < length;
        inside(x, region.x, region.width) && inside(y, region.y, region.height)
    });
    let level = |valid: &GrayImage| valid.get_pixel_checked(x, y).map(|level| level.0[0]);
    in_crop && valid.is_none_or(|valid| level(valid) == Some(255))
}
