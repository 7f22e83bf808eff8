//! Walks the chunks of a PNG file to check that it is complete before anything is decoded.

use std::collections::BTreeMap;
use std::io::{ErrorKind, Read, SeekFrom};

use flate2::Crc;

use super::ReadSeek;

/// Checks every checksum up to the end chunk, and the length of the palette. Bytes after the end chunk are ignored.
///
/// # Errors
/// The reason, if the file ends early, a checksum is wrong, or the palette is not a list of colours.
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
        // A palette consists of RGB triples; the decoder relies on this.
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

/// Text that names the chunks gAMA and cHRM if they contradict sRGB; `None` if they do not, or if a
/// cICP, iCCP or sRGB chunk describes the colours.
pub(super) fn against_srgb(chunks: &BTreeMap<[u8; 4], Vec<u8>>) -> Option<String> {
    const SRGB: [u32; 8] = [
        31_270, 32_900, 64_000, 33_000, 30_000, 60_000, 15_000, 6_000,
    ];
    if [b"cICP", b"iCCP", b"sRGB"]
        .iter()
        .any(|name| chunks.contains_key(*name))
    {
        return None;
    }
    let values = |name| -> Vec<u32> {
        let (words, _) = chunks.get(name).map_or(&[][..], Vec::as_slice).as_chunks();
        words.iter().map(|word| u32::from_be_bytes(*word)).collect()
    };
    // Within 5 %, as in libpng; a gamma of 0 is ignored.
    let gamma = values(b"gAMA").first().copied();
    let gamma = gamma.filter(|gamma| !matches!(gamma, 0 | 43_182..=47_728));
    let gamma = gamma.map(|gamma| format!("gAMA {}", f64::from(gamma) / 1e5));
    let primaries = values(b"cHRM");
    let is_other = primaries.iter().zip(SRGB).any(|(a, b)| a.abs_diff(b) > 500);
    let primaries = (primaries.len() == 8 && is_other).then(|| "cHRM".to_owned());
    let both: Vec<String> = gamma.into_iter().chain(primaries).collect();
    (!both.is_empty()).then(|| both.join(" and "))
}

/// The chunks before the pixels, keyed by name; at most 32 bytes of each. The file is rewound to its start.
///
/// # Errors
/// Any error of the reader. If the file ends early, the chunks before the end are returned.
pub(super) fn before_pixels(
    file: &mut dyn ReadSeek,
) -> std::io::Result<BTreeMap<[u8; 4], Vec<u8>>> {
    file.seek(SeekFrom::Start(8))?;
    let mut found = BTreeMap::new();
    let mut start = [0; 8];
    loop {
        match file.read_exact(&mut start) {
            Err(error) if error.kind() == ErrorKind::UnexpectedEof => break,
            read => read?,
        }
        let [l0, l1, l2, l3, name @ ..] = start;
        if matches!(&name, b"IDAT" | b"IEND") {
            break;
        }
        let length = u32::from_be_bytes([l0, l1, l2, l3]);
        let mut bytes = Vec::new();
        (&mut *file)
            .take(length.min(32).into())
            .read_to_end(&mut bytes)?;
        file.seek_relative(i64::from(length) - bytes.len() as i64 + 4)?;
        found.insert(name, bytes);
    }
    file.rewind()?;
    Ok(found)
}
