// A sub-frame: a rectangle of tiles that is binned and rasterised together.

struct Frame {
    // First tile, and the number of tiles in x and y.
    first: vec2<u32>,
    tiles: vec2<u32>,
    // Number of Gaussians in the scene, and of (tile, Gaussian) pairs in the sub-frame.
    count: u32,
    pairs: u32,
    // A tile's side is 2^shift pixels.
    shift: u32,
    // Upper bound on the alpha of one Gaussian in a pixel.
    alpha_max: f32,
}

// First and last tile, relative to the sub-frame: x0, y0, x1, y1. Empty if first > last.
fn tiles_of(footprint: vec2<u32>, frame: Frame) -> vec4<i32> {
    let low = vec2<i32>((footprint & vec2<u32>(0xffffu)) >> vec2<u32>(frame.shift));
    let high = vec2<i32>(footprint >> vec2<u32>(16u + frame.shift));
    let first = vec2<i32>(frame.first);
    let most = vec2<i32>(frame.tiles) - 1;
    return vec4<i32>(max(low - first, vec2<i32>(0)), min(high - first, most));
}

fn is_empty(footprint: vec2<u32>) -> bool {
    return (footprint.x & 0xffffu) > (footprint.x >> 16u);
}
