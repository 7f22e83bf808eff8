//! Scoring rules other than metrics that a protocol may change.

use std::fmt;

use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

use super::Region;

/// Selection of the compared pixels; part of the identity of every value that depends on it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
pub struct ScoringRules {
    /// The mask that metrics with the suffix `@mask` use.
    pub mask: PairMask,
    /// Treatment of the border of pictures.
    pub border: Border,
}

/// Which pixels of a pair metrics with the suffix `@mask` compare.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum PairMask {
    /// The target's pixels that the dataset does not exclude.
    #[default]
    NotExcluded,
    /// Target pixels with depth whose points project into the source's image; occlusion is not tested. A mask with
    /// fewer than [`MIN_PIXELS`] pixels is discarded.
    SourceBounds,
}

/// A value is computed only if [`PairMask::SourceBounds`] contains at least this many pixels, as in UniSHARP.
pub const MIN_PIXELS: usize = 8;

/// The border that is excluded from comparison.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Border {
    /// The border is not excluded.
    #[default]
    Kept,
    /// A twentieth of each side: from ⌈side / 20⌉ to ⌊19 side / 20⌋, as Flash3D crops.
    Twentieth,
}

impl Border {
    /// The compared part of a picture of the given width and height.
    pub fn kept(self, (width, height): (u32, u32)) -> Region {
        let cut = |side: u32| {
            let start = side.div_ceil(20);
            let end = (u64::from(side) * 19 / 20) as u32;
            (start, end.saturating_sub(start))
        };
        match self {
            Self::Kept => Region::whole((width, height)),
            Self::Twentieth => {
                let ((x, width), (y, height)) = (cut(width), cut(height));
                Region {
                    x,
                    y,
                    width,
                    height,
                }
            }
        }
    }
}

impl fmt::Display for PairMask {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::NotExcluded => {
                f.write_str("the target's pixels that the dataset does not exclude")
            }
            Self::SourceBounds => write!(
                f,
                "target pixels with depth whose point lies inside the source's picture, occluded or not; fewer than \
                 {MIN_PIXELS} are no number"
            ),
        }
    }
}

impl fmt::Display for Border {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(match self {
            Self::Kept => "compared",
            Self::Twentieth => "a twentieth of each side is cropped from both pictures",
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_twentieth_is_flash3ds_crop() {
        let kept = Border::Twentieth.kept((384, 256));
        // Columns 20 to 364, rows 13 to 243.
        assert_eq!((kept.x, kept.y, kept.size()), (20, 13, (344, 230)));
        let kept = Border::Twentieth.kept((1, 1));
        assert!(!kept.fits((1, 1)), "nothing is left");
    }
}
