//! Exports the pairs of a list as folders: `OUT/<pair_id>/{source.png, pair.json}`, optionally with
//! `target.png` and depth.
//!
//! `pair.json` is written last. It contains the names and SHA-256 of the pair's files, and a hash
//! of everything that determines the files. A later export can therefore complete missing pairs and
//! replace pairs whose dataset changed.

use std::collections::{BTreeMap, BTreeSet};
use std::io::ErrorKind;
use std::path::Path;

use rayon::prelude::*;
use serde::Serialize;
use sharp_datasets::View;
use sharp_datasets::format::npy;

use super::ExportError;
use super::file::{Hashes, Stamp, write};
use crate::io::atomic_files::{FileError, write_json};
use crate::io::hash::sha256_hex;
use crate::io::observer::Observer;
use crate::io::rendering_files::encode_png;
use crate::io::view_hashes::ViewHashes;
use crate::pairs::description::{FORMAT, PairDescription};
use crate::pairs::pair_id::path_of;
use crate::pairs::pair_list::ResolvedPair;

/// Options of an export: which files to write besides the source's picture and the cameras, how the datasets were read, and
/// factors for the cameras' translation.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct ExportOptions {
    /// Write `target.png`, the ground truth.
    pub target: bool,
    /// Write `source_depth.npy` and `target_depth.npy`, float32 metres; skipped for views without depth.
    pub depth: bool,
    /// The settings with which each dataset was read, keyed by dataset name. Settings affect depth;
    /// if a setting changes, the pairs are exported again.
    pub readings: BTreeMap<String, String>,
    /// Factors for the cameras' translation, each with the folder name for the predictions made with these cameras.
    pub scales: Vec<(String, f64)>,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct Exported {
    pub written: usize,
    pub kept: usize,
    /// Number of views whose depth was requested but that have none.
    pub without_depth: usize,
}

#[derive(Serialize)]
struct PairFile {
    #[serde(flatten)]
    description: PairDescription,
    #[serde(flatten)]
    stamp: Stamp,
}

/// Writes the pairs, grouped by source so that each source picture is read once.
///
/// # Errors
/// Fails at the first file that cannot be read or written; files already written are kept and reused next time.
pub fn export(
    pairs: &[ResolvedPair],
    out: &Path,
    options: &ExportOptions,
    observer: &dyn Observer,
) -> Result<Exported, ExportError> {
    let hashes = ViewHashes::default();
    let same_source = |a: &ResolvedPair, b: &ResolvedPair| {
        std::ptr::eq(a.scene, b.scene) && a.source.id == b.source.id
    };
    let groups: Vec<&[ResolvedPair]> = pairs.chunk_by(same_source).collect();
    observer.begin("exporting", pairs.len(), "pairs");
    let done: Result<Vec<ExportedGroup>, ExportError> = groups
        .into_par_iter()
        .map(|group| export_group(group, out, options, &hashes, observer))
        .collect();
    observer.end();
    let done = done?;
    let without_depth: BTreeSet<&String> = done.iter().flat_map(|g| &g.without_depth).collect();
    Ok(Exported {
        written: done.iter().map(|group| group.written).sum(),
        kept: done.iter().map(|group| group.kept).sum(),
        without_depth: without_depth.len(),
    })
}

/// Counts for the pairs of one source.
#[derive(Default)]
struct ExportedGroup {
    written: usize,
    kept: usize,
    /// `dataset/scene/view` of views without the requested depth.
    without_depth: BTreeSet<String>,
}

fn export_group(
    group: &[ResolvedPair],
    out: &Path,
    options: &ExportOptions,
    hashes: &ViewHashes,
    observer: &dyn Observer,
) -> Result<ExportedGroup, ExportError> {
    let mut exported = ExportedGroup::default();
    let (mut picture, mut depth) = (None, None);
    for pair in group {
        observer.step();
        let folder = out.join(path_of(&pair.pair.pair_id));
        let key = key(pair, options, hashes)?;
        let mut lacks_depth = |view: &View| {
            let scene = pair.scene;
            let name = format!("{}/{}/{}", scene.dataset, scene.id, view.id);
            exported.without_depth.insert(name);
        };
        if Stamp::is_done(&folder, "pair.json", &key) {
            for (view, file) in depth_files(pair, options) {
                if !folder.join(file).exists() {
                    lacks_depth(view);
                }
            }
            exported.kept += 1;
            continue;
        }
        let mut files = Hashes::new();
        let source = match &mut picture {
            Some(source) => source,
            none => none.insert(png(pair.source, &folder)?),
        };
        write(&folder, "source.png", source, &mut files)?;
        if options.target {
            let target = png(pair.target, &folder)?;
            write(&folder, "target.png", &target, &mut files)?;
        }
        for (view, file) in depth_files(pair, options) {
            let of_target;
            let bytes = match &mut depth {
                _ if !std::ptr::eq(view, pair.source) => {
                    of_target = depth_of(view)?;
                    &of_target
                }
                Some(of_source) => of_source,
                none => none.insert(depth_of(view)?),
            };
            match bytes {
                Some(bytes) => write(&folder, file, bytes, &mut files)?,
                None => lacks_depth(view),
            }
        }
        for name in ["target.png", "source_depth.npy", "target_depth.npy"] {
            if !files.contains_key(name) {
                remove(&folder.join(name))?;
            }
        }
        let (source, target) = (pair.source.into(), pair.target.into());
        let file = PairFile {
            description: PairDescription::new(&pair.pair.pair_id, &source, &target)
                .with_scales(&options.scales),
            stamp: Stamp { key, files },
        };
        write_json(&folder.join("pair.json"), &file)?;
        exported.written += 1;
    }
    Ok(exported)
}

pub(super) fn png(view: &View, path: &Path) -> Result<Vec<u8>, ExportError> {
    Ok(encode_png(&view.content.image()?, path)?)
}

/// The views whose depth is requested, with the names of the depth files.
fn depth_files<'a>(
    pair: &ResolvedPair<'a>,
    options: &ExportOptions,
) -> Vec<(&'a View, &'static str)> {
    if !options.depth {
        return Vec::new();
    }
    vec![
        (pair.source, "source_depth.npy"),
        (pair.target, "target_depth.npy"),
    ]
}

fn depth_of(view: &View) -> Result<Option<Vec<u8>>, ExportError> {
    Ok(view.content.depth()?.map(|depth| npy::to_bytes(&depth)))
}

/// Removes a file left by an earlier export.
fn remove(path: &Path) -> Result<(), ExportError> {
    match std::fs::remove_file(path) {
        Err(error) if error.kind() != ErrorKind::NotFound => {
            Err(FileError::new(path, "remove")(error).into())
        }
        _ => Ok(()),
    }
}

fn key(
    pair: &ResolvedPair,
    options: &ExportOptions,
    hashes: &ViewHashes,
) -> Result<String, ExportError> {
    let names = pair.pair;
    let readings = options.readings.get(&names.dataset);
    let text = format!(
        "pair {FORMAT} {} {} {:?} {}\n{}\n{}\n{}\n",
        options.target,
        options.depth,
        options.scales,
        names.pair_id,
        readings.map_or("", String::as_str),
        hashes.view(pair.source)?,
        hashes.view(pair.target)?,
    );
    Ok(sha256_hex(text.as_bytes()))
}
