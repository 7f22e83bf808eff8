// Pass `scan`: exclusive prefix sums of u32 counts, in place, block by block.
// CPU twin: sharp/src/render/scan.rs.
//
// `scan_blocks` writes each block's total to `sums`; the host scans those in turn, and `add_sums` adds them back. There
// are no atomics, so the result cannot depend on timing.

struct ScanParams {
    count: u32,
    padding_0: u32,
    padding_1: u32,
    padding_2: u32,
}

@group(0) @binding(0) var<uniform> params: ScanParams;
@group(0) @binding(1) var<storage, read_write> data: array<u32>;
@group(0) @binding(2) var<storage, read_write> sums: array<u32>;

const LANES: u32 = 256u;
const PER_LANE: u32 = 4u;

var<workgroup> partial: array<u32, 256>;

@compute @workgroup_size(256)
fn scan_blocks(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let block = group_index(group, groups);
    let first = block * LANES * PER_LANE + local * PER_LANE;
    var values: array<u32, 4>;
    var total = 0u;
    for (var i = 0u; i < PER_LANE; i++) {
        if first + i < params.count {
            values[i] = data[first + i];
        }
        total += values[i];
    }
    partial[local] = total;
    workgroupBarrier();
    for (var step = 1u; step < LANES; step <<= 1u) {
        var before = 0u;
        if local >= step {
            before = partial[local - step];
        }
        workgroupBarrier();
        partial[local] += before;
        workgroupBarrier();
    }
    var running = partial[local] - total;
    for (var i = 0u; i < PER_LANE; i++) {
        if first + i < params.count {
            data[first + i] = running;
        }
        running += values[i];
    }
    if local == LANES - 1u && block * LANES * PER_LANE < params.count {
        sums[block] = partial[local];
    }
}

@compute @workgroup_size(256)
fn add_sums(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let block = group_index(group, groups);
    let first = block * LANES * PER_LANE + local * PER_LANE;
    for (var i = 0u; i < PER_LANE; i++) {
        if first + i < params.count {
            data[first + i] += sums[block];
        }
    }
}
