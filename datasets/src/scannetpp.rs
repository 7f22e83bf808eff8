//! ScanNet++, DSLR pictures (v1 and v2).
//!
//! `data/<scene>/dslr/` holds fisheye pictures in `resized_images`, their cameras in
//! `nerfstudio/transforms.json` and, if the toolbox was run, undistorted pictures with
//! `nerfstudio/transforms_undistorted.json`. Poses went through COLMAP's change of world axes on
//! their way into the JSON; it is undone, so that the views share the world of `scans/`. Metres.

use std::path::PathBuf;
use std::sync::Arc;

use crate::colmap::Tracks;
use crate::depth::{Encoding, Resampling, StoredDepth};
use crate::files::{self, Root};
use crate::finder::Finder;
use crate::format::transforms::{self, Frame, Transforms, undo_colmap_axes};
use crate::format::{colmap, picture};
use crate::lens::Lens;
use crate::mask::Mask;
use crate::posed::{self, Depth, Pinhole, Posed, frame_id};
use crate::scan::{Scan, ScanCache};
use crate::skipped::Skipped;
use crate::spec::{Attempts, Choice, DatasetSpec, Format, Setting, conclude};
use crate::undistort::Undistortion;
use crate::{DatasetError, Pairing, Scene, View, processing};

/// The catalogue's entry.
pub(crate) const FORMAT: Format = Format {
    name: "scannetpp",
    summary: "ScanNet++ (v1, v2) DSLR: splits/<split>.txt and data/<scene>/dslr",
    settings: &[
        Setting::named(
            "split",
            "a list in splits/, or every scene",
            &[
                Choice::new(
                    "nvs_test",
                    "the one the paper names: it has neither mesh nor test pictures, so that \
                     frames=train and depth=points are what is left of it",
                ),
                Choice::proxy("nvs_sem_val", "has meshes and test pictures"),
                Choice::proxy("nvs_test_small", "twelve scenes of nvs_test"),
                Choice::proxy("all", "every scene that is there"),
            ],
        ),
        Setting::choice(
            "frames",
            "which pictures of a scene",
            &[
                Choice::new("train", "'frames': all that is there of nvs_test"),
                Choice::new("test", "'test_frames'"),
                Choice::new("all", "both"),
            ],
        ),
        Setting::choice(
            "images",
            "which photographs",
            &[
                Choice::new("auto", "undistorted if they are there, else fisheye"),
                Choice::new("undistorted", "as the toolbox undistorts them"),
                Choice::new(
                    "fisheye",
                    "as taken, undistorted by us to the toolbox's camera",
                ),
            ],
        ),
        Setting::choice(
            "depth",
            "where depth comes from",
            &[
                Choice::new(
                    "auto",
                    "rendered if it is there, else the mesh if it is there",
                ),
                Choice::new("rendered", "the toolbox's dslr/render_depth, millimetres"),
                Choice::new("mesh", "scans/mesh_aligned_0.05.ply, drawn by us"),
                Choice::proxy("points", "COLMAP's points that each picture sees: sparse"),
                Choice::new("none", "nowhere"),
            ],
        ),
        Setting::choice(
            "bad",
            "pictures whose pose ScanNet++ calls bad",
            &[
                Choice::new("drop", "are left out"),
                Choice::proxy("keep", "are used"),
            ],
        ),
        Setting::choice(
            "masks",
            "what becomes of anonymised pixels",
            &[
                Choice::new(
                    "apply",
                    "black, without depth, left out of scores by ScanNet++'s own rule",
                ),
                Choice::new("ignore", "as stored"),
            ],
        ),
    ],
    open,
};

fn open(spec: &DatasetSpec) -> Result<Attempts, DatasetError> {
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
    let mut missing = Skipped::of("scene");
    for name in names {
        // A name that leads out must not hide the other scenes.
        let folders = root
            .resolve_listed(&list, &data, &format!("{name}/dslr"))
            .and_then(|dslr| Ok((root.resolve(&data, &name)?, dslr)));
        match folders {
            Err(error) => scenes.push(Err(error)),
            Ok((scene, dslr)) if dslr.is_dir() => {
                let reader = Reader {
                    spec,
                    root: &root,
                    scene,
                    dslr,
                    cache: &cache,
                };
                scenes.push(reader.read(&name));
            }
            Ok(_) if split == "all" => {}
            Ok(_) => missing.add("the split names scenes that are not there", &name),
        }
    }
    let expected = "splits/<split>.txt and data/<scene>/dslr of its scenes, or split=all";
    conclude(spec, scenes, expected, &[&missing])
}

struct Reader<'a> {
    spec: &'a DatasetSpec,
    root: &'a Root,
    scene: PathBuf,
    dslr: PathBuf,
    cache: &'a ScanCache,
}

/// The pictures of a scene: where they, their masks and their cameras are.
struct Pictures {
    json: PathBuf,
    file: Transforms,
    images: PathBuf,
    masks: PathBuf,
    /// The folder of pictures that the toolbox undistorted; `None` for the fisheye ones.
    published: Option<String>,
    /// The fisheye cameras, where the pictures are undistorted but depth is not.
    fisheye: Option<Transforms>,
}

impl Reader<'_> {
    fn read(&self, name: &str) -> Result<Scene, DatasetError> {
        let pictures = self.pictures()?;
        let source = self.depth_source()?;
        let mut notes = Vec::new();
        if let Some(published) = &pictures.published {
            notes.push(format!("pictures: {published}, undistorted by the toolbox"));
        }
        let choice = self.spec.setting("frames");
        let chosen: Vec<&Frame> = [
            (choice != "test", &pictures.file.frames),
            (choice != "train", &pictures.file.test_frames),
        ]
        .into_iter()
        .filter(|(wanted, _)| *wanted)
        .flat_map(|(_, frames)| frames)
        .collect();
        let mut finder = Finder::new(self.root, &pictures.json);
        let mut skipped = Skipped::default();
        let mut views = Vec::new();
        for frame in chosen {
            let file_name = &frame.file_path;
            if frame.is_bad && self.spec.setting("bad") == "drop" {
                skipped.add("ScanNet++ calls the pose bad", file_name);
                continue;
            }
            let Ok(pose) = &frame.world_from_camera else {
                skipped.add("the pose is not finite or not rigid", file_name);
                continue;
            };
            let Some(image) = finder.picture(&pictures.images, file_name)? else {
                skipped.add("the picture does not exist", file_name);
                continue;
            };
            let size = match frame.size() {
                Ok(Some(size)) => size,
                Ok(None) => picture::dimensions(&image)?,
                Err(reason) => return Err(DatasetError::malformed(&pictures.json, reason)),
            };
            let lens = frame
                .lens(size)
                .map_err(|reason| DatasetError::malformed(&pictures.json, reason))?;
            let id = frame_id(file_name);
            let mask = if self.spec.setting("masks") == "apply" {
                finder
                    .find(&pictures.masks, &format!("{id}.png"), &["png"])?
                    .map(|file| Mask { file })
            } else {
                None
            };
            let depth = self.depth(&source, &pictures, &id, lens, &mut finder)?;
            views.push(
                Posed {
                    id,
                    image,
                    lens,
                    pinhole: Pinhole::LikeScanNetPp,
                    camera_from_world: undo_colmap_axes(pose).inverse(),
                    mask,
                    depth,
                    cameras: vec![pictures.json.clone()],
                }
                .into_view()?,
            );
        }
        posed::finish(&mut views);
        let has_depth = processing::without_depth(&views) < views.len();
        if let Some(said) = source.said(has_depth, self.spec.setting("depth")) {
            notes.push(format!("depth: {said}"));
        }
        let masked = |view: &View| view.content.processing().masked;
        if self.spec.setting("masks") == "apply" && !views.iter().any(masked) {
            let folder = pictures.masks.file_name().unwrap_or_default();
            notes.push(format!("masks: none in dslr/{}", folder.display()));
        }
        notes.extend(skipped.notes(&pictures.json));
        notes.extend(finder.notes());
        Ok(Scene {
            dataset: self.spec.name.clone(),
            id: name.to_owned(),
            cluster: name.to_owned(),
            views,
            pairing: Pairing::MultiView,
            notes,
        })
    }

    fn pictures(&self) -> Result<Pictures, DatasetError> {
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
                .then(|| transforms::read(&fisheye_json));
            let folder = undistorted.file_name().unwrap_or_default();
            Ok(Pictures {
                published: Some(format!("dslr/{}", folder.display())),
                file: transforms::read(&pinhole_json)?,
                json: pinhole_json,
                images: undistorted,
                masks: first(["resized_undistorted_masks", "undistorted_anon_masks"])?,
                fisheye: fisheye.transpose()?,
            })
        } else {
            Ok(Pictures {
                file: transforms::read(&fisheye_json)?,
                json: fisheye_json,
                images: inside("resized_images")?,
                masks: inside("resized_anon_masks")?,
                published: None,
                fisheye: None,
            })
        }
    }

    fn depth_source(&self) -> Result<Source, DatasetError> {
        let rendered = self.root.resolve(&self.dslr, "render_depth")?;
        let mesh = self
            .root
            .resolve(&self.scene, "scans/mesh_aligned_0.05.ply")?;
        let scan = Scan {
            file: mesh.clone(),
            cache: self.cache.clone(),
            splat_radius: 0,
        };
        Ok(match self.spec.setting("depth") {
            "rendered" if rendered.is_dir() => Source::Rendered(rendered),
            "mesh" => Source::Mesh(scan),
            "points" => {
                let folder = self.root.resolve(&self.dslr, "colmap")?;
                colmap::check_inside(self.root, &folder)?;
                let ids = colmap::read_model(&folder)?
                    .images
                    .into_iter()
                    .map(|image| (frame_id(&image.name), image.id))
                    .collect();
                Source::Points(Tracks::read(&folder, 1.0)?, ids)
            }
            "auto" if rendered.is_dir() => Source::Rendered(rendered),
            "auto" if mesh.is_file() => Source::Mesh(scan),
            _ => Source::None,
        })
    }

    fn depth(
        &self,
        source: &Source,
        pictures: &Pictures,
        id: &str,
        lens: Lens,
        finder: &mut Finder<'_>,
    ) -> Result<Depth, DatasetError> {
        let rendered = match source {
            Source::None => return Ok(Depth::None),
            Source::Mesh(scan) => return Ok(Depth::Scan(scan.clone())),
            Source::Points(tracks, ids) => {
                let image = ids.iter().find(|(name, _)| name == id);
                return Ok(image.map_or(Depth::None, |(_, image)| tracks.of(*image)));
            }
            Source::Rendered(folder) => finder.find(folder, &format!("{id}.png"), &["png"])?,
        };
        let Some(map) = rendered else {
            return Ok(Depth::None);
        };
        let millimetres = Encoding::Units(0.001);
        if !lens.is_pinhole() {
            return Ok(Depth::Map(map, millimetres, Resampling::Nearest));
        }
        // Rendered in the fisheye camera, needed in the pinhole one.
        let malformed = |reason: &str| DatasetError::malformed(&map, reason.to_owned());
        let frame = pictures
            .fisheye
            .iter()
            .flat_map(|f| f.frames.iter().chain(&f.test_frames))
            .find(|f| frame_id(&f.file_path) == id)
            .ok_or_else(|| {
                malformed("nerfstudio/transforms.json lacks this picture's fisheye camera")
            })?;
        let size = frame
            .size()
            .ok()
            .flatten()
            .ok_or_else(|| malformed("nerfstudio/transforms.json lacks the pictures' size"))?;
        let fisheye = frame.lens(size).map_err(|reason| malformed(&reason))?;
        let undistortion = Undistortion::new(fisheye, lens.intrinsics());
        Ok(Depth::Ready(Arc::new(StoredDepth {
            file: map,
            encoding: millimetres,
            size,
            undistortion: Some((undistortion, Resampling::Nearest)),
        })))
    }
}

enum Source {
    None,
    Rendered(PathBuf),
    Mesh(Scan),
    Points(Tracks, Vec<(String, u32)>),
}

impl Source {
    /// What was read under a value of the setting `depth`, or why nothing was.
    fn said(&self, has_depth: bool, setting: &str) -> Option<&'static str> {
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
