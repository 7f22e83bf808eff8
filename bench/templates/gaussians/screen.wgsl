// Converts the output of `raster` for the screen: background, sRGB, 8 bit.

struct Screen {
    // Pixels shown, and pixels from one row of the picture to the next.
    size: vec2<u32>,
    stride: u32,
    // 0 colour, 1 alpha, 2 inverse depth.
    shown: u32,
    // In the blending colour space.
    background: vec3<f32>,
    // 1 if levels are truncated, not rounded.
    truncate: u32,
    // Inverse depths shown in black and in white, 1/metres.
    inverse_depth: vec2<f32>,
    // 1 if encoded values were blended.
    encoded: u32,
}

@group(0) @binding(0) var<uniform> screen: Screen;
@group(0) @binding(1) var<storage, read> picture: array<vec4<f32>>;
@group(0) @binding(2) var<storage, read> depths: array<f32>;

@vertex
fn corner(@builtin(vertex_index) index: u32) -> @builtin(position) vec4<f32> {
    // One triangle that covers the screen.
    let at = vec2<f32>(f32((index << 1u) & 2u), f32(index & 2u));
    return vec4<f32>(at * 2.0 - 1.0, 0.0, 1.0);
}

fn encoded(linear: vec3<f32>) -> vec3<f32> {
    let curve = 1.055 * pow(max(linear, vec3<f32>(0.0)), vec3<f32>(1.0 / 2.4)) - 0.055;
    return select(curve, 12.92 * linear, linear <= vec3<f32>(0.0031308));
}

@fragment
fn shade(@builtin(position) position: vec4<f32>) -> @location(0) vec4<f32> {
    let at = min(vec2<u32>(position.xy), screen.size - 1u);
    let place = at.y * screen.stride + at.x;
    let pixel = picture[place];
    var color = vec3<f32>(pixel.a);
    if screen.shown == 0u {
        let blended = pixel.rgb + (1.0 - pixel.a) * screen.background;
        color = select(encoded(blended), blended, screen.encoded == 1u);
    } else if screen.shown == 2u {
        let inverse = pixel.a / max(depths[place], 1e-8);
        let span = screen.inverse_depth.y - screen.inverse_depth.x;
        color = vec3<f32>((inverse - screen.inverse_depth.x) / span) * f32(pixel.a > 0.0);
    }
    let level = clamp(color, vec3<f32>(0.0), vec3<f32>(1.0)) * 255.0;
    let whole = select(floor(level + 0.5), floor(level), screen.truncate == 1u);
    return vec4<f32>(whole / 255.0, 1.0);
}
