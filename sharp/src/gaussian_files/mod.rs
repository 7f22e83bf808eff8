//! Reading of Gaussian scenes in any supported format: PLY, PlayCanvas' compressed PLY, SPZ 1 to 4, SOG 1 and 2
//! (archive or folder), and .splat. Formats are detected from the content, except .splat, which is recognised by its
//! name only.
//!
//! A reader's memory is bounded by a multiple of the file's size, whatever its header claims.

mod rule;
mod sog;
mod splat;
mod spz;

use std::io::Read;
use std::path::Path;

use crate::gaussians::Gaussians;
use crate::ply::table::TableError;
use crate::ply::{self, GaussianScene, PlyError, PlyReason, StoredForm, Suspicion};

pub use rule::MarkedRule;
pub use spz::{LARGEST_SPZ_SCALE, to_bytes as to_spz_bytes};

/// Topic of the [`Suspicion`] that a file does not state its axes.
pub const AXES: &str = "axes";

/// Flips the axes of Gaussians by the given signs to obtain OpenCV axes, and removes the [`Suspicion`] that the file
/// does not state its axes.
///
/// # Errors
/// The suspicion's text, if there is such a suspicion and `signs` is `None`.
pub fn turn(
    gaussians: &mut Gaussians,
    doubts: &mut Vec<Suspicion>,
    signs: Option<[f32; 3]>,
) -> Result<(), String> {
    let is_of_axes = |doubt: &Suspicion| doubt.about == AXES;
    match (signs, doubts.iter().position(is_of_axes)) {
        (None, Some(at)) => return Err(doubts[at].text.clone()),
        (Some(signs), _) => *gaussians = std::mem::take(gaussians).flipped(signs),
        (None, None) => {}
    }
    doubts.retain(|doubt| !is_of_axes(doubt));
    Ok(())
}

/// Maximum number of bytes or pixels that one byte of a file may decompress to. Real files stay below 20.
const MAX_EXPANSION: usize = 256;

/// Advice on converting unsupported formats.
const CONVERT: &str = "convert it with `npx @playcanvas/splat-transform IN OUT.ply`";

/// Reads a scene from a file, or from a folder that contains a SOG's `meta.json`. `reading`
/// overrides the format's own number encodings. `reading` also sets the blending colour space, and
/// the colour encoding of files that do not state one.
///
/// # Errors
/// [`PlyError`] with the path and the reason; [`PlyReason::Foreign`] for a recognised but unsupported format.
pub fn load(path: &Path, reading: impl Into<StoredForm>) -> Result<GaussianScene, PlyError> {
    let given = reading.into();
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let read = || match () {
        () if path.is_dir() && !path.join("meta.json").is_file() => Err(PlyReason::Foreign(
            "a folder without meta.json, so not an unpacked SOG".to_owned(),
        )),
        () if path.is_dir() => sog::from_folder(path)?.scene(&given),
        () if name.eq_ignore_ascii_case("meta.json") => {
            sog::from_folder(path.parent().unwrap_or(path))?.scene(&given)
        }
        () => from_bytes(&crate::files::read(path)?, &name, given),
    };
    read().map_err(|reason| PlyError::new(path, reason))
}

/// Like [`load`], for the bytes of a file called `name`.
///
/// # Errors
/// [`PlyReason`] says why the bytes cannot be read; it does not name the file.
pub fn from_bytes(
    bytes: &[u8],
    name: &str,
    reading: impl Into<StoredForm>,
) -> Result<GaussianScene, PlyReason> {
    let given = reading.into();
    let name = name.to_ascii_lowercase();
    match bytes {
        [] => Err(PlyReason::Empty),
        [b'N', b'G', b'S', b'P', ..] | [0x1f, 0x8b, ..] => spz::decode(bytes)?.scene(&given),
        [b'P', b'K', ..] if !name.ends_with(".npz") => sog::from_archive(bytes)?.scene(&given),
        _ if name.ends_with(".splat") && !bytes.starts_with(b"ply") => {
            splat::decode(bytes)?.scene(&given)
        }
        _ => match ply::from_bytes(bytes, given) {
            Err(PlyReason::Table(TableError::NotPly)) => {
                Err(foreign_format(bytes, &name).map_or(PlyReason::Unknown, PlyReason::Foreign))
            }
            read => read,
        },
    }
}

/// Recognises an unsupported format by a file's first bytes and name; returns the format's name
/// with advice.
pub fn foreign_format(bytes: &[u8], name: &str) -> Option<String> {
    let name = name.to_ascii_lowercase();
    let is = |end: &str| name.ends_with(end);
    let format = match bytes {
        [0xef, 0xbb, 0xbf, ..] => {
            let mark =
                "text with a byte order mark, which a text editor added; write the file again";
            return Some(mark.to_owned());
        }
        [b'g', b'l', b'T', b'F', ..] => "glTF",
        _ if is(".glb") || is(".gltf") => "glTF",
        _ if is(".ksplat") => "KSPLAT",
        _ if is("lod-meta.json") => "streamed SOG",
        _ if is(".npz") || is(".npy") => {
            return Some("NumPy arrays, which are not supported".to_owned());
        }
        _ => return None,
    };
    Some(format!("{format}, which is not supported; {CONVERT}"))
}

/// Says why a compressed stream cannot be read, in words that do not depend on the decompressor.
fn unfolding(error: &std::io::Error) -> String {
    let why = match error.kind() {
        std::io::ErrorKind::UnexpectedEof => "it ends early: truncated?",
        _ => "its bytes are damaged",
    };
    format!("it cannot be unpacked ({why})")
}

/// Decompresses exactly `expected` bytes from a stream that takes `packed` bytes in the file.
fn unfold(stream: impl Read, expected: usize, packed: usize) -> Result<Vec<u8>, String> {
    if expected / MAX_EXPANSION > packed {
        return Err(format!(
            "its header claims {expected} bytes, which {packed} compressed bytes cannot hold"
        ));
    }
    let mut bytes = Vec::new();
    stream
        .take(expected as u64)
        .read_to_end(&mut bytes)
        .map_err(|error| unfolding(&error))?;
    if bytes.len() == expected {
        Ok(bytes)
    } else {
        Err(format!(
            "it ends after {} of {expected} bytes (truncated?)",
            bytes.len()
        ))
    }
}

#[cfg(test)]
mod tests;
