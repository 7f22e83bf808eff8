// Pass `ranges`: start and end of each tile's list in the sorted pairs. Tiles without pairs keep the zeros written by
// the host.
// CPU twin: sharp/src/render/ranges.rs.

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> tiles: array<u32>;
@group(0) @binding(2) var<storage, read_write> ranges: array<vec2<u32>>;

@compute @workgroup_size(256)
fn find_ranges(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let i = group_index(group, groups) * 256u + local;
    if i >= frame.pairs {
        return;
    }
    let tile = tiles[i];
    if i == 0u || tiles[max(i, 1u) - 1u] != tile {
        ranges[tile].x = i;
    }
    if i + 1u == frame.pairs || tiles[min(i + 1u, frame.pairs - 1u)] != tile {
        ranges[tile].y = i + 1u;
    }
}
