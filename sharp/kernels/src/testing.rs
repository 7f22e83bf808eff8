//! Helpers shared by the tests of several modules.

/// Reproducible, nearly normal values of variance 1: sums of four uniform values.
pub(crate) fn noise(seed: u64, len: usize) -> Vec<f32> {
    let mut state = seed.wrapping_mul(0x9e37_79b9_7f4a_7c15);
    let mut uniform = || {
        state = state.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let z = (state ^ (state >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        ((z ^ (z >> 31)) >> 40) as f32 / (1 << 24) as f32 - 0.5
    };
    (0..len)
        .map(|_| (uniform() + uniform() + uniform() + uniform()) * 3.0_f32.sqrt())
        .collect()
}

/// `|found - exact| / |exact|` in the L2 norm; infinite if anything is not finite.
pub(crate) fn relative_error(found: &[f32], exact: &[f64]) -> f64 {
    assert_eq!(found.len(), exact.len());
    let mut error = 0.0;
    let mut norm = 0.0;
    for (f, e) in found.iter().zip(exact) {
        if !f.is_finite() {
            return f64::INFINITY;
        }
        error += (f64::from(*f) - e).powi(2);
        norm += e * e;
    }
    (error / norm).sqrt()
}

/// Runs `work` in a pool of `threads` threads.
pub(crate) fn with_threads<R: Send>(threads: usize, work: impl FnOnce() -> R + Send) -> R {
    rayon::ThreadPoolBuilder::new()
        .num_threads(threads)
        .build()
        .unwrap()
        .install(work)
}
