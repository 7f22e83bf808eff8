use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// Information that a method uses beyond the source's photograph and the cameras; shown in reports.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
pub struct Privilege {
    #[serde(rename = "privilege")]
    pub depth: TrueDepth,
    /// Whether the method uses views of the scene other than the source.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub several_views: bool,
    /// Whether the target's camera is aligned to the target's photograph before the picture is scored.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub target_pose: bool,
}

/// Use of the source's true depth.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum TrueDepth {
    #[default]
    None,
    /// Only the scale of the true depth: predicted Gaussians are scaled about the source camera by the median ratio of
    /// true to predicted depth (the paper's "privileged depth evaluation", eq. global_scale). The predicted depth is
    /// the method's first depth layer, or else that of its Gaussians rendered from the source camera. The method itself
    /// does not get the true depth.
    DepthScale,
    SourceDepth,
}

impl Privilege {
    /// Uses only the photograph and the cameras.
    pub const NONE: Self = Self::of_depth(TrueDepth::None);

    pub const fn of_depth(depth: TrueDepth) -> Self {
        Self {
            depth,
            several_views: false,
            target_pose: false,
        }
    }

    /// One phrase per privilege. Seeing the true depth itself has no phrase, because the descriptions of such methods
    /// mention it.
    pub fn phrases(self) -> impl Iterator<Item = &'static str> {
        let scale = self.depth == TrueDepth::DepthScale;
        [
            scale.then_some("its scale aligned to the source's true depth"),
            self.several_views.then_some("sees several views"),
            self.target_pose
                .then_some("the target's camera moved to fit its photograph"),
        ]
        .into_iter()
        .flatten()
    }
}
