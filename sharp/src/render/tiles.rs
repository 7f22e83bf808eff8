//! Pass `tiles`: a bin's ordered list cut into lists of its tiles.

use super::emit::BIN;
use super::project::{Footprint, Splat};

/// A Gaussian as one bin sees it: the mean is relative to the bin's corner, so that a pixel's
/// distance from it keeps its digits anywhere in the image, and does not depend on the tile size.
#[derive(Debug, Clone, Copy)]
pub(super) struct LocalSplat {
    pub(super) mean: [f32; 2],
    pub(super) p: f32,
    pub(super) q: f32,
    pub(super) r: f32,
    pub(super) opacity: f32,
    pub(super) cut: f32,
    pub(super) z: f32,
    pub(super) color: [f32; 3],
    /// First and last pixel within the bin: x0, x1, y0, y1.
    pub(super) reach: [u8; 4],
}

/// The lists of one bin; buffers that a thread uses for bin after bin.
#[derive(Debug, Default)]
pub(super) struct TileLists {
    /// The bin's Gaussians, front to back.
    pub(super) splats: Vec<LocalSplat>,
    /// Where each tile's list starts in `members`, row by row over `rows`, and the last one's end.
    starts: Vec<u32>,
    next: Vec<u32>,
    members: Vec<u32>,
    /// Members of each tile in the whole bin.
    counts: Vec<u32>,
}

/// Members a bin lists at once before it goes on in bands of tile rows.
const MEMBER_LIMIT: u64 = 1 << 22;

impl TileLists {
    /// Takes a bin's ordered keys.
    pub(super) fn load(
        &mut self,
        keys: &[u64],
        splats: &[Splat],
        footprints: &[Footprint],
        corner: [usize; 2],
    ) {
        let origin = corner.map(|c| c as f64);
        let within = |pixel: u16, axis: usize| -> u8 {
            // In 0..=63 after the clamp.
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

    /// Lists the tiles of `tile` pixels and hands them over, band by band: `each(lists, rows)`.
    pub(super) fn for_each_band(&mut self, tile: usize, mut each: impl FnMut(Band<'_>)) {
        let side = BIN / tile;
        self.counts.clear();
        self.counts.resize(side * side, 0);
        for s in &self.splats {
            let [x0, x1, y0, y1] = s.reach.map(|pixel| usize::from(pixel) / tile);
            for y in y0..=y1 {
                for count in &mut self.counts[y * side + x0..=y * side + x1] {
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
        self.starts.clear();
        self.starts.push(0);
        let mut total = 0;
        for count in &self.counts[first * side..last * side] {
            total += count;
            self.starts.push(total);
        }
        self.next.clear();
        self.next.extend_from_slice(&self.starts);
        self.members.clear();
        self.members.resize(total as usize, 0);
        for (member, s) in self.splats.iter().enumerate() {
            let [x0, x1, y0, y1] = s.reach.map(|pixel| usize::from(pixel) / tile);
            for y in y0.max(first)..(y1 + 1).min(last) {
                let row = (y - first) * side;
                for next in &mut self.next[row + x0..=row + x1] {
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
    /// Side of a tile, pixels.
    pub(super) fn tile(self) -> usize {
        self.tile
    }

    /// Each tile's first pixel within the bin, (x, y), and its members, front to back.
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
