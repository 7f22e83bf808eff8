//! Settings of datasets: keys, values and their meaning.

use serde::Serialize;

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

    /// Creates a setting that accepts any value. Values other than `choices` count as deviations from the paper.
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
    /// True if the value is known to differ from the paper's procedure; reports then say "proxy".
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

/// Settings for reading pictures, available in every file-based format. They are part of a
/// dataset's identity only if given explicitly.
pub static PICTURES: [Setting; 3] = [
    Setting::choice(
        "alpha",
        "what to do with pictures that are not opaque",
        &[
            choice("refuse", "report an error"),
            choice("black", "composite over black, in encoded values"),
            choice("white", "composite over white, in encoded values"),
            choice("drop", "keep the colours as stored"),
        ],
    ),
    Setting::choice(
        "color",
        "what to do with pictures whose colour profile (ICC, cICP) is not sRGB",
        &[
            choice(
                "convert",
                "convert to sRGB and clip; profiles with lookup tables and CMYK profiles are an error",
            ),
            choice("as-stored", "read as if they were sRGB"),
        ],
    ),
    Setting::choice(
        "orientation",
        "what to do with pictures that have an EXIF orientation",
        &[
            choice(
                "auto",
                "read as stored if that size fits the camera; turn upright if only the upright size fits",
            ),
            choice("stored", "read as stored"),
            choice("upright", "turn upright"),
        ],
    ),
];

/// Permission to refer to files outside the dataset's folder.
pub(crate) const OUTSIDE: Setting = Setting::choice(
    "outside",
    "what to do with files outside the folder, reached through `..`, an absolute path or a symbolic link",
    &[
        choice("refuse", "report an error"),
        choice("allow", "read them; only for datasets that you trust"),
    ],
);
