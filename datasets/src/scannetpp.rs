//! ScanNet++, DSLR pictures (v1 and v2).
//!
//! `data/<scene>/dslr/` holds fisheye pictures in `resized_images`, their cameras in
//! `nerfstudio/transforms.json` and, if the toolbox was run, undistorted pictures with
//! `nerfstudio/transforms_undistorted.json`. Poses went through COLMAP's change of world axes on
//! their way into the JSON; it is undone, so that the views share the world of `scans/`. Metres.

use std::path::PathBuf;

use crate::colmap::PointTracks;
use crate::depth::{DepthEncoding, ViewDepth};
use crate::entry::{DatasetEntry, PaperOverlap, Setting, choice, proxy};
use crate::files::{self, Root};
use crate::format::transforms::{self, JsonFrame, Transforms, undo_colmap_axes};
use crate::format::{colmap, picture};
use crate::left_out::LeftOut;
use crate::lens::Lens;
use crate::mask::MaskFile;
use crate::required_files::{PhotographPath, RequiredFile};
use crate::scan_depth::{ScanCache, ScanFile};
use crate::scene_builder::{Pinhole, PosedFrame, SceneBuilder, frame_id};
use crate::spec::SceneResults;
use crate::{DatasetError, DatasetSpec, Scene};

pub(crate) static ENTRY: DatasetEntry = DatasetEntry {
    format: "scannetpp",
    display_name: "ScanNet++",
    title: "ScanNet++ (v1, v2), DSLR pictures",
    page: "https://kaldir.vc.in.tum.de/scannetpp/",
    terms: "non-commercial research after application; no redistribution",
    download: "DSLR pictures, nerfstudio/ cameras, splits/, and scans/ for depth",
    size: "371 GB of DSLR pictures for all 1,006 scenes of v2",
    layout: "splits/<split>.txt, data/<scene>/dslr/{resized_images, nerfstudio/transforms.json}, \
             data/<scene>/scans/mesh_aligned_0.05.ply",
    paper_column: "ScanNet++",
    paper_overlap: PaperOverlap::Dense,
    caveat: "the paper says 'nvs test split': whether that is the list nvs_test, whose meshes and \
             test pictures are withheld, or the test pictures of other scenes, is open",
    settings: &[
        Setting::named(
            "split",
            "a list in splits/, or every scene",
            &[
                choice(
                    "nvs_test",
                    "one reading of the paper's 'nvs test': it has neither mesh nor test pictures, so \
                     that frames=train and depth=points are what is left of it",
                ),
                choice(
                    "nvs_sem_val",
                    "has meshes and test pictures: with frames=test another reading",
                ),
                proxy("nvs_test_small", "twelve scenes of nvs_test"),
                choice("all", "every scene that is there: with frames=test a third"),
            ],
        ),
        Setting::choice(
            "frames",
            "which pictures of a scene",
            &[
                choice("train", "'frames': all that is there of nvs_test"),
                choice("test", "'test_frames'"),
                choice("all", "both"),
            ],
        ),
        Setting::choice(
            "images",
            "which photographs",
            &[
                choice("auto", "undistorted if they are there, else fisheye"),
                choice("undistorted", "as the toolbox undistorts them"),
                choice(
                    "fisheye",
                    "as taken, undistorted by us to the toolbox's camera",
                ),
            ],
        ),
        Setting::choice(
            "depth",
            "where depth comes from",
            &[
                choice(
                    "auto",
                    "rendered if it is there, else the mesh if it is there",
                ),
                choice("rendered", "the toolbox's dslr/render_depth, millimetres"),
                choice("mesh", "scans/mesh_aligned_0.05.ply, drawn by us"),
                choice("points", "COLMAP's points that each picture sees: sparse"),
                choice("none", "nowhere"),
            ],
        ),
        Setting::choice(
            "bad",
            "pictures whose pose ScanNet++ calls bad",
            &[choice("drop", "are left out"), proxy("keep", "are used")],
        ),
        Setting::choice(
            "masks",
            "what becomes of anonymised pixels",
            &[
                choice(
                    "apply",
                    "black, without depth, left out of scores by ScanNet++'s own rule",
                ),
                choice("ignore", "as stored"),
            ],
        ),
    ],
    open,
    required_files,
    archives: |photo| vec![format!("scene {}", photo.scene_name())],
};

const MESH: &str = "scans/mesh_aligned_0.05.ply";

fn required_files(photo: &PhotographPath<'_>) -> Vec<RequiredFile> {
    let undistorted = photo.folder.contains("undistorted");
    let (json, masks) = if undistorted {
        ("transforms_undistorted.json", "resized_undistorted_masks")
    } else {
        ("transforms.json", "resized_anon_masks")
    };
    let mut files = vec![RequiredFile::camera(
        photo.above(&format!("nerfstudio/{json}")),
    )];
    if undistorted {
        // Depth is rendered in the fisheye camera.
        let fisheye = photo.above("nerfstudio/transforms.json");
        files.push(RequiredFile::camera(fisheye));
    }
    files.push(RequiredFile::list("splits/nvs_test.txt"));
    let stem = photo.stem;
    files.push(RequiredFile::mask(
        photo.above(&format!("{masks}/{stem}.png")),
    ));
    let rendered = RequiredFile::depth(photo.above(&format!("render_depth/{stem}.png")));
    let scene = photo.up().strip_suffix("/dslr").unwrap_or(photo.up());
    files.push(rendered.or(format!("{scene}/{MESH}")));
    files
}

fn open(spec: &DatasetSpec) -> Result<SceneResults, DatasetError> {
    let root = Root::open(&spec.path)?;
    let data = root.resolve(root.path(), "data")?;
    let data = if data.is_dir() {
        data
    } else {
        root.path().to_owned()
    };
    let split = spec.setting("split");
    let list = root.resolve(root.path(), &format!("splits/{split}.txt"))?;
    let names: Vec<String> = if split == "all" {
        files::list(&data)?.into_iter().map(|e| e.0).collect()
    } else {
        let text = files::read_text(&list)?;
        text.lines()
            .map(|l| l.trim().to_owned())
            .filter(|l| !l.is_empty())
            .collect()
    };
    let cache = ScanCache::default();
    let mut scenes = Vec::new();
    let mut missing = LeftOut::of("scene");
    for name in names {
        // A name that leads out must not hide the other scenes.
        let folders = root
            .resolve_listed(&list, &data, &format!("{name}/dslr"))
            .and_then(|dslr| Ok((root.resolve(&data, &name)?, dslr)));
        match folders {
            Err(error) => scenes.push(Err(error)),
            Ok((scene, dslr)) if dslr.is_dir() => {
                let reader = ScanNetPpReader {
                    spec,
                    root: &root,
                    scene,
                    dslr,
                    cache: &cache,
                };
                scenes.push(reader.read(&name));
            }
            Ok(_) if split == "all" => {}
            Ok(_) => missing.add("the split names scenes that are not there", name),
        }
    }
    let expected = "splits/<split>.txt and data/<scene>/dslr of its scenes, or split=all";
    spec.conclude(scenes, expected, &[&missing])
}

struct ScanNetPpReader<'a> {
    spec: &'a DatasetSpec,
    root: &'a Root,
    scene: PathBuf,
    dslr: PathBuf,
    cache: &'a ScanCache,
}

/// Where a scene's photographs, their masks and their cameras are.
struct DslrPhotographs {
    json: PathBuf,
    file: Transforms,
    images: PathBuf,
    masks: PathBuf,
    /// The folder of pictures that the toolbox undistorted; `None` for the fisheye ones.
    published: Option<String>,
    /// The fisheye cameras, where the pictures are undistorted but depth is not.
    fisheye: Option<Transforms>,
}

impl ScanNetPpReader<'_> {
    fn read(&self, name: &str) -> Result<Scene, DatasetError> {
        let photos = self.photographs()?;
        let depth_from = self.depth_from()?;
        let choice = self.spec.setting("frames");
        let chosen: Vec<&JsonFrame> = [
            (choice != "test", &photos.file.frames),
            (choice != "train", &photos.file.test_frames),
        ]
        .into_iter()
        .filter(|(wanted, _)| *wanted)
        .flat_map(|(_, frames)| frames)
        .collect();
        let mut scene = SceneBuilder::new(self.spec, self.root, &photos.json);
        for frame in chosen {
            let file_name = &frame.file_path;
            if frame.is_bad && self.spec.setting("bad") == "drop" {
                scene.leave_out("ScanNet++ calls the pose bad", file_name);
                continue;
            }
            let image = scene.finder.picture(&photos.images, file_name)?;
            let pose = frame.world_from_camera.as_ref().ok();
            let Some((image, pose)) = scene.usable(file_name, image, pose) else {
                continue;
            };
            let in_json = |error| DatasetError::format(&photos.json, error);
            let size = match frame.size().map_err(in_json)? {
                Some(size) => size,
                None => picture::dimensions(&image)?,
            };
            let lens = frame.lens(size).map_err(in_json)?;
            let id = frame_id(file_name);
            let png = format!("{id}.png");
            let mask = if self.spec.setting("masks") == "apply" {
                let file = scene.finder.find(&photos.masks, &png, &["png"])?;
                file.map(|file| MaskFile { file })
            } else {
                None
            };
            let depth = match &depth_from {
                DepthFrom::None => None,
                DepthFrom::Mesh(scan) => Some(ViewDepth::Scan(scan.clone())),
                DepthFrom::Points(tracks, ids) => {
                    let image = ids.iter().find(|(name, _)| *name == id);
                    image.map(|(_, image)| tracks.depth_of(*image))
                }
                DepthFrom::Rendered(folder) => match scene.finder.find(folder, &png, &["png"])? {
                    Some(map) => Some(rendered_depth(map, &photos, &id, lens)?),
                    None => None,
                },
            };
            scene.add(PosedFrame {
                id,
                image,
                lens,
                pinhole: Pinhole::LikeScanNetPp,
                camera_from_world: undo_colmap_axes(pose).inverse(),
                mask,
                depth,
                cameras: vec![photos.json.clone()],
            })?;
        }
        if let Some(published) = &photos.published {
            let note = format!("pictures: {published}, undistorted by the toolbox");
            scene.notes.push(note);
        }
        if let Some(note) = depth_from.note(scene.has_depth(), self.spec.setting("depth")) {
            scene.notes.push(format!("depth: {note}"));
        }
        if self.spec.setting("masks") == "apply" && !scene.has_masks() {
            let folder = photos.masks.file_name().unwrap_or_default();
            let note = format!("masks: none in dslr/{}", folder.display());
            scene.notes.push(note);
        }
        Ok(scene.finish(name.to_owned()))
    }

    fn photographs(&self) -> Result<DslrPhotographs, DatasetError> {
        let inside = |name: &str| self.root.resolve(&self.dslr, name);
        // The toolbox's own default differs from the published folder's name.
        let first = |names: [&str; 2]| -> Result<PathBuf, DatasetError> {
            let [published, default] = [inside(names[0])?, inside(names[1])?];
            Ok(if published.is_dir() {
                published
            } else {
                default
            })
        };
        let fisheye_json = inside("nerfstudio/transforms.json")?;
        let pinhole_json = inside("nerfstudio/transforms_undistorted.json")?;
        let undistorted = first(["resized_undistorted_images", "undistorted_images"])?;
        let use_undistorted = match self.spec.setting("images") {
            "fisheye" => false,
            "undistorted" => true,
            _ => undistorted.is_dir() && pinhole_json.is_file(),
        };
        if use_undistorted {
            let fisheye = fisheye_json
                .is_file()
                .then(|| files::parse_text(&fisheye_json, transforms::parse));
            let folder = undistorted.file_name().unwrap_or_default();
            Ok(DslrPhotographs {
                published: Some(format!("dslr/{}", folder.display())),
                file: files::parse_text(&pinhole_json, transforms::parse)?,
                json: pinhole_json,
                images: undistorted,
                masks: first(["resized_undistorted_masks", "undistorted_anon_masks"])?,
                fisheye: fisheye.transpose()?,
            })
        } else {
            Ok(DslrPhotographs {
                file: files::parse_text(&fisheye_json, transforms::parse)?,
                json: fisheye_json,
                images: inside("resized_images")?,
                masks: inside("resized_anon_masks")?,
                published: None,
                fisheye: None,
            })
        }
    }

    fn depth_from(&self) -> Result<DepthFrom, DatasetError> {
        let rendered = self.root.resolve(&self.dslr, "render_depth")?;
        let mesh = self.root.resolve(&self.scene, MESH)?;
        let (has_rendered, has_mesh) = (rendered.is_dir(), mesh.is_file());
        let mesh = ScanFile {
            file: mesh,
            cache: self.cache.clone(),
            splat_radius: 0,
        };
        Ok(match self.spec.setting("depth") {
            "auto" | "rendered" if has_rendered => DepthFrom::Rendered(rendered),
            "auto" if has_mesh => DepthFrom::Mesh(mesh),
            "mesh" => DepthFrom::Mesh(mesh),
            "points" => {
                let folder = self.root.resolve(&self.dslr, "colmap")?;
                let model = colmap::read_model_in(self.root, &folder)?;
                let images = model.images.into_iter();
                let ids = images.map(|image| (frame_id(&image.name), image.id));
                DepthFrom::Points(PointTracks::read(&folder, 1.0)?, ids.collect())
            }
            _ => DepthFrom::None,
        })
    }
}

/// A map that the toolbox rendered in the fisheye camera.
fn rendered_depth(
    map: PathBuf,
    photos: &DslrPhotographs,
    id: &str,
    lens: Lens,
) -> Result<ViewDepth, DatasetError> {
    let millimetres = DepthEncoding::Units(0.001);
    if !lens.is_pinhole() {
        return Ok(ViewDepth::Map(map, millimetres));
    }
    let lacks = |what: &str| {
        DatasetError::malformed(&map, format!("nerfstudio/transforms.json lacks {what}"))
    };
    let frame = photos
        .fisheye
        .iter()
        .flat_map(|f| f.frames.iter().chain(&f.test_frames))
        .find(|f| frame_id(&f.file_path) == id)
        .ok_or_else(|| lacks("this picture's fisheye camera"))?;
    let size = frame.size().ok().flatten();
    let size = size.ok_or_else(|| lacks("the pictures' size"))?;
    let fisheye = frame.lens(size);
    let fisheye = fisheye.map_err(|error| DatasetError::format(&map, error))?;
    Ok(ViewDepth::MapOf(map, millimetres, fisheye))
}

enum DepthFrom {
    None,
    Rendered(PathBuf),
    Mesh(ScanFile),
    /// With the ids of the model's images by their names.
    Points(PointTracks, Vec<(String, u32)>),
}

impl DepthFrom {
    /// What was read under a value of the setting `depth`, or why nothing was.
    fn note(&self, has_depth: bool, setting: &str) -> Option<&'static str> {
        Some(match (self, setting) {
            (Self::Rendered(_), _) if has_depth => "dslr/render_depth, rendered by the toolbox",
            (Self::Rendered(_), _) => "none, no map of these pictures in dslr/render_depth",
            (Self::Mesh(_), _) => "scans/mesh_aligned_0.05.ply, drawn by us",
            (Self::Points(..), _) => "COLMAP's points that each picture sees",
            (Self::None, "none") => return None,
            (Self::None, "rendered") => "none, there is no dslr/render_depth",
            (Self::None, _) => {
                "neither dslr/render_depth nor scans/mesh_aligned_0.05.ply, so the views have no \
                 depth; depth=points takes COLMAP's points"
            }
        })
    }
}
