//! Tells pictures that were rendered from the target's photograph at the source's pose from other pictures of the source's
//! view: they are far worse where the target does not show the source's content.

use image::RgbImage;
use sharp_datasets::View;

use crate::pairs::depth::PosedDepth;
use crate::pairs::overlap::{OverlapOptions, seen_mask};
use crate::pairs::pair_list::ResolvedPair;
use crate::pairs::valid_depth::is_valid_depth;

/// A picture was rendered from the target's photograph if its squared error is at least this multiple higher where the
/// target does not show the content. Such places are at edges, so it is several times higher in other pictures as well.
const MIN_ERROR: f64 = 10.0;
/// Minimum share of the source's pixels whose content the target does not show, and of those that it shows.
const MIN_PLACES: f64 = 0.01;

/// For each pixel of the source, reduced to the given size, whether its content is not visible in the target; `None` for
/// pixels without depth. `None` if one of the views has no depth.
pub(super) fn unseen_by_target(
    planned: &ResolvedPair<'_>,
    (width, height): (u32, u32),
) -> Option<Vec<Option<bool>>> {
    let reduced = |view: &View| {
        let depth = PosedDepth::of_view(view, view.content.depth().ok()??).ok()?;
        Some(depth.reduced(width.max(height)))
    };
    let (source, target) = (reduced(planned.source)?, reduced(planned.target)?);
    let seen = seen_mask(&source, &target, &OverlapOptions::default());
    let (w, h) = source.depth().dimensions();
    let is_unseen = |k: u32| {
        let (x, y) = (k % width, k / width);
        let at = ((y * h / height) * w + x * w / width) as usize;
        is_valid_depth(source.depth().as_raw()[at]).then(|| !seen[at])
    };
    Some((0..width * height).map(is_unseen).collect())
}

/// Whether the mean squared error of a picture is far higher in some places (`true`) than in others (`false`). Both must
/// be sufficiently many.
pub(super) fn is_worse_where(places: &[Option<bool>], seen: &RgbImage, shown: &RgbImage) -> bool {
    if seen.dimensions() != shown.dimensions() {
        return false;
    }
    let error = |there: bool| {
        let pixels = seen.pixels().zip(shown.pixels()).zip(places);
        let errors = pixels
            .filter(|(_, place)| **place == Some(there))
            .map(|((a, b), _)| {
                let off =
                    a.0.iter()
                        .zip(b.0)
                        .map(|(a, b)| f64::from(a.abs_diff(b)).powi(2));
                off.sum::<f64>()
            });
        let errors: Vec<f64> = errors.collect();
        let is_enough = errors.len() as f64 >= MIN_PLACES * places.len() as f64;
        is_enough.then(|| errors.iter().sum::<f64>() / errors.len() as f64)
    };
    let both = error(true).zip(error(false));
    both.is_some_and(|(worse, others)| worse >= MIN_ERROR * others.max(1.0))
}

#[cfg(test)]
mod tests {
    use image::Rgb;
    use sharp_tests::holds;

    use super::super::camera::misplaced;
    use super::super::finding::ShownTarget;
    use super::super::group::Extent;
    use super::*;

    #[test]
    fn renderings_of_the_source_from_the_target_are_told() {
        use ShownTarget::{SourceFromTarget, SourceView};
        let view = |noise: u32| {
            RgbImage::from_fn(96, 72, |x, y| {
                let wave = 120.0 + 90.0 * (f64::from(x) / 7.0 + f64::from(y) / 9.0).sin();
                Rgb([wave as u8 + (noise * (x * 7919 + y * 104_729) % 7) as u8; 3])
            })
        };
        let (seen, shown) = (view(0), view(1));
        // The target does not show the left tenth, which is made up; there is no depth at the bottom.
        let places: Vec<Option<bool>> = (0..96 * 72)
            .map(|k| (k < 96 * 60).then_some(k % 96 < 9))
            .collect();
        let made_up = RgbImage::from_fn(96, 72, |x, y| *shown.get_pixel(x.max(9), y));
        assert!(is_worse_where(&places, &seen, &made_up));
        // Of the source's own pose, all parts are alike.
        assert!(!is_worse_where(&places, &seen, &shown));
        assert!(!is_worse_where(
            &vec![Some(false); 96 * 72],
            &seen,
            &made_up
        ));
        let said = |found: &[(ShownTarget, usize)]| {
            misplaced(&found.iter().copied().collect(), "pairs", Extent::Dataset).unwrap()
        };
        let text = said(&[(SourceFromTarget, 4), (SourceView, 2)]);
        holds(&text, &["6 of the 6", "rename A__B to B__A"]);
        let text = said(&[(SourceFromTarget, 2), (SourceView, 4)]);
        assert!(!text.contains("rename"), "{text}");
    }
}
