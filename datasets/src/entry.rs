//! Registry of datasets; each entry is defined next to its reader.

use serde::Serialize;

use crate::left_out::FoundScenes;
use crate::required_files::{PhotographPath, RequiredFile};
use crate::{
    DatasetError, DatasetSpec, booster, colmap, eth3d, middlebury, nerfstudio, scannetpp, stereo,
    synthetic, tanks_and_temples, wildrgbd,
};

/// All datasets: those of the paper's tables in order, then the user's own data, then the procedural scene.
pub static ENTRIES: [&DatasetEntry; 10] = [
    &middlebury::ENTRY,
    &booster::ENTRY,
    &scannetpp::ENTRY,
    &wildrgbd::ENTRY,
    &tanks_and_temples::ENTRY,
    &eth3d::ENTRY,
    &nerfstudio::ENTRY,
    &colmap::ENTRY,
    &stereo::ENTRY,
    &synthetic::ENTRY,
];

/// Looks up the entry of a format.
///
/// # Errors
/// [`DatasetError::UnknownFormat`].
pub fn entry(format: &str) -> Result<&'static DatasetEntry, DatasetError> {
    let found = ENTRIES.into_iter().find(|entry| entry.format == format);
    found.ok_or_else(|| DatasetError::UnknownFormat {
        name: format.to_owned(),
    })
}

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
    /// True if the terms allow publishing its pictures, and predictions from them, with attribution. True for the
    /// user's own data; false if terms contradict each other.
    pub may_publish: bool,
    pub download: &'static str,
    pub size: &'static str,
    /// The files that the reader looks for.
    pub layout: &'static str,
    /// Column group in the paper's tables; empty for data that the paper does not use.
    #[serde(rename = "table_column")]
    pub paper_column: &'static str,
    /// Criterion by which the paper chooses pairs; for other data, the rule that it would apply.
    #[serde(skip)]
    pub paper_overlap: PaperOverlap,
    /// Remaining uncertainties.
    pub caveat: &'static str,
    /// Available settings, for instance for different interpretations of the paper.
    #[serde(rename = "readings")]
    pub settings: &'static [Setting],
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
        open: |_| Ok(FoundScenes::default()),
        required_files: |_| Vec::new(),
        archives: |_| Vec::new(),
    };

    /// The photograph of a scene and its associated files in the dataset, in order of
    /// [`FileRole`](crate::required_files::FileRole), according to the layout alone; for a stereo pair, only the
    /// source's (left) depth is included. Files that are named in other files (`transforms.json`) or found by their
    /// stem are only known once those exist: see [`of_view`](crate::required_files::of_view).
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
    /// None: each stereo scene is one pair.
    Stereo,
    /// Overlap computed from the dataset's own dense depth.
    Dense,
    /// Overlap computed from predicted depth, scaled to the dataset's sparse depth.
    Sparse,
}

/// An option for opening a dataset, given as `key=value`.
#[derive(Debug, Serialize)]
pub struct Setting {
    pub key: &'static str,
    pub meaning: &'static str,
    pub default: &'static str,
    /// True if values other than the choices are allowed.
    #[serde(rename = "other_values")]
    pub any: bool,
    /// True if the paper leaves open which of several values it used.
    pub open: bool,
    /// Values with a specific meaning, the default first.
    pub choices: &'static [SettingChoice],
}

impl Setting {
    pub(crate) const fn choice(
        key: &'static str,
        meaning: &'static str,
        choices: &'static [SettingChoice],
    ) -> Self {
        Self {
            key,
            meaning,
            default: choices[0].value,
            any: false,
            open: false,
            choices,
        }
    }

    /// A setting with any value, some of which are described; the others count as proxies.
    pub(crate) const fn named(
        key: &'static str,
        meaning: &'static str,
        choices: &'static [SettingChoice],
    ) -> Self {
        Self {
            any: true,
            ..Self::choice(key, meaning, choices)
        }
    }

    pub(crate) const fn free(
        key: &'static str,
        meaning: &'static str,
        default: &'static str,
    ) -> Self {
        Self {
            key,
            meaning,
            default,
            any: true,
            open: false,
            choices: &[],
        }
    }

    /// Marks a setting whose value the paper leaves open.
    pub(crate) const fn left_open(self) -> Self {
        Self { open: true, ..self }
    }

    /// True if this setting has the given key and accepts the given value.
    pub fn allows(&self, key: &str, value: &str) -> bool {
        self.key == key && (self.any || self.choices.iter().any(|choice| choice.value == value))
    }

    /// True if a value is known to differ from the paper's procedure.
    pub(crate) fn is_proxy(&self, value: &str) -> bool {
        let chosen = self.choices.iter().find(|choice| choice.value == value);
        chosen.map_or(!self.choices.is_empty(), |choice| choice.proxy)
    }
}

/// One value of a [`Setting`].
#[derive(Debug, Serialize)]
pub struct SettingChoice {
    pub value: &'static str,
    pub meaning: &'static str,
    /// True if it is known to differ from the paper's procedure; reports then say "proxy".
    pub proxy: bool,
}

pub(crate) const fn choice(value: &'static str, meaning: &'static str) -> SettingChoice {
    SettingChoice {
        value,
        meaning,
        proxy: false,
    }
}

/// A choice that is known to differ from the paper's procedure.
pub(crate) const fn proxy(value: &'static str, meaning: &'static str) -> SettingChoice {
    SettingChoice {
        proxy: true,
        ..choice(value, meaning)
    }
}

/// Settings for reading pictures, available in every file-based format. They only become part of a dataset's identity
/// if given explicitly.
pub static PICTURES: [Setting; 3] = [
    Setting::choice(
        "alpha",
        "pictures that are not opaque",
        &[
            choice("refuse", "are an error"),
            choice("black", "are composited over black, in encoded values"),
            choice("white", "are composited over white, in encoded values"),
            choice("drop", "keep their colours as they are stored"),
        ],
    ),
    Setting::choice(
        "color",
        "pictures whose colour profile (ICC, cICP) is not sRGB",
        &[
            choice(
                "convert",
                "are converted to sRGB, clipped; tables of colours and inks are an error",
            ),
            choice("as-stored", "are taken for sRGB"),
        ],
    ),
    Setting::choice(
        "orientation",
        "pictures with an EXIF orientation",
        &[
            choice(
                "auto",
                "are read as stored where that fits the camera, upright where only that does",
            ),
            choice("stored", "are read as stored"),
            choice("upright", "are turned upright"),
        ],
    ),
];

/// Permission to refer to files outside the dataset's folder.
pub(crate) const OUTSIDE: Setting = Setting::choice(
    "outside",
    "files that `..`, an absolute path or a symbolic link puts outside the folder",
    &[
        choice("refuse", "are an error"),
        choice("allow", "are read; only for files you trust"),
    ],
);
