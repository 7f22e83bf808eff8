//! User-supplied depth maps: `--overlap-depth DIR`.

use std::path::{Path, PathBuf};

use sharp::resize::nearest;
use sharp_datasets::format::read_map;
use sharp_datasets::{DepthMap, Scene, View};

use super::DepthSource;
use crate::io::hash::{file_sha256, sha256_hex};
use crate::pairs::PairError;
use crate::pairs::pair_id::{scene_path, view_name};
use crate::pairs::valid_depth::is_valid_depth;

const EXTENSIONS: [&str; 5] = ["npy", "npz", "exr", "pfm", "png"];

/// Unit of a 16-bit PNG, in metres.
const PNG_UNIT_M: f64 = 0.001;

/// Reads `DIR/<dataset>/<scene>/<view>.npy|npz|exr|pfm|png`, each part percent-encoded as in pair ids.
///
/// The maps are z-depth (neither disparity nor ray length) of the scored pictures, which `cameras export` writes:
/// floats in metres, or 16-bit PNG in millimetres. Values that are not finite or not positive mean no depth. A map of
/// another size but the picture's aspect ratio is resized to the picture by nearest-pixel sampling.
#[derive(Debug, Clone)]
pub struct GivenDepth {
    dir: PathBuf,
}

impl GivenDepth {
    pub fn open(dir: &Path) -> Result<Self, PairError> {
        if !dir.is_dir() {
            return Err(wrong(dir, "is not a folder"));
        }
        Ok(Self {
            dir: dir.to_owned(),
        })
    }

    /// The number of views that have a map, and a single SHA-256 of these maps and their names.
    ///
    /// # Errors
    /// [`PairError::Depth`] if a view has two maps, [`PairError::File`] if a map cannot be read.
    pub fn digest(&self, scenes: &[Scene]) -> Result<(usize, String), PairError> {
        let mut lines = Vec::new();
        for scene in scenes {
            for view in &scene.views {
                if let Some(file) = self.find(scene, view)? {
                    let hash = file_sha256(&file)?;
                    let name = stem(scene, view);
                    lines.push(format!("{name} {hash}\n"));
                }
            }
        }
        lines.sort();
        Ok((lines.len(), sha256_hex(lines.concat().as_bytes())))
    }

    fn find(&self, scene: &Scene, view: &View) -> Result<Option<PathBuf>, PairError> {
        find_map(&self.dir.join(stem(scene, view)))
    }
}

/// The depth map at the path `stem` plus one of `EXTENSIONS`, if any. A PNG next to a map in floats is ignored, because
/// it is probably a visualisation.
///
/// # Errors
/// [`PairError::Depth`] if there are two maps.
pub fn find_map(stem: &Path) -> Result<Option<PathBuf>, PairError> {
    let found: Vec<PathBuf> = EXTENSIONS
        .iter()
        // Append the extension instead of replacing one, because a view's name may contain a dot.
        .map(|extension| PathBuf::from(format!("{}.{extension}", stem.display())))
        .filter(|path| path.is_file())
        .collect();
    match found.as_slice() {
        [] => Ok(None),
        [file] => Ok(Some(file.clone())),
        [file, png] if png.extension().is_some_and(|e| e == "png") => Ok(Some(file.clone())),
        [first, second, ..] => Err(wrong(
            first,
            &format!("ambiguous, because {} exists too", second.display()),
        )),
    }
}

/// Reads a file's z-depth in metres, at the file's resolution; 0 where unknown.
///
/// # Errors
/// The error names the file.
pub fn read_metres(file: &Path) -> Result<DepthMap, PairError> {
    let mut map = read_map(file)?;
    let is_png = file.extension().is_some_and(|e| e == "png");
    let unit = if is_png { PNG_UNIT_M } else { 1.0 };
    for z in map.iter_mut() {
        let metres = (f64::from(*z) * unit) as f32;
        *z = if is_valid_depth(metres) { metres } else { 0.0 };
    }
    Ok(map)
}

fn stem(scene: &Scene, view: &View) -> String {
    let folder = scene_path(&scene.dataset, &scene.id);
    format!("{folder}/{}", view_name(&view.id))
}

fn wrong(path: &Path, reason: &str) -> PairError {
    PairError::Depth {
        path: path.to_owned(),
        reason: reason.to_owned(),
    }
}

impl DepthSource for GivenDepth {
    fn depth(&self, scene: &Scene, view: &View) -> Result<Option<DepthMap>, PairError> {
        let Some(file) = self.find(scene, view)? else {
            let expected = self.dir.join(stem(scene, view));
            let reason = format!("no depth map (looked for .{})", EXTENSIONS.join(", ."));
            return Err(wrong(&expected, &reason));
        };
        let map = read_metres(&file)?;
        let (w, h) = map.dimensions();
        let (to_w, to_h) = (view.intrinsics.width, view.intrinsics.height);
        // Rounding to whole pixels may put a side one pixel off the exact aspect ratio.
        let other = f64::from(w) * f64::from(to_h) / f64::from(to_w);
        if (w, h) != (to_w, to_h) && (other - f64::from(h)).abs() > 1.0 {
            return Err(PairError::DepthSize {
                what: file.display().to_string(),
                depth: (w, h),
                camera: (to_w, to_h),
            });
        }
        let resized = nearest(
            map.as_raw(),
            (w as usize, h as usize),
            (to_w as usize, to_h as usize),
        );
        let map = DepthMap::from_vec(to_w, to_h, resized);
        map.map(Some).ok_or_else(|| wrong(&file, "is too large"))
    }

    fn name(&self) -> String {
        "given".to_owned()
    }

    fn files(&self, scene: &Scene, view: &View) -> Vec<PathBuf> {
        self.find(scene, view).ok().flatten().into_iter().collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pairs::depth::{GroundTruthDepth, ScaledToGroundTruth};
    use crate::pairs::test_scene::{Depth, row};
    use image::Luma;
    use sharp_datasets::format::{FloatMap, depth_png, npy};
    use sharp_tests::holds;

    fn write(dir: &Path, name: &str, map: &FloatMap) -> PathBuf {
        let path = dir.join("d/s").join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        if name.ends_with("png") {
            depth_png::write(&path, map).unwrap();
        } else {
            npy::write(&path, map).unwrap();
        }
        path
    }

    #[test]
    fn maps_are_found_by_name_and_brought_to_size_and_scale() {
        let dir = tempfile::tempdir().unwrap();
        let scene = row(
            "d",
            "s",
            0.1,
            &[Depth::Wall(2.0), Depth::Wall(2.0), Depth::Absent],
        )
        .scene;
        // A quarter of the size, in an arbitrary unit, with a hole.
        let mut map = FloatMap::from_pixel(50, 5, Luma([0.5]));
        map.put_pixel(0, 0, Luma([f32::NAN]));
        write(dir.path(), "v0.npy", &map);
        write(
            dir.path(),
            "v1.png",
            &FloatMap::from_pixel(100, 10, Luma([1500.0])),
        );
        write(dir.path(), "v2.npy", &map);
        let given = GivenDepth::open(dir.path()).unwrap();
        let plain = given.depth(&scene, &scene.views[0]).unwrap().unwrap();
        assert_eq!(plain.dimensions(), (100, 10));
        assert_eq!(plain.get_pixel(0, 0).0, [0.0]);
        assert_eq!(plain.get_pixel(2, 0).0, [0.5]);
        let millimetres = given.depth(&scene, &scene.views[1]).unwrap().unwrap();
        assert_eq!(millimetres.get_pixel(0, 0).0, [1.5]);

        let scaled = ScaledToGroundTruth(given.clone());
        let metric = scaled.depth(&scene, &scene.views[0]).unwrap().unwrap();
        assert_eq!(metric.get_pixel(99, 9).0, [2.0]);
        assert_eq!(scaled.name(), "given,median-scaled-to-ground-truth");
        // A view without depth of its own cannot be scaled.
        assert!(scaled.depth(&scene, &scene.views[2]).unwrap().is_none());
        assert!(GroundTruthDepth.files(&scene, &scene.views[0]).is_empty());
        assert_eq!(
            scaled.files(&scene, &scene.views[1]),
            [dir.path().join("d/s/v1.png")]
        );
        let (maps, digest) = given.digest(std::slice::from_ref(&scene)).unwrap();
        assert_eq!((maps, digest.len()), (3, 64));
        std::fs::remove_file(dir.path().join("d/s/v2.npy")).unwrap();
        assert_ne!(
            given.digest(std::slice::from_ref(&scene)).unwrap().1,
            digest
        );
    }

    #[test]
    fn what_is_wrong_with_a_map_is_said_with_its_name() {
        let dir = tempfile::tempdir().unwrap();
        let scene = row("d", "s", 0.1, &[Depth::Wall(2.0); 3]).scene;
        let given = GivenDepth::open(dir.path()).unwrap();
        let depth = |view: usize| {
            given
                .depth(&scene, &scene.views[view])
                .unwrap_err()
                .to_string()
        };
        let absent = depth(0);
        holds(&absent, &["v0", "no depth map"]);
        let map = FloatMap::from_pixel(100, 10, Luma([1.0]));
        write(dir.path(), "v0.npy", &map);
        write(dir.path(), "v0.png", &map);
        assert!(given.depth(&scene, &scene.views[0]).unwrap().is_some());
        let other = dir.path().join("d/s/v0.npz");
        std::fs::write(&other, "x").unwrap();
        assert!(depth(0).contains("ambiguous"));
        std::fs::remove_file(other).unwrap();
        write(
            dir.path(),
            "v1.npy",
            &FloatMap::from_pixel(50, 50, Luma([1.0])),
        );
        let shape = depth(1);
        holds(&shape, &["v1.npy", "50x50"]);
        std::fs::write(dir.path().join("d/s/v2.npy"), b"\x93NUMPY").unwrap();
        assert!(depth(2).contains("v2.npy"));
        let nowhere = GivenDepth::open(&dir.path().join("nowhere")).unwrap_err();
        assert!(nowhere.to_string().contains("nowhere"));
    }
}
