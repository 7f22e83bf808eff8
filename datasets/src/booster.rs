//! Booster: stereo pairs of transparent and mirroring objects, several illuminations a scene.
//!
//! A scene is a folder with `camera_00`, a second camera (`camera_02` in the balanced set,
//! `camera_01` or `camera_02` in the unbalanced one) and `calib_00-0N.xml`. Every picture of the
//! first camera that the second has too, one an illumination, makes one pair; all share one
//! disparity map a camera. The test sets have none.
//!
//! Cameras come from the projection matrices of OpenCV's rectification, whose pixel centres are
//! whole numbers, so 0.5 is added to each principal point. `baselineLR` is in millimetres.

use std::path::{Path, PathBuf};

use crate::depth::StereoGeometry;
use crate::entry::{DatasetEntry, PaperOverlap, Setting, choice, proxy};
use crate::files::{self, Root};
use crate::format::opencv_xml::{self, FileStorage, Node};
use crate::format::{FormatError, picture};
use crate::required_files::{PhotographPath, RequiredFile};
use crate::spec::SceneResults;
use crate::stereo_pair::{self, Side};
use crate::{DatasetError, DatasetSpec};

pub(crate) static ENTRY: DatasetEntry = DatasetEntry {
    format: "booster",
    display_name: "Booster",
    title: "Booster",
    page: "https://cvlab-unibo.github.io/booster-web/",
    terms: "research use; do not redistribute",
    download: "booster_gt.zip; only the training set has ground truth",
    size: "19.3 GB (8.3 GB unpacked for train/balanced)",
    layout: "train/balanced/<Scene>/{camera_00/*.png, camera_02/*.png, disp_00.npy, \
             disp_02.npy, calib_00-02.xml}",
    paper_column: "Booster",
    paper_overlap: PaperOverlap::Stereo,
    caveat: "the paper does not say whether every illumination counts (228 pairs) or one (38)",
    settings: &[
        Setting::choice(
            "split",
            "which part, by the folder's name; a folder that is neither always counts",
            &[
                choice(
                    "train",
                    "with ground truth: the paper's privileged depth needs it",
                ),
                proxy("test", "without ground truth"),
            ],
        ),
        Setting::choice(
            "set",
            "balanced or unbalanced cameras, by the folder's name",
            &[
                choice("balanced", "two cameras of the same kind"),
                proxy("unbalanced", "the second camera is smaller"),
            ],
        ),
        Setting::choice(
            "illuminations",
            "which pictures of a scene make pairs",
            &[
                choice("all", "every illumination: 228 pairs of the train set"),
                choice("first", "only the first: 38 pairs of the train set"),
            ],
        ),
    ],
    open,
    required_files,
    archives: |_| vec!["booster_gt.zip".to_owned()],
};

fn required_files(photo: &PhotographPath<'_>) -> Vec<RequiredFile> {
    let calibration = RequiredFile::camera(photo.above("calib_00-02.xml"));
    let mut files = vec![calibration.or(photo.above("calib_00-01.xml"))];
    if photo.folder.ends_with("camera_00") {
        files.push(RequiredFile::depth(photo.above("disp_00.npy")));
    }
    files
}

fn open(spec: &DatasetSpec) -> Result<SceneResults, DatasetError> {
    let root = Root::open(&spec.path)?;
    let found = root.find_folders(4, &|folder| folder.join("camera_00").is_dir())?;
    let mut scenes = Vec::new();
    for folder in found.folders {
        if is_wanted(&folder, spec.setting("split"), spec.setting("set")) {
            let before = scenes.len();
            if let Err(error) = read_scene(spec, &root, &folder, &mut scenes) {
                scenes.truncate(before);
                scenes.push(Err(error));
            }
        }
    }
    let expected = "<split>/<set>/<Scene>/camera_00/*.png with camera_02 and calib_00-02.xml; or \
                    split= and set= rule out what is there";
    spec.conclude(scenes, expected, &[&found.left_out])
}

/// Looks at the folders above the scene, also those above the dataset's root.
fn is_wanted(folder: &Path, split: &str, set: &str) -> bool {
    let above: Vec<_> = folder
        .parent()
        .into_iter()
        .flat_map(Path::components)
        .map(|c| c.as_os_str().to_string_lossy().to_ascii_lowercase())
        .collect();
    let named = |prefix: &str| {
        above
            .iter()
            .any(|c| c == prefix || c.starts_with(&format!("{prefix}_")))
    };
    let split_fits = named(split) || !(named("train") || named("test"));
    let set_fits = named(set) || !(named("balanced") || named("unbalanced"));
    split_fits && set_fits
}

fn read_scene(
    spec: &DatasetSpec,
    root: &Root,
    folder: &Path,
    scenes: &mut SceneResults,
) -> Result<(), DatasetError> {
    let (number, calibration) = ["02", "01"]
        .iter()
        .map(|n| (*n, folder.join(format!("calib_00-{n}.xml"))))
        .find(|(_, path)| path.is_file())
        .ok_or_else(|| DatasetError::malformed(folder, "no calib_00-02.xml or calib_00-01.xml"))?;
    root.check(&calibration)?;
    let storage = files::parse_text(&calibration, opencv_xml::parse)?;
    let rig = BoosterRig::parse(&storage).map_err(|e| DatasetError::format(&calibration, e))?;
    let id = root.id_of(folder);
    let cluster = id.rsplit('/').next().unwrap_or(&id);
    let left_folder = root.resolve(folder, "camera_00")?;
    let right_folder = root.resolve(folder, &format!("camera_{number}"))?;
    for (name, left) in files::list(&left_folder)? {
        let right = right_folder.join(&name);
        let Some((stem, "png" | "jpg" | "PNG" | "JPG")) = name.rsplit_once('.') else {
            continue;
        };
        if !right.is_file() {
            continue;
        }
        let sides = [
            rig.side(root, folder, "00", left, 0)?,
            rig.side(root, folder, number, right, 1)?,
        ];
        let mut notes = Vec::new();
        if sides[0].disparity.is_none() {
            notes.push(format!(
                "{id}: no disp_00.npy, so the left view has no depth"
            ));
        }
        let (id, cluster) = (format!("{id}/{stem}"), cluster.to_owned());
        let scene = stereo_pair::scene(&spec.name, id, cluster, sides, &calibration, notes)?;
        scenes.push(Ok(scene));
        if spec.setting("illuminations") == "first" {
            break;
        }
    }
    Ok(())
}

/// The two cameras of a scene.
struct BoosterRig {
    /// Focal lengths and principal points of the left and right camera, integer-centred.
    cameras: [[f64; 4]; 2],
    geometry: [StereoGeometry; 2],
}

impl BoosterRig {
    fn parse(storage: &FileStorage) -> Result<Self, FormatError> {
        let left = camera(storage, "proj_matL", "mtxL")?;
        let right = camera(storage, "proj_matR", "mtxR")?;
        // The right camera's matrix holds −f·B in its fourth column.
        let from_matrix = match storage.get("proj_matR") {
            Some(Node::Matrix {
                rows: 3,
                cols: 4,
                data,
            }) if data[0] != 0.0 => Some(-data[3] / data[0]),
            _ => None,
        };
        let baseline_mm = match (storage.get("baselineLR"), from_matrix) {
            (Some(Node::Number(b)), other) => {
                if other
                    .is_some_and(|o| o.is_finite() && o != 0.0 && (o - b).abs() > 0.01 * b.abs())
                {
                    let other = other.unwrap_or_default();
                    return Err(format!("baselineLR is {b}, but proj_matR says {other}").into());
                }
                *b
            }
            (_, Some(b)) => b,
            _ => return Err("neither baselineLR nor a 3x4 proj_matR".into()),
        };
        if !baseline_mm.is_finite() || baseline_mm <= 0.0 {
            return Err(format!("the baseline is {baseline_mm} mm").into());
        }
        let baseline_m = baseline_mm / 1000.0;
        let geometry = [left[0], right[0]].map(|focal| StereoGeometry {
            focal,
            baseline_m,
            doffs: right[2] - left[2],
        });
        Ok(Self {
            cameras: [left, right],
            geometry,
        })
    }

    fn side(
        &self,
        root: &Root,
        folder: &Path,
        number: &str,
        image: PathBuf,
        index: usize,
    ) -> Result<Side, DatasetError> {
        root.check(&image)?;
        let [fx, fy, cx, cy] = self.cameras[index];
        let disparity = root.resolve(folder, &format!("disp_{number}.npy"))?;
        Ok(Side {
            id: format!("camera_{number}"),
            size: picture::dimensions(&image)?,
            image,
            disparity: disparity.is_file().then_some((disparity, 1.0)),
            focal: (fx, fy),
            center: (cx + 0.5, cy + 0.5),
            geometry: self.geometry[index],
        })
    }
}

/// fx, fy, cx, cy of the first matrix there is.
fn camera(
    storage: &FileStorage,
    projection: &str,
    intrinsic: &str,
) -> Result<[f64; 4], FormatError> {
    for (name, columns) in [(projection, 4), (intrinsic, 3)] {
        if let Some(Node::Matrix {
            rows: 3,
            cols,
            data,
        }) = storage.get(name)
            && *cols == columns
        {
            let found = [data[0], data[columns + 1], data[2], data[columns + 2]];
            if !found.iter().all(|v| v.is_finite()) {
                return Err(format!("{name} holds a value that is not finite").into());
            }
            return Ok(found);
        }
    }
    Err(format!("neither {projection} (3x4) nor {intrinsic} (3x3)").into())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn storage(baseline: &str, right_fourth: &str) -> FileStorage {
        let matrix = |name: &str, data: &str| {
            format!("<{name}><rows>3</rows><cols>4</cols><dt>d</dt><data>{data}</data></{name}>")
        };
        let text = format!(
            "<opencv_storage>{}{}{baseline}</opencv_storage>",
            matrix("proj_matL", "1000. 0. 300. 0. 0. 1000. 200. 0. 0. 0. 1. 0."),
            matrix(
                "proj_matR",
                &format!("1000. 0. 330. {right_fourth} 0. 1000. 200. 0. 0. 0. 1. 0.")
            ),
        );
        opencv_xml::parse(&text).unwrap()
    }

    #[test]
    fn the_baseline_is_millimetres_and_may_come_from_the_matrix() {
        for baseline in ["<baselineLR>8.0e+01</baselineLR>", ""] {
            let rig = BoosterRig::parse(&storage(baseline, "-80000.")).unwrap();
            assert!((rig.geometry[1].baseline_m - 0.08).abs() < 1e-15);
            assert_eq!(rig.geometry[0].doffs, 30.0);
        }
        for (baseline, fourth, reason) in [
            (
                "<baselineLR>0.08</baselineLR>",
                "-80000.",
                "proj_matR says 80",
            ),
            ("<baselineLR>.Nan</baselineLR>", "0.", "NaN"),
            ("", "0.", "baseline is"),
        ] {
            let error = BoosterRig::parse(&storage(baseline, fourth)).err().unwrap();
            assert!(error.to_string().contains(reason), "{error}");
        }
    }

    #[test]
    fn splits_and_sets_go_by_folder_names() {
        for (folder, wanted) in [
            ("/d/train/balanced/Case", true),
            ("/d/train/unbalanced/Case", false),
            ("/d/test_stereo/balanced/Case", false),
            ("/d/balanced/Case", true),
            ("/d/Case", true),
        ] {
            assert_eq!(
                is_wanted(Path::new(folder), "train", "balanced"),
                wanted,
                "{folder}"
            );
        }
        assert!(is_wanted(
            Path::new("/d/test_stereo/balanced/Case"),
            "test",
            "balanced"
        ));
    }
}
