//! The reference, the shifted pictures and the mean image side by side, with their scores below.

use super::experiment::Experiment;
use crate::report::column::Column;
use crate::report::figures::sheet::{Sheet, Tile};

/// Lays the pictures out in one row, the reference first.
pub fn strip(experiment: &Experiment) -> Sheet {
    let mut heads = vec!["Reference".to_owned()];
    let mut tiles = vec![Tile::new("", Ok(experiment.reference.clone()), "")];
    for comparison in &experiment.comparisons {
        let scores = experiment.keys().into_iter().map(|key| {
            let column = Column::from(key);
            let value = comparison.score(key).map(|value| column.shown(value));
            let value = value.unwrap_or_else(|| "unavailable".to_owned());
            // Keep a label and its number on one line.
            format!("{} {value}", column.label).replace(' ', "\u{a0}")
        });
        let scores = scores.collect::<Vec<_>>().join(", ");
        heads.push(comparison.label());
        tiles.push(Tile::new("", Ok(comparison.picture.clone()), scores));
    }
    Sheet {
        heads,
        rows: vec![(String::new(), tiles)],
    }
}
