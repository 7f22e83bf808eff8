use sharp_kernels::{InstructionSet, Simd};

use super::*;

/// Tolerance relative to the largest committed value in a column; for totals, relative to the
/// committed total itself. Some gradients use Candle's matrix products, which sum in blocks that
/// depend on the processor's caches. Without fused multiply-add, the last bits of our kernels
/// differ as well. The last bits determine the drawing order of Gaussians of nearly equal depth,
/// which an untrained network has, so that totals of single steps differ by up to 3e-5.
const TOLERANCE: f64 = 1e-4;
/// Tolerance of the second stage, which learns from 8-bit renderings: a difference in the last bit
/// may become a whole level.
const TOLERANCE_OF_LEVELS: f64 = 1e-3;
/// Tolerance for the losses of factors that are nearly 1, which depend on the last bits.
const TOLERANCE_OF_SCALES: f64 = 1e-2;

/// Twenty steps of the first stage and two of the second, with every loss: any change to a step
/// shows here. `SHARP_BENCH_BLESS=1` rewrites the curve.
#[test]
fn losses_follow_the_committed_curve() {
    let mut config = config([20, 2], 192);
    config.losses.percep = 0.01;
    config.loss_options.percep.crop = Some(64);
    // The first Gaussians are too large for a picture of this width.
    config.loss_options.splat_width = 768.0;
    let mut training = Training::new(&config);
    training.trainer.run(&mut Silent).unwrap();
    let log = std::fs::read_to_string(training.path("log.csv")).unwrap();
    let curve = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/trainer/tests/curve.csv");
    if std::env::var_os("SHARP_BENCH_BLESS").is_some() {
        std::fs::write(&curve, &log).unwrap();
    }
    let committed = std::fs::read_to_string(curve).unwrap();
    assert_eq!(log.lines().next(), committed.lines().next());
    let rows = |log: &str| -> Vec<Vec<f64>> {
        let lines = log.lines().skip(1);
        lines
            .map(|line| line.split(',').map(|cell| cell.parse().unwrap()).collect())
            .collect()
    };
    let (mut found, expected) = (rows(&log), rows(&committed));
    assert_eq!((found.len(), expected.len()), (22, 22));
    let is_portable = Simd::detect().instruction_set() == InstructionSet::Portable;
    if is_portable {
        found.truncate(20);
    }
    for (column, name) in log.lines().next().unwrap().split(',').enumerate() {
        let largest = expected
            .iter()
            .fold(0.0, |l: f64, row| l.max(row[column].abs()));
        // All offsets are within the margin of `delta`.
        assert!(
            largest > 0.0 || name == "delta",
            "{name} is 0 in every step"
        );
        // Factors are nearly 1, so these losses consist of the last bits only.
        if is_portable && name.starts_with("scale") {
            continue;
        }
        for (row, (found, expected)) in found.iter().zip(&expected).enumerate() {
            let deviation = (found[column] - expected[column]).abs();
            let scale = if name == "total" {
                expected[column]
            } else {
                largest
            };
            let tolerance = match name {
                _ if name.starts_with("scale") => TOLERANCE_OF_SCALES,
                _ if row < 20 => TOLERANCE,
                _ => TOLERANCE_OF_LEVELS,
            };
            assert!(
                deviation < tolerance * scale || deviation == 0.0,
                "{name} in row {row}: {} {}",
                found[column],
                expected[column]
            );
        }
    }
}
