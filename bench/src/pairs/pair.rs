//! One row of a pair list.

/// An ordered pair of views: the target is to be predicted from the source. One row of a pair list.
#[derive(Debug, Clone, PartialEq)]
pub struct Pair {
    /// `dataset/scene/source__target`; see [`super::pair_id`].
    pub pair_id: String,
    pub dataset: String,
    pub scene: String,
    /// Number of the set within the scene, from 0; `None` for a stereo scene.
    pub set: Option<u32>,
    pub source: String,
    pub target: String,
    /// File of the source's photograph relative to the dataset's folder, with `/` as separator; empty for a procedural
    /// view.
    pub source_file: String,
    pub target_file: String,
    /// SHA-256 of the source's photograph; empty if it could not be read.
    pub source_sha256: String,
    /// SHA-256 of the target's photograph; empty if it could not be read.
    pub target_sha256: String,
    /// Distance of the two camera centres, in metres.
    pub baseline_m: f64,
    /// Angle between the two cameras, in degrees.
    pub rotation_deg: f64,
    /// Median depth of the target, in metres. If the target of a stereo pair has no depth, the median depth of the
    /// source, because both views of a rectified pair share the depth axis. `None` if neither has depth.
    pub median_depth_m: Option<f64>,
    /// Share of the target's pixels that are visible in the source; `None` without depth.
    pub overlap: Option<f64>,
    /// Share of the source's pixels that are visible in the target; `None` without depth.
    pub overlap_source_to_target: Option<f64>,
    pub selected: bool,
}
