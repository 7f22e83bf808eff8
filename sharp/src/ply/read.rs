//! Tables to a scene.

use std::collections::BTreeMap;
use std::path::Path;

use super::table::{Body, Element, Header, TableError};
use super::{ColorSpace, GaussianScene, PlyError, PlyReason, SH_CONSTANT, VERTEX};
use crate::camera::Intrinsics;
use crate::color::linear_from_srgb;
use crate::gaussians::Gaussians;

/// Reads a scene from `path`.
///
/// Properties and elements may come in any order, in text or binary of either byte order. Needed
/// are `x y z f_dc_0..2 opacity scale_0..2 rot_0..3` of element `vertex`. Older forms of the
/// release's extra elements are understood: an `intrinsic` of four values (fx, fy, width, height)
/// and an `extrinsic` of twelve (3×4, its 3×3 part transposed). `color_space` is how colours are
/// encoded where the file does not say.
///
/// # Errors
/// [`PlyError`] with the path and the reason; [`PlyReason::ColorSpaceUnknown`] where neither says.
pub fn load(path: &Path, color_space: Option<ColorSpace>) -> Result<GaussianScene, PlyError> {
    crate::files::read(path)
        .map_err(PlyReason::from)
        .and_then(|bytes| from_bytes(&bytes, color_space))
        .map_err(|reason| PlyError::new(path, reason))
}

/// As [`load`], from a file's bytes.
///
/// # Errors
/// [`PlyReason`].
pub fn from_bytes(bytes: &[u8], given: Option<ColorSpace>) -> Result<GaussianScene, PlyReason> {
    let (header, mut body) = Header::parse(bytes)?;
    let mut vertices = None;
    let mut extras = Extras::new();
    for element in &header.elements {
        if element.name == "vertex" && vertices.is_none() {
            vertices = Some(gaussians(&mut body, element)?);
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
        mut gaussians,
        color_coefficients,
        is_view_dependent,
    } = vertices.ok_or(PlyReason::NoVertices)?;
    let stated = color_space(&header, &extras)?;
    let color_space = match (stated, given) {
        (Some(stated), Some(given)) if stated != given => {
            return Err(PlyReason::ColorSpaceContradicted { stated, given });
        }
        (stated, given) => stated.or(given).ok_or(PlyReason::ColorSpaceUnknown)?,
    };
    // The element that says how colours are encoded follows them.
    for color in gaussians.colors.as_flattened_mut() {
        let stored = *color * SH_CONSTANT + 0.5;
        *color = match color_space {
            ColorSpace::Srgb => linear_from_srgb(stored),
            ColorSpace::Linear => stored,
        };
    }
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

/// What element `vertex` holds.
struct Vertices {
    /// Their colours are still coefficients.
    gaussians: Gaussians,
    color_coefficients: usize,
    is_view_dependent: bool,
}

fn gaussians(body: &mut Body<'_>, element: &Element) -> Result<Vertices, PlyReason> {
    let columns = VERTEX.map(|name| element.number(name));
    let missing = VERTEX.into_iter().zip(columns).filter(|(_, c)| c.is_none());
    let missing: Vec<_> = missing.map(|(name, _)| name).collect();
    if !missing.is_empty() {
        return Err(PlyReason::Missing(missing));
    }
    let columns = columns.map(Option::unwrap_or_default);
    let rest = element.properties.iter().map(|p| &p.name);
    let rest = rest.filter(|name| name.starts_with("f_rest_"));
    let rest: Vec<usize> = rest.filter_map(|name| element.number(name)).collect();
    let mut out = Gaussians::default();
    let mut is_view_dependent = false;
    body.rows::<TableError>(element, |row| {
        let c = columns.map(|index| row.number(index));
        out.means.push([c[0], c[1], c[2]].map(|v| v as f32));
        out.colors.push([c[3], c[4], c[5]].map(|v| v as f32));
        out.opacities.push((1.0 / (1.0 + (-c[6]).exp())) as f32);
        out.scales.push([c[7], c[8], c[9]].map(|v| v.exp() as f32));
        out.quaternions
            .push([c[10], c[11], c[12], c[13]].map(|v| v as f32));
        is_view_dependent |= rest.iter().any(|&index| row.number(index) != 0.0);
        Ok(())
    })?;
    Ok(Vertices {
        gaussians: out,
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
