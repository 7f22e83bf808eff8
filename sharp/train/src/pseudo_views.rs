//! Settings of the second stage's pseudo-novel views.

use serde::Deserialize;

/// Choices about the second stage's pseudo-novel views that the paper leaves open.
#[derive(Debug, Clone, PartialEq, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PseudoViews {
    /// Maximum distance of a pseudo-novel camera from the photograph's, as a fraction of the photograph's median
    /// depth. The camera looks at a point at this depth.
    pub part_of_distance: f64,
    /// Each camera looks at a point near the photograph's axis. Maximum distance of that point from the axis, horizontally
    /// and vertically each, as a fraction of the median depth.
    pub part_aside: f64,
    /// Minimum alpha at which losses use a pixel of the rendering.
    pub covered: f32,
}

impl Default for PseudoViews {
    fn default() -> Self {
        Self {
            part_of_distance: 0.26,
            part_aside: 0.1,
            covered: 0.99,
        }
    }
}

impl PseudoViews {
    /// The first invalid value: its key, and the reason.
    pub(crate) fn first_fault(&self) -> Option<(&'static str, String)> {
        let checks = [
            (
                self.part_of_distance > 0.0 && self.part_of_distance < 1.0,
                "pseudo_views.part_of_distance",
                "is not between 0 and 1",
            ),
            (
                (0.0..1.0).contains(&self.part_aside),
                "pseudo_views.part_aside",
                "is not between 0 and 1",
            ),
            (
                (0.0..1.0).contains(&self.covered),
                "pseudo_views.covered",
                "is not between 0 and 1",
            ),
        ];
        let failed = checks.into_iter().find(|(holds, ..)| !holds);
        failed.map(|(_, key, reason)| (key, reason.to_owned()))
    }
}
