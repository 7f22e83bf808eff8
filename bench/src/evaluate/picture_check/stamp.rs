//! Detects content that all pictures have in common although their targets do not, such as captions and watermarks.

use std::collections::{BTreeMap, BTreeSet};

use image::RgbImage;
use image::imageops::thumbnail;

use super::group::PictureGroup;
use super::measures::Cell;
use crate::evaluate::record::Record;
use crate::pairs::valid_depth::median_of;

/// Number of cells across and down.
const GRID: [u32; 2] = [40, 30];
/// A cell may have foreign content if picture and target differ in it by at least this, in levels.
const MIN_FOREIGN_DIFFERENCE: u8 = 12;
/// Cells of several pictures count as equal if their levels differ by at most this from the median of these pictures.
const MAX_EQUAL_DIFFERENCE: u8 = 3;
/// Pictures are compared only if they have at least this many targets.
const MIN_TARGETS: usize = 4;
/// Pictures are compared only if they have at least this many sources, because predictions from one source may be
/// alike.
const MIN_SOURCES: usize = 3;
/// Foreign content is reported only if at least this share of the pictures have it in common.
const MIN_SHARE: f64 = 0.8;
/// Content of a cell is foreign only if the targets differ there: the median difference of their levels from their
/// median level must be at least this.
const MIN_TARGET_DIFFERENCE: f64 = 8.0;
/// Content is reported only if it fills at least this many cells.
const MIN_CELLS: usize = 8;
/// Content is reported only if it fills at least this share of the rectangle around it. Other faults are scattered.
const MIN_FILLED: f64 = 0.4;
/// Content is reported only if it fills at most this share of all cells. Pictures that are wrong everywhere have
/// another cause.
const MAX_SHARE: f64 = 0.5;
/// Content is reported only if its contrast is at least this, in levels. Holes and backgrounds have one colour.
const MIN_CONTRAST: u8 = 24;

/// Cells in which a picture differs from its target, with the mean levels of both.
pub(super) fn wrong_cells(target: &RgbImage, picture: &RgbImage) -> Vec<Cell> {
    let levels = |of: &RgbImage| -> Vec<u8> {
        let cells = thumbnail(of, GRID[0], GRID[1]);
        let means = cells.pixels().map(|pixel| pixel.0.map(u16::from));
        means.map(|[r, g, b]| ((r + g + b) / 3) as u8).collect()
    };
    let both = levels(picture).into_iter().zip(levels(target));
    let wrong = (0..)
        .zip(both)
        .filter(|(_, (own, seen))| own.abs_diff(*seen) >= MIN_FOREIGN_DIFFERENCE);
    wrong.map(|(cell, (own, seen))| (cell, own, seen)).collect()
}

/// A warning if the pictures share content that their targets do not show.
pub(crate) fn stamped_pictures(group: &PictureGroup<'_, &Record>) -> Option<String> {
    let records = group.pictures.iter();
    let compared = records.filter_map(|record| Some((*record, record.wrong_cells.as_deref()?)));
    let pictures: Vec<(&Record, &[Cell])> = compared.collect();
    let views = |of: fn(&Record) -> &String| {
        let names = pictures
            .iter()
            .map(|(record, _)| (&record.scene, of(record)));
        names.collect::<BTreeSet<_>>().len()
    };
    if views(|record| &record.target) < MIN_TARGETS || views(|record| &record.source) < MIN_SOURCES
    {
        return None;
    }
    let all = pictures.len();
    let mut levels: BTreeMap<u16, Vec<(u8, u8)>> = BTreeMap::new();
    for (cell, own, seen) in pictures.iter().flat_map(|(_, cells)| *cells) {
        levels.entry(*cell).or_default().push((*own, *seen));
    }
    let stamped = levels.into_iter().filter_map(|(cell, mut levels)| {
        let own = median_of(levels.iter().map(|level| level.0).collect())? as u8;
        levels.retain(|level| level.0.abs_diff(own) <= MAX_EQUAL_DIFFERENCE);
        let seen = median_of(levels.iter().map(|level| level.1).collect())? as u8;
        let apart = levels.iter().map(|level| level.1.abs_diff(seen));
        let is_stamped = levels.len() as f64 >= MIN_SHARE * all as f64
            && median_of(apart.collect())? >= MIN_TARGET_DIFFERENCE;
        is_stamped.then_some((u32::from(cell), own))
    });
    let stamped: Vec<(u32, u8)> = stamped.collect();
    let of_levels = stamped.iter().map(|(_, level)| *level);
    let contrast = of_levels.clone().max()? - of_levels.min()?;
    // First column and row of the content, and the column and row after the last.
    let [across, down] = [0, 1].map(|axis| {
        let at = stamped
            .iter()
            .map(|(cell, _)| [cell % GRID[0], cell / GRID[0]][axis]);
        [
            at.clone().min().unwrap_or_default(),
            at.max().unwrap_or_default() + 1,
        ]
    });
    let around = f64::from((across[1] - across[0]) * (down[1] - down[0]));
    let (count, share) = (
        stamped.len(),
        stamped.len() as f64 / f64::from(GRID[0] * GRID[1]),
    );
    let is_found = count >= MIN_CELLS && count as f64 >= MIN_FILLED * around && share <= MAX_SHARE;
    if !is_found || contrast < MIN_CONTRAST {
        return None;
    }
    let [across, down] = [(across, GRID[0]), (down, GRID[1])]
        .map(|([first, last], of)| format!("{} to {} %", 100 * first / of, 100 * last / of));
    Some(format!(
        "its pictures share content that their targets do not have, such as a caption, logo or watermark (about {:.0} % \
         of their area, at {across} of the width and {down} of the height, is the same in nearly all of the {all} \
         compared pictures of {}); store the pictures without this content",
        100.0 * share,
        group.name
    ))
}

#[cfg(test)]
mod tests {
    use image::Rgb;

    use super::super::group::tests::of_dataset;
    use super::*;
    use crate::evaluate::record::Status;
    use crate::evaluate::record::tests::record;

    /// The warning about eight predictions, altered by `change`.
    fn told(change: impl Fn(u32, u32, u8) -> u8) -> Option<String> {
        let wave = |view: u32, x: u32, y: u32| {
            let (u, v) = (f64::from(x) / 23.0, f64::from(y) / 31.0);
            (128.0 + 100.0 * (u + f64::from(view * 9)).sin() * (v + f64::from(view * 5)).cos())
                as u8
        };
        let records: Vec<Record> =
            (0..8)
                .map(|view| {
                    let target = RgbImage::from_fn(160, 120, |x, y| Rgb([wave(view, x, y); 3]));
                    let picture = RgbImage::from_fn(160, 120, |x, y| {
                        Rgb([change(x, y, wave(view, x + 3, y)); 3])
                    });
                    Record {
                        source: format!("source {view}"),
                        target: format!("target {view}"),
                        status: Status::Ok,
                        wrong_cells: Some(wrong_cells(&target, &picture)),
                        ..record()
                    }
                })
                .collect();
        of_dataset(&records, stamped_pictures)
    }

    #[test]
    fn captions_are_told_and_holes_are_not() {
        let is_box = |x: u32, y: u32| (8..88).contains(&x) && (4..20).contains(&y);
        let caption = |x: u32, y: u32, level: u8| {
            if is_box(x, y) {
                [0, 200][usize::from((x / 8).is_multiple_of(3))]
            } else {
                level
            }
        };
        let said = told(caption).unwrap();
        assert!(
            said.contains("at 5 to 55 % of the width and 3 to 16 % of the height"),
            "{said}"
        );
        assert_eq!(told(|_, _, level| level), None);
        // Holes, and pictures without content.
        assert_eq!(told(|x, _, level| if x > 130 { 0 } else { level }), None);
        assert_eq!(told(|x, y, _| (x + y) as u8), None);
    }
}
