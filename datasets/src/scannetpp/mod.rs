//! ScanNet++, DSLR pictures (v1 and v2).
//!
//! `data/<scene>/dslr/` contains fisheye pictures in `resized_images`, their cameras in
//! `nerfstudio/transforms.json` and, if the toolbox was run, undistorted pictures with
//! `nerfstudio/transforms_undistorted.json`. COLMAP's change of world axes was applied to the poses
//! in the JSON; that change is undone here, so that the views share the coordinate system of
//! `scans/`. Units are metres.

mod photographs;

use std::path::PathBuf;

use crate::colmap::PointTracks;
use crate::depth::ViewDepth;
use crate::files::{self, Root};
use crate::format::transforms::{JsonFrame, undo_colmap_axes};
use crate::format::{colmap, picture};
use crate::found_scenes::FoundScenes;
use crate::mask::{Keep, MaskFile};
use crate::required_files::{PhotographPath, RequiredFile};
use crate::scan_depth::{ScanCache, ScanFile};
use crate::scene_builder::{Pinhole, PosedFrame, SceneBuilder, frame_id, no_pose};
use crate::setting::{Setting, choice, proxy};
use crate::spec::PaperOverlap;
use crate::{DatasetEntry, DatasetError, DatasetSpec, Scene};
use photographs::DslrPhotographs;

pub(crate) static ENTRY: DatasetEntry = DatasetEntry {
    format: "scannetpp",
    display_name: "ScanNet++",
    title: "ScanNet++ (v1, v2), DSLR pictures",
    page: "https://kaldir.vc.in.tum.de/scannetpp/",
    terms: "non-commercial research after application; no redistribution",
    may_publish: false,
    download: "DSLR pictures, nerfstudio/ cameras, splits/, and scans/ for depth",
    size: "371 GB of DSLR pictures for all 1,006 scenes of v2",
    layout: "splits/<split>.txt, data/<scene>/dslr/{resized_images, nerfstudio/transforms.json}, \
             data/<scene>/scans/mesh_aligned_0.05.ply",
    paper_column: "ScanNet++",
    paper_overlap: PaperOverlap::Dense,
    caveat: "the paper says 'nvs test split', which may mean the list nvs_test, whose meshes and \
             test pictures are withheld, or the test pictures of other scenes",
    settings: &[
        Setting::named(
            "split",
            "which scenes: those of a list in splits/, or all",
            &[
                choice(
                    "nvs_test",
                    "one interpretation of the paper's 'nvs test'; its scenes have neither mesh nor test pictures, \
                     so only frames=train and depth=points are possible",
                ),
                choice(
                    "nvs_sem_val",
                    "has meshes and test pictures; with frames=test, another interpretation of 'nvs test'",
                ),
                proxy("nvs_test_small", "twelve scenes of nvs_test"),
                choice("all", "every scene found; with frames=test, a third interpretation of 'nvs test'"),
            ],
        ).left_open(),
        Setting::choice(
            "frames",
            "which pictures of a scene",
            &[
                choice("train", "the pictures in 'frames' (for nvs_test, only these are available)"),
                choice("test", "the pictures in 'test_frames'"),
                choice("all", "both"),
            ],
        ).left_open(),
        Setting::choice(
            "images",
            "which form of the photographs",
            &[
                choice("auto", "undistorted if available, else fisheye"),
                choice("undistorted", "as the toolbox undistorts them"),
                choice(
                    "fisheye",
                    "as taken, undistorted by sharp-bench to the toolbox's camera",
                ),
            ],
        ).left_open(),
        Setting::choice(
            "depth",
            "source of depth",
            &[
                choice(
                    "auto",
                    "rendered if available, else mesh if available",
                ),
                choice("rendered", "the toolbox's dslr/render_depth, millimetres"),
                choice("mesh", "scans/mesh_aligned_0.05.ply, rendered by sharp-bench"),
                choice("points", "COLMAP's points that each picture sees (sparse)"),
                choice("none", "no depth"),
            ],
        ).left_open(),
        Setting::choice(
            "bad",
            "what to do with pictures whose pose ScanNet++ flags as bad",
            &[choice("drop", "leave them out"), proxy("keep", "use them")],
        ),
        Setting::choice(
            "masks",
            "what to do with anonymised pixels",
            &[
                choice(
                    "apply",
                    "make them black, remove their depth and exclude them from scores (ScanNet++'s own rule)",
                ),
                choice("ignore", "use them as stored"),
            ],
        ).left_open(),
    ],
    poses_are_matrices: false,
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
    let scene = photo.up().strip_suffix("/dslr").unwrap_or(photo.up());
    let mesh = || format!("{scene}/{MESH}");
    let mut files = vec![RequiredFile::camera(
        photo.above(&format!("nerfstudio/{json}")),
    )];
    if undistorted {
        // Depth maps are rendered with the fisheye camera; depth from a mesh does not need that
        // camera.
        let fisheye = RequiredFile::depth(photo.above("nerfstudio/transforms.json"));
        files.push(fisheye.or(mesh()));
    }
    files.push(RequiredFile::list("splits/nvs_test.txt"));
    let stem = photo.stem;
    files.push(RequiredFile::mask(
        photo.above(&format!("{masks}/{stem}.png")),
    ));
    let rendered = RequiredFile::depth(photo.above(&format!("render_depth/{stem}.png")));
    files.push(rendered.or(mesh()));
    files
}

fn open(spec: &DatasetSpec) -> Result<FoundScenes, DatasetError> {
    let root = Root::open(&spec.path)?;
    let data = root.resolve(root.path(), "data")?;
    let data = if data.is_dir() {
        data
    } else {
        root.path().to_owned()
    };
    let split = spec.setting("split");
    let list = root.resolve(root.path(), &format!("splits/{split}.txt"))?;
    let others = ["splits", "metadata"].map(|name| root.path().join(name));
    let there = files::list(&data)?.into_iter();
    let there = there.filter(|(_, path)| path.is_dir() && !others.contains(path));
    let there: Vec<String> = there.map(|(name, _)| name).collect();
    let names: Vec<String> = if split == "all" {
        there.clone()
    } else {
        let text = files::read_text(&list)?;
        let lines = text.lines().map(str::trim).filter(|line| !line.is_empty());
        lines.map(str::to_owned).collect()
    };
    let cache = ScanCache::default();
    let mut found = FoundScenes::default();
    for name in &names {
        // A name that points outside the folder must not prevent reading the other scenes.
        let scene = root.resolve_listed(&list, &data, &format!("{name}/dslr"));
        let scene = scene.and_then(|dslr| {
            let scene = root.resolve(&data, name)?;
            if !scene.is_dir() {
                return Err(DatasetError::malformed(
                    &list,
                    "lists scenes that do not exist",
                ));
            }
            if !dslr.is_dir() {
                return Err(DatasetError::malformed(
                    &data,
                    "there is no dslr/ in scenes",
                ));
            }
            let reader = ScanNetPpReader {
                spec,
                root: &root,
                scene,
                dslr,
                cache: &cache,
            };
            reader.read(name)
        });
        found.add(name, scene);
    }
    for name in there.iter().filter(|name| !names.contains(name)) {
        found.rule_out(name, format!("split={split} does not list them"));
    }
    let expected = "splits/<split>.txt and data/<scene>/dslr of its scenes, or split=all";
    spec.conclude(found, expected, Vec::new())
}

struct ScanNetPpReader<'a> {
    spec: &'a DatasetSpec,
    root: &'a Root,
    scene: PathBuf,
    dslr: PathBuf,
    cache: &'a ScanCache,
}

impl ScanNetPpReader<'_> {
    fn read(&self, name: &str) -> Result<Scene, DatasetError> {
        let depth_from = self.depth_from()?;
        let is_rendered = matches!(depth_from, DepthFrom::Rendered(_));
        let choice = self.spec.setting("images");
        let photos = DslrPhotographs::find(self.root, &self.dslr, choice, is_rendered)?;
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
                scene.leave_out("ScanNet++ marks the pose as bad", file_name);
                continue;
            }
            let image = scene.finder.picture(&photos.images, file_name)?;
            let pose = frame.world_from_camera.as_ref().map_err(no_pose);
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
                file.map(|file| MaskFile {
                    // Only 255 counts as valid, as in the official toolkit.
                    white: 255,
                    file,
                    keep: Keep::White,
                })
            } else {
                None
            };
            let mut cameras = vec![photos.json.clone()];
            let depth = match &depth_from {
                DepthFrom::None => None,
                DepthFrom::Mesh(scan) => Some(ViewDepth::Scan(scan.clone())),
                DepthFrom::Points(tracks, ids) => {
                    let image = ids.iter().find(|(name, _)| *name == id);
                    image.map(|(_, image)| tracks.depth_of(*image))
                }
                DepthFrom::Rendered(folder) => match scene.finder.find(folder, &png, &["png"])? {
                    Some(map) => {
                        cameras.extend(photos.fisheye.iter().map(|(json, _)| json.clone()));
                        Some(photos.rendered_depth(map, &id, lens)?)
                    }
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
                cameras,
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
        let hint = match choice {
            "all" => String::new(),
            other => format!("; only the pictures of frames={other} are read"),
        };
        scene.finish_with_views(name.to_owned(), &hint)
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

enum DepthFrom {
    None,
    Rendered(PathBuf),
    Mesh(ScanFile),
    /// Points, and for each frame id the id of the image in the model.
    Points(PointTracks, Vec<(String, u32)>),
}

impl DepthFrom {
    /// Describes the depth that was read with the setting `depth`, or why none was read.
    fn note(&self, has_depth: bool, setting: &str) -> Option<&'static str> {
        Some(match (self, setting) {
            (Self::Rendered(_), _) if has_depth => "dslr/render_depth, rendered by the toolbox",
            (Self::Rendered(_), _) => {
                "none, because dslr/render_depth has no map of these pictures"
            }
            (Self::Mesh(_), _) => "scans/mesh_aligned_0.05.ply, rendered by sharp-bench",
            (Self::Points(..), _) => "COLMAP's points that each picture sees",
            (Self::None, "none") => return None,
            (Self::None, "rendered") => "none, because there is no dslr/render_depth",
            (Self::None, _) => {
                "there is neither dslr/render_depth nor scans/mesh_aligned_0.05.ply, so the views have \
                 no depth; depth=points would read COLMAP's points"
            }
        })
    }
}
