//! Failures of a method, shown with their depth: input, view and inverse depth side by side.

use std::path::Path;

use image::RgbImage;
use sharp_datasets::DepthMap;

use super::choice::ChosenPair;
use super::qualitative::{SheetContent, named};
use super::sheet::{Sheet, Tile};
use crate::evaluate::EvaluateError;
use crate::pairs::depth::given::{GivenDepth, find_map, read_metres};
use crate::pairs::pair_id::path_of;
use crate::pairs::valid_depth::is_valid_depth;
use crate::report::error::{MissingPicture, ReportError};
use crate::report::error_map::false_colours;

/// A sheet with input, view and inverse depth of each pair. With a folder, depth is read from
/// `DIR/<pair_id>.npy|npz|exr|pfm|png` (z-depth in the target's camera, in metres). Without one, depth is that of the
/// kept rendering, as in the paper. If no rendering was kept, it is the dataset's depth of the target, or of the source
/// if the target has none. The caption states where the depth is from.
///
/// # Errors
/// If there is not exactly one method, or the folder does not exist.
pub fn sheet(comparison: &SheetContent<'_>, depth: Option<&Path>) -> Result<Sheet, ReportError> {
    let [method] = comparison.methods[..] else {
        return Err(ReportError::NotOneMethod);
    };
    // A missing folder is an error; a missing map is only shown as missing.
    let folder = depth.map(GivenDepth::open).transpose();
    folder.map_err(EvaluateError::from)?;
    let rows = comparison.pairs.iter().map(|chosen| {
        let found = match depth {
            Some(folder) => of_pair(folder, chosen).map(|map| (map, "given")),
            None => of_run(comparison, chosen, method),
        };
        let (picture, text) = match found {
            Ok((map, _)) if !map.iter().any(|z| is_valid_depth(*z)) => {
                (Err(MissingPicture::Without("pixel with a depth")), "")
            }
            Ok((map, whose)) => (Ok(inverse_depth(&map)), whose),
            Err(reason) => (Err(reason), ""),
        };
        let tiles = vec![
            comparison.input(chosen),
            comparison.prediction(chosen, method),
            Tile::new(named(chosen, "inverse depth"), picture, text),
        ];
        (String::new(), tiles)
    });
    let label = comparison.board.methods[method].label.clone();
    Ok(Sheet {
        heads: vec!["input".to_owned(), label, "inverse depth".to_owned()],
        rows: rows.collect(),
    })
}

/// Depth of the scored rendering, or the dataset's depth if no rendering was kept. Also returns the words that state
/// where the depth is from.
fn of_run(
    comparison: &SheetContent<'_>,
    chosen: &ChosenPair<'_>,
    method: usize,
) -> Result<(DepthMap, &'static str), MissingPicture> {
    let record = chosen.pair.by_method.get(method).copied().flatten();
    let rendered = record.map(|record| comparison.pictures.rendered_depth(record));
    match rendered.transpose()?.flatten() {
        Some(depth) => Ok((depth, "of the rendering")),
        None => of_dataset(comparison, chosen),
    }
}

/// The dataset's depth of the target, or of the source if the target has none. Also returns the words that state where
/// the depth is from.
fn of_dataset(
    comparison: &SheetContent<'_>,
    chosen: &ChosenPair<'_>,
) -> Result<(DepthMap, &'static str), MissingPicture> {
    let facts = chosen.pair.facts;
    if let Some(depth) = comparison.pictures.depth(facts, &facts.target)? {
        return Ok((
            depth,
            "of the dataset's target, because no rendering was kept (run --keep float)",
        ));
    }
    let depth = comparison.pictures.depth(facts, &facts.source)?;
    let depth = depth.ok_or(MissingPicture::Without("depth"))?;
    Ok((
        depth,
        "of the dataset's input, because no rendering was kept (run --keep float)",
    ))
}

fn of_pair(folder: &Path, chosen: &ChosenPair<'_>) -> Result<DepthMap, MissingPicture> {
    let unusable = |reason: String| MissingPicture::Unusable(reason);
    let stem = folder.join(path_of(&chosen.pair.facts.pair_id));
    let file = find_map(&stem).map_err(|error| unusable(error.to_string()))?;
    let file = file.ok_or(MissingPicture::Without("depth map of this pair"))?;
    read_metres(&file).map_err(|error| unusable(error.to_string()))
}

/// Inverse depth in false colours from the 0.1th to the 99.9th percentile. Near pixels are bright; pixels without depth
/// are grey.
pub(super) fn inverse_depth(depth: &DepthMap) -> RgbImage {
    let valid = depth.iter().copied().filter(|z| is_valid_depth(*z));
    let mut inverse: Vec<f32> = valid.map(|z| 1.0 / z).collect();
    inverse.sort_unstable_by(f32::total_cmp);
    let at = |share: f64| {
        let place = (share * inverse.len().saturating_sub(1) as f64).round() as usize;
        inverse.get(place).copied().unwrap_or(0.0)
    };
    let (low, high) = (at(0.001), at(0.999));
    let span = (high - low).max(f32::MIN_POSITIVE);
    false_colours(depth, |z| is_valid_depth(z).then(|| (1.0 / z - low) / span))
}
