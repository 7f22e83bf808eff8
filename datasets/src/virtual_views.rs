//! Any photograph, with virtual views around it: cameras along a path, without photographs to score against.

use std::path::{Path, PathBuf};
use std::sync::Arc;

use glam::DVec3;
use image::RgbImage;
use sharp::camera::{Intrinsics, RigidTransform};
use sharp::image_file::OrientationRule;
use sharp::image_file::focal::{Focal, FocalSource};
use sharp::trajectory::{DepthRange, Trajectory, TrajectoryKind, looking, shifted};
use sharp::unprojection::release_intrinsics;
use sharp_checkpoint::hash::sha256_hex;

use crate::depth::{DepthEncoding, DepthKind, ViewDepth};
use crate::file_content::FileContent;
use crate::files::{self, Root};
use crate::format::picture;
use crate::found_scenes::FoundScenes;
use crate::setting::{Setting, choice};
use crate::undistort::ViewGeometry;
use crate::{DatasetEntry, DatasetError, DatasetSpec, DepthMap, Pairing, Scene, View, ViewContent};

pub(crate) static ENTRY: DatasetEntry = DatasetEntry {
    format: "virtual",
    display_name: "virtual views",
    title: "any photographs, with virtual cameras around them",
    layout: "a photograph, or a folder of them",
    caveat: "nothing to score: methods predict the views, for figures",
    settings: &[
        Setting::choice(
            "path",
            "how the camera moves",
            &[
                choice("lateral", "to the right, in steps"),
                choice("forward", "forward, in steps"),
                choice(
                    "orbit",
                    "to the right on an orbit around the point at `focus` on the photograph's axis, in steps",
                ),
                choice(
                    "swipe",
                    "from left to right; this path and the following ones are those of SHARP's release, sized by `near` \
                     and looking at the point at `focus`",
                ),
                choice("shake", "left and right, then up and down"),
                choice("rotate", "on a circle"),
                choice(
                    "rotate_forward",
                    "sideways along a sine, forward and back along half a cosine",
                ),
            ],
        ),
        Setting::free("views", "number of virtual views, 1 to 1000", "8"),
        Setting::free(
            "step",
            "step between consecutive views: metres (auto: 0.05), or degrees on an orbit (auto: 2)",
            "auto",
        ),
        Setting::free(
            "near",
            "depth of the nearest objects in metres, for the paths of SHARP's release (auto: the 0.001 quantile of the depth map, or 1 without one)",
            "auto",
        ),
        Setting::free(
            "focus",
            "depth in metres of the point that the camera looks at, for an orbit and the paths of SHARP's release (auto: the 0.1 quantile of the depth map, at \
             least 2, or 2 without one)",
            "auto",
        ),
        Setting::free(
            "focal-px",
            "focal length in pixels (auto: as stated in the photograph's file, or 30 mm on 35 mm film)",
            "auto",
        ),
        Setting::free(
            "depth",
            "folder with a depth map of each photograph: NAME.exr, .npy, .npz or .pfm (metres), or NAME.png \
             (millimetres), as `predict --depth-only` writes them; methods that use true depth \
             read it",
            "none",
        ),
    ],
    open,
    ..DatasetEntry::OWN
};

const MAX_VIEWS: usize = 1000;
const DEPTH_EXTENSIONS: [&str; 5] = ["exr", "npy", "npz", "pfm", "png"];

fn open(spec: &DatasetSpec) -> Result<FoundScenes, DatasetError> {
    let options = Options::of(spec)?;
    let photographs = if spec.path.is_file() {
        let name = spec.path.file_name().unwrap_or_default();
        vec![(name.to_string_lossy().into_owned(), spec.path.clone())]
    } else {
        files::pictures(Root::open(&spec.path)?.path())?
    };
    let mut found = FoundScenes::default();
    for (name, file) in photographs {
        found.add(name, scene(spec, &options, &file));
    }
    spec.conclude(found, "a photograph, or a folder of them", Vec::new())
}

struct Options {
    path: CameraPath,
    views: usize,
    near_m: Option<f64>,
    focus_m: Option<f64>,
    focal_px: Option<f64>,
    depth: Option<PathBuf>,
}

#[derive(Clone, Copy)]
enum CameraPath {
    LateralM(f64),
    ForwardM(f64),
    OrbitDeg(f64),
    Release(TrajectoryKind),
}

impl Options {
    fn of(spec: &DatasetSpec) -> Result<Self, DatasetError> {
        let number = |key: &str| match spec.setting(key) {
            "auto" => Ok(None),
            _ => spec.positive(key).map(Some),
        };
        let (path, step) = (spec.setting("path"), number("step")?);
        let unused: &[&str] = match path {
            "lateral" | "forward" => &["near", "focus"],
            "orbit" => &["near"],
            _ => &["step"],
        };
        if let Some(key) = unused.iter().find(|key| spec.setting(key) != "auto") {
            return Err(spec.refused(format!("path={path} does not use '{key}'; omit '{key}'")));
        }
        let kind = TrajectoryKind::ALL.into_iter().find(|k| k.name() == path);
        let path = match (path, kind) {
            (_, Some(kind)) => CameraPath::Release(kind),
            ("forward", None) => CameraPath::ForwardM(step.unwrap_or(0.05)),
            ("orbit", None) => CameraPath::OrbitDeg(step.unwrap_or(2.0)),
            _ => CameraPath::LateralM(step.unwrap_or(0.05)),
        };
        let views = spec.setting("views").parse().ok();
        let views = views.filter(|n| (1..=MAX_VIEWS).contains(n));
        let views = views.ok_or_else(|| {
            spec.refused(format!(
                "'views' must be a whole number from 1 to {MAX_VIEWS}"
            ))
        })?;
        let depth = spec.setting("depth");
        Ok(Self {
            path,
            views,
            near_m: number("near")?,
            focus_m: number("focus")?,
            focal_px: number("focal-px")?,
            depth: (depth != "none").then(|| PathBuf::from(depth)),
        })
    }

    /// Transforms from the photograph's camera to the camera of each virtual view.
    fn poses(&self, camera: &Intrinsics, depth: Option<&DepthMap>) -> Vec<RigidTransform> {
        let range = depth.and_then(|depth| DepthRange::of_depths(depth.iter().copied()));
        let near = self.near_m.or(range.map(|range| range.near)).unwrap_or(1.0);
        let focus = self.focus_m.or(range.map(|range| range.focus));
        let focus = focus.unwrap_or(DepthRange::MIN_FOCUS);
        let centre = DVec3::Z * focus;
        let at = |step: usize| {
            let n = step as f64;
            match self.path {
                CameraPath::LateralM(step) => shifted(DVec3::X * (step * n)),
                CameraPath::ForwardM(step) => shifted(DVec3::Z * (step * n)),
                CameraPath::OrbitDeg(step) => {
                    let (sin, cos) = (step * n).to_radians().sin_cos();
                    looking(centre - focus * DVec3::new(-sin, 0.0, cos), centre)
                }
                CameraPath::Release(_) => RigidTransform::IDENTITY,
            }
        };
        let CameraPath::Release(kind) = self.path else {
            return (1..=self.views).map(at).collect();
        };
        let range = DepthRange {
            near,
            focus,
            far: range.map_or(focus, |range| range.far),
        };
        let steps = self.views;
        Trajectory { kind, steps }.poses(camera, &range)
    }
}

fn scene(spec: &DatasetSpec, options: &Options, file: &Path) -> Result<Scene, DatasetError> {
    let header = picture::header(file)?;
    let mut rules = spec.picture_rules();
    // There is no camera whose size could decide the orientation.
    let is_turned = rules.turns(&header, None);
    rules.orientation = if is_turned {
        OrientationRule::Upright
    } else {
        OrientationRule::Stored
    };
    let size = if is_turned {
        header.upright_size()
    } else {
        header.size
    };
    let mut warnings = Vec::new();
    let mut notes = Vec::new();
    let focal_px = match options.focal_px {
        Some(px) => px,
        None => {
            let of = (size.0 as usize, size.1 as usize);
            let focal = Focal::of_file(&files::read(file)?, of);
            let named = focal.warnings.into_iter();
            let named = named.map(|text| {
                let text = text.replace("--focal-px", "focal-px=PIXELS");
                format!("{}: {text}", file.display())
            });
            // The paper's own code assumes this default for every photograph without a focal length.
            match focal.source {
                FocalSource::Default => notes.extend(named),
                _ => warnings.extend(named),
            }
            focal.px
        }
    };
    let intrinsics = release_intrinsics(focal_px, size.0, size.1)
        .map_err(|error| DatasetError::camera(file, error))?;
    let stem = file.file_stem().unwrap_or_default();
    let stem = stem.to_string_lossy().into_owned();
    let depth = match &options.depth {
        None => None,
        Some(folder) => Some(depth_of(folder, &stem)?),
    };
    let photograph = FileContent {
        image: file.to_owned(),
        rules,
        geometry: ViewGeometry {
            size,
            undistortion: None,
            pinhole: intrinsics,
            camera_from_world: RigidTransform::IDENTITY,
        },
        mask: None,
        depth,
        cameras: Vec::new(),
        has_camera_size: false,
    };
    let poses = options.poses(&intrinsics, photograph.depth()?.as_ref());
    let view = |id: String, camera_from_world, content| View {
        id,
        intrinsics,
        camera_from_world,
        content,
    };
    let first = view(
        "photograph".to_owned(),
        RigidTransform::IDENTITY,
        Arc::new(photograph),
    );
    let path = spec.setting("path");
    let digits = options.views.to_string().len().max(2);
    let others = poses.into_iter().zip(1..).map(|(pose, n)| {
        let camera: Arc<dyn ViewContent> = Arc::new(CameraOnly);
        view(format!("{path}_{n:0digits$}"), pose, camera)
    });
    let views = std::iter::once(first).chain(others).collect();
    Ok(Scene {
        notes,
        warnings,
        ..Scene::new(&spec.name, stem, views, Pairing::Star { source: 0 })
    })
}

fn depth_of(folder: &Path, stem: &str) -> Result<ViewDepth, DatasetError> {
    let maps = files::of_stem(folder, stem, &DEPTH_EXTENSIONS);
    // A PNG next to a float map is its visualisation.
    let Some(map) = maps.into_iter().next() else {
        let reason = format!("no depth map {stem}.{}", DEPTH_EXTENSIONS.join(", ."));
        return Err(DatasetError::malformed(folder, reason));
    };
    let is_png = map
        .extension()
        .is_some_and(|e| e.eq_ignore_ascii_case("png"));
    let unit_m = if is_png { 0.001 } else { 1.0 };
    Ok(ViewDepth::Map(
        map,
        DepthEncoding::Units(unit_m, DepthKind::Z),
    ))
}

/// Content of a view that is only a camera.
#[derive(Debug)]
struct CameraOnly;

impl ViewContent for CameraOnly {
    fn image(&self) -> Result<RgbImage, DatasetError> {
        Err(DatasetError::NoPhotograph)
    }

    fn has_photograph(&self) -> bool {
        false
    }

    fn image_sha256(&self) -> Result<String, DatasetError> {
        Ok(sha256_hex(b"camera without a photograph"))
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::format::{FloatMap, npy};
    use image::{Luma, Rgb};

    fn open(folder: &Path, settings: &str) -> Result<Vec<Scene>, DatasetError> {
        let spec = format!("virtual={}{settings}", folder.display());
        crate::open(&DatasetSpec::parse(&spec)?)
    }

    fn photograph(folder: &Path, name: &str) -> PathBuf {
        let path = folder.join(name);
        RgbImage::from_pixel(60, 40, Rgb([9, 90, 200]))
            .save(&path)
            .unwrap();
        path
    }

    fn centres(scene: &Scene) -> Vec<DVec3> {
        let views = scene.views.iter().skip(1);
        views.map(|v| v.camera_from_world.camera_center()).collect()
    }

    #[test]
    fn cameras_move_as_the_path_says() {
        let dir = tempfile::tempdir().unwrap();
        photograph(dir.path(), "a.png");
        let of = |settings: &str| open(dir.path(), settings).unwrap().remove(0);
        let lateral = of(",views=2,step=0.1");
        assert_eq!(lateral.id, "a");
        assert_eq!(lateral.pairing, Pairing::Star { source: 0 });
        assert_eq!(centres(&lateral), [DVec3::X * 0.1, DVec3::X * 0.2]);
        assert_eq!(lateral.views[2].id, "lateral_02");
        assert!(lateral.views[0].content.has_photograph());
        assert!(!lateral.views[1].content.has_photograph());
        // 30 mm on the diagonal of 35 mm film.
        let focal = 30.0 * 60_f64.hypot(40.0) / 36_f64.hypot(24.0);
        assert!((lateral.views[1].intrinsics.fx - focal).abs() < 1e-9);
        assert!(lateral.notes[0].contains("focal-px=PIXELS"), "{lateral:?}");
        let forward = of(",path=forward,views=1,step=0.3,focal-px=50");
        assert_eq!(centres(&forward), [DVec3::Z * 0.3]);
        assert_eq!(forward.views[0].intrinsics.fx, 50.0);
        assert!(forward.notes.is_empty() && forward.warnings.is_empty());
        let orbit = of(",path=orbit,views=3,step=30,focus=2");
        // A quarter of a turn to the right of the point at 2 m: level with it, looking left.
        let last = &orbit.views[3].camera_from_world;
        assert!((last.camera_center() - DVec3::new(2.0, 0.0, 2.0)).length() < 1e-9);
        assert!((last.apply(DVec3::Z * 2.0) - DVec3::Z * 2.0).length() < 1e-9);
        let swipe = of(",path=swipe,views=3,near=2");
        let x: Vec<f64> = centres(&swipe).iter().map(|eye| eye.x).collect();
        let side = 0.08 * (60_f64.hypot(40.0) / focal) * 2.0;
        assert!(
            (x[0] + side).abs() < 1e-9 && (x[2] - side).abs() < 1e-9,
            "{x:?}"
        );
    }

    #[test]
    fn depth_maps_set_the_size_of_a_path_and_are_the_photographs_depth() {
        let dir = tempfile::tempdir().unwrap();
        let file = photograph(dir.path(), "a.png");
        let maps = dir.path().join("maps");
        std::fs::create_dir(&maps).unwrap();
        let settings = format!(",path=swipe,views=2,depth={}", maps.display());
        let missing = open(&file, &settings).unwrap_err().to_string();
        assert!(missing.contains("no depth map a.exr"), "{missing}");
        let map = FloatMap::from_pixel(60, 40, Luma([4.0]));
        npy::write(&maps.join("a.npy"), &map).unwrap();
        let scene = open(&file, &settings).unwrap().remove(0);
        assert_eq!(scene.views[0].content.depth().unwrap().unwrap(), map);
        let nearer = open(&file, ",path=swipe,views=2,near=2").unwrap().remove(0);
        let (far, near) = (centres(&scene)[0].x, centres(&nearer)[0].x);
        assert!((far / near - 2.0).abs() < 1e-6, "{far} {near}");
    }

    #[test]
    fn mistakes_are_named() {
        let dir = tempfile::tempdir().unwrap();
        let reason = |settings: &str| open(dir.path(), settings).unwrap_err().to_string();
        assert!(reason("").contains("no virtual scene found"));
        for (settings, part) in [
            (",views=0", "from 1 to 1000"),
            (",path=swipe,step=1", "path=swipe does not use 'step'"),
            (",near=2", "path=lateral does not use 'near'"),
            (",path=orbit,focus=-1", "'focus' cannot be '-1'"),
            (",path=zigzag", "one of lateral"),
        ] {
            let reason = reason(settings);
            assert!(reason.contains(part), "{reason}");
        }
    }
}
