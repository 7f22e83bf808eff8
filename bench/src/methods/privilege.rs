use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// What a method knows besides the source's photograph and the cameras; shown in reports.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
pub struct Privilege {
    #[serde(rename = "privilege")]
    pub depth: TrueDepth,
    /// Other views of the scene than the source.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub several_views: bool,
    /// The target's photograph, to which its camera is moved before the picture is scored.
    #[serde(default, skip_serializing_if = "std::ops::Not::not")]
    pub target_pose: bool,
}

/// What a method may know of the source's true depth.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum TrueDepth {
    #[default]
    None,
    /// Its scale: predicted Gaussians are scaled about the source camera by the median of true over predicted depth (the
    /// paper's "privileged depth evaluation", eq. global_scale). Predicted is the method's first depth layer, or where it
    /// has none the depth of its Gaussians as the source camera sees them. The method itself sees no depth.
    DepthScale,
    SourceDepth,
}

impl Privilege {
    /// Sees the source's photograph alone.
    pub const NONE: Self = Self::of_depth(TrueDepth::None);

    pub const fn of_depth(depth: TrueDepth) -> Self {
        Self {
            depth,
            several_views: false,
            target_pose: false,
        }
    }

    /// A phrase for each; kinds of methods that see the depth itself say so in their description.
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
