//! Encoding of a scene as compressed PLY.

use super::{BOUNDS, CHUNK, PACKED};
use crate::gaussians::Gaussians;
use crate::ply::GaussianScene;
use crate::ply::write::{comments, srgb};

/// Maximum magnitude of the logarithm of a scale; larger ones are clamped.
const MAX_SCALE: f32 = 20.0;

/// Encodes the scene as a compressed PLY, ordered so that neighbouring Gaussians share a chunk.
///
/// Coefficients of view-dependent colour are clamped to ±4, and scales to e^±20. Non-finite Gaussians are omitted,
/// because they would invalidate the bounds of their chunk.
pub fn to_compressed_bytes(scene: &GaussianScene) -> Vec<u8> {
    let g = &scene.gaussians;
    let order = morton_order(g);
    let g = g.subset(&order);
    let n = g.len();
    let chunks = n.div_ceil(CHUNK);
    let mut text = String::from("ply\nformat binary_little_endian 1.0\n");
    for comment in comments(scene) {
        text += &format!("comment {comment}\n");
    }
    text += &format!("element chunk {chunks}\n");
    for name in BOUNDS {
        text += &format!("property float {name}\n");
    }
    text += &format!("element vertex {n}\n");
    for name in PACKED {
        text += &format!("property uint {name}\n");
    }
    let each = g.harmonics.per_gaussian();
    if each > 0 {
        text += &format!("element sh {n}\n");
        for k in 0..3 * each {
            text += &format!("property uchar f_rest_{k}\n");
        }
    }
    let mut out = (text + "end_header\n").into_bytes();
    let scales = |k: usize| g.scales[k].map(|s| s.ln().clamp(-MAX_SCALE, MAX_SCALE));
    let colors = |k: usize| g.colors[k].map(|c| srgb(c, scene.reading.blending));
    let mut packed = Vec::with_capacity(n * 16);
    for first in (0..n).step_by(CHUNK) {
        let rows = first..(first + CHUNK).min(n);
        let bounds = [
            Bounds::of(rows.clone().map(|k| g.means[k])),
            Bounds::of(rows.clone().map(scales)),
            Bounds::of(rows.clone().map(colors)),
        ];
        for Bounds { least, most } in &bounds {
            out.extend(least.iter().chain(most).flat_map(|v| v.to_le_bytes()));
        }
        let [means, logs, tints] = bounds;
        for k in rows {
            let [r, g8, b] = tints.quantised(colors(k), [255.0; 3]);
            let opacity = (g.opacities[k].clamp(0.0, 1.0) * 255.0).round() as u32;
            for word in [
                packed_11_10_11(&means, g.means[k]),
                packed_rotation(g.quaternions[k]),
                packed_11_10_11(&logs, scales(k)),
                r << 24 | g8 << 16 | b << 8 | opacity,
            ] {
                packed.extend(word.to_le_bytes());
            }
        }
    }
    out.append(&mut packed);
    for k in (0..n).filter(|_| each > 0) {
        let row = g.harmonics.of(k);
        for channel in 0..3 {
            // The conversion from float to byte saturates.
            let byte = |c: &[f32; 3]| ((c[channel] / 8.0 + 0.5) * 256.0).floor() as u8;
            out.extend(row.iter().map(byte));
        }
    }
    out
}

/// Minimum and maximum along each axis.
struct Bounds {
    least: [f32; 3],
    most: [f32; 3],
}

impl Bounds {
    fn of(rows: impl Iterator<Item = [f32; 3]>) -> Self {
        let mut bounds = Self {
            least: [f32::INFINITY; 3],
            most: [f32::NEG_INFINITY; 3],
        };
        for row in rows {
            for axis in 0..3 {
                bounds.least[axis] = bounds.least[axis].min(row[axis]);
                bounds.most[axis] = bounds.most[axis].max(row[axis]);
            }
        }
        bounds
    }

    /// Quantises values between minimum and maximum to 0..=`levels`.
    fn quantised(&self, row: [f32; 3], levels: [f64; 3]) -> [u32; 3] {
        [0, 1, 2].map(|axis| {
            let least = f64::from(self.least[axis]);
            let range = f64::from(self.most[axis]) - least;
            let share = (f64::from(row[axis]) - least) / range;
            // NaN if the range is empty, which the cast converts to 0.
            (share * levels[axis]).round() as u32
        })
    }
}

fn packed_11_10_11(bounds: &Bounds, row: [f32; 3]) -> u32 {
    let [x, y, z] = bounds.quantised(row, [2047.0, 1023.0, 2047.0]);
    x << 21 | y << 11 | z
}

fn packed_rotation(quaternion: [f32; 4]) -> u32 {
    let (unit, largest) = unit_quaternion(quaternion);
    let mut packed = largest as u32;
    for (place, value) in unit.into_iter().enumerate() {
        if place != largest {
            let share = value / std::f64::consts::SQRT_2 + 0.5;
            packed = packed << 10 | (share * 1023.0).round().clamp(0.0, 1023.0) as u32;
        }
    }
    packed
}

/// Normalised quaternion with a positive largest component, and the index of that component. A zero
/// quaternion gives the identity.
pub(crate) fn unit_quaternion(quaternion: [f32; 4]) -> ([f64; 4], usize) {
    let wide = quaternion.map(f64::from);
    let norm = wide.iter().map(|v| v * v).sum::<f64>().sqrt();
    if !(norm > 0.0 && norm.is_finite()) {
        return ([1.0, 0.0, 0.0, 0.0], 0);
    }
    let largest = (1..4).fold(0, |best, k| {
        if wide[k].abs() > wide[best].abs() {
            k
        } else {
            best
        }
    });
    let scale = norm.copysign(wide[largest]);
    (wide.map(|v| v / scale), largest)
}

/// Indices of finite Gaussians along a space-filling curve.
fn morton_order(g: &Gaussians) -> Vec<usize> {
    let mut order: Vec<usize> = (0..g.len()).filter(|&k| g.is_finite(k)).collect();
    let bounds = Bounds::of(order.iter().map(|&k| g.means[k]));
    order.sort_by_cached_key(|&k| {
        let cell = bounds.quantised(g.means[k], [1023.0; 3]);
        (0..10).fold(0_u32, |key, bit| {
            let at = |axis: usize| (cell[axis] >> bit & 1) << (3 * bit + axis as u32);
            key | at(0) | at(1) | at(2)
        })
    });
    order
}
