//! Bare little-endian f32 values, row by row from the top: ETH3D's depth maps, which have the photograph's name
//! (`.JPG`) but are not JPEG. Their size is known only from the camera.

use std::io::Read;

use super::{FloatMap, FormatError, is_byte_swapped};

/// Reads `width · height` values; gzip-compressed files are decompressed. +inf means no depth.
///
/// # Errors
/// If the data does not have exactly that length, or only makes sense in the other byte order.
pub fn parse(bytes: &[u8], (width, height): (u32, u32)) -> Result<FloatMap, FormatError> {
    let expected = u64::from(width) * u64::from(height) * 4;
    let mut unpacked = Vec::new();
    let bytes = if bytes.starts_with(&[0x1F, 0x8B]) && bytes.len() as u64 != expected {
        flate2::read::GzDecoder::new(bytes)
            .take(expected + 1)
            .read_to_end(&mut unpacked)
            .map_err(|e| invalid!("cannot be unpacked: {e}"))?;
        &unpacked
    } else {
        bytes
    };
    if bytes.len() as u64 != expected {
        return Err(invalid!(
            "has {} bytes, but the depth of a {width}x{height} picture takes exactly {expected}",
            bytes.len()
        ));
    }
    let values: Vec<f32> = bytes
        .chunks_exact(4)
        .map(|b| f32::from_le_bytes([b[0], b[1], b[2], b[3]]))
        .collect();
    if is_byte_swapped(&values) {
        return Err("its values are sensible only as big-endian; write them little-endian".into());
    }
    FloatMap::from_vec(width, height, values).ok_or_else(|| "the size overflows".into())
}
