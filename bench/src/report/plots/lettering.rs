//! Text of the bundled font on pictures.

use image::RgbImage;

use super::canvas::Ink;
use super::font::{Weight, raster, width};

/// Writes a line of text; its baseline starts at `at`. What lies outside the picture is cut off.
pub fn write(
    picture: &mut RgbImage,
    text: &str,
    at: (u32, u32),
    size: f64,
    weight: Weight,
    ink: Ink,
) {
    raster(text, size, weight, |x, y, coverage| {
        let place = (
            u32::try_from(i64::from(at.0) + i64::from(x)),
            u32::try_from(i64::from(at.1) + i64::from(y)),
        );
        let (Ok(x), Ok(y)) = place else { return };
        let Some(pixel) = picture.get_pixel_mut_checked(x, y) else {
            return;
        };
        let rgb = [ink.rgb.0, ink.rgb.1, ink.rgb.2];
        for (below, above) in pixel.0.iter_mut().zip(rgb) {
            let mixed = f32::from(*below) * (1.0 - coverage) + f32::from(above) * coverage;
            *below = mixed.round() as u8;
        }
    });
}

/// The text in lines no wider than `room` where its words allow.
pub fn wrapped(text: &str, size: f64, weight: Weight, room: f64) -> Vec<String> {
    let mut lines: Vec<String> = Vec::new();
    for word in text.split_whitespace() {
        match lines.last_mut() {
            Some(line) if width(&format!("{line} {word}"), size, weight) <= room => {
                line.push(' ');
                line.push_str(word);
            }
            _ => lines.push(word.to_owned()),
        }
    }
    lines
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::report::plots::canvas::INK;
    use image::Rgb;

    #[test]
    fn lines_break_between_words() {
        let whole = width("one two", 10.0, Weight::Regular);
        let lines = |room| wrapped("one two  three", 10.0, Weight::Regular, room);
        assert_eq!(lines(whole), ["one two", "three"]);
        assert_eq!(lines(1.0), ["one", "two", "three"]);
        assert_eq!(lines(1e4), ["one two three"]);
    }

    #[test]
    fn text_darkens_paper_and_may_run_out_of_it() {
        let mut paper = RgbImage::from_pixel(20, 20, Rgb([255; 3]));
        write(&mut paper, "MMMM", (5, 18), 16.0, Weight::Bold, INK);
        assert!(paper.pixels().any(|p| p.0[0] < 100));
        assert_eq!(paper.get_pixel(0, 0), &Rgb([255; 3]));
    }
}
