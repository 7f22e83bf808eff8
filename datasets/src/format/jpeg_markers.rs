//! The marker segments of a JPEG stream, walked to see that it ends where it should.

use super::FormatError;

/// Checks that a JPEG stream runs from its start marker to its end marker.
///
/// Only the structure is looked at: segments are skipped by their length (so the end marker of an
/// embedded thumbnail does not count), entropy-coded data is passed over to the next marker.
///
/// # Errors
/// When the stream ends early or a segment is malformed.
pub(super) fn check_complete(bytes: &[u8]) -> Result<(), FormatError> {
    const TRUNCATED: &str = "the JPEG stream ends before its end marker (truncated?)";
    let mut at = 2;
    loop {
        // A marker is FF and a code; any number of FF may come before the code.
        if bytes.get(at).ok_or(TRUNCATED)? != &0xFF {
            return Err(invalid!("no JPEG marker where one is due, at byte {at}"));
        }
        while bytes.get(at).ok_or(TRUNCATED)? == &0xFF {
            at += 1;
        }
        let code = bytes[at];
        at += 1;
        match code {
            0xD9 => return Ok(()),
            // Without a payload.
            0x01 | 0xD0..=0xD8 => continue,
            _ => {}
        }
        let length = bytes.get(at..at + 2).ok_or(TRUNCATED)?;
        let length = usize::from(u16::from_be_bytes([length[0], length[1]]));
        if length < 2 {
            return Err(invalid!("a JPEG segment of {length} bytes, at byte {at}"));
        }
        at += length;
        if code == 0xDA {
            at = end_of_scan(bytes, at).ok_or(TRUNCATED)?;
        }
    }
}

/// The position of the first marker after entropy-coded data: an FF that is not followed by 00 (a
/// stuffed byte) or a restart marker.
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
