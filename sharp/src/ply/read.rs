//! Tables to a scene.

use std::collections::BTreeMap;
use std::path::Path;

use super::marks::{foreign_format, has_logit_colors, other_form, other_rule};
use super::reading::{Marks, StoredColors, StoredForm, StoredOpacity, StoredScales};
use super::suspicions::{Suspicion, suspicions};
use super::table::{Body, Element, Header, TableError};
use super::{ColorSpace, GaussianScene, PlyError, PlyReason, VERTEX};
use crate::camera::Intrinsics;
use crate::gaussians::Gaussians;

/// Reads a scene from `path`.
///
/// Properties and elements may come in any order, in text or binary of either byte order. Needed
/// are `x y z f_dc_0..2 opacity scale_0..2 rot_0..3` of element `vertex`. Older forms of the
/// release's extra elements are understood: an `intrinsic` of four values (fx, fy, width, height)
/// and an `extrinsic` of twelve (3×4, its 3×3 part transposed). `reading` is how numbers are read
/// where that is not as 3D Gaussian Splatting stores them, and how colours are encoded where the
/// file does not say.
///
/// # Errors
/// [`PlyError`] with the path and the reason; [`PlyReason::ColorSpaceUnknown`] where neither says;
/// [`PlyReason::Foreign`], [`PlyReason::OtherForm`] and [`PlyReason::OtherRule`] for files whose
/// numbers would be misread.
pub fn load(path: &Path, reading: impl Into<StoredForm>) -> Result<GaussianScene, PlyError> {
    let read = || {
        let bytes = crate::files::read(path)?;
        from_bytes(&bytes, reading).map_err(|reason| match reason {
            PlyReason::Table(TableError::NotPly) => {
                let name = path.file_name().unwrap_or_default().to_string_lossy();
                let foreign = foreign_format(&bytes, &name);
                foreign.map_or(TableError::NotPly.into(), PlyReason::Foreign)
            }
            other => other,
        })
    };
    read().map_err(|reason| PlyError::new(path, reason))
}

/// Like [`load`], from a file's bytes.
///
/// # Errors
/// [`PlyReason`].
pub fn from_bytes(bytes: &[u8], given: impl Into<StoredForm>) -> Result<GaussianScene, PlyReason> {
    let given: StoredForm = given.into();
    let (header, mut body) = Header::parse(bytes)?;
    let mut doubts = Vec::new();
    let surplus = body.surplus(&header);
    let mut vertices = None;
    let mut extras = Extras::new();
    for element in &header.elements {
        if element.name == "vertex" && vertices.is_none() {
            if let Some(rows) = surplus.and_then(|bytes| longer_rows(bytes, element.count)) {
                return Err(rows);
            }
            vertices = Some(gaussians(&mut body, &header, element, &given)?);
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
    let Vertices {
        stored: mut gaussians,
        count,
        color_coefficients,
        is_view_dependent,
    } = vertices.ok_or(PlyReason::NoVertices)?;
    let rest = body.rest();
    if !rest.trim_ascii().is_empty() {
        if let Some(rows) = longer_rows(rest.len(), count).filter(|_| surplus.is_none()) {
            return Err(rows);
        }
        let text = format!(
            "{} bytes follow the last row that its header announces: was it written by another program than its header, or \
             two files joined?",
            rest.len()
        );
        doubts.push(Suspicion::new("trailing bytes", text));
    }
    let stated = color_space(&header, &extras)?;
    let reading = match (stated, given.color_space) {
        (Some(stated), Some(given)) if stated != given => {
            return Err(PlyReason::ColorSpaceContradicted { stated, given });
        }
        (stated, given_space) => StoredForm {
            color_space: stated.or(given_space),
            ..given
        },
    };
    let reading = reading.of_ply();
    doubts.extend(suspicions(&gaussians, &given, &reading));
    check_stored(&gaussians, &reading)?;
    if reading.color_space.is_none() {
        return Err(PlyReason::ColorSpaceUnknown);
    }
    reading.decode(&mut gaussians);
    Ok(GaussianScene {
        gaussians,
        intrinsics: intrinsics(&extras)?,
        extrinsics: extrinsics(&extras)?,
        color_space: stated,
        version: extra(&extras, "version")
            .and_then(|v| <[f64; 3]>::try_from(v).ok())
            .map(|v| v.map(|x| x as u8)),
        color_coefficients,
        is_view_dependent,
        reading,
        doubts,
    })
}

/// Refuses values that a reading which was asked for cannot have.
///
/// # Errors
/// [`PlyReason::Impossible`].
pub fn check_stored(stored: &Gaussians, reading: &StoredForm) -> Result<(), PlyReason> {
    let impossible = |what, value: f32, advice| PlyReason::Impossible {
        what,
        value,
        advice,
    };
    let mut opacities = stored.opacities.iter().copied();
    let outside = |o: &f32| !(-1e-4..=1.0001).contains(o) && !o.is_nan();
    if reading.opacity == Some(StoredOpacity::Linear)
        && let Some(value) = opacities.find(outside)
    {
        return Err(impossible(
            "an opacity",
            value,
            "`opacity=logit` reads logits",
        ));
    }
    let mut scales = stored.scales.as_flattened().iter().copied();
    if reading.scales == Some(StoredScales::Linear)
        && let Some(value) = scales.find(|s| *s < 0.0)
    {
        let advice = "`scales=log` reads logarithms";
        return Err(impossible("a standard deviation", value, advice));
    }
    Ok(())
}

/// The reason to refuse rows that are longer than the header says: bytes that are left over share out evenly.
fn longer_rows(surplus: usize, count: usize) -> Option<PlyReason> {
    // A few bytes share out among a few rows by chance.
    let is_padding = count >= 20 && surplus > 0 && surplus.is_multiple_of(count);
    is_padding.then(|| PlyReason::LongerRows {
        surplus,
        count,
        each: surplus / count,
    })
}

/// Elements of the release that are read besides the vertices, each with one property of its name.
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

/// Properties of element `vertex`.
struct Vertices {
    /// As stored.
    stored: Gaussians,
    count: usize,
    color_coefficients: usize,
    is_view_dependent: bool,
}

/// Properties of colours that are not coefficients.
const RGB: [&str; 3] = ["red", "green", "blue"];

fn gaussians(
    body: &mut Body<'_>,
    header: &Header,
    element: &Element,
    given: &StoredForm,
) -> Result<Vertices, PlyReason> {
    let mut names = VERTEX;
    if given.colors == Some(StoredColors::Rgb255) && element.number("f_dc_0").is_none() {
        names[3..6].copy_from_slice(&RGB);
    } else if let Some(form) = other_form(header, element) {
        return Err(PlyReason::OtherForm(form));
    }
    let columns = names.map(|name| element.number(name));
    let missing = names.into_iter().zip(columns).filter(|(_, c)| c.is_none());
    let missing: Vec<_> = missing.map(|(name, _)| name).collect();
    if !missing.is_empty() {
        return Err(PlyReason::Missing(missing));
    }
    if given.marks != Some(Marks::Ignore)
        && let Some(rule) = other_rule(header, element)
    {
        return Err(PlyReason::OtherRule(rule));
    }
    let columns = columns.map(Option::unwrap_or_default);
    let rest = element.properties.iter().map(|p| &p.name);
    let rest = rest.filter(|name| name.starts_with("f_rest_"));
    let rest: Vec<usize> = rest.filter_map(|name| element.number(name)).collect();
    if given.colors.is_none() && has_logit_colors(header, rest.len()) {
        return Err(PlyReason::LogitColors);
    }
    let mut out = Gaussians::default();
    let mut is_view_dependent = false;
    body.rows::<TableError>(element, |row| {
        let c = columns.map(|index| row.number(index) as f32);
        out.means.push([c[0], c[1], c[2]]);
        out.colors.push([c[3], c[4], c[5]]);
        out.opacities.push(c[6]);
        out.scales.push([c[7], c[8], c[9]]);
        out.quaternions.push([c[10], c[11], c[12], c[13]]);
        is_view_dependent |= rest.iter().any(|&index| row.number(index) != 0.0);
        Ok(())
    })?;
    Ok(Vertices {
        stored: out,
        count: element.count,
        color_coefficients: rest.len(),
        is_view_dependent,
    })
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
        // Legacy: no principal point, so the middle of the image.
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
                // The release's writer puts the principal point into the middle.
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
    // `as` saturates and maps NaN to 0, which the camera then refuses.
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
