//! What a dataset format is, what can be set about it, and a dataset as asked for.

use std::collections::BTreeMap;
use std::fmt;
use std::path::PathBuf;

use crate::skipped::Skipped;
use crate::{DatasetError, Scene};

/// One dataset format.
#[derive(Debug)]
pub struct Format {
    /// As written in `FORMAT=PATH`.
    pub name: &'static str,
    /// One line: what it is and what it looks for.
    pub summary: &'static str,
    /// What can be chosen, for instance between readings of the paper.
    pub settings: &'static [Setting],
    pub(crate) open: fn(&DatasetSpec) -> Result<Attempts, DatasetError>,
}

/// The scenes found, in order; one that cannot be read does not hide the others.
pub(crate) type Attempts = Vec<Result<Scene, DatasetError>>;

/// The scenes that a reader found below a folder, with a note on what it left out.
///
/// # Errors
/// [`DatasetError::NoScene`] when there is none; `expected` is the layout that was looked for.
pub(crate) fn conclude(
    spec: &DatasetSpec,
    mut scenes: Attempts,
    expected: &'static str,
    left_out: &[&Skipped],
) -> Result<Attempts, DatasetError> {
    let notes = left_out
        .iter()
        .flat_map(|skipped| skipped.notes(&spec.path));
    if scenes.is_empty() {
        return Err(DatasetError::NoScene {
            path: spec.path.clone(),
            format: spec.format,
            expected,
            note: notes.map(|note| format!("; {note}")).collect(),
        });
    }
    if let Some(first) = scenes.iter_mut().flatten().next() {
        first.notes.extend(notes);
    }
    Ok(scenes)
}

/// Something that can be chosen when a dataset is opened, as `key=value`.
#[derive(Debug, PartialEq, Eq)]
pub struct Setting {
    /// The key.
    pub key: &'static str,
    /// What it decides.
    pub meaning: &'static str,
    /// The values that have a meaning of their own, the default first; empty when none has.
    pub choices: &'static [Choice],
    /// Whether other values are allowed too.
    pub any: bool,
    /// The default.
    pub default: &'static str,
}

impl Setting {
    pub(crate) const fn choice(
        key: &'static str,
        meaning: &'static str,
        choices: &'static [Choice],
    ) -> Self {
        Self {
            key,
            meaning,
            choices,
            any: false,
            default: choices[0].value,
        }
    }

    /// Any value, of which some are described; the others count as proxies.
    pub(crate) const fn named(
        key: &'static str,
        meaning: &'static str,
        choices: &'static [Choice],
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
            choices: &[],
            any: true,
            default,
        }
    }
}

/// One value of a [`Setting`].
#[derive(Debug, PartialEq, Eq)]
pub struct Choice {
    /// As written.
    pub value: &'static str,
    /// What it means.
    pub meaning: &'static str,
    /// True where it is known to differ from what the paper did: reports then say "proxy".
    pub proxy: bool,
}

impl Choice {
    pub(crate) const fn new(value: &'static str, meaning: &'static str) -> Self {
        Self {
            value,
            meaning,
            proxy: false,
        }
    }

    pub(crate) const fn proxy(value: &'static str, meaning: &'static str) -> Self {
        Self {
            value,
            meaning,
            proxy: true,
        }
    }
}

/// Whether files outside the dataset's folder may be named.
pub(crate) const OUTSIDE: Setting = Setting::choice(
    "outside",
    "files that `..`, an absolute path or a symbolic link puts outside the folder",
    &[
        Choice::new("refuse", "are an error"),
        Choice::new("allow", "are read; only for files you trust"),
    ],
);

/// A dataset as asked for: `[NAME:]FORMAT=PATH[,key=value…]`. The procedural format has no path:
/// `synthetic` or `synthetic=seed=7,size=320x240`.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct DatasetSpec {
    /// Name of this instance: a column group of the tables. The format's name unless given.
    pub name: String,
    /// The format's name.
    pub format: &'static str,
    /// The dataset's folder; empty for a procedural one.
    pub path: PathBuf,
    /// Only what was asked for; [`DatasetSpec::setting`] knows the defaults.
    pub settings: BTreeMap<&'static str, String>,
    /// What can be set.
    pub(crate) known: &'static [Setting],
}

impl DatasetSpec {
    /// The value of a setting: as asked for, or the default. Empty for a key the format lacks.
    pub fn setting(&self, key: &str) -> &str {
        match self.settings.get(key) {
            Some(value) => value,
            None => self
                .known
                .iter()
                .find(|s| s.key == key)
                .map_or("", |s| s.default),
        }
    }

    /// Every setting with its effective value, and whether that value is known to differ from
    /// what the paper did.
    pub fn readings(&self) -> Vec<(&'static str, String, bool)> {
        self.known
            .iter()
            .map(|s| {
                let value = self.setting(s.key);
                let chosen = s.choices.iter().find(|c| c.value == value);
                let proxy = chosen.map_or(!s.choices.is_empty(), |c| c.proxy);
                (s.key, value.to_owned(), proxy)
            })
            .collect()
    }

    /// The value of a setting that is a number above zero.
    pub(crate) fn positive(&self, key: &str) -> Result<f64, DatasetError> {
        let text = self.setting(key);
        match text.parse::<f64>() {
            Ok(value) if value.is_finite() && value > 0.0 => Ok(value),
            _ => Err(DatasetError::Spec {
                text: self.to_string(),
                reason: format!("'{key}' cannot be '{text}'; it is a number above zero"),
            }),
        }
    }
}

impl fmt::Display for DatasetSpec {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.name != self.format {
            write!(f, "{}:", self.name)?;
        }
        f.write_str(self.format)?;
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
