//! Alternatives to the reader's interpretation that are tested.

use glam::DVec2;

use super::compare::{
    LEAST_ERRORS, LEAST_GAIN, LEAST_GAIN_OF_FACTORS, LEAST_GAIN_OF_LENSES, LEAST_GAIN_OF_VIEWS,
};
use super::explained::{Explained, Registration};
use super::small_view::Part;

/// A change to the reader's interpretation.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Change {
    /// The poses' translations, multiplied by this, fit the depth.
    Scale(f64),
    /// These focal lengths, multiplied by this, fit.
    Focal(Focal, f64),
    CentreExchanged,
    /// Principal points are further right and down by this much, in widths of the picture.
    CentreOff(DVec2),
    /// Depth fits if this many metres are added.
    Short(f64),
    RayLength,
    /// Depth was already z, but was interpreted as the length of rays.
    NoRayLength,
    /// The stored values are the reciprocal of depth; the poses' translations, multiplied by this, fit the reciprocals.
    Inverse(f64),
    /// The stored values are those of a z-buffer, whose near plane is this far away.
    Buffer(f64),
    /// The poses use another convention, named as in [`alternatives`].
    Convention(&'static str),
    /// Parts of views belong to other pictures; a description of the assignment.
    Order(String, Moves),
    /// Pairs of views fit the poses of others, but not as one list: two pictures would have one pose.
    Unlisted,
    /// One or several views are wrong; a sentence on them.
    Views(String),
    /// Cameras are exchanged; a description.
    Cameras(String),
    /// The lenses have this [`Reading::bend`].
    Bent(f64),
    /// Depth maps fit the pictures if they are moved and scaled.
    Registered(Registration),
    /// Pictures or depth maps are flipped; a description.
    Flipped(Part, &'static str),
    /// Pictures fit with the other EXIF orientation rule, with which they also have the camera's size; the setting that
    /// selects it.
    Turned(&'static str),
}

/// Focal lengths that are wrong by a common factor.
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
    /// True for a change after which depths may agree as before, or less, while colours fit.
    pub(super) fn shows_in_colours(&self) -> bool {
        matches!(
            self,
            Self::Focal(..)
                | Self::CentreExchanged
                | Self::CentreOff(_)
                | Self::Bent(_)
                | Self::Registered(_)
                | Self::Buffer(_)
        )
    }

    /// Minimum fraction of the loss that it must remove, and minimum number of standard errors.
    pub(super) fn least_gain(&self) -> (f64, f64) {
        let gain = match self {
            // Small everywhere, but of the same kind everywhere.
            Self::Bent(_) => return LEAST_GAIN_OF_LENSES,
            Self::Scale(_) | Self::Focal(..) | Self::Registered(_) => LEAST_GAIN_OF_FACTORS,
            Self::Views(_) => LEAST_GAIN_OF_VIEWS,
            _ => LEAST_GAIN,
        };
        (gain, LEAST_ERRORS)
    }
}

/// The part of a view that is reassigned; the rest is unchanged.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) enum Moves {
    Poses,
    PosesAndDepth,
    Depth,
}

impl Moves {
    /// Noun for the reassigned parts.
    pub(super) fn noun(self) -> &'static str {
        match self {
            Self::Depth => "depth map",
            _ => "pose",
        }
    }
}

/// An interpretation that fits better.
#[derive(Debug, Clone)]
pub(super) struct Better {
    pub(super) change: Change,
    pub(super) as_read: Explained,
    pub(super) explained: Explained,
    /// True if the remaining loss is no larger than for valid data.
    pub(super) fits_well: bool,
    /// True if it is hardly less than as read.
    pub(super) is_slight: bool,
}
