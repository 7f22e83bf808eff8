//! Sweeps of a few records whose results were computed by hand.

use sharp_metrics::MetricKey;

use super::study::CrossingRule;
use super::*;
use crate::evaluate::Results;
use crate::evaluate::record::{Record, Score, Status};
use crate::evaluate::test_records::record;
use crate::methods::TrueDepth;
use crate::report::test_results;
use sharp_plots::style::FigureStyle;

const DATASET: &str = "d_1 & co";
const HOSTILE: &str = "<script>=100 %";

fn scored(method: &str, pair: usize, baseline_m: f64, psnr: f64) -> Record {
    Record {
        method: method.into(),
        baseline_m,
        median_depth_m: Some(4.0),
        overlap: (pair != 3).then_some(0.75),
        scores: [("psnr".to_owned(), Score::Value(psnr))].into(),
        ..record(DATASET, 0, pair)
    }
}

/// Records for bins of half a metre. The bins have two pairs, one pair, none, and an infinite score next to a finite one.
fn records() -> Vec<Record> {
    let mut records = vec![
        scored("a", 0, 0.125, 20.0),
        scored("a", 1, 0.375, 22.0),
        scored("a", 2, 0.5, 10.0),
        scored("a", 3, 1.5, f64::INFINITY),
        scored("a", 4, 1.75, 30.0),
        scored(HOSTILE, 0, 0.125, 24.0),
        scored(HOSTILE, 1, 0.375, 26.0),
        scored(HOSTILE, 2, 0.5, 6.0),
        scored(HOSTILE, 3, 1.5, 1.0),
    ];
    // A failure is in no bin.
    records.push(Record {
        status: Status::Failed { reason: "x".into() },
        ..scored(HOSTILE, 4, 1.75, 99.0)
    });
    records
}

/// Results with `a` as the first method, which uses the source's true depth.
fn results(keys: &[MetricKey], records: &[Record]) -> Results {
    let mut results = test_results::results(keys, records.to_vec());
    let methods = &mut results.manifest.methods;
    methods.sort_by_key(|method| method.label != "a");
    for method in methods.iter_mut().filter(|method| method.label == "a") {
        method.privilege.depth = TrueDepth::SourceDepth;
    }
    results
}

fn sweep(records: &[Record], spec: SweepSpec) -> Sweep {
    Sweep::of(&results(&[MetricKey::PSNR], records), spec).unwrap()
}

fn halves() -> SweepSpec {
    SweepSpec {
        binning: "0.5".parse().unwrap(),
        ..SweepSpec::default()
    }
}

fn csv_of(sweep: &Sweep) -> String {
    String::from_utf8(table::csv(sweep)).unwrap()
}

#[test]
fn the_table_as_csv() {
    let sweep = sweep(&records(), halves());
    let expected = "\
dataset,method,split,metric,x,x_low,x_high,n,mean,sd,ci_low,ci_high
d_1 & co,a,d_1 & co,psnr,0.25,0,0.5,2,21,1.4142135623730951,,
d_1 & co,a,d_1 & co,psnr,0.5,0.5,1,1,10,,,
d_1 & co,a,d_1 & co,psnr,1.625,1.5,2,2,inf,,,
d_1 & co,<script>=100 %,d_1 & co,psnr,0.25,0,0.5,2,25,1.4142135623730951,,
d_1 & co,<script>=100 %,d_1 & co,psnr,0.5,0.5,1,1,6,,,
d_1 & co,<script>=100 %,d_1 & co,psnr,1.5,1.5,2,1,1,,,
";
    assert_eq!(csv_of(&sweep), expected);
}

#[test]
fn the_table_as_latex() {
    let expected = "\
% by sharp-bench sweep
% \\usepackage{booktabs,graphicx}
\\begin{table}[!htbp]
\\centering
\\caption{PSNR against camera baseline (m). Mean $\\pm$ one sample standard deviation.}
\\label{tab:sweep-psnr}
\\resizebox{\\linewidth}{!}{%
\\begin{tabular}{lrcc}
\\toprule
baseline, m & $n$ & a & \\textless{}script\\textgreater{}=100 \\% \\\\
\\midrule
\\multicolumn{4}{l}{\\emph{d\\_1 \\& co}} \\\\
0--0.5 & 2 & 21.00 $\\pm$ 1.41 & 25.00 $\\pm$ 1.41 \\\\
0.5--1 & 1 & 10.00 & 6.00 \\\\
1.5--2 & 1--2 & $\\infty$ & 1.00 \\\\
\\bottomrule
\\end{tabular}%
}

\\smallskip\\raggedright\\footnotesize
PSNR: \\texttt{psnr}. Rows: camera baseline (m), bins of width 0.5. Baseline: distance of the camera centres.
\\end{table}
";
    assert_eq!(table::latex(&sweep(&records(), halves())), expected);
}

#[test]
fn intervals_are_over_clusters() {
    let mut records = vec![scored("a", 0, 0.1, 20.0), scored("a", 1, 0.1, 22.0)];
    records[1].cluster = "another".into();
    let sweep = sweep(&records, halves());
    let bin = &sweep.panels[0].lines[0].bins[0][0];
    // Standard error 1, one degree of freedom of Student's t.
    let (low, high) = bin.interval.unwrap();
    assert!((low - (21.0 - 12.706_204_736_174_7)).abs() < 1e-8, "{low}");
    assert!(
        (high - (21.0 + 12.706_204_736_174_7)).abs() < 1e-8,
        "{high}"
    );
}

#[test]
fn panels_by_method_and_by_privilege() {
    let by = |split, privileged| {
        let spec = SweepSpec {
            split,
            privileged,
            ..halves()
        };
        let panels = sweep(&records(), spec).panels.into_iter().map(|panel| {
            let labels = panel.lines.into_iter().map(|line| line.label);
            format!("{}: {}", panel.split, labels.collect::<Vec<_>>().join("+"))
        });
        panels.collect::<Vec<_>>().join("; ")
    };
    assert_eq!(by(Split::Dataset, None), format!("{DATASET}: a+{HOSTILE}"));
    assert_eq!(by(Split::Dataset, Some(true)), format!("{DATASET}: a"));
    assert_eq!(
        by(Split::Method, None),
        format!("a: {DATASET}; {HOSTILE}: {DATASET}")
    );
    assert_eq!(
        by(Split::Privileged, None),
        format!("{DATASET}, no depth given: {HOSTILE}; {DATASET}, privileged depth: a")
    );
}

#[test]
fn every_motion_has_its_place_and_unknown_ones_are_counted() {
    let first = |x| {
        let spec = SweepSpec {
            x,
            ..SweepSpec::default()
        };
        let panel = sweep(&records(), spec).panels.remove(0);
        (panel.lines[0].bins[0][0].banded.bin.x, panel.unplaced)
    };
    assert_eq!(first(Motion::BaselineM).0, 0.125);
    assert_eq!(first(Motion::RotationDeg), (0.0, 0));
    assert_eq!(first(Motion::RelativeMotion).0, 0.125 / 4.0);
    assert_eq!(first(Motion::Overlap), (0.75, 1));
    assert_eq!(first(Motion::Disoccluded), (0.25, 1));
}

#[test]
fn a_method_falls_behind_and_below() {
    let spec = SweepSpec {
        against: Some("a".into()),
        thresholds: vec!["psnr=15.5".parse().unwrap()],
        ..halves()
    };
    let sweep = sweep(&records(), spec);
    let found: Vec<(&str, &CrossingRule, f64)> = sweep
        .crossings
        .iter()
        .map(|c| (c.method.as_str(), &c.rule, c.found.x))
        .collect();
    // The infinite score of `a` is above the limit. The other method loses 19 dB from 0.25 m to 0.5 m, reaches 15.5
    // half-way, and goes from 4 dB ahead of `a` to 4 dB behind.
    assert_eq!(
        found,
        [
            ("a", &CrossingRule::Beyond(15.5), f64::INFINITY),
            (HOSTILE, &CrossingRule::Beyond(15.5), 0.375),
            (HOSTILE, &CrossingRule::Behind("a".into()), 0.375),
        ]
    );
    let text = table::sentence(&sweep, &sweep.crossings[2]);
    assert_eq!(
        text,
        "d_1 & co: in PSNR, <script>=100 % is behind a from a camera baseline of 0.375 m on (no interval, because \
         there \
         is a single scene)"
    );
    let text = table::sentence(&sweep, &sweep.crossings[0]);
    assert!(
        text.starts_with("d_1 & co: in PSNR, a is not below 15.5 in the last bin ("),
        "{text}"
    );
    let csv = String::from_utf8(table::crossings_csv(&sweep)).unwrap();
    let row = "d_1 & co,a,d_1 & co,psnr,below 15.5,inf,,,1,10000,0";
    assert_eq!(csv.lines().nth(1), Some(row));
}

#[test]
fn figures_escape_names_and_are_the_same_in_any_order() {
    let mut reversed = records();
    reversed.reverse();
    let spec = || SweepSpec {
        thresholds: vec!["psnr=15.5".parse().unwrap()],
        ..halves()
    };
    let style = FigureStyle::default();
    let one = figure::figures(&sweep(&records(), spec()), &style).unwrap();
    assert_eq!(
        one,
        figure::figures(&sweep(&reversed, spec()), &style).unwrap()
    );
    let svg = &one[0].1.svg;
    assert!(svg.contains("&lt;script&gt;") && !svg.contains("<script>"));
    // 84 mm at 300 dpi.
    let png = image::load_from_memory(&one[0].1.png).unwrap();
    assert!((990..=994).contains(&png.width()), "{}", png.width());
    assert!(
        figure::figures(&sweep(&[], halves()), &style)
            .unwrap()
            .is_empty()
    );
}

#[test]
fn pairs_outside_all_bins_are_counted() {
    let outside = |binning: &str, far: f64| {
        let mut records = records();
        records[4].baseline_m = far;
        records[9].baseline_m = far;
        let spec = SweepSpec {
            binning: binning.parse().unwrap(),
            ..SweepSpec::default()
        };
        sweep(&records, spec).panels[0].outside
    };
    assert_eq!(outside("0,1", 1.75), 2);
    assert_eq!(outside("0,2", 1.75), 0);
    assert_eq!(outside("0.1", 1e30), 1);
}

#[test]
fn what_an_earlier_sweep_left_is_removed_and_what_others_wrote_is_not() {
    let mut records = records();
    for record in &mut records {
        let key = MetricKey::SSIM.to_string();
        record.scores.insert(key, Score::Value(0.5));
    }
    let results = results(&[MetricKey::PSNR, MetricKey::SSIM], &records);
    let sweep = |metrics: Vec<MetricKey>, against: Option<&str>| {
        let spec = SweepSpec {
            metrics,
            against: against.map(str::to_owned),
            ..halves()
        };
        Sweep::of(&results, spec).unwrap()
    };
    let dir = tempfile::tempdir().unwrap();
    let write =
        |sweep: &Sweep, stem: &str| files::write(sweep, dir.path(), stem, &FigureStyle::default());
    // Files of another stem are kept, even if it begins with this one.
    write(&sweep(vec![], None), "sweep-x").unwrap();
    let first = write(&sweep(vec![], Some("a")), "sweep").unwrap();
    assert_eq!((first.written.len(), first.removed.len()), (9, 0));
    let svg = dir.path().join("sweep-ssim-gauss11-valid.svg");
    std::fs::write(&svg, "mine").unwrap();
    let second = write(&sweep(vec![MetricKey::PSNR], None), "sweep").unwrap();
    let removed = [
        "sweep-crossings.csv",
        "sweep-ssim-gauss11-valid.pdf",
        "sweep-ssim-gauss11-valid.png",
    ];
    assert_eq!(second.removed, removed.map(|name| dir.path().join(name)));
    assert!(second.removed.iter().all(|path| !path.exists()) && svg.exists());
    assert!(dir.path().join("sweep-x-ssim-gauss11-valid.svg").exists());

    // If one name is taken, nothing is written.
    let error = write(&sweep(vec![], None), "sweep")
        .unwrap_err()
        .to_string();
    assert!(error.contains("gauss11-valid.svg: cannot write"), "{error}");
    assert!(!removed.iter().any(|name| dir.path().join(name).exists()));
}

#[test]
fn a_threshold_is_a_number_that_a_metric_may_have() {
    assert!("psnr=16".parse::<spec::Threshold>().is_ok());
    for wrong in ["psnr=1e308", "psnr=nan", "psnr=-inf", "psnr"] {
        assert!(wrong.parse::<spec::Threshold>().is_err(), "{wrong}");
    }
}

#[test]
fn one_pair_and_none_are_sweeps_too() {
    let one = [scored("a", 0, 0.125, 20.0)];
    for binning in ["0.1", "quantile:8", "0,1"] {
        let spec = SweepSpec {
            binning: binning.parse().unwrap(),
            band: Band::Ci95,
            ..SweepSpec::default()
        };
        let sweep = sweep(&one, spec);
        assert_eq!(csv_of(&sweep).lines().count(), 2, "{binning}");
        assert_eq!(
            figure::figures(&sweep, &FigureStyle::default())
                .unwrap()
                .len(),
            1
        );
    }
    assert_eq!(csv_of(&sweep(&[], halves())).lines().count(), 1);
}

#[test]
fn names_that_are_not_there_are_named() {
    let results = results(&[MetricKey::PSNR], &records());
    let new = |spec| Sweep::of(&results, spec).unwrap_err().to_string();
    let error = new(SweepSpec {
        metrics: vec![MetricKey::SSIM],
        ..halves()
    });
    assert_eq!(
        error,
        "metric 'ssim[gauss11,valid]' is not in these runs; they have psnr"
    );
    let error = new(SweepSpec {
        against: Some("z".into()),
        ..halves()
    });
    assert!(
        error.contains("method 'z'") && error.contains("have a, <script>=100 %"),
        "{error}"
    );
}
