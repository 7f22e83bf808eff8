//! COLMAP's text files. Errors contain the line number and the reason.

use std::collections::BTreeMap;
use std::str::FromStr;

use glam::DVec3;

use super::FormatError;
use super::colmap_records::{ColmapCamera, ColmapImage, ColmapPoint, pose, size};

/// Parses `cameras.txt`: `ID MODEL WIDTH HEIGHT PARAMS…`.
///
/// # Errors
/// If a line is invalid; states the line's number and the fault.
pub fn cameras(text: &str) -> Result<BTreeMap<u32, ColmapCamera>, FormatError> {
    let mut cameras = BTreeMap::new();
    for (number, line) in records(text) {
        let mut line = RecordLine::new(number, line);
        let id = line.next("camera id")?;
        let camera = ColmapCamera {
            model: line.word("camera model")?.to_owned(),
            size: size(line.next("width")?, line.next("height")?)?,
            params: line.rest("parameter")?,
        };
        cameras.insert(id, camera);
    }
    Ok(cameras)
}

/// Parses `images.txt`: two lines per image. The second may be empty, or missing if observations
/// were removed from the file.
///
/// # Errors
/// If a line is invalid; states the line's number and the fault.
pub fn images(text: &str) -> Result<Vec<ColmapImage>, FormatError> {
    let mut images = Vec::new();
    let mut lines = text.lines().enumerate().peekable();
    while let Some((number, line)) = lines.next() {
        if is_void(line) {
            continue;
        }
        images.push(image(number, line)?);
        // The next line has this image's observations, even if it is blank.
        let Some((number, line)) =
            lines.next_if(|(number, line)| image(*number, line).is_err() || is_track(line))
        else {
            continue;
        };
        if !is_void(line) && RecordLine::new(number, line).next::<f64>("x").is_err() {
            return Err(invalid!(
                "line {}: neither an image nor the observations of the image before it",
                number + 1
            ));
        }
    }
    Ok(images)
}

fn image(number: usize, line: &str) -> Result<ColmapImage, FormatError> {
    let mut line = RecordLine::new(number, line);
    let id = line.next("image id")?;
    let mut values = [0.0; 7];
    for value in &mut values {
        *value = line.next("pose")?;
    }
    let [w, x, y, z, tx, ty, tz] = values;
    let camera_id = line.next("camera id")?;
    let name = line.remainder();
    if name.is_empty() {
        return Err(invalid!("line {}: the image has no name", number + 1));
    }
    Ok(ColmapImage {
        id,
        camera_id,
        name: name.to_owned(),
        camera_from_world: pose([w, x, y, z], [tx, ty, tz]),
    })
}

/// True for a line of observations, which consists of triples of numbers.
fn is_track(line: &str) -> bool {
    let mut words = line.split_whitespace();
    words.clone().count().is_multiple_of(3) && words.all(|word| word.parse::<f64>().is_ok())
}

/// Parses `points3D.txt`: `ID X Y Z R G B ERROR (IMAGE_ID POINT2D_IDX)…`.
///
/// # Errors
/// If a line is invalid; states the line's number and the fault.
pub fn points(text: &str) -> Result<Vec<ColmapPoint>, FormatError> {
    records(text)
        .map(|(number, line)| {
            let mut line = RecordLine::new(number, line);
            line.word("point id")?;
            let position = DVec3::new(
                line.next("coordinate")?,
                line.next("coordinate")?,
                line.next("coordinate")?,
            );
            for what in ["color", "color", "color", "error"] {
                line.word(what)?;
            }
            let track: Vec<u32> = line.rest("track entry")?;
            Ok(ColmapPoint {
                position,
                seen_by: track.into_iter().step_by(2).collect(),
            })
        })
        .collect()
}

fn is_void(line: &str) -> bool {
    let line = line.trim();
    line.is_empty() || line.starts_with('#')
}

fn records(text: &str) -> impl Iterator<Item = (usize, &str)> {
    text.lines().enumerate().filter(|(_, line)| !is_void(line))
}

/// Parses a line word by word; errors include the line's number.
struct RecordLine<'a> {
    number: usize,
    rest: &'a str,
}

impl<'a> RecordLine<'a> {
    fn new(number: usize, text: &'a str) -> Self {
        Self { number, rest: text }
    }

    fn word(&mut self, what: &str) -> Result<&'a str, FormatError> {
        let rest = self.rest.trim_start();
        let end = rest.find(char::is_whitespace).unwrap_or(rest.len());
        let (word, rest) = rest.split_at(end);
        self.rest = rest;
        if word.is_empty() {
            return Err(invalid!("line {}: the {what} is missing", self.number + 1));
        }
        Ok(word)
    }

    fn next<T: FromStr>(&mut self, what: &str) -> Result<T, FormatError> {
        let word = self.word(what)?;
        word.parse()
            .map_err(|_| invalid!("line {}: '{word}' is not a valid {what}", self.number + 1))
    }

    fn rest<T: FromStr>(&mut self, what: &str) -> Result<Vec<T>, FormatError> {
        let mut values = Vec::new();
        while !self.rest.trim().is_empty() {
            values.push(self.next(what)?);
        }
        Ok(values)
    }

    fn remainder(&self) -> &'a str {
        self.rest.trim()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn tracks_are_read_without_their_indices() {
        let text = "# comment\n500 -28.4 10.1 153.5 107 107 99 2.9 100 0 200 0 300 1\n";
        let points = points(text).unwrap();
        assert_eq!(points[0].position, DVec3::new(-28.4, 10.1, 153.5));
        assert_eq!(points[0].seen_by, [100, 200, 300]);
    }

    #[test]
    fn images_are_counted_with_and_without_their_observations() {
        let one = "1 1 0 0 0 0 0 0 1 a b.png";
        let numbers = "2 1 0 0 0 0 0 0 1 000002";
        for (text, count) in [
            (format!("{one}\n\n{numbers}\n\n"), 2),
            (format!("# c\n{one}\n{numbers}\n{one}\n"), 3),
            (
                format!("{one}\n1 2 3 4 5 6\n{numbers}\n12 3 -1 4 5 6 7 8 9 10 11 -1\n"),
                2,
            ),
            (format!("{one}\n{one}\n1.5 2 3\n{one}"), 3),
        ] {
            assert_eq!(images(&text).unwrap().len(), count, "{text}");
        }
        let broken = format!("{one}\nb 1 0 0 0 0 0 0 1 b.png\n");
        assert!(
            images(&broken)
                .unwrap_err()
                .to_string()
                .contains("line 2: neither")
        );
    }

    #[test]
    fn errors_carry_the_line() {
        for (error, reason) in [
            (
                cameras("\n1 PINHOLE 640").unwrap_err(),
                "line 2: the height is missing",
            ),
            (
                cameras("1 PINHOLE 640 x").unwrap_err(),
                "'x' is not a valid height",
            ),
            (cameras("1 PINHOLE 0 4 1").unwrap_err(), "0x4"),
            (images("1 1 0 0 0 0 0 0 1\n").unwrap_err(), "no name"),
            (
                images("1 1 0 0 0 0 0 zero 1 a").unwrap_err(),
                "'zero' is not a valid pose",
            ),
            (points("1 2 3").unwrap_err(), "the coordinate is missing"),
        ] {
            assert!(error.to_string().contains(reason), "{error}");
        }
    }
}
