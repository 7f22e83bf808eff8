use std::collections::BTreeMap;

use sharp_metrics::MetricKey;
use sharp_tests::holds;

use super::output::{junit, markdown};
use super::*;
use crate::evaluate::Results;
use crate::evaluate::record::{Record, Score, Status};
use crate::evaluate::test_records;
use crate::evaluate::unit::Timing;
use crate::report::test_results;
use crate::track::compare::compare_results;

fn record(dataset: &str, scene: usize, number: usize, psnr: f64) -> Record {
    Record {
        pair_id: format!("{dataset}/{scene}/{number}"),
        scores: [
            ("psnr".to_owned(), Score::Value(psnr)),
            ("lpips[alex,v0.1]".to_owned(), Score::Value(1.0 / psnr)),
        ]
        .into(),
        ..test_records::record(dataset, scene, number)
    }
}

/// Two pairs per scene, with `change` added to their PSNR.
fn scored(dataset: &str, scenes: usize, change: impl Fn(usize, usize) -> f64) -> Vec<Record> {
    let pairs = (0..scenes).flat_map(|scene| (0..2).map(move |number| (scene, number)));
    let psnr = |scene, number| 20.0 + (scene * 7 % 5) as f64 + change(scene, number);
    pairs
        .map(|(scene, number)| record(dataset, scene, number, psnr(scene, number)))
        .collect()
}

fn results(records: Vec<Record>) -> Results {
    test_results::results(&[MetricKey::PSNR, MetricKey::LPIPS], records)
}

fn config(limits: &[&str]) -> GateConfig {
    GateConfig {
        fail_if: limits.iter().map(|limit| limit.parse().unwrap()).collect(),
        ..Default::default()
    }
}

fn judged(a: Vec<Record>, b: Vec<Record>, config: &GateConfig) -> Result<GateReport, GateError> {
    let sides = [("a", results(a)), ("b", results(b))];
    let sides = sides.map(|(name, results)| (Path::new(name), results));
    let comparison = compare_results(sides, &[], &Practical::default())?;
    judge::judge(&comparison, config, [Path::new("a"), Path::new("b")])
}

/// The states of all checks except coverage.
fn states(report: &GateReport) -> Vec<CheckState> {
    let limits = report
        .checks
        .iter()
        .filter(|c| c.quantity != "missing_pairs");
    limits.map(|check| check.state).collect()
}

fn nothing(_: usize, _: usize) -> f64 {
    0.0
}

#[test]
fn a_limit_fires_only_beyond_its_bound_and_where_chance_is_unlikely() {
    let drop = |scene: usize, _: usize| -0.3 - 0.05 * (scene % 3) as f64;
    let noise = |scene: usize, _: usize| [-2.0, 1.4, -1.1, 0.9][scene % 4];
    let states = |limit: &str, change: &dyn Fn(usize, usize) -> f64| {
        let report = judged(
            scored("D", 8, nothing),
            scored("D", 8, change),
            &config(&[limit]),
        );
        let report = report.unwrap();
        (states(&report)[0], report.state)
    };
    let (fired, passed) = (CheckState::Fired, CheckState::Passed);
    assert_eq!(states("psnr < -0.2", &drop), (fired, fired));
    assert_eq!(states("psnr < -0.5", &drop), (passed, passed));
    assert_eq!(
        states("psnr < -0.1", &noise),
        (CheckState::NotSignificant, passed)
    );
    // Better by any amount passes.
    assert_eq!(states("psnr < 0", &|_, _| 3.0), (passed, passed));
    assert_eq!(states("lpips > 0", &drop), (fired, fired));
    let rise = |scene: usize, number: usize| -drop(scene, number);
    assert_eq!(states("|psnr| > 0.2", &rise), (fired, fired));
    assert_eq!(states("|psnr| > 0.2", &drop), (fired, fired));
    assert_eq!(states("|psnr| > 0.5", &rise), (passed, passed));
}

#[test]
fn limits_without_a_place_hold_on_each_dataset_and_over_all() {
    let both = |d: &dyn Fn(usize, usize) -> f64| {
        let mut records = scored("D", 6, d);
        records.extend(scored("E", 6, nothing));
        records
    };
    let drop = |scene: usize, _: usize| -1.0 - 0.01 * scene as f64;
    let places = |limit: &str| -> Vec<(String, CheckState)> {
        let report = judged(both(&nothing), both(&drop), &config(&[limit])).unwrap();
        let limits = report.checks.into_iter().skip(2);
        limits.map(|check| (check.dataset, check.state)).collect()
    };
    let place = |name: &str, state| (name.to_owned(), state);
    let (fired, passed) = (CheckState::Fired, CheckState::Passed);
    assert_eq!(
        places("psnr < -0.1"),
        [place("D", fired), place("E", passed), place("all", fired)]
    );
    assert_eq!(places("psnr < -0.1 on E"), [place("E", passed)]);
    assert_eq!(places("psnr < -0.1 on all"), [place("all", fired)]);
    assert_eq!(places("psnr < -0.1 on E per scene"), [place("E", passed)]);
    // A dataset for which no run has scores is skipped, unless a limit names it.
    let half = || {
        let mut records = both(&nothing);
        records
            .iter_mut()
            .filter(|r| r.dataset == "E")
            .for_each(|r| r.scores.clear());
        records
    };
    let states = |limit: &str| states(&judged(half(), half(), &config(&[limit])).unwrap());
    assert_eq!(states("psnr < -0.1"), [passed]);
    assert_eq!(states("psnr < -0.1 on E"), [CheckState::Inconclusive]);
}

#[test]
fn what_cannot_be_averaged_never_passes_silently() {
    let (drop, limit) = (|_: usize, _: usize| -1.0, config(&["psnr < -0.1"]));
    let with = |at: usize, value: f64, mut records: Vec<Record>| {
        let score = Score::Value(value);
        records[at].scores.insert("psnr".into(), score);
        records
    };
    let fresh = || scored("D", 6, nothing);
    let infinite = || with(2, f64::INFINITY, fresh());
    // Infinity in A only, in B only, in both, or with both signs.
    let report = judged(infinite(), fresh(), &limit).unwrap();
    assert_eq!(states(&report), [CheckState::Fired]);
    assert!(report.checks[1].reason.contains("infinite on one side"));
    assert_eq!(
        states(&judged(fresh(), infinite(), &limit).unwrap()),
        [CheckState::Passed]
    );
    assert_eq!(
        states(&judged(infinite(), infinite(), &limit).unwrap()),
        [CheckState::Passed]
    );
    let crossed = with(5, f64::INFINITY, fresh());
    let report = judged(infinite(), crossed, &limit).unwrap();
    assert_eq!(states(&report), [CheckState::Fired]);
    assert!(report.checks[1].reason.contains("not a number"));
    // NaN in B counts as a lost pair. NaN in A does not, but it makes the mean NaN.
    let nan = || with(2, f64::NAN, fresh());
    let report = judged(fresh(), nan(), &limit).unwrap();
    assert_eq!(report.checks[0].state, CheckState::Fired);
    holds(&report.checks[0].reason, &["D/1/0: psnr is NaN"]);
    let report = judged(nan(), fresh(), &limit).unwrap();
    assert_eq!(
        (report.checks[0].state, report.checks[1].state),
        (CheckState::Passed, CheckState::Fired)
    );
    // With one scene and one pair there is no p, whatever the drop. Limits per scene do not need p.
    let limits = config(&["psnr < -0.1", "psnr < -0.1 per scene"]);
    let report = judged(scored("D", 1, nothing), scored("D", 1, drop), &limits).unwrap();
    assert_eq!(
        states(&report),
        [CheckState::NotSignificant, CheckState::Fired]
    );
    holds(&report.checks[1].reason, &["scene"]);
    let one = |change: &dyn Fn(usize, usize) -> f64| scored("D", 1, change)[..1].to_vec();
    let report = judged(one(&nothing), one(&drop), &limits).unwrap();
    assert_eq!(
        states(&report),
        [CheckState::NotSignificant, CheckState::Fired]
    );
}

#[test]
fn lost_pairs_fire_and_a_metric_without_any_is_inconclusive() {
    let fail = |records: &mut [Record]| {
        for record in records {
            record.scores.clear();
            record.status = Status::Failed {
                reason: "out of <memory>".into(),
            };
        }
    };
    let mut b = scored("D", 4, nothing);
    fail(&mut b[..2]);
    let mut limits = config(&["psnr < -0.1"]);
    let report = judged(scored("D", 4, nothing), b.clone(), &limits).unwrap();
    let check = &report.checks[0];
    assert_eq!(
        (check.state, check.a, check.b),
        (CheckState::Fired, Some(8.0), Some(6.0))
    );
    assert!(check.reason.contains("2 pairs") && check.reason.contains("D/0/0: out of <memory>"));
    limits.missing_pairs = 2;
    let report = judged(scored("D", 4, nothing), b.clone(), &limits).unwrap();
    assert_eq!(report.state, CheckState::Passed);
    // A pair missing in A is not lost.
    let report = judged(
        b.clone(),
        scored("D", 4, nothing),
        &config(&["psnr < -0.1"]),
    )
    .unwrap();
    assert_eq!(report.state, CheckState::Passed);
    fail(&mut b);
    limits.missing_pairs = 8;
    let report = judged(scored("D", 4, nothing), b, &limits).unwrap();
    assert_eq!(
        (states(&report), report.state),
        (vec![CheckState::Inconclusive], CheckState::Inconclusive)
    );
}

#[test]
fn power_is_asked_of_what_may_differ_and_firing_wins() {
    let noise = |scene: usize, _: usize| [-0.4, 0.5, -0.3, 0.2][scene % 4];
    let mut strict = config(&["psnr < -0.6"]);
    strict.require_power.insert("psnr".parse().unwrap(), 0.05);
    let mut lenient = strict.clone();
    lenient.require_power.insert("psnr".parse().unwrap(), 5.0);
    let state = |b: Vec<Record>, config: &GateConfig| {
        judged(scored("D", 8, nothing), b, config).unwrap().state
    };
    assert_eq!(
        state(scored("D", 8, noise), &strict),
        CheckState::Inconclusive
    );
    assert_eq!(state(scored("D", 8, noise), &lenient), CheckState::Passed);
    assert_eq!(state(scored("D", 8, nothing), &strict), CheckState::Passed);
    // Without spread, the detectable difference is unknown.
    assert_eq!(
        state(scored("D", 8, |_, _| 0.5), &lenient),
        CheckState::Inconclusive
    );
    let drop = |scene: usize, number: usize| noise(scene, number) - 3.0;
    assert_eq!(state(scored("D", 8, drop), &strict), CheckState::Fired);
}

#[test]
fn a_gate_that_checks_nothing_is_refused() {
    let refused = |limits: &GateConfig| {
        let records = || scored("D", 2, nothing);
        match judged(records(), records(), limits) {
            Err(GateError::Limits(reason)) => reason,
            other => panic!("{other:?}"),
        }
    };
    let said = refused(&config(&["ssim < -0.1"]));
    holds(&said, &["'ssim < -0.1'", "psnr, lpips-alex"]);
    let said = refused(&config(&["psnr < -0.1 on E"]));
    assert!(said.contains("expected D or all"), "{said}");
    let mut power = config(&["psnr < -1 per scene"]);
    power.require_power.insert("psnr".parse().unwrap(), 1.0);
    assert!(refused(&power).contains("tests significance"));
    power.require_power.insert("psnr".parse().unwrap(), 0.0);
    assert!(refused(&power).contains("psnr is 0, but must be a number above 0"));
}

#[test]
fn limits_read_back_as_they_are_written() {
    for text in [
        "psnr < -0.1",
        "|psnr| > 0.05 on D",
        "lpips > +0.005 on all",
        "ssim@frustum < -0.002 on my data per scene",
        "lpips-vgg > +0 per scene",
        "seconds_per_pair > +10 %",
        "peak_memory > +2.5 %",
    ] {
        assert_eq!(text.parse::<Limit>().unwrap().to_string(), text);
    }
    for (loose, strict) in [
        ("lpips>0.005", "lpips > +0.005"),
        ("psnr<-.1on", ""),
        ("ssim[gauss11,valid] < -1e-3", "ssim-gauss11-valid < -0.001"),
        ("peak_memory>10%", "peak_memory > +10 %"),
    ] {
        match loose.parse::<Limit>() {
            Ok(limit) => assert_eq!(limit.to_string(), strict),
            Err(said) => assert!(strict.is_empty() && said.contains("not a number"), "{said}"),
        }
    }
    for (text, part) in [
        ("psnr", "expected a limit such as"),
        (
            "psnr > 0.1",
            "higher is better for psnr, so write the limit as 'psnr < -VALUE'",
        ),
        ("psnr < 0.1", "higher is better"),
        ("lpips > -0.1", "lower is better"),
        ("lpips < 0.1", "lower is better"),
        ("|lpips| < -0.1", "'|lpips| > VALUE'"),
        ("psnr < -inf", "not a number"),
        ("msssim < -0.1", "unknown metric 'msssim'"),
        ("seconds_per_pair > 1", "'seconds_per_pair > +10 %'"),
        ("peak_memory > 10 % on D", "'peak_memory > +10 %'"),
        ("peak_memory > -10 %", "0 % or more"),
    ] {
        let said = text.parse::<Limit>().unwrap_err();
        assert!(said.contains(part) && said.contains(text), "{said}");
    }
}

#[test]
fn gate_toml_is_strict_and_names_the_line() {
    let text = "fail_if = [\"psnr < -0.1\"]\nmissing_pairs = 1\n[require_power]\npsnr = 0.5\n\"lpips-vgg\" = 0.01\n";
    let config = GateConfig::parse(text).unwrap();
    assert_eq!(
        (
            config.fail_if.len(),
            config.missing_pairs,
            config.require_power.len()
        ),
        (1, 1, 2)
    );
    for (text, parts) in [
        ("fail_if = []\nfail_iff = []", ["line 2", "fail_iff"]),
        ("\nfail_if = [\"psnr > 1\"]", ["line 2", "higher is better"]),
        ("missing_pairs = -1", ["line 1", "-1"]),
        ("require_power = { psmr = 1.0 }", ["line 1", "psmr"]),
        ("fail_if = [", ["line 1", ""]),
    ] {
        let said = GateConfig::parse(text).unwrap_err();
        assert!(
            parts.iter().all(|part| said.contains(part)) && !said.contains('\n'),
            "{said}"
        );
    }
}

#[test]
fn costs_count_on_one_device_only() {
    let timing = |machine: Option<&str>, secs: f64| Timing {
        predict_secs: secs,
        score_secs: 9.0,
        machine: machine.map(str::to_owned),
        peak_bytes: Some(1 << 20),
        ..Timing::default()
    };
    let records = || scored("D", 2, nothing);
    let side = |each: &[Timing]| -> BTreeMap<String, Timing> {
        let pairs = records().into_iter().map(|record| record.pair_id);
        pairs.zip(each.iter().cloned()).collect()
    };
    let sides = [("a", results(records())), ("b", results(records()))];
    let sides = sides.map(|(name, results)| (Path::new(name), results));
    let comparison = compare_results(sides, &[], &Practical::default()).unwrap();
    let limits = config(&["seconds_per_pair > +10 %", "peak_memory > +10 %"]);
    let checks = |a: &[Timing], b: &[Timing]| {
        let against = &comparison.against[0];
        cost::costs_of(&comparison, &limits, against, &[side(a), side(b)])
    };
    let x = |secs| timing(Some("x, 8 threads"), secs);
    let found = checks(&[x(1.0), x(3.0)], &[x(2.0), x(2.3)]);
    assert_eq!((found[0].a, found[0].b), (Some(2.0), Some(2.15)));
    assert_eq!(
        (found[0].state, found[1].state),
        (CheckState::Passed, CheckState::Passed)
    );
    assert_eq!(found[1].b, Some(1.0));
    assert_eq!(
        checks(&[x(1.0), x(1.0)], &[x(1.0), x(1.3)])[0].state,
        CheckState::Fired
    );
    // A pair that is missing on one side is ignored on both sides.
    assert_eq!(
        checks(&[x(1.0), x(1.0)], &[x(1.0)])[0].state,
        CheckState::Passed
    );
    let other = timing(Some("x, 4 threads"), 1.0);
    for (a, b, part) in [
        (
            vec![x(1.0)],
            vec![other.clone()],
            "processor is x, 8 threads in A and x, 4 threads in B",
        ),
        (
            vec![x(1.0)],
            vec![other, x(1.0)],
            "B was predicted partly by x, 4 threads and partly by x, 8 threads",
        ),
        (
            vec![timing(None, 1.0)],
            vec![x(1.0)],
            "A does not state which processor",
        ),
        (vec![x(1.0)], vec![], "B has no times"),
        (vec![x(0.04)], vec![x(1.0)], "below 0.05"),
    ] {
        let found = checks(&a, &b);
        assert_eq!(found[0].state, CheckState::NotCompared);
        assert!(found[0].reason.contains(part), "{}", found[0].reason);
    }
}

#[test]
fn comments_and_build_servers_get_text_that_stays_text() {
    let mut b = scored("D", 4, |_, _| -1.0);
    for record in &mut b {
        record.status = Status::Failed {
            reason: "<img src=x> | @everyone \u{1}\u{ffff} \"&' `rm` ]]>".into(),
        };
        record.scores.remove("lpips[alex,v0.1]");
    }
    let limits = config(&[
        "psnr < -0.1 per scene",
        "lpips > +0.005",
        "peak_memory > +10 %",
    ]);
    let report = judged(scored("D", 4, nothing), b, &limits).unwrap();
    assert_eq!(report.state, CheckState::Fired);
    let xml = junit(&report);
    assert!(
        xml.contains("tests=\"7\" failures=\"5\" errors=\"1\" skipped=\"1\""),
        "{xml}"
    );
    assert!(
        xml.contains("&lt;img src=x&gt; | @everyone \\u0001\\uffff &quot;&amp;'"),
        "{xml}"
    );
    let page = markdown(&report);
    assert!(
        page.starts_with(
            "### Quality gate failed: 5 of 7 checks fired, 1 inconclusive, 1 not compared\n"
        ),
        "{page}"
    );
    holds(&page, &["&lt;img src=x&gt; \\| @&#8203;everyone"]);
    assert!(!page.contains('\u{1}') && page.contains("\\`rm\\`"));
    let rows: Vec<&str> = page
        .lines()
        .filter(|line| line.starts_with("| fired "))
        .collect();
    assert_eq!(rows.len(), 5);
    let cells = |row: &str| row.replace("\\|", "").matches('|').count();
    assert!(rows.iter().all(|row| cells(row) == 11), "{page}");
    assert!(
        page.ends_with("\n    sharp-bench compare a b --method m=m\n"),
        "{page}"
    );
    holds(&page, &["| D/0/0 | 20.000 | 19.000 | 1.000 |"]);
    assert_eq!(shell_word("it's"), r"'it'\''s'");
}
