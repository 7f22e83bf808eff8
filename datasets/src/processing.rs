//! Processing steps from files to pixels. Each scene gets one note for each kind of step.

/// Processing steps of one view's files.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Processing {
    /// Resampling of the photograph; `None` if it is used as stored.
    pub undistorted: Option<Undistorted>,
    /// True if a mask made some pixels black and without depth.
    pub masked: bool,
    /// True if no file is known to contain the view's depth.
    pub lacks_depth: bool,
    /// True if depth is rendered from a scan at the view's pose, rather than read from a map that belongs to the
    /// picture.
    pub depth_by_pose: bool,
}

/// Conversion of a photograph to a pinhole camera.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Undistorted {
    /// COLMAP's name of the lens model.
    pub model: &'static str,
    /// Rule by which the pinhole camera was chosen.
    pub camera: &'static str,
}
