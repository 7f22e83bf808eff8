//! Detects pictures with bars, margins, missing rows or interlaced rows, at full resolution.
//!
//! Holes of a rendering are not reported: their edges follow the scene, or they are on one side or on all sides.

use image::RgbImage;

use super::finding::PictureChange;

/// Maximum difference of levels that count as one colour; JPEG alters them.
const MAX_WITHIN_COLOUR: u8 = 8;
/// Lowest level that counts as white.
const MIN_WHITE: u8 = 247;
/// Bars and margins must fill at least one in this many lines to be reported.
const BAR: u32 = 50;
/// Unfinished pictures must lack at least one in this many rows to be reported.
const MISSING: u32 = 5;
/// Maximum difference in thickness of two bars that count as equally thick, in pixels.
const MAX_UNEVEN: u32 = 2;
/// In interlaced pictures, the mean difference between neighbouring rows, divided by that between rows two apart, is
/// above this.
const MIN_STEPS: f64 = 1.2;
/// The ratio that [`MIN_STEPS`] limits is below this for columns, and for rows of pictures that are not interlaced.
const MAX_STEPS: f64 = 1.05;
/// One row repeated in a picture must fill at least one in this many rows to be reported.
const REPEATED_ROW: usize = 20;
/// Share of the lines that are equal to the previous line in pictures enlarged by 1.3 to 16 times.
const REPEATED: std::ops::RangeInclusive<f64> = 0.2..=0.95;
/// Maximum number of successive lines that are equal to the previous line, in enlarged pictures.
const MAX_REPEATED: usize = 15;
/// Maximum size of the central part in which steps are measured, in pixels.
const STEPS_WITHIN: u32 = 256;

/// The change that the layout of a picture shows, such as bars or interlaced rows.
pub(super) fn layout_change(photograph: &RgbImage, picture: &RgbImage) -> Option<PictureChange> {
    if photograph.dimensions() != picture.dimensions() {
        return None;
    }
    let [rows, columns] = [true, false].map(|is_row| Sides::of(photograph, picture, is_row));
    let is_framed = [&rows, &columns]
        .iter()
        .all(|sides| sides.are_bars() && sides.colours.iter().flatten().all(|v| *v >= MIN_WHITE));
    if is_framed {
        return Some(PictureChange::Framed);
    }
    let has_bars =
        |sides: &Sides, across: &Sides| sides.are_equal_bars() && across.thickness == [0; 2];
    if has_bars(&rows, &columns) || has_bars(&columns, &rows) {
        return Some(PictureChange::Bars);
    }
    if rows.is_unfinished() {
        return Some(PictureChange::Unfinished);
    }
    if let Some(thickness) = strip(&rows, &columns) {
        return Some(PictureChange::Strip(thickness));
    }
    let is_interlaced = steps(picture, true) > MIN_STEPS
        && steps(picture, false) < MAX_STEPS
        && steps(photograph, true) < MAX_STEPS;
    if is_interlaced {
        return Some(PictureChange::Interlaced);
    }
    if repeats_a_row(photograph, picture) {
        return Some(PictureChange::RepeatedRow);
    }
    let is_repeated = |of: &RgbImage, is_row| REPEATED.contains(&repeated(of, is_row));
    let has_blocks = is_repeated(picture, true) && is_repeated(picture, false);
    let is_change = has_blocks && [true, false].iter().any(|is| !is_repeated(photograph, *is));
    is_change.then_some(PictureChange::Blocks)
}

/// Whether successive rows of the picture equal one row of several colours, unlike in the photograph. Columns are
/// ignored, because methods often repeat the border of the source where a horizontal motion leaves a hole.
fn repeats_a_row(photograph: &RgbImage, picture: &RgbImage) -> bool {
    let runs = |of: &RgbImage| {
        let mut longest = (0, 0);
        let mut at = 1;
        for run in equal_lines(of, true).chunk_by(|a, b| a == b) {
            if run[0] && run.len() > longest.0 {
                longest = (run.len(), at);
            }
            at += run.len();
        }
        longest
    };
    let (count, at) = runs(picture);
    let least = (picture.height() as usize / REPEATED_ROW).max(MAX_REPEATED + 1);
    count >= least
        && colour_of(picture, true, at as u32).is_none()
        && 2 * runs(photograph).0 < count
}

/// For each row (or column) but the first, whether it equals the previous one.
fn equal_lines(picture: &RgbImage, is_row: bool) -> Vec<bool> {
    let (width, height) = picture.dimensions();
    let all = if is_row { height } else { width };
    let is_equal = |at: u32| line(picture, is_row, at).eq(line(picture, is_row, at - 1));
    (1..all).map(is_equal).collect()
}

/// The share of the rows (or columns) of `picture` that equal the previous one. Returns 1 if more than `MAX_REPEATED`
/// successive ones do, as in bars.
fn repeated(picture: &RgbImage, is_row: bool) -> f64 {
    let equal = equal_lines(picture, is_row);
    if equal
        .chunk_by(|a, b| a == b)
        .any(|run| run[0] && run.len() > MAX_REPEATED)
    {
        return 1.0;
    }
    equal.iter().filter(|is| **is).count() as f64 / equal.len().max(1) as f64
}

/// The thickness of a strip along the first or last row, in thousandths of the height. Strips along columns are
/// ignored, because a horizontal shift of the camera leaves the same hole.
fn strip(rows: &Sides, columns: &Sides) -> Option<[i16; 2]> {
    let side = match (rows.thickness, columns.thickness) {
        ([_, 0], [0, 0]) => 0,
        ([0, _], [0, 0]) => 1,
        _ => return None,
    };
    let is_all = |is: fn(&u8) -> bool| rows.colours[side].iter().all(is);
    let is_told = is_all(|v| *v >= MIN_WHITE) || is_all(|v| *v <= MAX_WITHIN_COLOUR);
    let is_thick = rows.thickness[side] >= (rows.all / BAR).max(2);
    (is_told && is_thick && rows.is_sharp[side] && rows.vary[side])
        .then(|| rows.thickness.map(|lines| (1000 * lines / rows.all) as i16))
}

/// Lines of one colour along two opposite sides of a picture.
struct Sides {
    /// Number of lines in the picture.
    all: u32,
    /// Number of successive lines of one colour along the first side and along the last.
    thickness: [u32; 2],
    colours: [[u8; 3]; 2],
    /// For each side, whether the photograph varies along most of these lines.
    vary: [bool; 2],
    /// For each side, whether the line after these lines has hardly any pixels of their colour.
    is_sharp: [bool; 2],
}

impl Sides {
    fn of(photograph: &RgbImage, picture: &RgbImage, is_row: bool) -> Self {
        let (width, height) = picture.dimensions();
        let all = if is_row { height } else { width };
        let place = |side: usize, k: u32| if side == 0 { k } else { all - 1 - k };
        let side = |side: usize| {
            let first = colour_of(picture, is_row, place(side, 0))?;
            let same = |k: &u32| {
                let colour = colour_of(picture, is_row, place(side, *k));
                colour.is_some_and(|colour| is_alike(colour, first))
            };
            let count = (0..all).take_while(same).count() as u32;
            let varying = (0..count)
                .filter(|k| colour_of(photograph, is_row, place(side, *k)).is_none())
                .count() as u32;
            let is_sharp = count < all && {
                let next = line(picture, is_row, place(side, count));
                10 * next.filter(|pixel| is_alike(*pixel, first)).count()
                    < if is_row { width } else { height } as usize
            };
            Some((count, first, 2 * varying > count, is_sharp))
        };
        let [first, last] = [0, 1].map(|at| side(at).unwrap_or_default());
        Self {
            all,
            thickness: [first.0, last.0],
            colours: [first.1, last.1],
            vary: [first.2, last.2],
            is_sharp: [first.3, last.3],
        }
    }

    fn are_bars(&self) -> bool {
        let least = (self.all / BAR).max(2);
        self.thickness.iter().all(|t| *t >= least && *t < self.all)
            && self.vary == [true; 2]
            && is_alike(self.colours[0], self.colours[1])
    }

    fn are_equal_bars(&self) -> bool {
        self.are_bars() && self.thickness[0].abs_diff(self.thickness[1]) <= MAX_UNEVEN
    }

    /// Whether lines of one grey level fill the last part of the picture, and no line at the first side has a single
    /// colour.
    fn is_unfinished(&self) -> bool {
        let [first, last] = self.thickness;
        let [r, g, b] = self.colours[1];
        first == 0
            && last >= (self.all / MISSING).max(2)
            && self.vary[1]
            && is_alike([r, g, b], [g; 3])
    }
}

/// The pixels of a row or column.
fn line(picture: &RgbImage, is_row: bool, at: u32) -> impl Iterator<Item = [u8; 3]> {
    let (width, height) = picture.dimensions();
    let length = if is_row { width } else { height };
    (0..length).map(move |k| {
        if is_row {
            picture.get_pixel(k, at).0
        } else {
            picture.get_pixel(at, k).0
        }
    })
}

/// The colour of a row or column; `None` if it has several.
fn colour_of(picture: &RgbImage, is_row: bool, at: u32) -> Option<[u8; 3]> {
    let first = line(picture, is_row, at).next()?;
    line(picture, is_row, at)
        .all(|pixel| is_alike(pixel, first))
        .then_some(first)
}

fn is_alike(a: [u8; 3], b: [u8; 3]) -> bool {
    a.iter()
        .zip(b)
        .all(|(a, b)| a.abs_diff(b) <= MAX_WITHIN_COLOUR)
}

/// The mean difference of neighbouring rows (or columns), divided by the mean difference of rows (or columns) two
/// apart.
fn steps(picture: &RgbImage, is_row: bool) -> f64 {
    let (width, height) = picture.dimensions();
    let size = [width, height].map(|n| n.min(STEPS_WITHIN));
    let [left, top] = [(width - size[0]) / 2, (height - size[1]) / 2];
    let level = |x: u32, y: u32| picture.get_pixel(left + x, top + y).0[1];
    let mut sums = [0_u64; 2];
    for y in 0..size[1].saturating_sub(if is_row { 2 } else { 0 }) {
        for x in 0..size[0].saturating_sub(if is_row { 0 } else { 2 }) {
            for (by, sum) in (1..).zip(&mut sums) {
                let other = if is_row {
                    level(x, y + by)
                } else {
                    level(x + by, y)
                };
                *sum += u64::from(level(x, y).abs_diff(other));
            }
        }
    }
    // Mean differences of up to half a level are noise.
    let noise = u64::from(size[0] * size[1] / 2).max(1);
    sums[0] as f64 / sums[1].max(noise) as f64
}

#[cfg(test)]
mod tests {
    use image::Rgb;

    use super::*;

    fn photograph(by: u32) -> RgbImage {
        RgbImage::from_fn(120, 90, |x, y| {
            let (u, v) = (f64::from(x + by) / 9.0, f64::from(y) / 11.0);
            let level = |phase: f64| (120.0 + 60.0 * (u + phase).sin() + 50.0 * v.cos()) as u8;
            Rgb([level(0.0), level(0.9), level(2.4)])
        })
    }

    /// The photograph shifted by a pixel, with other pixels where `of` gives a colour.
    fn told(of: impl Fn(u32, u32) -> Option<[u8; 3]>) -> Option<PictureChange> {
        let mut shown = photograph(1);
        for (x, y, pixel) in shown.enumerate_pixels_mut() {
            *pixel = of(x, y).map_or(*pixel, Rgb);
        }
        layout_change(&photograph(0), &shown)
    }

    #[test]
    fn padding_margins_and_missing_rows_are_told() {
        let black = |is: bool| is.then_some([0; 3]);
        let white = |is: bool| is.then_some([255; 3]);
        assert_eq!(
            told(|_, y| black(!(9..81).contains(&y))),
            Some(PictureChange::Bars)
        );
        assert_eq!(
            told(|x, _| white(!(9..111).contains(&x))),
            Some(PictureChange::Bars)
        );
        let margin = |x, y| !(12..108).contains(&x) || !(9..80).contains(&y);
        assert_eq!(
            told(|x, y| white(margin(x, y))),
            Some(PictureChange::Framed)
        );
        assert_eq!(
            told(|_, y| (y > 50).then_some([128; 3])),
            Some(PictureChange::Unfinished)
        );
        let other = photograph(25);
        let every_second = |x, y| (y % 2 == 1).then(|| other.get_pixel(x, y).0);
        assert_eq!(told(every_second), Some(PictureChange::Interlaced));
        assert_eq!(
            told(|_, y| black(y % 2 == 1)),
            Some(PictureChange::Interlaced)
        );
    }

    #[test]
    fn a_repeated_row_is_told() {
        let own = photograph(1);
        let row = |is: bool, x: u32| is.then(|| own.get_pixel(x, 65).0);
        let repeated = Some(PictureChange::RepeatedRow);
        assert_eq!(told(|x, y| row(y > 65, x)), repeated);
        assert_eq!(told(|x, y| row((30..50).contains(&y), x)), repeated);
        // Few rows, columns, holes, and a wall without texture that the photograph has, too.
        for proper in [
            told(|x, y| row(y > 75, x)),
            told(|x, y| (x > 80).then(|| own.get_pixel(80, y).0)),
            told(|_, y| (30..60).contains(&y).then_some([0; 3])),
        ] {
            assert_eq!(proper, None);
        }
        let wall = |of: RgbImage| RgbImage::from_fn(120, 90, |x, y| *of.get_pixel(x, y.min(50)));
        assert_eq!(layout_change(&wall(photograph(0)), &wall(own)), None);
    }

    #[test]
    fn strips_along_one_side_are_told() {
        let strip = |told: Option<PictureChange>| match told {
            Some(PictureChange::Strip(thickness)) => thickness,
            other => panic!("{other:?}"),
        };
        let colour = |is: bool, level: u8| is.then_some([level; 3]);
        assert_eq!(strip(told(|_, y| colour(y < 9, 255))), [100, 0]);
        assert_eq!(strip(told(|_, y| colour(y > 80, 0))), [0, 100]);
        // An edge that follows the scene, two sides, and one line.
        for proper in [
            told(|x, y| colour(y < 9 + x % 5, 255)),
            told(|x, y| colour(y < 9 || x < 9, 255)),
            told(|_, y| colour(y < 1, 255)),
            told(|x, _| colour(x >= 114, 255)),
        ] {
            assert_eq!(proper, None);
        }
    }

    #[test]
    fn pictures_enlarged_by_repeating_pixels_are_told() {
        use image::imageops::{FilterType, resize};
        for size in [(30, 22), (45, 40), (80, 60)] {
            let small = resize(&photograph(1), size.0, size.1, FilterType::Triangle);
            let again = |filter| resize(&small, 120, 90, filter);
            let told = |shown: &RgbImage| layout_change(&photograph(0), shown);
            assert_eq!(
                told(&again(FilterType::Nearest)),
                Some(PictureChange::Blocks)
            );
            assert_eq!(told(&again(FilterType::Triangle)), None);
            // The photograph was enlarged, too.
            let blocks = again(FilterType::Nearest);
            assert_eq!(layout_change(&blocks, &blocks), None);
        }
    }

    #[test]
    fn holes_and_patterns_are_not() {
        let black = |is: bool| is.then_some([0; 3]);
        for proper in [
            told(|_, _| None),
            told(|x, _| black(x < 20)),
            told(|x, y| black(!(12..108).contains(&x) || !(9..80).contains(&y))),
            told(|x, y| black(y > 60 + x / 8)),
            told(|x, y| ((x + y) % 2 == 1).then_some([120; 3])),
            told(|_, _| Some([90; 3])),
            told(|_, _| Some([0; 3])),
        ] {
            assert_eq!(proper, None);
        }
        // The photograph has the bars, too.
        let mut seen = photograph(0);
        for (_, y, pixel) in seen.enumerate_pixels_mut() {
            if !(9..81).contains(&y) {
                *pixel = Rgb([0; 3]);
            }
        }
        assert_eq!(layout_change(&seen, &seen), None);
    }
}
