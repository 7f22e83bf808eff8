//! Walks the marker segments of a JPEG stream to check that the stream is complete.

use std::io::{BufRead, Read};

use super::ReadSeek;

/// Checks that a JPEG stream runs from its start marker to its end marker.
///
/// Only the structure is checked. Segments are skipped by their length, so the end marker of an embedded thumbnail does
/// not count. Entropy-coded data is skipped up to the next marker.
///
/// # Errors
/// The reason, if the stream ends early or a segment is malformed.
pub(super) fn check_complete(bytes: &[u8]) -> Result<(), String> {
    const TRUNCATED: &str = "the JPEG stream ends before its end marker (truncated?)";
    let mut at = 2;
    loop {
        // A marker is FF and a code; the code may be preceded by any number of FF.
        if bytes.get(at).ok_or(TRUNCATED)? != &0xFF {
            return Err(format!("missing JPEG marker at byte {at}"));
        }
        while bytes.get(at).ok_or(TRUNCATED)? == &0xFF {
            at += 1;
        }
        let code = bytes[at];
        at += 1;
        match code {
            0xD9 => return Ok(()),
            // Markers without a payload.
            0x01 | 0xD0..=0xD8 => continue,
            _ => {}
        }
        let length = bytes.get(at..at + 2).ok_or(TRUNCATED)?;
        let length = usize::from(u16::from_be_bytes([length[0], length[1]]));
        if length < 2 {
            return Err(format!(
                "invalid length of a JPEG segment: {length} bytes, at byte {at}"
            ));
        }
        at += length;
        if code == 0xDA {
            at = end_of_scan(bytes, at).ok_or(TRUNCATED)?;
        }
    }
}

/// The segments before the pixels, which contain all header information; shorter if the file ends early or is
/// malformed.
///
/// # Errors
/// Any error of the reader.
pub(super) fn head(file: &mut dyn ReadSeek) -> std::io::Result<Vec<u8>> {
    let mut head = Vec::new();
    let take = |file: &mut dyn BufRead, bytes: u64, head: &mut Vec<u8>| {
        Ok::<_, std::io::Error>(file.take(bytes).read_to_end(head)? as u64 == bytes)
    };
    take(file, 2, &mut head)?;
    while take(file, 4, &mut head)? {
        let [.., 0xFF, code @ 0xC0..=0xFE, l0, l1] = head[..] else {
            // Fill bytes or damage; left to the decoder.
            file.read_to_end(&mut head)?;
            break;
        };
        let length = u64::from(u16::from_be_bytes([l0, l1]));
        if !take(file, length.saturating_sub(2), &mut head)? || code == 0xDA {
            break;
        }
    }
    Ok(head)
}

/// Position of the first marker after entropy-coded data: an FF that is not followed by 00 (a stuffed byte) or a
/// restart marker.
fn end_of_scan(bytes: &[u8], mut at: usize) -> Option<usize> {
    loop {
        at += bytes.get(at..)?.iter().position(|&b| b == 0xFF)?;
        match bytes.get(at + 1)? {
            0x00 | 0xD0..=0xD7 => at += 2,
            0xFF => at += 1,
            _ => return Some(at),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::check_complete;

    const START: &[u8] = &[0xFF, 0xD8];
    const COMMENT_WITH_END_MARKER: &[u8] = &[0xFF, 0xFE, 0, 4, 0xFF, 0xD9];
    const SCAN: &[u8] = &[0xFF, 0xDA, 0, 2, 1, 0xFF, 0, 0xFF, 0xD3, 7];
    const END: &[u8] = &[0xFF, 0xD9];

    #[test]
    fn the_end_marker_must_be_the_streams_own() {
        let whole = [START, COMMENT_WITH_END_MARKER, SCAN, END, b"trailing"].concat();
        assert_eq!(check_complete(&whole), Ok(()));
        for cut in 0..whole.len() - 8 {
            assert!(check_complete(&whole[..cut]).is_err(), "{cut}");
        }
    }

    #[test]
    fn nonsense_is_refused() {
        assert!(check_complete(&[0xFF, 0xD8, 0x00, 0xFF]).is_err());
        assert!(check_complete(&[0xFF, 0xD8, 0xFF, 0xE0, 0, 1]).is_err());
    }
}
