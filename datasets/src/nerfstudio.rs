//! Anyone's own pictures with a `transforms.json`.
//!
//! The format's conventions are nerfstudio's: OpenGL camera-to-world poses, pixel centres at half
//! integers, paths relative to the JSON. Its centring and rescaling of poses is not applied: the
//! file's units, times `scale`, are metres.

use std::collections::BTreeSet;
use std::path::{Path, PathBuf};

use sharp::camera::RigidTransform;

use crate::camera_size::{CAMERA_SIZE, CameraSizes};
use crate::depth::{Encoding, Resampling};
use crate::files::Root;
use crate::finder::Finder;
use crate::format::picture;
use crate::format::transforms::{self, Frame};
use crate::mask::Mask;
use crate::posed::{self, Depth, Pinhole, Posed, frame_id};
use crate::skipped::Skipped;
use crate::spec::{Attempts, Choice, DatasetSpec, Format, OUTSIDE, Setting, conclude};
use crate::{DatasetError, Pairing, Scene};

/// The catalogue's entry.
pub(crate) const FORMAT: Format = Format {
    name: "nerfstudio",
    summary: "your own pictures with a transforms.json (nerfstudio, instant-ngp, Blender)",
    settings: &[
        Setting::free("scale", "metres of one unit of the poses", "1"),
        Setting::free(
            "depth-unit",
            "metres of one unit of the depth maps, whatever their format (nerfstudio's rule)",
            "0.001",
        ),
        Setting::choice(
            "intrinsics",
            "whose count where a frame and the file state different ones",
            &[
                Choice::new("frame", "the frame's own"),
                Choice::new("file", "the file's, as in nerfstudio"),
            ],
        ),
        Setting::choice(
            "masks",
            "what becomes of pixels that a mask excludes",
            &[
                Choice::new("ignore", "masks are not read"),
                Choice::new(
                    "apply",
                    "the picture is black and the depth invalid there, and scores leave them out",
                ),
            ],
        ),
        CAMERA_SIZE,
        OUTSIDE,
    ],
    open,
};

/// The names a folder is searched for, the first that is there being read.
const NAMES: [&str; 2] = ["transforms.json", "transforms_train.json"];
/// Names of the same kind, which are only read when given as the path.
const OTHERS: [&str; 2] = ["transforms_val.json", "transforms_test.json"];

fn open(spec: &DatasetSpec) -> Result<Attempts, DatasetError> {
    let (folder, only) = if spec.path.is_file() {
        let folder = spec.path.parent().filter(|p| !p.as_os_str().is_empty());
        (folder.unwrap_or(Path::new(".")), Some(spec.path.clone()))
    } else {
        (spec.path.as_path(), None)
    };
    let root = Root::open(folder)?.allowing_outside(spec.setting("outside") == "allow");
    // Asked once, before any scene: a wrong value is no scene's fault.
    let units = (spec.positive("scale")?, spec.positive("depth-unit")?);
    if let Some(json) = only {
        return Ok(vec![read_scene(spec, &root, &json, units)]);
    }
    let found = root.find_folders(3, &|f| NAMES.iter().any(|n| f.join(n).is_file()))?;
    let mut scenes = Vec::new();
    for folder in &found.folders {
        let mut there = NAMES
            .iter()
            .chain(&OTHERS)
            .filter(|name| folder.join(name).is_file());
        let Some(name) = there.next() else { continue };
        let scene = read_scene(spec, &root, &folder.join(name), units);
        scenes.push(scene.map(|mut scene| {
            scene.notes.extend(choice_note(folder, name, there));
            scene
        }));
    }
    let expected = "transforms.json or transforms_train.json, up to three levels down; a file of \
                    another name can be given itself as the path";
    conclude(spec, scenes, expected, &[&found.passed_over])
}

/// Which of a folder's files was read, where there is more than the usual one.
fn choice_note<'a>(
    folder: &Path,
    read: &str,
    others: impl Iterator<Item = &'a &'a str>,
) -> Option<String> {
    let others: Vec<&str> = others.copied().collect();
    let choice = match others.as_slice() {
        [] if read == NAMES[0] => return None,
        [] => format!("there is no {}", NAMES[0]),
        others => format!(
            "not {} beside it; to read another one give the file itself as the path",
            others.join(", ")
        ),
    };
    Some(format!("{}: {read} was read, {choice}", folder.display()))
}

fn read_scene(
    spec: &DatasetSpec,
    root: &Root,
    json: &Path,
    (scale, depth_unit): (f64, f64),
) -> Result<Scene, DatasetError> {
    root.check(json)?;
    let mut file = transforms::read(json)?;
    let by_file = spec.setting("intrinsics") == "file";
    if by_file {
        file.frames.iter_mut().for_each(Frame::prefer_file);
    }
    let folder = json.parent().unwrap_or(Path::new("."));
    let mut reader = Reader {
        metres: scale / file.applied_scale,
        depth_unit,
        masks: spec.setting("masks") == "apply",
        sizes: CameraSizes::new(spec),
    };
    let mut finder = Finder::new(root, json);
    let (mut skipped, mut seen) = (Skipped::default(), BTreeSet::new());
    let mut views = Vec::new();
    for frame in &file.frames {
        let name = &frame.file_path;
        // Names that leave the folder are refused before anything else is made of them.
        let image = finder.picture(folder, name)?;
        let Ok(world_from_camera) = &frame.world_from_camera else {
            skipped.add("the pose is not finite or not rigid", name);
            continue;
        };
        let Some(image) = image else {
            skipped.add("the picture does not exist", name);
            continue;
        };
        if !seen.insert(image.clone()) {
            skipped.add("the picture was listed before", name);
            continue;
        }
        let posed = reader.posed(frame, image, world_from_camera, json, folder, &mut finder)?;
        views.push(posed.into_view()?);
    }
    posed::finish(&mut views);
    let mut notes = skipped.notes(json);
    notes.extend(finder.notes());
    notes.extend(reader.sizes.notes(json));
    let contradicting = file.frames.iter().filter(|f| f.contradicts_file).count();
    if contradicting > 0 {
        notes.push(format!(
            "{}: {contradicting} frame(s) state intrinsics that differ from the file's; {} count",
            json.display(),
            if by_file {
                "the file's"
            } else {
                "the frames' (intrinsics=file: the file's, as in nerfstudio)"
            }
        ));
    }
    if views.is_empty() {
        return Err(DatasetError::malformed(
            json,
            format!("no usable frame; {}", notes.join("; ")),
        ));
    }
    let id = root.id_of(folder);
    Ok(Scene {
        dataset: spec.name.clone(),
        cluster: id.clone(),
        id,
        views,
        pairing: Pairing::MultiView,
        notes,
    })
}

struct Reader {
    metres: f64,
    depth_unit: f64,
    masks: bool,
    sizes: CameraSizes,
}

impl Reader {
    fn posed(
        &mut self,
        frame: &Frame,
        image: PathBuf,
        world_from_camera: &RigidTransform,
        json: &Path,
        folder: &Path,
        finder: &mut Finder<'_>,
    ) -> Result<Posed, DatasetError> {
        let malformed = |reason: String| {
            DatasetError::malformed(json, format!("frame '{}': {reason}", frame.file_path))
        };
        let size = match frame.size().map_err(malformed)? {
            Some(size) => size,
            None => picture::dimensions(&image)?,
        };
        let mut named = |name: &Option<String>, what: &str| match name {
            None => Ok(None),
            Some(name) => match finder.map(folder, name)? {
                Some(path) => Ok(Some(path)),
                None => Err(malformed(format!("its {what} '{name}' does not exist"))),
            },
        };
        let depth = match named(&frame.depth_file_path, "depth map")? {
            Some(path) => Depth::Map(path, Encoding::Units(self.depth_unit), Resampling::Nearest),
            None => Depth::None,
        };
        let mask = if self.masks {
            named(&frame.mask_path, "mask")?.map(|file| Mask { file })
        } else {
            None
        };
        let lens = frame.lens(size).map_err(malformed)?;
        let lens = self.sizes.fit(lens, &image)?;
        let mut pose = *world_from_camera;
        pose.translation *= self.metres;
        Ok(Posed {
            id: frame_id(&frame.file_path),
            image,
            lens,
            pinhole: Pinhole::WithoutBlankPixels,
            camera_from_world: pose.inverse(),
            mask,
            depth,
            cameras: vec![json.to_owned()],
        })
    }
}
