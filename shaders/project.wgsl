// Pass `project`: computes every Gaussian's splat, pixel bounding box and depth key.
// CPU twin: sharp/src/render/project.rs.

@group(0) @binding(0) var<uniform> view: View;
// Mean (xyz) and opacity (w).
@group(0) @binding(1) var<storage, read> means: array<vec4<f32>>;
// (w, x, y, z), not normalised.
@group(0) @binding(2) var<storage, read> quaternions: array<vec4<f32>>;
// Standard deviations (xyz); w is 1 if every attribute is finite, else 0.
@group(0) @binding(3) var<storage, read> scales: array<vec4<f32>>;
// Mean in pixels (xy), then p and q of the conic's factor (zw).
@group(0) @binding(4) var<storage, read_write> splats: array<vec4<f32>>;
// r of the conic's factor, opacity, z.
@group(0) @binding(5) var<storage, read_write> details: array<vec4<f32>>;
// x0 | x1 << 16, y0 | y1 << 16, in pixels, inclusive; x0 > x1 if no pixel is reached.
@group(0) @binding(6) var<storage, read_write> footprints: array<vec2<u32>>;
@group(0) @binding(7) var<storage, read_write> keys: array<u32>;
// Number of dropped Gaussians, by reason.
@group(0) @binding(8) var<storage, read_write> dropped: array<atomic<u32>>;

const NOT_FINITE: u32 = 0u;
const ZERO_QUATERNION: u32 = 1u;
const NEAR: u32 = 2u;
const FAR: u32 = 3u;
const DEGENERATE: u32 = 4u;
const TRANSPARENT: u32 = 5u;
const OUTSIDE: u32 = 6u;
const DRAWN: u32 = 7u;

const MAX_EXTENT: f32 = 3.33;
// Side of the tiles that bound the support, in pixels.
const SUPPORT_TILE: f32 = 16.0;

// Opacity factor that compensates for the low-pass filter. The determinants, without and with the filter, are in units
// of `unit` to the power of four.
fn compensation(sharp: f32, blurred: f32, unit: f32) -> f32 {
    if view.compensation == 0u {
        return 1.0;
    }
    if view.compensation == 3u {
        let least = 1e-6 / unit / unit / unit / unit;
        if sharp <= least || blurred <= least {
            return 0.0;
        }
        return sqrt(sharp / (blurred + least) + 1e-6);
    }
    return sqrt(max(sharp / blurred, select(0.0, 2.5e-5, view.compensation == 2u)));
}

// Tests the bits, because a compiler may assume that arithmetic never yields NaN.
fn is_finite(x: f32) -> bool {
    return (bitcast<u32>(x) & 0x7f800000u) != 0x7f800000u;
}

// An unevaluated sum of two f32, with twice the precision of one.
struct Sum {
    high: f32,
    low: f32,
}

// Upper half of the significand's bits, so that products of halves are exact. fma is not used, because it need not be
// fused.
fn upper(x: f32) -> f32 {
    return bitcast<f32>(bitcast<u32>(x) & 0xfffff000u);
}

// Identity that the compiler cannot see through: some compilers simplify (a + b) - a to b.
fn opaque(x: f32) -> f32 {
    return bitcast<f32>(bitcast<u32>(x) ^ view.zero);
}

// Adds a * (b + b_rest) to `sum`.
fn add_product(sum: Sum, a: f32, b: f32, b_rest: f32) -> Sum {
    let product = a * b;
    let a_high = upper(a);
    let b_high = upper(b);
    let a_low = a - a_high;
    let b_low = b - b_high;
    let rounding = ((a_high * b_high - product) + a_high * b_low + a_low * b_high) + a_low * b_low;
    let high = opaque(sum.high + product);
    let added = opaque(high - sum.high);
    let lost = (sum.high - (high - added)) + (product - added);
    return Sum(high, sum.low + (lost + (rounding + a * b_rest)));
}

// z of the centre, rounded as the host rounds it from f64: the order of near-equal depths depends on it.
fn depth_of(mean: vec3<f32>) -> f32 {
    var sum = Sum(0.0, 0.0);
    sum = add_product(sum, mean.x, view.row2.x, view.row2_rest.x);
    sum = add_product(sum, mean.y, view.row2.y, view.row2_rest.y);
    sum = add_product(sum, mean.z, view.row2.z, view.row2_rest.z);
    sum = add_product(sum, 1.0, view.row2.w, view.row2_rest.w);
    return sum.high + sum.low;
}

@compute @workgroup_size(256)
fn project(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let k = group_index(group, groups) * 256u + local;
    if k >= view.count {
        return;
    }
    keys[k] = CULLED;
    footprints[k] = vec2<u32>(1u, 1u);
    let reason = project_one(k);
    if reason != DRAWN {
        atomicAdd(&dropped[reason], 1u);
    }
}

fn project_one(k: u32) -> u32 {
    let mean = means[k];
    let scale = scales[k];
    if scale.w == 0.0 {
        return NOT_FINITE;
    }
    // Normalised by the largest entry first, so that squares neither overflow nor underflow.
    let raw = quaternions[k];
    let magnitude = max(max(abs(raw.x), abs(raw.y)), max(abs(raw.z), abs(raw.w)));
    if magnitude == 0.0 {
        return ZERO_QUATERNION;
    }
    let point = vec4<f32>(mean.xyz, 1.0);
    let z = depth_of(mean.xyz);
    if !(z >= view.near) {
        return NEAR;
    }
    if z > view.far {
        return FAR;
    }
    let slope = vec2<f32>(dot(view.row0, point), dot(view.row1, point)) / z;
    let center = view.focal * slope + view.center;
    let at = clamp(slope, view.bounds.xz, view.bounds.yw);
    let gain = view.focal / z;
    let gx = gain.x * (view.row0.xyz - at.x * view.row2.xyz);
    let gy = gain.y * (view.row1.xyz - at.y * view.row2.xyz);

    let q = normalize(raw / magnitude);
    let r0 = vec3<f32>(
        1.0 - 2.0 * (q.z * q.z + q.w * q.w),
        2.0 * (q.y * q.z + q.x * q.w),
        2.0 * (q.y * q.w - q.x * q.z),
    );
    let r1 = vec3<f32>(
        2.0 * (q.y * q.z - q.x * q.w),
        1.0 - 2.0 * (q.y * q.y + q.w * q.w),
        2.0 * (q.z * q.w + q.x * q.y),
    );
    let r2 = vec3<f32>(
        2.0 * (q.y * q.w + q.x * q.z),
        2.0 * (q.z * q.w - q.x * q.y),
        1.0 - 2.0 * (q.y * q.y + q.z * q.z),
    );
    let wide_u = vec3<f32>(dot(gx, r0), dot(gx, r1), dot(gx, r2)) * scale.xyz;
    let wide_v = vec3<f32>(dot(gy, r0), dot(gy, r1), dot(gy, r2)) * scale.xyz;
    let largest = max(abs(wide_u), abs(wide_v));
    let unit = max(largest.x, max(largest.y, largest.z));
    // In units of the largest entry, so that squares neither overflow nor underflow.
    let eps = view.eps2d / unit / unit;
    let u = wide_u / unit;
    let v = wide_v / unit;
    let uu = dot(u, u);
    let vv = dot(v, v);
    let minors = cross(u, v);
    // By the Cauchy-Binet formula, which has no cancellation.
    let sharp = dot(minors, minors);
    let determinant = sharp + eps * (uu + vv) + eps * eps;
    let root = sqrt(determinant);
    let a = sqrt(uu + eps);
    let d = sqrt(vv + eps);
    let factor = TO_LOG2 / unit * vec3<f32>(d / root, -dot(u, v) / (d * root), 1.0 / d);
    let opacity = mean.w * compensation(sharp, determinant, unit);
    // The opacity is at least 1/255 wherever this value is used.
    let extent = sqrt(2.0 * log(max(255.0 * opacity, 1.0)));
    let reach = vec2<f32>(a, d) * (unit * extent);
    let drawable = determinant > 0.0 && unit > 0.0 && is_finite(factor.x) && is_finite(factor.y)
        && is_finite(factor.z) && is_finite(reach.x) && is_finite(reach.y)
        && is_finite(center.x) && is_finite(center.y);
    if !drawable {
        return DEGENERATE;
    }
    if !(opacity >= ALPHA_MIN) {
        return TRANSPARENT;
    }
    let size = view.size;
    let radius = ceil(vec2<f32>(a, d) * (unit * min(extent, MAX_EXTENT)));
    if any(center + radius <= vec2<f32>(0.0)) || any(center - radius >= size) {
        return OUTSIDE;
    }
    splats[k] = vec4<f32>(center, factor.xy);
    details[k] = vec4<f32>(factor.z, opacity, z, 0.0);
    keys[k] = bitcast<u32>(z);
    // Conservative: wider than rounding in `raster` can extend the 1/255 contour.
    let wide = reach * 1.0001 + vec2<f32>(0.01) + abs(center) * 1e-6;
    var first = max(ceil(center - 0.5 - wide), vec2<f32>(0.0));
    var last = min(floor(center - 0.5 + wide), size - 1.0);
    if view.tiled == 1u {
        // Inria's radius: three standard deviations along the longer axis, in whole pixels.
        let variance = vec2<f32>(a, d) * unit * vec2<f32>(a, d) * unit;
        let half = 0.5 * (variance.x - variance.y);
        let across = dot(u, v) * unit * unit;
        let root = sqrt(max(0.1, half * half + across * across));
        let three = ceil(3.0 * sqrt(0.5 * (variance.x + variance.y) + root));
        first = max(first, trunc((center - 0.5 - three) / SUPPORT_TILE) * SUPPORT_TILE);
        let end = trunc((center - 0.5 + three + SUPPORT_TILE - 1.0) / SUPPORT_TILE) * SUPPORT_TILE;
        last = min(last, end - 1.0);
    }
    if all(first <= last) {
        let low = vec2<u32>(first);
        let high = vec2<u32>(last);
        footprints[k] = low | (high << vec2<u32>(16u));
    }
    return DRAWN;
}
