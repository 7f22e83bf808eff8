//! Points and triangles of PLY files (laser scans, meshes). Other properties and elements are skipped.

use glam::Vec3;
use sharp::ply::table::{Body, Element, Header};

use super::FormatError;

/// Points and, for a mesh, triangles between them.
#[derive(Debug, Clone, Default, PartialEq)]
pub struct Geometry {
    /// Positions in the file's units.
    pub points: Vec<Vec3>,
    /// Indices into `points`; faces with more than three corners are split into fans. Empty for a scan.
    pub triangles: Vec<[u32; 3]>,
}

/// Parses a PLY file.
///
/// # Errors
/// If the file is not a PLY, has no vertices with x, y and z, or has fewer bytes than its header requires; also if a
/// face refers to a missing vertex.
pub fn parse(bytes: &[u8]) -> Result<Geometry, FormatError> {
    let (header, mut body) = Header::parse(bytes)?;
    let mut geometry = Geometry::default();
    for element in &header.elements {
        match element.name.as_str() {
            "vertex" => read_vertices(element, &mut body, &mut geometry.points)?,
            "face" => read_faces(element, &mut body, &mut geometry.triangles)?,
            // The remaining elements are not needed, so they may be of any kind.
            _ if !geometry.points.is_empty() => break,
            _ => body.rows(element, |_| Ok::<_, FormatError>(()))?,
        }
    }
    if geometry.points.is_empty() {
        return Err("there are no vertices".into());
    }
    let count = geometry.points.len();
    let wrong = |t: &&[u32; 3]| t.iter().any(|i| *i as usize >= count);
    if let Some(triangle) = geometry.triangles.iter().find(wrong) {
        return Err(invalid!(
            "a face refers to the vertices {triangle:?}, but there are only {count}"
        ));
    }
    Ok(geometry)
}

fn read_vertices(
    element: &Element,
    body: &mut Body<'_>,
    points: &mut Vec<Vec3>,
) -> Result<(), FormatError> {
    let place = |name: &str| {
        let found = element.number(name);
        found.ok_or_else(|| invalid!("the vertices have no property '{name}'"))
    };
    let places = [place("x")?, place("y")?, place("z")?];
    body.rows(element, |row| {
        points.push(Vec3::from(places.map(|i| row.number(i) as f32)));
        Ok(())
    })
}

fn read_faces(
    element: &Element,
    body: &mut Body<'_>,
    triangles: &mut Vec<[u32; 3]>,
) -> Result<(), FormatError> {
    const MAX_CORNERS: usize = 1024;
    let list = element.list("vertex_indices");
    let list = list.or_else(|| element.list("vertex_index"));
    body.rows(element, |row| {
        let corners = list.map_or(&[][..], |list| row.property(list));
        if corners.len() > MAX_CORNERS {
            return Err(invalid!(
                "a face has {} corners, but at most {MAX_CORNERS} are supported",
                corners.len()
            ));
        }
        let range = 0.0..=f64::from(u32::MAX);
        if let Some(corner) = corners.iter().find(|i| !range.contains(*i)) {
            return Err(invalid!(
                "a face refers to vertex {corner}, which cannot exist"
            ));
        }
        for pair in corners.get(1..).unwrap_or_default().windows(2) {
            triangles.push([corners[0], pair[0], pair[1]].map(|i| i as u32));
        }
        Ok(())
    })
}

#[cfg(test)]
mod tests {
    use sharp::ply::table::TableError;

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
        let xyz = "property float x\nproperty float y\nproperty float z\n";
        assert_eq!(parse(b"obj"), Err(TableError::NotPly.into()));
        assert!(matches!(
            parse(b"ply\nformat ascii 1.0\n"),
            Err(FormatError::Ply(TableError::Header { line: 3, .. }))
        ));
        let header = with(&format!("element vertex 99999999999\n{xyz}"));
        assert!(matches!(
            parse(header.as_bytes()),
            Err(FormatError::Ply(TableError::Truncated {
                count: 99_999_999_999,
                ..
            }))
        ));
        for (text, reason) in [
            (with(""), "no vertices"),
            (with("element vertex 5\n"), "no property 'x'"),
            (
                with("element vertex 0\nproperty float x\n"),
                "no property 'y'",
            ),
            (with(&format!("element vertex 0\n{xyz}")), "no vertices"),
        ] {
            let error = parse(text.as_bytes()).unwrap_err().to_string();
            assert!(error.to_string().contains(reason), "{error}");
        }
        let bad_face = "ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty float y\n\
            property float z\nelement face 1\nproperty list uchar int vertex_indices\nend_header\n\
            0 0 0\n3 0 0 1\n";
        let error = parse(bad_face.as_bytes()).unwrap_err().to_string();
        assert!(
            error.to_string().contains("refers to the vertices"),
            "{error}"
        );
    }
}
