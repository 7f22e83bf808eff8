//! The pairs of a list as folders: `OUT/<pair_id>/{source.png, pair.json}`, on request `target.png` and depth.
//!
//! `pair.json` is written last and holds the sha256 of its files and of what they were made from: an export that was
//! stopped goes on where it was, one whose dataset changed is made anew.

use std::collections::BTreeMap;
use std::path::Path;

use rayon::prelude::*;
use serde::Serialize;
use sharp_datasets::format::npy;
use sharp_datasets::{Scene, View};

use super::ExportError;
use super::description::{FORMAT, PairDescription};
use super::file::{Hashes, Stamp, write, write_json};
use crate::durable::sha256_hex;
use crate::protocol::pair_list::ResolvedPair;
use crate::render_file::encode_png;
use crate::view_hashes::ViewHashes;

/// What is written besides the source's picture and the cameras, and how the datasets were read.
#[derive(Debug, Clone, PartialEq, Eq, Default)]
pub struct ExportOptions {
    /// `target.png`: the ground truth.
    pub target: bool,
    /// `source_depth.npy` and `target_depth.npy`, float32 metres.
    pub depth: bool,
    /// By dataset: the settings in force, which decide what depth means. An export under other settings is made anew.
    pub readings: BTreeMap<String, String>,
}

/// What became of an export.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default, Serialize)]
pub struct Exported {
    /// Pairs written.
    pub written: usize,
    /// Pairs that were there already, unchanged.
    pub kept: usize,
}

#[derive(Serialize)]
struct PairFile<'a> {
    #[serde(flatten)]
    description: PairDescription,
    #[serde(flatten)]
    stamp: &'a Stamp,
}

/// Writes the pairs. Those of one source follow each other, so that its picture is read once. `advance` is told after
/// each pair, from several threads.
///
/// # Errors
/// The first file that cannot be read or written; what was written before stays and is kept next time.
pub fn export(
    pairs: &[ResolvedPair],
    out: &Path,
    options: &ExportOptions,
    advance: &(dyn Fn() + Sync),
) -> Result<Exported, ExportError> {
    let hashes = ViewHashes::default();
    let same_source = |a: &ResolvedPair, b: &ResolvedPair| {
        std::ptr::eq(a.scene, b.scene) && a.source.id == b.source.id
    };
    let groups: Vec<&[ResolvedPair]> = pairs.chunk_by(same_source).collect();
    let counts: Result<Vec<Exported>, ExportError> = groups
        .into_par_iter()
        .map(|group| export_group(group, out, options, &hashes, advance))
        .collect();
    Ok(counts?
        .into_iter()
        .fold(Exported::default(), |sum, one| Exported {
            written: sum.written + one.written,
            kept: sum.kept + one.kept,
        }))
}

/// The pairs of one source.
fn export_group(
    group: &[ResolvedPair],
    out: &Path,
    options: &ExportOptions,
    hashes: &ViewHashes,
    advance: &(dyn Fn() + Sync),
) -> Result<Exported, ExportError> {
    let mut exported = Exported::default();
    let (mut picture, mut depth) = (None, None);
    for pair in group {
        let folder = out.join(&pair.pair.pair_id);
        let key = key(pair, options, hashes)?;
        if Stamp::is_done(&folder, "pair.json", &key) {
            exported.kept += 1;
            advance();
            continue;
        }
        let mut files = Hashes::new();
        if picture.is_none() {
            picture = Some(png(pair.source, &folder)?);
        }
        write(
            &folder,
            "source.png",
            picture.as_deref().unwrap_or_default(),
            &mut files,
        )?;
        if options.target {
            write(
                &folder,
                "target.png",
                &png(pair.target, &folder)?,
                &mut files,
            )?;
        }
        if options.depth {
            if depth.is_none() {
                depth = Some(depth_of(pair.scene, pair.source)?);
            }
            let source_depth = depth.as_deref().unwrap_or_default();
            write(&folder, "source_depth.npy", source_depth, &mut files)?;
            let target_depth = depth_of(pair.scene, pair.target)?;
            write(&folder, "target_depth.npy", &target_depth, &mut files)?;
        }
        let names = pair.pair;
        let description = PairDescription::new(
            &names.pair_id,
            &names.dataset,
            &names.scene,
            pair.source,
            pair.target,
        );
        let stamp = Stamp { key, files };
        write_json(
            &folder.join("pair.json"),
            &PairFile {
                description,
                stamp: &stamp,
            },
        )?;
        exported.written += 1;
        advance();
    }
    Ok(exported)
}

/// The picture that is scored, as PNG.
pub(super) fn png(view: &View, path: &Path) -> Result<Vec<u8>, ExportError> {
    Ok(encode_png(&view.content.image()?, path)?)
}

fn depth_of(scene: &Scene, view: &View) -> Result<Vec<u8>, ExportError> {
    let depth = view.content.depth()?.ok_or_else(|| ExportError::NoDepth {
        view: format!("{}/{}/{}", scene.dataset, scene.id, view.id),
    })?;
    Ok(npy::to_bytes(&depth))
}

/// Hash of everything that a pair's files depend on.
fn key(
    pair: &ResolvedPair,
    options: &ExportOptions,
    hashes: &ViewHashes,
) -> Result<String, ExportError> {
    let names = pair.pair;
    let readings = options.readings.get(&names.dataset);
    let text = format!(
        "pair {FORMAT} {} {} {}\n{}\n{}\n{}\n",
        options.target,
        options.depth,
        names.pair_id,
        readings.map_or("", String::as_str),
        hashes.view(pair.source)?,
        hashes.view(pair.target)?,
    );
    Ok(sha256_hex(text.as_bytes()))
}
