//! Stable radix sort of (key, value) pairs and the prefix sums it stands on.

use super::device::Gpu;
use super::passes::Passes;
use wgpu::{Buffer, CommandEncoder};

/// Keys and values, twice: a pass reads one half and writes the other.
pub(super) struct SortBuffers {
    pub(super) keys: [Buffer; 2],
    pub(super) values: [Buffer; 2],
    capacity: u64,
}

/// Keys in a block of the radix passes.
const RADIX_BLOCK: u32 = 4096;
/// Entries in a block of the scan.
const SCAN_BLOCK: u32 = 1024;

impl SortBuffers {
    /// Room for `capacity` pairs.
    pub(super) fn new(gpu: &Gpu, capacity: u64) -> Self {
        let make = |label| gpu.storage(label, capacity * 4);
        Self {
            keys: [make("keys"), make("keys")],
            values: [make("values"), make("values")],
            capacity,
        }
    }

    /// The same buffers if they hold `count` pairs, else larger ones.
    pub(super) fn grown(self, gpu: &Gpu, count: u32) -> Self {
        if u64::from(count) <= self.capacity {
            return self;
        }
        let most = gpu.binding_limit / 4;
        let wanted = (u64::from(count) * 5 / 4).min(most).max(u64::from(count));
        drop(self);
        Self::new(gpu, wanted)
    }
}

/// Sorts by the low `bits` bits of the keys in half 0, 8 bits a pass; returns the half that holds
/// the result. With `identity` the values start out as the indices.
pub(super) fn sort(
    gpu: &Gpu,
    passes: &Passes,
    encoder: &mut CommandEncoder,
    pairs: &SortBuffers,
    (count, bits): (u32, u32),
    identity: bool,
) -> usize {
    let blocks = count.div_ceil(RADIX_BLOCK);
    let histogram = gpu.storage("histogram", u64::from(blocks) * 256 * 4);
    let mut from = 0;
    for shift in (0..bits).step_by(8) {
        let to = 1 - from;
        let first = u32::from(identity && shift == 0);
        let params = gpu.uniform("radix", &[count, shift, blocks, first]);
        gpu.run(
            encoder,
            &passes.radix_histogram,
            &[&params, &pairs.keys[from], &histogram],
            blocks,
        );
        scan(gpu, passes, encoder, &histogram, blocks * 256);
        gpu.run(
            encoder,
            &passes.radix_scatter,
            &[
                &params,
                &pairs.keys[from],
                &pairs.values[from],
                &histogram,
                &pairs.keys[to],
                &pairs.values[to],
            ],
            blocks,
        );
        from = to;
    }
    from
}

/// Exclusive prefix sums of the first `count` entries, in place.
pub(super) fn scan(
    gpu: &Gpu,
    passes: &Passes,
    encoder: &mut CommandEncoder,
    data: &Buffer,
    count: u32,
) {
    let blocks = count.div_ceil(SCAN_BLOCK);
    let sums = gpu.storage("sums", u64::from(blocks) * 4);
    let params = gpu.uniform("scan", &[count, 0, 0, 0]);
    let buffers = [&params, data, &sums];
    gpu.run(encoder, &passes.scan_blocks, &buffers, blocks);
    if blocks > 1 {
        scan(gpu, passes, encoder, &sums, blocks);
        gpu.run(encoder, &passes.add_sums, &buffers, blocks);
    }
}
