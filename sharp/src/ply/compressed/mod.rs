//! PlayCanvas' compressed PLY: 16 bytes per Gaussian, quantised within the bounds of its chunk of 256 Gaussians, plus
//! one byte per coefficient of view-dependent colour.

mod write;

use super::PlyReason;
use super::decoded::{Decoded, degree_of};
use super::marks::FileMarks;
use super::reading::{StoredColors, StoredForm, StoredOpacity, StoredScales};
use super::table::{Body, Element, Header, TableError};

pub use write::to_compressed_bytes;
#[cfg(feature = "gaussian-files")]
pub(crate) use write::unit_quaternion;

/// Gaussians per chunk.
const CHUNK: usize = 256;

/// Bounds of a chunk: minimum and maximum of the position, of the logarithmic scale and, in the newer form of the
/// format, of the colour.
const BOUNDS: [&str; 18] = [
    "min_x",
    "min_y",
    "min_z",
    "max_x",
    "max_y",
    "max_z",
    "min_scale_x",
    "min_scale_y",
    "min_scale_z",
    "max_scale_x",
    "max_scale_y",
    "max_scale_z",
    "min_r",
    "min_g",
    "min_b",
    "max_r",
    "max_g",
    "max_b",
];
/// Number of bounds in the older form, without colours.
const OLDER_BOUNDS: usize = 12;

const PACKED: [&str; 4] = [
    "packed_position",
    "packed_rotation",
    "packed_scale",
    "packed_color",
];

pub(super) fn is_compressed(header: &Header) -> bool {
    let mut elements = header.elements.iter();
    elements.any(|e| e.name == "chunk" || e.number(PACKED[0]).is_some())
}

/// Reads the rows. Display colours are converted to coefficients; an opacity of 0 or 1 is exact.
pub(super) fn decode(header: &Header, mut body: Body<'_>) -> Result<Decoded, PlyReason> {
    let mut chunks: Vec<[f32; 18]> = Vec::new();
    let mut packed: Vec<[u32; 4]> = Vec::new();
    let mut rest: Vec<u8> = Vec::new();
    let mut coefficients = 0;
    let mut marks = FileMarks::default();
    for element in &header.elements {
        match element.name.as_str() {
            "chunk" => {
                let older = columns(element, &BOUNDS[..OLDER_BOUNDS])?;
                let newer = columns(element, &BOUNDS[OLDER_BOUNDS..]).unwrap_or_default();
                body.rows::<TableError>(element, |row| {
                    // In the older form, colours range over 0..1.
                    let mut bounds = [0.0; 18];
                    bounds[15..].fill(1.0);
                    for (bound, column) in bounds.iter_mut().zip(older.iter().chain(&newer)) {
                        *bound = row.number(*column) as f32;
                    }
                    chunks.push(bounds);
                    Ok(())
                })?;
            }
            "vertex" => {
                let columns = columns(element, &PACKED)?;
                marks = FileMarks::of_ply(header, element, None);
                body.rows::<TableError>(element, |row| {
                    packed.push([0, 1, 2, 3].map(|k| row.number(columns[k]) as u32));
                    Ok(())
                })?;
            }
            "sh" => {
                let names = (0..element.properties.len()).map(|k| format!("f_rest_{k}"));
                let columns: Option<Vec<usize>> = names.map(|name| element.number(&name)).collect();
                coefficients = element.properties.len();
                let columns = columns.filter(|_| degree_of(coefficients).is_some());
                let columns = columns.ok_or(PlyReason::Degree(coefficients))?;
                body.rows::<TableError>(element, |row| {
                    rest.extend(columns.iter().map(|column| row.number(*column) as u8));
                    Ok(())
                })?;
            }
            _ => body.rows::<TableError>(element, |_| Ok(()))?,
        }
    }
    let damaged = |what: String| PlyReason::Damaged {
        format: "compressed PLY",
        what,
    };
    let count = packed.len();
    if chunks.len() * CHUNK < count {
        let held = chunks.len();
        return Err(damaged(format!(
            "{held} chunks are not the right number for {count} Gaussians"
        )));
    }
    if rest.len() != count * coefficients {
        return Err(damaged(format!(
            "element `sh` does not have the {count} rows of element `vertex`"
        )));
    }
    let mut out = Decoded {
        form: StoredForm {
            opacity: Some(StoredOpacity::Linear),
            scales: Some(StoredScales::Log),
            colors: Some(StoredColors::Rgb01),
            ..StoredForm::default()
        },
        marks,
        color_coefficients: coefficients,
        ..Decoded::default()
    };
    let stored = &mut out.stored;
    stored.harmonics.degree = degree_of(coefficients).unwrap_or_default();
    for (k, [position, rotation, scale, color]) in packed.into_iter().enumerate() {
        let bounds = &chunks[k / CHUNK];
        let between = |first: usize, shares: [f64; 3]| {
            [0, 1, 2].map(|axis| {
                let least = f64::from(bounds[first + axis]);
                let most = f64::from(bounds[first + 3 + axis]);
                (least + (most - least) * shares[axis]) as f32
            })
        };
        stored.means.push(between(0, shares_11_10_11(position)));
        stored.quaternions.push(rotation_of(rotation));
        stored.scales.push(between(6, shares_11_10_11(scale)));
        let [r, g, b, a] = color.to_be_bytes().map(|byte| f64::from(byte) / 255.0);
        stored.colors.push(between(12, [r, g, b]));
        stored.opacities.push(a as f32);
    }
    let each = coefficients / 3;
    for row in rest.chunks_exact(coefficients.max(1)) {
        let of = |k: usize| [0, 1, 2].map(|channel| coefficient_of(row[channel * each + k]));
        stored.harmonics.coefficients.extend((0..each).map(of));
    }
    let mut values = stored.harmonics.coefficients.iter().flatten();
    out.is_view_dependent = values.any(|v| *v != 0.0);
    Ok(out)
}

fn columns(element: &Element, names: &[&'static str]) -> Result<Vec<usize>, PlyReason> {
    let found = names.iter().map(|name| (*name, element.number(name)));
    let missing: Vec<_> = found.clone().filter(|(_, c)| c.is_none()).collect();
    if !missing.is_empty() {
        return Err(PlyReason::Missing(
            missing.into_iter().map(|(name, _)| name).collect(),
        ));
    }
    Ok(found.filter_map(|(_, column)| column).collect())
}

/// Unpacks fractions 0..1 along x, y and z, stored in 11, 10 and 11 bits.
fn shares_11_10_11(packed: u32) -> [f64; 3] {
    [
        f64::from(packed >> 21) / 2047.0,
        f64::from(packed >> 11 & 1023) / 1023.0,
        f64::from(packed & 2047) / 2047.0,
    ]
}

/// Decodes a quaternion. The two highest bits identify the largest of w, x, y, z, which is
/// positive; the other three components follow in order.
fn rotation_of(packed: u32) -> [f32; 4] {
    let largest = (packed >> 30) as usize;
    let mut quaternion = [0.0_f64; 4];
    let mut shift = 20;
    for (place, value) in quaternion.iter_mut().enumerate() {
        if place != largest {
            *value = (f64::from(packed >> shift & 1023) / 1023.0 - 0.5) * std::f64::consts::SQRT_2;
            shift -= 10_u32.min(shift);
        }
    }
    completed(quaternion, largest)
}

/// Unit quaternion with component `largest` recomputed as the positive value that normalises it;
/// the other components are kept.
pub(crate) fn completed(mut quaternion: [f64; 4], largest: usize) -> [f32; 4] {
    quaternion[largest] = 0.0;
    let sum: f64 = quaternion.iter().map(|v| v * v).sum();
    quaternion[largest] = (1.0 - sum).max(0.0).sqrt();
    quaternion.map(|v| v as f32)
}

/// Maps a byte to −4..4. The ends are exact; other bytes map to the centres of their intervals.
fn coefficient_of(byte: u8) -> f32 {
    let share = match byte {
        0 => 0.0,
        255 => 1.0,
        byte => (f32::from(byte) + 0.5) / 256.0,
    };
    (share - 0.5) * 8.0
}
