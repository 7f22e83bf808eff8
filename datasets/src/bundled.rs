//! The dataset bundled with the program: four Middlebury scenes, in Middlebury's own layout.

use std::borrow::Cow;
use std::path::{Path, PathBuf};

use crate::format::{exr_depth, pfm};
use crate::{DatasetError, files};

struct BundledScene {
    name: &'static str,
    files: [BundledFile; 4],
}

struct BundledFile {
    /// Name of the bundled file. An EXR file of disparities is extracted as PFM, which the
    /// `middlebury` reader requires.
    name: &'static str,
    bytes: &'static [u8],
}

macro_rules! bundled {
    ($folder:literal, $name:literal) => {
        BundledFile {
            name: $name,
            bytes: include_bytes!(concat!("../bundled/", $folder, "/", $name)),
        }
    };
}

/// SHA-256 of each file as [`extract_all`] writes it, in the format of `sha256sum`, with paths `SCENE/FILE`.
const SHA256SUMS: &str = include_str!("../bundled/SHA256SUMS");

const SCENES: [BundledScene; 4] = [
    BundledScene {
        name: "Motorcycle-quarter",
        files: [
            bundled!("middlebury/Motorcycle-quarter", "calib.txt"),
            bundled!("middlebury/Motorcycle-quarter", "disp0.pfm"),
            bundled!("middlebury/Motorcycle-quarter", "im0.png"),
            bundled!("middlebury/Motorcycle-quarter", "im1.png"),
        ],
    },
    BundledScene {
        name: "Adirondack-quarter",
        files: [
            bundled!("middlebury-more/Adirondack", "calib.txt"),
            bundled!("middlebury-more/Adirondack", "disp0.exr"),
            bundled!("middlebury-more/Adirondack", "im0.png"),
            bundled!("middlebury-more/Adirondack", "im1.png"),
        ],
    },
    BundledScene {
        name: "Piano-quarter",
        files: [
            bundled!("middlebury-more/Piano", "calib.txt"),
            bundled!("middlebury-more/Piano", "disp0.exr"),
            bundled!("middlebury-more/Piano", "im0.png"),
            bundled!("middlebury-more/Piano", "im1.png"),
        ],
    },
    BundledScene {
        name: "Playroom-quarter",
        files: [
            bundled!("middlebury-more/Playroom", "calib.txt"),
            bundled!("middlebury-more/Playroom", "disp0.exr"),
            bundled!("middlebury-more/Playroom", "im0.png"),
            bundled!("middlebury-more/Playroom", "im1.png"),
        ],
    },
];

/// Writes the scene Motorcycle to `folder` and returns the path for the `middlebury` reader.
/// Existing files with the expected hash are kept. Each other file is written to a temporary file
/// and then renamed, so that no file is ever incomplete.
///
/// # Errors
/// [`DatasetError::Io`]; [`DatasetError::Malformed`] if a written file does not have the expected SHA-256.
pub fn extract(folder: &Path) -> Result<PathBuf, DatasetError> {
    extract_scenes(folder, &SCENES[..1])
}

/// Like [`extract`], with all four scenes: Motorcycle, Adirondack, Piano and Playroom.
///
/// # Errors
/// As for [`extract`].
pub fn extract_all(folder: &Path) -> Result<PathBuf, DatasetError> {
    extract_scenes(folder, &SCENES)
}

fn extract_scenes(folder: &Path, scenes: &[BundledScene]) -> Result<PathBuf, DatasetError> {
    let dataset = folder.join("middlebury");
    for scene in scenes {
        let folder = dataset.join(scene.name);
        std::fs::create_dir_all(&folder).map_err(|e| DatasetError::io(folder, e))?;
        for file in &scene.files {
            file.extract(&dataset, scene.name)?;
        }
    }
    Ok(dataset)
}

impl BundledFile {
    fn extract(&self, dataset: &Path, scene: &str) -> Result<(), DatasetError> {
        let name = self.name.replace(".exr", ".pfm");
        let path = dataset.join(scene).join(&name);
        let written = format!("  {scene}/{name}");
        let expected = SHA256SUMS
            .lines()
            .find_map(|line| line.strip_suffix(&written));
        let expected = expected.unwrap_or_default();
        if path.is_file() && files::sha256(&path)? == expected {
            return Ok(());
        }
        let malformed = |reason: String| DatasetError::malformed(&path, reason);
        let bytes = if name == self.name {
            Cow::Borrowed(self.bytes)
        } else {
            let map = exr_depth::parse(self.bytes);
            Cow::Owned(pfm::bytes(
                &map.map_err(|reason| malformed(reason.to_string()))?,
            ))
        };
        let partial = path.with_extension(format!("{}.part", std::process::id()));
        std::fs::write(&partial, bytes).map_err(|e| DatasetError::io(&partial, e))?;
        std::fs::rename(&partial, &path).map_err(|e| DatasetError::io(&path, e))?;
        let found = files::sha256(&path)?;
        if found == expected {
            Ok(())
        } else {
            Err(malformed(format!(
                "has sha256 {found}, expected {expected}"
            )))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn extraction_is_whole_and_mends_what_is_broken() {
        let folder = tempfile::tempdir().unwrap();
        let dataset = extract_all(folder.path()).unwrap();
        let image = dataset.join("Piano-quarter/im0.png");
        let whole = std::fs::read(&image).unwrap();
        std::fs::write(&image, &whole[..100]).unwrap();
        assert_eq!(extract_all(folder.path()).unwrap(), dataset);
        assert_eq!(std::fs::read(&image).unwrap(), whole);
        for scene in SCENES {
            assert_eq!(files::list(&dataset.join(scene.name)).unwrap().len(), 4);
        }
        assert_eq!(files::list(&dataset).unwrap().len(), 4);
        assert_eq!(
            files::list(&extract(&folder.path().join("one")).unwrap())
                .unwrap()
                .len(),
            1
        );
    }
}
