//! Scoring on a part of the target: what a method that crops predicts, or what all methods share.

use std::borrow::Cow;

use crate::methods::{Method, Prediction};
use crate::protocol::Region;
use crate::protocol::pair_list::ResolvedPair;

/// What all methods predict of a pair's target. A method that cannot say (its picture is missing) does not count: it
/// will fail on the pair.
pub(super) fn common_region(methods: &[Box<dyn Method>], planned: &ResolvedPair) -> Region {
    let intrinsics = &planned.target.intrinsics;
    let size = (intrinsics.width, intrinsics.height);
    let regions = methods
        .iter()
        .filter_map(|method| method.region(&planned.pair.pair_id, size).ok().flatten());
    // Regions without a common pixel give an empty one, which no prediction can be cut to.
    let nothing = Region {
        width: 0,
        height: 0,
        ..Region::whole(size)
    };
    regions.fold(Region::whole(size), |common, region| {
        common.intersection(&region).unwrap_or(nothing)
    })
}

/// Reduces a prediction to a part of what it shows. `size` is the target's.
pub(super) fn cut(
    prediction: &mut Prediction,
    common: Region,
    size: (u32, u32),
) -> Result<(), String> {
    let shown = prediction.region.unwrap_or(Region::whole(size));
    let inside = common.within(&shown).ok_or_else(|| {
        format!("the methods' common region is {common}; this prediction shows {shown}")
    })?;
    if let Cow::Owned(picture) = inside.crop(&prediction.picture) {
        prediction.picture = picture;
    }
    prediction.region = (common != Region::whole(size)).then_some(common);
    Ok(())
}

/// How a record says that it was scored on a part of the target: `crop_x`, `crop_y`, `crop_width`, `crop_height` in
/// pixels of the target, and `scored_share` of its area.
pub(super) fn region_extras(region: &Region, size: (u32, u32)) -> [(String, f64); 5] {
    [
        ("crop_x", f64::from(region.x)),
        ("crop_y", f64::from(region.y)),
        ("crop_width", f64::from(region.width)),
        ("crop_height", f64::from(region.height)),
        ("scored_share", region.share_of(size)),
    ]
    .map(|(name, value)| (name.to_owned(), value))
}
