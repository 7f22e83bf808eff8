//! A dataset as specified on a command line, and opening its scenes.

use std::collections::BTreeMap;
use std::fmt;
use std::path::PathBuf;

use serde::Serialize;

use sharp::image_file::PictureRules;

use crate::entry::{DatasetEntry, PICTURES, Setting, entry};
use crate::error::nearest_of;
use crate::left_out::{FoundScenes, LeftOutScene, by_reason};
use crate::{DatasetError, Scene, files, picture_notes, processing, synthetic};

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
    /// True if the paper leaves this open, so that the value is one of several it may have used.
    pub open: bool,
}

impl fmt::Display for SettingInForce {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}={}", self.key, self.value)
    }
}

impl DatasetSpec {
    /// Parses `[NAME:]FORMAT=PATH[,key=value…]`. A path may contain `:`, `=` and commas, but not a comma followed by
    /// text with `=`, which is parsed as a setting.
    ///
    /// # Errors
    /// [`DatasetError::UnknownFormat`]; [`DatasetError::Spec`] for a missing path, an unknown key, or a value that is
    /// not among the key's choices.
    pub fn parse(text: &str) -> Result<Self, DatasetError> {
        let error = |reason: String| DatasetError::Spec {
            text: text.to_owned(),
            reason,
        };
        // Without a path, the settings may directly follow the format: `synthetic,views=4`.
        let (head, mut path) = match text.find(['=', ',']) {
            Some(at) => (&text[..at], &text[at + 1..]),
            None => (text, ""),
        };
        let (name, format) = match head.rsplit_once(':') {
            Some(("", _)) => return Err(error("the name before ':' is empty".into())),
            Some((name, format)) => (name, format),
            None => (head, head),
        };
        if name.contains(char::is_control) {
            return Err(error(
                "a name has no line ends and no other control characters".into(),
            ));
        }
        let entry = entry(format)?;
        let procedural = format == synthetic::ENTRY.format;
        let no_folder = || error(format!("no folder: write {format}=FOLDER"));
        if !procedural && text[head.len()..].starts_with(',') {
            return Err(no_folder());
        }
        // Settings are parsed from the end, so that a path may contain commas and equal signs.
        let mut settings = BTreeMap::new();
        while !path.is_empty() {
            let (before, last) = match path.rsplit_once(',') {
                Some(parts) => parts,
                None if procedural => ("", path),
                None => break,
            };
            let Some((key, value)) = last.split_once('=') else {
                if procedural {
                    return Err(error(format!("'{last}' is not key=value")));
                }
                break;
            };
            let mut known = entry.settings.iter().chain(&PICTURES);
            let Some(setting) = known.find(|s| s.key == key) else {
                let known = entry.settings.iter().chain(&PICTURES);
                let known: Vec<_> = known.map(|s| s.key).collect();
                return Err(error(format!(
                    "{format} has no setting '{key}'; {}",
                    nearest_of(key, &known)
                )));
            };
            if !setting.any && setting.choices.iter().all(|c| c.value != value) {
                let known: Vec<_> = setting.choices.iter().map(|c| c.value).collect();
                return Err(error(format!(
                    "'{key}' cannot be '{value}'; it is one of: {}",
                    known.join(", ")
                )));
            }
            if settings.insert(setting.key, value.to_owned()).is_some() {
                return Err(error(format!("'{key}' is given twice")));
            }
            path = before;
        }
        if path.is_empty() && !procedural {
            return Err(no_folder());
        }
        Ok(Self {
            name: name.to_owned(),
            entry,
            path: PathBuf::from(path),
            settings,
        })
    }

    /// Value of a setting: as given, or the default. Empty if the format does not have this key.
    pub fn setting(&self, key: &str) -> &str {
        let mut known = self.entry.settings.iter().chain(&PICTURES);
        let mut default = || known.find(|s| s.key == key);
        match self.settings.get(key) {
            Some(value) => value,
            None => default().map_or("", |setting| setting.default),
        }
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
                "'{key}' cannot be '{text}'; it is a number above zero"
            ))),
        }
    }

    pub(crate) fn refused(&self, reason: String) -> DatasetError {
        DatasetError::Spec {
            text: self.to_string(),
            reason,
        }
    }

    /// Completes the result of a reader with the folders that could not be searched.
    ///
    /// # Errors
    /// [`DatasetError::NoScene`] if there is no scene, not even a broken one; `expected` describes the layout that was
    /// searched for.
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

/// Opens a dataset: finds its scenes and reads the cameras, but no pixels. Scenes are in natural order of their ids.
///
/// # Errors
/// The first error; names the file or folder and what is wrong with it.
pub fn open(spec: &DatasetSpec) -> Result<Vec<Scene>, DatasetError> {
    open_each(spec)?.all()
}

/// Like [`open`], but also lists scenes that cannot be read or that a setting excludes.
///
/// # Errors
/// If there is no scene at all, or the dataset's own lists cannot be read.
pub fn open_each(spec: &DatasetSpec) -> Result<FoundScenes, DatasetError> {
    let mut found = (spec.entry.open)(spec)?;
    for scene in &mut found.scenes {
        scene.notes.extend(processing::notes(scene));
        picture_notes::add(scene, spec);
    }
    Ok(found)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_is_parsed_is_written_back() {
        for text in [
            "middlebury=/data/middlebury",
            "mine:middlebury=a:b/c=d",
            "middlebury=/data,rectification=perfect,right=im1E",
            "synthetic",
            "rings:synthetic=seed=7,size=320x240,views=24",
        ] {
            assert_eq!(DatasetSpec::parse(text).unwrap().to_string(), text);
        }
        let spec = DatasetSpec::parse("synthetic,views=4").unwrap();
        assert_eq!(spec.to_string(), "synthetic=views=4");
        let spec = DatasetSpec::parse("middlebury=./a,b").unwrap();
        assert_eq!(spec.path, PathBuf::from("./a,b"));
        assert_eq!(spec.setting("right"), "im1");
    }

    #[test]
    fn mistakes_are_explained() {
        for (text, reason) in [
            ("kitti=/x", "known: middlebury"),
            ("middlebury", "middlebury=FOLDER"),
            ("middlebury,right=im1E", "middlebury=FOLDER"),
            (":middlebury=/x", "empty"),
            ("middlebury=/x,right=im2", "one of: im1, im1E, im1L"),
            ("middlebury=/x,left=im0", "no setting 'left'"),
            ("synthetic=seed=1,seed=2", "twice"),
            ("synthetic=/x", "not key=value"),
        ] {
            let error = DatasetSpec::parse(text).unwrap_err().to_string();
            assert!(error.contains(reason), "{error}");
        }
    }
}
