// Pass `raster`: blends each tile's list into its pixels; each thread processes eight pixels of a column.
// CPU twin: sharp/src/render/raster.rs.
//
// Eight pixels share the cost of fetching a Gaussian. A pixel's sums follow the order of its list and involve no other
// pixel, so its bits depend neither on its neighbours nor on the tile's size.

@group(0) @binding(0) var<uniform> frame: Frame;
@group(0) @binding(1) var<storage, read> ranges: array<vec2<u32>>;
@group(0) @binding(2) var<storage, read> members: array<u32>;
@group(0) @binding(3) var<storage, read> splats: array<vec4<f32>>;
@group(0) @binding(4) var<storage, read> details: array<vec4<f32>>;
@group(0) @binding(5) var<storage, read> colors: array<vec4<f32>>;
// Premultiplied RGB and alpha; rows of the sub-frame, padded to whole tiles.
@group(0) @binding(6) var<storage, read_write> picture: array<vec4<f32>>;
@group(0) @binding(7) var<storage, read_write> depths: array<f32>;

// Pixels of a column per thread.
const STRIP: u32 = 8u;

// Four vertically adjacent pixels.
struct Four {
    red: vec4<f32>,
    green: vec4<f32>,
    blue: vec4<f32>,
    depth: vec4<f32>,
    // Remaining transmittance; 0 for a finished pixel, whose final transmittance is in `done`.
    transmittance: vec4<f32>,
    done: vec4<f32>,
}

// State of the pixels before the first Gaussian.
fn untouched() -> Four {
    let zero = vec4<f32>(0.0);
    return Four(zero, zero, zero, zero, vec4<f32>(1.0), zero);
}

// State of the pixels after one more Gaussian, whose centre is at offset `d`.
fn blended(
    before: Four,
    dx: f32,
    dy: vec4<f32>,
    splat: vec4<f32>,
    detail: vec4<f32>,
    color: vec4<f32>,
) -> Four {
    let across = fma(vec4<f32>(splat.z), vec4<f32>(dx), splat.w * dy);
    let along = detail.x * dy;
    let exponent = fma(across, across, along * along);
    let alpha = min(vec4<f32>(frame.alpha_max), detail.y * exp2_exact(-exponent));
    let hit = alpha >= vec4<f32>(ALPHA_MIN);
    let left = fma(-alpha, before.transmittance, before.transmittance);
    let goes_on = left > vec4<f32>(TRANSMITTANCE_STOP);
    let adds = hit & goes_on;
    // A pixel whose transmittance would fall below the stop threshold is finished, without this Gaussian.
    let stops = hit & !goes_on;
    let zero = vec4<f32>(0.0);
    let weight = select(zero, alpha * before.transmittance, adds);
    return Four(
        fma(weight, vec4<f32>(color.x), before.red),
        fma(weight, vec4<f32>(color.y), before.green),
        fma(weight, vec4<f32>(color.z), before.blue),
        fma(weight, vec4<f32>(detail.z), before.depth),
        select(select(before.transmittance, zero, stops), left, adds),
        before.done + select(zero, before.transmittance, stops),
    );
}

fn write(pixels: Four, first: u32, stride: u32) {
    let alpha = 1.0 - (pixels.transmittance + pixels.done);
    for (var i = 0u; i < 4u; i++) {
        let at = first + i * stride;
        picture[at] = vec4<f32>(pixels.red[i], pixels.green[i], pixels.blue[i], alpha[i]);
        depths[at] = pixels.depth[i];
    }
}

@compute @workgroup_size(8, 4)
fn raster(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(local_invocation_id) local: vec3<u32>,
) {
    // First pixel of the strip, relative to the sub-frame.
    let within = (group.xy * vec2<u32>(8u, 4u) + local.xy) * vec2<u32>(1u, STRIP);
    let tile = within >> vec2<u32>(frame.shift);
    if tile.y >= frame.tiles.y {
        return;
    }
    let corner = vec2<f32>((frame.first << vec2<u32>(frame.shift)) + within) + 0.5;
    let upper_rows = corner.y + vec4<f32>(0.0, 1.0, 2.0, 3.0);
    let lower_rows = corner.y + vec4<f32>(4.0, 5.0, 6.0, 7.0);
    let range = ranges[tile.y * frame.tiles.x + tile.x];
    var upper = untouched();
    var lower = untouched();
    for (var i = range.x; i < range.y; i++) {
        let k = members[i];
        let splat = splats[k];
        let detail = details[k];
        let color = colors[k];
        let dx = splat.x - corner.x;
        upper = blended(upper, dx, splat.y - upper_rows, splat, detail, color);
        lower = blended(lower, dx, splat.y - lower_rows, splat, detail, color);
        if all(max(upper.transmittance, lower.transmittance) == vec4<f32>(0.0)) {
            break;
        }
    }
    let stride = frame.tiles.x << frame.shift;
    let at = within.y * stride + within.x;
    write(upper, at, stride);
    write(lower, at + 4u * stride, stride);
}
