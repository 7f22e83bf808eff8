//! Encoding of a scene as SPZ 3.

use std::io::{self, Write};

use flate2::Compression;
use flate2::write::GzEncoder;

use super::{ANTIALIASED, COLOR_SCALE, MAGIC};
use crate::ply::{GaussianScene, SH_CONSTANT, srgb, unit_quaternion};

/// Maximum number of fractional bits of positions.
const FRACTIONAL_BITS: i32 = 12;

/// Encodes the scene as SPZ 3. Axes are converted from OpenCV's (x right, y down, z forward) to
/// those that the format requires (right, up, back).
///
/// Gaussians with non-finite values are omitted. Values out of range are clamped: scales to e^−10..e^5.9, coefficients
/// of view-dependent colour (stored with all eight bits) to −1..0.99. Positions are 24-bit fixed-point numbers with 12
/// fractional bits, or fewer if the largest position needs more bits before the point. Positions beyond ±2²³ do not fit
/// and are stored wrapped.
///
/// # Errors
/// If there are more than [`u32::MAX`] Gaussians.
pub fn to_bytes(scene: &GaussianScene) -> io::Result<Vec<u8>> {
    let g = scene.gaussians.clone().flipped([1.0, -1.0, -1.0]);
    let g = g.filtered(|k| g.is_finite(k));
    let farthest = g
        .means
        .as_flattened()
        .iter()
        .fold(0.0_f32, |most, v| most.max(v.abs()));
    let whole_bits = (f64::from(farthest) + 1.0).log2().ceil() as i32;
    let fractional_bits = FRACTIONAL_BITS.min(23 - whole_bits).max(0);
    let flags = match scene.marks.antialiased {
        Some(true) => ANTIALIASED,
        _ => 0,
    };
    let count = u32::try_from(g.len()).map_err(io::Error::other)?;
    let mut out = GzEncoder::new(Vec::new(), Compression::default());
    out.write_all(&MAGIC)?;
    out.write_all(&3_u32.to_le_bytes())?;
    out.write_all(&count.to_le_bytes())?;
    out.write_all(&[g.harmonics.degree as u8, fractional_bits as u8, flags, 0])?;
    let step = f64::from(fractional_bits).exp2();
    for value in g.means.as_flattened() {
        let word = (f64::from(*value) * step).round() as i32;
        out.write_all(&word.to_le_bytes()[..3])?;
    }
    // The conversion from float to byte saturates.
    let mut put = |values: &mut dyn Iterator<Item = f32>| -> io::Result<()> {
        let bytes: Vec<u8> = values.map(|v| v.round() as u8).collect();
        out.write_all(&bytes)
    };
    put(&mut g.opacities.iter().map(|o| o * 255.0))?;
    let stored = |c: &f32| {
        let coefficient = (srgb(*c, scene.reading.blending) - 0.5) / SH_CONSTANT;
        (coefficient * COLOR_SCALE + 0.5) * 255.0
    };
    put(&mut g.colors.as_flattened().iter().map(stored))?;
    put(&mut g
        .scales
        .as_flattened()
        .iter()
        .map(|s| (s.ln() + 10.0) * 16.0))?;
    for quaternion in &g.quaternions {
        out.write_all(&packed_rotation(*quaternion).to_le_bytes())?;
    }
    let coefficients = g.harmonics.coefficients.as_flattened().iter();
    let bytes: Vec<u8> = coefficients
        .map(|c| (c * 128.0 + 128.0).round() as u8)
        .collect();
    out.write_all(&bytes)?;
    out.finish()
}

fn packed_rotation(quaternion: [f32; 4]) -> u32 {
    let ([w, x, y, z], largest) = unit_quaternion(quaternion);
    // Converts the index from w, x, y, z to x, y, z, w order.
    let largest = (largest + 3) % 4;
    let mut packed = largest as u32;
    for (place, value) in [x, y, z, w].into_iter().enumerate() {
        if place != largest {
            let magnitude = (value.abs() * std::f64::consts::SQRT_2 * 511.0).round();
            let sign = u32::from(value < 0.0) << 9;
            packed = packed << 10 | sign | (magnitude as u32).min(511);
        }
    }
    packed
}
