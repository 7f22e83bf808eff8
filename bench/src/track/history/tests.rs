use std::collections::BTreeSet;

use serde_json::json;
use sharp_metrics::{MetricInfo, MetricKey};
use sharp_statistics::Verdict;

use super::*;
use crate::evaluate::record::{Record, Score, Status};
use crate::evaluate::test_records;
use crate::evaluate::{Manifest, Results};
use crate::pairs::{Pair, PairList};

/// Parameters of a test's run.
#[derive(Clone)]
struct Run {
    /// Name and number of scenes; four pairs per scene.
    datasets: Vec<(&'static str, usize)>,
    metrics: Vec<MetricKey>,
    weights: char,
    photographs: char,
    near: f64,
    /// Score by dataset, scene and number of the pair.
    score: fn(&str, usize, usize) -> f64,
}

fn plain(_: &str, scene: usize, number: usize) -> f64 {
    20.0 + (scene * 7 % 5) as f64 + 0.5 * number as f64
}

/// Factor by which a change affects a scene, 0.5 to 1.5.
fn share(scene: usize) -> f64 {
    0.5 + (scene * 3 % 8) as f64 / 7.0
}

impl Default for Run {
    fn default() -> Self {
        Self {
            datasets: vec![("D", 8)],
            metrics: vec![MetricKey::PSNR],
            weights: 'a',
            photographs: 'f',
            near: 0.01,
            score: plain,
        }
    }
}

impl Run {
    fn scoring(score: fn(&str, usize, usize) -> f64) -> Self {
        Self {
            score,
            ..Self::default()
        }
    }

    fn bundle(&self) -> Bundle {
        let metrics = self.metrics.iter().map(|key| {
            let mut metric = serde_json::to_value(MetricInfo::new(*key, &[])).unwrap();
            metric["identity"] = "i".into();
            metric
        });
        let datasets = self.datasets.iter().map(|(name, scenes)| {
            json!({"name": name, "spec": "anywhere", "format": "stereo", "identity": "r", "scenes": scenes, "views": 2,
                   "readings": [], "notes": []})
        });
        let manifest: Manifest = serde_json::from_value(json!({
            "format": 2, "version": "0", "sources": {},
            "renderer": {"backend": "cpu-avx2", "near": self.near, "far": 1e10, "eps2d": 0.0, "background": "black"},
            "kernels": "avx2",
            "metric_networks": {"device": "cpu", "instruction_set": "avx2", "algorithm": "winograd"},
            "scoring": {},
            "datasets": datasets.collect::<Vec<_>>(),
            "pairs": {"sha256": "", "listed": 0, "evaluated": 0, "lists": []},
            "methods": [{"label": "m", "spec": "m", "privilege": "none", "sources": "",
                         "identity": {"kind": "k", "settings": {"checkpoint": self.weights.to_string().repeat(64)}}}],
            "metrics": metrics.collect::<Vec<_>>(),
        }))
        .unwrap();
        let (mut pairs, mut records) = (Vec::new(), Vec::new());
        for (dataset, scenes) in &self.datasets {
            for (scene, number) in (0..*scenes).flat_map(|s| (0..4).map(move |n| (s, n))) {
                let (pair, record) = self.unit(dataset, scene, number);
                pairs.push(pair);
                records.push(record);
            }
        }
        Bundle {
            results: Results {
                manifest,
                records,
                missing: BTreeSet::new(),
                pictures: Vec::new(),
                damaged: Vec::new(),
                methods_listed: false,
            },
            pairs: PairList::new("pairs.csv", pairs),
            occasion: None,
            timings: std::collections::BTreeMap::new(),
        }
    }

    fn unit(&self, dataset: &str, scene: usize, number: usize) -> (Pair, Record) {
        let score = Score::Value((self.score)(dataset, scene, number));
        let keys = self.metrics.iter();
        let record = Record {
            scores: keys.map(|key| (key.to_string(), score.clone())).collect(),
            ..test_records::record(dataset, scene, number)
        };
        let pair = Pair {
            pair_id: record.pair_id.clone(),
            dataset: dataset.into(),
            scene: scene.to_string(),
            set: None,
            source: "s".into(),
            target: number.to_string(),
            source_file: "s.png".into(),
            target_file: "t.png".into(),
            source_sha256: self.photographs.to_string().repeat(64),
            target_sha256: "e".repeat(64),
            baseline_m: 0.1,
            rotation_deg: 0.0,
            median_depth_m: None,
            overlap: None,
            overlap_source_to_target: None,
            selected: true,
        };
        (pair, record)
    }
}

struct Folder(tempfile::TempDir);

impl Folder {
    fn new() -> Self {
        Self(tempfile::tempdir().unwrap())
    }

    fn path(&self, name: &str) -> PathBuf {
        self.0.path().join(name)
    }

    fn history(&self) -> PathBuf {
        self.path("history")
    }

    fn try_add(&self, run: &Run, label: &str, commit: Option<&str>) -> Result<Added, HistoryError> {
        let path = self.path("run.zip");
        std::fs::write(&path, run.bundle().bytes().unwrap()).unwrap();
        let occasion = occasion(&path, Some(label), commit, Some("2026-01-31"))?;
        add(&self.history(), &path, occasion)
    }

    fn add(&self, run: &Run) -> Added {
        self.try_add(run, "x", None).unwrap()
    }

    fn read(&self) -> History {
        read(&self.history()).unwrap()
    }

    fn names(&self) -> Vec<String> {
        let names = std::fs::read_dir(self.history()).unwrap();
        let names = names.map(|entry| entry.unwrap().file_name().into_string().unwrap());
        let mut names: Vec<String> = names.collect();
        names.sort();
        names
    }
}

/// Verdict, rule and reference entry of a change point.
type Marked = (Verdict, Rule, u32);

/// For each entry of the only series: the entry that it is compared with, and its change point.
fn course(history: &History) -> Vec<(Option<u32>, Option<Marked>)> {
    let [series] = &history.series[..] else {
        panic!("{} series", history.series.len());
    };
    let points = series.points.iter();
    points
        .map(|p| {
            let mark = p.change.as_ref();
            (p.follows, mark.map(|m| (m.verdict, m.rule, m.against)))
        })
        .collect()
}

#[test]
fn entries_are_in_the_order_of_adding_and_nothing_is_written_over() {
    let folder = Folder::new();
    let base = Run::default();
    let first = folder.try_add(&base, "nightly", Some("c1")).unwrap();
    assert!(first.is_new && first.number == 1 && first.path.ends_with("0001.zip"));
    let bytes = std::fs::read(&first.path).unwrap();

    // Adding the same run again has no effect, even on another day.
    let again = folder.try_add(&base, "nightly", Some("c1")).unwrap();
    assert!(!again.is_new && again.number == 1);
    // Another commit or label makes a new entry, and so do other weights, photographs or scores with the same label.
    folder.try_add(&base, "nightly", Some("c2")).unwrap();
    folder.try_add(&base, "other", Some("c1")).unwrap();
    for run in [
        Run {
            weights: 'b',
            ..base.clone()
        },
        Run {
            photographs: 'd',
            ..base.clone()
        },
        Run::scoring(|d, s, n| {
            if (s, n) == (7, 3) {
                0.0
            } else {
                plain(d, s, n)
            }
        }),
    ] {
        let added = folder.try_add(&run, "nightly", Some("c1")).unwrap();
        assert!(added.is_new, "{added:?}");
        assert!(!folder.try_add(&run, "nightly", Some("c1")).unwrap().is_new);
    }
    assert_eq!(std::fs::read(&first.path).unwrap(), bytes);
    let expected = (1..=6).map(|n| format!("{n:04}.zip"));
    assert_eq!(folder.names(), expected.collect::<Vec<_>>());
    let history = folder.read();
    let labels: Vec<&str> = history.entries.iter().map(|(_, o)| &*o.label).collect();
    assert_eq!(
        labels,
        [
            "nightly", "nightly", "other", "nightly", "nightly", "nightly"
        ]
    );
    let weights: Vec<&str> = history.points().map(|p| &*p.weights).collect();
    assert_eq!(
        weights[2..5],
        ["aaaaaaaaaaaa", "bbbbbbbbbbbb", "aaaaaaaaaaaa"]
    );

    // An entry can be added to another history like any run, with new metadata.
    let other = folder.path("elsewhere");
    let said = occasion(&first.path, None, None, Some("2026-02-01T10:00")).unwrap();
    let added = add(&other, &first.path, said).unwrap();
    assert_eq!((added.occasion.label.as_str(), added.number), ("0001", 1));
}

#[test]
fn where_files_lay_does_not_make_another_run() {
    let folder = Folder::new();
    folder.add(&Run::default());
    let mut moved = Run::default().bundle();
    moved.results.manifest.datasets[0].spec = Some("synthetic=views=9".parse().unwrap());
    let path = folder.path("moved.zip");
    std::fs::write(&path, moved.bytes().unwrap()).unwrap();
    let said = occasion(&path, Some("x"), None, None).unwrap();
    assert!(!add(&folder.history(), &path, said).unwrap().is_new);
}

#[test]
fn what_is_said_of_a_run_is_one_line_and_a_day() {
    let run = Path::new("runs/v1.zip");
    let said = |label, commit, date| occasion(run, label, commit, date);
    let named = said(None, None, None).unwrap();
    assert_eq!(named.label, "v1");
    assert!(is_date(&named.date) && named.date.len() == 16);
    for (label, commit, date, part) in [
        (Some(""), None, None, "label"),
        (Some("a\nb"), None, None, "label"),
        (Some("\u{1b}[2J"), None, None, "\\u001b"),
        (Some("é"), Some(" "), None, "commit"),
        (None, Some("\u{202e}x"), None, "commit"),
        (None, None, Some("2026-02-30"), "does not exist"),
    ] {
        let error = said(label, commit, date).unwrap_err().to_string();
        assert!(error.contains(part), "{error}");
    }
    assert!(said(Some(&"x".repeat(LONGEST + 1)), None, None).is_err());
}

#[test]
fn a_jump_is_marked_once() {
    let folder = Folder::new();
    folder.add(&Run::default());
    folder.add(&Run::scoring(|d, s, n| plain(d, s, n) + [0.2, -0.2][s % 2]));
    let worse = |d: &str, s, n| plain(d, s, n) - 2.0 * share(s);
    folder.add(&Run::scoring(worse));
    folder.try_add(&Run::scoring(worse), "y", None).unwrap();
    folder.try_add(&Run::default(), "y", None).unwrap();
    let history = folder.read();
    assert_eq!(
        course(&history),
        [
            (None, None),
            (Some(1), None),
            (Some(2), Some((Verdict::Worse, Rule::Step, 2))),
            (Some(3), None),
            (Some(4), Some((Verdict::Better, Rule::Step, 4))),
        ]
    );
    // The numbers are the same in `compare` and in the series.
    let points = &history.series[0].points;
    let mark = points[2].change.as_ref().unwrap();
    assert!((mark.difference - (points[2].mean.unwrap() - points[1].mean.unwrap())).abs() < 1e-9);
    assert!(mark.p.unwrap() < 0.05);
    assert!(points[0].ci_low.unwrap() < points[0].mean.unwrap());
    assert_eq!(
        (points[0].n_pairs, points[0].n_scenes, points[0].n_planned),
        (32, 8, 32)
    );
    let said = history.series[0].events(&points[2]);
    assert!(said[0].starts_with("worse by 2."), "{said:?}");
}

/// Each step may be due to chance, but the sum of three steps may not.
#[test]
fn a_slow_drift_is_marked_when_it_has_added_up() {
    let folder = Folder::new();
    let noise = |s: usize, at: usize| 0.4 * (((s * 5 + at * 3) % 8) as f64 / 3.5 - 1.0);
    let run = |at: usize| {
        let mut bundle = Run::default().bundle();
        for (place, record) in bundle.results.records.iter_mut().enumerate() {
            let scene = place / 4;
            let score = plain("D", scene, place % 4) - 0.12 * at as f64 + noise(scene, at);
            record.scores.insert("psnr".into(), Score::Value(score));
        }
        bundle
    };
    for at in 0..8 {
        let path = folder.path("run.zip");
        std::fs::write(&path, run(at).bytes().unwrap()).unwrap();
        let said = occasion(&path, None, None, None).unwrap();
        add(&folder.history(), &path, said).unwrap();
    }
    let course = course(&folder.read());
    let marks: Vec<_> = course.iter().filter_map(|(_, mark)| *mark).collect();
    // Later entries are compared with the change point.
    let drift = |against| (Verdict::Worse, Rule::Drift, against);
    assert_eq!(marks, [drift(1), drift(4)], "{course:?}");
    assert!(course[3].1.is_some() && course[6].1.is_some(), "{course:?}");
}

#[test]
fn a_series_is_broken_where_entries_cannot_be_compared_and_continues_where_they_can() {
    let base = Run::default();
    let worse = Run::scoring(|d, s, n| plain(d, s, n) - 2.0 * share(s));
    let fewer = Run {
        datasets: vec![("D", 7)],
        ..worse.clone()
    };
    let near = Run {
        near: 0.5,
        ..worse.clone()
    };
    let photographs = Run {
        photographs: 'd',
        ..worse.clone()
    };
    for (other, reason) in [
        (fewer, "their pairs differ (4 pairs only in A"),
        (near, "the renderer's nearest depth is \"0.01\""),
        (photographs, "the photographs of D/0/s__0 differ"),
    ] {
        let folder = Folder::new();
        folder.add(&base);
        folder.add(&other);
        folder.add(&worse);
        let history = folder.read();
        assert_eq!(
            course(&history),
            [
                (None, None),
                (None, None),
                (Some(1), Some((Verdict::Worse, Rule::Step, 1))),
            ]
        );
        let points = &history.series[0].points;
        let broken = points[1].broken.as_ref().unwrap();
        assert!(
            broken.contains(reason) && broken.contains("entry 1"),
            "{broken}"
        );
        let broken = points[2].broken.as_ref().unwrap();
        assert!(broken.contains("entry 2"), "{broken}");
    }
}

/// A dataset or metric that appears or changes does not interrupt other series.
#[test]
fn datasets_and_metrics_go_their_own_ways() {
    let folder = Folder::new();
    let ssim: MetricKey = "ssim".parse().unwrap();
    folder.add(&Run::default());
    folder.add(&Run {
        datasets: vec![("D", 8), ("E", 3)],
        metrics: vec![MetricKey::PSNR, ssim],
        ..Run::default()
    });
    folder.add(&Run {
        datasets: vec![("D", 8), ("E", 2)],
        score: |d, s, n| plain(d, s, n) + 2.0 * share(s),
        ..Run::default()
    });
    let history = folder.read();
    let titles: Vec<String> = history.series.iter().map(Series::title).collect();
    assert_eq!(titles.len(), 4);
    assert!(
        titles[0] == "psnr, D: m" && titles[1] == "psnr, E: m",
        "{titles:?}"
    );
    let follows = |at: usize| -> Vec<_> {
        let points = history.series[at].points.iter();
        points
            .map(|p| (p.entry, p.follows, p.change.is_some()))
            .collect()
    };
    assert_eq!(
        follows(0),
        [(1, None, false), (2, Some(1), false), (3, Some(2), true)]
    );
    assert_eq!(follows(1), [(2, None, false), (3, None, false)]);
    assert_eq!(
        (follows(2), follows(3)),
        (vec![(2, None, false)], vec![(2, None, false)])
    );
    assert!(history.series[0].points[2].broken.is_none());
}

#[test]
fn numbers_that_are_none_are_shown_and_change_nothing() {
    let folder = Folder::new();
    folder.add(&Run::scoring(
        |_, s, _| if s == 0 { f64::INFINITY } else { 20.0 },
    ));
    folder.add(&Run::scoring(
        |_, s, _| if s == 0 { f64::NAN } else { 20.0 },
    ));
    let mut failed = Run::default().bundle();
    for record in &mut failed.results.records {
        record.scores.clear();
        record.status = Status::Failed {
            reason: "no".into(),
        };
    }
    let path = folder.path("failed.zip");
    std::fs::write(&path, failed.bytes().unwrap()).unwrap();
    let said = occasion(&path, None, None, None).unwrap();
    add(&folder.history(), &path, said).unwrap();
    folder.add(&Run::default());
    // NaN is equal to itself when runs are tested for equality.
    assert!(
        !folder
            .add(&Run::scoring(|_, s, _| if s == 0 {
                f64::NAN
            } else {
                20.0
            }))
            .is_new
    );

    let history = folder.read();
    let expected = [(None, None), (Some(1), None), (None, None), (Some(2), None)];
    assert_eq!(course(&history), expected);
    let points = &history.series[0].points;
    assert_eq!(points[0].mean, Some(f64::INFINITY));
    assert!(points[1].mean.unwrap().is_nan());
    assert!(
        points[..2]
            .iter()
            .all(|p| p.ci_low.is_none() && p.ci_high.is_none())
    );
    assert_eq!(
        (points[2].mean, points[2].n_failed, points[2].n_planned),
        (None, 32, 32)
    );
    let table = String::from_utf8(csv::csv(&history)).unwrap();
    let lines: Vec<&str> = table.lines().collect();
    assert!(
        lines[1].contains(",32,32,0,8,inf,,,") && lines[2].contains(",nan,,,"),
        "{table}"
    );
    assert!(lines[3].contains(",0,32,32,0,,,,"), "{table}");
    let page = page::html(&history, "h").unwrap();
    assert!(page.contains("∞") && page.contains("0 of 32"));
    let json = serde_json::to_value(&points[1]).unwrap();
    assert!(json["mean"].is_null());
}

#[test]
fn a_damaged_entry_costs_the_others_nothing() {
    let folder = Folder::new();
    for commit in ["1", "2", "3"] {
        folder.try_add(&Run::default(), "x", Some(commit)).unwrap();
    }
    let second = folder.history().join("0002.zip");
    let mut bytes = std::fs::read(&second).unwrap();
    bytes.truncate(bytes.len() / 2);
    std::fs::write(&second, &bytes).unwrap();
    // A bundle without the date and label of an entry.
    let bare = Run::default().bundle().bytes().unwrap();
    std::fs::write(folder.history().join("0004.zip"), bare).unwrap();

    let history = folder.read();
    let numbers: Vec<u32> = history.entries.iter().map(|(n, _)| *n).collect();
    assert_eq!(numbers, [1, 3]);
    assert_eq!(course(&history), [(None, None), (Some(1), None)]);
    let [half, bare] = &history.damaged[..] else {
        panic!("{:?}", history.damaged);
    };
    assert!(half.contains("0002.zip") && bare.contains("0004.zip"));

    // Untrusted text in an entry.
    let mut hostile = Run::default().bundle();
    hostile.occasion = Some(Occasion {
        label: "a\u{1b}[2J".into(),
        commit: None,
        date: "2026-01-31".into(),
    });
    std::fs::write(&second, hostile.bytes().unwrap()).unwrap();
    let reason = &folder.read().damaged[0];
    assert!(
        reason.contains("0002.zip") && reason.contains("\\u001b"),
        "{reason}"
    );
}

#[test]
fn folders_of_others_are_left_alone() {
    let folder = Folder::new();
    std::fs::create_dir(folder.history()).unwrap();
    let error = read(&folder.history()).unwrap_err().to_string();
    assert!(error.contains("history add DIR RUN"), "{error}");
    std::fs::write(folder.path("history/notes.txt"), b"mine").unwrap();
    let error = folder
        .try_add(&Run::default(), "x", None)
        .unwrap_err()
        .to_string();
    assert!(error.contains("notes.txt"), "{error}");
    assert_eq!(folder.names(), ["notes.txt"]);
    // The largest possible number.
    std::fs::write(folder.path("history/4294967295.zip"), b"").unwrap();
    let error = folder
        .try_add(&Run::default(), "x", None)
        .unwrap_err()
        .to_string();
    assert!(error.contains("no number is left"), "{error}");
}

#[test]
fn runs_added_at_the_same_time_are_all_there_once() {
    let folder = Folder::new();
    let path = folder.path("run.zip");
    std::fs::write(&path, Run::default().bundle().bytes().unwrap()).unwrap();
    let history = folder.history();
    std::thread::scope(|scope| {
        for thread in 0..4 {
            let (path, history) = (&path, &history);
            scope.spawn(move || {
                for commit in 0..5 {
                    // Each thread adds a commit of its own and a commit that all threads add.
                    for commit in [format!("{thread}-{commit}"), format!("all-{commit}")] {
                        let said = occasion(path, None, Some(&commit), None).unwrap();
                        add(history, path, said).unwrap();
                    }
                }
            });
        }
    });
    let found = folder.read();
    let commits = found
        .entries
        .iter()
        .filter_map(|(_, o)| o.commit.as_deref());
    assert_eq!(commits.collect::<BTreeSet<_>>().len(), 25);
    assert_eq!(found.entries.len(), 25);
    assert_eq!(folder.names().len(), 25);
}

#[test]
fn the_table_and_the_page_hold_what_others_wrote_as_text() {
    let folder = Folder::new();
    folder
        .try_add(&Run::default(), "=1+1", Some("<b>c</b>"))
        .unwrap();
    let history = folder.read();
    let table = String::from_utf8(csv::csv(&history)).unwrap();
    let mut lines = table.lines();
    assert_eq!(lines.next().unwrap(), csv::COLUMNS);
    assert!(
        lines
            .next()
            .unwrap()
            .starts_with("1,'=1+1,<b>c</b>,2026-01-31,m,D,psnr,32,32,0,8,"),
        "{table}"
    );
    let page = page::html(&history, "<i>h</i>").unwrap();
    assert!(!page.contains("<b>c") && !page.contains("<i>h"));
    assert!(page.contains("default-src 'none'") && !page.contains("<script"));
    assert_eq!(page, page::html(&folder.read(), "<i>h</i>").unwrap());
}
