//! Weights of LPIPS and DISTS: requirements of each metric, sources and identities.
//!
//! The metrics' own small weights are included in the crate, as are torchvision's published convolutions of AlexNet and
//! VGG16 ([`Weights::at_hand`]). User-supplied files take precedence: torchvision's `.pth`, or a `.safetensors` with
//! the same names (with or without the leading `features.`). Only the convolutions are read.

pub(crate) mod backbone;
mod embedded;
#[cfg(any(feature = "download", test))]
mod fetch;
mod load;
mod registry;

use std::collections::BTreeMap;
use std::fmt;
use std::path::PathBuf;

use sharp_checkpoint::CheckpointError;

pub use backbone::{Backbone, UnknownBackbone};
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
    /// The network that a metric needs; `None` for PSNR and SSIM.
    pub fn of(metric: Metric) -> Option<Self> {
        match metric {
            Metric::Psnr | Metric::PsnrFloored | Metric::Ssim(_) => None,
            Metric::Lpips(net, _) => Some(Self::of_lpips(net)),
            Metric::Dists | Metric::DistsResize256 => Some(Self::Vgg16),
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
    /// the cross-check. Scores with these weights can be used to compare implementations, but not pictures.
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
