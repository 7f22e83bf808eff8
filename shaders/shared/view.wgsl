// The view and the rendering constants, shared by all passes.

struct View {
    // Rows of the affine map from scene to camera, with the offset in w.
    row0: vec4<f32>,
    row1: vec4<f32>,
    row2: vec4<f32>,
    // Residual of rounding row2 to f32.
    row2_rest: vec4<f32>,
    // Focal lengths and principal point, in pixels.
    focal: vec2<f32>,
    center: vec2<f32>,
    // Bounds on the slopes x/z and y/z at which the Jacobian is evaluated: x low, x high, y low, y high.
    bounds: vec4<f32>,
    // Image size in pixels.
    size: vec2<f32>,
    // Low-pass variance in square pixels.
    eps2d: f32,
    // Clipping depths in metres.
    near: f32,
    far: f32,
    // Number of Gaussians in the scene.
    count: u32,
    // Always 0, but unknown to the compiler; see `opaque` in project.wgsl.
    zero: u32,
    // Compensation for the low-pass filter: 0 none, 1 the square root of the determinants' ratio, 2 that root with a
    // lower bound, 3 Mip-Splatting's.
    compensation: u32,
    // 1 if the support is limited to tiles of 16x16 pixels.
    tiled: u32,
    // Degree of the harmonics drawn, and number of coefficients stored per Gaussian beyond the constant one.
    degree: u32,
    stored: u32,
    padding: u32,
    // Camera centre in the coordinates of the means.
    eye: vec4<f32>,
}

const ALPHA_MIN: f32 = 1.0 / 255.0;
const TRANSMITTANCE_STOP: f32 = 1e-4;
// sqrt(log2(e) / 2): converts an exponent of e to an exponent of 2.
const TO_LOG2: f32 = 0.84932180;
// Key of a Gaussian that is not drawn; sorts behind all others.
const CULLED: u32 = 0xffffffffu;

// Workgroups are numbered over two axes, because one axis allows only 65535.
fn group_index(group: vec3<u32>, groups: vec3<u32>) -> u32 {
    return group.y * groups.x + group.x;
}
