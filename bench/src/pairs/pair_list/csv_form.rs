//! Rows of a pair list as CSV.

use std::ops::RangeInclusive;
use std::str::FromStr;

use crate::io::text::{csv_cell, csv_text};
use crate::pairs::Pair;
use crate::pairs::pair_id::PairName;

pub const COLUMNS: [&str; 16] = [
    "pair_id",
    "dataset",
    "scene",
    "set",
    "source",
    "target",
    "source_file",
    "target_file",
    "source_sha256",
    "target_sha256",
    "baseline_m",
    "rotation_deg",
    "median_depth_m",
    "overlap",
    "overlap_source_to_target",
    "selected",
];

/// Likely cause of a changed file, and what to do; follows a colon.
pub(super) const SPREADSHEET: &str =
    "a spreadsheet probably changed this file; use the original, or fetch or build the list again";

pub(super) fn to_csv(pairs: &[Pair]) -> String {
    let rows = pairs.iter().map(fields);
    std::iter::once(COLUMNS.map(str::to_owned))
        .chain(rows)
        .map(|row| row.map(|field| quoted(&field)).join(",") + "\n")
        .collect()
}

/// Quotes a field only if needed (RFC 4180).
fn quoted(field: &str) -> String {
    if field.contains([',', '"', '\n', '\r']) {
        format!("\"{}\"", field.replace('"', "\"\""))
    } else {
        field.to_owned()
    }
}

/// A row as text, in the order of [`COLUMNS`].
pub(super) fn fields(pair: &Pair) -> [String; COLUMNS.len()] {
    fn or_empty<T: ToString>(value: Option<T>) -> String {
        value.map(|v| v.to_string()).unwrap_or_default()
    }
    let text = |text: &str| csv_cell(text).into_owned();
    [
        text(&pair.pair_id),
        text(&pair.dataset),
        text(&pair.scene),
        or_empty(pair.set),
        text(&pair.source),
        text(&pair.target),
        text(&pair.source_file),
        text(&pair.target_file),
        pair.source_sha256.clone(),
        pair.target_sha256.clone(),
        pair.baseline_m.to_string(),
        pair.rotation_deg.to_string(),
        or_empty(pair.median_depth_m),
        or_empty(pair.overlap),
        or_empty(pair.overlap_source_to_target),
        pair.selected.to_string(),
    ]
}

pub(super) fn parse_row(row: &csv::StringRecord) -> Result<Pair, String> {
    let field = |i: usize| row.get(i).unwrap_or_default();
    let text = |i: usize| csv_text(field(i)).to_owned();
    let number = |i: usize, (range, expected): &(RangeInclusive<f64>, &str)| {
        let value = field(i).parse::<f64>().ok();
        value
            .filter(|v| range.contains(v))
            .ok_or_else(|| wrong_field(i, field(i), expected))
    };
    let number_or_none = |i: usize, range| match field(i) {
        "" => Ok(None),
        _ => number(i, range).map(Some),
    };
    let metres = (0.0..=f64::MAX, "a number of 0 or more");
    let degrees = (0.0..=180.0, "a number from 0 to 180");
    let depth = (f64::MIN_POSITIVE..=f64::MAX, "a number above 0");
    let share = (0.0..=1.0, "a number from 0 to 1");
    let hash = |i: usize| {
        let is_digit = |b: u8| b.is_ascii_digit() || (b'a'..=b'f').contains(&b);
        let value = field(i);
        if value.is_empty() || (value.len() == 64 && value.bytes().all(is_digit)) {
            Ok(value.to_owned())
        } else {
            Err(wrong_field(i, value, "64 lower-case hexadecimal digits"))
        }
    };
    let pair = Pair {
        pair_id: text(0),
        dataset: text(1),
        scene: text(2),
        set: match field(3) {
            "" => None,
            number => {
                Some(u32::from_str(number).map_err(|_| wrong_field(3, number, "a set's number"))?)
            }
        },
        source: text(4),
        target: text(5),
        source_file: text(6),
        target_file: text(7),
        source_sha256: hash(8)?,
        target_sha256: hash(9)?,
        baseline_m: number(10, &metres)?,
        rotation_deg: number(11, &degrees)?,
        median_depth_m: number_or_none(12, &depth)?,
        overlap: number_or_none(13, &share)?,
        overlap_source_to_target: number_or_none(14, &share)?,
        selected: bool::from_str(field(15)).map_err(|_| {
            let wrong = wrong_field(15, field(15), "true or false");
            match field(15) {
                "TRUE" | "FALSE" => format!("{wrong} in small letters: {SPREADSHEET}"),
                _ => wrong,
            }
        })?,
    };
    let name = PairName::decode(&pair.pair_id).map_err(|error| error.to_string())?;
    let columns = [&pair.dataset, &pair.scene, &pair.source, &pair.target];
    let names = [&name.dataset, &name.scene, &name.source, &name.target];
    if names != columns {
        let is_shortened =
            |(name, column): (&&String, &String)| name.trim_start_matches('0') == column;
        let mut changed = names.iter().zip(columns).filter(|(a, b)| **a != *b);
        let cause = if changed.all(is_shortened) {
            format!(", which lack the leading zeros of their names: {SPREADSHEET}")
        } else {
            String::new()
        };
        return Err(format!(
            "pair id '{}' disagrees with the row's dataset, scene, source and target{cause}",
            pair.pair_id
        ));
    }
    Ok(pair)
}

fn wrong_field(column: usize, value: &str, expected: &str) -> String {
    format!("{} is '{value}', not {expected}", COLUMNS[column])
}
