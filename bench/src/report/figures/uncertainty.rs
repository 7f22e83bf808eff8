//! How much predicted depth changes if the picture is mirrored: the relative absolute difference |d − m| / d, where d
//! is the depth of the picture, and m that of the mirrored picture, mirrored back.

use std::path::Path;

use image::RgbImage;
use image::imageops::flip_horizontal;
use sharp::model::Predictor;
use sharp::model::depth_pro::{DepthPro, DepthProSource};
use sharp::model::predictor::{Planes, planes_of};
use sharp::resize::nearest;
use sharp_datasets::DepthMap;
use sharp_plots::PlotError;

use super::failure::inverse_depth;
use super::sheet::{Sheet, Tile};
use crate::io::checkpoint::{NetworkError, depth_pro_network, named_network};
use crate::pairs::PairError;
use crate::pairs::depth::given::read_metres;
use crate::pairs::valid_depth::{is_valid_depth, median_of};
use crate::report::error::ReportError;
use crate::report::error_map::false_colours;

/// Relative differences of at least this value have the brightest colour.
const BRIGHTEST: f32 = 0.5;

/// Depth of a picture, and depth of the mirrored picture as predicted (not mirrored back). Both maps have the same
/// size.
pub struct Mirrored {
    /// Name such as `layer 1`; empty for a map without layers.
    pub name: String,
    pub depth: DepthMap,
    pub of_mirror: DepthMap,
}

impl Mirrored {
    /// Reads two files.
    ///
    /// # Errors
    /// The error names the file that cannot be read or has no depth at all.
    pub fn read(depth: &Path, of_mirror: &Path) -> Result<Self, PairError> {
        let read = |file: &Path| {
            let map = read_metres(file)?;
            let known = map.iter().any(|z| is_valid_depth(*z));
            known.then_some(map).ok_or_else(|| PairError::Depth {
                path: file.to_owned(),
                reason: "no pixel has a depth".to_owned(),
            })
        };
        Ok(Self {
            name: String::new(),
            depth: read(depth)?,
            of_mirror: read(of_mirror)?,
        })
    }

    /// |d − m| / d per pixel; NaN where d or m is unknown.
    ///
    /// # Errors
    /// A message if the sizes differ.
    pub fn difference(&self) -> Result<DepthMap, String> {
        let (d, m) = (self.depth.dimensions(), self.of_mirror.dimensions());
        if d != m {
            return Err(format!(
                "the depth map has {} × {} pixels, but that of the mirrored picture has {} × {}",
                d.0, d.1, m.0, m.1
            ));
        }
        let back = flip_horizontal(&self.of_mirror);
        let of = |(d, m): (&f32, &f32)| {
            if is_valid_depth(*d) && is_valid_depth(*m) {
                (d - m).abs() / d
            } else {
                f32::NAN
            }
        };
        let values = self.depth.iter().zip(back.iter()).map(of).collect();
        DepthMap::from_vec(d.0, d.1, values).ok_or_else(|| "the map is empty".to_owned())
    }
}

/// Predicts the depth of a picture and of its mirror image. A checkpoint of Depth Pro gives one pair of maps, one of
/// SHARP gives a pair for each of its two layers. `checkpoint` may be `mini`, the bundled network of SHARP; `config` is
/// the architecture (`FILE.json#NAME`), by default the release's. The focal length, which scales both depths alike, is
/// not needed.
///
/// # Errors
/// If the network cannot be read or does not accept the picture.
pub fn by_network(
    picture: &RgbImage,
    checkpoint: &Path,
    config: Option<&str>,
) -> Result<Vec<Mirrored>, NetworkError> {
    if matches!(DepthProSource::open_if(checkpoint), Ok(Some(_))) {
        let network = DepthPro::open(&depth_pro_network(checkpoint, config)?)?;
        let (width, height) = picture.dimensions();
        let depth = |picture: &RgbImage| -> Result<Option<DepthMap>, NetworkError> {
            let planes = Planes {
                values: &planes_of(picture, |v| f32::from(v) / 255.0),
                width: width as usize,
                height: height as usize,
            };
            let predicted = network.predict(planes, Some(width as f32))?;
            Ok(DepthMap::from_vec(width, height, predicted.depth))
        };
        let both = depth(picture)?.zip(depth(&flip_horizontal(picture))?);
        let both = both.map(|(depth, of_mirror)| Mirrored {
            name: String::new(),
            depth,
            of_mirror,
        });
        return Ok(both.into_iter().collect());
    }
    let predictor = Predictor::open(&named_network(Some(checkpoint), config)?)?;
    let whole = predictor.predict_rgb8(picture, 1.0)?;
    let mirror = predictor.predict_rgb8(&flip_horizontal(picture), 1.0)?;
    let side = whole.resolution;
    let layers = |depth: &[f32]| -> Vec<DepthMap> {
        let layers = depth.chunks_exact(side * side);
        let size = (picture.width() as usize, picture.height() as usize);
        // Resize from the network's square back to the picture's shape.
        let maps = layers.filter_map(|layer| {
            let values = nearest(layer, (side, side), size);
            DepthMap::from_vec(picture.width(), picture.height(), values)
        });
        maps.collect()
    };
    let both = layers(&whole.depth).into_iter().zip(layers(&mirror.depth));
    let named = both.enumerate().map(|(i, (depth, of_mirror))| Mirrored {
        name: format!("layer {}", i + 1),
        depth,
        of_mirror,
    });
    Ok(named.collect())
}

/// One row per pair of maps: the picture, its depth, the depth of the mirrored picture (mirrored back), and their
/// relative difference, with its median in the text.
///
/// # Errors
/// If two maps have different sizes, or no pixel has a depth in both.
pub fn sheet(picture: &RgbImage, maps: &[Mirrored]) -> Result<Sheet, ReportError> {
    let failed = |reason: String| PlotError::new("uncertainty", reason);
    let heads = ["picture", "depth", "of the mirror image", "uncertainty"];
    let mut rows = Vec::new();
    for maps in maps {
        let difference = maps.difference().map_err(failed)?;
        let known: Vec<f32> = difference.iter().copied().filter(|v| !v.is_nan()).collect();
        let share = known.len() as f64 / difference.as_raw().len().max(1) as f64;
        let median = median_of(known);
        let median = median.ok_or_else(|| failed("no pixel has both depths".to_owned()))?;
        let text = format!(
            "median {median:.3} over {:.1} % of the pixels; brightest from {BRIGHTEST} up",
            100.0 * share
        );
        let colours = false_colours(&difference, |v| (!v.is_nan()).then_some(v / BRIGHTEST));
        let pictures = [
            picture.clone(),
            inverse_depth(&maps.depth),
            flip_horizontal(&inverse_depth(&maps.of_mirror)),
            colours,
        ];
        let texts = [String::new(), String::new(), String::new(), text];
        let tiles = heads.into_iter().zip(pictures).zip(texts);
        let tiles = tiles.map(|((head, picture), text)| Tile::new(head, Ok(picture), text));
        rows.push((maps.name.clone(), tiles.collect()));
    }
    Ok(Sheet {
        heads: heads.map(str::to_owned).into(),
        rows,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_mirrored_map_is_mirrored_back() {
        let map = |values: [f32; 3]| DepthMap::from_vec(3, 1, values.into()).unwrap();
        let maps = Mirrored {
            name: String::new(),
            depth: map([2.0, 4.0, 0.0]),
            of_mirror: map([5.0, 3.0, 2.0]),
        };
        let found = maps.difference().unwrap();
        assert_eq!(found.as_raw()[..2], [0.0, 0.25]);
        assert!(found.as_raw()[2].is_nan());
        let sheet = sheet(&RgbImage::new(3, 1), &[maps]).unwrap();
        let text = &sheet.rows[0].1[3].text;
        assert_eq!(
            text,
            "median 0.125 over 66.7 % of the pixels; brightest from 0.5 up"
        );
        let other = Mirrored {
            name: String::new(),
            depth: DepthMap::new(2, 1),
            of_mirror: DepthMap::new(1, 1),
        };
        assert!(other.difference().unwrap_err().contains("2 × 1"));
        let nowhere = Mirrored {
            name: String::new(),
            depth: map([2.0, 0.0, 0.0]),
            of_mirror: map([2.0, 0.0, 0.0]),
        };
        let error = super::sheet(&RgbImage::new(3, 1), &[nowhere]).err();
        assert!(error.is_some_and(|e| e.to_string().contains("no pixel has both depths")));
    }
}
