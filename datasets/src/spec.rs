//! A dataset: static facts about it, and its specification on a command line.

use std::collections::BTreeMap;
use std::fmt;
use std::path::PathBuf;

use serde::Serialize;

use sharp::image_file::PictureRules;

use crate::found_scenes::{FoundScenes, LeftOutScene, by_reason};
use crate::required_files::{PhotographPath, RequiredFile};
use crate::setting::{PICTURES, Setting};
use crate::{DatasetError, files};

/// Static description of a dataset, as stated by its authors. Serialises to the output of `datasets list --json`.
#[derive(Debug, Serialize)]
pub struct DatasetEntry {
    /// Name used in `FORMAT=PATH`.
    pub format: &'static str,
    /// Name used in tables and plots.
    pub display_name: &'static str,
    /// Short description, with the part or version that is read.
    pub title: &'static str,
    /// Official page; empty for the user's own data.
    pub page: &'static str,
    /// Summary of the terms of use; the page is authoritative.
    pub terms: &'static str,
    /// True if the terms allow publishing the dataset's pictures, and predictions from them, with attribution. True for
    /// the user's own data; false if terms contradict each other.
    pub may_publish: bool,
    pub download: &'static str,
    pub size: &'static str,
    /// The files that the reader looks for.
    pub layout: &'static str,
    /// Column group in the paper's tables; empty for data that the paper does not use.
    #[serde(rename = "table_column")]
    pub paper_column: &'static str,
    /// The paper's rule for choosing pairs or, for data that the paper does not use, the rule that
    /// would apply.
    #[serde(skip)]
    pub paper_overlap: PaperOverlap,
    /// Remaining uncertainties about the dataset.
    pub caveat: &'static str,
    /// Available settings, for instance for different interpretations of the paper.
    #[serde(rename = "readings")]
    pub settings: &'static [Setting],
    /// True if the dataset's files store poses as matrices, so that no order of quaternions can be
    /// wrong.
    #[serde(skip)]
    pub(crate) poses_are_matrices: bool,
    #[serde(skip)]
    pub(crate) open: fn(&DatasetSpec) -> Result<FoundScenes, DatasetError>,
    #[serde(skip)]
    pub(crate) required_files: fn(&PhotographPath<'_>) -> Vec<RequiredFile>,
    #[serde(skip)]
    pub(crate) archives: fn(&PhotographPath<'_>) -> Vec<String>,
}

impl DatasetEntry {
    /// Defaults for the user's own data: no page, no terms, nothing to download.
    pub(crate) const OWN: Self = Self {
        format: "",
        display_name: "",
        title: "",
        page: "",
        terms: "yours",
        may_publish: true,
        download: "nothing",
        size: "any",
        layout: "",
        paper_column: "",
        paper_overlap: PaperOverlap::Dense,
        caveat: "",
        settings: &[],
        poses_are_matrices: false,
        open: |_| Ok(FoundScenes::default()),
        required_files: |_| Vec::new(),
        archives: |_| Vec::new(),
    };

    /// The photograph of a scene and the files that belong to it, in order of
    /// [`FileRole`](crate::required_files::FileRole), according to the layout alone. For a stereo
    /// pair, only the source's (left) depth is included. Files that other files list
    /// (`transforms.json`) or that are found by their stem are known only once they exist; see
    /// [`View::required_files`](crate::View::required_files).
    pub fn required_files(&self, scene: &str, picture: &str) -> Vec<RequiredFile> {
        let photograph = PhotographPath::new(scene, picture);
        let mut files = vec![RequiredFile::picture(picture)];
        files.extend((self.required_files)(&photograph));
        files
    }

    /// Archives on the official page that contain a scene; empty if unknown.
    pub fn archives(&self, scene: &str, picture: &str) -> Vec<String> {
        (self.archives)(&PhotographPath::new(scene, picture))
    }
}

/// The paper's rule for choosing a dataset's pairs.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum PaperOverlap {
    /// No rule: each stereo scene is one pair.
    Stereo,
    /// Overlap computed from the dataset's own dense depth.
    Dense,
    /// Overlap computed from predicted depth, scaled to the dataset's sparse depth.
    Sparse,
}

/// A dataset specification: `[NAME:]FORMAT=PATH[,key=value…]`. The procedural format has no path: `synthetic` or
/// `synthetic=seed=7,size=320x240`.
#[derive(Debug, Clone)]
pub struct DatasetSpec {
    /// Name of this instance, used as a column group in tables. Defaults to the format's name.
    pub name: String,
    pub entry: &'static DatasetEntry,
    /// Folder of the dataset; empty if procedural.
    pub path: PathBuf,
    /// Explicitly given settings only; [`DatasetSpec::setting`] adds the defaults.
    pub settings: BTreeMap<&'static str, String>,
}

/// A setting with its effective value; displayed as `key=value`.
#[derive(Debug, Clone, PartialEq, Eq, Serialize)]
pub struct SettingInForce {
    pub key: &'static str,
    pub value: String,
    /// True if the value is known to differ from the paper's procedure.
    pub proxy: bool,
    /// True if the paper leaves this setting open; the value is then one of several that the paper
    /// may have used.
    pub open: bool,
}

impl fmt::Display for SettingInForce {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}={}", self.key, self.value)
    }
}

impl DatasetSpec {
    /// Value of a setting: as given, or the default. Empty if the format does not have this key.
    pub fn setting(&self, key: &str) -> &str {
        let mut known = self.entry.settings.iter().chain(&PICTURES);
        let mut default = || known.find(|s| s.key == key);
        match self.settings.get(key) {
            Some(value) => value,
            None => default().map_or("", |setting| setting.default),
        }
    }

    /// True if the format has the setting `masks`; otherwise, the format itself defines which side
    /// of masks is kept.
    pub(crate) fn has_mask_sides(&self) -> bool {
        let mut settings = self.entry.settings.iter();
        settings.any(|setting| setting.allows("masks", "keep-black"))
    }

    /// Rules for reading the dataset's pictures.
    pub fn picture_rules(&self) -> PictureRules {
        // The values were validated when they were set.
        PictureRules::parse(|key| Some(self.setting(key))).unwrap_or_default()
    }

    /// Every setting of the format with its effective value, and the explicitly given ones of [`PICTURES`].
    pub fn readings(&self) -> Vec<SettingInForce> {
        let given = |setting: &&Setting| self.settings.contains_key(setting.key);
        let settings = self.entry.settings.iter();
        settings
            .chain(PICTURES.iter().filter(given))
            .map(|setting| {
                let value = self.setting(setting.key).to_owned();
                SettingInForce {
                    key: setting.key,
                    proxy: setting.is_proxy(&value),
                    open: setting.open,
                    value,
                }
            })
            .collect()
    }

    /// Value of a setting that must be a positive number.
    pub(crate) fn positive(&self, key: &str) -> Result<f64, DatasetError> {
        let text = self.setting(key);
        match text.parse::<f64>() {
            Ok(value) if value.is_finite() && value > 0.0 => Ok(value),
            _ => Err(self.refused(format!(
                "'{key}' cannot be '{text}'; it must be a number above zero"
            ))),
        }
    }

    pub(crate) fn refused(&self, reason: String) -> DatasetError {
        DatasetError::Spec {
            text: self.to_string(),
            reason,
        }
    }

    /// Completes the result of a reader by adding the folders that could not be searched.
    ///
    /// # Errors
    /// [`DatasetError::NoScene`] if there is no scene, not even a broken one; `expected` describes
    /// the layout that was searched for.
    pub(crate) fn conclude(
        &self,
        mut found: FoundScenes,
        expected: &'static str,
        unsearched: Vec<LeftOutScene>,
    ) -> Result<FoundScenes, DatasetError> {
        let broken = found.left_out.iter().any(|scene| scene.why.is_fault());
        found.left_out.extend(unsearched);
        if found.scenes.is_empty() && !broken {
            let groups = by_reason(&found.left_out).into_iter();
            let there = files::what_lies_in(&self.path);
            let notes = groups.map(|group| format!("; {group}"));
            let notes = std::iter::once(format!("; {there}")).chain(notes);
            return Err(DatasetError::NoScene {
                path: self.path.clone(),
                format: self.entry.format,
                expected,
                note: notes.collect(),
            });
        }
        Ok(found)
    }
}

impl fmt::Display for DatasetSpec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.name != self.entry.format {
            write!(f, "{}:", self.name)?;
        }
        f.write_str(self.entry.format)?;
        let path = self.path.display().to_string();
        let parts = (!path.is_empty())
            .then_some(path)
            .into_iter()
            .chain(self.settings.iter().map(|(k, v)| format!("{k}={v}")));
        for (i, part) in parts.enumerate() {
            write!(f, "{}{part}", if i == 0 { '=' } else { ',' })?;
        }
        Ok(())
    }
}
