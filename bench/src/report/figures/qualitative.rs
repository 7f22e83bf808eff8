//! Predictions side by side: pairs as rows to compare methods, or as columns for ablations and for targets of one
//! source.

use super::choice::{ChosenPair, PairsChoice, chosen};
use super::sheet::{Sheet, SheetMedium, Tile};
use crate::evaluate::record::{Record, Status};
use crate::report::board::Board;
use crate::report::column::Column;
use crate::report::error::{MissingPicture, ReportError};
use crate::report::pictures::ReportPictures;
use crate::scoring::Region;

/// Pairs, methods, scores and enlarged parts of a sheet.
pub struct SheetContent<'a> {
    pub board: &'a Board<'a>,
    pub pairs: Vec<ChosenPair<'a>>,
    /// Indices of methods in the board.
    pub methods: Vec<usize>,
    /// Metrics whose scores are shown below predictions.
    pub metrics: &'a [Column],
    pub pictures: &'a ReportPictures<'a>,
    /// Enlarged parts of predictions and truth, in pixels of the target.
    pub crops: Vec<Region>,
}

/// The figure of a report as PNG: the plotted methods on one pair of median difficulty per dataset. `None` if there are
/// no pictures.
///
/// # Errors
/// If the figure cannot be encoded.
pub fn figure(
    board: &Board<'_>,
    metrics: &[Column],
    pictures: &ReportPictures<'_>,
) -> Result<Option<Vec<u8>>, ReportError> {
    let comparison = SheetContent {
        board,
        pairs: chosen(board, metrics, &PairsChoice::default())?,
        methods: board.plotted().collect(),
        metrics,
        pictures,
        crops: Vec::new(),
    };
    let mut sheet = comparison.pairs_as_rows();
    // In a report, omit datasets without pictures.
    let any = |tiles: &[Tile]| tiles.iter().any(|tile| tile.picture.is_ok());
    sheet.rows.retain(|(_, tiles)| any(tiles));
    sheet.png(&SheetMedium::screen())
}

impl SheetContent<'_> {
    /// One row per pair: the input, the predictions and, if any target has a picture, the truth.
    pub fn pairs_as_rows(&self) -> Sheet {
        let labels = self
            .methods
            .iter()
            .map(|m| self.board.methods[*m].label.clone());
        let has_truth = self.has_truth();
        let heads = std::iter::once("input".to_owned()).chain(labels);
        let rows = self.pairs.iter().map(|chosen| {
            let mut tiles = vec![self.input(chosen)];
            tiles.extend(self.methods.iter().map(|m| self.prediction(chosen, *m)));
            tiles.extend(has_truth.then(|| self.truth(chosen)));
            (String::new(), tiles)
        });
        Sheet {
            heads: heads.chain(has_truth.then(|| "truth".to_owned())).collect(),
            rows: rows.collect(),
        }
    }

    /// One row per method, and the truth as the last row if any target has a picture. If all pairs share one input
    /// (`one_source`), it is shown first.
    pub fn pairs_as_columns(&self, one_source: bool) -> Sheet {
        let row = |label: &str, tile: &dyn Fn(&ChosenPair<'_>) -> Tile| {
            (
                label.to_owned(),
                self.pairs.iter().map(tile).collect::<Vec<_>>(),
            )
        };
        let mut rows = Vec::new();
        if let Some(first) = self.pairs.first().filter(|_| one_source) {
            rows.push(("input".to_owned(), vec![self.input(first)]));
        }
        rows.extend(self.methods.iter().map(|m| {
            row(&self.board.methods[*m].label, &|chosen| {
                self.prediction(chosen, *m)
            })
        }));
        if self.has_truth() {
            rows.push(row("truth", &|chosen| self.truth(chosen)));
        }
        Sheet {
            heads: Vec::new(),
            rows,
        }
    }

    fn has_truth(&self) -> bool {
        let mut targets = self.pairs.iter().map(|chosen| chosen.pair.facts);
        targets.any(|facts| !self.pictures.is_virtual(facts))
    }

    pub(super) fn input(&self, chosen: &ChosenPair<'_>) -> Tile {
        let facts = chosen.pair.facts;
        let text = format!("{}, {}", chosen.dataset.dataset.title(), facts.scene);
        Tile::new(named(chosen, "input"), self.pictures.source(facts), text)
    }

    fn truth(&self, chosen: &ChosenPair<'_>) -> Tile {
        let facts = chosen.pair.facts;
        Tile {
            crops: self.crops.clone(),
            ..Tile::new(
                named(chosen, "truth"),
                self.pictures.target(facts),
                baseline(facts),
            )
        }
    }

    pub(super) fn prediction(&self, chosen: &ChosenPair<'_>, method: usize) -> Tile {
        let record = chosen.pair.by_method.get(method).copied().flatten();
        let (picture, text) = match record.map(|record| (record, &record.status)) {
            None => (Err(MissingPicture::Without("record")), String::new()),
            Some((_, Status::Failed { reason })) => {
                (Err(MissingPicture::Failed(reason.clone())), String::new())
            }
            Some((record, Status::Ok)) => {
                let text = if self.pictures.is_virtual(record) {
                    baseline(record)
                } else {
                    self.scores(record)
                };
                (self.pictures.prediction(record), text)
            }
        };
        Tile {
            crops: self.crops.clone(),
            ..Tile::new(
                named(chosen, &self.board.methods[method].label),
                picture,
                text,
            )
        }
    }

    fn scores(&self, record: &Record) -> String {
        let named = self.metrics.iter().zip(Column::names(self.metrics));
        let scores = named.filter_map(|(metric, name)| {
            let value = record.scores.get(&metric.key)?.value()?;
            // Keep a name and its number on one line.
            Some(format!("{name} {}", metric.shown(value)).replace(' ', "\u{a0}"))
        });
        scores.collect::<Vec<_>>().join(", ")
    }
}

fn baseline(facts: &Record) -> String {
    format!("baseline {:.3} m", facts.baseline_m).replace(' ', "\u{a0}")
}

/// Name of a tile in messages about it.
pub(super) fn named(chosen: &ChosenPair<'_>, what: &str) -> String {
    format!("{}, {what}", chosen.pair.facts.pair_id)
}
