//! Conversion of PLY tables to a scene.

use std::collections::BTreeMap;

use super::decoded::{Decoded, degree_of};
use super::marks::{FileMarks, Generator, other_form};
use super::reading::{Marks, StoredColors, StoredForm};
use super::suspicions::Suspicion;
use super::table::{Body, Element, Header, Scalar, TableError};
use super::{ColorSpace, GaussianScene, PlyReason, VERTEX, compressed};
use crate::camera::Intrinsics;

/// Parses the bytes of a PLY file.
///
/// Properties and elements may come in any order, in text or binary of either byte order. The element `vertex` must
/// have the properties `x y z f_dc_0..2 opacity scale_0..2 rot_0..3`; PlayCanvas' compressed elements can replace it.
///
/// Older forms of the SHARP release's extra elements are supported: an `intrinsic` of four values (fx, fy, width,
/// height) and an `extrinsic` of twelve (3×4, with its 3×3 part transposed).
///
/// `given` overrides the encodings of 3D Gaussian Splatting, and sets the colour encoding of files
/// that do not state theirs.
///
/// # Errors
/// [`PlyReason`] for a malformed or incomplete file; [`PlyReason::ColorSpaceUnknown`] if neither the file nor `given`
/// states the encoding; [`PlyReason::OtherForm`] and [`PlyReason::OtherRule`] for files whose numbers would be
/// misinterpreted.
pub fn from_bytes(bytes: &[u8], given: impl Into<StoredForm>) -> Result<GaussianScene, PlyReason> {
    let given: StoredForm = given.into();
    let (header, mut body) = Header::parse(bytes)?;
    if compressed::is_compressed(&header) {
        return compressed::decode(&header, body)?.scene(&given);
    }
    let mut doubts = Vec::new();
    let surplus = body.surplus(&header);
    let mut vertices = None;
    let mut extras = Extras::new();
    for element in &header.elements {
        if element.name == "vertex" && vertices.is_none() {
            if let Some(rows) = surplus.and_then(|bytes| longer_rows(bytes, element.count)) {
                return Err(rows);
            }
            vertices = Some((element, gaussians(&mut body, &header, element, &given)?));
            continue;
        }
        let mut values = Vec::new();
        let wanted = EXTRAS
            .contains(&element.name.as_str())
            .then(|| element.number(&element.name))
            .flatten();
        body.rows::<TableError>(element, |row| {
            values.extend(wanted.map(|index| row.number(index)));
            Ok(())
        })?;
        if wanted.is_some() {
            extras.entry(&element.name).or_insert(values);
        }
    }
    let (vertex, mut decoded) = vertices.ok_or(PlyReason::NoVertices)?;
    let rest = body.rest();
    if !rest.trim_ascii().is_empty() {
        if let Some(rows) = longer_rows(rest.len(), vertex.count).filter(|_| surplus.is_none()) {
            return Err(rows);
        }
        let text = format!(
            "{} bytes follow the last row announced by its header; perhaps the header belongs to another file, or \
             two files were joined",
            rest.len()
        );
        doubts.push(Suspicion::new("trailing bytes", text));
    }
    decoded.stated = color_space(&header, &extras)?;
    decoded.marks = FileMarks::of_ply(&header, vertex, decoded.stated);
    decoded.doubts = doubts;
    decoded.intrinsics = intrinsics(&extras)?;
    decoded.extrinsics = extrinsics(&extras)?;
    decoded.version = extra(&extras, "version")
        .and_then(|v| <[f64; 3]>::try_from(v).ok())
        .map(|v| v.map(|x| x as u8));
    decoded.scene(&given)
}

/// The error for a file whose rows are longer than its header states. This is assumed if the file has at least 20 rows,
/// and the number of surplus bytes is a multiple of the number of rows; otherwise `None`.
fn longer_rows(surplus: usize, count: usize) -> Option<PlyReason> {
    // With few rows, the surplus may be a multiple of the count by chance.
    let is_padding = count >= 20 && surplus > 0 && surplus.is_multiple_of(count);
    is_padding.then(|| PlyReason::LongerRows {
        surplus,
        count,
        each: surplus / count,
    })
}

/// Elements of the SHARP release that are read in addition to the vertices; each has one property with
/// the element's name.
const EXTRAS: [&str; 5] = [
    "extrinsic",
    "intrinsic",
    "image_size",
    "color_space",
    "version",
];

type Extras<'a> = BTreeMap<&'a str, Vec<f64>>;

fn extra<'a>(extras: &'a Extras<'_>, name: &str) -> Option<&'a [f64]> {
    extras.get(name).map(Vec::as_slice)
}

/// Properties of colours that are not spherical-harmonics coefficients.
const RGB: [&str; 3] = ["red", "green", "blue"];

fn gaussians(
    body: &mut Body<'_>,
    header: &Header,
    element: &Element,
    given: &StoredForm,
) -> Result<Decoded, PlyReason> {
    let mut names = VERTEX;
    let mut form = StoredForm::ply();
    let is_byte = |name: &str| {
        let index = element.number(name);
        index.is_some_and(|index| element.properties[index].scalar == Scalar::U8)
    };
    let has_bytes = given.blending == ColorSpace::Srgb && RGB.into_iter().all(is_byte);
    let takes_rgb = match given.colors {
        Some(colors) => colors == StoredColors::Rgb255,
        None => has_bytes,
    };
    if takes_rgb && element.number("f_dc_0").is_none() {
        names[3..6].copy_from_slice(&RGB);
        form.colors = Some(StoredColors::Rgb255);
    } else if let Some(form) = other_form(element) {
        return Err(PlyReason::OtherForm(form));
    }
    let columns = names.map(|name| element.number(name));
    let missing = names.into_iter().zip(columns).filter(|(_, c)| c.is_none());
    let missing: Vec<_> = missing.map(|(name, _)| name).collect();
    if !missing.is_empty() {
        return Err(PlyReason::Missing(missing));
    }
    let marks = FileMarks::of_ply(header, element, None);
    if given.marks != Some(Marks::Ignore) {
        // Checked before reading the rows, of which there may be many.
        marks.check_rule(given)?;
    }
    let columns = columns.map(Option::unwrap_or_default);
    let rest = rest_columns(element, given.blending)?;
    let is_of_nerfstudio = marks.generator == Some(Generator::Nerfstudio);
    if given.colors.is_none() && !takes_rgb && rest.is_empty() && is_of_nerfstudio {
        return Err(PlyReason::LogitColors);
    }
    let filter = element.number("filter_3D");
    let mut out = Decoded {
        form,
        color_coefficients: rest.len(),
        ..Decoded::default()
    };
    let each = rest.len() / 3;
    let keeps_harmonics = given.blending == ColorSpace::Srgb;
    if keeps_harmonics {
        out.stored.harmonics.degree = degree_of(rest.len()).unwrap_or_default();
    }
    body.rows::<TableError>(element, |row| {
        let c = columns.map(|index| row.number(index) as f32);
        let stored = &mut out.stored;
        stored.means.push([c[0], c[1], c[2]]);
        stored.colors.push([c[3], c[4], c[5]]);
        stored.opacities.push(c[6]);
        stored.scales.push([c[7], c[8], c[9]]);
        stored.quaternions.push([c[10], c[11], c[12], c[13]]);
        out.filter_3d
            .extend(filter.map(|index| row.number(index) as f32));
        out.is_view_dependent |= rest.iter().any(|&index| row.number(index) != 0.0);
        if keeps_harmonics {
            // All coefficients of red come first, then green, then blue.
            let of =
                |k: usize| [0, 1, 2].map(|channel| row.number(rest[channel * each + k]) as f32);
            stored.harmonics.coefficients.extend((0..each).map(of));
        }
        Ok(())
    })?;
    Ok(out)
}

/// Columns of `f_rest_*`, in order of their numbers.
fn rest_columns(element: &Element, blending: ColorSpace) -> Result<Vec<usize>, PlyReason> {
    let numbered = element.properties.iter().filter_map(|property| {
        let number: usize = property.name.strip_prefix("f_rest_")?.parse().ok()?;
        Some((number, element.number(&property.name)?))
    });
    let mut numbered: Vec<(usize, usize)> = numbered.collect();
    numbered.sort_unstable();
    let is_complete = numbered
        .iter()
        .map(|(number, _)| *number)
        .eq(0..numbered.len());
    if blending == ColorSpace::Srgb && !(is_complete && degree_of(numbered.len()).is_some()) {
        return Err(PlyReason::Degree(numbered.len()));
    }
    Ok(numbered.into_iter().map(|(_, column)| column).collect())
}

fn color_space(header: &Header, extras: &Extras<'_>) -> Result<Option<ColorSpace>, PlyReason> {
    match extra(extras, "color_space") {
        Some([0.0]) => Ok(Some(ColorSpace::Srgb)),
        Some([1.0]) => Ok(Some(ColorSpace::Linear)),
        Some(other) => Err(PlyReason::Extra {
            element: "color_space",
            what: match other {
                [code] => format!("{code} is neither 0 (sRGB) nor 1 (linear)"),
                _ => format!("{} values instead of 1", other.len()),
            },
        }),
        None if header
            .comments
            .iter()
            .any(|c| c == super::write::SRGB_COMMENT) =>
        {
            Ok(Some(ColorSpace::Srgb))
        }
        None => Ok(None),
    }
}

fn intrinsics(extras: &Extras<'_>) -> Result<Option<Intrinsics>, PlyReason> {
    let Some(values) = extra(extras, "intrinsic") else {
        return Ok(None);
    };
    let (focal, center, size) = match *values {
        // Legacy form without a principal point: uses the image's centre.
        [fx, fy, width, height] => ((fx, fy), (width / 2.0, height / 2.0), [width, height]),
        [fx, _, cx, _, fy, cy, _, _, _] => {
            let size = match extra(extras, "image_size") {
                Some(&[width, height]) => [width, height],
                Some(other) => {
                    return Err(PlyReason::Extra {
                        element: "image_size",
                        what: format!("{} values instead of 2", other.len()),
                    });
                }
                // The SHARP release's writer puts the principal point in the centre of the image.
                None => [2.0 * cx, 2.0 * cy],
            };
            ((fx, fy), (cx, cy), size)
        }
        _ => {
            return Err(PlyReason::Extra {
                element: "intrinsic",
                what: format!("{} values instead of 9 or 4", values.len()),
            });
        }
    };
    // `as` saturates and maps NaN to 0, which the camera then rejects.
    let [width, height] = size.map(|v| v.round() as u32);
    Ok(Some(Intrinsics::new(focal, center, (width, height))?))
}

fn extrinsics(extras: &Extras<'_>) -> Result<Option<[f32; 16]>, PlyReason> {
    let Some(values) = extra(extras, "extrinsic") else {
        return Ok(None);
    };
    let mut matrix = [0.0; 16];
    match values.len() {
        16 => {
            for (to, from) in matrix.iter_mut().zip(values) {
                *to = *from as f32;
            }
        }
        12 => {
            matrix[15] = 1.0;
            for row in 0..3 {
                for column in 0..3 {
                    matrix[row * 4 + column] = values[column * 4 + row] as f32;
                }
                matrix[row * 4 + 3] = values[row * 4 + 3] as f32;
            }
        }
        other => {
            return Err(PlyReason::Extra {
                element: "extrinsic",
                what: format!("{other} values instead of 16 or 12"),
            });
        }
    }
    Ok(Some(matrix))
}
