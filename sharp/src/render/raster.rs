//! Pass `raster`: blends each tile's list into its pixels, sixteen pixels at a time.
//!
//! A pixel adds its Gaussians in list order, alone in its lane: neither the tile size nor what was
//! skipped around it can change its bits. Skipping is safe because footprint and `cut` are wider
//! than anything that could reach 1/255.

use super::project::ALPHA_MIN;
use super::ranges::{Band, LocalSplat};
#[cfg(target_arch = "x86_64")]
use super::simd::{Avx2, Avx512};
use super::simd::{Lanes, Portable, per_instruction_set};

/// Side of the square of pixels that the lanes hold.
pub(super) const BLOCK: usize = 4;

/// No Gaussian covers a pixel more than this.
const ALPHA_MAX: f32 = 0.999;
/// A pixel is done before its transmittance would fall to this.
const TRANSMITTANCE_STOP: f32 = 1e-4;

/// The part of the output that one bin owns: its rows of pixels.
#[derive(Default)]
pub(super) struct BinPixels<'a> {
    pub(super) rgb: Vec<&'a mut [[f32; 3]]>,
    pub(super) alpha: Vec<&'a mut [f32]>,
    pub(super) depth: Vec<&'a mut [f32]>,
}

per_instruction_set! {
    /// Rasterises the tiles of one band of a bin.
    pub(super) fn raster(lists: Band<'_>, scratch: &mut Vec<u32>, out: &mut BinPixels<'_>) =
        band::<Avx512>, band::<Avx2>, band::<Portable>
}

#[inline(always)]
fn band<L: Lanes>(lists: Band<'_>, scratch: &mut Vec<u32>, out: &mut BinPixels<'_>) {
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
                let pixels = block::<L>(lists.splats, members, (x, y));
                write(&pixels, (x, y), out);
            }
        }
    }
}

/// The members that may touch the block `at` a first pixel.
#[inline(always)]
fn reaching(splats: &[LocalSplat], members: &[u32], at: (usize, usize), into: &mut Vec<u32>) {
    into.clear();
    into.extend(
        members
            .iter()
            .filter(|&&member| splats[member as usize].reaches(at, BLOCK)),
    );
}

/// What a block accumulated: red, green, blue, depth, transmittance.
type Pixels = [[f32; 16]; 5];

#[inline(always)]
fn block<L: Lanes>(splats: &[LocalSplat], members: &[u32], (x, y): (usize, usize)) -> Pixels {
    let center = |axis: usize| -> [f32; 16] {
        std::array::from_fn(|lane| {
            let within = if axis == 0 {
                lane % BLOCK
            } else {
                lane / BLOCK
            };
            // Below 64 and a half: exact.
            ([x, y][axis] + within) as f32 + 0.5
        })
    };
    let (px, py) = (L::from_array(&center(0)), L::from_array(&center(1)));
    let (alpha_min, alpha_max) = (L::splat(ALPHA_MIN), L::splat(ALPHA_MAX));
    let stop = L::splat(TRANSMITTANCE_STOP);
    let zero = L::splat(0.0);
    let (mut red, mut green, mut blue, mut depth) = (zero, zero, zero, zero);
    let mut transmittance = L::splat(1.0);
    // Pixels that are done keep their transmittance here and go on with zero, which adds nothing.
    let mut done = zero;
    for &member in members {
        let s = &splats[member as usize];
        let dx = L::splat(s.mean[0]).sub(px);
        let dy = L::splat(s.mean[1]).sub(py);
        let across = L::splat(s.p).mul_add(dx, L::splat(s.q).mul(dy));
        let along = L::splat(s.r).mul(dy);
        let exponent = across.mul_add(across, along.mul(along));
        let alpha = L::splat(s.opacity)
            .mul(zero.sub(exponent).exp2())
            .min(alpha_max);
        let hit = alpha_min.le(alpha);
        let left = alpha.neg_mul_add(transmittance, transmittance);
        let adds = left.gt_where(stop, hit);
        let weight = alpha.mul(transmittance).masked(adds);
        red = weight.mul_add(L::splat(s.color[0]), red);
        green = weight.mul_add(L::splat(s.color[1]), green);
        blue = weight.mul_add(L::splat(s.color[2]), blue);
        depth = weight.mul_add(L::splat(s.z), depth);
        // A pixel that would fall to the stop is done, without this Gaussian.
        let stops = left.not_gt_where(stop, hit);
        if L::any(stops) {
            done = done.add(transmittance.masked(stops));
            transmittance = L::select(stops, zero, transmittance);
            if !L::any(transmittance.gt_where(zero, zero.le(zero))) {
                break;
            }
        }
        transmittance = L::select(adds, left, transmittance);
    }
    let transmittance = transmittance.add(done);
    [red, green, blue, depth, transmittance].map(L::to_array)
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
