// 2^x for x <= 0, at least 2^-126, by the same polynomial as on the CPU: the built-in may be off by many units in the
// last place.
fn exp2_exact(exponent: vec4<f32>) -> vec4<f32> {
    let x = max(exponent, vec4<f32>(-126.0));
    let whole = round(x);
    let f = x - whole;
    var sum = vec4<f32>(0.0013264727);
    sum = fma(sum, f, vec4<f32>(0.009671513));
    sum = fma(sum, f, vec4<f32>(0.055507336));
    sum = fma(sum, f, vec4<f32>(0.24022242));
    sum = fma(sum, f, vec4<f32>(0.693147));
    sum = fma(sum, f, vec4<f32>(1.0));
    return sum * bitcast<vec4<f32>>(vec4<u32>(vec4<i32>(whole) + 127) << vec4<u32>(23u));
}
