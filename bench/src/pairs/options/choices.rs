//! The choices that have names of their own.

/// Whether both directions between two views are pairs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PairOrder {
    /// Each way, judged on its own.
    Both,
    /// Only from the earlier view, in natural order, to the later one.
    Once,
}

/// What happens to views that have no depth.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum MissingDepth {
    /// They count when sets are formed, but join no pair.
    Reject,
    /// Their pairs qualify without an overlap.
    Accept,
    /// They are left out before sets are formed.
    LeaveOut,
}

/// Which of a pair's two overlaps the threshold looks at.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OverlapDirection {
    /// The share of the target's pixels that the source sees: what view synthesis needs.
    TargetInSource,
    /// The share of the source's pixels that the target sees.
    SourceInTarget,
    /// The smaller of the two.
    Min,
    /// Their mean.
    Mean,
    /// The larger of the two.
    Max,
}

impl OverlapDirection {
    /// The number that is compared with the threshold.
    pub fn of(self, target_in_source: f64, source_in_target: f64) -> f64 {
        match self {
            Self::TargetInSource => target_in_source,
            Self::SourceInTarget => source_in_target,
            Self::Min => target_in_source.min(source_in_target),
            Self::Mean => 0.5 * (target_in_source + source_in_target),
            Self::Max => target_in_source.max(source_in_target),
        }
    }
}

/// Whose depth decides overlap.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum OverlapDepth {
    /// The dataset's own, pixel by pixel.
    GroundTruth,
    /// The dataset's own where it is sparse: a point is seen if depth that was measured within so many pixels of where
    /// it lands agrees.
    Sparse {
        /// Pixels of the depth map.
        radius: u32,
    },
    /// Maps that someone else predicted, scaled to the dataset's own by the median of ratios: the paper's way on ETH3D.
    Given,
    /// The same as they are, in metres.
    GivenMetric,
    /// The first depth layer of SHARP's official checkpoint, scaled like [`Self::Given`].
    SharpRelease,
}

impl OverlapDepth {
    /// Radius of [`Self::Sparse`] unless given.
    pub const RADIUS: u32 = 8;

    /// True for the dataset's own depth, pixel by pixel.
    pub fn is_ground_truth(self) -> bool {
        self == Self::GroundTruth
    }
}
