//! NumPy's `.npy` arrays and `.npz` archives of them, numeric types only.
//!
//! Implemented here because the crate `npyz` allocates whatever length a header states (4 GiB from
//! 14 bytes), and `ndarray-npy` would add a dependency on `ndarray`.

use std::borrow::Cow;
use std::fmt::Display;
use std::io::{Cursor, Read};
use std::path::Path;

use half::f16;
use zip::ZipArchive;
use zip::result::ZipError;

use super::{FloatMap, FormatError};
use crate::DatasetError;

/// An array in row-major (C) order, regardless of the order and type in the file.
#[derive(Debug, Clone, PartialEq)]
pub struct NpyArray {
    /// Extent of each dimension.
    pub shape: Vec<usize>,
    /// Values, as many as the product of the extents.
    pub values: Vec<f32>,
}

impl NpyArray {
    /// Converts the array to a map; dimensions of extent 1 before and after height and width are dropped.
    ///
    /// # Errors
    /// If more than two dimensions remain, or a side is zero or too large.
    pub fn into_map(self) -> Result<FloatMap, FormatError> {
        let (width, height) = map_size(&self.shape)?;
        FloatMap::from_vec(width, height, self.values)
            .ok_or_else(|| invalid!("the array's shape {:?} is too large", self.shape))
    }
}

/// Width and height of the map that an array of this shape forms.
fn map_size(shape: &[usize]) -> Result<(u32, u32), FormatError> {
    let mut sides = shape;
    while sides.len() > 2 && sides.first() == Some(&1) {
        sides = &sides[1..];
    }
    while sides.len() > 2 && sides.last() == Some(&1) {
        sides = &sides[..sides.len() - 1];
    }
    let &[height, width] = sides else {
        return Err(invalid!(
            "the array's shape is {shape:?}, but a map has two dimensions, height and width"
        ));
    };
    let side = |n: usize| u32::try_from(n).ok().filter(|n| *n > 0);
    let sides = side(width).zip(side(height));
    sides.ok_or_else(|| invalid!("the array's shape is {shape:?}, so it has no pixels"))
}

/// Reads an array of any shape from an `.npy` file, or the only array of an `.npz` (if it has
/// several: `arr_0`, `depth` or `disp`).
///
/// # Errors
/// If the bytes are not a NumPy file, contain an object array (which would require unpickling and is never read), or
/// have fewer values than the shape requires.
pub fn parse(bytes: &[u8]) -> Result<NpyArray, FormatError> {
    if bytes.starts_with(b"PK") {
        parse_array(&unpacked(bytes, u64::MAX)?)
    } else {
        parse_array(bytes)
    }
}

/// Width and height of an `.npz`'s map; decompresses only its header.
///
/// # Errors
/// The errors of [`parse`] and [`NpyArray::into_map`] that the header reveals.
pub(super) fn archived_size(bytes: &[u8]) -> Result<(u32, u32), FormatError> {
    const LONGEST_HEADER: u64 = 1 << 17;
    let start = unpacked(bytes, LONGEST_HEADER)?;
    map_size(&NpyHeader::parse(&start)?.shape)
}

/// The first `most` bytes of the archive's array. If `most` covers the whole array, also checks
/// that the array is complete.
fn unpacked(bytes: &[u8], most: u64) -> Result<Vec<u8>, FormatError> {
    let refused =
        |_: ZipError| FormatError::from("not a readable ZIP archive (truncated or damaged?)");
    let mut archive = ZipArchive::new(Cursor::new(bytes)).map_err(refused)?;
    let names = archive.file_names().filter_map(Result::ok);
    let names = names.filter(|name| name.ends_with(".npy"));
    let names: Vec<String> = names.map(Cow::into_owned).collect();
    let usual = ["arr_0.npy", "depth.npy", "disp.npy"].map(str::to_owned);
    let name = match names.as_slice() {
        [] => return Err("the archive contains no array".into()),
        [only] => only,
        several => usual
            .iter()
            .find(|name| several.contains(name))
            .ok_or_else(|| {
                let first = several[..several.len().min(8)].join(", ");
                invalid!("the archive contains several arrays ({first}), and none is named arr_0, depth or disp")
            })?,
    };
    let member = archive.by_name(name).map_err(refused)?;
    let (packed, size) = (member.compressed_size(), member.size());
    let damaged = |why: &dyn Display| invalid!("the archive's member '{name}' is damaged: {why}");
    // Deflate compresses at most 1032-fold.
    if size / 1032 > packed.min(bytes.len() as u64) {
        return Err(damaged(&format_args!(
            "its {packed} compressed bytes cannot hold {size} bytes"
        )));
    }
    let mut array = Vec::new();
    // Reading to the end also verifies the checksum.
    let read = member.take(most.min(size + 1)).read_to_end(&mut array);
    read.map_err(|_| damaged(&"it cannot be unpacked (truncated?)"))?;
    if most > size && array.len() as u64 != size {
        return Err(damaged(&format_args!("it should have {size} bytes")));
    }
    Ok(array)
}

/// Header of an array, and the bytes that follow.
struct NpyHeader<'a> {
    kind: String,
    fortran: bool,
    shape: Vec<usize>,
    data: &'a [u8],
}

impl<'a> NpyHeader<'a> {
    fn parse(bytes: &'a [u8]) -> Result<Self, FormatError> {
        let rest = bytes.strip_prefix(b"\x93NUMPY").ok_or(
            "not a NumPy array, because the file does not start with NumPy's magic number",
        )?;
        let short = || "the header ends early".to_owned();
        let (length, start) = match *rest.first().ok_or_else(short)? {
            1 => {
                let b = rest.get(2..4).ok_or_else(short)?;
                (usize::from(u16::from_le_bytes([b[0], b[1]])), 4)
            }
            2 | 3 => {
                let b = rest.get(2..6).ok_or_else(short)?;
                (u32::from_le_bytes([b[0], b[1], b[2], b[3]]) as usize, 6)
            }
            other => {
                return Err(invalid!(
                    "version {other} of NumPy's format is not supported"
                ));
            }
        };
        let header = rest
            .get(start..)
            .and_then(|r| r.get(..length))
            .ok_or_else(short)?;
        let data = &rest[start + length..];
        let header = String::from_utf8_lossy(header);

        let kind = text_of(&header, "descr").ok_or("the header has no simple 'descr'")?;
        let fortran = match value_of(&header, "fortran_order") {
            Some(v) if v.starts_with("False") => false,
            Some(v) if v.starts_with("True") => true,
            _ => return Err("the header has no 'fortran_order'".into()),
        };
        let shape = shape_of(&header).ok_or("the header has no 'shape'")?;
        Ok(Self {
            kind: kind.to_owned(),
            fortran,
            shape,
            data,
        })
    }
}

fn parse_array(bytes: &[u8]) -> Result<NpyArray, FormatError> {
    let NpyHeader {
        kind,
        fortran,
        shape,
        data,
    } = NpyHeader::parse(bytes)?;
    let element = NpyType::parse(&kind)?;
    let sizes = shape.iter().chain([&element.size]);
    let needed = sizes.fold(1_u128, |n, side| n.saturating_mul(*side as u128));
    let fits = usize::try_from(needed).ok().and_then(|n| data.get(..n));
    let data = fits.ok_or_else(|| FormatError::Truncated {
        what: format!("an array of shape {shape:?} and type '{kind}'"),
        needed,
        available: data.len(),
    })?;
    let values: Vec<f32> = data
        .chunks_exact(element.size)
        .map(|b| element.decode(b))
        .collect();
    Ok(NpyArray {
        values: if fortran {
            row_major(&shape, &values)
        } else {
            values
        },
        shape,
    })
}

/// Converts values whose first index varies fastest to row-major order.
fn row_major(shape: &[usize], values: &[f32]) -> Vec<f32> {
    let mut index = vec![0; shape.len()];
    let mut strides = vec![1; shape.len()];
    for i in 1..shape.len() {
        strides[i] = strides[i - 1] * shape[i - 1];
    }
    (0..values.len())
        .map(|_| {
            let at: usize = index.iter().zip(&strides).map(|(i, s)| i * s).sum();
            for (i, side) in index.iter_mut().zip(shape).rev() {
                *i += 1;
                if *i < *side {
                    break;
                }
                *i = 0;
            }
            values[at]
        })
        .collect()
}

/// The text after `'key':` in the header's Python dictionary.
fn value_of<'a>(header: &'a str, key: &str) -> Option<&'a str> {
    let at = header
        .find(&format!("'{key}'"))
        .or_else(|| header.find(&format!("\"{key}\"")))?;
    let rest = header[at + key.len() + 2..].trim_start();
    Some(rest.strip_prefix(':')?.trim_start())
}

fn text_of<'a>(header: &'a str, key: &str) -> Option<&'a str> {
    let value = value_of(header, key)?;
    let quote = value.chars().next().filter(|c| *c == '\'' || *c == '"')?;
    value[1..].split(quote).next()
}

fn shape_of(header: &str) -> Option<Vec<usize>> {
    let value = value_of(header, "shape")?;
    let inner = value.strip_prefix('(')?.split_once(')')?.0;
    inner
        .split(',')
        .map(str::trim)
        .filter(|side| !side.is_empty())
        .map(|side| side.parse().ok())
        .collect()
}

#[derive(Clone, Copy)]
struct NpyType {
    kind: u8,
    size: usize,
    big_endian: bool,
}

impl NpyType {
    fn parse(text: &str) -> Result<Self, FormatError> {
        let unknown =
            || FormatError::Unsupported(format!("arrays of type '{text}' are not supported"));
        // NumPy writes `|O`; `O` without a byte order is recognised too.
        if text
            .trim_start_matches(['|', '<', '>', '='])
            .starts_with('O')
        {
            return Err(
                "an array of Python objects, which are refused because they would have to be \
                 unpickled"
                    .into(),
            );
        }
        let (order, rest) = text.split_at_checked(1).ok_or_else(unknown)?;
        let (kind, size) = rest.split_at_checked(1).ok_or_else(unknown)?;
        let size: usize = size.parse().map_err(|_| unknown())?;
        let big_endian = match order {
            "<" | "|" | "=" => false,
            ">" => true,
            _ => return Err(unknown()),
        };
        let kind = kind.as_bytes()[0];
        match (kind, size) {
            (b'f', 2 | 4 | 8) | (b'u' | b'i', 1 | 2 | 4 | 8) | (b'b', 1) => Ok(Self {
                kind,
                size,
                big_endian,
            }),
            _ => Err(unknown()),
        }
    }

    fn decode(self, bytes: &[u8]) -> f32 {
        let mut b = [0; 8];
        b[..self.size].copy_from_slice(bytes);
        if self.big_endian {
            b[..self.size].reverse();
        }
        let whole = u64::from_le_bytes(b);
        match (self.kind, self.size) {
            (b'f', 2) => f16::from_bits(whole as u16).to_f32(),
            (b'f', 4) => f32::from_bits(whole as u32),
            (b'f', _) => f64::from_bits(whole) as f32,
            (b'i', size) => {
                let unused = 64 - 8 * size as u32;
                ((whole << unused) as i64 >> unused) as f32
            }
            _ => whole as f32,
        }
    }
}

/// Writes a map as a little-endian f32 `.npy` of shape (height, width).
///
/// # Errors
/// If the file cannot be written.
pub fn write(path: &Path, map: &FloatMap) -> Result<(), DatasetError> {
    std::fs::write(path, to_bytes(map)).map_err(|e| DatasetError::io(path, e))
}

/// The bytes written by [`write()`].
pub fn to_bytes(map: &FloatMap) -> Vec<u8> {
    let mut bytes = header("<f4", map).into_bytes();
    bytes.splice(0..0, preamble(bytes.len()));
    bytes.extend(map.iter().flat_map(|v| v.to_le_bytes()));
    bytes
}

/// A header padded so that the data starts at a multiple of 64 bytes.
fn header(kind: &str, map: &FloatMap) -> String {
    let mut text = format!(
        "{{'descr': '{kind}', 'fortran_order': False, 'shape': ({}, {}), }}",
        map.height(),
        map.width()
    );
    while !(text.len() + 1 + 10).is_multiple_of(64) {
        text.push(' ');
    }
    text.push('\n');
    text
}

fn preamble(header_length: usize) -> Vec<u8> {
    let mut bytes = b"\x93NUMPY\x01\x00".to_vec();
    bytes.extend((header_length as u16).to_le_bytes());
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    fn array(descr: &str, fortran: bool, shape: &str, data: &[u8]) -> Vec<u8> {
        let fortran = if fortran { "True" } else { "False" };
        let text = format!("{{'descr': {descr}, 'fortran_order': {fortran}, 'shape': {shape}}}");
        [preamble(text.len()), text.into_bytes(), data.to_vec()].concat()
    }

    #[test]
    fn orders_and_types_are_honoured() {
        let fortran = parse(&array("'|u1'", true, "(2, 3)", &[1, 4, 2, 5, 3, 6])).unwrap();
        assert_eq!(fortran.values, [1.0, 2.0, 3.0, 4.0, 5.0, 6.0]);
        let big = parse(&array("'>i2'", false, "(2,)", &[0xFF, 0xFE, 1, 0])).unwrap();
        assert_eq!(big.values, [-2.0, 256.0]);
        let half = parse(&array("'<f2'", false, "(1,)", &[0x00, 0x3E])).unwrap();
        assert_eq!(half.values, [1.5]);
        let scalar = parse(&array("'<f8'", false, "()", &2.5_f64.to_le_bytes())).unwrap();
        assert_eq!(scalar.values, [2.5]);
    }

    #[test]
    fn broken_arrays_are_refused() {
        for (bytes, reason) in [
            (b"\x93NUMPX".to_vec(), "magic"),
            (b"\x93NUMPY\x01\x00\xff\xff".to_vec(), "ends early"),
            (b"\x93NUMPY\x07\x00\x00\x00".to_vec(), "version 7"),
            (array("'|O'", false, "(1,)", &[0; 8]), "unpickled"),
            (array("'O'", false, "(1,)", &[0; 8]), "unpickled"),
            (array("[('a', '<f4')]", false, "(1,)", &[0; 8]), "simple"),
            (
                array("'<c8'", false, "(1,)", &[0; 8]),
                "'<c8' are not supported",
            ),
            (array("'<f4'", false, "(2,)", &[0; 7]), "truncated"),
            (
                array("'<f4'", false, "(9999999999, 9999999999)", &[0; 8]),
                "truncated",
            ),
            (array("'é'", false, "(1,)", &[0; 8]), "not supported"),
        ] {
            let error = parse(&bytes).unwrap_err();
            assert!(error.to_string().contains(reason), "{error}");
        }
        let cube = parse(&array("'|u1'", false, "(2, 1, 2)", &[0; 4])).unwrap();
        assert!(cube.into_map().is_err());
        let empty = parse(&array("'|u1'", false, "(0, 4)", &[])).unwrap();
        assert!(empty.into_map().is_err());
    }
}
