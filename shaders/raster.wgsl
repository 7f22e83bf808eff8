// Pass `raster`: blends each tile's list into its pixels; one thread owns one pixel.
// CPU twin: sharp/src/render/raster.rs.

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> ranges: array<vec2<u32>>;
@group(0) @binding(2) var<storage, read> members: array<u32>;
@group(0) @binding(3) var<storage, read> splats: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> details: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> colors: array<vec4<f32>>;
// Linear RGB, premultiplied, and alpha; rows of the sub-frame in whole tiles.
@group(0) @binding(6) var<storage, read_write> picture: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read_write> depths: array<f32>;

@compute @workgroup_size(8, 8)
fn raster(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_id) local: vec3<u32>,
) {
    let within = group.xy * TILE + local.xy;
    let pixel = vec2<f32>(frame.first * TILE + within) + 0.5;
    let range = ranges[group.y * frame.tiles.x + group.x];
    var color = vec3<f32>(0.0);
    var depth = 0.0;
    var transmittance = 1.0;
    for (var i = range.x; i < range.y; i++) {
        let k = members[i];
        let splat = splats[k];
        let detail = details[k];
        let d = splat.xy - pixel;
        let across = fma(splat.z, d.x, splat.w * d.y);
        let along = detail.x * d.y;
        let exponent = fma(across, across, along * along);
        let alpha = min(ALPHA_MAX, detail.y * exp2_exact(-exponent));
        if alpha >= ALPHA_MIN {
            let left = fma(-alpha, transmittance, transmittance);
            if left <= TRANSMITTANCE_STOP {
                break;
            }
            let weight = alpha * transmittance;
            color = fma(vec3<f32>(weight), colors[k].xyz, color);
            depth = fma(weight, detail.z, depth);
            transmittance = left;
        }
    }
    let at = within.y * frame.tiles.x * TILE + within.x;
    picture[at] = vec4<f32>(color, 1.0 - transmittance);
    depths[at] = depth;
}
