// Pass `harmonics`: view-dependent colours of the Gaussians.
// CPU twin: sharp/src/render/harmonics.rs.

@group(0) @binding(0) var<uniform> view: View;
// Mean (xyz) and opacity (w).
@group(0) @binding(1) var<storage, read> means: array<vec4<f32>>;
// Constant term of the colour.
@group(0) @binding(2) var<storage, read> colors: array<vec4<f32>>;
// Three values (RGB) per coefficient, `view.stored` coefficients per Gaussian.
@group(0) @binding(3) var<storage, read> coefficients: array<f32>;
@group(0) @binding(4) var<storage, read_write> seen: array<vec4<f32>>;

@compute @workgroup_size(256)
fn harmonics(
    @builtin(workgroup_id) group: vec3<u32>,
    @builtin(num_workgroups) groups: vec3<u32>,
    @builtin(local_invocation_index) local: u32,
) {
    let k = group_index(group, groups) * 256u + local;
    if k >= view.count {
        return;
    }
    var color = colors[k].xyz;
    if view.degree > 0u {
        let basis = basis_at(normalize(means[k].xyz - view.eye.xyz));
        let drawn = (view.degree + 1u) * (view.degree + 1u) - 1u;
        for (var i = 0u; i < drawn; i++) {
            let at = 3u * (k * view.stored + i);
            color += basis[i] * vec3<f32>(coefficients[at], coefficients[at + 1u], coefficients[at + 2u]);
        }
    }
    seen[k] = vec4<f32>(max(color, vec3<f32>(0.0)), 0.0);
}

// Basis functions without the constant one.
fn basis_at(d: vec3<f32>) -> array<f32, 24> {
    let x = d.x;
    let y = d.y;
    let z = d.z;
    let xx = x * x;
    let yy = y * y;
    let zz = z * z;
    return array<f32, 24>(
        -0.48860252 * y,
        0.48860252 * z,
        -0.48860252 * x,
        1.0925485 * x * y,
        -1.0925485 * y * z,
        0.31539157 * (2.0 * zz - xx - yy),
        -1.0925485 * x * z,
        0.54627424 * (xx - yy),
        -0.5900436 * y * (3.0 * xx - yy),
        2.8906114 * x * y * z,
        -0.4570458 * y * (4.0 * zz - xx - yy),
        0.37317634 * z * (2.0 * zz - 3.0 * xx - 3.0 * yy),
        -0.4570458 * x * (4.0 * zz - xx - yy),
        1.4453057 * z * (xx - yy),
        -0.5900436 * x * (xx - 3.0 * yy),
        2.5033429 * x * y * (xx - yy),
        -1.7701308 * y * z * (3.0 * xx - yy),
        0.9461747 * x * y * (7.0 * zz - 1.0),
        -0.6690465 * y * z * (7.0 * zz - 3.0),
        0.10578555 * (35.0 * zz * zz - 30.0 * zz + 3.0),
        -0.6690465 * x * z * (7.0 * zz - 3.0),
        0.47308734 * (xx - yy) * (7.0 * zz - 1.0),
        -1.7701308 * x * z * (xx - 3.0 * yy),
        0.6258357 * (xx * (xx - 3.0 * yy) - yy * (3.0 * xx - yy)),
    );
}
