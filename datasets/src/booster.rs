//! Booster: stereo pairs of transparent and mirroring objects, with several illuminations per scene.
//!
//! A scene is a folder with `camera_00`, a second camera (`camera_02` in the balanced set, `camera_01` or `camera_02`
//! in the unbalanced one) and `calib_00-0N.xml`. Each illumination for which both cameras have a picture forms one
//! pair; all pairs share one disparity map per camera. The test sets have no disparity maps.
//!
//! Cameras are read from the projection matrices of OpenCV's rectification. OpenCV's pixel centres are at integers, so
//! 0.5 is added to each principal point. `baselineLR` is in millimetres.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use crate::depth::StereoGeometry;
use crate::files::{self, Root};
use crate::format::opencv_xml::{self, FileStorage, Node};
use crate::format::{FormatError, picture};
use crate::found_scenes::FoundScenes;
use crate::required_files::{PhotographPath, RequiredFile};
use crate::setting::{Setting, choice, proxy};
use crate::spec::PaperOverlap;
use crate::stereo_pair::{self, Side, without_depth};
use crate::{DatasetEntry, DatasetError, DatasetSpec, Scene, natural_order};

pub(crate) static ENTRY: DatasetEntry = DatasetEntry {
    format: "booster",
    display_name: "Booster",
    title: "Booster",
    page: "https://cvlab-unibo.github.io/booster-web/",
    terms: "research use; do not redistribute",
    may_publish: false,
    download: "booster_gt.zip; only the training set has ground truth",
    size: "19.3 GB (8.3 GB unpacked for train/balanced)",
    layout: "train/balanced/<Scene>/{camera_00/*.png, camera_02/*.png, disp_00.npy, \
             disp_02.npy, calib_00-02.xml}",
    paper_column: "Booster",
    paper_overlap: PaperOverlap::Stereo,
    caveat: "the paper does not say if it uses every illumination (228 pairs) or only one (38)",
    settings: &[
        Setting::choice(
            "split",
            "which part of Booster to read, named like its folder; a folder with neither name is always read",
            &[
                choice(
                    "train",
                    "with ground truth, which the paper's privileged depth needs",
                ),
                proxy("test", "without ground truth"),
            ],
        ),
        Setting::choice(
            "set",
            "which camera pair to read, named like its folder",
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
                choice(
                    "first",
                    "only the first illumination: 38 pairs of the train set",
                ),
            ],
        )
        .left_open(),
    ],
    poses_are_matrices: false,
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

fn open(spec: &DatasetSpec) -> Result<FoundScenes, DatasetError> {
    let root = Root::open(&spec.path)?;
    let search = root.find_folders(4, &|folder| {
        let cameras = ["camera_00", "camera_01", "camera_02"];
        let calibrations = NUMBERS.map(|n| folder.join(calibration_of(n)));
        cameras.iter().any(|camera| folder.join(camera).is_dir())
            || calibrations.iter().any(|file| file.is_file())
    })?;
    let mut found = FoundScenes::default();
    for folder in &search.folders {
        let (split, set) = (spec.setting("split"), spec.setting("set"));
        if !is_wanted(folder, split, set) {
            let reason = format!("split={split} and set={set}");
            found.rule_out(root.id_of(folder), reason);
        } else if let Err(error) = read_scenes(spec, &root, folder, &mut found) {
            found.add(root.id_of(folder), Err(error));
        }
    }
    let expected = "<split>/<set>/<Scene>/camera_00/*.png with camera_02 and calib_00-02.xml, not excluded by split= \
                    or set=";
    spec.conclude(found, expected, search.unsearched)
}

/// Possible numbers of a scene's second camera.
const NUMBERS: [&str; 2] = ["02", "01"];

fn calibration_of(number: &str) -> String {
    format!("calib_00-{number}.xml")
}

/// True if the folders that contain the scene, including those above the dataset's root, match
/// `split` and `set`.
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

/// Adds a scene to `found` for each pair of pictures in a folder; a pair that cannot be read is added with its error.
///
/// # Errors
/// If the folder's pictures cannot be determined.
fn read_scenes(
    spec: &DatasetSpec,
    root: &Root,
    folder: &Path,
    found: &mut FoundScenes,
) -> Result<(), DatasetError> {
    let mut numbers = NUMBERS.into_iter();
    let number = numbers.find(|n| folder.join(calibration_of(n)).is_file());
    let number = number.ok_or_else(|| {
        DatasetError::malformed(folder, "missing calib_00-02.xml (or calib_00-01.xml)")
    })?;
    let cameras = ["camera_00".to_owned(), format!("camera_{number}")];
    let mut names = BTreeSet::new();
    for camera in &cameras {
        let pictures = files::pictures(&root.resolve(folder, camera)?)?.into_iter();
        names.extend(pictures.map(|(name, _)| name));
    }
    if names.is_empty() {
        return Err(DatasetError::malformed(folder, "no picture in camera_00"));
    }
    let mut names: Vec<String> = names.into_iter().collect();
    names.sort_by(|a, b| natural_order::compare(a, b));
    let (id, mut is_first) = (root.id_of(folder), true);
    for name in names {
        let stem = name
            .rsplit_once('.')
            .map_or(name.as_str(), |(stem, _)| stem);
        let id = format!("{id}/{stem}");
        if !is_first && spec.setting("illuminations") == "first" {
            found.rule_out(id, "illuminations=first");
            continue;
        }
        is_first = false;
        let pictures = [&cameras[0], &cameras[1]].map(|camera| folder.join(camera).join(&name));
        let scene = match pictures.iter().find(|picture| !picture.is_file()) {
            Some(missing) => Err(DatasetError::malformed(missing, "there is no such picture")),
            None => read_scene(spec, root, folder, number, id.clone(), pictures),
        };
        found.add(id, scene);
    }
    Ok(())
}

fn read_scene(
    spec: &DatasetSpec,
    root: &Root,
    folder: &Path,
    number: &str,
    id: String,
    [left, right]: [PathBuf; 2],
) -> Result<Scene, DatasetError> {
    let calibration = root.resolve(folder, &calibration_of(number))?;
    let storage = files::parse_text(&calibration, opencv_xml::parse)?;
    let rig = BoosterRig::parse(&storage).map_err(|e| DatasetError::format(&calibration, e))?;
    let sides = [
        rig.side(root, folder, "00", left, 0)?,
        rig.side(root, folder, number, right, 1)?,
    ];
    let folder_id = root.id_of(folder);
    let notes = without_depth(&sides[0], &folder_id, "disp_00.npy");
    let cluster = folder_id.rsplit('/').next().unwrap_or(&folder_id);
    stereo_pair::scene(spec, id, cluster.to_owned(), sides, &calibration, notes)
}

/// The two cameras of a scene.
struct BoosterRig {
    /// fx, fy, cx and cy of the left and right camera, with pixel centres at integers.
    cameras: [[f64; 4]; 2],
    geometry: [StereoGeometry; 2],
}

impl BoosterRig {
    fn parse(storage: &FileStorage) -> Result<Self, FormatError> {
        let left = camera(storage, "proj_matL", "mtxL")?;
        let right = camera(storage, "proj_matR", "mtxR")?;
        // The fourth column of the right camera's matrix contains −f·B, from which the baseline follows.
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
                    return Err(format!("baselineLR is {b}, but proj_matR implies {other}").into());
                }
                *b
            }
            (_, Some(b)) => b,
            _ => return Err("there is neither baselineLR nor a 3x4 proj_matR".into()),
        };
        if !baseline_mm.is_finite() || baseline_mm <= 0.0 {
            return Err(format!("the baseline is {baseline_mm} mm, but must be above zero").into());
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

/// fx, fy, cx and cy from the matrix named `projection` or, if it is missing, from the one named
/// `intrinsic`.
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
                return Err(format!("{name} has a value that is not finite").into());
            }
            return Ok(found);
        }
    }
    Err(format!("there is neither {projection} (3x4) nor {intrinsic} (3x3)").into())
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
                "proj_matR implies 80",
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
