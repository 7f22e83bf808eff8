//! Maps of values in any self-describing format.

use std::io::Cursor;
use std::path::Path;

use sharp::camera::{CameraError, Intrinsics};
use sharp::image_file;

use super::{FloatMap, FormatError, depth_png, exr_depth, npy, pfm};
use crate::{DatasetError, files};

/// Reads a map in any self-describing format, detected from the first bytes: PFM, npy, npz, EXR or 16-bit PNG.
///
/// # Errors
/// If the file cannot be read, or has more pixels than a camera may have; names the file and the
/// reason.
pub fn read_map(path: &Path) -> Result<FloatMap, DatasetError> {
    read_map_if(path, &|_| Ok(()))
}

/// Like [`read_map`], but first passes the width and height in the header to `accepts`, because a
/// small compressed file may contain a map that exhausts memory.
///
/// # Errors
/// As for [`read_map`], and any error of `accepts`.
pub(crate) fn read_map_if(
    path: &Path,
    accepts: &dyn Fn((u32, u32)) -> Result<(), DatasetError>,
) -> Result<FloatMap, DatasetError> {
    // The size of an uncompressed map is limited by its file; pixels have at most eight bytes.
    let length = std::fs::metadata(path)
        .map_err(|e| DatasetError::io(path, e))?
        .len();
    if length / 8 > Intrinsics::MAX_PIXELS {
        let reason = format!("is {length} bytes long, more than any map");
        return Err(DatasetError::malformed(path, reason));
    }
    let bytes = files::read(path)?;
    let named = |error| DatasetError::format(path, error);
    if let Some((width, height)) = compressed_size(&bytes).map_err(named)? {
        if u64::from(width) * u64::from(height) > Intrinsics::MAX_PIXELS {
            let source = CameraError::TooLarge { width, height };
            return Err(DatasetError::camera(path, source));
        }
        accepts((width, height))?;
    }
    let map = parse_map(&bytes).map_err(named)?;
    accepts(map.dimensions())?;
    Ok(map)
}

/// Width and height of a compressed map, from its header.
fn compressed_size(bytes: &[u8]) -> Result<Option<(u32, u32)>, FormatError> {
    Ok(if bytes.starts_with(b"PK") {
        Some(npy::archived_size(bytes)?)
    } else if bytes.starts_with(EXR) {
        Some(exr_depth::size(bytes)?)
    } else if bytes.starts_with(b"\x89PNG") {
        Some(image_file::dimensions(&mut Cursor::new(bytes))?)
    } else {
        None
    })
}

const EXR: &[u8] = &[0x76, 0x2F, 0x31, 0x01];

fn parse_map(bytes: &[u8]) -> Result<FloatMap, FormatError> {
    if bytes.starts_with(b"\x93NUMPY") || bytes.starts_with(b"PK") {
        npy::parse(bytes).and_then(npy::NpyArray::into_map)
    } else if bytes.starts_with(EXR) {
        exr_depth::parse(bytes)
    } else if bytes.starts_with(b"Pf") || bytes.starts_with(b"PF") {
        pfm::parse(bytes)
    } else {
        depth_png::parse(bytes)
    }
}

#[cfg(test)]
mod tests {
    use std::io::Write as _;

    use super::*;

    /// Truncation of the array is detected only when the whole archive is unpacked.
    #[test]
    fn an_archived_map_is_judged_by_its_header() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("a.npz");
        let written = |width: u32, height: u32, bytes: usize| {
            let header = format!(
                "{{'descr': '<f4', 'fortran_order': False, 'shape': ({height}, {width}, 1), }}"
            );
            let mut array = b"\x93NUMPY\x01\0".to_vec();
            array.extend((header.len() as u16).to_le_bytes());
            array.extend(header.as_bytes());
            array.resize(array.len() + bytes, 0);
            let mut archive = zip::ZipWriter::new(std::fs::File::create(&path).unwrap());
            let options = zip::write::SimpleFileOptions::default();
            archive.start_file("depth.npy", options).unwrap();
            archive.write_all(&array).unwrap();
            archive.finish().unwrap();
        };
        written(300, 200, 4);
        let expected = |size| match size {
            (300, 200) => Err(DatasetError::malformed("a.npz", "not of that size")),
            other => panic!("{other:?}"),
        };
        let error = read_map_if(&path, &expected).unwrap_err().to_string();
        assert_eq!(error, "a.npz: not of that size");
        let error = read_map(&path).unwrap_err().to_string();
        assert!(error.contains("truncated"), "{error}");
        written(60_000, 20_000, 4);
        let error = read_map(&path).unwrap_err().to_string();
        assert!(
            error.contains("60000x20000") && error.contains("268435456"),
            "{error}"
        );
        written(3, 2, 24);
        assert_eq!(read_map(&path).unwrap().dimensions(), (3, 2));
    }
}
