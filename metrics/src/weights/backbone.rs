//! Networks whose features the learned metrics compare.

use serde::{Deserialize, Serialize};

/// A network whose features LPIPS or DISTS compare; only its convolutions are needed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Backbone {
    AlexNet,
    /// VGG16 without batch normalisation.
    Vgg16,
    SqueezeNet1_1,
}

#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("unknown network '{0}'; known: alexnet vgg16 squeezenet1_1")]
pub struct UnknownBackbone(String);

impl Backbone {
    pub const ALL: [Self; 3] = [Self::AlexNet, Self::Vgg16, Self::SqueezeNet1_1];

    /// torchvision's name: `alexnet`, `vgg16`, `squeezenet1_1`.
    pub fn name(self) -> &'static str {
        match self {
            Self::AlexNet => "alexnet",
            Self::Vgg16 => "vgg16",
            Self::SqueezeNet1_1 => "squeezenet1_1",
        }
    }

    /// SHA-256 of the published features, computed as for [`WeightsUsed::features_sha256`](super::WeightsUsed::features_sha256).
    ///
    /// With these weights, AlexNet and SqueezeNet reproduce the values in the documentation of lpips (0.722 for its
    /// first pair of examples) and torchmetrics (0.1005).
    pub fn published_features(self) -> &'static str {
        match self {
            Self::AlexNet => "8eed026b364dd02bdf76d6ca5a9bfaa0efb090d22a8b79ad51186269c08605c7",
            Self::Vgg16 => "2b36fb93d5999585cb8768685c9bf7c6c5e6a7982cca582d3138b2910433df50",
            Self::SqueezeNet1_1 => {
                "8f728f13ffc4c9ed6b00faa9362ec13d7d3520652d0a8357047045aba9def764"
            }
        }
    }
}

by_name!(Backbone, UnknownBackbone);
