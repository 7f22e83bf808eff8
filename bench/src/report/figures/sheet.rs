//! Pictures in rows and columns, with text below them and parts of them enlarged.

use image::{Rgb, RgbImage, imageops};

use crate::report::error::MissingPicture;
use crate::report::pictures::{fitted, reduced};
use crate::report::plots::canvas::{INK, Ink, MUTED};
use crate::report::plots::palette::COLOURS;
use crate::report::plots::style::FigureStyle;
use crate::report::plots::text::{self, Weight};
use crate::scoring::Region;

/// Sizes of a sheet in pixels.
#[derive(Debug, Clone, PartialEq)]
pub struct SheetMedium {
    /// Longest side of a picture.
    pub tile: u32,
    /// Whether smaller pictures are enlarged to it.
    pub grows: bool,
    pub gap: u32,
    pub margin: u32,
    /// Font size of heads, and of what is below pictures.
    pub font: f64,
    pub small: f64,
    pub dpi: f64,
    /// Of boxes around enlarged parts, in turn.
    pub colours: Vec<Ink>,
}

impl SheetMedium {
    /// In a report.
    pub fn screen() -> Self {
        Self {
            tile: 440,
            grows: false,
            gap: 10,
            margin: 16,
            font: 25.0,
            small: 20.0,
            dpi: 192.0,
            colours: COLOURS.into(),
        }
    }

    /// In print: so many columns share the figure's width, which has no margin.
    pub fn print(style: &FigureStyle, columns: usize) -> Self {
        let gap = (style.font_pixels() * 0.25).round().max(1.0) as u32;
        let columns = u32::try_from(columns.max(1)).unwrap_or(u32::MAX);
        let room = style
            .pixels()
            .saturating_sub(gap.saturating_mul(columns - 1));
        Self {
            tile: (room / columns).max(8),
            grows: true,
            gap,
            margin: 0,
            font: style.font_pixels(),
            small: style.font_pixels() * 0.85,
            dpi: style.dpi,
            colours: style.colours.clone(),
        }
    }
}

/// A picture or the reason why there is none, and the text below.
pub struct Tile {
    pub picture: Result<RgbImage, MissingPicture>,
    pub text: String,
    /// Parts that are framed and shown enlarged below the picture; those outside it are left out.
    pub crops: Vec<Region>,
}

impl Tile {
    pub fn new(picture: Result<RgbImage, MissingPicture>, text: impl Into<String>) -> Self {
        Self {
            picture,
            text: text.into(),
            crops: Vec::new(),
        }
    }
}

/// Rows of tiles under heads.
#[derive(Default)]
pub struct Sheet {
    /// Over the columns; none where all are empty.
    pub heads: Vec<String>,
    /// What stands left over each row, and its tiles.
    pub rows: Vec<(String, Vec<Tile>)>,
}

/// A tile as it is drawn.
struct Drawn {
    pictures: Vec<RgbImage>,
    lines: Vec<String>,
}

impl Sheet {
    /// How many columns there are.
    pub fn columns(&self) -> usize {
        let rows = self.rows.iter().map(|(_, tiles)| tiles.len());
        rows.max().unwrap_or(0).max(self.heads.len())
    }

    /// The sheet as a picture; `None` without any picture in it.
    pub fn draw(&self, medium: &SheetMedium) -> Option<RgbImage> {
        let pictures = self.rows.iter().flat_map(|(_, tiles)| tiles);
        if !pictures.clone().any(|tile| tile.picture.is_ok()) {
            return None;
        }
        let rows: Vec<(&str, Vec<Drawn>)> = self
            .rows
            .iter()
            .map(|(label, tiles)| {
                let drawn = tiles.iter().map(|tile| drawn(tile, medium));
                (label.as_str(), drawn.collect())
            })
            .collect();
        let gap = medium.gap;
        let line = |size: f64| (size * 1.3).round() as u32;
        let of_row = |(label, tiles): &(&str, Vec<Drawn>)| {
            let pictures = tiles
                .iter()
                .map(|tile| stacked(tile, gap))
                .max()
                .unwrap_or(0);
            let lines = tiles.iter().map(|tile| tile.lines.len()).max().unwrap_or(0) as u32;
            let label = if label.is_empty() {
                0
            } else {
                line(medium.font)
            };
            (label, pictures, lines * line(medium.small))
        };
        let head = match self.heads.iter().all(String::is_empty) {
            true => 0,
            false => line(medium.font) + gap,
        };
        let heights = rows.iter().map(of_row);
        let total: u32 = heights.map(|(a, b, c)| a + b + c + 2 * gap).sum();
        let columns = self.columns() as u32;
        let column = medium.tile;
        let mut sheet = RgbImage::from_pixel(
            2 * medium.margin + columns * (column + gap) - gap,
            2 * medium.margin + head + total - gap,
            Rgb([255; 3]),
        );
        let left = |at: usize| medium.margin + at as u32 * (column + gap);
        let fit =
            |text: &str, size, weight, room: u32| text::fitted(text, size, weight, f64::from(room));
        for (at, label) in self.heads.iter().enumerate() {
            let label = fit(label, medium.font, Weight::Bold, column);
            let place = (left(at), medium.margin + (medium.font * 0.95) as u32);
            text::write(&mut sheet, &label, place, medium.font, Weight::Bold, INK);
        }
        let mut top = medium.margin + head;
        for row in &rows {
            let (label_height, pictures, texts) = of_row(row);
            let label = fit(row.0, medium.font, Weight::Bold, columns * column);
            let place = (left(0), top + (medium.font * 0.95) as u32);
            text::write(&mut sheet, &label, place, medium.font, Weight::Bold, INK);
            top += label_height;
            for (at, tile) in row.1.iter().enumerate() {
                paste(&mut sheet, tile, (left(at), top), gap);
                for (text, k) in tile.lines.iter().zip(1_u32..) {
                    let place = (left(at), top + pictures + k * line(medium.small));
                    text::write(
                        &mut sheet,
                        text,
                        place,
                        medium.small,
                        Weight::Regular,
                        MUTED,
                    );
                }
            }
            top += pictures + texts + 2 * gap;
        }
        Some(sheet)
    }
}

/// The picture, its enlarged parts side by side below it.
fn paste(sheet: &mut RgbImage, tile: &Drawn, (left, top): (u32, u32), gap: u32) {
    let Some((picture, parts)) = tile.pictures.split_first() else {
        return;
    };
    imageops::replace(sheet, picture, i64::from(left), i64::from(top));
    let (mut x, y) = (left, top + picture.height() + gap);
    for part in parts {
        imageops::replace(sheet, part, i64::from(x), i64::from(y));
        x += part.width() + gap;
    }
}

/// Height of a tile's pictures.
fn stacked(tile: &Drawn, gap: u32) -> u32 {
    let Some((picture, parts)) = tile.pictures.split_first() else {
        return 0;
    };
    let parts = parts.iter().map(|part| part.height() + gap).max();
    picture.height() + parts.unwrap_or(0)
}

fn drawn(tile: &Tile, medium: &SheetMedium) -> Drawn {
    let room = f64::from(medium.tile);
    let lines = |text: &str| text::wrapped(text, medium.small, Weight::Regular, room);
    let picture = match &tile.picture {
        Ok(picture) => picture,
        Err(reason) => {
            return Drawn {
                pictures: Vec::new(),
                lines: lines(&reason.to_string()),
            };
        }
    };
    let mut shown = scaled(picture, medium.tile, medium.grows);
    let share = f64::from(shown.width()) / f64::from(picture.width().max(1));
    let crops = tile.crops.iter();
    let crops: Vec<&Region> = crops
        .filter(|crop| crop.fits(picture.dimensions()))
        .collect();
    let n = crops.len().max(1) as u32;
    let width = (shown.width().saturating_sub((n - 1) * medium.gap) / n).max(1);
    let frame = (medium.font * 0.09).round().max(2.0) as u32;
    let mut parts = Vec::new();
    for (crop, ink) in crops.iter().zip(medium.colours.iter().cycle()) {
        let part = imageops::crop_imm(picture, crop.x, crop.y, crop.width, crop.height).to_image();
        let height = f64::from(width) * f64::from(crop.height) / f64::from(crop.width);
        // Larger pixels stay pixels: nothing is smoothed over.
        let filter = match width > crop.width {
            true => imageops::FilterType::Nearest,
            false => imageops::FilterType::Triangle,
        };
        let mut part = imageops::resize(&part, width, (height.round() as u32).max(1), filter);
        let whole = (0, 0, part.width(), part.height());
        outline(&mut part, whole, frame, *ink);
        parts.push(part);
        let at = |v: u32| (f64::from(v) * share).round() as u32;
        let place = (at(crop.x), at(crop.y), at(crop.width), at(crop.height));
        outline(&mut shown, place, frame, *ink);
    }
    Drawn {
        pictures: std::iter::once(shown).chain(parts).collect(),
        lines: lines(&tile.text),
    }
}

fn scaled(picture: &RgbImage, side: u32, grows: bool) -> RgbImage {
    let longest = picture.width().max(picture.height());
    if !grows || longest >= side || longest == 0 {
        return reduced(picture, side);
    }
    // As `fitted` would shrink a picture of the same shape.
    let factor = side.div_ceil(longest);
    let (width, height) = fitted((picture.width() * factor, picture.height() * factor), side);
    imageops::resize(picture, width, height, imageops::FilterType::Triangle)
}

/// A frame within a picture's `(x, y, width, height)`.
fn outline(picture: &mut RgbImage, (x, y, w, h): (u32, u32, u32, u32), thick: u32, ink: Ink) {
    let colour = Rgb::from(ink);
    let (right, bottom) = ((x + w).min(picture.width()), (y + h).min(picture.height()));
    for v in y..bottom {
        for u in x..right {
            let edge = u < x + thick || v < y + thick || u + thick >= right || v + thick >= bottom;
            if edge {
                picture.put_pixel(u, v, colour);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn medium() -> SheetMedium {
        SheetMedium {
            tile: 100,
            grows: true,
            gap: 4,
            margin: 0,
            font: 20.0,
            small: 10.0,
            dpi: 300.0,
            colours: vec![Ink::opaque(255, 0, 0)],
        }
    }

    #[test]
    fn a_part_is_framed_and_shown_enlarged_below() {
        let mut picture = RgbImage::from_pixel(50, 25, Rgb([10; 3]));
        picture.put_pixel(22, 12, Rgb([200; 3]));
        let mut tile = Tile::new(Ok(picture), "");
        let crop = |x, y, width, height| Region {
            x,
            y,
            width,
            height,
        };
        // The second reaches out of the picture.
        tile.crops = vec![crop(20, 10, 10, 5), crop(45, 0, 10, 5)];
        let sheet = Sheet {
            heads: Vec::new(),
            rows: vec![(String::new(), vec![tile])],
        };
        let drawn = sheet.draw(&medium()).unwrap();
        // Twice as large, and the part ten times.
        assert_eq!(drawn.dimensions(), (100, 50 + 4 + 50 + 4));
        assert_eq!(drawn.get_pixel(40, 20), &Rgb([255, 0, 0]));
        assert_eq!(drawn.get_pixel(39, 19), &Rgb([10; 3]));
        assert_eq!(drawn.get_pixel(59, 29), &Rgb([255, 0, 0]));
        assert_eq!(drawn.get_pixel(25, 54 + 25), &Rgb([200; 3]));
        assert_eq!(drawn.get_pixel(0, 54), &Rgb([255, 0, 0]));
        assert_eq!(drawn.get_pixel(97, 51), &Rgb([255; 3]));
    }

    #[test]
    fn without_a_picture_there_is_no_sheet() {
        let missing = || Tile::new(Err(MissingPicture::NotKept), "");
        let sheet = Sheet {
            heads: vec!["a".into()],
            rows: vec![("r".into(), vec![missing(), missing()])],
        };
        assert_eq!(sheet.columns(), 2);
        assert!(sheet.draw(&medium()).is_none());
        assert!(Sheet::default().draw(&medium()).is_none());
    }

    #[test]
    fn a_print_is_as_wide_as_its_style_says() {
        let style = FigureStyle::default();
        let tile = || Tile::new(Ok(RgbImage::new(40, 30)), "text");
        let sheet = Sheet {
            heads: vec!["<a>".into(), "b".into(), "c".into()],
            rows: vec![("row".into(), vec![tile(), tile(), tile()])],
        };
        let width = sheet.draw(&SheetMedium::print(&style, 3)).unwrap().width();
        // 992 pixels, less what does not divide by three.
        assert!((990..=992).contains(&width), "{width}");
    }
}
