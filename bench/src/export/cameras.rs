//! Exports every view of some scenes as `OUT/<dataset>/<scene>/<view>.{png,json}`, with names
//! percent-encoded as in pair ids.
//!
//! Meant as input for tools that process single views: that predict depth for `--overlap-depth`, reconstruct a scene,
//! or fit Gaussians.

use std::path::Path;

use rayon::prelude::*;
use serde::Serialize;
use sharp_datasets::{Scene, View};

use super::ExportError;
use super::camera_file::CameraFile;
use super::file::{Hashes, Stamp, write};
use super::pairs::{Exported, png};
use crate::io::atomic_files::write_json;
use crate::io::hash::sha256_hex;
use crate::io::observer::Observer;
use crate::io::view_hashes::ViewHashes;
use crate::pairs::description::conventions;
use crate::pairs::pair_id::{scene_path, view_name};

/// A view's camera, with the same keys as `render --camera`.
#[derive(Serialize)]
struct CameraDescription<'a> {
    dataset: &'a str,
    scene: &'a str,
    view: &'a str,
    #[serde(flatten)]
    camera: CameraFile,
    conventions: std::collections::BTreeMap<&'static str, &'static str>,
    #[serde(flatten)]
    stamp: Stamp,
}

/// Writes the pictures and cameras of all views.
///
/// # Errors
/// Fails at the first file that cannot be read or written; files already written are kept and reused next time.
pub fn export(
    scenes: &[Scene],
    out: &Path,
    observer: &dyn Observer,
) -> Result<Exported, ExportError> {
    let views: Vec<(&Scene, &View)> = scenes
        .iter()
        .flat_map(|scene| scene.views.iter().map(move |view| (scene, view)))
        .collect();
    let hashes = ViewHashes::default();
    observer.begin("exporting", views.len(), "views");
    let written: Result<Vec<bool>, ExportError> = views
        .into_par_iter()
        .map(|(scene, view)| {
            let written = export_view(scene, view, out, &hashes)?;
            observer.step();
            Ok(written)
        })
        .collect();
    observer.end();
    let written = written?;
    let fresh = written.iter().filter(|w| **w).count();
    Ok(Exported {
        written: fresh,
        kept: written.len() - fresh,
        ..Exported::default()
    })
}

/// Exports one view. Returns false if the exported files already existed.
fn export_view(
    scene: &Scene,
    view: &View,
    out: &Path,
    hashes: &ViewHashes,
) -> Result<bool, ExportError> {
    let folder = out.join(scene_path(&scene.dataset, &scene.id));
    let name = view_name(&view.id);
    let description = format!("{name}.json");
    let key = sha256_hex(format!("view {} {}", view.id, hashes.view(view)?).as_bytes());
    if Stamp::is_done(&folder, &description, &key) {
        return Ok(false);
    }
    let mut files = Hashes::new();
    let picture = png(view, &folder)?;
    write(&folder, &format!("{name}.png"), &picture, &mut files)?;
    write_json(
        &folder.join(&description),
        &CameraDescription {
            dataset: &scene.dataset,
            scene: &scene.id,
            view: &view.id,
            camera: CameraFile::of(&view.intrinsics, &view.camera_from_world.to_affine()),
            conventions: conventions(),
            stamp: Stamp { key, files },
        },
    )?;
    Ok(true)
}
