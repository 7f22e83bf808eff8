//! Backward of pass `raster`: contribution of each Gaussian of a bin to the gradient.
//!
//! Every block is traversed front to back once more, keeping α and T, and then back to front with the sum over the
//! Gaussians behind. With `q = ∂L/∂C·c + ∂L/∂D z` of each Gaussian and `w = α T`,
//!
//! `∂L/∂α = T q − (Σ_behind w q + T_end ∂L/∂T_end) / (1 − α)`, `∂L/∂T_end = −∂L/∂A`.
//!
//! The gradient is zero through an α that was clamped, skipped, or behind the stop.

use super::super::ranges::{Band, LocalSplat};
use super::super::raster::{ALPHA_MAX, BLOCK, Coverage, Transmittance, centers, reaching};
#[cfg(target_arch = "x86_64")]
use super::super::simd::{Avx2, Avx512};
use super::super::simd::{Lanes, Portable, Scalar, per_instruction_set};
use super::PictureGradient;
use crate::render::emit::BIN;
use std::f64::consts::LN_2;

/// Sums over the pixels of one splat.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub(super) struct SplatSums<S = f32> {
    /// Sum of `α ∂L/∂α`: the opacity's gradient times the opacity.
    pub(super) opacity: S,
    pub(super) color: [S; 3],
    pub(super) z: S,
    /// Sum of `a = ∂L/∂(p dx + q dy)`.
    pub(super) across: S,
    /// Sum of `b = ∂L/∂(r dy)`.
    pub(super) along: S,
    /// Sums of `a dx`, `a dy`, `b dy`: the gradients of p, q, r.
    pub(super) factor: [S; 3],
}

/// Splats that contribute to some pixel of a block, each with its α (0 in pixels to which it does
/// not contribute) and the transmittance T in front of it. The memory is reused between blocks.
pub(super) type Steps<S = f32> = Vec<(u32, [S; 16], [S; 16])>;

/// Gradient of a picture at the pixels of a block: red, green, blue, alpha, depth; 0 outside the image.
pub(super) type Upstream<S> = [[S; 16]; 5];

per_instruction_set! {
    /// Adds the contributions of the tiles of one band of the bin whose first pixel is `corner`.
    pub(super) fn raster(
        lists: Band<'_>,
        corner: [usize; 2],
        gradient: &PictureGradient<'_>,
        scratch: (&mut Vec<u32>, &mut Steps),
        out: &mut [SplatSums],
    ) = band::<Avx512>, band::<Avx2>, band::<Portable>
}

#[inline(always)]
fn band<L: Lanes<Scalar = f32>>(
    lists: Band<'_>,
    corner: [usize; 2],
    gradient: &PictureGradient<'_>,
    (near, steps): (&mut Vec<u32>, &mut Steps),
    out: &mut [SplatSums],
) {
    let tile = lists.tile();
    let columns = (gradient.width - corner[0]).min(BIN);
    let rows = (gradient.height() - corner[1]).min(BIN);
    for ((x0, y0), members) in lists.tiles() {
        if members.is_empty() {
            continue;
        }
        for y in (y0..(y0 + tile).min(rows)).step_by(BLOCK) {
            for x in (x0..(x0 + tile).min(columns)).step_by(BLOCK) {
                let upstream = gradient.block([corner[0] + x, corner[1] + y]);
                let members = if tile == BLOCK {
                    members
                } else {
                    reaching(lists.splats, members, (x, y), near);
                    &*near
                };
                block::<L>(lists.splats, members, (x, y), &upstream, steps, out);
            }
        }
    }
}

/// Adds one block's contributions; `out` has one element per element of `splats`.
#[inline(always)]
pub(super) fn block<L: Lanes>(
    splats: &[LocalSplat<L::Scalar>],
    members: &[u32],
    at: (usize, usize),
    upstream: &Upstream<L::Scalar>,
    steps: &mut Steps<L::Scalar>,
    out: &mut [SplatSums<L::Scalar>],
) {
    let centers = centers::<L>(at);
    let alpha_max = L::splat(ALPHA_MAX.into());
    steps.clear();
    let mut transmittance = Transmittance::<L>::full();
    for &member in members {
        let s = &splats[member as usize];
        let alpha = Coverage::new(s, centers).alpha(s, alpha_max);
        let absorption = transmittance.absorb(alpha);
        if L::any(absorption.adds) {
            let alpha = alpha.masked(absorption.adds);
            steps.push((member, alpha.to_array(), transmittance.left.to_array()));
        }
        if !transmittance.take(&absorption) {
            break;
        }
    }
    let [red, green, blue, cover, depth] =
        [0, 1, 2, 3, 4].map(|k: usize| L::from_array(&upstream[k]));
    let (one, zero) = (L::splat(1.0.into()), L::zero());
    // ∂α/∂e = −ln 2 α, and e is a sum of squares.
    let slope = L::splat(L::Scalar::of(-2.0 * LN_2));
    let mut behind = zero.sub(transmittance.end().mul(cover));
    for (member, alpha, left) in steps.iter().rev() {
        let s = &splats[*member as usize];
        let (alpha, left) = (L::from_array(alpha), L::from_array(left));
        let adds = alpha.gt_where(zero, zero.le(zero));
        let weight = alpha.mul(left);
        let mut q = L::splat(s.z).mul(depth);
        q = L::splat(s.color[0]).mul_add(red, q);
        q = L::splat(s.color[1]).mul_add(green, q);
        q = L::splat(s.color[2]).mul_add(blue, q);
        let of_alpha = left.mul(q).sub(behind.div(one.sub(alpha)));
        behind = weight.mul_add(q, behind);
        let of_alpha = alpha.mul(of_alpha).masked(adds);
        let of_alpha = L::select(alpha_max.le(alpha), zero, of_alpha);
        let Coverage {
            dx,
            dy,
            across,
            along,
        } = Coverage::new(s, centers);
        let of_exponent = slope.mul(of_alpha);
        let (a, b) = (of_exponent.mul(across), of_exponent.mul(along));
        let sums = &mut out[*member as usize];
        sums.opacity += of_alpha.sum();
        sums.color[0] += weight.mul(red).sum();
        sums.color[1] += weight.mul(green).sum();
        sums.color[2] += weight.mul(blue).sum();
        sums.z += weight.mul(depth).sum();
        sums.across += a.sum();
        sums.along += b.sum();
        sums.factor[0] += a.mul(dx).sum();
        sums.factor[1] += a.mul(dy).sum();
        sums.factor[2] += b.mul(dy).sum();
    }
}
