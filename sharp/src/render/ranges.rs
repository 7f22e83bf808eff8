//! Pass `ranges`: start and end of each tile's list, and the lists themselves.
//!
//! The GPU sorts (tile, Gaussian) pairs by tile and finds the boundaries. Here, on the CPU, it is cheaper to count,
//! scan and fill within each bin, which gives the same lists in the same order.

use super::emit::BIN;
use super::project::{Footprint, Splat};
use super::scan::scan;

/// A Gaussian relative to one bin. Its mean is relative to the bin's corner, so that a pixel's distance from the mean
/// has the same precision anywhere in the image and for any tile size.
#[derive(Debug, Clone, Copy)]
pub(super) struct LocalSplat<S = f32> {
    pub(super) mean: [S; 2],
    pub(super) p: S,
    pub(super) q: S,
    pub(super) r: S,
    pub(super) opacity: S,
    pub(super) z: S,
    pub(super) color: [S; 3],
    /// First and last pixel within the bin: x0, x1, y0, y1.
    pub(super) reach: [u8; 4],
    /// Value of `σ · log2 e` above which alpha is below 1/255.
    pub(super) cut: f32,
    /// True if the ellipse covers little of its bounding box, so that computing the tile columns of each row saves
    /// time.
    pub(super) slanted: bool,
}

/// A Gaussian is slanted if (a / (π/4))² is below this, where a is the fraction of the bounding box
/// that the ellipse covers.
const SLANTED: f32 = 0.5;

impl LocalSplat {
    /// True if the splat may reach some pixel of the block of `side` pixels at `(x, y)`.
    pub(super) fn reaches(&self, (x, y): (usize, usize), side: usize) -> bool {
        let [x0, x1, y0, y1] = self.reach.map(usize::from);
        let boxed = x0 < x + side && x1 >= x && y0 < y + side && y1 >= y;
        boxed
            && (!self.slanted || {
                let (first, last) = self.columns(y, side);
                first < x + side && last >= x
            })
    }

    /// First and last tile row.
    fn tile_rows(&self, shift: u32) -> (usize, usize) {
        let [.., y0, y1] = self.reach.map(|pixel| usize::from(pixel >> shift));
        (y0, y1)
    }

    /// First and last tile of a tile row; empty if the first is beyond the last.
    fn tile_columns(&self, row: usize, shift: u32) -> (usize, usize) {
        if self.slanted {
            let (x0, x1) = self.columns(row << shift, 1 << shift);
            return if x0 > x1 {
                (1, 0)
            } else {
                (x0 >> shift, x1 >> shift)
            };
        }
        let [x0, x1, ..] = self.reach.map(|pixel| usize::from(pixel >> shift));
        (x0, x1)
    }

    /// First and last pixel column within reach on any of the `rows` rows starting at `y`.
    ///
    /// On one row, the pixels within reach satisfy `|p dx + q dy| ≤ sqrt(cut − (r dy)²)`. Each end of this interval of
    /// dx has one stationary point in dy. Over the rows, the end is extreme at the dy that is nearest to that point.
    fn columns(&self, y: usize, rows: usize) -> (usize, usize) {
        let (p, q, r) = (self.p, self.q, self.r);
        let tip = self.cut.sqrt() / r;
        let low = (self.mean[1] - (y + rows) as f32 + 0.5).clamp(-tip, tip);
        let high = (self.mean[1] - y as f32 - 0.5).clamp(-tip, tip);
        let stationary = -q * tip / (q * q + r * r).sqrt();
        let half = |dy: f32| (self.cut - r * dy * (r * dy)).max(0.0).sqrt() / p;
        let (at_most, at_least) = (stationary.clamp(low, high), (-stationary).clamp(low, high));
        let most = half(at_most) - q * at_most / p;
        let least = -half(at_least) - q * at_least / p;
        // Rounding here and in `raster` is relative to the sum of the magnitudes added.
        let middle = self.mean[0] - 0.5;
        let margin = |dx: f32| 1e-2 + 1e-5 * (dx.abs() + middle.abs() + 2.0 * half(0.0));
        let first = (middle - most - margin(most)).ceil();
        let last = (middle - least + margin(least)).floor();
        let [x0, x1, ..] = self.reach.map(usize::from);
        // Negative values and NaN become 0; if `last` is NaN, the range is extended to the end
        // instead.
        let last = if last.is_nan() { BIN as f32 } else { last };
        if last < 0.0 {
            return (1, 0);
        }
        ((first as usize).max(x0), (last as usize).min(x1))
    }
}

/// Lists of one bin; the buffers are reused for bin after bin.
#[derive(Debug, Default)]
pub(super) struct TileLists {
    /// The bin's Gaussians, front to back.
    pub(super) splats: Vec<LocalSplat>,
    /// Start of each tile's list in `members`, row by row over `rows`, and the end of the last one.
    starts: Vec<u32>,
    next: Vec<u32>,
    members: Vec<u32>,
    /// Number of members of each tile of the whole bin.
    counts: Vec<u32>,
}

/// Maximum number of members listed at once: a bin with more is rasterised in bands of tile rows.
const MEMBER_LIMIT: u64 = 1 << 22;

impl TileLists {
    /// Loads a bin's sorted keys.
    pub(super) fn load(
        &mut self,
        keys: &[u64],
        splats: &[Splat],
        footprints: &[Footprint],
        corner: [usize; 2],
    ) {
        let origin = corner.map(|c| c as f64);
        let within = |pixel: u16, axis: usize| -> u8 {
            // The result is in 0..=63 after the clamp.
            usize::from(pixel).saturating_sub(corner[axis]).min(BIN - 1) as u8
        };
        self.splats.clear();
        self.splats.extend(keys.iter().map(|key| {
            // The low half is the index, the high half the bits of z.
            let index = *key as u32 as usize;
            let (s, f) = (&splats[index], &footprints[index]);
            LocalSplat {
                mean: [
                    (s.mean[0] - origin[0]) as f32,
                    (s.mean[1] - origin[1]) as f32,
                ],
                p: s.p,
                q: s.q,
                r: s.r,
                opacity: s.opacity,
                cut: s.cut,
                slanted: s.r * s.r < SLANTED * (s.q * s.q + s.r * s.r)
                    && f.x1 - f.x0 > 8
                    && f.y1 - f.y0 > 8,
                z: f.z,
                color: s.color,
                reach: [
                    within(f.x0, 0),
                    within(f.x1, 0),
                    within(f.y0, 1),
                    within(f.y1, 1),
                ],
            }
        }));
    }

    /// Builds the lists for tiles of `tile` × `tile` pixels and passes each band of tile rows to
    /// `each`.
    pub(super) fn for_each_band(&mut self, tile: usize, mut each: impl FnMut(Band<'_>)) {
        let side = BIN / tile;
        let shift = tile.trailing_zeros();
        self.counts.clear();
        self.counts.resize(side * side, 0);
        for s in &self.splats {
            let (y0, y1) = s.tile_rows(shift);
            for y in y0..=y1 {
                let (x0, x1) = s.tile_columns(y, shift);
                for count in &mut self.counts[y * side + x0..y * side + x1 + 1] {
                    *count += 1;
                }
            }
        }
        let mut first = 0;
        while first < side {
            let (mut last, mut members) = (first, 0);
            while last < side {
                let row = &self.counts[last * side..(last + 1) * side];
                let more: u64 = row.iter().map(|count| u64::from(*count)).sum();
                if last > first && members + more > MEMBER_LIMIT {
                    break;
                }
                members += more;
                last += 1;
            }
            self.fill(tile, first, last);
            each(Band {
                splats: &self.splats,
                starts: &self.starts,
                members: &self.members,
                tile,
                first_row: first,
            });
            first = last;
        }
    }

    /// Fills the lists of tile rows `first..last`.
    fn fill(&mut self, tile: usize, first: usize, last: usize) {
        let side = BIN / tile;
        let shift = tile.trailing_zeros();
        scan(&self.counts[first * side..last * side], &mut self.starts);
        self.next.clear();
        self.next.extend_from_slice(&self.starts);
        let total = self.starts.last().map_or(0, |end| *end as usize);
        self.members.clear();
        self.members.resize(total, 0);
        for (member, s) in self.splats.iter().enumerate() {
            let (y0, y1) = s.tile_rows(shift);
            for y in y0.max(first)..(y1 + 1).min(last) {
                let (x0, x1) = s.tile_columns(y, shift);
                let row = (y - first) * side;
                for next in &mut self.next[row + x0..row + x1 + 1] {
                    self.members[*next as usize] = member as u32;
                    *next += 1;
                }
            }
        }
    }
}

/// The lists of some rows of tiles of one bin.
#[derive(Clone, Copy)]
pub(super) struct Band<'a> {
    pub(super) splats: &'a [LocalSplat],
    starts: &'a [u32],
    members: &'a [u32],
    tile: usize,
    first_row: usize,
}

impl<'a> Band<'a> {
    /// Side of a tile, in pixels.
    pub(super) fn tile(self) -> usize {
        self.tile
    }

    /// First pixel (x, y) of each tile within the bin, and the tile's members, front to back.
    pub(super) fn tiles(self) -> impl Iterator<Item = ((usize, usize), &'a [u32])> {
        let side = BIN / self.tile;
        self.starts.windows(2).enumerate().map(move |(at, ends)| {
            let corner = (
                at % side * self.tile,
                (at / side + self.first_row) * self.tile,
            );
            (corner, &self.members[ends[0] as usize..ends[1] as usize])
        })
    }
}
