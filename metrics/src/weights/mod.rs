//! Weights of LPIPS and DISTS: requirements of each metric, sources and identities.
//!
//! The metrics' own small weights are included in the crate, as are torchvision's published convolutions of AlexNet and
//! VGG16 ([`Weights::at_hand`]). User-supplied files take precedence: torchvision's `.pth`, or a `.safetensors` with
//! the same names (with or without the leading `features.`). Only the convolutions are read.

mod embedded;
#[cfg(any(feature = "download", test))]
mod fetch;
mod load;
mod registry;

use std::collections::BTreeMap;
use std::fmt;
use std::path::PathBuf;

use serde::{Deserialize, Serialize};
use sharp_checkpoint::CheckpointError;

pub(crate) use embedded::{dists_weights, linear_weights, linear_weights_v0};
#[cfg(any(feature = "download", test))]
pub use fetch::{FetchError, fetch};
pub use load::NamedTensors;
pub(crate) use load::Tensors;
pub use registry::{
    Published, cache_folder, lies_in, mirrored, own_folders, torch_hub, user_cache,
};

use crate::identity::{LpipsNet, Metric};
use crate::options::Device;

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

#[derive(Debug, thiserror::Error)]
pub enum WeightsError {
    /// The file cannot be read as a checkpoint.
    #[error("weights of {backbone}: {source}")]
    Checkpoint {
        backbone: Backbone,
        /// The reason; includes the file's name.
        source: CheckpointError,
    },
    /// The tensors in the file are not those of the network.
    #[error("{}: not the weights of {backbone}: {reason}", path.display())]
    Mismatch {
        backbone: Backbone,
        path: PathBuf,
        /// The missing, surplus or misshaped tensors.
        reason: String,
    },
    /// A weight is NaN or infinite.
    #[error("{}: {tensor} has a value that is not finite", path.display())]
    NotFinite { path: PathBuf, tensor: String },
    /// The network cannot be loaded onto the requested device.
    #[error("the networks cannot be computed on {device}: {reason}")]
    Device { device: Device, reason: String },
    /// The weights included in the crate are damaged.
    #[error("the built-in weights {file} are damaged: {reason}")]
    Embedded {
        /// Path in the crate's source.
        file: &'static str,
        reason: String,
    },
}

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

    /// The network that a metric needs; `None` for PSNR and SSIM.
    pub fn of(metric: Metric) -> Option<Self> {
        match metric {
            Metric::Psnr | Metric::PsnrFloored | Metric::Ssim(_) => None,
            Metric::Lpips(net, _) => Some(Self::of_lpips(net)),
            Metric::Dists | Metric::DistsResize256 => Some(Self::Vgg16),
        }
    }

    /// SHA-256 of the published features, computed as for [`WeightsUsed::features_sha256`].
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

    /// The network of an LPIPS variant.
    pub fn of_lpips(net: LpipsNet) -> Self {
        match net {
            LpipsNet::Alex => Self::AlexNet,
            LpipsNet::Vgg => Self::Vgg16,
            LpipsNet::Squeeze => Self::SqueezeNet1_1,
        }
    }
}

by_name!(Backbone, UnknownBackbone);

/// Source of a network's weights; displayed as the file, `built in` or `deterministic:SALT`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum WeightsSource {
    File(PathBuf),
    /// The published weights compiled into this program; AlexNet only.
    BuiltIn,
    /// Deterministic weights, computed from the tensors' names and this salt.
    Deterministic(String),
}

impl fmt::Display for WeightsSource {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::File(path) => path.display().fmt(f),
            Self::BuiltIn => f.write_str("built in"),
            Self::Deterministic(salt) => write!(f, "deterministic:{salt}"),
        }
    }
}

/// The source of each network's weights.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Weights {
    sources: BTreeMap<Backbone, WeightsSource>,
}

impl Weights {
    /// No weights; LPIPS and DISTS are then unavailable.
    pub fn none() -> Self {
        Self::default()
    }

    /// Deterministic weights computed from the tensors' names and `salt`, for all networks; used by the golden data and
    /// the cross-check. Scores with them are only meaningful to compare implementations, not pictures.
    pub fn deterministic(salt: &str) -> Self {
        let source = WeightsSource::Deterministic(salt.to_owned());
        Self {
            sources: Backbone::ALL.map(|b| (b, source.clone())).into(),
        }
    }

    /// Uses a network's weights from a file: torchvision's `.pth` or a `.safetensors`.
    #[must_use]
    pub fn with_file(mut self, backbone: Backbone, file: impl Into<PathBuf>) -> Self {
        self.sources
            .insert(backbone, WeightsSource::File(file.into()));
        self
    }

    /// Source of a network's weights, whether valid or not; `None` if no source is configured.
    pub fn source(&self, backbone: Backbone) -> Option<&WeightsSource> {
        self.sources.get(&backbone)
    }
}

/// Weights used by a scorer, for the record of a run.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct WeightsUsed {
    pub backbone: Backbone,
    pub source: WeightsSource,
    /// SHA-256 over the convolutions' names and f32 values: the same for torchvision's file and a features-only copy.
    pub features_sha256: String,
    /// SHA-256 of the file, or of the original file if a features-only copy records it. `None` without a file.
    pub original_sha256: Option<String>,
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_read_back() {
        for backbone in Backbone::ALL {
            assert_eq!(backbone.to_string().parse(), Ok(backbone));
        }
        assert!("vgg19".parse::<Backbone>().is_err());
    }
}
