//! Middlebury 2014 stereo, in the layouts of the `scenes2014` archives and of MiddEval3.
//!
//! A scene is any folder with `im0.png`, `im1.png` and `calib.txt`; a folder with only some of them
//! is a broken scene. Depth is computed from `disp0.pfm` (scenes2014) or `disp0GT.pfm` (MiddEval3,
//! whose ground truth is a separate download) by Middlebury's own formula,
//! `Z = baseline · f / (d + doffs)`.
//!
//! `calib.txt` does not specify its pixel-centre convention. It is assumed to be OpenCV's, in which
//! the centre of the first pixel is (0, 0), so 0.5 is added to each principal point. This does not
//! affect depth, which depends only on the difference of the principal points.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use crate::depth::StereoGeometry;
use crate::files::{self, Root};
use crate::format::{calib, picture};
use crate::found_scenes::FoundScenes;
use crate::required_files::{PhotographPath, RequiredFile};
use crate::setting::{Setting, choice, proxy};
use crate::spec::PaperOverlap;
use crate::stereo_pair::{self, Side, without_depth};
use crate::{DatasetEntry, DatasetError, DatasetSpec, Scene};

pub(crate) static ENTRY: DatasetEntry = DatasetEntry {
    format: "middlebury",
    display_name: "Middlebury",
    title: "Middlebury Stereo 2014",
    page: "https://vision.middlebury.edu/stereo/data/scenes2014/",
    terms: "free to use and publish; cite Scharstein et al., GCPR 2014",
    may_publish: true,
    download: "zip/<Scene>-perfect.zip and -imperfect.zip (23 scenes each), or MiddEval3-data-F.zip \
               with MiddEval3-GT0-F.zip",
    size: "46 archives; pictures of 5 to 6 megapixels, disparity maps of 24 MB each; one scene is bundled at a \
           quarter of the size",
    layout: "<Scene>/{im0.png, im1.png, calib.txt, disp0.pfm or disp0GT.pfm}",
    paper_column: "Middlebury",
    paper_overlap: PaperOverlap::Stereo,
    caveat: "the paper says neither which scenes nor which rectification it used",
    settings: &[
        Setting::choice(
            "scenes",
            "which scenes to read, named like their folders without -perfect or -imperfect",
            &[
                choice("found", "every scene folder found"),
                choice("training15", "the 15 of MiddEval3's training set"),
            ],
        )
        .left_open(),
        Setting::choice(
            "rectification",
            "which of a scene's two rectifications to read (folders with neither suffix are always read)",
            &[
                choice(
                    "one",
                    "<Scene>-perfect, or <Scene>-imperfect if that is the only one",
                ),
                choice("any", "every scene folder found, even both of one scene"),
                choice("perfect", "only <Scene>-perfect"),
                choice("imperfect", "only <Scene>-imperfect"),
            ],
        )
        .left_open(),
        Setting::choice(
            "right",
            "which picture of the right camera is the target",
            &[
                choice("im1", "the default exposure and lighting"),
                proxy("im1E", "another exposure, if available"),
                proxy("im1L", "another lighting, if available"),
            ],
        ),
    ],
    poses_are_matrices: false,
    open,
    required_files,
    archives,
};

fn required_files(photo: &PhotographPath<'_>) -> Vec<RequiredFile> {
    let mut files = vec![RequiredFile::camera(photo.beside("calib.txt"))];
    if photo.stem == "im0" {
        let map = RequiredFile::depth(photo.beside("disp0.pfm"));
        files.push(map.or(photo.beside("disp0GT.pfm")));
    }
    files
}

fn archives(photo: &PhotographPath<'_>) -> Vec<String> {
    if photo.scene_name().ends_with("perfect") {
        return vec![format!("zip/{}.zip", photo.scene_name())];
    }
    let sizes = ["F", "H", "Q"].into_iter();
    sizes
        .filter(|size| photo.scene.contains(&format!("training{size}")))
        .flat_map(|size| ["data", "GT0"].map(|part| format!("MiddEval3-{part}-{size}.zip")))
        .collect()
}

fn open(spec: &DatasetSpec) -> Result<FoundScenes, DatasetError> {
    let root = Root::open(&spec.path)?;
    let right = spec.setting("right");
    let right_name = format!("{right}.png");
    let rectification = spec.setting("rectification");
    let search = root.find_folders(4, &|folder| {
        // Stray text files and maps next to the scenes' folders are not part of any scene.
        (folder != root.path() && has_part(folder))
            || PICTURES.iter().any(|name| folder.join(name).is_file())
    })?;
    let ids: Vec<String> = search.folders.iter().map(|f| root.id_of(f)).collect();
    let perfect: BTreeSet<&str> = ids
        .iter()
        .filter(|id| id.ends_with("-perfect"))
        .map(|id| without_rectification(id))
        .collect();
    let mut found = FoundScenes::default();
    for (folder, id) in search.folders.iter().zip(&ids) {
        let has_both = id.ends_with("-imperfect") && perfect.contains(without_rectification(id));
        let other = match rectification {
            "perfect" => id.ends_with("-imperfect"),
            "imperfect" => id.ends_with("-perfect"),
            "one" => has_both,
            _ => false,
        };
        if spec.setting("scenes") == "training15" && !is_training15(id) {
            found.rule_out(
                id,
                "not in MiddEval3's training set, as scenes=training15 requires",
            );
        } else if other && rectification == "one" {
            let reason = "rectification=one reads only <Scene>-perfect if it exists (rectification=any reads both)";
            found.rule_out(id, reason);
        } else if other {
            found.rule_out(id, format!("rectification={rectification}"));
        } else if right != "im1" && !folder.join(&right_name).is_file() {
            let reason = format!("there is no {right_name}, which right={right} requires");
            found.rule_out(id, reason);
        } else {
            found.add(id, read_scene(spec, &root, folder, id.clone(), right));
        }
    }
    let expected = if found.left_out.is_empty() {
        "folders with im0.png, im1.png and calib.txt, up to four levels down"
    } else {
        "folders not excluded by scenes=, rectification= and right="
    };
    spec.conclude(found, expected, search.unsearched)
}

const PICTURES: [&str; 2] = ["im0.png", "im1.png"];

/// True if a folder has a file of a scene, even in another format or with an upper-case name. In
/// this way, a scene that cannot be read is reported as excluded instead of being overlooked.
fn has_part(folder: &Path) -> bool {
    let names = files::list(folder).unwrap_or_default().into_iter();
    names
        .map(|(name, _)| name.to_ascii_lowercase())
        .any(|name| {
            let stem = name.split('.').next().unwrap_or_default();
            name == "calib.txt" || matches!(stem, "im0" | "im1" | "disp0" | "disp0gt")
        })
}

fn read_scene(
    spec: &DatasetSpec,
    root: &Root,
    folder: &Path,
    id: String,
    right: &str,
) -> Result<Scene, DatasetError> {
    let mut names = PICTURES.into_iter().chain(["calib.txt"]);
    if let Some(missing) = names.find(|name| !folder.join(name).is_file()) {
        let reason = format!("there is no {missing}");
        return Err(DatasetError::malformed(folder, reason));
    }
    let calibration = root.resolve(folder, "calib.txt")?;
    let rig = files::parse_text(&calibration, calib::parse)?;
    let geometry = StereoGeometry {
        focal: rig.focal,
        baseline_m: rig.baseline_m,
        doffs: rig.doffs,
    };
    let side = |number: usize, name: &str, center: (f64, f64)| -> Result<Side, DatasetError> {
        let image = root.resolve(folder, &format!("{name}.png"))?;
        Ok(Side {
            id: name.to_owned(),
            size: match rig.size {
                Some(size) => size,
                None => picture::dimensions(&image)?,
            },
            image,
            disparity: find_disparity(root, folder, number)?.map(|file| (file, 1.0)),
            focal: (rig.focal, rig.focal),
            center: (center.0 + 0.5, center.1 + 0.5),
            geometry,
        })
    };
    let sides = [
        side(0, "im0", rig.left_center)?,
        side(1, right, rig.right_center)?,
    ];
    let notes = without_depth(&sides[0], &id, "disp0.pfm or disp0GT.pfm");
    let cluster = physical_scene(&id);
    stereo_pair::scene(spec, id, cluster, sides, &calibration, notes)
}

/// Disparity map of the left (0) or right (1) view, with the file name of either layout.
fn find_disparity(
    root: &Root,
    folder: &Path,
    side: usize,
) -> Result<Option<PathBuf>, DatasetError> {
    for name in [format!("disp{side}.pfm"), format!("disp{side}GT.pfm")] {
        let path = root.resolve(folder, &name)?;
        if path.is_file() {
            return Ok(Some(path));
        }
    }
    Ok(None)
}

/// True if MiddEval3's training set has the scene of this id.
fn is_training15(id: &str) -> bool {
    const NAMES: [&str; 15] = [
        "Adirondack",
        "ArtL",
        "Jadeplant",
        "Motorcycle",
        "MotorcycleE",
        "Piano",
        "PianoL",
        "Pipes",
        "Playroom",
        "Playtable",
        "PlaytableP",
        "Recycle",
        "Shelves",
        "Teddy",
        "Vintage",
    ];
    NAMES.contains(&without_rectification(id))
}

/// Folder name of the scene without `-perfect` or `-imperfect`.
fn without_rectification(id: &str) -> &str {
    let name = id.rsplit('/').next().unwrap_or(id);
    name.strip_suffix("-perfect")
        .or_else(|| name.strip_suffix("-imperfect"))
        .unwrap_or(name)
}

/// Folder name of the scene without `-perfect`/`-imperfect` and without MiddEval3's suffix for another exposure (E),
/// lighting (L) or rectification (P) of the same set-up: `PianoL` → `Piano`.
fn physical_scene(id: &str) -> String {
    let name = without_rectification(id);
    let stem = name.strip_suffix(['E', 'L', 'P']).unwrap_or(name);
    let is_variant = stem.ends_with(|c: char| c.is_ascii_lowercase());
    (if is_variant { stem } else { name }).to_owned()
}

#[cfg(test)]
mod tests {
    use super::{has_part, is_training15, physical_scene};

    #[test]
    fn a_folder_with_any_part_of_a_scene_is_one() {
        let dir = tempfile::tempdir().unwrap();
        for name in ["im0.PNG", "im1.jpg", "disp0GT.pfm", "calib.txt"] {
            let folder = dir.path().join(name.replace('.', "_"));
            std::fs::create_dir(&folder).unwrap();
            assert!(!has_part(&folder));
            std::fs::write(folder.join(name), "").unwrap();
            assert!(has_part(&folder), "{name}");
        }
        // A file of another exposure of the same scene.
        std::fs::write(dir.path().join("im0e0.png"), "").unwrap();
        assert!(!has_part(dir.path()));
    }

    #[test]
    fn the_training_set_goes_by_names() {
        assert!(is_training15("trainingF/PianoL") && is_training15("Adirondack-imperfect"));
        assert!(!is_training15("Bicycle1-perfect") && !is_training15("Motorcycle-quarter"));
    }

    #[test]
    fn variants_of_a_set_up_form_one_cluster() {
        for (id, cluster) in [
            ("Adirondack-perfect", "Adirondack"),
            ("x/Adirondack-imperfect", "Adirondack"),
            ("trainingQ/PianoL", "Piano"),
            ("MotorcycleE", "Motorcycle"),
            ("PlaytableP", "Playtable"),
            ("Pipes", "Pipes"),
            ("Motorcycle-quarter", "Motorcycle-quarter"),
            ("SCENE", "SCENE"),
        ] {
            assert_eq!(physical_scene(id), cluster);
        }
    }
}
