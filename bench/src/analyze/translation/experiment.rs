//! Scores all comparisons of one picture.

use image::RgbImage;
use sharp_metrics::{MetricKey, Picture, ScoreError, Scorer};

use crate::pictures::keyed_scores::KeyedScores;

use super::shift::{Shifts, ShiftsError, Windows, mean_image};

/// A picture compared with shifted copies and with its mean colour.
#[derive(Debug)]
pub struct Experiment {
    /// The unshifted window, which everything is compared with.
    pub reference: RgbImage,
    /// The shifts in ascending order, then the mean image.
    pub comparisons: Vec<Comparison>,
}

/// Scores of one altered picture against the reference: a row of the table.
#[derive(Debug)]
pub struct Comparison {
    /// Shift of the window in per cent of the width and in pixels; `None` for the mean image.
    pub shift: Option<(f64, f64)>,
    /// The picture compared with the reference.
    pub picture: RgbImage,
    /// For each metric, the score, or the reason why it is missing.
    pub scores: KeyedScores,
}

/// Why a picture cannot be analysed.
#[derive(Debug, thiserror::Error)]
pub enum ExperimentError {
    /// The picture is too small for the shifts.
    #[error(transparent)]
    Shifts(#[from] ShiftsError),
    /// The pictures cannot be scored.
    #[error(transparent)]
    Score(#[from] ScoreError),
}

impl Experiment {
    /// Makes and scores all comparisons; `progress` is called after each.
    ///
    /// # Errors
    /// If the picture is too small for the shifts, or cannot be scored.
    pub fn run(
        picture: &RgbImage,
        shifts: &Shifts,
        scorer: &Scorer,
        mut progress: impl FnMut(),
    ) -> Result<Self, ExperimentError> {
        let windows = Windows::new(picture, shifts)?;
        let reference = windows.reference();
        let target = Picture::from(reference.clone());
        let mut comparisons = Vec::new();
        let moved = shifts.percent().iter().map(|percent| {
            let pixels = windows.pixels(*percent);
            (Some((*percent, pixels)), windows.shifted(pixels))
        });
        for (shift, picture) in moved.chain([(None, mean_image(&reference))]) {
            let scores = scorer.score(&Picture::from(picture.clone()), &target, None)?;
            comparisons.push(Comparison {
                shift,
                picture,
                scores: scores
                    .into_iter()
                    .map(|(key, score)| (key, score.map_err(|reason| reason.to_string())))
                    .collect(),
            });
            progress();
        }
        Ok(Self {
            reference,
            comparisons,
        })
    }

    /// The metrics, in the order of the scores.
    pub fn keys(&self) -> Vec<MetricKey> {
        let first = self.comparisons.first();
        first.map_or_else(Vec::new, |c| c.scores.iter().map(|(key, _)| *key).collect())
    }
}

impl Comparison {
    /// The paper's label: `Translated (0.1 %)`, `Mean image`.
    pub fn label(&self) -> String {
        match self.shift {
            Some((percent, _)) => format!("Translated ({percent:?} %)"),
            None => "Mean image".to_owned(),
        }
    }

    /// The score of a metric; `None` if missing.
    pub fn score(&self, key: MetricKey) -> Option<f64> {
        let (_, score) = self.scores.iter().find(|(k, _)| *k == key)?;
        score.as_ref().ok().copied()
    }
}
