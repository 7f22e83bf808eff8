use std::collections::BTreeMap;

use sharp_metrics::{Family, MetricKey};

use super::cells::{Agreement, Averaging, SceneReading, cell};
use super::joint::joint_readings;
use crate::evaluate::Aggregation;
use crate::evaluate::readings::{PictureReading, Readings};
use crate::evaluate::record::Record;
use crate::evaluate::test_records::record;
use crate::report::paper::published::metric;

/// Scene 0 has two pairs and scene 1 has one; both show the same place. LPIPS is computed with two networks.
fn readings() -> Readings {
    let of = |scene: usize, number: usize| Record {
        cluster: "place".into(),
        ..record("eth3d", scene, number)
    };
    let lpips = |name: &str| name.parse::<MetricKey>().unwrap();
    let scores = [
        (
            (PictureReading::AsScored, lpips("lpips-alex")),
            [0.1, 0.3, 0.8],
        ),
        (
            (PictureReading::AsScored, lpips("lpips-vgg")),
            [0.2, 0.4, 0.66],
        ),
        (
            (PictureReading::Truncated, lpips("lpips-alex")),
            [0.1, 0.3, 0.5],
        ),
        (
            (PictureReading::AsScored, MetricKey::PSNR),
            [10.0, 20.0, 20.0],
        ),
    ];
    let scores = scores.map(|(key, values)| (key, values.map(Some).to_vec()));
    Readings {
        records: vec![of(0, 1), of(0, 2), of(1, 1)],
        units: BTreeMap::from([("eth3d".to_owned(), 3)]),
        scores: BTreeMap::from(scores),
        ..Readings::default()
    }
}

fn explained(family: Family, decimals: usize, published: f64) -> super::CellExplanation {
    let mut column = metric(family);
    column.decimals = decimals;
    cell(
        &readings(),
        "eth3d",
        "ETH3D",
        &column,
        published,
        Aggregation::Pairs,
    )
}

#[test]
fn the_runs_own_reading_comes_first_and_equals() {
    let cell = explained(Family::Lpips, 3, 0.4);
    assert_eq!(cell.as_scored, Some((0.1 + 0.3 + 0.8) / 3.0));
    assert_eq!(cell.verdict, Agreement::Equal);
    let first = cell.readings[0].reading;
    assert_eq!(
        (first.averaging, first.scenes),
        (Averaging::Of(Aggregation::Pairs), SceneReading::All)
    );
}

#[test]
fn readings_that_print_alike_and_differ_are_ambiguous() {
    // Means over pairs, printed with one decimal: alex 0.40, vgg 0.42.
    let cell = explained(Family::Lpips, 1, 0.4);
    let values: Vec<f64> = cell.candidates().iter().map(|c| c.value).collect();
    assert!(
        (values[0] - 0.4).abs() < 1e-12 && (values[1] - 0.42).abs() < 1e-12,
        "{values:?}"
    );
    assert_eq!(cell.verdict, Agreement::Ambiguous);
    // With three decimals, only one of them equals the published number.
    assert_eq!(explained(Family::Lpips, 3, 0.42).verdict, Agreement::Equal);
}

#[test]
fn readings_of_one_value_are_one_candidate() {
    // Here the means over scenes and over source views are equal.
    let cell = explained(Family::Lpips, 3, 0.5);
    let alike = cell
        .readings
        .iter()
        .filter(|value| cell.prints(value.value));
    assert_eq!((alike.count(), cell.candidates().len()), (2, 1));
    assert_eq!(cell.verdict, Agreement::Equal);
}

#[test]
fn inside_the_spread_and_outside_of_it() {
    assert_eq!(
        explained(Family::Lpips, 3, 0.333).verdict,
        Agreement::Inside
    );
    assert_eq!(explained(Family::Lpips, 3, 0.9).verdict, Agreement::Outside);
    assert_eq!(
        explained(Family::Dists, 3, 0.1).verdict,
        Agreement::NotComputed
    );
}

#[test]
fn psnr_of_the_mean_error_is_a_reading() {
    // Errors 0.1, 0.01, 0.01: mean 0.04.
    let cell = explained(Family::Psnr, 2, 13.98);
    assert_eq!(cell.verdict, Agreement::Equal);
    assert_eq!(
        cell.candidates()[0].reading.averaging,
        Averaging::PooledError
    );
    assert_eq!(cell.as_scored, Some(50.0 / 3.0));
}

#[test]
fn one_scene_a_place_takes_the_first() {
    let cell = explained(Family::Lpips, 3, 0.2);
    let one = cell.readings.iter().find(|value| {
        value.reading.scenes == SceneReading::OneAPlace && value.reading.key == MetricKey::LPIPS
    });
    let one = one.unwrap();
    assert_eq!((one.value, one.n), (0.2, 2));
}

#[test]
fn one_reading_is_taken_for_all_metrics() {
    let cells = [
        explained(Family::Lpips, 3, 0.3),
        explained(Family::Psnr, 2, 16.67),
    ];
    let all = joint_readings(&cells);
    // PSNR has no truncated reading here, so there is no truncated joint reading.
    assert!(
        all.iter()
            .all(|joint| joint.picture == PictureReading::AsScored)
    );
    assert!(all.is_sorted_by(|a, b| a.farthest <= b.farthest));
    let pairs = all.iter().find(|joint| {
        (joint.averaging, joint.scenes) == (Averaging::Of(Aggregation::Pairs), SceneReading::All)
    });
    let pairs = pairs.unwrap();
    // LPIPS is 0.4, published 0.300; the distance 0.1 is 200 halves of 0.001.
    assert!((pairs.farthest - 200.0).abs() < 1e-6, "{}", pairs.farthest);
    assert!((pairs.variants[1].distance - (50.0 / 3.0 - 16.67)).abs() < 1e-12);
}
