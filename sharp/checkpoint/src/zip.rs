//! The subset of the zip format that PyTorch writes: stored entries, located through the central
//! directory, with 64-bit sizes if needed.
//!
//! Implemented here because the `zip` crate reads entries as streams, guesses at damaged directories, and silently uses
//! the last of several entries of one name. This implementation rejects every inconsistency.

use std::collections::BTreeMap;
use std::ops::Range;

use crate::bytes::Bytes;
use crate::error::{Fault, malformed};

const END: &[u8] = b"PK\x05\x06";
const END_64: &[u8] = b"PK\x06\x06";
const END_64_LOCATOR: &[u8] = b"PK\x06\x07";
const CENTRAL: &[u8] = b"PK\x01\x02";
const LOCAL: &[u8] = b"PK\x03\x04";
/// Length of an end record without its comment, which may take up to 65 535 more bytes.
const END_LEN: usize = 22;
/// Length of the locator of a ZIP64 end record.
const LOCATOR_LEN: usize = 20;
/// Length of an entry of the central directory without its name, extra fields and comment.
const CENTRAL_LEN: usize = 46;
/// Length of a local file header without its name and extra fields.
const LOCAL_LEN: usize = 30;

/// Location of an entry's data.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(crate) enum ZipEntry {
    /// Uncompressed, at this byte range of the file.
    Stored(Range<usize>),
    /// The data cannot be read, for the given reason.
    Unreadable(String),
}

/// Maps names to the data of their entries.
pub(crate) type Directory = BTreeMap<String, ZipEntry>;

/// Reads a little-endian field of a record whose length was already checked.
fn u16_at(b: &[u8], at: usize) -> u64 {
    u64::from(b[at]) | u64::from(b[at + 1]) << 8
}

fn u32_at(b: &[u8], at: usize) -> u64 {
    u16_at(b, at) | u16_at(b, at + 2) << 16
}

fn u64_at(b: &[u8], at: usize) -> u64 {
    u32_at(b, at) | u32_at(b, at + 4) << 32
}

/// Reads `len` bytes at `start`; errors call the bytes `what`.
fn slice(file: &(impl Bytes + ?Sized), start: u64, len: u64, what: &str) -> Result<Vec<u8>, Fault> {
    let end = start.checked_add(len);
    match end.filter(|&end| end <= file.len() as u64) {
        Some(end) => file.get(start as usize..end as usize),
        None => malformed!("zip: {what} lies outside the file"),
    }
}

/// Reads the central directory and every entry's local header.
pub(crate) fn read(file: &(impl Bytes + ?Sized)) -> Result<Directory, Fault> {
    let (count, size, start) = locate(file)?;
    let directory = slice(file, start, size, "the central directory")?;
    let mut rest = directory.as_slice();
    if count > (rest.len() / CENTRAL_LEN) as u64 {
        return malformed!("zip: the directory of {size} bytes is too small for {count} entries");
    }
    let mut entries = BTreeMap::new();
    for _ in 0..count {
        if rest.len() < CENTRAL_LEN || !rest.starts_with(CENTRAL) {
            return malformed!("zip: the central directory is damaged");
        }
        let (name_len, extra_len, comment_len) = (
            u16_at(rest, 28) as usize,
            u16_at(rest, 30) as usize,
            u16_at(rest, 32) as usize,
        );
        let record_len = CENTRAL_LEN + name_len + extra_len + comment_len;
        let Some(record) = rest.get(..record_len) else {
            return malformed!("zip: the central directory is cut off");
        };
        rest = &rest[record_len..];
        let Ok(name) = std::str::from_utf8(&record[CENTRAL_LEN..CENTRAL_LEN + name_len]) else {
            return malformed!("zip: an entry's name is not UTF-8");
        };
        let extra = &record[CENTRAL_LEN + name_len..][..extra_len];
        let entry = entry(file, record, extra, name)?;
        if entries.insert(name.to_owned(), entry).is_some() {
            return malformed!("zip: two entries are named '{name}'");
        }
    }
    Ok(entries)
}

/// Entry count, size and start of the central directory.
fn locate(file: &(impl Bytes + ?Sized)) -> Result<(u64, u64, u64), Fault> {
    let tail = file.get(file.len().saturating_sub(END_LEN + 0xFFFF + LOCATOR_LEN)..file.len())?;
    let Some(last) = tail.len().checked_sub(END_LEN) else {
        return malformed!("zip: the file is cut off");
    };
    let end = (last.saturating_sub(0xFFFF)..=last).rev().find(|&at| {
        tail[at..].starts_with(END) && at + END_LEN + u16_at(&tail, at + 20) as usize == tail.len()
    });
    let Some(at) = end else {
        return malformed!("zip: no end of the central directory; the file is cut off");
    };
    let end = &tail[at..];
    let (count, size, start) = (u16_at(end, 10), u32_at(end, 12), u32_at(end, 16));
    if count != 0xFFFF && size != 0xFFFF_FFFF && start != 0xFFFF_FFFF {
        return Ok((count, size, start));
    }
    let Some(locator) = at.checked_sub(LOCATOR_LEN).map(|l| &tail[l..at]) else {
        return malformed!("zip: the 64-bit end record is missing");
    };
    if !locator.starts_with(END_64_LOCATOR) {
        // Without a ZIP64 record, the fields are actual values: an archive may hold exactly 65 535 entries.
        return Ok((count, size, start));
    }
    let end = slice(file, u64_at(locator, 8), 56, "the 64-bit end record")?;
    if !end.starts_with(END_64) {
        return malformed!("zip: the 64-bit end record is damaged");
    }
    Ok((u64_at(&end, 32), u64_at(&end, 40), u64_at(&end, 48)))
}

/// Resolves one central record to the byte range of its data.
fn entry(
    file: &(impl Bytes + ?Sized),
    record: &[u8],
    extra: &[u8],
    name: &str,
) -> Result<ZipEntry, Fault> {
    let (flags, method) = (u16_at(record, 8), u16_at(record, 10));
    let mut packed = u32_at(record, 20);
    let mut size = u32_at(record, 24);
    let mut start = u32_at(record, 42);
    // A 32-bit value of all ones means that the actual value is in the 64-bit extra field. That field contains only the
    // values replaced in this way, in the order of this loop.
    let wide = wide_field(extra);
    let mut at = 0;
    for value in [&mut size, &mut packed, &mut start] {
        if *value == 0xFFFF_FFFF {
            let Some(field) = wide.get(at..at + 8) else {
                return malformed!("zip: the 64-bit sizes of '{name}' are missing");
            };
            *value = u64_at(field, 0);
            at += 8;
        }
    }
    if flags & 1 != 0 {
        return Ok(ZipEntry::Unreadable("is encrypted".into()));
    }
    if method != 0 {
        return Ok(ZipEntry::Unreadable(format!(
            "is compressed (method {method}); PyTorch stores entries uncompressed, \
             so the file was repacked; unpack and save it again"
        )));
    }
    if packed != size {
        return malformed!("zip: '{name}' is stored uncompressed, but its two sizes differ");
    }
    let local = slice(file, start, LOCAL_LEN as u64, "a local header")?;
    if !local.starts_with(LOCAL) {
        return malformed!("zip: the local header of '{name}' is damaged");
    }
    let data = start + LOCAL_LEN as u64 + u16_at(&local, 26) + u16_at(&local, 28);
    let end = data.checked_add(size).filter(|&e| e <= file.len() as u64);
    match end {
        Some(end) => Ok(ZipEntry::Stored(data as usize..end as usize)),
        None => malformed!("zip: '{name}' of {size} bytes reaches beyond the end of the file"),
    }
}

/// Payload of the 64-bit extra field; empty if absent.
fn wide_field(mut extra: &[u8]) -> &[u8] {
    while extra.len() >= 4 {
        let (id, len) = (u16_at(extra, 0), u16_at(extra, 2) as usize);
        let Some(payload) = extra.get(4..4 + len) else {
            break;
        };
        if id == 1 {
            return payload;
        }
        extra = &extra[4 + len..];
    }
    &[]
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// Writes stored archives for this crate's tests. `wide` uses 64-bit fields.
    pub(crate) fn archive(entries: &[(&str, &[u8])], wide: bool) -> Vec<u8> {
        let mut out = Vec::new();
        let mut central = Vec::new();
        for (name, data) in entries {
            let start = out.len();
            let (size32, start32) = if wide {
                (u32::MAX, u32::MAX)
            } else {
                (data.len() as u32, start as u32)
            };
            out.extend(LOCAL);
            out.extend([0; 14]);
            out.extend(size32.to_le_bytes());
            out.extend(size32.to_le_bytes());
            out.extend((name.len() as u16).to_le_bytes());
            // Padding in the local header only; PyTorch uses it to align the data.
            out.extend(6_u16.to_le_bytes());
            out.extend(name.as_bytes());
            out.extend(*b"FB\x02\x00ZZ");
            out.extend(*data);
            let mut extra = Vec::new();
            if wide {
                extra.extend([1, 0, 24, 0]);
                extra.extend((data.len() as u64).to_le_bytes());
                extra.extend((data.len() as u64).to_le_bytes());
                extra.extend((start as u64).to_le_bytes());
            }
            central.extend(CENTRAL);
            central.extend([0; 16]);
            central.extend(size32.to_le_bytes());
            central.extend(size32.to_le_bytes());
            central.extend((name.len() as u16).to_le_bytes());
            central.extend((extra.len() as u16).to_le_bytes());
            central.extend([0; 10]);
            central.extend(start32.to_le_bytes());
            central.extend(name.as_bytes());
            central.extend(extra);
        }
        let start = out.len() as u64;
        out.extend(&central);
        let (count, size) = (entries.len() as u64, central.len() as u64);
        if wide {
            let at = out.len() as u64;
            out.extend(END_64);
            out.extend(44_u64.to_le_bytes());
            out.extend([0; 12]);
            for v in [count, count, size, start] {
                out.extend(v.to_le_bytes());
            }
            out.extend(END_64_LOCATOR);
            out.extend([0; 4]);
            out.extend(at.to_le_bytes());
            out.extend([1, 0, 0, 0]);
        }
        out.extend(END);
        out.extend([0; 4]);
        let (count16, size32, start32) = if wide {
            (u16::MAX, u32::MAX, u32::MAX)
        } else {
            (count as u16, size as u32, start as u32)
        };
        out.extend(count16.to_le_bytes());
        out.extend(count16.to_le_bytes());
        out.extend(size32.to_le_bytes());
        out.extend(start32.to_le_bytes());
        out.extend([0, 0]);
        out
    }

    #[test]
    fn stored_entries_are_found_with_narrow_and_wide_fields() {
        for wide in [false, true] {
            let file = archive(&[("a/data.pkl", b"xyz"), ("a/data/0", b"")], wide);
            let found = read(file.as_slice()).unwrap();
            let ZipEntry::Stored(range) = &found["a/data.pkl"] else {
                panic!("stored");
            };
            assert_eq!(&file[range.clone()], b"xyz");
            assert_eq!(found.len(), 2);
        }
    }

    #[test]
    fn compressed_entries_say_so() {
        let mut file = archive(&[("a", b"xyz")], false);
        let at = file.windows(4).position(|w| w == CENTRAL).unwrap();
        file[at + 10] = 8;
        assert!(
            matches!(&read(file.as_slice()).unwrap()["a"], ZipEntry::Unreadable(why) if why.contains("compressed"))
        );
    }

    #[test]
    fn lies_are_refused() {
        let good = archive(&[("a", b"xyz")], false);
        let central = good.windows(4).position(|w| w == CENTRAL).unwrap();
        let end = good.len() - END_LEN;
        let lie = |at: usize, bytes: &[u8]| {
            let mut file = good.clone();
            file[at..at + bytes.len()].copy_from_slice(bytes);
            read(file.as_slice()).is_err()
        };
        assert!(lie(central + 20, &[0xF0; 8]), "sizes");
        assert!(lie(central + 42, &[0xF0; 4]), "local header's place");
        assert!(lie(central + 28, &[0xFF; 2]), "length of the name");
        assert!(lie(end + 10, &[0xF0; 2]), "count");
        assert!(lie(end + 12, &[0xF0; 4]), "directory's size");
        assert!(lie(end + 16, &[0xF0; 4]), "directory's place");
        assert!(lie(0, b"XX"), "local signature");
        assert!(read(archive(&[("a", b"1"), ("a", b"2")], false).as_slice()).is_err());
        for cut in 0..good.len() {
            assert!(read(&good[..cut]).is_err(), "cut at {cut}");
        }
    }
}
