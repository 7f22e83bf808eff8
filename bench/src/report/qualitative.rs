//! A figure as papers have it: a row per dataset, with source, target and the predictions of the ranked methods
//! side by side.

use image::{Rgb, RgbImage, imageops};

use crate::evaluate::record::Status;

use super::board::{Board, PairBoard};
use super::error::{MissingPicture, ReportError};
use super::gallery::by_badness;
use super::input::Column;
use super::pictures::{ReportPictures, reduced};
use super::plots::canvas::{INK, Ink, MUTED};
use super::plots::png;
use super::plots::text::{self, Weight};

/// Longest side of a picture, pixels.
const TILE: u32 = 440;
const GAP: u32 = 10;
const MARGIN: u32 = 16;
const SIZE: f64 = 25.0;
const SMALL: f64 = 20.0;

/// The pair of median difficulty of each dataset, as PNG. `None` without any picture.
///
/// # Errors
/// When the figure cannot be encoded.
pub fn figure(
    board: &Board<'_>,
    metrics: &[Column],
    pictures: &dyn ReportPictures,
) -> Result<Option<Vec<u8>>, ReportError> {
    let rows: Vec<PictureRow> = board
        .datasets
        .iter()
        .filter_map(|dataset| {
            let pairs = by_badness(board, &dataset.pairs, metrics);
            let pair = pairs.get(pairs.len() / 2)?;
            let label = format!("{}, {}", dataset.dataset.title(), pair.facts.scene);
            Some(PictureRow::new(board, pair, label, metrics, pictures))
        })
        .filter(|row| row.tiles.iter().any(|tile| tile.picture.is_some()))
        .collect();
    if rows.is_empty() {
        return Ok(None);
    }
    let columns = 2 + board
        .methods
        .iter()
        .filter(|m| m.unranked.is_none())
        .count() as u32;
    let head = MARGIN + line(SIZE) + GAP;
    let total = rows.iter().map(PictureRow::height).sum::<u32>();
    let mut sheet = RgbImage::from_pixel(
        2 * MARGIN + columns * (TILE + GAP) - GAP,
        head + total + MARGIN - GAP,
        Rgb([255; 3]),
    );
    let left = |column: usize| MARGIN + column as u32 * (TILE + GAP);
    let heads = ["source", "target"].into_iter();
    let ranked = board.methods.iter().filter(|m| m.unranked.is_none());
    let heads = heads.chain(ranked.map(|m| m.label.as_str()));
    for (column, label) in heads.enumerate() {
        let at = (left(column), head - GAP - 4);
        write(&mut sheet, label, at, SIZE, Weight::Bold, INK);
    }
    let mut top = head;
    for row in &rows {
        for (column, tile) in row.tiles.iter().enumerate() {
            let at = (left(column), top);
            if let Some(picture) = &tile.picture {
                imageops::replace(&mut sheet, picture, i64::from(at.0), i64::from(at.1));
            }
            for (text, i) in tile.text.iter().zip(1..) {
                let below = (at.0, top + row.pictures() + i * line(SMALL));
                write(&mut sheet, text, below, SMALL, Weight::Regular, MUTED);
            }
        }
        top += row.height();
    }
    let png = png::encode(&sheet, 192.0).map_err(|e| ReportError::Plot {
        plot: "qualitative.png".into(),
        reason: e.to_string(),
    })?;
    Ok(Some(png))
}

/// Height of a line of text.
fn line(size: f64) -> u32 {
    (size * 1.3).round() as u32
}

struct PictureRow {
    tiles: Vec<Tile>,
}

/// A picture, and the lines below it.
struct Tile {
    picture: Option<RgbImage>,
    text: Vec<String>,
}

impl Tile {
    fn new(picture: Result<RgbImage, MissingPicture>, text: &str) -> Self {
        match picture {
            Ok(picture) => Self {
                picture: Some(reduced(&picture, TILE)),
                ..Self::empty(text)
            },
            Err(reason) => Self::empty(&reason.to_string()),
        }
    }

    fn empty(text: &str) -> Self {
        Self {
            picture: None,
            text: text::wrapped(text, SMALL, Weight::Regular, f64::from(TILE)),
        }
    }
}

impl PictureRow {
    fn new(
        board: &Board<'_>,
        pair: &PairBoard<'_>,
        label: String,
        metrics: &[Column],
        pictures: &dyn ReportPictures,
    ) -> Self {
        let baseline = format!("baseline {:.3} m", pair.facts.baseline_m);
        let mut tiles = vec![
            Tile::new(pictures.source(pair.facts), &label),
            Tile::new(pictures.target(pair.facts), &baseline),
        ];
        let methods = pair.by_method.iter().zip(&board.methods);
        for (record, _) in methods.filter(|(_, method)| method.unranked.is_none()) {
            tiles.push(match record {
                None => Tile::empty("no record"),
                Some(record) if record.status != Status::Ok => Tile::empty("failed"),
                Some(record) => {
                    let named = metrics.iter().zip(Column::names(metrics));
                    let scores = named.filter_map(|(metric, name)| {
                        let value = record.scores.get(&metric.key)?.value()?;
                        // A name and its number stay on one line.
                        Some(format!("{name} {}", metric.shown(value)).replace(' ', "\u{a0}"))
                    });
                    let scores: Vec<String> = scores.collect();
                    Tile::new(pictures.prediction(record), &scores.join(", "))
                }
            });
        }
        Self { tiles }
    }

    /// Height of the pictures.
    fn pictures(&self) -> u32 {
        let heights = self.tiles.iter().filter_map(|t| t.picture.as_ref());
        heights.map(RgbImage::height).max().unwrap_or(0)
    }

    /// Height of pictures and text, with the distance to the next row.
    fn height(&self) -> u32 {
        let lines = self.tiles.iter().map(|tile| tile.text.len()).max();
        self.pictures() + line(SMALL) * (lines.unwrap_or(0) as u32 + 1) + GAP
    }
}

/// Text from a baseline's start, shortened to the width of a tile.
fn write(sheet: &mut RgbImage, text: &str, at: (u32, u32), size: f64, weight: Weight, ink: Ink) {
    let text = text::fitted(text, size, weight, f64::from(TILE));
    text::write(sheet, &text, at, size, weight, ink);
}
