//! Changes to the reader's reading that are tried.

use glam::DVec2;

use super::compare::{LEAST_GAIN, LEAST_GAIN_OF_FACTORS, LEAST_GAIN_OF_VIEWS};
use super::explained::Explained;
use super::small_view::Part;

/// The change that another reading makes.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Change {
    /// The poses' translations, times this, fit the depth.
    Scale(f64),
    /// These focal lengths, times this, fit.
    Focal(Focal, f64),
    CentreExchanged,
    /// Principal points lie so far right and down, in widths of the picture.
    CentreOff(DVec2),
    /// Depth, and so many metres, fits.
    Short(f64),
    RayLength,
    /// Depth was z already, and was taken for the length of rays.
    NoRayLength,
    /// Depth is the reciprocal of what is stored; the poses' translations, times this, fit the reciprocals.
    Inverse(f64),
    /// The poses are of another convention, named as in [`alternatives`].
    Convention(&'static str),
    /// Parts of views belong to other pictures; the assignment in words.
    Order(String, Moves),
    /// One view or some are wrong; the sentence on them.
    Views(String),
    /// Cameras are exchanged, in words.
    Cameras(String),
    /// Lenses have this [`Reading::bend`].
    Bent(f64),
    /// Pictures or depth maps are turned, in words.
    Flipped(Part, &'static str),
    /// Pictures read under the other EXIF orientation rule, which fits the camera as well; the setting that selects it.
    Turned(&'static str),
}

/// Focal lengths that are wrong together.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Focal {
    Both,
    X,
    Y,
}

impl Focal {
    pub(super) fn times(self, factor: f64) -> DVec2 {
        match self {
            Self::Both => DVec2::splat(factor),
            Self::X => DVec2::new(factor, 1.0),
            Self::Y => DVec2::new(1.0, factor),
        }
    }
}

impl Change {
    pub(super) fn least_gain(&self) -> f64 {
        match self {
            Self::Scale(_) | Self::Focal(..) => LEAST_GAIN_OF_FACTORS,
            Self::Views(_) => LEAST_GAIN_OF_VIEWS,
            _ => LEAST_GAIN,
        }
    }
}

/// The part of a view that another assignment moves; the rest stays as it is.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Moves {
    Poses,
    PosesAndDepth,
    Depth,
}

impl Moves {
    /// The parts that are reassigned.
    pub(super) fn noun(self) -> &'static str {
        match self {
            Self::Depth => "depth map",
            _ => "pose",
        }
    }
}

/// A reading that fits better.
#[derive(Debug, Clone)]
pub(super) struct Better {
    pub(super) change: Change,
    pub(super) as_read: Explained,
    pub(super) explained: Explained,
    /// Whether what it leaves unexplained is no more than in proper data.
    pub(super) fits_well: bool,
}
