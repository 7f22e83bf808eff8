//! What becomes of records on their way in.

use crate::report::records::natural;
use crate::report::summary::of_metric;

use super::*;

#[test]
fn planned_pairs_without_records_count() {
    let mut dataset = Dataset::named("d");
    dataset.planned_pairs = Some(5);
    let records = small_run();
    let board = Board::new(&records, &[dataset], &[]).unwrap();
    let summary = of_metric(&board.datasets[0], 1, "psnr");
    assert_eq!(
        (
            summary.n,
            summary.total,
            summary.failed,
            summary.unavailable
        ),
        (1, 5, 1, 3)
    );
    assert_eq!(summary.absences, [("planned but not run".to_owned(), 3)]);
}

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
    let error = Board::new(&[], &[], &[Method::named("m"), Method::named("m")]).unwrap_err();
    assert_eq!(error.to_string(), "method 'm' is given twice");
    let mut input = input(&[]);
    input.options.bin_width_m = Some(-1.0);
    let error = write_report(&input, Path::new("/nonexistent")).unwrap_err();
    assert!(error.to_string().starts_with("bin_width_m = -1"), "{error}");
}

#[test]
fn names_sort_as_people_count() {
    let mut names = ["v10", "v2", "v02", "a", "v2b", "v1"];
    names.sort_by(|a, b| natural(a, b));
    assert_eq!(names, ["a", "v1", "v02", "v2", "v2b", "v10"]);
}
