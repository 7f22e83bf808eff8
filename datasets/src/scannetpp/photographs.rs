//! Selection of a scene's photographs, and lookup of the cameras of their depth.

use std::path::{Path, PathBuf};

use crate::DatasetError;
use crate::depth::{DepthEncoding, DepthKind, ViewDepth};
use crate::files::{self, Root};
use crate::format::transforms::{self, Transforms};
use crate::lens::Lens;
use crate::scene_builder::frame_id;

/// Paths of a scene's photographs, masks and cameras.
pub(super) struct DslrPhotographs {
    pub(super) json: PathBuf,
    pub(super) file: Transforms,
    pub(super) images: PathBuf,
    pub(super) masks: PathBuf,
    /// Folder of pictures undistorted by the toolbox; `None` if the fisheye pictures are used.
    pub(super) published: Option<String>,
    /// Fisheye cameras and their file; `None` unless the pictures are undistorted and depth is
    /// in the fisheye geometry.
    pub(super) fisheye: Option<(PathBuf, Transforms)>,
}

impl DslrPhotographs {
    /// Finds the photographs selected by `choice`, a value of the setting `images`. If
    /// `depth_in_fisheye`, undistorted pictures require the fisheye cameras as well.
    ///
    /// # Errors
    /// Names the file that is broken or missing, with a remedy.
    pub(super) fn find(
        root: &Root,
        dslr: &Path,
        choice: &str,
        depth_in_fisheye: bool,
    ) -> Result<Self, DatasetError> {
        let inside = |name: &str| root.resolve(dslr, name);
        // The toolbox's default name differs from that of the published folder.
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
        let use_undistorted = match choice {
            "fisheye" => false,
            "undistorted" => true,
            _ => undistorted.is_dir() && pinhole_json.is_file(),
        };
        let missing = |json: &Path, remedy: &str| {
            let reason = format!("does not exist; {remedy}");
            DatasetError::malformed(json, reason)
        };
        if use_undistorted {
            if !pinhole_json.is_file() {
                let remedy = "it comes with the toolbox's undistorted pictures; images=fisheye \
                              reads the original pictures with nerfstudio/transforms.json";
                return Err(missing(&pinhole_json, remedy));
            }
            let fisheye = if depth_in_fisheye {
                if !fisheye_json.is_file() {
                    let remedy = "dslr/render_depth was rendered with the cameras in this file; add it from the \
                                  download's nerfstudio/, or set depth=mesh, depth=points or depth=none";
                    return Err(missing(&fisheye_json, remedy));
                }
                let parsed = files::parse_text(&fisheye_json, transforms::parse)?;
                Some((fisheye_json, parsed))
            } else {
                None
            };
            let folder = undistorted.file_name().unwrap_or_default();
            Ok(Self {
                published: Some(format!("dslr/{}", folder.display())),
                file: files::parse_text(&pinhole_json, transforms::parse)?,
                json: pinhole_json,
                images: undistorted,
                masks: first(["resized_undistorted_masks", "undistorted_anon_masks"])?,
                fisheye,
            })
        } else {
            if !fisheye_json.is_file() {
                let remedy = "it contains the cameras of the fisheye pictures; add it from the download's nerfstudio/, \
                              or add the toolbox's undistorted pictures with nerfstudio/transforms_undistorted.json, \
                              which do not need it";
                return Err(missing(&fisheye_json, remedy));
            }
            Ok(Self {
                file: files::parse_text(&fisheye_json, transforms::parse)?,
                json: fisheye_json,
                images: inside("resized_images")?,
                masks: inside("resized_anon_masks")?,
                published: None,
                fisheye: None,
            })
        }
    }

    /// Depth map rendered by the toolbox with the fisheye camera.
    ///
    /// # Errors
    /// If the picture's fisheye camera is missing.
    pub(super) fn rendered_depth(
        &self,
        map: PathBuf,
        id: &str,
        lens: Lens,
    ) -> Result<ViewDepth, DatasetError> {
        let millimetres = DepthEncoding::Units(0.001, DepthKind::Z);
        if !lens.is_pinhole() {
            return Ok(ViewDepth::Map(map, millimetres));
        }
        let lacks = |what: &str| {
            DatasetError::malformed(
                &map,
                format!("nerfstudio/transforms.json does not contain {what}"),
            )
        };
        let frame = self
            .fisheye
            .iter()
            .flat_map(|(_, f)| f.frames.iter().chain(&f.test_frames))
            .find(|f| frame_id(&f.file_path) == id)
            .ok_or_else(|| lacks("this picture's fisheye camera"))?;
        let size = frame.size().ok().flatten();
        let size = size.ok_or_else(|| lacks("the pictures' size"))?;
        let fisheye = frame.lens(size);
        let fisheye = fisheye.map_err(|error| DatasetError::format(&map, error))?;
        Ok(ViewDepth::MapOf(map, millimetres, fisheye))
    }
}
