//! A map in false colours, with a colour bar.
//!
//! The colours (inferno) have equal steps of lightness for equal steps of value, so they stay in order in grey and
//! under every form of colour blindness. Dark is alike, bright is different, in every map.

use image::{Rgb, RgbImage, imageops};

use super::{ColourScale, LocalMap};
use crate::report::error_map::colour;
use crate::report::plots::canvas::{INK, MUTED};
use crate::report::plots::scale::Step;
use crate::report::plots::text::{CAP_HEIGHT, Weight, width, wrapped, write};

/// Small maps are enlarged, each pixel to a square, until their longer side has this many pixels.
const SMALLEST_SIDE: u32 = 480;
/// Colour of pixels without a value.
const NO_VALUE: Rgb<u8> = Rgb([0xB8, 0xBE, 0xC6]);
const PAPER: Rgb<u8> = Rgb([255; 3]);

/// Lengths of a drawing, pixels.
struct Layout {
    /// Squares that a value becomes.
    enlargement: u32,
    /// Font size.
    font: f64,
    margin: u32,
    /// Of the map as drawn.
    map: (u32, u32),
    /// Where the map and the bar begin.
    top: u32,
    bar: (u32, u32),
    bar_left: u32,
    canvas: (u32, u32),
    title: Vec<String>,
    caption: Vec<String>,
}

/// The map at its own resolution or enlarged, with its key above, the colour bar at its side and an explanation below.
pub fn drawing(map: &LocalMap) -> RgbImage {
    let ticks = Ticks::of(map);
    let layout = Layout::of(map, &ticks);
    let mut picture = RgbImage::from_pixel(layout.canvas.0, layout.canvas.1, PAPER);
    draw_map(&mut picture, map, &layout);
    draw_bar(&mut picture, map.scale, &ticks, &layout);
    draw_texts(&mut picture, &layout);
    picture
}

/// The bar's ticks: position between the dark end, 0, and the bright one, 1, and label.
struct Ticks(Vec<(f64, String)>);

impl Ticks {
    fn of(map: &LocalMap) -> Self {
        let ColourScale { alike, different } = map.scale;
        let (low, high) = (alike.min(different), alike.max(different));
        let step = Step::nice(high - low, 5);
        let below = has_values_below(map, low);
        let ticks = step.within(low, high).into_iter().map(|k| {
            let value = step.at(k);
            let sign = if below && value == low { "≤ " } else { "" };
            let share = (value - alike) / (different - alike);
            (share, format!("{sign}{}", step.text(k)))
        });
        Self(ticks.collect())
    }
}

fn has_values_below(map: &LocalMap, low: f64) -> bool {
    map.values.as_raw().iter().any(|v| f64::from(*v) < low)
}

impl Layout {
    fn of(map: &LocalMap, ticks: &Ticks) -> Self {
        let (width_px, height_px) = map.values.dimensions();
        let enlargement = SMALLEST_SIDE.div_ceil(width_px.max(height_px)).max(1);
        let drawn = (width_px * enlargement, height_px * enlargement);
        let font = (f64::from(drawn.0.max(drawn.1)) / 42.0).clamp(14.0, 90.0);
        let margin = font.round() as u32;
        let label = ticks
            .0
            .iter()
            .map(|(_, label)| width(label, font, Weight::Regular))
            .fold(0.0, f64::max);
        let bar = ((1.3 * font) as u32, drawn.1.max((7.0 * font) as u32));
        let bar_left = margin + drawn.0 + margin;
        let canvas_width = bar_left + bar.0 + margin + label.ceil() as u32 + margin;
        let room = f64::from(canvas_width - 2 * margin);
        let title = wrapped(&map.key, font * 1.15, Weight::Bold, room);
        let caption = wrapped(&caption(map), font, Weight::Regular, room);
        let line = line_height(font);
        let top = margin + line * title.len() as u32 + margin / 2;
        let below = margin / 2 + line * caption.len() as u32 + margin;
        Self {
            enlargement,
            font,
            margin,
            map: drawn,
            top,
            bar,
            bar_left,
            canvas: (canvas_width, top + bar.1 + below),
            title,
            caption,
        }
    }
}

fn line_height(font: f64) -> u32 {
    (font * 1.4).round() as u32
}

fn caption(map: &LocalMap) -> String {
    let mut text = map.meaning.to_owned();
    if let Some(first) = text.get_mut(..1) {
        first.make_ascii_uppercase();
    }
    text += &format!(
        "; dark: alike, bright: different. Mean over the map {:.4}.",
        map.mean()
    );
    if map.values.as_raw().iter().any(|v| v.is_nan()) {
        text += " Grey: the window would reach out of the picture.";
    }
    text
}

fn draw_map(picture: &mut RgbImage, map: &LocalMap, layout: &Layout) {
    let drawn = RgbImage::from_fn(layout.map.0, layout.map.1, |x, y| {
        let (x, y) = (x / layout.enlargement, y / layout.enlargement);
        match map.values.get_pixel(x, y).0[0] {
            value if value.is_nan() => NO_VALUE,
            value => colour(map.scale.share(value)),
        }
    });
    imageops::replace(picture, &drawn, layout.margin.into(), layout.top.into());
}

fn draw_bar(picture: &mut RgbImage, scale: ColourScale, ticks: &Ticks, layout: &Layout) {
    let (bar_width, bar_height) = layout.bar;
    let span = f64::from(bar_height - 1);
    for y in 0..bar_height {
        let share = 1.0 - f64::from(y) / span;
        let value = scale.alike + share * (scale.different - scale.alike);
        let rgb = colour(scale.share(value as f32));
        for x in 0..bar_width {
            picture.put_pixel(layout.bar_left + x, layout.top + y, rgb);
        }
    }
    let thickness = (layout.font / 14.0).round().max(1.0) as u32;
    let right = layout.bar_left + bar_width;
    for (share, label) in &ticks.0 {
        let y = f64::from(layout.top) + (1.0 - share) * span;
        let first = (y - f64::from(thickness) / 2.0 + 0.5).max(f64::from(layout.top)) as u32;
        for line in first..first + thickness {
            for x in right..right + layout.margin / 3 {
                picture.put_pixel(x, line.min(layout.top + bar_height - 1), INK.into());
            }
        }
        let baseline = (y + layout.font * CAP_HEIGHT / 2.0).round() as u32;
        let at = (right + layout.margin / 2, baseline);
        write(picture, label, at, layout.font, Weight::Regular, INK);
    }
}

fn draw_texts(picture: &mut RgbImage, layout: &Layout) {
    let line = line_height(layout.font);
    for (i, text) in layout.title.iter().enumerate() {
        let baseline = layout.margin + line * i as u32 + layout.font.round() as u32;
        let at = (layout.margin, baseline);
        write(picture, text, at, layout.font * 1.15, Weight::Bold, INK);
    }
    let below = layout.top + layout.bar.1 + layout.margin / 2;
    for (i, text) in layout.caption.iter().enumerate() {
        let baseline = below + line * i as u32 + layout.font.round() as u32;
        let at = (layout.margin, baseline);
        write(picture, text, at, layout.font, Weight::Regular, MUTED);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pictures::maps::Values;
    use image::Luma;

    fn map(width: u32, height: u32, scale: ColourScale) -> LocalMap {
        let values = Values::from_fn(width, height, |x, y| {
            Luma([if (x, y) == (0, 0) {
                f32::NAN
            } else {
                x as f32 / (width - 1) as f32
            }])
        });
        LocalMap {
            key: "lpips[alex,v0.1]".into(),
            alias: "lpips-alex".into(),
            meaning: "distance",
            values,
            scale,
        }
    }

    #[test]
    fn values_become_squares_of_the_colours_of_the_bar() {
        let scale = ColourScale {
            alike: 0.0,
            different: 1.0,
        };
        let map = map(24, 10, scale);
        let layout = Layout::of(&map, &Ticks::of(&map));
        let picture = drawing(&map);
        assert_eq!(layout.enlargement, 20);
        assert_eq!(picture.dimensions(), layout.canvas);
        let at = |x: u32, y: u32| {
            let (x, y) = (20 * x + 7, 20 * y + 7);
            *picture.get_pixel(layout.margin + x, layout.top + y)
        };
        assert_eq!(at(0, 0), NO_VALUE);
        assert_eq!(at(0, 1), colour(0.0));
        assert_eq!(at(23, 9), colour(1.0));
        let bar = layout.bar_left + layout.bar.0 / 2;
        assert_eq!(picture.get_pixel(bar, layout.top), &colour(1.0));
        let bottom = layout.top + layout.bar.1 - 1;
        assert_eq!(picture.get_pixel(bar, bottom), &colour(0.0));
    }

    #[test]
    fn ticks_are_round_and_say_where_values_are_cut_off() {
        let ticks = |map: &LocalMap| -> Vec<String> {
            Ticks::of(map)
                .0
                .into_iter()
                .map(|(_, label)| label)
                .collect()
        };
        let mut map = map(30, 10, ColourScale::SSIM);
        assert_eq!(ticks(&map), ["0.0", "0.2", "0.4", "0.6", "0.8", "1.0"]);
        map.values.put_pixel(5, 5, Luma([-0.1]));
        assert_eq!(ticks(&map)[0], "≤ 0.0");
    }

    #[test]
    fn odd_shapes_can_be_drawn() {
        for (width, height) in [(2, 1), (3, 700), (700, 2)] {
            let picture = drawing(&map(width, height, ColourScale::SSIM));
            assert!(picture.width() > width && picture.height() > height);
        }
    }
}
