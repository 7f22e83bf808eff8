// Pass `radix`: one digit of a stable, least-significant-first sort of keys and their values.
// CPU twin: sharp/src/render/radix.rs.
//
// `radix_histogram` counts how often each digit occurs in each block of keys; the scanned counts are the offsets at
// which each block writes its keys. `radix_scatter` moves the keys; equal digits keep their order. Each round ranks 256
// keys at once: each key sets its bit in the mask of its digit, and its rank is the number of lower bits set. Setting
// bits is commutative, so timing cannot change the result.

@group(0) @binding(0) var<uniform> params: RadixParams;
@group(0) @binding(1) var<storage, read> keys: array<u32>;
// Digit by digit, block by block: counts, later offsets.
@group(0) @binding(2) var<storage, read_write> histogram: array<u32>;
@group(0) @binding(3) var<storage, read> values: array<u32>;
@group(0) @binding(4) var<storage, read_write> keys_out: array<u32>;
@group(0) @binding(5) var<storage, read_write> values_out: array<u32>;

var<workgroup> counts: array<atomic<u32>, 256>;
// Eight words per digit.
var<workgroup> masks: array<atomic<u32>, 2048>;
var<workgroup> next: array<u32, 256>;

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
            // The sum does not depend on the order of these additions.
            atomicAdd(&counts[digit_of(keys[i], params.shift)], 1u);
        }
    }
    workgroupBarrier();
    if block < params.blocks {
        histogram[local * params.blocks + block] = atomicLoad(&counts[local]);
    }
}

@compute @workgroup_size(256)
fn radix_scatter(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let block = group_index(group, groups);
    if block < params.blocks {
        next[local] = histogram[local * params.blocks + block];
    }
    for (var word = 0u; word < 8u; word++) {
        atomicStore(&masks[local * 8u + word], 0u);
    }
    workgroupBarrier();
    for (var round = 0u; round < ROUNDS; round++) {
        let i = (block * ROUNDS + round) * DIGITS + local;
        let valid = i < params.count;
        var key = 0u;
        var digit = 0u;
        if valid {
            key = keys[i];
            digit = digit_of(key, params.shift);
            atomicOr(&masks[digit * 8u + local / 32u], 1u << (local % 32u));
        }
        workgroupBarrier();
        if valid {
            var rank = 0u;
            for (var word = 0u; word < local / 32u; word++) {
                rank += countOneBits(atomicLoad(&masks[digit * 8u + word]));
            }
            let below = (1u << (local % 32u)) - 1u;
            rank += countOneBits(atomicLoad(&masks[digit * 8u + local / 32u]) & below);
            let place = next[digit] + rank;
            keys_out[place] = key;
            if params.identity == 1u {
                values_out[place] = i;
            } else {
                values_out[place] = values[i];
            }
        }
        workgroupBarrier();
        var seen = 0u;
        for (var word = 0u; word < 8u; word++) {
            seen += countOneBits(atomicLoad(&masks[local * 8u + word]));
            atomicStore(&masks[local * 8u + word], 0u);
        }
        next[local] += seen;
        workgroupBarrier();
    }
}
