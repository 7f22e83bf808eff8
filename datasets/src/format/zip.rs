//! As much of ZIP as `.npz` needs: the central directory, stored and deflated members.

use std::io::Read;

use flate2::Crc;
use flate2::read::DeflateDecoder;

/// A member of an archive.
#[derive(Debug, Clone)]
pub(super) struct Entry {
    pub(super) name: String,
    method: u16,
    crc: u32,
    packed: usize,
    unpacked: usize,
    header_at: usize,
}

/// An archive in memory.
#[derive(Debug)]
pub(super) struct Archive<'a> {
    bytes: &'a [u8],
    entries: Vec<Entry>,
}

impl<'a> Archive<'a> {
    /// Reads the central directory.
    pub(super) fn open(bytes: &'a [u8]) -> Result<Self, String> {
        const END: &[u8] = b"PK\x05\x06";
        const END_LENGTH: usize = 22;
        let start = bytes.len().saturating_sub(END_LENGTH + 0xFFFF);
        let end = bytes[start..]
            .windows(4)
            .rposition(|w| w == END)
            .map(|i| &bytes[start + i..])
            .filter(|end| end.len() >= END_LENGTH)
            .ok_or("the archive has no directory (truncated?)")?;
        let count = u16_at(end, 10)?;
        let mut at = u32_at(end, 16)?;
        let mut entries = Vec::new();
        for _ in 0..count {
            let record = bytes.get(at..).unwrap_or_default();
            if !record.starts_with(b"PK\x01\x02") {
                return Err("the archive's directory is damaged".into());
            }
            let name_length = usize::from(u16_at(record, 28)?);
            let extra_length = usize::from(u16_at(record, 30)?);
            let comment_length = usize::from(u16_at(record, 32)?);
            let name = record
                .get(46..46 + name_length)
                .ok_or("the archive's directory is damaged")?;
            entries.push(Entry {
                name: String::from_utf8_lossy(name).into_owned(),
                method: u16_at(record, 10)?,
                crc: u32_at(record, 16)? as u32,
                packed: u32_at(record, 20)?,
                unpacked: u32_at(record, 24)?,
                header_at: u32_at(record, 42)?,
            });
            at += 46 + name_length + extra_length + comment_length;
        }
        Ok(Self { bytes, entries })
    }

    pub(super) fn entries(&self) -> &[Entry] {
        &self.entries
    }

    /// Unpacks a member and checks its checksum.
    pub(super) fn extract(&self, entry: &Entry) -> Result<Vec<u8>, String> {
        let damaged = || format!("the archive's member '{}' is damaged", entry.name);
        let header = self.bytes.get(entry.header_at..).ok_or_else(damaged)?;
        if !header.starts_with(b"PK\x03\x04") {
            return Err(damaged());
        }
        let skip = 30 + usize::from(u16_at(header, 26)?) + usize::from(u16_at(header, 28)?);
        let packed = header
            .get(skip..)
            .and_then(|data| data.get(..entry.packed))
            .ok_or_else(damaged)?;
        let unpacked = match entry.method {
            0 => packed.to_vec(),
            8 => {
                // Deflate cannot expand further than this; do not believe a larger size.
                if entry.unpacked / 1032 > packed.len() {
                    return Err(damaged());
                }
                let mut out = Vec::new();
                DeflateDecoder::new(packed)
                    .take(entry.unpacked as u64 + 1)
                    .read_to_end(&mut out)
                    .map_err(|_| damaged())?;
                out
            }
            other => {
                return Err(format!(
                    "the archive's member '{}' is packed by method {other}, which is not read",
                    entry.name
                ));
            }
        };
        let mut crc = Crc::new();
        crc.update(&unpacked);
        if unpacked.len() != entry.unpacked || crc.sum() != entry.crc {
            return Err(damaged());
        }
        Ok(unpacked)
    }
}

fn u16_at(bytes: &[u8], at: usize) -> Result<u16, String> {
    match bytes.get(at..at + 2) {
        Some(b) => Ok(u16::from_le_bytes([b[0], b[1]])),
        None => Err("the archive ends early".into()),
    }
}

fn u32_at(bytes: &[u8], at: usize) -> Result<usize, String> {
    match bytes.get(at..at + 4) {
        Some(b) => Ok(u32::from_le_bytes([b[0], b[1], b[2], b[3]]) as usize),
        None => Err("the archive ends early".into()),
    }
}
