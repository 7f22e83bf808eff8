//! Pass `raster`: blends each tile's list into its pixels, sixteen pixels at a time.
//!
//! Each lane accumulates one pixel's Gaussians in list order, independently of all other lanes, so
//! neither the tile size nor skipped Gaussians change the pixel's bits. Skipping is safe because
//! footprint and `cut` are conservative bounds of the region in which alpha can reach 1/255.

use super::Rule;
use super::project::ALPHA_MIN;
use super::ranges::{Band, LocalSplat};
#[cfg(target_arch = "x86_64")]
use super::simd::{Avx2, Avx512};
use super::simd::{Lanes, Portable, per_instruction_set};

/// Side of the square of pixels processed in one set of lanes.
pub(super) const BLOCK: usize = 4;

/// Maximum alpha of one Gaussian in a pixel under SHARP's rule, the only rule with a derivative.
pub(super) const ALPHA_MAX: f32 = Rule::SHARP.alpha_max;
/// A pixel is finished when the next Gaussian would reduce its transmittance to this or less; that Gaussian is not
/// added.
pub(super) const TRANSMITTANCE_STOP: f32 = 1e-4;

/// The part of the output that belongs to one bin, as rows of pixels.
#[derive(Default)]
pub(super) struct BinPixels<'a> {
    pub(super) rgb: Vec<&'a mut [[f32; 3]]>,
    pub(super) alpha: Vec<&'a mut [f32]>,
    pub(super) depth: Vec<&'a mut [f32]>,
}

per_instruction_set! {
    /// Rasterises the tiles of one band of a bin; the alpha of each Gaussian is limited to `alpha_max`.
    pub(super) fn raster(
        lists: Band<'_>,
        alpha_max: f32,
        scratch: &mut Vec<u32>,
        out: &mut BinPixels<'_>,
    ) = band::<Avx512>, band::<Avx2>, band::<Portable>
}

#[inline(always)]
fn band<L: Lanes<Scalar = f32>>(
    lists: Band<'_>,
    alpha_max: f32,
    scratch: &mut Vec<u32>,
    out: &mut BinPixels<'_>,
) {
    let alpha_max = L::splat(alpha_max);
    let tile = lists.tile();
    let rows = out.alpha.len();
    let columns = out.alpha.first().map_or(0, |row| row.len());
    for ((x0, y0), members) in lists.tiles() {
        if members.is_empty() {
            continue;
        }
        for y in (y0..(y0 + tile).min(rows)).step_by(BLOCK) {
            for x in (x0..(x0 + tile).min(columns)).step_by(BLOCK) {
                let members = if tile == BLOCK {
                    members
                } else {
                    reaching(lists.splats, members, (x, y), scratch);
                    &*scratch
                };
                let pixels = block::<L>(lists.splats, members, (x, y), alpha_max);
                write(&pixels, (x, y), out);
            }
        }
    }
}

/// Members that may reach the block whose first pixel is `at`.
#[inline(always)]
pub(super) fn reaching(
    splats: &[LocalSplat],
    members: &[u32],
    at: (usize, usize),
    into: &mut Vec<u32>,
) {
    into.clear();
    into.extend(
        members
            .iter()
            .filter(|&&member| splats[member as usize].reaches(at, BLOCK)),
    );
}

/// Accumulated values of a block: red, green, blue, depth, transmittance.
type Pixels = [[f32; 16]; 5];

/// Centres of a block's pixels, x and y.
#[inline(always)]
pub(super) fn centers<L: Lanes>((x, y): (usize, usize)) -> [L; 2] {
    let center = |first: usize, within: fn(usize) -> usize| {
        // At most 63.5, which f32 represents exactly.
        L::from_array(&std::array::from_fn(|lane| {
            L::Scalar::from((first + within(lane)) as f32 + 0.5)
        }))
    };
    [
        center(x, |lane| lane % BLOCK),
        center(y, |lane| lane / BLOCK),
    ]
}

/// Coverage of a block by a Gaussian: the definition of α shared by forward and backward.
pub(super) struct Coverage<L> {
    /// Mean minus pixel centre.
    pub(super) dx: L,
    pub(super) dy: L,
    /// `p dx + q dy` in `across`, and `r dy`; the sum of the two squares is the exponent of 2.
    pub(super) across: L,
    pub(super) along: L,
}

impl<L: Lanes> Coverage<L> {
    #[inline(always)]
    pub(super) fn new(s: &LocalSplat<L::Scalar>, [px, py]: [L; 2]) -> Self {
        let dx = L::splat(s.mean[0]).sub(px);
        let dy = L::splat(s.mean[1]).sub(py);
        let across = L::splat(s.p).mul_add(dx, L::splat(s.q).mul(dy));
        let along = L::splat(s.r).mul(dy);
        Self {
            dx,
            dy,
            across,
            along,
        }
    }

    #[inline(always)]
    pub(super) fn alpha(&self, s: &LocalSplat<L::Scalar>, alpha_max: L) -> L {
        let along = self.along.mul(self.along);
        let exponent = self.across.mul_add(self.across, along);
        L::splat(s.opacity)
            .mul(L::zero().sub(exponent).exp2())
            .min(alpha_max)
    }
}

/// Effect of a Gaussian on a block's transmittance.
pub(super) struct Absorption<L: Lanes> {
    hit: L::Mask,
    /// Transmittance behind the Gaussian.
    left: L,
    /// Pixels to which the Gaussian contributes.
    pub(super) adds: L::Mask,
}

/// Remaining transmittance of a block's pixels, front to back.
pub(super) struct Transmittance<L> {
    /// Remaining transmittance; zero in finished pixels.
    pub(super) left: L,
    /// Final transmittance of finished pixels.
    done: L,
    alpha_min: L,
    stop: L,
}

impl<L: Lanes> Transmittance<L> {
    #[inline(always)]
    pub(super) fn full() -> Self {
        Self {
            left: L::splat(L::Scalar::from(1.0)),
            done: L::zero(),
            alpha_min: L::splat(ALPHA_MIN.into()),
            stop: L::splat(TRANSMITTANCE_STOP.into()),
        }
    }

    /// Determines the pixels to which a Gaussian of coverage `alpha` contributes.
    #[inline(always)]
    pub(super) fn absorb(&self, alpha: L) -> Absorption<L> {
        let hit = self.alpha_min.le(alpha);
        let left = alpha.neg_mul_add(self.left, self.left);
        Absorption {
            hit,
            left,
            adds: left.gt_where(self.stop, hit),
        }
    }

    /// Applies an absorption; returns false once every pixel is finished.
    #[inline(always)]
    pub(super) fn take(&mut self, absorption: &Absorption<L>) -> bool {
        // A pixel whose transmittance would fall below the stop threshold is finished, without this Gaussian.
        let stops = absorption.left.not_gt_where(self.stop, absorption.hit);
        if L::any(stops) {
            self.done = self.done.add(self.left.masked(stops));
            self.left = L::select(stops, L::zero(), self.left);
            let all = L::zero().le(L::zero());
            if !L::any(self.left.gt_where(L::zero(), all)) {
                return false;
            }
        }
        self.left = L::select(absorption.adds, absorption.left, self.left);
        true
    }

    /// Transmittance that reaches the background.
    #[inline(always)]
    pub(super) fn end(&self) -> L {
        self.left.add(self.done)
    }
}

#[inline(always)]
fn block<L: Lanes<Scalar = f32>>(
    splats: &[LocalSplat],
    members: &[u32],
    at: (usize, usize),
    alpha_max: L,
) -> Pixels {
    let centers = centers::<L>(at);
    let [mut red, mut green, mut blue, mut depth] = [L::zero(); 4];
    let mut transmittance = Transmittance::<L>::full();
    for &member in members {
        let s = &splats[member as usize];
        let alpha = Coverage::new(s, centers).alpha(s, alpha_max);
        let absorption = transmittance.absorb(alpha);
        let weight = alpha.mul(transmittance.left).masked(absorption.adds);
        red = weight.mul_add(L::splat(s.color[0]), red);
        green = weight.mul_add(L::splat(s.color[1]), green);
        blue = weight.mul_add(L::splat(s.color[2]), blue);
        depth = weight.mul_add(L::splat(s.z), depth);
        if !transmittance.take(&absorption) {
            break;
        }
    }
    [red, green, blue, depth, transmittance.end()].map(L::to_array)
}

#[inline(always)]
fn write(pixels: &Pixels, (x, y): (usize, usize), out: &mut BinPixels<'_>) {
    let rows = out.alpha.len().min(y + BLOCK);
    for row in y..rows {
        let columns = out.alpha[row].len().min(x + BLOCK);
        for column in x..columns {
            let lane = (row - y) * BLOCK + (column - x);
            out.rgb[row][column] = [pixels[0][lane], pixels[1][lane], pixels[2][lane]];
            out.depth[row][column] = pixels[3][lane];
            out.alpha[row][column] = 1.0 - pixels[4][lane];
        }
    }
}
