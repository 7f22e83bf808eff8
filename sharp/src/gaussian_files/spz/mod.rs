//! Niantic's SPZ: one gzip stream up to version 3, one Zstandard stream per attribute in version 4. Attributes are
//! stored one after another, each for all Gaussians.

mod write;

use std::io::Read;

use flate2::read::GzDecoder;
use half::f16;
use ruzstd::decoding::StreamingDecoder;

use super::{unfold, unfolding};
use crate::gaussians::Harmonics;
use crate::ply::{
    Decoded, FileMarks, PlyReason, StoredColors, StoredForm, StoredOpacity, StoredScales,
    Suspicion, completed,
};

pub use write::to_bytes;

/// Largest standard deviation that the format can store, e^(255/16 − 10).
pub const LARGEST_SPZ_SCALE: f32 = 378.98;

const MAGIC: [u8; 4] = *b"NGSP";
/// Header size of versions 1 to 3.
const HEADER: usize = 16;
/// Header size of version 4.
const WIDE_HEADER: usize = 32;
/// Flag of files made for an antialiased rasteriser.
const ANTIALIASED: u8 = 1;
/// A stored byte b is the colour coefficient (b / 255 − 0.5) / `COLOR_SCALE`.
const COLOR_SCALE: f32 = 0.15;

fn damaged(what: impl Into<String>) -> PlyReason {
    PlyReason::Damaged {
        format: "SPZ",
        what: what.into(),
    }
}

struct Header {
    version: u32,
    count: usize,
    degree: usize,
    fractional_bits: u8,
    flags: u8,
}

impl Header {
    fn parse(bytes: &[u8; HEADER]) -> Result<Self, PlyReason> {
        let word = |at: usize| {
            u32::from_le_bytes([bytes[at], bytes[at + 1], bytes[at + 2], bytes[at + 3]])
        };
        let header = Self {
            version: word(4),
            count: word(8) as usize,
            degree: bytes[12].into(),
            fractional_bits: bytes[13],
            flags: bytes[14],
        };
        match header {
            Self {
                version: 0 | 5.., ..
            } => Err(damaged(format!(
                "version {} is not supported; only versions 1 to 4 are",
                header.version
            ))),
            Self { degree, .. } if degree > Harmonics::MAX_DEGREE => Err(damaged(format!(
                "degree {degree} of view-dependent colour is not supported; the maximum is 4"
            ))),
            _ => Ok(header),
        }
    }

    /// Bytes per Gaussian in each block: position, opacity, colour, scale, rotation, view-dependent colour.
    fn blocks(&self) -> [usize; 6] {
        let position = if self.version == 1 { 6 } else { 9 };
        let rotation = if self.version < 3 { 3 } else { 4 };
        let coefficients = 3 * ((self.degree + 1).pow(2) - 1);
        [position, 1, 3, 3, rotation, coefficients]
    }
}

/// Reads a file that starts like a gzip stream (SPZ 1 to 3) or like SPZ 4.
pub(super) fn decode(bytes: &[u8]) -> Result<Decoded, PlyReason> {
    let (header, blocks) = if bytes.starts_with(&MAGIC) {
        zstd_blocks(bytes)?
    } else {
        gzip_blocks(bytes)?
    };
    let [positions, opacities, colors, scales, rotations, harmonics] = &blocks;
    let mut out = Decoded {
        form: StoredForm {
            opacity: Some(StoredOpacity::Byte),
            scales: Some(StoredScales::Log),
            colors: Some(StoredColors::Dc),
            ..StoredForm::default()
        },
        marks: FileMarks {
            // An unset flag carries no information: most programs never set it.
            antialiased: (header.flags & ANTIALIASED != 0).then_some(true),
            ..FileMarks::default()
        },
        color_coefficients: header.blocks()[5],
        is_view_dependent: harmonics.iter().any(|byte| *byte != 128),
        ..Decoded::default()
    };
    let three = |bytes: &[u8], value: fn(f32) -> f32| -> Vec<[f32; 3]> {
        let rows = bytes.as_chunks::<3>().0.iter();
        rows.map(|row| row.map(|byte| value(byte.into()))).collect()
    };
    let stored = &mut out.stored;
    stored.opacities = opacities.iter().map(|byte| f32::from(*byte)).collect();
    stored.colors = three(colors, |byte| (byte / 255.0 - 0.5) / COLOR_SCALE);
    stored.scales = three(scales, |byte| byte / 16.0 - 10.0);
    stored.harmonics.degree = header.degree;
    stored.harmonics.coefficients = three(harmonics, |byte| (byte - 128.0) / 128.0);
    if header.version == 1 {
        let rows = positions.as_chunks::<6>().0.iter();
        let axis = |row: &[u8; 6], k: usize| f16::from_le_bytes([row[2 * k], row[2 * k + 1]]);
        stored.means = rows
            .map(|row| [0, 1, 2].map(|k| axis(row, k).to_f32()))
            .collect();
    } else {
        let step = (-f64::from(header.fractional_bits)).exp2();
        let rows = positions.as_chunks::<9>().0.iter();
        let axis = |row: &[u8; 9], k: usize| {
            // The 24 bits are in the upper bytes, so the shift extends their sign.
            let word = i32::from_le_bytes([0, row[3 * k], row[3 * k + 1], row[3 * k + 2]]) >> 8;
            (f64::from(word) * step) as f32
        };
        stored.means = rows.map(|row| [0, 1, 2].map(|k| axis(row, k))).collect();
        let most = (1 << 23) - 2;
        let end = (f64::from(most) * step) as f32;
        if stored.means.as_flattened().iter().any(|v| v.abs() >= end) {
            let text = format!(
                "a position is at ±{end}, the limit of the file's range; larger positions were wrapped when the file \
                 was written"
            );
            out.doubts.push(Suspicion::new("overflow", text));
        }
    }
    stored.quaternions = match header.version {
        1 | 2 => three(rotations, |byte| byte / 127.5 - 1.0)
            .into_iter()
            .map(|[x, y, z]| [(1.0 - x * x - y * y - z * z).max(0.0).sqrt(), x, y, z])
            .collect(),
        _ => rotations
            .as_chunks::<4>()
            .0
            .iter()
            .map(|word| rotation_of(u32::from_le_bytes(*word)))
            .collect(),
    };
    out.doubts.push(Suspicion::new(
        super::AXES,
        "SPZ does not state its axes; use `axes=rub` if they follow the format's specification, `axes=rdf` if a \
         PLY's numbers were stored unchanged, as splat-transform 3 does",
    ));
    Ok(out)
}

/// Decodes a quaternion. The two highest bits identify the largest of x, y, z, w, which is positive; the other
/// components follow as sign and magnitude.
fn rotation_of(packed: u32) -> [f32; 4] {
    let largest = (packed >> 30) as usize;
    let mut xyzw = [0.0_f64; 4];
    let mut rest = packed;
    for place in (0..4).rev().filter(|place| *place != largest) {
        let magnitude = f64::from(rest & 511) / 511.0 * std::f64::consts::FRAC_1_SQRT_2;
        xyzw[place] = if rest & 512 == 0 {
            magnitude
        } else {
            -magnitude
        };
        rest >>= 10;
    }
    let [x, y, z, w] = completed(xyzw, largest);
    [w, x, y, z]
}

fn gzip_blocks(bytes: &[u8]) -> Result<(Header, [Vec<u8>; 6]), PlyReason> {
    let mut stream = GzDecoder::new(bytes);
    let mut start = [0; HEADER];
    let begun = stream.read_exact(&mut start);
    if begun.is_ok() && !start.starts_with(&MAGIC) {
        let what = if start.starts_with(b"ply") {
            "a PLY file packed by gzip; unpack it (gunzip)"
        } else {
            "packed by gzip, and not an SPZ; unpack it (gunzip)"
        };
        return Err(PlyReason::Foreign(what.to_owned()));
    }
    begun.map_err(|error| damaged(unfolding(&error)))?;
    let header = Header::parse(&start)?;
    if header.version == 4 {
        return Err(damaged("version 4 must not be packed by gzip"));
    }
    let sizes = header
        .blocks()
        .map(|size| header.count.saturating_mul(size));
    let expected = sizes
        .iter()
        .fold(0_usize, |sum, size| sum.saturating_add(*size));
    let unpacked = unfold(stream, expected, bytes.len()).map_err(damaged)?;
    let mut rest = unpacked.as_slice();
    let blocks = sizes.map(|size| {
        let (block, after) = rest.split_at(size);
        rest = after;
        block.to_vec()
    });
    Ok((header, blocks))
}

fn zstd_blocks(bytes: &[u8]) -> Result<(Header, [Vec<u8>; 6]), PlyReason> {
    let cut = || damaged("the file ends before its last stream (truncated?)");
    let start: &[u8; WIDE_HEADER] = bytes.first_chunk().ok_or_else(cut)?;
    let header = Header::parse(start.first_chunk().ok_or_else(cut)?)?;
    if header.version != 4 {
        let what = format!("version {} must be packed by gzip", header.version);
        return Err(damaged(what));
    }
    let wanted = if header.degree == 0 { 5 } else { 6 };
    if usize::from(start[15]) != wanted {
        let what = format!("{} streams instead of {wanted}", start[15]);
        return Err(damaged(what));
    }
    let table = u32::from_le_bytes([start[16], start[17], start[18], start[19]]);
    let table = bytes.get(table as usize..).ok_or_else(cut)?;
    let (sizes, _) = table.as_chunks::<16>();
    let mut rest = table.get(16 * wanted..).ok_or_else(cut)?;
    let mut blocks: [Vec<u8>; 6] = Default::default();
    for (block, (row, size)) in blocks
        .iter_mut()
        .zip(sizes.iter().zip(header.blocks()))
        .take(wanted)
    {
        let [packed, raw] = [0, 8].map(|at| {
            let word = row[at..].first_chunk().copied().unwrap_or_default();
            usize::try_from(u64::from_le_bytes(word)).unwrap_or(usize::MAX)
        });
        let expected = header.count.saturating_mul(size);
        if raw != expected {
            let what = format!(
                "a stream of {raw} bytes, but {} Gaussians need {expected}",
                header.count
            );
            return Err(damaged(what));
        }
        let (stream, after) = rest.split_at_checked(packed).ok_or_else(cut)?;
        rest = after;
        if expected > 0 {
            let zstd = StreamingDecoder::new(stream).map_err(|_| {
                damaged("one of the streams is not Zstandard: the file's bytes are damaged")
            })?;
            *block = unfold(zstd, expected, packed).map_err(damaged)?;
        }
    }
    Ok((header, blocks))
}
