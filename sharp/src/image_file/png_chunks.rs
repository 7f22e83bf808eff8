//! The chunks of a PNG file, walked to see that it is whole before anything is decoded.

use std::io::{BufRead, ErrorKind, Read, Seek, SeekFrom};

use flate2::Crc;

/// Checks every checksum up to the end chunk, and the length of the palette. Bytes after the end
/// chunk are ignored.
///
/// # Errors
/// The reason, when the file ends early, a checksum is wrong, or the palette is not a list of colours.
pub(super) fn check_complete(bytes: &[u8]) -> Result<(), String> {
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
            return Err(format!(
                "the checksum (CRC) of its {name} chunk is wrong: the file is damaged"
            ));
        }
        // A palette is triples; the decoder takes that for granted.
        if name == "PLTE" && (!length.is_multiple_of(3) || !(3..=768).contains(&length)) {
            return Err(format!(
                "its palette has {length} bytes, which is not a list of colours"
            ));
        }
        if name == "IEND" {
            return Ok(());
        }
        rest = after;
    }
}

/// The four bytes of the cICP chunk: primaries, transfer, matrix, range. It comes before the pixels; the file is left at
/// its start.
///
/// # Errors
/// The reader's; a file that ends early has none.
pub(super) fn cicp(file: &mut (impl BufRead + Seek)) -> std::io::Result<Option<[u8; 4]>> {
    file.seek(SeekFrom::Start(8))?;
    let mut found = None;
    let mut start = [0; 8];
    loop {
        match file.read_exact(&mut start) {
            Err(error) if error.kind() == ErrorKind::UnexpectedEof => break,
            read => read?,
        }
        let [l0, l1, l2, l3, name @ ..] = start;
        match &name {
            b"IDAT" | b"IEND" => break,
            b"cICP" => {
                let mut bytes = Vec::with_capacity(4);
                file.by_ref().take(4).read_to_end(&mut bytes)?;
                found = bytes.first_chunk().copied();
                break;
            }
            _ => file.seek_relative(i64::from(u32::from_be_bytes([l0, l1, l2, l3])) + 4)?,
        }
    }
    file.rewind()?;
    Ok(found)
}
