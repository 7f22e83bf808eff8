//! Sheets: pictures in rows and columns, with text and enlarged parts below them.

use image::RgbImage;
use sharp_plots::ink::Ink;
use sharp_plots::palette::COLOURS;
use sharp_plots::style::FigureStyle;

use crate::report::error::MissingPicture;
use crate::scoring::Region;

/// Minimum width of a printed column in multiples of the font size, so that a score with four
/// decimals fits.
const MIN_EMS: f64 = 3.0;

/// Sizes of a sheet in pixels.
#[derive(Debug, Clone, PartialEq)]
pub struct SheetMedium {
    /// Longest side of a picture.
    pub tile: u32,
    /// Whether pictures that are smaller than `tile` are enlarged to it.
    pub grows: bool,
    pub gap: u32,
    pub margin: u32,
    /// Font size of heads; `small` is the font size of the text below pictures.
    pub font: f64,
    pub small: f64,
    pub dpi: f64,
    /// Colours of boxes around enlarged parts, used in turn.
    pub colours: Vec<Ink>,
}

impl SheetMedium {
    /// Sizes for a report on a screen.
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

    /// Sizes for print. `columns` columns share the figure's width; there is no margin.
    ///
    /// # Errors
    /// A message if text does not fit into the columns.
    pub fn print(style: &FigureStyle, columns: usize) -> Result<Self, String> {
        let gap = (style.font_pixels() * 0.25).round().max(1.0) as u32;
        let columns = u32::try_from(columns.max(1)).unwrap_or(u32::MAX);
        let room = style
            .pixels()
            .saturating_sub(gap.saturating_mul(columns - 1));
        let tile = room / columns;
        let least = (MIN_EMS * style.font_pixels()).ceil();
        if f64::from(tile) < least {
            let needed = f64::from(columns) * least + f64::from(gap) * f64::from(columns - 1);
            let reason = style.narrow(needed / f64::from(style.pixels()));
            return Err(format!("{columns} columns: {reason}"));
        }
        Ok(Self {
            tile,
            grows: true,
            gap,
            margin: 0,
            font: style.font_pixels(),
            small: style.font_pixels() * 0.85,
            dpi: style.dpi,
            colours: style.colours.clone(),
        })
    }
}

impl SheetMedium {
    pub(super) fn frame(&self) -> u32 {
        (self.font * 0.09).round().max(2.0) as u32
    }
}

/// A picture, or the reason why it is missing, and the text below it.
pub struct Tile {
    /// Name in messages about the tile.
    pub name: String,
    pub picture: Result<RgbImage, MissingPicture>,
    pub text: String,
    /// Parts that are framed in the picture and shown enlarged below it. Parts that extend beyond the picture are left
    /// out.
    pub crops: Vec<Region>,
}

impl Tile {
    pub fn new(
        name: impl Into<String>,
        picture: Result<RgbImage, MissingPicture>,
        text: impl Into<String>,
    ) -> Self {
        Self {
            name: name.into(),
            picture,
            text: text.into(),
            crops: Vec::new(),
        }
    }
}

/// Rows of tiles under heads.
#[derive(Default)]
pub struct Sheet {
    /// Column heads; may be empty.
    pub heads: Vec<String>,
    /// Label above each row, and its tiles.
    pub rows: Vec<(String, Vec<Tile>)>,
}

impl Sheet {
    pub fn columns(&self) -> usize {
        let rows = self.rows.iter().map(|(_, tiles)| tiles.len());
        rows.max().unwrap_or(0).max(self.heads.len())
    }

    pub(super) fn tiles(&self) -> impl Iterator<Item = &Tile> {
        self.rows.iter().flat_map(|(_, tiles)| tiles)
    }

    /// Missing pictures, and parts that extend beyond their picture, one line each.
    pub fn problems(&self) -> Vec<String> {
        let of_tile = |tile: &Tile| match &tile.picture {
            Err(reason) => vec![format!("{}: {reason}", tile.name)],
            Ok(picture) => {
                let (w, h) = picture.dimensions();
                let outside = tile.crops.iter().filter(|crop| !crop.fits((w, h)));
                let said = outside.map(|crop| {
                    format!(
                        "{}: the part {},{},{},{} extends beyond its {w} × {h} pixels",
                        tile.name, crop.x, crop.y, crop.width, crop.height
                    )
                });
                said.collect()
            }
        };
        self.tiles().flat_map(of_tile).collect()
    }
}
