use sharp_kernels::{InstructionSet, Simd};

use super::*;

/// How far totals may lie from the committed ones, relative. AVX2 and AVX-512 give the same bytes. Without fused
/// multiply-add the last bits differ, and with them the order in which Gaussians of nearly one depth are
/// drawn, as an untrained network's are: single steps differ by up to 3e-5 in total.
fn tolerance() -> f64 {
    match Simd::detect().instruction_set() {
        InstructionSet::Portable => 1e-4,
        _ => 1e-5,
    }
}

/// Twenty steps of the first stage: what anything in a step changes shows here.
/// `SHARP_BENCH_BLESS=1` writes the curve anew.
#[test]
fn losses_follow_the_committed_curve() {
    let mut training = Training::new(&config([20, 0], 192));
    training.trainer.run(&mut Silent).unwrap();
    let log = std::fs::read_to_string(training.path("log.csv")).unwrap();
    let curve = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/trainer/tests/curve.csv");
    if std::env::var_os("SHARP_BENCH_BLESS").is_some() {
        std::fs::write(&curve, &log).unwrap();
    }
    let committed = std::fs::read_to_string(curve).unwrap();
    let totals = |log: &str| -> Vec<f64> {
        let column = |line: &str| line.split(',').rev().nth(1).unwrap().parse().unwrap();
        log.lines().skip(1).map(column).collect()
    };
    let (found, expected) = (totals(&log), totals(&committed));
    assert_eq!((found.len(), expected.len()), (20, 20));
    for (step, (found, expected)) in found.iter().zip(&expected).enumerate() {
        let deviation = (found / expected - 1.0).abs();
        assert!(deviation < tolerance(), "{step}: {found} {expected}");
    }
}
