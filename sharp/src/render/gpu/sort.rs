//! Stable radix sort of (key, value) pairs, and the prefix sums it is based on.

use super::device::Gpu;
use super::layout::{RadixParams, ScanParams};
use super::memory::GpuBuffer;
use super::passes::Passes;
use bytemuck::Zeroable;
use wgpu::CommandEncoder;

/// Keys per block of the radix passes.
const RADIX_BLOCK: u32 = 4096;
/// Entries per block of the scan.
const SCAN_BLOCK: u32 = 1024;

/// Prefix sums on the device. `levels` are the sums of the blocks of the data, the sums of the blocks of those sums,
/// and so on.
pub(super) struct Scan {
    levels: Vec<GpuBuffer>,
}

impl Scan {
    /// Creates buffers for up to `entries` entries.
    pub(super) fn new(gpu: &Gpu, entries: u64) -> Self {
        let mut levels = Vec::new();
        let mut blocks = entries;
        loop {
            blocks = blocks.div_ceil(u64::from(SCAN_BLOCK));
            levels.push(gpu.storage("sums", blocks * 4));
            if blocks <= 1 {
                return Self { levels };
            }
        }
    }

    /// Exclusive prefix sums of the first `count` entries, in place.
    pub(super) fn scan(
        &self,
        gpu: &Gpu,
        passes: &Passes,
        encoder: &mut CommandEncoder,
        data: &GpuBuffer,
        count: u32,
    ) {
        self.blocks(gpu, passes, encoder, (0, data), count);
        self.join(gpu, passes, encoder, (0, data), count);
    }

    /// Like [`Self::scan`], but also copies the sums of the blocks to the host; returns a staging
    /// buffer and its length in bytes. The total of the block sums, unlike the last prefix sum,
    /// need not fit in 32 bits.
    pub(super) fn scan_and_stage(
        &self,
        gpu: &Gpu,
        passes: &Passes,
        encoder: &mut CommandEncoder,
        data: &GpuBuffer,
        count: u32,
    ) -> (GpuBuffer, u64) {
        self.blocks(gpu, passes, encoder, (0, data), count);
        let bytes = u64::from(count.div_ceil(SCAN_BLOCK)) * 4;
        let staged = gpu.stage(encoder, &self.levels[0], bytes);
        self.join(gpu, passes, encoder, (0, data), count);
        (staged, bytes)
    }

    /// Scans each block by itself and writes the blocks' sums to `levels[level]`.
    fn blocks(
        &self,
        gpu: &Gpu,
        passes: &Passes,
        encoder: &mut CommandEncoder,
        (level, data): (usize, &GpuBuffer),
        count: u32,
    ) {
        let params = gpu.uniform("scan", &scan_params(count));
        let buffers = [&params, data, &self.levels[level]];
        let groups = count.div_ceil(SCAN_BLOCK);
        gpu.run(encoder, &passes.scan_blocks, &buffers, groups);
    }

    /// Adds the sums of all preceding blocks to each block.
    fn join(
        &self,
        gpu: &Gpu,
        passes: &Passes,
        encoder: &mut CommandEncoder,
        (level, data): (usize, &GpuBuffer),
        count: u32,
    ) {
        let blocks = count.div_ceil(SCAN_BLOCK);
        if blocks <= 1 {
            return;
        }
        let sums = &self.levels[level];
        self.blocks(gpu, passes, encoder, (level + 1, sums), blocks);
        self.join(gpu, passes, encoder, (level + 1, sums), blocks);
        let params = gpu.uniform("scan", &scan_params(count));
        gpu.run(encoder, &passes.add_sums, &[&params, data, sums], blocks);
    }
}

fn scan_params(count: u32) -> ScanParams {
    ScanParams {
        count,
        ..Zeroable::zeroed()
    }
}

/// Keys and values, double-buffered: a pass reads one half and writes the other.
pub(super) struct SortBuffers {
    pub(super) keys: [GpuBuffer; 2],
    pub(super) values: [GpuBuffer; 2],
    histogram: GpuBuffer,
    scan: Scan,
    capacity: u64,
}

/// Bytes per pair over all buffers, to within a thousandth.
pub(super) const PAIR_BYTES: u64 = 16;

impl SortBuffers {
    pub(super) fn new(gpu: &Gpu, capacity: u64) -> Self {
        let make = |label| gpu.storage(label, capacity * 4);
        let entries = capacity.div_ceil(u64::from(RADIX_BLOCK)) * 256;
        Self {
            keys: [make("keys"), make("keys")],
            values: [make("values"), make("values")],
            histogram: gpu.storage("histogram", entries * 4),
            scan: Scan::new(gpu, entries),
            capacity,
        }
    }

    /// Makes room for `count` pairs, plus some headroom if the window allows, so that the next sub-frame fits as well.
    pub(super) fn grow(&mut self, gpu: &Gpu, count: u32) {
        let count = u64::from(count);
        if count > self.capacity {
            let roomy = (count * 5 / 4).min(gpu.window() / PAIR_BYTES);
            // Frees the old buffers first.
            *self = Self::new(gpu, 0);
            *self = Self::new(gpu, roomy.max(count));
        }
    }

    /// Sorts by the low `bits` bits of the keys in half 0, 8 bits per pass; returns the half that contains the result.
    /// With `identity`, the values are initialised to the indices.
    pub(super) fn sort(
        &self,
        gpu: &Gpu,
        passes: &Passes,
        encoder: &mut CommandEncoder,
        (count, bits): (u32, u32),
        identity: bool,
    ) -> usize {
        let blocks = count.div_ceil(RADIX_BLOCK);
        let mut from = 0;
        for shift in (0..bits).step_by(8) {
            let to = 1 - from;
            let params = RadixParams {
                count,
                shift,
                blocks,
                identity: u32::from(identity && shift == 0),
            };
            let params = gpu.uniform("radix", &params);
            let buffers = [
                &params,
                &self.keys[from],
                &self.histogram,
                &self.values[from],
                &self.keys[to],
                &self.values[to],
            ];
            gpu.run(encoder, &passes.radix_histogram, &buffers[..3], blocks);
            self.scan
                .scan(gpu, passes, encoder, &self.histogram, blocks * 256);
            gpu.run(encoder, &passes.radix_scatter, &buffers, blocks);
            from = to;
        }
        from
    }
}
