//! Facts about published networks that are known without their files: SHARP's checkpoint, and the encoder of the
//! perceptual loss.

use std::ops::RangeInclusive;
use std::path::Path;

use sharp::model::inventory::CheckpointSource;
use sharp::model::{Algorithm, Compute, ModelConfig};
use sharp_metrics::weights::mirrored;
use sharp_train::losses::{Perceptual, PerceptualOptions};

pub const RELEASE_FILE: &str = "sharp_2572gikvuh.pt";

pub const RELEASE_ADDRESS: &str = "https://ml-site.cdn-apple.com/models/sharp/sharp_2572gikvuh.pt";

pub const LICENCE_NAME: &str = "Apple Machine Learning Research Model License Agreement";

pub const LICENCE_ADDRESS: &str = "https://github.com/apple/ml-sharp/blob/main/LICENSE_MODEL";

/// Summary of the licence; the licence's text is authoritative.
pub const LICENCE_SUMMARY: &str = "use for research only: no commercial use, no product development, no part in a \
                                   commercial product or service; this also holds for models derived from it";

/// The licence's name, address and summary, to be read before accepting it.
pub fn licence_text() -> String {
    format!(
        "SHARP's checkpoint {RELEASE_FILE} is not part of this program. It is Apple's, under the\n  \
         {LICENCE_NAME}\n  {LICENCE_ADDRESS}\nIn short (the licence's own text is authoritative): {LICENCE_SUMMARY}."
    )
}

/// Address of the encoder in LaMa's perceptual loss, published by CSAIL's semantic-segmentation-pytorch.
pub const RESNET_ADDRESS: &str = "http://sceneparsing.csail.mit.edu/model/pytorch/ade20k-resnet50dilated-ppm_deepsup/\
                                  encoder_epoch_20.pth";

/// Name of the encoder's file in sharp-bench's cache; the original name, `encoder_epoch_20.pth`, is not descriptive.
pub const RESNET_FILE: &str = "resnet50dilated.pth";

/// A published file without a hash from its authors.
#[derive(Debug, Clone, PartialEq)]
pub struct Release {
    /// Name of the file on the command line of `weights fetch`.
    pub name: &'static str,
    /// File name in sharp-bench's cache.
    pub file: &'static str,
    pub published: &'static str,
    /// Download address.
    pub address: String,
    pub network: ReleasedNetwork,
    /// Name of the licence, and the address of its text.
    pub licence: (&'static str, &'static str),
    /// Plausible file sizes, in bytes.
    pub sizes: RangeInclusive<u64>,
}

/// The network that a file must contain.
#[derive(Debug, Clone, PartialEq)]
pub enum ReleasedNetwork {
    Sharp(Box<ModelConfig>),
    ResNet50Dilated,
}

/// Number of f32 values in the release's state dict.
const PARAMETERS: u64 = 702_305_169;

/// Number of parameters of the encoder: a ResNet-50 without its classifier, with three 3×3
/// convolutions in place of the 7×7 convolution.
const RESNET_PARAMETERS: u64 = 23_631_808;

/// Upper bound on what a file contains besides its parameters, in bytes: names, shapes and alignment of a thousand
/// tensors, and the running statistics of normalisation layers.
const OVERHEAD: u64 = 16 << 20;

/// Plausible sizes of a file with `parameters` f32 parameters, in bytes.
fn sizes(parameters: u64) -> RangeInclusive<u64> {
    4 * parameters..=4 * parameters + OVERHEAD
}

impl Release {
    /// SHARP's official release. Neither the size nor a hash of the file is published. The range of plausible sizes is
    /// computed from the number of parameters.
    pub fn official() -> Self {
        Self {
            name: "sharp",
            file: RELEASE_FILE,
            published: RELEASE_ADDRESS,
            address: mirrored(RELEASE_ADDRESS),
            network: ReleasedNetwork::Sharp(Box::new(ModelConfig::release())),
            licence: (LICENCE_NAME, LICENCE_ADDRESS),
            sizes: sizes(PARAMETERS),
        }
    }

    /// The network of the paper's perceptual loss.
    pub fn resnet50dilated() -> Self {
        Self {
            name: "resnet50dilated",
            file: RESNET_FILE,
            published: RESNET_ADDRESS,
            address: mirrored(RESNET_ADDRESS),
            network: ReleasedNetwork::ResNet50Dilated,
            licence: (
                "BSD 3-clause",
                "https://github.com/CSAILVision/semantic-segmentation-pytorch/blob/master/LICENSE",
            ),
            sizes: sizes(RESNET_PARAMETERS),
        }
    }

    /// Checks that a file contains the network; the error states what is wrong.
    pub(super) fn check(&self, file: &Path) -> Result<(), String> {
        match &self.network {
            ReleasedNetwork::Sharp(config) => CheckpointSource::open(file)
                .and_then(|source| source.check(config, &[]))
                .map_err(|error| format!("not SHARP's checkpoint: {error}")),
            ReleasedNetwork::ResNet50Dilated => {
                let options = PerceptualOptions {
                    resnet50dilated: Some(file.to_owned()),
                    ..PerceptualOptions::default()
                };
                let network = Perceptual::new(options, Compute::cpu(Algorithm::Winograd));
                network.map(|_| ()).map_err(|error| error.to_string())
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sharp::model::inventory::inventory;
    use sharp::model::params::Parameter;

    #[test]
    fn the_size_is_that_of_the_releases_parameters() {
        let release = Release::official();
        let parameters = inventory(&ModelConfig::release()).unwrap();
        let count: usize = parameters.iter().map(Parameter::len).sum();
        assert_eq!(count as u64, PARAMETERS);
        assert!(release.address.ends_with(RELEASE_FILE));
    }

    #[test]
    fn the_licence_is_shown_with_its_name_its_address_and_what_it_allows() {
        let text = licence_text();
        for part in [
            "Research Model License",
            "LICENSE_MODEL",
            "no commercial use",
        ] {
            assert!(text.contains(part), "{text}");
        }
    }
}
