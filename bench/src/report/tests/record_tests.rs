//! What becomes of records on their way in.

use crate::report::records::natural;
use crate::report::scores::{merged, read_scores};
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
fn runs_are_joined_by_unit() {
    let a = record("d", "p", "m", 0.1, &[("psnr", 20.0)]);
    let b = record("d", "p", "m", 0.1, &[("psnr", 20.0), ("dists", 0.1)]);
    let joined = merged(vec![vec![a.clone()], vec![b.clone()]]).unwrap();
    assert_eq!(joined, std::slice::from_ref(&b));
    let c = record("d", "p", "m", 0.1, &[("psnr", 20.000001)]);
    let error = merged(vec![vec![a.clone()], vec![c]])
        .unwrap_err()
        .to_string();
    assert!(error.contains("psnr differs"), "{error}");
    let error = merged(vec![vec![a.clone()], vec![failed(a, "x")]])
        .unwrap_err()
        .to_string();
    assert!(error.contains("failed in another"), "{error}");
}

#[test]
fn scores_files_are_read_with_their_gaps() {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("scores.csv");
    let head = "pair_id,dataset,scene,source,target,method,baseline_m,rotation_deg,median_depth_m,overlap,status";
    let text = format!(
        "{head},psnr,\"ssim[gauss11,valid]\"\n\
         d/s/0__1,d,s,0,1,m,0.1,2,,0.75,ok,inf,0.5\n\
         d/s/0__2,d,s,0,2,m,0.2,2,3.5,,ok,,0.25\n\
         d/s/0__3,d,s,0,3,m,0.3,2,,,a.png: missing,,\n"
    );
    std::fs::write(&path, &text).unwrap();
    let records = read_scores(&path).unwrap();
    assert_eq!(records.len(), 3);
    assert_eq!(records[0].scores["psnr"], Score::Value(f64::INFINITY));
    assert_eq!(
        (records[0].median_depth_m, records[0].overlap),
        (None, Some(0.75))
    );
    assert!(records[1].scores["psnr"].value().is_none());
    assert_eq!(
        records[2].status,
        Status::Failed {
            reason: "a.png: missing".into()
        }
    );
    for (broken, says) in [
        (
            text.replace("0.25", "x"),
            "line 3: ssim[gauss11,valid]: 'x' is not a number",
        ),
        (
            text.replace("pair_id,", "id,"),
            "line 1: the columns must begin with pair_id,",
        ),
        (text.replace(",0.25", ""), "line 3"),
        (
            text.replace("psnr,", "\"ssim[gauss11,valid]\","),
            "a metric has two columns",
        ),
    ] {
        std::fs::write(&path, broken).unwrap();
        let error = read_scores(&path).unwrap_err().to_string();
        assert!(
            error.contains(says) && error.contains("scores.csv"),
            "{error}"
        );
    }
}

#[test]
fn names_sort_as_people_count() {
    let mut names = ["v10", "v2", "v02", "a", "v2b", "v1"];
    names.sort_by(|a, b| natural(a, b));
    assert_eq!(names, ["a", "v1", "v02", "v2", "v2b", "v10"]);
}
