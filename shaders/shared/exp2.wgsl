// 2^x for -126 <= x <= 0, the CPU's polynomial: the built-in may be off by many units.
fn exp2_exact(exponent: f32) -> f32 {
    let x = max(exponent, -126.0);
    let whole = round(x);
    let f = x - whole;
    var sum = 0.0013264727;
    sum = fma(sum, f, 0.009671513);
    sum = fma(sum, f, 0.055507336);
    sum = fma(sum, f, 0.24022242);
    sum = fma(sum, f, 0.693147);
    sum = fma(sum, f, 1.0);
    return sum * bitcast<f32>(u32(i32(whole) + 127) << 23u);
}
