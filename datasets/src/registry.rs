//! Every dataset that can be read; the only module that names all readers.

use std::collections::BTreeMap;
use std::path::PathBuf;

use crate::error::nearest_of;
use crate::found_scenes::FoundScenes;
use crate::setting::PICTURES;
use crate::{
    DatasetEntry, DatasetError, DatasetSpec, Scene, booster, colmap, eth3d, middlebury, nerfstudio,
    scannetpp, scene_notes, stereo, synthetic, tanks_and_temples, virtual_views, wildrgbd,
};

/// All datasets: those of the paper's tables in order, then the user's own data, then the procedural scene.
pub static ENTRIES: [&DatasetEntry; 11] = [
    &middlebury::ENTRY,
    &booster::ENTRY,
    &scannetpp::ENTRY,
    &wildrgbd::ENTRY,
    &tanks_and_temples::ENTRY,
    &eth3d::ENTRY,
    &nerfstudio::ENTRY,
    &colmap::ENTRY,
    &stereo::ENTRY,
    &virtual_views::ENTRY,
    &synthetic::ENTRY,
];

/// Looks up the entry of a format.
///
/// # Errors
/// [`DatasetError::UnknownFormat`] if there is no such format.
pub fn entry(format: &str) -> Result<&'static DatasetEntry, DatasetError> {
    let found = ENTRIES.into_iter().find(|entry| entry.format == format);
    found.ok_or_else(|| DatasetError::UnknownFormat {
        name: format.to_owned(),
        known: nearest_of(format, &ENTRIES.map(|entry| entry.format)),
    })
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
                "a name must not contain line breaks or control characters".into(),
            ));
        }
        let entry = entry(format)?;
        let procedural = format == synthetic::ENTRY.format;
        let no_folder = || error(format!("the folder is missing; write {format}=FOLDER"));
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
                    "'{key}' cannot be '{value}'; it must be one of {}",
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
}

/// Opens a dataset: finds its scenes and reads the cameras, but no pixels. Scenes are in natural order of their ids.
///
/// # Errors
/// If a scene cannot be read; names the file or folder and what is wrong with it.
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
        scene_notes::add(scene, spec);
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
            ("middlebury=/x,right=im2", "one of im1, im1E, im1L"),
            ("middlebury=/x,left=im0", "no setting 'left'"),
            ("synthetic=seed=1,seed=2", "twice"),
            ("synthetic=/x", "not key=value"),
        ] {
            let error = DatasetSpec::parse(text).unwrap_err().to_string();
            assert!(error.contains(reason), "{error}");
        }
    }
}
