//! Middlebury 2014 stereo, as the `scenes2014` archives and as MiddEval3 lay it out.
//!
//! A scene is any folder with `im0.png`, `im1.png` and `calib.txt`. Depth comes from `disp0.pfm`
//! (scenes2014) or `disp0GT.pfm` (MiddEval3, whose ground truth is a separate download), as
//! `Z = baseline · f / (d + doffs)` (Middlebury's own formula).
//!
//! `calib.txt` does not say where its pixel centres lie. It is read as if the centre of the first
//! pixel were (0, 0), OpenCV's way, so 0.5 is added to each principal point. Depth depends only
//! on the difference of the two, which this leaves alone.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::{DMat3, DVec3};
use sharp::camera::{Intrinsics, RigidTransform};

use crate::catalog::{Choice, DatasetSpec, Format, Setting};
use crate::content::{DepthSource, FileContent, StereoGeometry, check_size};
use crate::files::Root;
use crate::format::calib::{self, StereoCalibration};
use crate::format::{pfm, picture};
use crate::{DatasetError, DepthMap, Pairing, Scene, View};

/// The catalogue's entry.
pub(crate) const FORMAT: Format = Format {
    name: "middlebury",
    summary: "Middlebury 2014 stereo (scenes2014 or MiddEval3): folders with im0.png, im1.png, calib.txt",
    settings: &[
        Setting::choice(
            "rectification",
            "which of the two rectifications of a scene (folders without the suffix always count)",
            &[
                Choice::new("any", "every scene folder found"),
                Choice::new("perfect", "only <Scene>-perfect"),
                Choice::new("imperfect", "only <Scene>-imperfect"),
            ],
        ),
        Setting::choice(
            "right",
            "which right picture is the target",
            &[
                Choice::new("im1", "the default exposure and lighting"),
                Choice::proxy("im1E", "another exposure, where there is one"),
                Choice::proxy("im1L", "another lighting, where there is one"),
            ],
        ),
    ],
    open,
};

/// Reads every scene below the folder, left view first.
///
/// # Errors
/// [`DatasetError::NoScene`] when nothing is found; errors of the files otherwise.
fn open(spec: &DatasetSpec) -> Result<Vec<Scene>, DatasetError> {
    let root = Root::open(&spec.path)?;
    let right = spec.setting("right");
    let right_name = format!("{right}.png");
    let rectification = spec.setting("rectification");
    let folders = root.find_folders(4, &|folder| {
        ["im0.png", "im1.png", "calib.txt"]
            .iter()
            .all(|name| folder.join(name).is_file())
    })?;
    let mut scenes = Vec::new();
    for folder in folders {
        let id = root.id_of(&folder);
        let other = match rectification {
            "perfect" => "-imperfect",
            "imperfect" => "-perfect",
            _ => "/",
        };
        if id.ends_with(other) || !folder.join(&right_name).is_file() {
            continue;
        }
        scenes.push(read_scene(&spec.name, &root, &folder, id, right)?);
    }
    if scenes.is_empty() {
        return Err(DatasetError::NoScene {
            path: spec.path.clone(),
            format: FORMAT.name,
            expected: "folders with im0.png, im1.png and calib.txt, up to four levels down",
        });
    }
    Ok(scenes)
}

fn read_scene(
    dataset: &str,
    root: &Root,
    folder: &Path,
    id: String,
    right: &str,
) -> Result<Scene, DatasetError> {
    let calibration_file = root.resolve(folder, "calib.txt")?;
    let rig = calib::read(&calibration_file)?;
    let mut notes = Vec::new();
    let mut view = |side: usize, name: &str| -> Result<View, DatasetError> {
        let image = root.resolve(folder, &format!("{name}.png"))?;
        let depth = find_disparity(root, folder, side)?;
        if side == 0 && depth.is_none() {
            notes.push(format!(
                "{id}: no disp0.pfm or disp0GT.pfm, so the left view has no depth"
            ));
        }
        let (center, x_m) = match side {
            0 => (rig.left_center, 0.0),
            _ => (rig.right_center, rig.baseline_m),
        };
        let size = match rig.size {
            Some(size) => size,
            None => picture::dimensions(&image)?,
        };
        let camera_error = |source| DatasetError::Camera {
            path: calibration_file.clone(),
            source,
        };
        Ok(View {
            id: name.to_owned(),
            intrinsics: Intrinsics::new(
                (rig.focal, rig.focal),
                (center.0 + 0.5, center.1 + 0.5),
                size,
            )
            .map_err(camera_error)?,
            camera_from_world: RigidTransform::new(DMat3::IDENTITY, DVec3::new(-x_m, 0.0, 0.0))
                .map_err(camera_error)?,
            content: Arc::new(FileContent {
                image,
                size,
                depth: depth
                    .map(|file| Arc::new(Disparity::new(file, &rig, size)) as Arc<dyn DepthSource>),
                cameras: vec![calibration_file.clone()],
            }),
        })
    };
    let views = vec![view(0, "im0")?, view(1, right)?];
    Ok(Scene {
        dataset: dataset.to_owned(),
        cluster: physical_scene(&id),
        id,
        views,
        pairing: Pairing::Stereo {
            source: 0,
            target: 1,
        },
        notes,
    })
}

/// The disparity of the left (0) or right (1) view, in either layout's name.
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

/// The scene's folder name without `-perfect`/`-imperfect` and without MiddEval3's suffix for
/// another exposure (E), lighting (L) or rectification (P) of the same set-up: `PianoL` → `Piano`.
fn physical_scene(id: &str) -> String {
    let name = id.rsplit('/').next().unwrap_or(id);
    let name = name
        .strip_suffix("-perfect")
        .or_else(|| name.strip_suffix("-imperfect"))
        .unwrap_or(name);
    let stem = name.strip_suffix(['E', 'L', 'P']).unwrap_or(name);
    let is_variant = stem.ends_with(|c: char| c.is_ascii_lowercase());
    (if is_variant { stem } else { name }).to_owned()
}

#[derive(Debug)]
struct Disparity {
    file: PathBuf,
    geometry: StereoGeometry,
    size: (u32, u32),
}

impl Disparity {
    fn new(file: PathBuf, rig: &StereoCalibration, size: (u32, u32)) -> Self {
        Self {
            file,
            geometry: StereoGeometry {
                focal: rig.focal,
                baseline_m: rig.baseline_m,
                doffs: rig.doffs,
            },
            size,
        }
    }
}

impl DepthSource for Disparity {
    fn load(&self) -> Result<DepthMap, DatasetError> {
        let disparity = pfm::read(&self.file)?;
        check_size(&self.file, disparity.dimensions(), self.size)?;
        self.geometry.depth_map(&self.file, &disparity)
    }

    fn files(&self) -> Vec<PathBuf> {
        vec![self.file.clone()]
    }
}

#[cfg(test)]
mod tests {
    use super::physical_scene;

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
