//! Alternative interpretations that are tested against the dataset reader's own interpretation.

use glam::DVec2;

use super::compare::{
    MIN_ERRORS, MIN_ERRORS_OF_LENSES, MIN_GAIN, MIN_GAIN_OF_FACTORS, MIN_GAIN_OF_LENSES,
    MIN_GAIN_OF_VIEWS,
};
use super::explained::{Explained, Registration};
use super::small_view::Part;

/// A change to the dataset reader's interpretation.
#[derive(Debug, Clone, PartialEq)]
pub(super) enum Change {
    /// Factor by which the poses' translations must be multiplied to fit the depth.
    Scale(f64),
    /// Focal lengths are wrong; holds which of fx and fy, and the factor by which to multiply them.
    Focal(Focal, f64),
    CentreSwapped,
    /// Principal points are off; holds the offset to add, to the right and down, in widths of the
    /// picture.
    CentreOff(DVec2),
    /// Number of metres that must be added to the depths.
    Short(f64),
    /// `by` metres must be added to the depths, and the poses' translations multiplied by `scale`.
    Planes {
        scale: f64,
        by: f64,
    },
    RayLength,
    /// Depth was already z, but was interpreted as ray length.
    NoRayLength,
    /// The stored values are reciprocals of depths; holds the factor by which the poses'
    /// translations must be multiplied to fit these depths.
    Inverse(f64),
    /// Depth maps hold reciprocals of depth, normalised between these two distances in metres, the nearer one first.
    InverseBetween(f64, f64),
    /// Depth maps hold values of a z-buffer; holds the distance of the near plane in metres.
    Buffer(f64),
    /// The poses use another convention; holds its [`Convention::name`](super::convention::Convention::name).
    Convention(&'static str),
    /// Parts of views belong to other pictures; holds a description of the assignment.
    Order(String, Moves),
    /// Pairs of views fit the poses of other views, but no consistent assignment exists, because two pictures would
    /// have the same pose.
    Unlisted,
    /// Some views are wrong; holds a description of the views and of the error.
    Views(String),
    /// Each picture is shifted by another amount; holds a description.
    Shifted(String),
    /// Cameras are swapped; holds a description of which cameras.
    Cameras(String),
    /// The lenses distort; holds their [`Reading::bend`].
    Bent(f64),
    /// Depth maps fit the pictures if they are shifted and scaled by this registration.
    Registered(Registration),
    /// Pictures or depth maps are flipped; holds a description of the direction.
    Flipped(Part, &'static str),
    /// Pictures fit better with the other treatment of their EXIF orientation: applied instead of ignored, or the
    /// reverse. Holds the setting that selects this treatment. Pictures have the camera's size in both cases.
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
    pub(super) const ALL: [Self; 3] = [Self::Both, Self::X, Self::Y];

    pub(super) fn times(self, factor: f64) -> DVec2 {
        match self {
            Self::Both => DVec2::splat(factor),
            Self::X => DVec2::new(factor, 1.0),
            Self::Y => DVec2::new(1.0, factor),
        }
    }
}

impl Change {
    /// True for changes with so many degrees of freedom that the few views of a quick check do not determine them.
    pub(super) fn needs_more_views(&self) -> bool {
        matches!(
            self,
            Self::Order(..) | Self::Unlisted | Self::Views(_) | Self::Shifted(_)
        )
    }

    /// True for changes that may improve the match of colours without improving the match of
    /// depths.
    pub(super) fn shows_in_colours(&self) -> bool {
        matches!(
            self,
            Self::Focal(..)
                | Self::CentreSwapped
                | Self::CentreOff(_)
                | Self::Shifted(_)
                | Self::Bent(_)
                | Self::Registered(_)
                | Self::Buffer(_)
                | Self::InverseBetween(..)
                | Self::Planes { .. }
                | Self::RayLength
                | Self::NoRayLength
        )
    }

    /// The smallest gain for which this change is reported: the fraction of the loss that it removes, and the
    /// improvement in standard errors.
    pub(super) fn least_gain(&self) -> (f64, f64) {
        let gain = match self {
            // Lens distortion has a small effect, but the same kind of effect everywhere.
            Self::Bent(_) => return (MIN_GAIN_OF_LENSES, MIN_ERRORS_OF_LENSES),
            Self::Scale(_) | Self::Focal(..) | Self::Registered(_) => MIN_GAIN_OF_FACTORS,
            Self::Views(_) => MIN_GAIN_OF_VIEWS,
            _ => MIN_GAIN,
        };
        (gain, MIN_ERRORS)
    }
}

/// The part of a view that is replaced by another view's; the other parts are kept.
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

/// An interpretation that fits better than the dataset reader's own.
#[derive(Debug, Clone)]
pub(super) struct Better {
    pub(super) change: Change,
    pub(super) as_read: Explained,
    pub(super) explained: Explained,
    /// True if the remaining loss is no larger than for valid data.
    pub(super) fits_well: bool,
    /// True if the loss is hardly less than with the dataset reader's own interpretation.
    pub(super) is_slight: bool,
}
