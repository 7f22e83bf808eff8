//! A plain rectified stereo pair: `left.*`, `right.*` and `rig.txt`.
//!
//! `rig.txt` has one `key=value` per line: `fx`, `fy` (default: fx), `cx_left`, `cx_right` (default: cx_left) and `cy`
//! in pixels, with the centre of the first pixel at (0.5, 0.5), and `baseline_m`. Optional: `disparity_unit`, the
//! number of pixels per stored unit (default 1; 1/256 = 0.00390625 for KITTI's 16-bit PNG), and the files
//! `disparity_left.*` and `disparity_right.*` (PFM, npy, npz, EXR, 16-bit PNG).

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

use crate::depth::StereoGeometry;
use crate::files::{self, PICTURE_EXTENSIONS, Root};
use crate::format::{FormatError, picture};
use crate::found_scenes::FoundScenes;
use crate::required_files::{PhotographPath, RequiredFile};
use crate::spec::PaperOverlap;
use crate::stereo_pair::{self, Side};
use crate::{DatasetEntry, DatasetError, DatasetSpec, Scene};

const MAPS: &[&str] = &["pfm", "npy", "npz", "exr", "png"];

pub(crate) static ENTRY: DatasetEntry = DatasetEntry {
    format: "stereo",
    display_name: "stereo",
    title: "your own rectified pairs",
    layout: "<pair>/{left.png, right.png, rig.txt}; disparity_left.pfm if available",
    paper_overlap: PaperOverlap::Stereo,
    open,
    required_files,
    ..DatasetEntry::OWN
};

fn required_files(photo: &PhotographPath<'_>) -> Vec<RequiredFile> {
    let mut files = vec![RequiredFile::camera(photo.beside("rig.txt"))];
    if photo.stem == "left" {
        files.push(RequiredFile::depth(photo.beside("disparity_left.pfm")));
    }
    files
}

fn open(spec: &DatasetSpec) -> Result<FoundScenes, DatasetError> {
    let root = Root::open(&spec.path)?;
    let search = root.find_folders(4, &|folder| {
        let there =
            |name: &str| find(&root, folder, name, &PICTURE_EXTENSIONS).is_ok_and(|p| p.is_some());
        folder.join("rig.txt").is_file() || (there("left") && there("right"))
    })?;
    let mut found = FoundScenes::default();
    for folder in &search.folders {
        found.add(root.id_of(folder), read_scene(spec, &root, folder));
    }
    let expected = "folders with left.png, right.png and rig.txt, up to four levels down";
    spec.conclude(found, expected, search.unsearched)
}

fn read_scene(spec: &DatasetSpec, root: &Root, folder: &Path) -> Result<Scene, DatasetError> {
    let file = root.resolve(folder, "rig.txt")?;
    let rig = StereoRig::parse(&files::read_text(&file)?)
        .map_err(|error| DatasetError::format(&file, error))?;
    let side = |name: &str, cx: f64| -> Result<Side, DatasetError> {
        let image = find(root, folder, name, &PICTURE_EXTENSIONS)?.ok_or_else(|| {
            let endings = PICTURE_EXTENSIONS.join(", .");
            DatasetError::malformed(folder, format!("no {name}.{endings}"))
        })?;
        Ok(Side {
            id: name.to_owned(),
            size: picture::dimensions(&image)?,
            image,
            disparity: find(root, folder, &format!("disparity_{name}"), MAPS)?
                .map(|path| (path, rig.disparity_unit)),
            focal: (rig.fx, rig.fy),
            center: (cx, rig.cy),
            geometry: StereoGeometry {
                focal: rig.fx,
                baseline_m: rig.baseline_m,
                doffs: rig.cx_right - rig.cx_left,
            },
        })
    };
    let sides = [side("left", rig.cx_left)?, side("right", rig.cx_right)?];
    let id = root.id_of(folder);
    stereo_pair::scene(spec, id.clone(), id, sides, &file, Vec::new())
}

/// Finds the file in a folder with the given stem, in upper or lower case, and one of the
/// extensions; `None` if there is none.
fn find(
    root: &Root,
    folder: &Path,
    stem: &str,
    extensions: &[&str],
) -> Result<Option<PathBuf>, DatasetError> {
    for (name, path) in files::list(folder)? {
        let fits = name.rsplit_once('.').is_some_and(|(s, e)| {
            s.eq_ignore_ascii_case(stem) && extensions.contains(&e.to_ascii_lowercase().as_str())
        });
        if fits {
            root.check(&path)?;
            return Ok(Some(path));
        }
    }
    Ok(None)
}

#[derive(Debug)]
struct StereoRig {
    fx: f64,
    fy: f64,
    cx_left: f64,
    cx_right: f64,
    cy: f64,
    baseline_m: f64,
    disparity_unit: f64,
}

impl StereoRig {
    fn parse(text: &str) -> Result<Self, FormatError> {
        const KEYS: [&str; 7] = [
            "fx",
            "fy",
            "cx_left",
            "cx_right",
            "cy",
            "baseline_m",
            "disparity_unit",
        ];
        let mut values = BTreeMap::new();
        for line in text.lines().map(str::trim) {
            if line.is_empty() || line.starts_with('#') {
                continue;
            }
            let (key, value) = line
                .split_once('=')
                .ok_or_else(|| format!("'{line}' is not key=value"))?;
            let (key, value) = (key.trim(), value.trim());
            if !KEYS.contains(&key) {
                return Err(format!("unknown key '{key}'; known: {}", KEYS.join(", ")).into());
            }
            match value.parse::<f64>() {
                Ok(number) if number.is_finite() => values.insert(key, number),
                _ => return Err(format!("{key} is '{value}', not a finite number").into()),
            };
        }
        let needed = |key: &str| {
            values
                .get(key)
                .copied()
                .ok_or_else(|| format!("the key '{key}' is missing"))
        };
        let or = |key: &str, default: f64| values.get(key).copied().unwrap_or(default);
        let (fx, cx_left) = (needed("fx")?, needed("cx_left")?);
        let rig = Self {
            fx,
            fy: or("fy", fx),
            cx_left,
            cx_right: or("cx_right", cx_left),
            cy: needed("cy")?,
            baseline_m: needed("baseline_m")?,
            disparity_unit: or("disparity_unit", 1.0),
        };
        if rig.baseline_m <= 0.0 || rig.disparity_unit <= 0.0 {
            return Err("baseline_m and disparity_unit must be above zero".into());
        }
        Ok(rig)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rigs_have_defaults_and_mistakes_are_named() {
        let rig =
            StereoRig::parse("fx=500\n# left\ncx_left = 320\ncy=240\nbaseline_m=0.1\n").unwrap();
        assert_eq!(
            (rig.fy, rig.cx_right, rig.disparity_unit),
            (500.0, 320.0, 1.0)
        );
        for (text, reason) in [
            ("fx=500", "'cx_left' is missing"),
            ("focal=5", "unknown key 'focal'"),
            ("fx=nan", "not a finite number"),
            ("fx", "not key=value"),
            ("fx=1\ncx_left=1\ncy=1\nbaseline_m=0", "above zero"),
        ] {
            let error = StereoRig::parse(text).unwrap_err();
            assert!(error.to_string().contains(reason), "{error}");
        }
    }

    #[test]
    fn pictures_of_every_format_are_found_in_any_case() {
        let dataset = tempfile::tempdir().unwrap();
        let folder = dataset.path().join("p");
        std::fs::create_dir(&folder).unwrap();
        let rig = "fx=8\ncx_left=4\ncy=3\nbaseline_m=0.1\n";
        std::fs::write(folder.join("rig.txt"), rig).unwrap();
        let spec = format!("stereo={}", dataset.path().display());
        let spec = DatasetSpec::parse(&spec).unwrap();
        for (left, right) in [("left.tif", "right.bmp"), ("Left.PNG", "RIGHT.webp")] {
            for name in [left, right] {
                let picture = image::RgbImage::from_pixel(8, 6, image::Rgb([9, 90, 200]));
                picture.save(folder.join(name)).unwrap();
            }
            assert_eq!(crate::open(&spec).unwrap()[0].views.len(), 2);
            for name in [left, right] {
                std::fs::remove_file(folder.join(name)).unwrap();
            }
        }
    }
}
