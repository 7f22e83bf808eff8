//! Pass `emit`: the list of Gaussians that reach each bin of 64×64 pixels.
//!
//! Lists are in source order, which for a predicted scene is row by row on the screen. Their entries are sort keys: the
//! bits of z in the upper half, the index in the lower half. Each chunk of Gaussians has its own lists, so that no two
//! threads write to the same memory and the result does not depend on the number of threads.

use super::project::Footprint;
use super::scan::scan;
use rayon::prelude::*;
use std::ops::Range;

/// Side of a bin in pixels; bins are the unit of work of the following passes.
pub(super) const BIN: usize = 64;

/// Gaussians per task.
const CHUNK: usize = 32_768;

/// Division of the image into bins, row by row.
#[derive(Debug, Clone, Copy)]
pub(super) struct BinGrid {
    pub(super) columns: usize,
    pub(super) rows: usize,
}

impl BinGrid {
    pub(super) fn new(width: u32, height: u32) -> Self {
        Self {
            columns: (width as usize).div_ceil(BIN),
            rows: (height as usize).div_ceil(BIN),
        }
    }

    pub(super) fn len(self) -> usize {
        self.columns * self.rows
    }

    /// Indices of the bins that a footprint overlaps.
    fn touched(self, f: Footprint) -> impl Iterator<Item = usize> {
        let (x0, x1) = (usize::from(f.x0) / BIN, usize::from(f.x1) / BIN);
        let (y0, y1) = (usize::from(f.y0) / BIN, usize::from(f.y1) / BIN);
        (y0..=y1).flat_map(move |y| (x0..=x1).map(move |x| y * self.columns + x))
    }
}

/// Number of Gaussians of each chunk that reach each bin.
pub(super) struct Counts(Vec<Vec<u32>>);

/// Counts the Gaussians per bin, on the threads of the current pool.
pub(super) fn count(grid: BinGrid, footprints: &[Footprint]) -> Counts {
    Counts(
        footprints
            .par_chunks(CHUNK)
            .map(|chunk| {
                let mut counts = vec![0_u32; grid.len()];
                for f in chunk.iter().filter(|f| !f.is_empty()) {
                    for bin in grid.touched(*f) {
                        counts[bin] += 1;
                    }
                }
                counts
            })
            .collect(),
    )
}

impl Counts {
    /// Splits the bins into runs that emit at most `limit` pairs each, or consist of a single bin.
    pub(super) fn groups(&self, grid: BinGrid, limit: u64) -> Vec<Range<usize>> {
        let mut groups = Vec::new();
        let (mut start, mut pairs) = (0, 0);
        for bin in 0..grid.len() {
            let more: u64 = self.0.iter().map(|counts| u64::from(counts[bin])).sum();
            if bin > start && pairs + more > limit {
                groups.push(start..bin);
                (start, pairs) = (bin, 0);
            }
            pairs += more;
        }
        if start < grid.len() {
            groups.push(start..grid.len());
        }
        groups
    }
}

/// Lists of a run of bins, chunk by chunk.
pub(super) struct BinLists {
    bins: Range<usize>,
    chunks: Vec<ChunkLists>,
}

struct ChunkLists {
    /// Start of each bin's list, and the end of the last one.
    starts: Vec<u32>,
    pairs: Vec<u64>,
}

impl BinLists {
    /// Collects a bin's list, in source order.
    pub(super) fn gather(&self, bin: usize, into: &mut Vec<u64>) {
        into.clear();
        let at = bin - self.bins.start;
        for chunk in &self.chunks {
            let range = chunk.starts[at] as usize..chunk.starts[at + 1] as usize;
            into.extend_from_slice(&chunk.pairs[range]);
        }
    }
}

/// The sort key of a Gaussian: depth first (positive floats have the order of their bits), then
/// index.
pub(super) fn key(z: f32, index: u32) -> u64 {
    u64::from(z.to_bits()) << 32 | u64::from(index)
}

/// Emits the lists of the bins in `bins`, on the threads of the current pool.
pub(super) fn emit(
    grid: BinGrid,
    footprints: &[Footprint],
    counts: &Counts,
    bins: Range<usize>,
) -> BinLists {
    let chunks = footprints
        .par_chunks(CHUNK)
        .zip(&counts.0)
        .enumerate()
        .map(|(index, (chunk, counts))| {
            let mut starts = Vec::new();
            scan(&counts[bins.clone()], &mut starts);
            let mut next = starts.clone();
            let total = starts.last().map_or(0, |end| *end as usize);
            let mut pairs = vec![0_u64; total];
            for (offset, f) in chunk.iter().enumerate().filter(|(_, f)| !f.is_empty()) {
                // Cannot overflow: the scene was checked to contain at most u32::MAX Gaussians.
                let key = key(f.z, (index * CHUNK + offset) as u32);
                for bin in grid.touched(*f).filter(|bin| bins.contains(bin)) {
                    let next = &mut next[bin - bins.start];
                    pairs[*next as usize] = key;
                    *next += 1;
                }
            }
            ChunkLists { starts, pairs }
        })
        .collect();
    BinLists { bins, chunks }
}
