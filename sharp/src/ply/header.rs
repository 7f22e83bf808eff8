//! The header of a PLY file: its encoding, and the elements with their properties.

use super::PlyReason;

/// How the rows after the header are stored.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Encoding {
    Ascii,
    LittleEndian,
    BigEndian,
}

/// A number's type.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Scalar {
    I8,
    U8,
    I16,
    U16,
    I32,
    U32,
    F32,
    F64,
}

impl Scalar {
    fn parse(word: &str) -> Option<Self> {
        Some(match word {
            "char" | "int8" => Self::I8,
            "uchar" | "uint8" => Self::U8,
            "short" | "int16" => Self::I16,
            "ushort" | "uint16" => Self::U16,
            "int" | "int32" => Self::I32,
            "uint" | "uint32" => Self::U32,
            "float" | "float32" => Self::F32,
            "double" | "float64" => Self::F64,
            _ => return None,
        })
    }

    /// Bytes in a binary file.
    pub(super) fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }
}

/// A named column.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Property {
    pub(super) name: String,
    pub(super) scalar: Scalar,
    /// Type of the count of a list property.
    pub(super) list_count: Option<Scalar>,
}

/// A table.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Element {
    pub(super) name: String,
    pub(super) count: usize,
    pub(super) properties: Vec<Property>,
}

impl Element {
    /// The column called `name`, unless it is a list.
    pub(super) fn column(&self, name: &str) -> Option<usize> {
        self.properties
            .iter()
            .position(|p| p.name == name && p.list_count.is_none())
    }
}

/// Everything before the data.
#[derive(Debug, Clone, PartialEq, Eq)]
pub(super) struct Header {
    pub(super) encoding: Encoding,
    pub(super) elements: Vec<Element>,
    pub(super) comments: Vec<String>,
    /// Offset of the first data byte.
    pub(super) data: usize,
}

/// Longest header read; real ones have some 2 KiB.
const MAX_HEADER_BYTES: usize = 1 << 16;

impl Header {
    pub(super) fn parse(bytes: &[u8]) -> Result<Self, PlyReason> {
        let bytes = &bytes[..bytes.len().min(MAX_HEADER_BYTES)];
        let mut encoding = None;
        let mut elements: Vec<Element> = Vec::new();
        let mut comments = Vec::new();
        let mut offset = 0;
        let mut number = 0;
        loop {
            number += 1;
            let line_error = |what: String| PlyReason::Header { line: number, what };
            let Some(length) = bytes[offset..].iter().position(|&b| b == b'\n') else {
                return Err(match number {
                    1 => PlyReason::NotPly,
                    _ => line_error(format!(
                        "no `end_header` within the first {MAX_HEADER_BYTES} bytes"
                    )),
                });
            };
            let line = String::from_utf8_lossy(&bytes[offset..offset + length]);
            offset += length + 1;
            let words: Vec<&str> = line.split_ascii_whitespace().collect();
            match words[..] {
                ["ply"] if number == 1 => {}
                _ if number == 1 => return Err(PlyReason::NotPly),
                ["end_header"] => {
                    let encoding = encoding.ok_or_else(|| line_error("no `format`".into()))?;
                    return Ok(Self {
                        encoding,
                        elements,
                        comments,
                        data: offset,
                    });
                }
                ["format", kind, "1.0"] => {
                    encoding = Some(match kind {
                        "ascii" => Encoding::Ascii,
                        "binary_little_endian" => Encoding::LittleEndian,
                        "binary_big_endian" => Encoding::BigEndian,
                        _ => return Err(line_error(format!("format `{kind}`"))),
                    });
                }
                ["comment" | "obj_info", ..] => comments.push(words[1..].join(" ")),
                ["element", name, count] => elements.push(Element {
                    name: name.to_owned(),
                    count: count
                        .parse()
                        .map_err(|_| line_error(format!("`{count}` is no count")))?,
                    properties: Vec::new(),
                }),
                ["property", ref rest @ ..] => {
                    let property =
                        property(rest).ok_or_else(|| line_error(shortened(line.trim())))?;
                    let element = elements
                        .last_mut()
                        .ok_or_else(|| line_error("a property before any element".into()))?;
                    if element.properties.iter().any(|p| p.name == property.name) {
                        return Err(line_error(format!("property `{}` twice", property.name)));
                    }
                    element.properties.push(property);
                }
                [] => {}
                _ => return Err(line_error(shortened(line.trim()))),
            }
        }
    }
}

fn property(words: &[&str]) -> Option<Property> {
    let (list_count, scalar, name) = match words {
        ["list", count, scalar, name] => (Some(Scalar::parse(count)?), scalar, name),
        [scalar, name] => (None, scalar, name),
        _ => return None,
    };
    Some(Property {
        name: (*name).to_owned(),
        scalar: Scalar::parse(scalar)?,
        list_count,
    })
}

/// A line or word of a file, short enough for an error message.
pub(super) fn shortened(text: &str) -> String {
    const LIMIT: usize = 60;
    if text.chars().count() <= LIMIT {
        format!("`{text}` is not understood")
    } else {
        let start: String = text.chars().take(LIMIT).collect();
        format!("`{start}…` is not understood")
    }
}
