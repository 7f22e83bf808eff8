//! Weights of the networks that LPIPS and DISTS stand on.

use std::collections::BTreeMap;
use std::fmt;
use std::path::{Path, PathBuf};
use std::str::FromStr;

use crate::identity::{LpipsNet, Metric};

/// A network whose features LPIPS or DISTS compare; only its convolutions are needed.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub enum Backbone {
    /// torchvision's AlexNet.
    AlexNet,
    /// torchvision's VGG16 without batch normalisation.
    Vgg16,
    /// torchvision's SqueezeNet 1.1.
    SqueezeNet1_1,
}

/// No backbone of that name.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error("unknown network '{0}'; known: alexnet vgg16 squeezenet1_1")]
pub struct UnknownBackbone(String);

/// Why a weights file cannot be used.
#[derive(Debug, thiserror::Error)]
pub enum WeightsError {
    /// The operating system refused.
    #[error("weights of {backbone}: {}: {source}", path.display())]
    Io {
        /// The network.
        backbone: Backbone,
        /// The file.
        path: PathBuf,
        /// What the system said.
        source: std::io::Error,
    },
}

impl Backbone {
    /// All networks.
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
            Metric::Lpips(LpipsNet::Alex, _) => Some(Self::AlexNet),
            Metric::Lpips(LpipsNet::Vgg, _) | Metric::Dists | Metric::DistsResize256 => {
                Some(Self::Vgg16)
            }
            Metric::Lpips(LpipsNet::Squeeze, _) => Some(Self::SqueezeNet1_1),
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

/// Where the weights of each network come from.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct Weights {
    files: BTreeMap<Backbone, PathBuf>,
}

impl Weights {
    /// No weights: LPIPS and DISTS are unavailable.
    pub fn none() -> Self {
        Self::default()
    }

    /// Takes a network's weights from a file: torchvision's `.pth` or `.safetensors`.
    #[must_use]
    pub fn with_file(mut self, backbone: Backbone, file: impl Into<PathBuf>) -> Self {
        self.files.insert(backbone, file.into());
        self
    }

    /// The file given for a network.
    pub fn file(&self, backbone: Backbone) -> Option<&Path> {
        self.files.get(&backbone).map(PathBuf::as_path)
    }

    /// Whether the file given for a network, if any, can be opened.
    pub(crate) fn check(&self, backbone: Backbone) -> Result<(), WeightsError> {
        let Some(path) = self.file(backbone) else {
            return Ok(());
        };
        match std::fs::File::open(path) {
            Ok(_) => Ok(()),
            Err(source) => Err(WeightsError::Io {
                backbone,
                path: path.to_owned(),
                source,
            }),
        }
    }
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
