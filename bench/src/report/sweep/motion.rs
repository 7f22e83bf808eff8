//! Measures of motion between the two views of a pair.

use serde::Serialize;

use crate::evaluate::record::Record;

/// A quantity of a pair that does not depend on the method.
#[derive(
    Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Default, Serialize, clap::ValueEnum,
)]
#[serde(rename_all = "snake_case")]
pub enum Motion {
    /// Distance of the camera centres, metres
    #[default]
    #[value(name = "baseline_m")]
    BaselineM,
    /// Angle between the cameras, degrees
    #[value(name = "rotation_deg")]
    RotationDeg,
    /// Share of the target's pixels with depth that are visible in the source, from the pair list
    #[value(name = "overlap")]
    Overlap,
    /// Baseline divided by the target's median depth (the source's, if only the source has depth)
    #[value(name = "baseline/median_depth")]
    RelativeMotion,
    /// 1 − overlap: share of the target that is hidden from the source or outside the source's picture
    #[value(name = "disoccluded")]
    Disoccluded,
}

impl Motion {
    /// The quantities by which breakdowns divide pairs. `Disoccluded` is left out, because `Overlap` divides pairs in
    /// the same way.
    pub const DIVIDING: [Self; 4] = [
        Self::BaselineM,
        Self::RotationDeg,
        Self::Overlap,
        Self::RelativeMotion,
    ];

    /// The value for a record; `None` if unknown or not finite.
    pub fn of(self, record: &Record) -> Option<f64> {
        let value = match self {
            Self::BaselineM => Some(record.baseline_m),
            Self::RotationDeg => Some(record.rotation_deg),
            Self::Overlap => record.overlap,
            Self::RelativeMotion => record.median_depth_m.map(|depth| record.baseline_m / depth),
            Self::Disoccluded => record.overlap.map(|overlap| 1.0 - overlap),
        };
        value.filter(|value| value.is_finite())
    }

    /// Title for headings, label of an axis, and a definition.
    fn words(self) -> [&'static str; 3] {
        match self {
            Self::BaselineM => [
                "baseline, m",
                "camera baseline (m)",
                "Baseline: distance of the camera centres.",
            ],
            Self::RotationDeg => [
                "rotation, degrees",
                "rotation (degrees)",
                "Rotation: angle between the two cameras.",
            ],
            Self::Overlap => [
                "overlap",
                "overlap (share of the target seen by the source)",
                "Overlap: share of the target's pixels with depth that the source sees, as the pair list measured it.",
            ],
            Self::RelativeMotion => [
                "baseline / median depth",
                "baseline / median depth",
                "Median depth: the target's, or the source's if only that has depth.",
            ],
            Self::Disoccluded => [
                "share not seen by the source",
                "share of the target not seen by the source",
                "Not seen: 1 − overlap, the share of the target's pixels with depth that are hidden from the source or \
                 outside its picture.",
            ],
        }
    }

    pub fn title(self) -> &'static str {
        self.words()[0]
    }

    pub fn label(self) -> &'static str {
        self.words()[1]
    }

    /// A value of the axis with its name and unit, for use in a sentence.
    pub fn phrase(self, value: &str) -> String {
        match self {
            Self::BaselineM => format!("a camera baseline of {value} m"),
            Self::RotationDeg => format!("a rotation of {value}°"),
            Self::Overlap => format!("an overlap of {value}"),
            Self::RelativeMotion => format!("a baseline of {value} median depths"),
            Self::Disoccluded => format!("an unseen share of {value}"),
        }
    }

    /// A sentence that defines the quantity, for captions.
    pub fn definition(self) -> &'static str {
        self.words()[2]
    }

    /// Value at which the axis starts, unless the smallest value of the data is lower or far higher. `None` if the axis
    /// always starts at the smallest value.
    pub fn start(self) -> Option<f64> {
        (self != Self::Overlap).then_some(0.0)
    }
}
