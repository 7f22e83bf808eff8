use schemars::JsonSchema;
use serde::{Deserialize, Serialize};

/// What a method may know of the source's true depth; shown in reports.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "snake_case")]
pub enum Privilege {
    #[default]
    None,
    /// Its scale: predicted Gaussians are scaled about the source camera by the median of true over predicted depth (the
    /// paper's "privileged depth evaluation", eq. global_scale). Predicted is the method's first depth layer, or where it
    /// has none the depth of its Gaussians as the source camera sees them. The method itself sees no depth.
    DepthScale,
    SourceDepth,
}
