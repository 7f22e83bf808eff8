//! Weights of LPIPS and DISTS: which a metric needs, where they come from, what they are.
//!
//! The metrics' own small weights ship with the crate. The networks' come from files of the
//! user's: torchvision's `.pth`, or a `.safetensors` with the same names (with or without the
//! leading `features.`); only the convolutions are read.

mod embedded;
#[cfg(any(feature = "download", test))]
mod fetch;
mod load;
mod registry;

use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use serde::{Deserialize, Serialize};
use sharp_checkpoint::CheckpointError;

pub(crate) use embedded::{dists_weights, linear_weights};
#[cfg(any(feature = "download", test))]
pub use fetch::{FetchError, fetch};
pub(crate) use load::Tensors;
pub use registry::{Published, cache_folder, user_cache};

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
            Metric::Psnr | Metric::Ssim(_) => None,
            Metric::Lpips(net, _) => Some(Self::of_lpips(net)),
            Metric::Dists | Metric::DistsResize256 => Some(Self::Vgg16),
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

/// Where a network's weights come from; shown as the file, or as `deterministic:SALT`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum WeightsSource {
    File(PathBuf),
    /// A pure function of the tensors' names and this salt.
    Deterministic(String),
}

impl fmt::Display for WeightsSource {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::File(path) => path.display().fmt(f),
            Self::Deterministic(salt) => write!(f, "deterministic:{salt}"),
        }
    }
}

/// Where the weights of each network come from.
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

    /// The file given for a network.
    pub fn file(&self, backbone: Backbone) -> Option<&Path> {
        match self.sources.get(&backbone)? {
            WeightsSource::File(path) => Some(path),
            WeightsSource::Deterministic(_) => None,
        }
    }

    /// Whether there are weights for a network, sound or not.
    pub fn has(&self, backbone: Backbone) -> bool {
        self.sources.contains_key(&backbone)
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
