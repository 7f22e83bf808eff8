//! Facts about the official checkpoint that are known without its file.

use std::ops::RangeInclusive;

use sharp::model::ModelConfig;
use sharp_metrics::weights::mirrored;

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

#[derive(Debug, Clone, PartialEq)]
pub struct Release {
    pub address: String,
    pub config: ModelConfig,
    /// Plausible file sizes, bytes.
    pub sizes: RangeInclusive<u64>,
}

/// Number of f32 values in the release's state dict.
const PARAMETERS: u64 = 702_305_169;

/// Upper bound on the size of the names, shapes and alignment of a thousand tensors, bytes.
const OVERHEAD: u64 = 16 << 20;

impl Release {
    /// The official release. Neither size nor hash of the file is published; the size follows from the number of
    /// parameters, except for the table of contents.
    pub fn official() -> Self {
        Self {
            address: mirrored(RELEASE_ADDRESS),
            config: ModelConfig::release(),
            sizes: 4 * PARAMETERS..=4 * PARAMETERS + OVERHEAD,
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
        let parameters = inventory(&release.config).unwrap();
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
