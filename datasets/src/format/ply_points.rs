//! Points and triangles of PLY files (laser scans, meshes): ASCII and binary, either byte order.
//! Other properties and elements are passed over.

use std::path::Path;

use glam::Vec3;

use crate::{DatasetError, files};

/// Points and, for a mesh, triangles between them.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Geometry {
    /// Positions in the file's units.
    pub points: Vec<Vec3>,
    /// Indices into `points`; faces with more corners are cut into fans. Empty for a scan.
    pub triangles: Vec<[u32; 3]>,
}

/// Reads a PLY file.
///
/// # Errors
/// Names the file: not PLY, no vertices with x, y, z, fewer bytes than the header promises, a
/// face that names a vertex there is not.
pub fn read(path: &Path) -> Result<Geometry, DatasetError> {
    parse(&files::read(path)?).map_err(|reason| DatasetError::malformed(path, reason))
}

/// As [`read`], from bytes; the error is the bare reason.
///
/// # Errors
/// See [`read`].
pub fn parse(bytes: &[u8]) -> Result<Geometry, String> {
    let (header, body) = Header::parse(bytes)?;
    let mut data = match header.encoding {
        Encoding::Ascii => Data::Text(
            std::str::from_utf8(body)
                .map_err(|_| "the body is not ASCII")?
                .split_ascii_whitespace(),
        ),
        Encoding::Little => Data::Binary(body, false),
        Encoding::Big => Data::Binary(body, true),
    };
    let mut geometry = Geometry::default();
    for element in &header.elements {
        element.check_fits(&data)?;
        match element.name.as_str() {
            "vertex" => read_vertices(element, &mut data, &mut geometry.points)?,
            "face" => read_faces(element, &mut data, &mut geometry.triangles)?,
            // Nothing of use can follow, and other elements may be of any kind.
            _ if !geometry.points.is_empty() => break,
            _ => {
                for _ in 0..element.count {
                    for property in &element.properties {
                        property.skip(&mut data)?;
                    }
                }
            }
        }
    }
    if geometry.points.is_empty() {
        return Err("there are no vertices".into());
    }
    let count = geometry.points.len();
    let wrong = |t: &&[u32; 3]| t.iter().any(|i| *i as usize >= count);
    if let Some(triangle) = geometry.triangles.iter().find(wrong) {
        return Err(format!("a face names the vertices {triangle:?} of {count}"));
    }
    Ok(geometry)
}

fn read_vertices(
    element: &Element,
    data: &mut Data<'_>,
    points: &mut Vec<Vec3>,
) -> Result<(), String> {
    let place = |name: &str| {
        element
            .properties
            .iter()
            .position(|p| p.name == name && p.count_kind.is_none())
            .ok_or_else(|| format!("the vertices have no property '{name}'"))
    };
    let places = [place("x")?, place("y")?, place("z")?];
    for _ in 0..element.count {
        let mut point = [0.0; 3];
        for (i, property) in element.properties.iter().enumerate() {
            match places.iter().position(|p| *p == i) {
                Some(axis) => point[axis] = data.number(property.kind)? as f32,
                None => property.skip(data)?,
            }
        }
        points.push(Vec3::from(point));
    }
    Ok(())
}

fn read_faces(
    element: &Element,
    data: &mut Data<'_>,
    triangles: &mut Vec<[u32; 3]>,
) -> Result<(), String> {
    for _ in 0..element.count {
        for property in &element.properties {
            let is_corners = matches!(property.name.as_str(), "vertex_indices" | "vertex_index");
            let (Some(count_kind), true) = (property.count_kind, is_corners) else {
                property.skip(data)?;
                continue;
            };
            let corners = data.number(count_kind)?;
            if !(0.0..=1024.0).contains(&corners) {
                return Err(format!("a face has {corners} corners"));
            }
            let corners = (0..corners as usize)
                .map(|_| match data.number(property.kind)? {
                    i if i >= 0.0 && i <= f64::from(u32::MAX) => Ok(i as u32),
                    i => Err(format!("a face names vertex {i}")),
                })
                .collect::<Result<Vec<_>, _>>()?;
            for i in 2..corners.len() {
                triangles.push([corners[0], corners[i - 1], corners[i]]);
            }
        }
    }
    Ok(())
}

#[derive(Clone, Copy, PartialEq)]
enum Encoding {
    Ascii,
    Little,
    Big,
}

struct Header {
    encoding: Encoding,
    elements: Vec<Element>,
}

struct Element {
    name: String,
    count: usize,
    properties: Vec<Property>,
}

struct Property {
    name: String,
    /// Type of a list's length; `None` for a single number.
    count_kind: Option<Kind>,
    kind: Kind,
}

#[derive(Clone, Copy)]
struct Kind {
    letter: u8,
    size: usize,
}

impl Header {
    fn parse(bytes: &[u8]) -> Result<(Self, &[u8]), String> {
        if !bytes.starts_with(b"ply") {
            return Err("not a PLY file: it does not begin with 'ply'".into());
        }
        let mut header = Self {
            encoding: Encoding::Ascii,
            elements: Vec::new(),
        };
        let mut rest = bytes;
        loop {
            let end = rest
                .iter()
                .take(4096)
                .position(|b| *b == b'\n')
                .ok_or("the header does not end")?;
            let line = String::from_utf8_lossy(&rest[..end]).into_owned();
            rest = &rest[end + 1..];
            let words: Vec<_> = line.split_ascii_whitespace().collect();
            match words.as_slice() {
                ["end_header"] => return Ok((header, rest)),
                ["format", kind, _] => {
                    header.encoding = match *kind {
                        "ascii" => Encoding::Ascii,
                        "binary_little_endian" => Encoding::Little,
                        "binary_big_endian" => Encoding::Big,
                        other => return Err(format!("unknown encoding '{other}'")),
                    };
                }
                ["element", name, count] => header.elements.push(Element {
                    name: (*name).to_owned(),
                    count: count
                        .parse()
                        .map_err(|_| format!("element {name} counts '{count}'"))?,
                    properties: Vec::new(),
                }),
                ["property", rest @ ..] => {
                    let property = Property::parse(rest)?;
                    header
                        .elements
                        .last_mut()
                        .ok_or("a property before the first element")?
                        .properties
                        .push(property);
                }
                [] | ["ply" | "comment" | "obj_info", ..] => {}
                other => return Err(format!("header line '{}' is not known", other.join(" "))),
            }
        }
    }
}

impl Element {
    /// Refuses a count that the rest of the file cannot hold, before anything is read.
    fn check_fits(&self, data: &Data<'_>) -> Result<(), String> {
        let (each, available) = match data {
            Data::Binary(rest, _) => (
                self.properties
                    .iter()
                    .map(|p| p.count_kind.unwrap_or(p.kind).size)
                    .sum::<usize>(),
                rest.len(),
            ),
            // Text is read token by token and ends when it ends.
            Data::Text(_) => return Ok(()),
        };
        if self.properties.is_empty() && self.count > 0 {
            return Err(format!("element {} has no properties", self.name));
        }
        if self.count.checked_mul(each).is_none_or(|n| n > available) {
            return Err(format!(
                "{} {}s take more than the {available} bytes that follow (truncated?)",
                self.count, self.name
            ));
        }
        Ok(())
    }
}

impl Property {
    fn parse(words: &[&str]) -> Result<Self, String> {
        let kind = |word: &str| {
            let (letter, size) = match word {
                "char" | "int8" => (b'i', 1),
                "uchar" | "uint8" => (b'u', 1),
                "short" | "int16" => (b'i', 2),
                "ushort" | "uint16" => (b'u', 2),
                "int" | "int32" => (b'i', 4),
                "uint" | "uint32" => (b'u', 4),
                "float" | "float32" => (b'f', 4),
                "double" | "float64" => (b'f', 8),
                other => return Err(format!("unknown property type '{other}'")),
            };
            Ok(Kind { letter, size })
        };
        match words {
            ["list", count, item, name] => Ok(Self {
                name: (*name).to_owned(),
                count_kind: Some(kind(count)?),
                kind: kind(item)?,
            }),
            [item, name] => Ok(Self {
                name: (*name).to_owned(),
                count_kind: None,
                kind: kind(item)?,
            }),
            other => Err(format!("property '{}' is not known", other.join(" "))),
        }
    }

    fn skip(&self, data: &mut Data<'_>) -> Result<(), String> {
        let count = match self.count_kind {
            None => 1.0,
            Some(kind) => data.number(kind)?,
        };
        if !(0.0..=1e6).contains(&count) {
            return Err(format!("a list '{}' of {count} items", self.name));
        }
        for _ in 0..count as usize {
            data.number(self.kind)?;
        }
        Ok(())
    }
}

enum Data<'a> {
    Text(std::str::SplitAsciiWhitespace<'a>),
    Binary(&'a [u8], bool),
}

impl Data<'_> {
    fn number(&mut self, kind: Kind) -> Result<f64, String> {
        const SHORT: &str = "the body ends early (truncated?)";
        match self {
            Self::Text(tokens) => {
                let token = tokens.next().ok_or(SHORT)?;
                token
                    .parse()
                    .map_err(|_| format!("'{token}' is not a number"))
            }
            Self::Binary(rest, big_endian) => {
                let (bytes, after) = rest.split_at_checked(kind.size).ok_or(SHORT)?;
                *rest = after;
                let mut b = [0; 8];
                b[..kind.size].copy_from_slice(bytes);
                if *big_endian {
                    b[..kind.size].reverse();
                }
                let whole = u64::from_le_bytes(b);
                let unused = 64 - 8 * kind.size as u32;
                Ok(match (kind.letter, kind.size) {
                    (b'f', 4) => f64::from(f32::from_bits(whole as u32)),
                    (b'f', _) => f64::from_bits(whole),
                    (b'i', _) => ((whole << unused) as i64 >> unused) as f64,
                    _ => whole as f64,
                })
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scans_and_meshes_are_read_in_every_encoding() {
        let ascii = "ply\nformat ascii 1.0\ncomment hand made\nelement vertex 3\nproperty float x\n\
            property float y\nproperty uchar red\nproperty double z\nelement face 1\n\
            property list uchar int vertex_indices\nend_header\n\
            0 0 255 1\n1 0 3 1.5\n0 -1 4 2e0\n3 0 1 2\n";
        let expected = Geometry {
            points: vec![
                Vec3::new(0.0, 0.0, 1.0),
                Vec3::new(1.0, 0.0, 1.5),
                Vec3::new(0.0, -1.0, 2.0),
            ],
            triangles: vec![[0, 1, 2]],
        };
        assert_eq!(parse(ascii.as_bytes()).unwrap(), expected);
        for big in [false, true] {
            let name = if big { "big" } else { "little" };
            let mut bytes = ascii
                .split("0 0 255")
                .next()
                .unwrap()
                .replace("ascii", &format!("binary_{name}_endian"))
                .into_bytes();
            let mut push = |le: &[u8]| {
                let mut b = le.to_vec();
                if big {
                    b.reverse();
                }
                bytes.extend(b);
            };
            for p in &expected.points {
                push(&p.x.to_le_bytes());
                push(&p.y.to_le_bytes());
                push(&[9]);
                push(&f64::from(p.z).to_le_bytes());
            }
            push(&[3]);
            for i in 0..3_i32 {
                push(&i.to_le_bytes());
            }
            assert_eq!(parse(&bytes).unwrap(), expected, "{name}");
            assert!(parse(&bytes[..bytes.len() - 1]).is_err());
        }
    }

    #[test]
    fn hostile_headers_are_refused() {
        let with =
            |lines: &str| format!("ply\nformat binary_little_endian 1.0\n{lines}end_header\n");
        for (text, reason) in [
            ("obj".to_owned(), "not a PLY"),
            ("ply\nformat ascii 1.0\n".to_owned(), "does not end"),
            (with(""), "no vertices"),
            (
                with(
                    "element vertex 99999999999\nproperty float x\nproperty float y\nproperty float z\n",
                ),
                "truncated",
            ),
            (with("element vertex 5\n"), "no properties"),
            (
                with("element vertex 0\nproperty float x\n"),
                "no property 'y'",
            ),
            (with("property float x\n"), "before the first element"),
            (with("element vertex -1\n"), "counts '-1'"),
        ] {
            let error = parse(text.as_bytes()).unwrap_err();
            assert!(error.contains(reason), "{error}");
        }
        let bad_face = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n\
            property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n\
            0 0 0\n3 0 0 1\n";
        assert!(
            parse(bad_face.as_bytes())
                .unwrap_err()
                .contains("names the vertices")
        );
    }
}
