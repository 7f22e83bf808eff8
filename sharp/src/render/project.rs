//! Pass `project`: computes each Gaussian's [`Splat`] and the [`Footprint`] it can reach.
//!
//! The arithmetic is f64 without fused operations, so that every instruction set gives the same bits. The determinant
//! is computed by Cauchy–Binet as `|u × v|²` of the two rows of `J L R diag(s)`, which avoids the cancellation of `ac −
//! b²` for needle-like Gaussians. The conic is stored as its Cholesky factor, so that it stays positive.

use super::harmonics::ViewColors;
use super::simd::{Simd, per_instruction_set};
use super::view::ViewConstants;
use super::{Compensation, Dropped, RenderView, Support};
use crate::gaussians::Gaussians;
use rayon::prelude::*;
use std::f64::consts::{LN_2, LOG2_E};

/// A projected Gaussian, stored at the index of its source Gaussian.
///
/// `σ · log2 e = (p dx + q dy)² + (r dy)²` with `(dx, dy) = mean − pixel centre`.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct Splat {
    /// Mean in pixels; f64, so that subtracting a distant tile's origin is exact.
    pub(super) mean: [f64; 2],
    /// p, q and r are the Cholesky factor of the conic, scaled for an exponential to base 2.
    pub(super) p: f32,
    pub(super) q: f32,
    pub(super) r: f32,
    pub(super) opacity: f32,
    /// Value of `σ · log2 e` above which alpha is below 1/255.
    pub(super) cut: f32,
    pub(super) color: [f32; 3],
}

/// The pixels where a Gaussian's alpha can reach 1/255, and the Gaussian's depth: everything needed
/// to sort Gaussians into tiles.
///
/// Pixels from `x0` to `x1` and `y0` to `y1`, inclusive; empty if `x0 > x1`.
#[derive(Debug, Clone, Copy, PartialEq)]
pub(super) struct Footprint {
    pub(super) x0: u16,
    pub(super) x1: u16,
    pub(super) y0: u16,
    pub(super) y1: u16,
    /// Depth of the centre, computed in f64 and rounded once; the sort key.
    pub(super) z: f32,
}

impl Footprint {
    pub(super) const EMPTY: Self = Self {
        x0: 1,
        x1: 0,
        y0: 1,
        y1: 0,
        z: 0.0,
    };

    pub(super) fn is_empty(self) -> bool {
        self.x0 > self.x1
    }
}

/// Outputs of the pass, kept between frames to reuse the memory.
#[derive(Debug, Default)]
pub(super) struct Projected {
    pub(super) splats: Vec<Splat>,
    pub(super) footprints: Vec<Footprint>,
    pub(super) drawn: u64,
    pub(super) dropped: Dropped,
}

/// Gaussians per task; a multiple of [`BLOCK`].
const CHUNK: usize = 8192;
/// Gaussians per block of transposed columns, chosen to fit in the L1 cache.
const BLOCK: usize = 128;

/// Minimum opacity, and minimum alpha in a pixel, that is drawn.
pub(super) const ALPHA_MIN: f32 = 1.0 / 255.0;
/// Maximum extent of a Gaussian in gsplat, in standard deviations; above `sqrt(2 ln 255) = 3.329`.
const MAX_EXTENT: f64 = 3.33;
/// Side of the tiles that bound the support, in pixels.
const SUPPORT_TILE: f64 = 16.0;
/// Share by which the box is enlarged. Together with [`BOX_MARGIN_PX`], this exceeds the distance by which rounding in
/// `raster` can move the 1/255 contour.
const RELATIVE_BOX_MARGIN: f64 = 1e-4;
/// Pixels by which the box is enlarged on each side, after [`RELATIVE_BOX_MARGIN`].
const BOX_MARGIN_PX: f64 = 1e-4;

/// Added to [`Splat::cut`], so that rounding in `raster` and in `log2` never cuts off a visible pixel.
const CUT_MARGIN: f32 = 1e-3;

/// Runs the pass on the threads of the current pool.
pub(super) fn project(simd: Simd, scene: &Gaussians, view: &RenderView, out: &mut Projected) {
    let n = scene.len();
    out.splats.resize(n, Splat::default());
    out.footprints.resize(n, Footprint::EMPTY);
    let constants = ViewConstants::new(view);
    let colors = ViewColors::new(scene.harmonics.degree, view);
    let (drawn, dropped) = out
        .splats
        .par_chunks_mut(CHUNK)
        .zip(out.footprints.par_chunks_mut(CHUNK))
        .enumerate()
        .map(|(chunk, (splats, footprints))| {
            let mut counts = (0, Dropped::default());
            let blocks = splats.chunks_mut(BLOCK).zip(footprints.chunks_mut(BLOCK));
            for (block, (splats, footprints)) in blocks.enumerate() {
                let first = chunk * CHUNK + block * BLOCK;
                project_block(
                    simd,
                    &constants,
                    colors.as_ref(),
                    scene,
                    first,
                    splats,
                    footprints,
                    &mut counts,
                );
            }
            counts
        })
        .reduce(
            || (0, Dropped::default()),
            |(drawn, mut dropped), (more, others)| {
                dropped += others;
                (drawn + more, dropped)
            },
        );
    out.drawn = drawn;
    out.dropped = dropped;
}

/// Columns of one block (structure of arrays), so that the loop over them vectorises.
struct Columns {
    mean: [[f64; BLOCK]; 3],
    quaternion: [[f64; BLOCK]; 4],
    scale: [[f64; BLOCK]; 3],
    opacity: [f64; BLOCK],
    center: [[f64; BLOCK]; 2],
    reach: [[f64; BLOCK]; 2],
    radius: [[f64; BLOCK]; 2],
    factor: [[f32; BLOCK]; 3],
    z: [f32; BLOCK],
    cut: [f32; BLOCK],
    norm: [f64; BLOCK],
    /// Determinant of the 2D covariance, low-pass included.
    determinant: [f64; BLOCK],
    /// Determinant of the 2D covariance without the low-pass.
    sharp_determinant: [f64; BLOCK],
    /// Standard deviations in x and y, low-pass included.
    deviation: [[f64; BLOCK]; 2],
    /// Off-diagonal entry of the 2D covariance.
    covariance: [f64; BLOCK],
}

per_instruction_set! {
    fn project_block(
        constants: &ViewConstants,
        colors: Option<&ViewColors>,
        scene: &Gaussians,
        first: usize,
        splats: &mut [Splat],
        footprints: &mut [Footprint],
        counts: &mut (u64, Dropped),
    ) = block, block, block
}

#[inline(always)]
fn block(
    constants: &ViewConstants,
    colors: Option<&ViewColors>,
    scene: &Gaussians,
    first: usize,
    splats: &mut [Splat],
    footprints: &mut [Footprint],
    counts: &mut (u64, Dropped),
) {
    let n = splats.len().min(BLOCK);
    let mut c = Columns {
        mean: [[0.0; BLOCK]; 3],
        quaternion: [[0.0; BLOCK]; 4],
        scale: [[0.0; BLOCK]; 3],
        opacity: [0.0; BLOCK],
        center: [[0.0; BLOCK]; 2],
        reach: [[0.0; BLOCK]; 2],
        radius: [[0.0; BLOCK]; 2],
        factor: [[0.0; BLOCK]; 3],
        z: [0.0; BLOCK],
        cut: [0.0; BLOCK],
        norm: [0.0; BLOCK],
        determinant: [0.0; BLOCK],
        sharp_determinant: [0.0; BLOCK],
        deviation: [[0.0; BLOCK]; 2],
        covariance: [0.0; BLOCK],
    };
    transpose(&scene.means[first..first + n], &mut c.mean);
    transpose(&scene.quaternions[first..first + n], &mut c.quaternion);
    transpose(&scene.scales[first..first + n], &mut c.scale);
    for (out, opacity) in c.opacity.iter_mut().zip(&scene.opacities[first..first + n]) {
        *out = f64::from(*opacity);
    }
    columns(constants, &mut c, n);
    compensate(constants.compensation, &mut c, n);
    reach(&mut c, n);
    for i in 0..n {
        let k = first + i;
        footprints[i] = Footprint::EMPTY;
        let dropped = &mut counts.1;
        let reason = if !scene.is_finite(k) {
            Some(&mut dropped.not_finite)
        } else if c.norm[i] == 0.0 {
            Some(&mut dropped.zero_quaternion)
        } else if c.z[i] < constants.near {
            Some(&mut dropped.near)
        } else if c.z[i] > constants.far {
            Some(&mut dropped.far)
        } else if !is_drawable(&c, i) {
            Some(&mut dropped.degenerate)
        } else if c.opacity[i] < f64::from(ALPHA_MIN) {
            Some(&mut dropped.transparent)
        } else if (0..2).any(|axis| {
            let (at, radius) = (c.center[axis][i], c.radius[axis][i]);
            at + radius <= 0.0 || at - radius >= constants.size[axis]
        }) {
            Some(&mut dropped.outside)
        } else {
            None
        };
        if let Some(count) = reason {
            *count += 1;
            continue;
        }
        counts.0 += 1;
        splats[i] = Splat {
            mean: [c.center[0][i], c.center[1][i]],
            p: c.factor[0][i],
            q: c.factor[1][i],
            r: c.factor[2][i],
            // Without compensation, the opacity is the stored f32 value, so the cast is exact.
            opacity: c.opacity[i] as f32,
            cut: c.cut[i],
            color: match colors {
                None => scene.colors[k],
                Some(colors) => colors.color(scene, k),
            },
        };
        footprints[i] = footprint(&c, i, constants);
    }
}

/// True if the determinant is positive and f32 can represent the conic's factor. NaN gives false.
fn is_drawable(c: &Columns, i: usize) -> bool {
    let finite = c.factor.iter().all(|column| column[i].is_finite())
        && c.center.iter().all(|column| column[i].is_finite())
        && c.reach.iter().all(|column| column[i].is_finite());
    c.determinant[i] > 0.0 && finite
}

/// Pixels whose centres are within reach, clipped to the image and to the rule's tiles.
fn footprint(c: &Columns, i: usize, constants: &ViewConstants) -> Footprint {
    let radius = match constants.support {
        Support::Exact => None,
        Support::Tiles => Some(tile_radius(c, i)),
    };
    let range = |axis: usize| {
        let (at, reach) = (c.center[axis][i] - 0.5, c.reach[axis][i]);
        let mut first = (at - reach).ceil().max(0.0);
        let mut last = (at + reach).floor().min(constants.size[axis] - 1.0);
        if let Some(radius) = radius {
            let tile = |pixel: f64| (pixel / SUPPORT_TILE).trunc() * SUPPORT_TILE;
            first = first.max(tile(at - radius));
            last = last.min(tile(at + radius + SUPPORT_TILE - 1.0) - 1.0);
        }
        // `first` and `last` are in 0..65535 if the range is not empty.
        (first <= last).then_some((first as u16, last as u16))
    };
    match (range(0), range(1)) {
        (Some((x0, x1)), Some((y0, y1))) => Footprint {
            x0,
            x1,
            y0,
            y1,
            z: c.z[i],
        },
        _ => Footprint::EMPTY,
    }
}

/// Inria's radius: three standard deviations along the longer axis, in whole pixels.
fn tile_radius(c: &Columns, i: usize) -> f64 {
    let [a, d] = [0, 1].map(|axis: usize| c.deviation[axis][i].powi(2));
    let (half, b) = (0.5 * (a - d), c.covariance[i]);
    let root = (half * half + b * b).max(0.1).sqrt();
    (3.0 * (0.5 * (a + d) + root).sqrt()).ceil()
}

#[inline(always)]
fn transpose<const D: usize>(rows: &[[f32; D]], columns: &mut [[f64; BLOCK]; D]) {
    for (i, row) in rows.iter().enumerate().take(BLOCK) {
        for d in 0..D {
            columns[d][i] = f64::from(row[d]);
        }
    }
}

/// The projection itself, without branches so that the loop vectorises.
#[inline(always)]
fn columns(k: &ViewConstants, c: &mut Columns, n: usize) {
    let [l0, l1, l2] = k.linear;
    let scale_to_log2 = (0.5 * LOG2_E).sqrt();
    for i in 0..n.min(BLOCK) {
        let (mx, my, mz) = (c.mean[0][i], c.mean[1][i], c.mean[2][i]);
        let x = l0[0] * mx + l0[1] * my + l0[2] * mz + k.offset[0];
        let y = l1[0] * mx + l1[1] * my + l1[2] * mz + k.offset[1];
        let z = l2[0] * mx + l2[1] * my + l2[2] * mz + k.offset[2];
        let inverse_z = 1.0 / z;
        let (slope_x, slope_y) = (x * inverse_z, y * inverse_z);
        c.center[0][i] = k.focal[0] * slope_x + k.center[0];
        c.center[1][i] = k.focal[1] * slope_y + k.center[1];
        c.z[i] = z as f32;

        // J L, with J evaluated at the clamped slopes.
        let at_x = slope_x.max(k.bounds[0][0]).min(k.bounds[0][1]);
        let at_y = slope_y.max(k.bounds[1][0]).min(k.bounds[1][1]);
        let (jx, jy) = (k.focal[0] * inverse_z, k.focal[1] * inverse_z);
        let gx = [0, 1, 2].map(|j: usize| jx * (l0[j] - at_x * l2[j]));
        let gy = [0, 1, 2].map(|j: usize| jy * (l1[j] - at_y * l2[j]));

        // Columns of the rotation of q/|q|, times the scales.
        let (qw, qx) = (c.quaternion[0][i], c.quaternion[1][i]);
        let (qy, qz) = (c.quaternion[2][i], c.quaternion[3][i]);
        let norm = qw * qw + qx * qx + qy * qy + qz * qz;
        let two = 2.0 / norm;
        c.norm[i] = norm;
        let (s0, s1, s2) = (c.scale[0][i], c.scale[1][i], c.scale[2][i]);
        let r0 = [
            (1.0 - two * (qy * qy + qz * qz)) * s0,
            two * (qx * qy + qw * qz) * s0,
            two * (qx * qz - qw * qy) * s0,
        ];
        let r1 = [
            two * (qx * qy - qw * qz) * s1,
            (1.0 - two * (qx * qx + qz * qz)) * s1,
            two * (qy * qz + qw * qx) * s1,
        ];
        let r2 = [
            two * (qx * qz + qw * qy) * s2,
            two * (qy * qz - qw * qx) * s2,
            (1.0 - two * (qx * qx + qy * qy)) * s2,
        ];
        let u = [dot(gx, r0), dot(gx, r1), dot(gx, r2)];
        let v = [dot(gy, r0), dot(gy, r1), dot(gy, r2)];
        let (uu, vv, b) = (dot(u, u), dot(v, v), dot(u, v));
        let (m0, m1) = (u[1] * v[2] - u[2] * v[1], u[2] * v[0] - u[0] * v[2]);
        let m2 = u[0] * v[1] - u[1] * v[0];
        let cross = m0 * m0 + m1 * m1 + m2 * m2;
        let determinant = cross + k.eps2d * (uu + vv) + k.eps2d * k.eps2d;
        c.determinant[i] = determinant;
        c.sharp_determinant[i] = cross;
        let (a, d) = ((uu + k.eps2d).sqrt(), (vv + k.eps2d).sqrt());
        let root = determinant.sqrt();
        c.deviation[0][i] = a;
        c.deviation[1][i] = d;
        c.covariance[i] = b;
        c.factor[0][i] = (scale_to_log2 * d / root) as f32;
        c.factor[1][i] = (-scale_to_log2 * b / (d * root)) as f32;
        c.factor[2][i] = (scale_to_log2 / d) as f32;
    }
}

/// Scales opacities to compensate for the low-pass.
#[inline(always)]
fn compensate(by: Compensation, c: &mut Columns, n: usize) {
    /// 0.005² rounded to f32.
    const FLOOR: f64 = 2.5e-5_f32 as f64;
    /// Mip-Splatting's 1e-6 rounded to f32.
    const EPSILON: f64 = 1e-6_f32 as f64;
    if by == Compensation::None {
        return;
    }
    for i in 0..n.min(BLOCK) {
        let (with, without) = (c.determinant[i], c.sharp_determinant[i]);
        c.opacity[i] *= match by {
            Compensation::None => 1.0,
            Compensation::Root => (without / with).sqrt(),
            Compensation::FlooredRoot => (without / with).max(FLOOR).sqrt(),
            Compensation::MipSplatting if with <= EPSILON || without <= EPSILON => 0.0,
            Compensation::MipSplatting => (without / (with + EPSILON) + EPSILON).sqrt(),
        };
    }
}

/// Computes the extent at which alpha falls to 1/255.
#[inline(always)]
fn reach(c: &mut Columns, n: usize) {
    for i in 0..n.min(BLOCK) {
        let (a, d) = (c.deviation[0][i], c.deviation[1][i]);
        // Extent at which o exp(-extent²/2) falls to 1/255.
        let cut = log2(255.0 * c.opacity[i]);
        c.cut[i] = cut as f32 + CUT_MARGIN;
        let extent = (2.0 * LN_2 * cut.max(0.0)).sqrt();
        let reach = extent * (1.0 + RELATIVE_BOX_MARGIN);
        c.reach[0][i] = a * reach + BOX_MARGIN_PX;
        c.reach[1][i] = d * reach + BOX_MARGIN_PX;
        let bounded = extent.min(MAX_EXTENT);
        c.radius[0][i] = (a * bounded).ceil();
        c.radius[1][i] = (d * bounded).ceil();
    }
}

#[inline(always)]
fn dot(a: [f64; 3], b: [f64; 3]) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

/// log2 of a positive normal number to 1e-9, in operations that vectorise; unspecified for other inputs.
#[inline(always)]
pub(super) fn log2(x: f64) -> f64 {
    let bits = x.to_bits();
    // The exponent that puts the mantissa in sqrt(1/2)..sqrt(2).
    let shifted = bits.wrapping_sub(std::f64::consts::FRAC_1_SQRT_2.to_bits());
    let mantissa = f64::from_bits(
        (shifted & 0x000f_ffff_ffff_ffff).wrapping_add(std::f64::consts::FRAC_1_SQRT_2.to_bits()),
    );
    // 2^52 + 2^51. Adding a small integer to the bits of this number and then subtracting the
    // number converts the integer to a float.
    const MAGIC: f64 = 6_755_399_441_055_744.0;
    let biased = f64::from_bits(((shifted >> 52) ^ 0x800).wrapping_add(MAGIC.to_bits())) - MAGIC;
    let exponent = biased - 2048.0;
    let s = (mantissa - 1.0) / (mantissa + 1.0);
    let s2 = s * s;
    let series = 1.0 + s2 * (1.0 / 3.0 + s2 * (0.2 + s2 * (1.0 / 7.0 + s2 * (1.0 / 9.0))));
    exponent + 2.0 * LOG2_E * s * series
}
