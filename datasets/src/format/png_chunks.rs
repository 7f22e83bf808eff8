//! The chunks of a PNG file, walked to see that it is whole before anything is decoded.

use super::FormatError;
use flate2::Crc;

/// Checks every chunk's checksum up to the end chunk, after which anything may follow, and the length
/// of the palette.
///
/// # Errors
/// When the file ends early, a checksum is wrong, or the palette is not a list of colours.
pub(super) fn check_complete(bytes: &[u8]) -> Result<(), FormatError> {
    const SIGNATURE_LENGTH: usize = 8;
    let mut rest = bytes.get(SIGNATURE_LENGTH..).unwrap_or_default();
    loop {
        let truncated = "the PNG file ends before its end chunk (truncated?)";
        let (length, after) = rest.split_first_chunk::<4>().ok_or(truncated)?;
        let length = u32::from_be_bytes(*length) as usize;
        let (checked, after) = after.split_at_checked(4 + length).ok_or(truncated)?;
        let (stored, after) = after.split_first_chunk::<4>().ok_or(truncated)?;
        let mut crc = Crc::new();
        crc.update(checked);
        let name = String::from_utf8_lossy(&checked[..4]);
        if crc.sum() != u32::from_be_bytes(*stored) {
            return Err(invalid!(
                "the checksum (CRC) of its {name} chunk is wrong: the file is damaged"
            ));
        }
        // A palette is triples; the decoder takes that for granted.
        if name == "PLTE" && (!length.is_multiple_of(3) || !(3..=768).contains(&length)) {
            return Err(invalid!(
                "its palette has {length} bytes, which is not a list of colours"
            ));
        }
        if name == "IEND" {
            return Ok(());
        }
        rest = after;
    }
}
