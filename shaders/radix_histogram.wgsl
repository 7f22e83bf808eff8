// Pass `radix_histogram`: how often each digit occurs in each block of keys.

@group(0) @binding(0) var<uniform> params: RadixParams;
@group(0) @binding(1) var<storage, read> keys: array<u32>;
// Digit by digit, block by block, so that its scan gives each block its places.
@group(0) @binding(2) var<storage, read_write> histogram: array<u32>;

var<workgroup> counts: array<atomic<u32>, 256>;

@compute @workgroup_size(256)
fn radix_histogram(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let block = group_index(group, groups);
    atomicStore(&counts[local], 0u);
    workgroupBarrier();
    for (var round = 0u; round < ROUNDS; round++) {
        let i = (block * ROUNDS + round) * DIGITS + local;
        if i < params.count {
            // The order of these additions does not show in the sum.
            atomicAdd(&counts[digit_of(keys[i], params.shift)], 1u);
        }
    }
    workgroupBarrier();
    if block < params.blocks {
        histogram[local * params.blocks + block] = atomicLoad(&counts[local]);
    }
}
