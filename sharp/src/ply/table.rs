//! PLY files as tables of numbers, independent of their meaning: a header that describes the elements, then the rows of
//! each element in the header's order.
//!
//! All numbers are read as f64, which represents every PLY type exactly.

/// Encoding of the rows after the header.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Encoding {
    Ascii,
    LittleEndian,
    BigEndian,
}

#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Scalar {
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

    /// Number of bytes that a value takes in a binary file.
    fn size(self) -> usize {
        match self {
            Self::I8 | Self::U8 => 1,
            Self::I16 | Self::U16 => 2,
            Self::I32 | Self::U32 | Self::F32 => 4,
            Self::F64 => 8,
        }
    }
}

/// A named column of an element.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Property {
    pub name: String,
    pub scalar: Scalar,
    /// Type of the stored list length; `None` for a single number.
    pub list_length: Option<Scalar>,
}

/// A table: the vertices, the faces, …
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Element {
    pub name: String,
    /// Number of rows according to the header. [`Body::rows`] checks this number against the size
    /// of the file.
    pub count: usize,
    pub properties: Vec<Property>,
}

impl Element {
    /// Position of the single-number property called `name`.
    pub fn number(&self, name: &str) -> Option<usize> {
        self.position(name, false)
    }

    /// Position of the list property called `name`.
    pub fn list(&self, name: &str) -> Option<usize> {
        self.position(name, true)
    }

    fn position(&self, name: &str, is_list: bool) -> Option<usize> {
        self.properties
            .iter()
            .position(|p| p.name == name && p.list_length.is_some() == is_list)
    }
}

#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Header {
    pub encoding: Encoding,
    /// Elements, in the order in which their rows are stored.
    pub elements: Vec<Element>,
    /// `comment` and `obj_info` lines without their keyword.
    pub comments: Vec<String>,
}

/// Errors of reading a PLY file.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum TableError {
    #[error("not a PLY file")]
    NotPly,
    #[error("header line {line}: {what}")]
    Header {
        /// Number of the line, counted from 1.
        line: usize,
        what: String,
    },
    #[error("element `{element}`: the file ends before its {count} rows do (truncated?)")]
    Truncated { element: String, count: usize },
    #[error("element `{element}`, row {row}: `{word}` is not a number")]
    NotANumber {
        element: String,
        /// Index of the row, counted from 0.
        row: usize,
        /// The word that is not a number, at most 40 bytes of it.
        word: String,
    },
}

/// Maximum length of a header in bytes; headers of real files have about 2 KiB.
const MAX_HEADER_BYTES: usize = 1 << 16;

impl Header {
    /// Parses the header of a file and returns the rest as the body.
    ///
    /// # Errors
    /// [`TableError::NotPly`] if the file does not begin like a PLY; [`TableError::Header`] if the
    /// header is malformed or longer than 64 KiB.
    pub fn parse(bytes: &[u8]) -> Result<(Self, Body<'_>), TableError> {
        let searched = &bytes[..bytes.len().min(MAX_HEADER_BYTES)];
        let mut encoding = None;
        let mut elements: Vec<Element> = Vec::new();
        let mut comments = Vec::new();
        let mut offset = 0;
        let mut number = 0;
        loop {
            number += 1;
            let line_error = |what: String| TableError::Header { line: number, what };
            let Some(length) = searched[offset..].iter().position(|&b| b == b'\n') else {
                return Err(match number {
                    1 => TableError::NotPly,
                    _ => line_error(format!(
                        "no `end_header` within the first {MAX_HEADER_BYTES} bytes"
                    )),
                });
            };
            let line = String::from_utf8_lossy(&searched[offset..offset + length]);
            offset += length + 1;
            let words: Vec<&str> = line.split_ascii_whitespace().collect();
            match words[..] {
                ["ply"] if number == 1 => {}
                _ if number == 1 => return Err(TableError::NotPly),
                ["end_header"] => {
                    let encoding = encoding.ok_or_else(|| line_error("no `format` line".into()))?;
                    let header = Self {
                        encoding,
                        elements,
                        comments,
                    };
                    let bytes = &bytes[offset..];
                    return Ok((header, Body { bytes, encoding }));
                }
                ["format", kind, "1.0"] => {
                    encoding = Some(match kind {
                        "ascii" => Encoding::Ascii,
                        "binary_little_endian" => Encoding::LittleEndian,
                        "binary_big_endian" => Encoding::BigEndian,
                        _ => return Err(line_error(format!("unknown format `{kind}`"))),
                    });
                }
                ["comment" | "obj_info", ..] => comments.push(words[1..].join(" ")),
                ["element", name, _] if elements.iter().any(|e| e.name == name) => {
                    return Err(line_error(format!(
                        "a second element `{name}`, although element names must be unique; perhaps two files were \
                         joined"
                    )));
                }
                ["element", name, count] => elements.push(Element {
                    name: name.to_owned(),
                    count: count
                        .parse()
                        .map_err(|_| line_error(format!("`{count}` is not a number of rows")))?,
                    properties: Vec::new(),
                }),
                ["property", ref rest @ ..] => {
                    let property = property(rest).ok_or_else(|| line_error(unread(&line)))?;
                    let element = elements
                        .last_mut()
                        .ok_or_else(|| line_error("a property before the first element".into()))?;
                    if element.properties.iter().any(|p| p.name == property.name) {
                        return Err(line_error(format!("a second property `{}`", property.name)));
                    }
                    element.properties.push(property);
                }
                [] => {}
                _ => return Err(line_error(unknown(&line))),
            }
        }
    }
}

fn property(words: &[&str]) -> Option<Property> {
    let (list_length, scalar, name) = match words {
        ["list", length, scalar, name] => (Some(Scalar::parse(length)?), scalar, name),
        [scalar, name] => (None, scalar, name),
        _ => return None,
    };
    Some(Property {
        name: (*name).to_owned(),
        scalar: Scalar::parse(scalar)?,
        list_length,
    })
}

/// Describes a line of a property whose type is unknown.
fn unread(line: &str) -> String {
    format!(
        "{}: not a type of PLY, which has integers, float and double; convert it to float",
        unknown(line)
    )
}

/// Describes an unknown header line, shortened to fit in an error message.
fn unknown(line: &str) -> String {
    let line = line.trim();
    match line.char_indices().nth(60) {
        None => format!("unknown line `{line}`"),
        Some((end, _)) => format!("unknown line `{}…`", &line[..end]),
    }
}

/// The rows that have not been read yet.
#[derive(Debug, Clone)]
pub struct Body<'a> {
    bytes: &'a [u8],
    encoding: Encoding,
}

#[derive(Debug, Clone, Copy)]
pub struct TableRow<'a> {
    values: &'a [f64],
    /// Start of each property in `values`, and the end of the last one.
    starts: &'a [usize],
}

impl<'a> TableRow<'a> {
    /// Values of a property: one, or all elements of a list.
    pub fn property(self, index: usize) -> &'a [f64] {
        &self.values[self.starts[index]..self.starts[index + 1]]
    }

    /// Value of a property that is a single number; the first value of a list property.
    pub fn number(self, index: usize) -> f64 {
        self.values[self.starts[index]]
    }
}

impl<'a> Body<'a> {
    /// The bytes that have not been read yet.
    pub fn rest(&self) -> &'a [u8] {
        self.bytes
    }

    /// Number of bytes beyond the rows that a binary header announces. `None` for text, for lists
    /// (whose lengths are stored in their rows), and for files that are too short.
    pub fn surplus(&self, header: &Header) -> Option<usize> {
        let binary = self.encoding != Encoding::Ascii;
        let size = header.elements.iter().try_fold(0_usize, |sum, element| {
            let sizes = element.properties.iter();
            let sizes = sizes.map(|p| p.list_length.is_none().then(|| p.scalar.size()));
            let row = sizes.sum::<Option<usize>>()?;
            sum.checked_add(row.checked_mul(element.count)?)
        });
        self.bytes.len().checked_sub(size.filter(|_| binary)?)
    }

    /// Reads the rows of `element`, which must be the next of the header's elements, and passes
    /// each row to `visit`.
    ///
    /// A count that exceeds what the rest of the file can contain is rejected before the first row. Memory is thus
    /// bounded by a small multiple of the file's size, even if `visit` collects all rows. Rows without properties take
    /// no bytes and are skipped, whatever their number in the header.
    ///
    /// # Errors
    /// [`TableError::Truncated`], [`TableError::NotANumber`], or any error of `visit`.
    pub fn rows<E: From<TableError>>(
        &mut self,
        element: &Element,
        mut visit: impl FnMut(TableRow<'_>) -> Result<(), E>,
    ) -> Result<(), E> {
        let truncated = || TableError::Truncated {
            element: element.name.clone(),
            count: element.count,
        };
        // Minimum bytes per row: the length of a list; in text, a digit and a separator for each
        // number.
        let least: usize = element
            .properties
            .iter()
            .map(|p| match self.encoding {
                Encoding::Ascii => 2,
                _ => p.list_length.unwrap_or(p.scalar).size(),
            })
            .sum();
        if least == 0 {
            return Ok(());
        }
        // The last number of a text file may have no separator after it.
        if element.count > (self.bytes.len() + 1) / least {
            return Err(truncated().into());
        }
        let mut values = Vec::new();
        let mut starts = Vec::with_capacity(element.properties.len() + 1);
        for row in 0..element.count {
            values.clear();
            starts.clear();
            let mut number = |scalar| match self.encoding {
                Encoding::Ascii => self.text(element, row),
                _ => self.binary(scalar).ok_or_else(truncated),
            };
            for property in &element.properties {
                starts.push(values.len());
                let length = match property.list_length {
                    Some(scalar) => number(scalar)?.max(0.0) as u64,
                    None => 1,
                };
                // Each number consumes bytes, so a wrong length stops at the end of the file.
                for _ in 0..length {
                    values.push(number(property.scalar)?);
                }
            }
            starts.push(values.len());
            visit(TableRow {
                values: &values,
                starts: &starts,
            })?;
        }
        Ok(())
    }

    /// Parses the next word of a text file as a number.
    fn text(&mut self, element: &Element, row: usize) -> Result<f64, TableError> {
        let rest = self.bytes.trim_ascii_start();
        if rest.is_empty() {
            return Err(TableError::Truncated {
                element: element.name.clone(),
                count: element.count,
            });
        }
        let end = rest
            .iter()
            .position(u8::is_ascii_whitespace)
            .unwrap_or(rest.len());
        let (word, after) = rest.split_at(end);
        self.bytes = after;
        std::str::from_utf8(word)
            .ok()
            .and_then(|w| w.parse().ok())
            .ok_or_else(|| TableError::NotANumber {
                element: element.name.clone(),
                row,
                word: String::from_utf8_lossy(&word[..word.len().min(40)]).into_owned(),
            })
    }

    /// Reads one binary value; `None` at the end of the file.
    fn binary(&mut self, scalar: Scalar) -> Option<f64> {
        Some(match scalar {
            Scalar::I8 => f64::from(i8::from_le_bytes(self.take()?)),
            Scalar::U8 => f64::from(u8::from_le_bytes(self.take()?)),
            Scalar::I16 => f64::from(i16::from_le_bytes(self.take()?)),
            Scalar::U16 => f64::from(u16::from_le_bytes(self.take()?)),
            Scalar::I32 => f64::from(i32::from_le_bytes(self.take()?)),
            Scalar::U32 => f64::from(u32::from_le_bytes(self.take()?)),
            Scalar::F32 => f64::from(f32::from_le_bytes(self.take()?)),
            Scalar::F64 => f64::from_le_bytes(self.take()?),
        })
    }

    /// The next N bytes in little-endian order.
    fn take<const N: usize>(&mut self) -> Option<[u8; N]> {
        let (head, rest) = self.bytes.split_first_chunk::<N>()?;
        self.bytes = rest;
        let mut out = *head;
        if self.encoding == Encoding::BigEndian {
            out.reverse();
        }
        Some(out)
    }
}
