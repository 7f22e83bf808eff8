//! A posed photograph in a file, with its lens, as a view: what every multi-view reader produces.

use std::path::PathBuf;
use std::sync::Arc;

use glam::DVec3;
use sharp::camera::RigidTransform;

use crate::content::FileContent;
use crate::depth::{DepthSource, Encoding, MaskedDepth, Resampling, StoredDepth};
use crate::lens::Lens;
use crate::mask::Mask;
use crate::scan::{PointDepth, Scan, ScanDepth};
use crate::undistort::Undistortion;
use crate::{DatasetError, View, natural};

/// Which pinhole camera a picture with lens distortion is resampled to.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum Pinhole {
    /// The widest that shows nothing beyond the stored picture.
    WithoutBlankPixels,
    /// The one ScanNet++'s toolbox uses.
    LikeScanNetPp,
}

/// What a reader knows about one photograph.
#[derive(Debug)]
pub(crate) struct Posed {
    pub(crate) id: String,
    pub(crate) image: PathBuf,
    pub(crate) lens: Lens,
    pub(crate) pinhole: Pinhole,
    pub(crate) camera_from_world: RigidTransform,
    pub(crate) mask: Option<Mask>,
    pub(crate) depth: Depth,
    pub(crate) cameras: Vec<PathBuf>,
}

/// Where its depth comes from.
#[derive(Debug)]
pub(crate) enum Depth {
    None,
    /// A map in the geometry of the stored picture.
    Map(PathBuf, Encoding, Resampling),
    /// In the geometry of the view's pinhole camera.
    Ready(Arc<dyn DepthSource>),
    /// A laser scan or mesh in world coordinates.
    Scan(Scan),
    /// Points in world coordinates that this view sees, and the file they are from.
    Points(PathBuf, Vec<DVec3>),
}

impl Posed {
    /// The view, resampled to a pinhole camera if the lens asks for it.
    ///
    /// # Errors
    /// Names the picture, when its lens cannot be resampled to a pinhole.
    pub(crate) fn into_view(self) -> Result<View, DatasetError> {
        let undistortion = if self.lens.is_pinhole() {
            None
        } else {
            let made = match self.pinhole {
                Pinhole::WithoutBlankPixels => Undistortion::without_blank_pixels(self.lens),
                Pinhole::LikeScanNetPp => Undistortion::like_scannetpp(self.lens),
            };
            Some(made.map_err(|reason| DatasetError::malformed(&self.image, reason))?)
        };
        let stored = self.lens.intrinsics();
        let intrinsics = undistortion.map_or(stored, |u| *u.pinhole());
        let size = (stored.width, stored.height);
        let depth = match self.depth {
            Depth::None => None,
            Depth::Map(file, encoding, resampling) => Some(Arc::new(StoredDepth {
                file,
                encoding,
                size,
                undistortion: undistortion.map(|u| (u, resampling)),
            }) as Arc<dyn DepthSource>),
            Depth::Ready(source) => Some(source),
            Depth::Scan(scan) => Some(Arc::new(ScanDepth {
                scan,
                pinhole: intrinsics,
                camera_from_world: self.camera_from_world,
            }) as Arc<dyn DepthSource>),
            Depth::Points(file, points) => Some(Arc::new(PointDepth {
                file,
                points,
                pinhole: intrinsics,
                camera_from_world: self.camera_from_world,
            }) as Arc<dyn DepthSource>),
        };
        let depth = match (depth, &self.mask) {
            (Some(depth), Some(mask)) => Some(Arc::new(MaskedDepth {
                depth,
                mask: mask.clone(),
                size,
                undistortion,
            }) as Arc<dyn DepthSource>),
            (depth, _) => depth,
        };
        Ok(View {
            id: self.id,
            intrinsics,
            camera_from_world: self.camera_from_world,
            content: Arc::new(FileContent {
                image: self.image,
                size,
                mask: self.mask,
                undistortion,
                depth,
                cameras: self.cameras,
            }),
        })
    }
}

/// Sorts views naturally and shortens their ids by the folders they all share.
pub(crate) fn finish(views: &mut [View]) {
    let shared = views
        .iter()
        .map(|v| v.id.rsplit_once('/').map_or("", |(folder, _)| folder))
        .reduce(common_folders)
        .unwrap_or("")
        .len();
    for view in views.iter_mut() {
        let id = view.id[shared..].trim_start_matches('/').to_owned();
        view.id = id;
    }
    views.sort_by(|a, b| natural::compare(&a.id, &b.id));
}

/// The leading path components that two folders share.
fn common_folders<'a>(a: &'a str, b: &str) -> &'a str {
    let mut length = 0;
    for (i, (x, y)) in a.split('/').zip(b.split('/')).enumerate() {
        if x != y {
            break;
        }
        length += x.len() + usize::from(i > 0);
    }
    &a[..length]
}

/// A picture's name without its extension, `./` and with `/` between folders.
pub(crate) fn frame_id(name: &str) -> String {
    let name = name.replace('\\', "/");
    let name = name.trim_start_matches("./");
    match name.rsplit_once('.') {
        Some((stem, extension)) if is_picture_extension(extension) => stem.to_owned(),
        _ => name.to_owned(),
    }
}

pub(crate) fn is_picture_extension(extension: &str) -> bool {
    matches!(
        extension.to_ascii_lowercase().as_str(),
        "png" | "jpg" | "jpeg"
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shared_folders_are_counted_by_component() {
        assert_eq!(common_folders("images/left", "images/left_2"), "images");
        assert_eq!(common_folders("images", "images"), "images");
        assert_eq!(common_folders("", "images"), "");
        assert_eq!(common_folders("a/b/c", "a/b"), "a/b");
    }
}
