//! Gaussian scenes from files of any format that is read, told apart by content: PLY, PlayCanvas' compressed PLY,
//! SPZ 1 to 4, SOG 1 and 2 (archive or folder), and .splat, which has no mark but its name.
//!
//! A reader's memory stays within a multiple of the file, whatever its header claims.

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

/// Topic of the [`Suspicion`] that a file does not tell its axes.
pub const AXES: &str = "axes";

/// Turns Gaussians from axes that are OpenCV's but for these signs, which settles the doubt about a file's axes.
///
/// # Errors
/// That doubt, where no signs are given.
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

/// Most bytes or pixels that a byte of a file may unfold to. Real files stay below 20.
const MOST_EXPANSION: usize = 256;

/// Advice for converting another format.
const CONVERT: &str = "convert it with `npx @playcanvas/splat-transform IN OUT.ply`";

/// Reads a scene from a file, or from a folder that holds a SOG's `meta.json`. `reading` is how numbers are read where
/// that is not as the format stores them, how colours are encoded where the file does not say, and what they are
/// blended in.
///
/// # Errors
/// [`PlyError`] with the path and the reason; [`PlyReason::Foreign`] for a format that is known and not read.
pub fn load(path: &Path, reading: impl Into<StoredForm>) -> Result<GaussianScene, PlyError> {
    let given = reading.into();
    let name = path.file_name().unwrap_or_default().to_string_lossy();
    let read = || match () {
        () if path.is_dir() && !path.join("meta.json").is_file() => Err(PlyReason::Foreign(
            "a folder, without the meta.json that an unpacked SOG has".to_owned(),
        )),
        () if path.is_dir() => sog::from_folder(path)?.scene(&given),
        () if name.eq_ignore_ascii_case("meta.json") => {
            sog::from_folder(path.parent().unwrap_or(path))?.scene(&given)
        }
        () => from_bytes(&crate::files::read(path)?, &name, given),
    };
    read().map_err(|reason| PlyError::new(path, reason))
}

/// Like [`load`], from the bytes of a file of this name.
///
/// # Errors
/// [`PlyReason`].
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

/// Names a format that is not read, by its first bytes and its name, with advice.
pub fn foreign_format(bytes: &[u8], name: &str) -> Option<String> {
    let name = name.to_ascii_lowercase();
    let is = |end: &str| name.ends_with(end);
    let format = match bytes {
        [b'g', b'l', b'T', b'F', ..] => "glTF",
        _ if is(".glb") || is(".gltf") => "glTF",
        _ if is(".ksplat") => "KSPLAT",
        _ if is("lod-meta.json") => "streamed SOG",
        _ if is(".npz") || is(".npy") => {
            return Some("NumPy arrays, which are not read".to_owned());
        }
        _ => return None,
    };
    Some(format!("{format}, which is not read; {CONVERT}"))
}

/// Why a packed stream cannot be read, in words that do not depend on who unpacks it.
fn unfolding(error: &std::io::Error) -> String {
    let why = match error.kind() {
        std::io::ErrorKind::UnexpectedEof => "it ends early: truncated?",
        _ => "its bytes are damaged",
    };
    format!("it cannot be unpacked ({why})")
}

/// Reads as many bytes as are expected, of a stream that `packed` bytes of the file hold.
fn unfold(stream: impl Read, expected: usize, packed: usize) -> Result<Vec<u8>, String> {
    if expected / MOST_EXPANSION > packed {
        return Err(format!(
            "its header asks for {expected} bytes, which {packed} cannot hold"
        ));
    }
    let mut bytes = Vec::new();
    stream
        .take(expected as u64)
        .read_to_end(&mut bytes)
        .map_err(|error| unfolding(&error))?;
    match bytes.len() == expected {
        true => Ok(bytes),
        false => Err(format!(
            "it ends after {} of {expected} bytes (truncated?)",
            bytes.len()
        )),
    }
}

#[cfg(test)]
mod tests;
