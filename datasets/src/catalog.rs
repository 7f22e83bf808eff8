//! The formats by name; how a dataset is asked for on a command line and opened.

use std::collections::BTreeMap;
use std::path::PathBuf;

use crate::spec::{Attempts, DatasetSpec, Format};
use crate::{
    DatasetError, Scene, booster, colmap, eth3d, middlebury, nerfstudio, processing, scannetpp,
    stereo, synthetic, tanks_and_temples, wildrgbd,
};

/// Every format, in the order of the paper's tables, then one's own data, then the procedural.
pub fn formats() -> &'static [Format] {
    &[
        middlebury::FORMAT,
        booster::FORMAT,
        scannetpp::FORMAT,
        wildrgbd::FORMAT,
        tanks_and_temples::FORMAT,
        eth3d::FORMAT,
        nerfstudio::FORMAT,
        colmap::FORMAT,
        stereo::FORMAT,
        synthetic::FORMAT,
    ]
}

impl DatasetSpec {
    /// Parses `[NAME:]FORMAT=PATH[,key=value…]`. A path may hold `:`, `=` and commas, but not a
    /// comma followed by something with `=`: that is a setting.
    ///
    /// # Errors
    /// [`DatasetError::UnknownFormat`]; [`DatasetError::Spec`] for a missing path, an unknown key
    /// or a value that is not among its choices.
    pub fn parse(text: &str) -> Result<Self, DatasetError> {
        let error = |reason: String| DatasetError::Spec {
            text: text.to_owned(),
            reason,
        };
        // Without a path the settings may follow the format at once: `synthetic,views=4`.
        let (head, rest) = match text.find(['=', ',']) {
            Some(at) => (&text[..at], Some(&text[at + 1..])),
            None => (text, None),
        };
        let (name, format_name) = match head.rsplit_once(':') {
            Some((name, format)) => (Some(name), format),
            None => (None, head),
        };
        let format = formats()
            .iter()
            .find(|f| f.name == format_name)
            .ok_or_else(|| DatasetError::UnknownFormat {
                name: format_name.to_owned(),
                known: formats()
                    .iter()
                    .map(|f| f.name)
                    .collect::<Vec<_>>()
                    .join(", "),
            })?;
        if name == Some("") {
            return Err(error("the name before ':' is empty".into()));
        }
        let procedural = format.name == synthetic::FORMAT.name;
        if !procedural && text[head.len()..].starts_with(',') {
            return Err(error(format!("no folder: write {format_name}=FOLDER")));
        }
        // Settings are taken from the end, so that a path may hold commas and equal signs.
        let mut path = rest.unwrap_or("");
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
            let Some(setting) = format.settings.iter().find(|s| s.key == key) else {
                let known: Vec<_> = format.settings.iter().map(|s| s.key).collect();
                return Err(error(format!(
                    "{format_name} has no setting '{key}'; there are: {}",
                    known.join(", ")
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
            return Err(error(format!("no folder: write {format_name}=FOLDER")));
        }
        Ok(Self {
            name: name.unwrap_or(format.name).to_owned(),
            format: format.name,
            path: PathBuf::from(path),
            settings,
            known: format.settings,
        })
    }
}

/// Opens a dataset: finds its scenes, reads the cameras, leaves the pixels alone. Scenes come in
/// natural order of their ids.
///
/// # Errors
/// Names the file or folder and what is wrong with it; the first one, if several are.
pub fn open(spec: &DatasetSpec) -> Result<Vec<Scene>, DatasetError> {
    open_each(spec)?.into_iter().collect()
}

/// As [`open`], with every scene that could not be read in its place among the others.
///
/// # Errors
/// When there is no scene at all, or the dataset's own lists cannot be read.
pub(crate) fn open_each(spec: &DatasetSpec) -> Result<Attempts, DatasetError> {
    let format = formats()
        .iter()
        .find(|f| f.name == spec.format)
        .ok_or_else(|| DatasetError::UnknownFormat {
            name: spec.format.to_owned(),
            known: String::new(),
        })?;
    let mut scenes = (format.open)(spec)?;
    for scene in scenes.iter_mut().flatten() {
        scene.notes.extend(processing::notes(scene));
    }
    Ok(scenes)
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
