//! Draws a sheet: places its pictures, frames and lines of text, and writes its files.

use std::path::{Path, PathBuf};

use image::{Rgb, RgbImage, imageops};
use sharp_plots::canvas::{Anchor, Lettering, Surface};
use sharp_plots::ink::{INK, Ink, MUTED, PAPER};
use sharp_plots::style::{FigureStyle, Medium};
use sharp_plots::text::{self, Weight};
use sharp_plots::{Drawing, Figure, PlotError, png};

use super::sheet::{Sheet, SheetMedium, Tile};
use crate::io::atomic_files::write_all_over_own;
use crate::report::error::ReportError;
use crate::report::pictures::fitted;
use crate::report::plots::files;
use crate::scoring::Region;

/// Maximum number of lines in the head of a column.
const HEAD_LINES: usize = 2;
/// Maximum number of lines in the reason for a missing picture.
const REASON_LINES: usize = 12;

struct DrawnTile {
    pictures: Vec<Shown>,
    lines: Vec<String>,
}

/// A picture and its displayed size, in pixels of the sheet.
struct Shown {
    picture: RgbImage,
    size: (u32, u32),
    /// Whether enlarging interpolates between pixels.
    is_smooth: bool,
    /// Rectangles `(x, y, width, height)` drawn on the picture.
    frames: Vec<((u32, u32, u32, u32), Ink)>,
}

/// A line of text, and the start of its baseline.
struct Line {
    text: String,
    at: (u32, u32),
    size: f64,
    weight: Weight,
    ink: Ink,
}

/// A laid-out sheet, in pixels.
struct Layout {
    size: (u32, u32),
    pictures: Vec<(Shown, (u32, u32))>,
    lines: Vec<Line>,
    frame: u32,
}

impl Sheet {
    /// Writes the sheet in print quality as SVG, PNG and PDF. SVG and PDF embed the pictures at their own resolution.
    ///
    /// # Errors
    /// If it has no picture, its columns are too narrow for text, or a file cannot be written, or exists and was not
    /// written by this program.
    pub fn write(
        &self,
        out: &Path,
        stem: &str,
        style: &FigureStyle,
    ) -> Result<Vec<PathBuf>, ReportError> {
        let failed = |reason: String| PlotError::new(stem, reason);
        let medium = SheetMedium::print(style, self.columns()).map_err(failed)?;
        let layout = self.layout(&medium).ok_or_else(|| {
            let reason = self.problems().into_iter().next();
            let reason = reason.unwrap_or_else(|| "no pair".to_owned());
            failed(format!("there is no picture to show ({reason})"))
        })?;
        let png = png::encode(&layout.raster(), medium.dpi);
        let print = Medium {
            zoom: 96.0 / medium.dpi,
            dpi: medium.dpi,
            paper: PAPER,
        };
        let drawing = Drawing::new(stem, layout.size, print, |surface| layout.paint(surface));
        let figure = Figure {
            title: stem.to_owned(),
            svg: drawing.svg()?,
            png: png.map_err(|error| failed(error.to_string()))?,
            pdf: drawing.pdf()?,
        };
        let paths = write_all_over_own(&files(figure, out, stem))?;
        Ok(paths)
    }

    /// The sheet as PNG; `None` if it has no picture.
    ///
    /// # Errors
    /// If it cannot be encoded.
    pub fn png(&self, medium: &SheetMedium) -> Result<Option<Vec<u8>>, ReportError> {
        let bytes = self
            .draw(medium)
            .map(|picture| png::encode(&picture, medium.dpi));
        let failed = |error| PlotError::new("a sheet of pictures", error).into();
        bytes.transpose().map_err(failed)
    }

    /// Draws the sheet; `None` if it has no picture.
    pub fn draw(&self, medium: &SheetMedium) -> Option<RgbImage> {
        Some(self.layout(medium)?.raster())
    }

    /// Places the pictures and texts of the sheet; `None` if no tile has a picture.
    fn layout(&self, medium: &SheetMedium) -> Option<Layout> {
        if !self.tiles().any(|tile| tile.picture.is_ok()) {
            return None;
        }
        let rows: Vec<(&str, Vec<DrawnTile>)> = self
            .rows
            .iter()
            .map(|(label, tiles)| {
                let drawn = tiles.iter().map(|tile| drawn(tile, medium));
                (label.as_str(), drawn.collect())
            })
            .collect();
        let gap = medium.gap;
        let line = |size: f64| (size * 1.3).round() as u32;
        let of_row = |(label, tiles): &(&str, Vec<DrawnTile>)| {
            let pictures = tiles.iter().map(|tile| stacked(tile, gap));
            let pictures = pictures.max().unwrap_or(0);
            let below = tiles.iter().map(|tile| {
                let lines = tile.lines.len() as u32 * line(medium.small);
                text_top(tile, pictures) + lines
            });
            let label = if label.is_empty() {
                0
            } else {
                line(medium.font)
            };
            (label, pictures, below.max().unwrap_or(pictures))
        };
        let columns = self.columns() as u32;
        let column = medium.tile;
        let heads: Vec<Vec<String>> = self
            .heads
            .iter()
            .map(|head| {
                let room = f64::from(column);
                text::wrapped_to(HEAD_LINES, head, medium.font, Weight::Bold, room)
            })
            .collect();
        let head = match heads.iter().map(Vec::len).max().unwrap_or(0) as u32 {
            0 => 0,
            lines => lines * line(medium.font) + gap,
        };
        let heights = rows.iter().map(of_row);
        let total: u32 = heights
            .map(|(label, _, tiles)| label + tiles + 2 * gap)
            .sum();
        let size = (
            2 * medium.margin + columns * (column + gap) - gap,
            2 * medium.margin + head + total - gap,
        );
        let (mut pictures, mut texts) = (Vec::new(), Vec::new());
        let left = |at: usize| medium.margin + at as u32 * (column + gap);
        let bold = |text: &str, (x, top): (u32, u32)| Line {
            text: text.to_owned(),
            at: (x, top + (medium.font * 0.95) as u32),
            size: medium.font,
            weight: Weight::Bold,
            ink: INK,
        };
        for (at, lines) in heads.iter().enumerate() {
            for (text, k) in lines.iter().zip(0_u32..) {
                let top = medium.margin + k * line(medium.font);
                texts.push(bold(text, (left(at), top)));
            }
        }
        let mut top = medium.margin + head;
        for row in rows {
            let (label_height, below_pictures, height) = of_row(&row);
            let room = f64::from(columns * column);
            let label = text::fitted(row.0, medium.font, Weight::Bold, room);
            texts.push(bold(&label, (left(0), top)));
            top += label_height;
            for (at, tile) in row.1.into_iter().enumerate() {
                let text_top = text_top(&tile, below_pictures);
                for (text, k) in tile.lines.iter().zip(1_u32..) {
                    texts.push(Line {
                        text: text.clone(),
                        at: (left(at), top + text_top + k * line(medium.small)),
                        size: medium.small,
                        weight: Weight::Regular,
                        ink: MUTED,
                    });
                }
                // Enlarged parts are side by side below the picture.
                let (mut x, mut y) = (left(at), top);
                for (k, shown) in tile.pictures.into_iter().enumerate() {
                    let (width, height) = shown.size;
                    pictures.push((shown, (x, y)));
                    match k {
                        0 => y += height + gap,
                        _ => x += width + gap,
                    }
                }
            }
            top += height + 2 * gap;
        }
        Some(Layout {
            size,
            pictures,
            lines: texts,
            frame: medium.frame(),
        })
    }
}

impl Layout {
    fn raster(&self) -> RgbImage {
        let mut sheet = RgbImage::from_pixel(self.size.0, self.size.1, Rgb([255; 3]));
        for (shown, (x, y)) in &self.pictures {
            let mut picture = shown.raster();
            for (place, ink) in &shown.frames {
                outline(&mut picture, *place, self.frame, *ink);
            }
            imageops::replace(&mut sheet, &picture, i64::from(*x), i64::from(*y));
        }
        for line in &self.lines {
            let Line { text, at, size, .. } = line;
            text::write(&mut sheet, text, *at, *size, line.weight, line.ink);
        }
        sheet
    }

    fn paint(&self, surface: &mut Surface) {
        let point = |(x, y): (u32, u32)| (f64::from(x), f64::from(y));
        let width = f64::from(self.frame);
        for (shown, at) in &self.pictures {
            surface.picture(shown.picture.clone(), point(*at), point(shown.size));
        }
        for (shown, at) in &self.pictures {
            for ((x, y, w, h), ink) in &shown.frames {
                // Inset the line by half its width, so that it stays inside the rectangle.
                let (x, y) = point((at.0 + x, at.1 + y));
                let (left, top) = (x + width / 2.0, y + width / 2.0);
                let (right, bottom) = (left + f64::from(*w) - width, top + f64::from(*h) - width);
                let corners = [
                    (left, top),
                    (right, top),
                    (right, bottom),
                    (left, bottom),
                    (left, top),
                    (right, top),
                ];
                surface.line(&corners, width, *ink);
            }
        }
        for line in &self.lines {
            let lettering = Lettering {
                weight: line.weight,
                ..Lettering::new(line.size, line.ink, Anchor::Start)
            };
            surface.text(&line.text, point(line.at), lettering);
        }
    }
}

impl Shown {
    /// The picture at its shown size.
    fn raster(&self) -> RgbImage {
        let (width, height) = self.size;
        if self.size == self.picture.dimensions() {
            return self.picture.clone();
        }
        let filter = if width > self.picture.width() && !self.is_smooth {
            imageops::FilterType::Nearest
        } else {
            imageops::FilterType::Triangle
        };
        imageops::resize(&self.picture, width, height, filter)
    }
}

fn stacked(tile: &DrawnTile, gap: u32) -> u32 {
    let Some((picture, parts)) = tile.pictures.split_first() else {
        return 0;
    };
    let parts = parts.iter().map(|part| part.size.1 + gap).max();
    picture.size.1 + parts.unwrap_or(0)
}

/// Vertical offset of a tile's text: below the row's pictures (`pictures`), or 0 if the picture is missing.
fn text_top(tile: &DrawnTile, pictures: u32) -> u32 {
    if tile.pictures.is_empty() {
        0
    } else {
        pictures
    }
}

fn drawn(tile: &Tile, medium: &SheetMedium) -> DrawnTile {
    let (room, small) = (f64::from(medium.tile), medium.small);
    let picture = match &tile.picture {
        Ok(picture) => picture,
        Err(reason) => {
            return DrawnTile {
                pictures: Vec::new(),
                lines: text::wrapped_to(
                    REASON_LINES,
                    &reason.to_string(),
                    small,
                    Weight::Regular,
                    room,
                ),
            };
        }
    };
    let size = size_of(picture, medium.tile, medium.grows);
    let share = f64::from(size.0) / f64::from(picture.width().max(1));
    let crops = tile.crops.iter();
    let crops: Vec<&Region> = crops
        .filter(|crop| crop.fits(picture.dimensions()))
        .collect();
    let n = crops.len().max(1) as u32;
    let width = (size.0.saturating_sub((n - 1) * medium.gap) / n).max(1);
    let (mut frames, mut parts) = (Vec::new(), Vec::new());
    for (crop, ink) in crops.iter().zip(medium.colours.iter().cycle()) {
        let part = crop.part_of(picture);
        let height = f64::from(width) * f64::from(crop.height) / f64::from(crop.width);
        let size = (width, (height.round() as u32).max(1));
        parts.push(Shown {
            picture: part,
            size,
            is_smooth: false,
            frames: vec![((0, 0, size.0, size.1), *ink)],
        });
        let at = |v: u32| (f64::from(v) * share).round() as u32;
        let place = (at(crop.x), at(crop.y), at(crop.width), at(crop.height));
        frames.push((place, *ink));
    }
    let shown = Shown {
        picture: picture.clone(),
        size,
        is_smooth: true,
        frames,
    };
    DrawnTile {
        pictures: std::iter::once(shown).chain(parts).collect(),
        lines: text::wrapped(&tile.text, small, Weight::Regular, room),
    }
}

/// The displayed size of a picture.
fn size_of(picture: &RgbImage, side: u32, grows: bool) -> (u32, u32) {
    let (width, height) = picture.dimensions();
    let longest = width.max(height);
    if !grows || longest >= side || longest == 0 {
        return fitted((width, height), side);
    }
    // Scale up first, so that `fitted` rounds as it does for larger pictures of this shape.
    let factor = side.div_ceil(longest);
    fitted((width * factor, height * factor), side)
}

/// Draws a frame inside the rectangle `(x, y, width, height)` of a picture.
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
    use sharp_tests::holds;

    use super::*;
    use crate::report::error::MissingPicture;

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
        let mut tile = Tile::new("p, m", Ok(picture), "");
        let crop = |x, y, width, height| Region {
            x,
            y,
            width,
            height,
        };
        // The second part extends beyond the picture.
        tile.crops = vec![crop(20, 10, 10, 5), crop(45, 0, 10, 5)];
        let sheet = Sheet {
            heads: Vec::new(),
            rows: vec![(String::new(), vec![tile])],
        };
        assert_eq!(
            sheet.problems(),
            ["p, m: the part 45,0,10,5 extends beyond its 50 × 25 pixels"]
        );
        let drawn = sheet.draw(&medium()).unwrap();
        // The picture is enlarged by 2, the part by 10.
        assert_eq!(drawn.dimensions(), (100, 50 + 4 + 50 + 4));
        assert_eq!(drawn.get_pixel(40, 20), &Rgb([255, 0, 0]));
        assert_eq!(drawn.get_pixel(39, 19), &Rgb([10; 3]));
        assert_eq!(drawn.get_pixel(59, 29), &Rgb([255, 0, 0]));
        assert_eq!(drawn.get_pixel(25, 54 + 25), &Rgb([200; 3]));
        assert_eq!(drawn.get_pixel(0, 54), &Rgb([255, 0, 0]));
        assert_eq!(drawn.get_pixel(97, 51), &Rgb([255; 3]));
    }

    #[test]
    fn vector_files_contain_the_pictures_own_pixels() {
        let picture = RgbImage::from_pixel(50, 25, Rgb([10, 20, 30]));
        let mut tile = Tile::new("", Ok(picture), "0.1234");
        tile.crops = vec![Region {
            x: 20,
            y: 10,
            width: 10,
            height: 5,
        }];
        let sheet = Sheet {
            heads: vec!["<a>".into()],
            rows: vec![(String::new(), vec![tile])],
        };
        let dir = tempfile::tempdir().unwrap();
        let files = sheet
            .write(dir.path(), "s", &FigureStyle::default())
            .unwrap();
        let names = files
            .iter()
            .map(|file| file.file_name().unwrap().to_str().unwrap());
        assert_eq!(names.collect::<Vec<_>>(), ["s.svg", "s.png", "s.pdf"]);
        let svg = std::fs::read_to_string(&files[0]).unwrap();
        let images = svg.split("base64,").skip(1);
        let sizes = images.map(|image| {
            let data = image.split('"').next().unwrap();
            let png = base64::Engine::decode(&base64::engine::general_purpose::STANDARD, data);
            image::load_from_memory(&png.unwrap())
                .unwrap()
                .to_rgb8()
                .dimensions()
        });
        assert_eq!(sizes.collect::<Vec<_>>(), [(50, 25), (10, 5)]);
        assert!(svg.contains(">0.1234") || svg.contains("0.1234\n"), "{svg}");
        // A frame on the picture and one on the enlarged part, each with five points, so that its last corner is
        // closed.
        assert_eq!(svg.matches("<polyline").count(), 2);
    }

    #[test]
    fn without_a_picture_there_is_no_sheet() {
        let missing = || Tile::new("p, m", Err(MissingPicture::NotKept), "");
        let sheet = Sheet {
            heads: vec!["a".into()],
            rows: vec![("r".into(), vec![missing(), missing()])],
        };
        assert_eq!(sheet.columns(), 2);
        assert!(sheet.draw(&medium()).is_none());
        assert!(Sheet::default().draw(&medium()).is_none());
        assert_eq!(sheet.problems(), ["p, m: the prediction was not kept"; 2]);
        let dir = tempfile::tempdir().unwrap();
        let style = FigureStyle::default();
        let error = sheet.write(dir.path(), "s", &style).unwrap_err();
        holds(&error.to_string(), &["(p, m: the prediction was not kept)"]);
    }

    #[test]
    fn all_text_lies_in_its_column() {
        let reason = "no_space/".repeat(40);
        let tiles = vec![
            Tile::new(
                "",
                Ok(RgbImage::from_pixel(40, 30, Rgb([255; 3]))),
                "0.1234 ".repeat(9),
            ),
            Tile::new("", Err(MissingPicture::Failed(reason)), ""),
            Tile::new("", Ok(RgbImage::from_pixel(40, 30, Rgb([255; 3]))), ""),
        ];
        let mut sheet = Sheet {
            heads: vec![
                "short".into(),
                "a-head-that-is-much-too-long-for-it".into(),
                String::new(),
            ],
            rows: vec![(String::new(), tiles)],
        };
        let drawn = sheet.draw(&medium()).unwrap();
        let is_empty = |x: std::ops::Range<u32>| {
            let mut pixels = x.flat_map(|x| (0..drawn.height()).map(move |y| (x, y)));
            pixels.all(|(x, y)| drawn.get_pixel(x, y) == &Rgb([255; 3]))
        };
        assert!(!is_empty(0..100) && !is_empty(104..204));
        assert!(is_empty(205..308), "text runs into the next column");
        // A head of two lines increases the sheet's height by one line; a longer head adds no more.
        let height = drawn.height();
        sheet.heads[1] = "a-head ".repeat(2);
        assert_eq!(sheet.draw(&medium()).unwrap().height(), height);
        sheet.heads[1].clear();
        assert_eq!(sheet.draw(&medium()).unwrap().height(), height - 26);
    }

    #[test]
    fn a_print_is_as_wide_as_its_style_says() {
        let style = FigureStyle::default();
        let tile = || Tile::new("", Ok(RgbImage::new(40, 30)), "text");
        let sheet = Sheet {
            heads: vec!["<a>".into(), "b".into(), "c".into()],
            rows: vec![("row".into(), vec![tile(), tile(), tile()])],
        };
        let medium = SheetMedium::print(&style, 3).unwrap();
        let width = sheet.draw(&medium).unwrap().width();
        // 992 pixels, less the remainder of the division by three.
        assert!((990..=992).contains(&width), "{width}");
        assert!(SheetMedium::print(&style, 9).is_ok());
        let error = SheetMedium::print(&style, 10).unwrap_err();
        holds(&error, &["10 columns", "width_mm of 91"]);
    }
}
