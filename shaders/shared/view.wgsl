// The view and the constants of the definition, as every pass sees them.

struct View {
    // Rows of the affine map from scene to camera, the offset in w.
    row0: vec4<f32>,
    row1: vec4<f32>,
    row2: vec4<f32>,
    // What rounding row2 to f32 left over.
    row2_rest: vec4<f32>,
    // Focal lengths, principal point, pixels.
    focal: vec2<f32>,
    center: vec2<f32>,
    // Slopes x/z and y/z at which the Jacobian may be taken: x low, x high, y low, y high.
    bounds: vec4<f32>,
    // Of the image, pixels.
    size: vec2<f32>,
    // Square pixels.
    eps2d: f32,
    // Metres.
    near: f32,
    far: f32,
    // Gaussians in the scene.
    count: u32,
    // 0: what no compiler can know, see `opaque` in project.wgsl.
    zero: u32,
    // What makes up for the low-pass: 0 nothing, 1 the root of the determinants' ratio, 2 the same
    // with a floor, 3 Mip-Splatting's.
    compensation: u32,
    // 1 where the support ends with tiles of 16x16 pixels.
    tiled: u32,
    // Harmonics that are drawn, and how many coefficients a Gaussian has beyond the constant one.
    degree: u32,
    stored: u32,
    padding: u32,
    // The camera's centre among the means.
    eye: vec4<f32>,
}

const ALPHA_MIN: f32 = 1.0 / 255.0;
const TRANSMITTANCE_STOP: f32 = 1e-4;
// sqrt(log2(e) / 2): brings the exponent of e to one of 2.
const TO_LOG2: f32 = 0.84932180;
// The key of a Gaussian that is not drawn: behind all others.
const CULLED: u32 = 0xffffffffu;

// Workgroups are numbered over two axes, because one holds only 65535.
fn group_index(group: vec3<u32>, groups: vec3<u32>) -> u32 {
    return group.y * groups.x + group.x;
}
