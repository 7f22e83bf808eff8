use sharp_metrics::MetricInfo;

use super::breakdown::Division;
use super::*;
use crate::evaluate::record::{Crop, Score};
use crate::evaluate::test_records;
use crate::report::sweep::Motion;
use crate::scoring::Region;

/// A record of pair `number` in a scene of a dataset, with this PSNR.
fn record(dataset: &str, scene: usize, number: usize, psnr: Option<f64>) -> Record {
    let score = psnr.map(|value| ("psnr".to_owned(), Score::Value(value)));
    Record {
        pair_id: format!("{dataset}/{scene}/{number:03}"),
        scores: score.into_iter().collect(),
        ..test_records::record(dataset, scene, number)
    }
}

fn sides<'a>(a: &'a [Record], b: &'a [Record]) -> Sides<'a> {
    let by_pair = |records: &'a [Record]| records.iter().map(|r| (r.pair_id.as_str(), r)).collect();
    Sides {
        a: by_pair(a),
        b: by_pair(b),
    }
}

fn rows(a: &[Record], b: &[Record], datasets: &[&str]) -> Vec<ScoreChange> {
    let psnr = MetricInfo::new(MetricKey::PSNR, &[]);
    let ids = |name: &str| -> BTreeSet<&str> {
        let records = a.iter().chain(b).filter(|record| record.dataset == name);
        records.map(|record| record.pair_id.as_str()).collect()
    };
    let datasets = datasets.iter().map(|name| (*name, ids(name).len()));
    let datasets: Vec<_> = datasets.filter(|(_, pairs)| *pairs > 0).collect();
    sides(a, b).rows(
        &datasets,
        &psnr,
        &Practical::default(),
        Resampling::default(),
    )
}

/// Scores of `scenes` × 4 pairs; `change` is added for each scene.
fn scored(dataset: &str, scenes: usize, change: impl Fn(usize, usize) -> f64) -> Vec<Record> {
    let pairs = (0..scenes).flat_map(|scene| (0..4).map(move |number| (scene, number)));
    let score =
        |scene, number| 20.0 + (scene * 7 % 5) as f64 + 0.5 * number as f64 + change(scene, number);
    pairs
        .map(|(scene, number)| record(dataset, scene, number, Some(score(scene, number))))
        .collect()
}

#[test]
fn a_drop_is_worse_on_its_dataset_and_the_mean_of_datasets_counts_them_equally() {
    let uneven = |scene: usize, number: usize| 0.01 * (scene % 3) as f64 + 0.02 * number as f64;
    let both = |change: &dyn Fn(usize, usize) -> f64, other: &dyn Fn(usize, usize) -> f64| {
        let mut records = scored("D", 6, change);
        records.extend(scored("E", 12, other));
        records
    };
    let nothing = |_: usize, _: usize| 0.0;
    let noise = |scene: usize, _: usize| [0.3, -0.3][scene % 2];
    let found = rows(
        &both(&nothing, &nothing),
        &both(&|scene, number| -1.0 - uneven(scene, number), &noise),
        &["D", "E"],
    );
    let [d, e, all] = &found[..] else {
        panic!("{found:?}");
    };
    assert_eq!(
        (d.verdict, e.verdict),
        (Verdict::Worse, Verdict::Inconclusive)
    );
    assert!((d.difference + 1.04).abs() < 1e-9, "{}", d.difference);
    assert!((d.mean_b - d.mean_a - d.difference).abs() < 1e-9);
    assert_eq!(
        (d.n_pairs, d.n_scenes, e.n_pairs, all.n_pairs, all.n_scenes),
        (24, 6, 48, 72, 18)
    );
    assert!((all.difference - 0.5 * (d.difference + e.difference)).abs() < 1e-12);
    assert_eq!(all.dataset, ALL);
    // With three rows, the smallest p is tripled.
    assert!((d.p_holm.unwrap() / d.p.unwrap() - 3.0).abs() < 1e-9 || all.p.unwrap() < d.p.unwrap());
    assert!(
        found
            .iter()
            .all(|row| row.p_holm >= row.p && row.mde.unwrap() > 0.0)
    );
    // The smallest p that the signs of six scenes allow.
    assert_eq!(
        (d.p_sign_flip, d.p_sign_flip_floor),
        (Some(0.03125), Some(0.03125))
    );
    assert_eq!((all.p_sign_flip, all.no_inference), (None, None));
}

#[test]
fn a_difference_within_what_is_negligible_is_none() {
    let tiny = scored("D", 7, |scene, _| [0.004, -0.003][scene % 2]);
    let [row] = &rows(&scored("D", 7, |_, _| 0.0), &tiny, &["D", "absent"])[..] else {
        panic!("one dataset has pairs");
    };
    // Differs by less than 0.05 dB.
    assert_eq!(row.verdict, Verdict::None);
}

#[test]
fn infinite_and_missing_scores_are_counted_and_never_averaged_away() {
    let a = vec![
        record("D", 0, 0, Some(f64::INFINITY)),
        record("D", 1, 0, Some(20.0)),
        record("D", 2, 0, Some(20.0)),
        record("D", 2, 1, None),
        record("D", 2, 2, Some(3.0)),
    ];
    let mut b = vec![
        record("D", 0, 0, Some(f64::INFINITY)),
        record("D", 1, 0, Some(21.0)),
        record("D", 2, 0, Some(20.5)),
        record("D", 2, 1, Some(20.5)),
    ];
    let [row] = &rows(&a, &b, &["D"])[..] else {
        panic!("one dataset");
    };
    assert_eq!(
        (row.n_pairs, row.n_scenes, row.n_infinite, row.left_out),
        (3, 3, 1, 2)
    );
    assert_eq!((row.difference, row.mean_a), (0.5, f64::INFINITY));
    b[1].scores
        .insert("psnr".into(), Score::Value(f64::INFINITY));
    let [row] = &rows(&a, &b, &["D"])[..] else {
        panic!("one dataset");
    };
    assert_eq!(
        (row.n_infinite, row.p, row.verdict),
        (2, None, Verdict::Inconclusive)
    );
    assert_eq!(row.no_inference, Some(NoInference::NotFinite));
    let json = serde_json::to_value(row).unwrap();
    assert!(json["difference"].is_null() && json["p"].is_null() && json["mean_b"].is_null());
}

#[test]
fn other_pairs_and_other_parts_of_targets_are_named() {
    let a = scored("D", 2, |_, _| 0.0);
    let ids = |records: &'static [Record]| records.iter().map(|r| r.pair_id.as_str()).collect();
    let leaked: &'static [Record] = a.clone().leak();
    let difference = pair_difference(&[ids(&leaked[1..]), ids(&leaked[..7])]).unwrap();
    assert_eq!(
        difference,
        "their pairs differ (1 pair only in A, 1 only in B; the first is D/0/000)"
    );
    assert_eq!(pair_difference(&[ids(leaked), ids(leaked)]), None);
    let mut cropped = a.clone();
    assert_eq!(sides(&a, &cropped).region_difference(), None);
    cropped[5].crop = Some(Crop {
        region: Region {
            x: 0,
            y: 0,
            width: 4,
            height: 4,
        },
        share: 0.5,
    });
    let difference = sides(&a, &cropped).region_difference().unwrap();
    assert!(difference.contains("D/1/001"), "{difference}");
}

#[test]
fn methods_of_equal_label_or_the_only_ones_stand_against_each_other() {
    let labels = |names: &[&str]| {
        names
            .iter()
            .map(|n| ((*n).to_owned(), (*n).to_owned()))
            .collect()
    };
    let pair = |a: &str, b: &str| (a.to_owned(), b.to_owned());
    let chosen = |asked: &[(String, String)], a: &[&str], b: &[&str]| {
        let against = chosen_methods(asked, &labels(a), &labels(b))?;
        let own = against.into_iter().map(|chosen| (chosen.a, chosen.b));
        Ok::<Vec<_>, CompareError>(own.collect())
    };
    assert_eq!(
        chosen(&[], &["x", "y"], &["y", "z"]).unwrap(),
        [pair("y", "y")]
    );
    assert_eq!(chosen(&[], &["x"], &["z"]).unwrap(), [pair("x", "z")]);
    assert_eq!(
        chosen(&[pair("x", "z")], &["x", "y"], &["y", "z"]).unwrap(),
        [pair("x", "z")]
    );
    let said = chosen(&[], &["x"], &["y", "z"]).unwrap_err().to_string();
    assert!(said.contains("run A has x; run B has y, z") && said.contains("--method OLD=NEW"));
    let said = chosen(&[pair("x", "q")], &["x"], &["y"])
        .unwrap_err()
        .to_string();
    assert!(said.contains("--method x=q"), "{said}");
}

/// Changes of PSNR between two sets of records.
fn changes<'a>(a: &'a [Record], b: &'a [Record]) -> Vec<PairChange<'a>> {
    sides(a, b).changes(&MetricInfo::new(MetricKey::PSNR, &[]))
}

#[test]
fn pairs_stand_in_the_order_of_what_they_lost() {
    let by = [0.5, -2.0, f64::NAN, 0.0, 1.0, -0.25];
    let a: Vec<Record> = (0..6).map(|i| record("D", i, 0, Some(20.0))).collect();
    let b = by
        .iter()
        .zip(0..)
        .map(|(by, i)| record("D", i, 0, Some(20.0 + by)));
    let b: Vec<Record> = b.collect();
    let mut found = changes(&a, &b);
    order_by_loss(&mut found);
    let ids = |changes: &mut dyn Iterator<Item = &PairChange<'_>>| -> Vec<String> {
        changes.map(|change| change.a.scene.clone()).collect()
    };
    // A score that became missing sorts first.
    assert_eq!(ids(&mut found.iter()), ["2", "1", "5", "3", "0", "4"]);
    assert_eq!(
        ids(&mut tables::most_changed(&found, 2)),
        ["2", "1", "0", "4"]
    );
    assert_eq!(
        ids(&mut tables::most_changed(&found, 9)),
        ["2", "1", "5", "0", "4"]
    );
    // If lower is better, an increase is a loss.
    let lpips = MetricInfo::new("lpips".parse().unwrap(), &[]);
    let change = |a: f64, b: f64| PairChange::new(&lpips, found[0].a, [a, b]).loss;
    assert_eq!((change(0.25, 0.5), change(0.5, 0.25)), (0.25, -0.25));
    assert_eq!(change(f64::INFINITY, f64::INFINITY), 0.0);
}

#[test]
fn pairs_are_parted_by_scene_and_by_how_far_the_camera_moved() {
    let mut a: Vec<Record> = (0..4).map(|i| record("D", i / 2, i, Some(20.0))).collect();
    for (record, baseline_m) in a.iter_mut().zip([0.02, 0.1, 0.19, 0.2]) {
        record.baseline_m = baseline_m;
        record.overlap = Some(0.8);
    }
    a[0].median_depth_m = Some(0.08);
    a[3].median_depth_m = Some(2.0);
    let found = changes(&a, &a);
    let found: Vec<&PairChange<'_>> = found.iter().collect();
    let parts = |by: Division| -> Vec<(String, Vec<String>)> {
        let parts = breakdown::parts(by, &found).into_iter();
        parts
            .map(|(name, part)| (name, part.iter().map(|c| c.a.target.clone()).collect()))
            .collect()
    };
    let part = |name: &str, targets: &[&str]| {
        (
            name.to_owned(),
            targets.iter().map(|t| (*t).to_owned()).collect::<Vec<_>>(),
        )
    };
    assert_eq!(
        parts(Division::Scene),
        [part("0", &["0", "1"]), part("1", &["2", "3"])]
    );
    // A bin contains its lower end.
    assert_eq!(
        parts(Division::Motion(Motion::BaselineM)),
        [
            part("0.00 to 0.05", &["0"]),
            part("0.10 to 0.15", &["1"]),
            part("0.15 to 0.20", &["2"]),
            part("0.20 to 0.25", &["3"])
        ]
    );
    // The value is unknown for two of four pairs. A value that is the same for all pairs does not divide them.
    assert_eq!(
        parts(Division::Motion(Motion::RelativeMotion)),
        [part("0.10 to 0.15", &["3"]), part("0.25 to 0.30", &["0"])]
    );
    assert!(
        parts(Division::Motion(Motion::Overlap)).is_empty()
            && parts(Division::Motion(Motion::RotationDeg)).is_empty()
    );
}
