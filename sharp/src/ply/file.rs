//! The tables of a PLY file, column by column, as f64 (which holds every PLY type exactly).

use super::PlyReason;
use super::header::{Element, Encoding, Header, Scalar};

/// One element's columns; list properties have an empty one.
#[derive(Debug)]
pub(super) struct Table {
    pub(super) element: Element,
    pub(super) columns: Vec<Vec<f64>>,
}

/// Reads the tables that `wanted` asks for by element and property, skipping all other data.
/// Memory is bounded by the file: a column is allocated only after its bytes are known to exist.
pub(super) fn tables(
    bytes: &[u8],
    header: &Header,
    wanted: impl Fn(&str, &str) -> bool,
) -> Result<Vec<Table>, PlyReason> {
    let mut cursor = Cursor {
        bytes: &bytes[header.data..],
        encoding: header.encoding,
    };
    let mut tables = Vec::new();
    for element in &header.elements {
        let keep: Vec<bool> = element
            .properties
            .iter()
            .map(|p| p.list_count.is_none() && wanted(&element.name, &p.name))
            .collect();
        let columns = cursor.table(element, &keep)?;
        tables.push(Table {
            element: element.clone(),
            columns,
        });
    }
    Ok(tables)
}

struct Cursor<'a> {
    bytes: &'a [u8],
    encoding: Encoding,
}

impl<'a> Cursor<'a> {
    fn table(&mut self, element: &Element, keep: &[bool]) -> Result<Vec<Vec<f64>>, PlyReason> {
        let truncated = || PlyReason::Truncated {
            element: element.name.clone(),
            count: element.count,
        };
        // The fewest bytes a row can have: a list its count, a number in text a digit and a blank.
        let least: usize = element
            .properties
            .iter()
            .map(|p| match self.encoding {
                Encoding::Ascii => 2,
                _ => p.list_count.unwrap_or(p.scalar).size(),
            })
            .sum();
        if least == 0 {
            // Rows without properties take no bytes, however many the header claims.
            return Ok(Vec::new());
        }
        // The last number of a text file may lack its blank.
        if element.count > (self.bytes.len() + 1) / least {
            return Err(truncated());
        }
        let mut columns: Vec<Vec<f64>> = keep
            .iter()
            .map(|&k| Vec::with_capacity(if k { element.count } else { 0 }))
            .collect();
        for row in 0..element.count {
            for (index, property) in element.properties.iter().enumerate() {
                let mut number = |scalar| match self.encoding {
                    Encoding::Ascii => self.text(element, row).transpose(),
                    _ => self.binary(scalar).map(Ok),
                };
                if let Some(count) = property.list_count {
                    let length = number(count).ok_or_else(truncated)??;
                    // Each step consumes bytes, so a lying count ends at the end of the file.
                    for _ in 0..length.max(0.0) as u64 {
                        number(property.scalar).ok_or_else(truncated)??;
                    }
                } else {
                    let value = number(property.scalar).ok_or_else(truncated)??;
                    if keep[index] {
                        columns[index].push(value);
                    }
                }
            }
        }
        Ok(columns)
    }

    /// The next word as a number; `None` at the end of the file.
    fn text(&mut self, element: &Element, row: usize) -> Result<Option<f64>, PlyReason> {
        let start = match self.bytes.iter().position(|b| !b.is_ascii_whitespace()) {
            Some(start) => start,
            None => return Ok(None),
        };
        let rest = &self.bytes[start..];
        let end = rest
            .iter()
            .position(u8::is_ascii_whitespace)
            .unwrap_or(rest.len());
        let (word, after) = rest.split_at(end);
        self.bytes = after;
        std::str::from_utf8(word)
            .ok()
            .and_then(|w| w.parse().ok())
            .map(Some)
            .ok_or_else(|| PlyReason::NotANumber {
                element: element.name.clone(),
                row,
                word: String::from_utf8_lossy(&word[..word.len().min(40)]).into_owned(),
            })
    }

    fn binary(&mut self, scalar: Scalar) -> Option<f64> {
        let swap = self.encoding == Encoding::BigEndian;
        Some(match scalar {
            Scalar::I8 => f64::from(i8::from_le_bytes(self.take(swap)?)),
            Scalar::U8 => f64::from(u8::from_le_bytes(self.take(swap)?)),
            Scalar::I16 => f64::from(i16::from_le_bytes(self.take(swap)?)),
            Scalar::U16 => f64::from(u16::from_le_bytes(self.take(swap)?)),
            Scalar::I32 => f64::from(i32::from_le_bytes(self.take(swap)?)),
            Scalar::U32 => f64::from(u32::from_le_bytes(self.take(swap)?)),
            Scalar::F32 => f64::from(f32::from_le_bytes(self.take(swap)?)),
            Scalar::F64 => f64::from_le_bytes(self.take(swap)?),
        })
    }

    /// The next N bytes in little-endian order.
    fn take<const N: usize>(&mut self, swap: bool) -> Option<[u8; N]> {
        let (head, rest) = self.bytes.split_first_chunk::<N>()?;
        self.bytes = rest;
        let mut out = *head;
        if swap {
            out.reverse();
        }
        Some(out)
    }
}
