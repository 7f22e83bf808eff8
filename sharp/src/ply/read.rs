//! Tables to a scene.

use std::path::Path;

use super::file::{Table, tables};
use super::header::Header;
use super::{ColorSpace, GaussianScene, PlyError, PlyReason, SH_CONSTANT};
use crate::camera::Intrinsics;
use crate::color::linear_from_srgb;
use crate::gaussians::Gaussians;

/// How to read what a file does not say.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct ReadOptions {
    /// Encoding of colours in a file that does not say. The default is the release's: linear.
    /// Most files of other programs hold values that were optimised in sRGB.
    pub default_color_space: ColorSpace,
}

/// Reads a scene from `path`.
///
/// Properties and elements may come in any order, in text or binary of either byte order. Needed
/// are `x y z f_dc_0..2 opacity scale_0..2 rot_0..3` of element `vertex`. Older forms of the
/// release's extra elements are understood: an `intrinsic` of four values (fx, fy, width, height)
/// and an `extrinsic` of twelve (3×4, its 3×3 part transposed).
///
/// # Errors
/// [`PlyError`] with the path and the reason.
pub fn load(path: &Path, options: ReadOptions) -> Result<GaussianScene, PlyError> {
    std::fs::read(path)
        .map_err(PlyReason::from)
        .and_then(|bytes| from_bytes(&bytes, options))
        .map_err(|reason| PlyError::new(path, reason))
}

/// As [`load`], from a file's bytes.
///
/// # Errors
/// [`PlyReason`].
pub fn from_bytes(bytes: &[u8], options: ReadOptions) -> Result<GaussianScene, PlyReason> {
    let header = Header::parse(bytes)?;
    let tables = tables(bytes, &header, |element, property| match element {
        "vertex" => VERTEX.contains(&property),
        _ => EXTRA.contains(&element) && element == property,
    })?;
    let color_space = color_space(&header, &tables)?.unwrap_or(options.default_color_space);
    let vertices = tables
        .iter()
        .find(|t| t.element.name == "vertex")
        .ok_or_else(|| PlyReason::Missing("itself".into()))?;
    let ignored = |name: &str| name.starts_with("f_rest_");
    Ok(GaussianScene {
        gaussians: gaussians(vertices, color_space)?,
        intrinsics: intrinsics(&tables)?,
        extrinsics: extrinsics(&tables)?,
        color_space,
        version: extra(&tables, "version")
            .and_then(|v| <[f64; 3]>::try_from(v).ok())
            .map(|v| v.map(|x| x as u8)),
        ignored_color_coefficients: vertices
            .element
            .properties
            .iter()
            .filter(|p| ignored(&p.name))
            .count(),
    })
}

const VERTEX: [&str; 14] = [
    "x", "y", "z", "f_dc_0", "f_dc_1", "f_dc_2", "opacity", "scale_0", "scale_1", "scale_2",
    "rot_0", "rot_1", "rot_2", "rot_3",
];

/// Elements with one property of the same name.
const EXTRA: [&str; 5] = [
    "extrinsic",
    "intrinsic",
    "image_size",
    "color_space",
    "version",
];

fn gaussians(vertices: &Table, color_space: ColorSpace) -> Result<Gaussians, PlyReason> {
    let column = |name: &str| {
        vertices
            .element
            .column(name)
            .map(|index| vertices.columns[index].as_slice())
    };
    let missing: Vec<&str> = VERTEX.into_iter().filter(|n| column(n).is_none()).collect();
    if !missing.is_empty() {
        return Err(PlyReason::Missing(missing.join(", ")));
    }
    let c = VERTEX.map(|name| column(name).unwrap_or_default());
    let rows = 0..vertices.element.count;
    let rgb = |coefficient: f64| {
        let stored = coefficient as f32 * SH_CONSTANT + 0.5;
        match color_space {
            ColorSpace::Srgb => linear_from_srgb(stored),
            ColorSpace::Linear => stored,
        }
    };
    Ok(Gaussians {
        means: rows
            .clone()
            .map(|k| [0, 1, 2].map(|i| c[i][k] as f32))
            .collect(),
        colors: rows
            .clone()
            .map(|k| [3, 4, 5].map(|i| rgb(c[i][k])))
            .collect(),
        opacities: rows
            .clone()
            .map(|k| (1.0 / (1.0 + (-c[6][k]).exp())) as f32)
            .collect(),
        scales: rows
            .clone()
            .map(|k| [7, 8, 9].map(|i| c[i][k].exp() as f32))
            .collect(),
        quaternions: rows
            .map(|k| [10, 11, 12, 13].map(|i| c[i][k] as f32))
            .collect(),
    })
}

fn extra<'a>(tables: &'a [Table], name: &str) -> Option<&'a [f64]> {
    let table = tables.iter().find(|t| t.element.name == name)?;
    let index = table.element.column(name)?;
    Some(&table.columns[index])
}

fn color_space(header: &Header, tables: &[Table]) -> Result<Option<ColorSpace>, PlyReason> {
    match extra(tables, "color_space") {
        Some([0.0]) => Ok(Some(ColorSpace::Srgb)),
        Some([1.0]) => Ok(Some(ColorSpace::Linear)),
        Some(other) => Err(PlyReason::Extra {
            element: "color_space",
            what: match other {
                [code] => format!("{code} is neither 0 (sRGB) nor 1 (linear)"),
                _ => format!("{} values where 1 belongs", other.len()),
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

fn intrinsics(tables: &[Table]) -> Result<Option<Intrinsics>, PlyReason> {
    let Some(values) = extra(tables, "intrinsic") else {
        return Ok(None);
    };
    let (focal, center, size) = match *values {
        // Legacy: no principal point, so the middle of the image.
        [fx, fy, width, height] => ((fx, fy), (width / 2.0, height / 2.0), [width, height]),
        [fx, _, cx, _, fy, cy, _, _, _] => {
            let size = match extra(tables, "image_size") {
                Some(&[width, height]) => [width, height],
                Some(other) => {
                    return Err(PlyReason::Extra {
                        element: "image_size",
                        what: format!("{} values where 2 belong", other.len()),
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
                what: format!("{} values where 9 or 4 belong", values.len()),
            });
        }
    };
    // `as` saturates and maps NaN to 0, which the camera then refuses.
    let [width, height] = size.map(|v| v.round() as u32);
    Ok(Some(Intrinsics::new(focal, center, (width, height))?))
}

fn extrinsics(tables: &[Table]) -> Result<Option<[f32; 16]>, PlyReason> {
    let Some(values) = extra(tables, "extrinsic") else {
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
                what: format!("{other} values where 16 or 12 belong"),
            });
        }
    }
    Ok(Some(matrix))
}
