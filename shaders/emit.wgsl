// Pass `emit`: in depth order, writes one (tile, Gaussian) pair for each tile that a Gaussian reaches.
// `count_tiles` runs first; a scan of its counts gives every thread its place to write, without atomics.
// CPU twin: sharp/src/render/emit.rs.

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> order: array<u32>;
@group(0) @binding(2) var<storage, read> footprints: array<vec2<u32>>;
// Number of pairs per Gaussian, later their start offsets; one entry more than there are Gaussians.
@group(0) @binding(3) var<storage, read_write> places: array<u32>;
@group(0) @binding(4) var<storage, read_write> tiles: array<u32>;
@group(0) @binding(5) var<storage, read_write> members: array<u32>;

@compute @workgroup_size(256)
fn count_tiles(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let j = group_index(group, groups) * 256u + local;
    if j > frame.count {
        return;
    }
    var count = 0u;
    if j < frame.count {
        let footprint = footprints[order[j]];
        if !is_empty(footprint) {
            let t = tiles_of(footprint, frame);
            let size = max(t.zw - t.xy + 1, vec2<i32>(0));
            count = u32(size.x) * u32(size.y);
        }
    }
    places[j] = count;
}

@compute @workgroup_size(256)
fn emit(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let j = group_index(group, groups) * 256u + local;
    if j >= frame.count {
        return;
    }
    let k = order[j];
    let footprint = footprints[k];
    if is_empty(footprint) {
        return;
    }
    let t = tiles_of(footprint, frame);
    var place = places[j];
    for (var y = t.y; y <= t.w; y++) {
        for (var x = t.x; x <= t.z; x++) {
            tiles[place] = u32(y) * frame.tiles.x + u32(x);
            members[place] = k;
            place++;
        }
    }
}
