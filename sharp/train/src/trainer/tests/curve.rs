use super::*;

/// How far totals may lie from the committed ones. Instruction sets differ in the last bits, which
/// Adam's first steps enlarge.
const RELATIVE: f64 = 1e-5;

/// Twenty steps of the first stage: what anything in a step changes shows here.
/// `SHARP_BENCH_BLESS=1` writes the curve anew.
#[test]
fn the_loss_falls_along_the_committed_curve() {
    if let Ok(set) = std::env::var("H3_SIMD") {
        sharp_kernels::Simd::pin(set.parse().unwrap()).unwrap();
    }
    let mut c = config([20, 0], 192);
    let env = |name: &str, d: f64| std::env::var(name).map_or(d, |v| v.parse().unwrap());
    c.stage1.schedule.peak = env("LR", 2e-4);
    c.stage1.schedule.last = env("LR", 2e-4) / 10.0;
    c.adam.epsilon = env("EPS", 1e-8);
    c.stage1.seed = env("SEED", 3.0) as u64;
    let mut training = Training::new(&c);
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
        println!("{step} {found} {deviation:.1e}");
        if std::env::var("H3_SIMD").is_err() {
            assert!(deviation < RELATIVE, "{step}: {found} {expected}");
        }
    }
    let mean = |part: &[f64]| part.iter().sum::<f64>() / part.len() as f64;
    assert!(mean(&found[15..]) < mean(&found[..5]));
}
