//! Dataset specs of a command line or a file.

use std::collections::BTreeMap;
use std::fmt;
use std::path::PathBuf;
use std::str::FromStr;

use serde::{Deserialize, Serialize};
use sharp_datasets::{DatasetError, DatasetSpec};

use crate::pairs::frame::Frame;
use crate::pairs::{PairError, PairOptions};

/// Prefix that distinguishes a dataset's pair options from its reader settings.
const PAIR_OPTION: &str = "pairs.";

/// Prefix of the setting with a dataset's [`Frame`].
const FRAME: &str = "frame=";

/// A dataset spec `[NAME:]FORMAT=PATH[,key=value…]`, where a key is a reader setting, `frame`, or `pairs.` followed by
/// a pair option.
#[derive(Debug, Clone, Serialize, Deserialize, schemars::JsonSchema)]
#[schemars(with = "String")]
#[serde(into = "String", try_from = "String")]
pub struct DatasetConfig {
    pub spec: DatasetSpec,
    /// Size to which views are resized; `None` keeps their own size.
    pub frame: Option<Frame>,
    pub pairs: PairOverrides,
}

/// Pair options of one dataset, which override the common ones.
#[derive(Debug, Clone, Default, PartialEq, Eq)]
pub struct PairOverrides {
    /// Values of [`PairOptions`](crate::pairs::PairOptions) as text, by their keys.
    pub options: BTreeMap<String, String>,
    pub overlap_depth: Option<PathBuf>,
    pub overlap_checkpoint: Option<PathBuf>,
    pub overlap_config: Option<String>,
}

impl PairOverrides {
    /// Comma-separated `key=value`, the form that
    /// [`PairOptions::with`](crate::pairs::PairOptions::with) parses.
    pub fn options_text(&self) -> String {
        self.options().join(",")
    }

    fn options(&self) -> Vec<String> {
        let options = self.options.iter();
        options
            .map(|(key, value)| format!("{key}={value}"))
            .collect()
    }

    /// All overrides as `key=value`, in a fixed order.
    fn entries(&self) -> Vec<String> {
        let mut entries = self.options();
        let files = [
            ("overlap-depth", &self.overlap_depth),
            ("overlap-checkpoint", &self.overlap_checkpoint),
        ];
        for (key, file) in files {
            entries.extend(
                file.as_ref()
                    .map(|file| format!("{key}={}", file.display())),
            );
        }
        let config = self.overlap_config.as_ref();
        entries.extend(config.map(|config| format!("overlap-config={config}")));
        entries
    }
}

impl DatasetConfig {
    /// A copy without pair options, for purposes that depend only on the views.
    #[must_use]
    pub fn without_pairs(&self) -> Self {
        Self {
            pairs: PairOverrides::default(),
            ..self.clone()
        }
    }
}

/// Parses a spec for clap. The error omits the spec, because clap quotes it.
pub(crate) fn clap_dataset(text: &str) -> Result<DatasetConfig, String> {
    text.parse().map_err(|error| match error {
        PairError::DatasetSpec { reason, .. }
        | PairError::Dataset(DatasetError::Spec { reason, .. }) => reason,
        error => error.to_string(),
    })
}

impl FromStr for DatasetConfig {
    type Err = PairError;

    fn from_str(text: &str) -> Result<Self, PairError> {
        let refused = |reason: String| PairError::DatasetSpec {
            spec: text.to_owned(),
            reason,
        };
        let (mut frame, mut pairs) = (None, PairOverrides::default());
        let mut of_reader = Vec::new();
        for part in text.split(',') {
            let key = part.trim_start();
            if let Some(value) = key.strip_prefix(FRAME) {
                let value = value.parse().map_err(refused)?;
                if frame.replace(value).is_some() {
                    return Err(refused("'frame' is given twice".to_owned()));
                }
            } else if let Some(option) = key.strip_prefix(PAIR_OPTION) {
                let Some((key, value)) = option.split_once('=') else {
                    return Err(refused(format!("'{part}' is not key=value")));
                };
                let value = value.to_owned();
                let is_repeated = match key {
                    "overlap-depth" => pairs.overlap_depth.replace(value.into()).is_some(),
                    "overlap-checkpoint" => {
                        pairs.overlap_checkpoint.replace(value.into()).is_some()
                    }
                    "overlap-config" => pairs.overlap_config.replace(value).is_some(),
                    _ => {
                        let set = PairOptions::default().set(key, &value);
                        set.map_err(|error| match error {
                            PairError::Options(reason) => {
                                refused(format!("{PAIR_OPTION}{key}: {reason}"))
                            }
                            other => other,
                        })?;
                        pairs.options.insert(key.to_owned(), value).is_some()
                    }
                };
                if is_repeated {
                    return Err(refused(format!("'{PAIR_OPTION}{key}' is given twice")));
                }
            } else {
                of_reader.push(part);
            }
        }
        Ok(Self {
            spec: DatasetSpec::parse(&of_reader.join(","))?,
            frame,
            pairs,
        })
    }
}

impl fmt::Display for DatasetConfig {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}", self.spec)?;
        if let Some(frame) = self.frame {
            write!(f, ",{FRAME}{frame}")?;
        }
        for entry in self.pairs.entries() {
            write!(f, ",{PAIR_OPTION}{entry}")?;
        }
        Ok(())
    }
}

impl From<DatasetConfig> for String {
    fn from(dataset: DatasetConfig) -> Self {
        dataset.to_string()
    }
}

impl TryFrom<String> for DatasetConfig {
    type Error = PairError;

    fn try_from(text: String) -> Result<Self, PairError> {
        text.parse()
    }
}

impl PartialEq for DatasetConfig {
    fn eq(&self, other: &Self) -> bool {
        self.to_string() == other.to_string()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_parsed_is_printed() {
        for text in [
            "E:eth3d=a/b,images=undistorted,pairs.overlap=given,pairs.overlap-depth=d",
            "synthetic=size=48x36,frame=cover:24x24:area,pairs.order=once",
            "synthetic",
        ] {
            let parsed: DatasetConfig = text.parse().unwrap();
            assert_eq!(parsed.to_string(), text);
        }
        let text = "E:eth3d=a,pairs.overlap=given,images=undistorted";
        let parsed: DatasetConfig = text.parse().unwrap();
        assert_eq!(
            parsed.to_string(),
            "E:eth3d=a,images=undistorted,pairs.overlap=given"
        );
        assert_eq!(
            parsed.without_pairs().to_string(),
            "E:eth3d=a,images=undistorted"
        );
    }

    #[test]
    fn mistakes_are_named() {
        for (text, part) in [
            ("synthetic,frame=cover", "WxH"),
            ("synthetic,frame=width:9:area,frame=width:9:area", "twice"),
            ("synthetic,pairs.order=once,pairs.order=both", "twice"),
            ("synthetic,pairs.order", "key=value"),
            ("synthetic,pairs.colour=blue", "unknown key 'colour'"),
            ("synthetic,pairs.order=never", "order=never: "),
            ("synthetic,colour=blue", "no setting 'colour'"),
        ] {
            let error = text.parse::<DatasetConfig>().unwrap_err().to_string();
            assert!(error.contains(part), "{text}: {error}");
        }
    }
}
