//! The series of a history as CSV, one row per point.

use crate::evaluate::Occasion;
use crate::io::text::csv_bytes;
use crate::report::tables::csv::{optional, text};
use crate::track::compare::verdict_word;

use super::{History, Point};

/// Header of the CSV that [`csv()`] writes.
pub const COLUMNS: &str = "entry,label,commit,date,method,dataset,metric,n_pairs,n_planned,n_failed,n_scenes,mean,ci_low,ci_high,\
                           weights,identity,follows,broken,change,rule,against,difference,p";

/// Comma-separated values with a header, series by series. Numbers round-trip; unknown values are
/// empty.
pub fn csv(history: &History) -> Vec<u8> {
    let rows = history.points().map(|point| row(history, point));
    csv_bytes(COLUMNS.split(','), rows)
}

fn row(history: &History, point: &Point) -> [String; 23] {
    let entry = |number: Option<u32>| number.map(|n| n.to_string()).unwrap_or_default();
    let occasion = history.occasion(point.entry);
    let of_entry =
        |of: fn(&Occasion) -> Option<&str>| text(occasion.and_then(of).unwrap_or_default());
    let change = point.change.as_ref();
    [
        point.entry.to_string(),
        of_entry(|occasion| Some(&occasion.label)),
        of_entry(|occasion| occasion.commit.as_deref()),
        of_entry(|occasion| Some(&occasion.date)),
        text(&point.method),
        text(&point.dataset),
        point.metric.clone(),
        point.n_pairs.to_string(),
        point.n_planned.to_string(),
        point.n_failed.to_string(),
        point.n_scenes.to_string(),
        optional(point.mean),
        optional(point.ci_low),
        optional(point.ci_high),
        point.weights.clone(),
        text(&point.identity),
        entry(point.follows),
        text(point.broken.as_deref().unwrap_or_default()),
        change.map_or_else(String::new, |c| verdict_word(c.verdict).to_owned()),
        change.map_or_else(String::new, |c| c.rule.word().to_owned()),
        entry(change.map(|c| c.against)),
        optional(change.map(|c| c.difference)),
        optional(change.and_then(|c| c.p)),
    ]
}
