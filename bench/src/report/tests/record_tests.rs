//! What becomes of records on their way in.

use super::*;

#[test]
fn contradicting_records_are_refused() {
    let twice = [
        record("d", "p", "m", 0.1, &[]),
        record("d", "p", "m", 0.1, &[]),
    ];
    let error = Board::new(&twice, &[], &[]).unwrap_err().to_string();
    assert_eq!(error, "pair 'd/p', method 'm': has two records");
    let other = [
        record("d", "p", "m", 0.1, &[]),
        record("d", "p", "n", 0.2, &[]),
    ];
    let error = Board::new(&other, &[], &[]).unwrap_err().to_string();
    assert!(error.contains("baseline differs"), "{error}");
    let error = Board::new(
        &[],
        &[],
        &[ReportMethod::named("m"), ReportMethod::named("m")],
    )
    .unwrap_err();
    assert_eq!(error.to_string(), "method 'm' is given twice");
    let mut input = input(&[]);
    input.metrics.push(MetricKey::PSNR.into());
    let error = write_report(&input, Path::new("/nonexistent")).unwrap_err();
    assert_eq!(error.to_string(), "metric 'psnr' is given twice");
}

#[test]
fn names_sort_as_people_count() {
    let names = ["v10", "v2", "v02", "a", "v2b", "v1"];
    let records = names.map(|name| record(name, "p", name, 0.1, &[]));
    let board = Board::new(&records, &[], &[]).unwrap();
    let sorted = ["a", "v1", "v02", "v2", "v2b", "v10"];
    let methods: Vec<_> = board.methods.iter().map(|m| m.label.as_str()).collect();
    let datasets: Vec<_> = board.datasets.iter().map(|d| d.dataset.title()).collect();
    assert_eq!((methods, datasets), (sorted.into(), sorted.into()));
}
