//! Weights of LPIPS and DISTS: which a metric needs, where they come from, what they are.
//!
//! The metrics' own small weights ship with the crate, and so do the convolutions that torchvision
//! published of AlexNet and VGG16 ([`Weights::at_hand`]). Files of the user's come before them:
//! torchvision's `.pth`, or a `.safetensors` with the same names (with or without the leading
//! `features.`); only the convolutions are read.

mod embedded;
#[cfg(any(feature = "download", test))]
mod fetch;
mod load;
mod registry;

use std::collections::BTreeMap;
use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;

use serde::{Deserialize, Serialize};
use sharp_checkpoint::CheckpointError;

pub(crate) use embedded::{dists_weights, linear_weights, linear_weights_v0};
#[cfg(any(feature = "download", test))]
pub use fetch::{FetchError, fetch};
pub use load::NamedTensors;
pub(crate) use load::Tensors;
pub use registry::{Published, cache_folder, lies_in, mirrored, own_folder, torch_hub, user_cache};

use crate::identity::{LpipsNet, Metric};
use crate::options::Device;

/// A network whose features LPIPS or DISTS compare; only its convolutions are needed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Backbone {
    AlexNet,
    /// Without batch normalisation.
    Vgg16,
    SqueezeNet1_1,
}

#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("unknown network '{0}'; known: alexnet vgg16 squeezenet1_1")]
pub struct UnknownBackbone(String);

/// Why weights cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum WeightsError {
    /// The file cannot be read as a checkpoint.
    #[error("weights of {backbone}: {source}")]
    Checkpoint {
        backbone: Backbone,
        /// Why; names the file.
        source: CheckpointError,
    },
    /// The file holds other tensors than the network has.
    #[error("{}: not the weights of {backbone}: {reason}", path.display())]
    Mismatch {
        backbone: Backbone,
        path: PathBuf,
        /// What is missing, surplus or of another shape.
        reason: String,
    },
    /// A weight is NaN or infinite.
    #[error("{}: {tensor} holds a value that is not finite", path.display())]
    NotFinite { path: PathBuf, tensor: String },
    /// The network cannot be put where it was to be computed.
    #[error("the networks cannot be computed on {device}: {reason}")]
    Device { device: Device, reason: String },
    /// The weights that ship with the crate are damaged.
    #[error("the built-in weights {file} are damaged: {reason}")]
    Embedded {
        /// The file in the crate's source.
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

    /// sha256 of the published features, as [`WeightsUsed::features_sha256`] counts it.
    ///
    /// With these, AlexNet's and SqueezeNet's give the values that the documentation of lpips (0.722
    /// for its first pair of examples) and of torchmetrics (0.1005) shows.
    pub fn published_features(self) -> &'static str {
        match self {
            Self::AlexNet => "8eed026b364dd02bdf76d6ca5a9bfaa0efb090d22a8b79ad51186269c08605c7",
            Self::Vgg16 => "2b36fb93d5999585cb8768685c9bf7c6c5e6a7982cca582d3138b2910433df50",
            Self::SqueezeNet1_1 => {
                "8f728f13ffc4c9ed6b00faa9362ec13d7d3520652d0a8357047045aba9def764"
            }
        }
    }

    /// The network of an LPIPS.
    pub fn of_lpips(net: LpipsNet) -> Self {
        match net {
            LpipsNet::Alex => Self::AlexNet,
            LpipsNet::Vgg => Self::Vgg16,
            LpipsNet::Squeeze => Self::SqueezeNet1_1,
        }
    }
}

impl fmt::Display for Backbone {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.pad(self.name())
    }
}

impl FromStr for Backbone {
    type Err = UnknownBackbone;

    fn from_str(name: &str) -> Result<Self, UnknownBackbone> {
        Self::ALL
            .into_iter()
            .find(|backbone| backbone.name() == name)
            .ok_or_else(|| UnknownBackbone(name.to_owned()))
    }
}

/// Source of a network's weights; displays as the file, as `built in` or as `deterministic:SALT`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum WeightsSource {
    File(PathBuf),
    /// The published ones, inside this program; AlexNet only.
    BuiltIn,
    /// A pure function of the tensors' names and this salt.
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
    /// No weights: LPIPS and DISTS are unavailable.
    pub fn none() -> Self {
        Self::default()
    }

    /// Weights that are a pure function of the tensors' names and `salt`, for all networks: what
    /// the golden data and the cross-check use. Scores with them compare implementations, not
    /// pictures.
    pub fn deterministic(salt: &str) -> Self {
        let source = WeightsSource::Deterministic(salt.to_owned());
        Self {
            sources: Backbone::ALL.map(|b| (b, source.clone())).into(),
        }
    }

    /// Takes a network's weights from a file: torchvision's `.pth` or a `.safetensors`.
    #[must_use]
    pub fn with_file(mut self, backbone: Backbone, file: impl Into<PathBuf>) -> Self {
        self.sources
            .insert(backbone, WeightsSource::File(file.into()));
        self
    }

    /// Where a network's weights are, sound or not; `None` without any.
    pub fn source(&self, backbone: Backbone) -> Option<&WeightsSource> {
        self.sources.get(&backbone)
    }
}

/// Weights that a scorer uses, for the record of a run.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct WeightsUsed {
    pub backbone: Backbone,
    pub source: WeightsSource,
    /// sha256 over the convolutions' names and f32 values: equal for torchvision's file and for a
    /// copy that holds the features only.
    pub features_sha256: String,
    /// sha256 of the file; of the file that it was made from where a features-only copy says so.
    /// `None` without a file.
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
