//! Helpers shared by the tests of the losses.

use sharp::random::SplitMix64;

/// Values in 0.05..1; any two neighbours differ by at least 1e-3.
pub(super) fn noise(seed: u64, count: usize) -> Vec<f32> {
    let mut random = SplitMix64::new(seed);
    let mut out: Vec<f32> = Vec::with_capacity(count);
    while out.len() < count {
        let value = random.between(0.05, 1.0) as f32;
        if out.last().is_none_or(|last| (last - value).abs() > 1e-3) {
            out.push(value);
        }
    }
    out
}

pub(super) fn pixels(values: &[f32]) -> Vec<[f32; 3]> {
    values.as_chunks().0.to_vec()
}

/// Compares a value and its gradient at `x` with an f64 definition: the value to 1e-9, the gradient
/// with central differences to 1e-6 of its largest element, which allows for rounding to f32.
pub(super) fn check(x: &[f32], value: f64, gradient: &[f32], definition: impl Fn(&[f64]) -> f64) {
    check_to([1e-9, 1e-6], x, value, gradient, definition);
}

/// Like [`check`], with other tolerances for the value and the gradient.
pub(super) fn check_to(
    [of_value, of_gradient]: [f64; 2],
    x: &[f32],
    value: f64,
    gradient: &[f32],
    definition: impl Fn(&[f64]) -> f64,
) {
    assert_eq!(gradient.len(), x.len());
    let mut at: Vec<f64> = x.iter().map(|v| f64::from(*v)).collect();
    let exact = definition(&at);
    let deviation = (value - exact).abs();
    assert!(
        deviation <= of_value * exact.abs().max(1e-3),
        "{value} {exact}"
    );
    let largest = gradient.iter().fold(0.0, |m, g| f64::from(g.abs()).max(m));
    assert!(largest > 0.0, "no gradient");
    for i in 0..x.len() {
        let (here, h) = (at[i], 1e-6 * at[i].abs().max(0.1));
        at[i] = here + h;
        let above = definition(&at);
        at[i] = here - h;
        let below = definition(&at);
        at[i] = here;
        let difference = (above - below) / (2.0 * h);
        let deviation = (difference - f64::from(gradient[i])).abs();
        assert!(
            deviation <= of_gradient * largest,
            "{i}: {difference} {}",
            gradient[i]
        );
    }
}
