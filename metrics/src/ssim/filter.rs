//! The window filter along one axis at a time, and the similarity of the filtered quantities.

use crate::simd::with_widest_vectors;

/// Elements that the inner loops process at once; row buffers are padded to a multiple of this number.
const BLOCK: usize = 32;
/// Maximum number of filtered quantities: a, b, a² + b², a b, and if the covariance is bounded, a².
pub(super) const QUANTITIES: usize = 5;
/// Minimum variance in dm_pix: f32's ε squared.
const MIN_VARIANCE: f64 = f32::EPSILON as f64 * f32::EPSILON as f64;

#[derive(Clone, Copy)]
pub(super) struct Constants {
    /// C₁ = (0.01 L)², where L is the range of values.
    pub(super) c1: f64,
    /// C₂ = (0.03 L)², where L is the range of values.
    pub(super) c2: f64,
    /// Factor from population to sample covariance, or 1.
    pub(super) covariance: f64,
    /// True if the covariance is bounded by the variances.
    pub(super) bounded: bool,
    /// Constant that is added to the denominator of each similarity.
    pub(super) guard: f64,
}

/// Length of a row buffer for `n` elements.
pub(super) fn padded(n: usize) -> usize {
    n.next_multiple_of(BLOCK)
}

/// Weighted sum over 2 × radius + 1 pixels along x, for every channel of every pixel.
pub(super) fn filter_along_x(input: &[f64], half: &[f64], channels: usize, out: &mut [f64]) {
    with_widest_vectors!(filter_along_x_body(input, half, channels, out):
        fn(input: &[f64], half: &[f64], channels: usize, out: &mut [f64]));
}

#[inline(always)]
fn filter_along_x_body(input: &[f64], half: &[f64], channels: usize, out: &mut [f64]) {
    let radius = half.len() - 1;
    for (block, out) in out.chunks_exact_mut(BLOCK).enumerate() {
        let tap = |k: usize| &input[block * BLOCK + k * channels..][..BLOCK];
        let mut sum = [0.0; BLOCK];
        for k in 0..radius {
            add_pair(&mut sum, half[k], tap(k), tap(2 * radius - k));
        }
        add_single(&mut sum, half[radius], tap(radius));
        out.copy_from_slice(&sum);
    }
}

/// Filters the quantities along y and computes the similarity from them.
pub(super) fn filter_along_y(rows: &[&[f64]], half: &[f64], constants: Constants, out: &mut [f64]) {
    with_widest_vectors!(filter_along_y_body(rows, half, constants, out):
        fn(rows: &[&[f64]], half: &[f64], constants: Constants, out: &mut [f64]));
}

#[inline(always)]
fn filter_along_y_body(rows: &[&[f64]], half: &[f64], constants: Constants, out: &mut [f64]) {
    let radius = half.len() - 1;
    let length = out.len();
    for (block, out) in out.chunks_exact_mut(BLOCK).enumerate() {
        let mut filtered = [[0.0; BLOCK]; QUANTITIES];
        let quantities = rows[0].len() / length;
        for (quantity, sum) in filtered.iter_mut().take(quantities).enumerate() {
            let tap = |k: usize| &rows[k][quantity * length + block * BLOCK..][..BLOCK];
            for k in 0..radius {
                add_pair(sum, half[k], tap(k), tap(2 * radius - k));
            }
            add_single(sum, half[radius], tap(radius));
        }
        let [mean_a, mean_b, squares, products, squares_a] = &filtered;
        for i in 0..BLOCK {
            let (a, b) = (mean_a[i], mean_b[i]);
            let (ab, aa_bb) = (a * b, a * a + b * b);
            let mut variances = constants.covariance * (squares[i] - aa_bb);
            let mut covariance = constants.covariance * (products[i] - ab);
            if constants.bounded {
                let of_a = squares_a[i] - a * a;
                let of_b = (variances - of_a).max(MIN_VARIANCE);
                let of_a = of_a.max(MIN_VARIANCE);
                variances = of_a + of_b;
                let bound = (of_a * of_b).sqrt();
                covariance = covariance.clamp(-bound, bound);
            }
            out[i] = (2.0 * ab + constants.c1) * (2.0 * covariance + constants.c2)
                / ((aa_bb + constants.c1) * (variances + constants.c2) + constants.guard);
        }
    }
}

#[inline(always)]
fn add_pair(sum: &mut [f64; BLOCK], weight: f64, a: &[f64], b: &[f64]) {
    for ((sum, a), b) in sum.iter_mut().zip(a).zip(b) {
        *sum += weight * (a + b);
    }
}

#[inline(always)]
fn add_single(sum: &mut [f64; BLOCK], weight: f64, a: &[f64]) {
    for (sum, a) in sum.iter_mut().zip(a) {
        *sum += weight * a;
    }
}
