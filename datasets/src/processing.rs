//! Processing steps from files to pixels, with one note per scene for each kind.

use std::collections::BTreeMap;

use sharp::camera::Intrinsics;

use crate::left_out::first_few;
use crate::{Pairing, Scene, View};

/// Processing steps of one view's files.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq)]
pub struct Processing {
    /// How the photograph was resampled; `None` if it is used as stored.
    pub undistorted: Option<Undistorted>,
    /// True if a mask made some pixels black and without depth.
    pub masked: bool,
    /// True if it is known that no file contains the view's depth.
    pub lacks_depth: bool,
    /// True if depth is rendered from a scan at the view's pose, rather than read from a map that belongs to the
    /// picture.
    pub depth_by_pose: bool,
}

/// Conversion of a photograph to a pinhole camera.
#[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord)]
pub struct Undistorted {
    /// COLMAP's name of the lens model.
    pub model: &'static str,
    /// Rule by which the pinhole camera was chosen.
    pub camera: &'static str,
}

/// Number of views without depth.
pub(crate) fn without_depth(views: &[View]) -> usize {
    let lacking = views.iter().filter(|v| v.content.processing().lacks_depth);
    lacking.count()
}

/// Notes on the processing of a scene's pixels, and on views without data that others have; one line each.
pub(crate) fn notes(scene: &Scene) -> Vec<String> {
    let all = scene.views.len();
    let mut notes = Vec::new();
    let mut ways: BTreeMap<Undistorted, Vec<&Intrinsics>> = BTreeMap::new();
    for view in &scene.views {
        if let Some(way) = view.content.processing().undistorted {
            ways.entry(way).or_default().push(&view.intrinsics);
        }
    }
    for (way, cameras) in ways {
        let camera = if cameras.iter().all(|camera| *camera == cameras[0]) {
            let k = cameras[0];
            format!(
                " (fx {:.3}, fy {:.3}, cx {:.3}, cy {:.3}, {}x{})",
                k.fx, k.fy, k.cx, k.cy, k.width, k.height
            )
        } else {
            String::new()
        };
        notes.push(format!(
            "pictures: {} of {all} undistorted by us, bilinearly, from {} to {}{camera}",
            cameras.len(),
            way.model,
            way.camera
        ));
    }
    let masked = scene.views.iter().filter(|v| v.content.processing().masked);
    let masked = masked.count();
    if masked > 0 {
        notes.push(format!(
            "masks: {masked} of {all} pictures have one; what it excludes is black and without depth"
        ));
    }
    let lacking = without_depth(&scene.views);
    if scene.pairing == Pairing::MultiView && (1..all).contains(&lacking) {
        notes.push(format!(
            "depth: {lacking} of {all} pictures have none: {}",
            first_without_depth(&scene.views)
        ));
    }
    notes
}

/// File names of the first pictures without depth.
fn first_without_depth(views: &[View]) -> String {
    let lacking = views.iter().filter(|v| v.content.processing().lacks_depth);
    let names = lacking.map(|view| {
        let file = view.content.image_file().and_then(|path| path.file_name());
        file.map_or(view.id.clone(), |name| name.to_string_lossy().into_owned())
    });
    first_few(&names.collect::<Vec<_>>())
}
