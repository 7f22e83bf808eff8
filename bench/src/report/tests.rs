//! Whole reports from small runs.

use std::collections::BTreeMap;
use std::path::Path;

use image::{Rgb, RgbImage};
use sharp_metrics::MetricKey;

use crate::record::{Record, Score, Status};

use super::plots::{histogram, motion};
use super::records::{Board, natural};
use super::scores::{merged, read_scores};
use super::summary::of_metric;
use super::tables::{build, csv, latex, markdown, text};
use super::*;

fn record(
    dataset: &str,
    pair: &str,
    method: &str,
    baseline_m: f64,
    scores: &[(&str, f64)],
) -> Record {
    Record {
        pair_id: format!("{dataset}/{pair}"),
        dataset: dataset.into(),
        scene: "scene".into(),
        cluster: "scene".into(),
        source: "0".into(),
        target: "1".into(),
        method: method.into(),
        baseline_m,
        rotation_deg: 1.0,
        median_depth_m: None,
        overlap: Some(0.8),
        status: Status::Ok,
        scores: scores
            .iter()
            .map(|(k, v)| ((*k).into(), Score::Value(*v)))
            .collect(),
        extras: BTreeMap::new(),
    }
}

fn failed(mut record: Record, reason: &str) -> Record {
    record.status = Status::Failed {
        reason: reason.into(),
    };
    record.scores.clear();
    record
}

/// Two methods, two pairs; the second prediction of `b` failed.
fn small_run() -> Vec<Record> {
    vec![
        record("d", "p2", "a", 0.2, &[("psnr", 30.0)]),
        record("d", "p1", "a", 0.1, &[("psnr", 20.0)]),
        record("d", "p1", "b", 0.1, &[("psnr", 40.0)]),
        failed(record("d", "p2", "b", 0.2, &[]), "p2.ply: truncated"),
    ]
}

fn input(records: &[Record]) -> ReportInput<'_> {
    ReportInput {
        title: "A run".into(),
        summary: "Two methods.".into(),
        records,
        metrics: vec![MetricKey::PSNR.into()],
        extras: Vec::new(),
        datasets: Vec::new(),
        methods: Vec::new(),
        facts: Vec::new(),
        published: Published::Matching,
        pictures: &NoPictures,
        options: Options::default(),
    }
}

fn psnr_table(records: &[Record]) -> tables::Table {
    let board = Board::new(records, &[], &[]).unwrap();
    build::of_scores(&board, &[MetricKey::PSNR.into()]).remove(0)
}

/// Every file of a report by its relative name.
fn files(input: &ReportInput<'_>) -> BTreeMap<String, Vec<u8>> {
    let dir = tempfile::tempdir().unwrap();
    let written = write_report(input, dir.path()).unwrap();
    let name = |path: &Path| path.strip_prefix(dir.path()).unwrap().display().to_string();
    written
        .all
        .iter()
        .map(|path| (name(path), std::fs::read(path).unwrap()))
        .collect()
}

#[test]
fn coverage_is_shown_and_incomplete_rows_are_not_ranked() {
    let table = psnr_table(&small_run());
    let [a, b] = table.rows.as_slice() else {
        panic!()
    };
    assert_eq!(
        (a.cells[0].value, a.cells[0].coverage),
        (Some(25.0), Some((2, 2)))
    );
    assert_eq!(
        (b.cells[0].value, b.cells[0].coverage),
        (Some(40.0), Some((1, 2)))
    );
    // b looks better, but over other pairs; a alone is no contest.
    assert_eq!((a.cells[0].rank, b.cells[0].rank), (None, None));
    let note = &table.notes[b.cells[0].notes[0]];
    assert!(
        note.contains("1 of 2 pairs") && note.contains("p2.ply: truncated (1×)"),
        "{note}"
    );
    for form in [
        markdown::markdown(&table),
        text::text(&table),
        latex::latex(&table),
    ] {
        assert!(form.contains("1/2"), "{form}");
    }
    assert!(
        csv::csv(&table).contains("\nb,d,psnr,40,,1,2,1,0,,2,a,"),
        "{}",
        csv::csv(&table)
    );
}

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
fn a_mean_with_an_infinity_is_infinite_and_says_of_how_many() {
    let table = psnr_table(&[
        record("d", "p1", "a", 0.1, &[("psnr", f64::INFINITY)]),
        record("d", "p2", "a", 0.2, &[("psnr", 31.2)]),
    ]);
    let cell = &table.rows[0].cells[0];
    assert_eq!(
        (cell.value, cell.infinite, cell.std),
        (Some(f64::INFINITY), 1, None)
    );
    assert_eq!(
        table.notes,
        ["Infinite for 1 of 2 pairs, and so is the mean; mean of the others 31.20."]
    );
    assert!(csv::csv(&table).contains("a,d,psnr,inf,,2,2,0,1,"));
    assert!(latex::latex(&table).contains("$\\infty$"));
}

#[test]
fn a_column_without_numbers_says_how_to_get_them() {
    let mut records = small_run();
    for record in &mut records {
        if record.status == Status::Ok {
            let score = Score::Unavailable {
                unavailable: "run `weights fetch alex`".into(),
            };
            record.scores.insert(MetricKey::LPIPS.to_string(), score);
        }
    }
    let board = Board::new(&records, &[], &[]).unwrap();
    let table = build::of_scores(&board, &[MetricKey::LPIPS.into()]).remove(0);
    assert_eq!(
        table.notes,
        ["No LPIPS alex (`lpips[alex,v0.1]`): run `weights fetch alex`."]
    );
    for row in &table.rows {
        assert_eq!(
            (row.cells[0].value, row.cells[0].notes.as_slice()),
            (None, &[0][..])
        );
    }
    assert!(markdown::markdown(&table).contains("n/a <sub>0/2</sub><sup>a</sup>"));
    assert!(markdown::markdown(&table).contains("`weights fetch alex`"));
    assert!(latex::latex(&table).contains("\\texttt{weights fetch alex}"));
}

#[test]
fn ranks_reach_every_form() {
    let records: Vec<Record> = [("a", 20.0), ("b", 21.0), ("c", 21.001), ("d", 19.0)]
        .map(|(method, psnr)| record("d", "p", method, 0.1, &[("psnr", psnr)]))
        .into();
    let table = psnr_table(&records);
    let ranks: Vec<_> = table.rows.iter().map(|r| r.cells[0].rank).collect();
    assert_eq!(ranks, [Some(3), Some(1), Some(1), None]);
    let latex = latex::latex(&table);
    assert!(
        latex.contains("b & \\cellcolor{tab_first} 21.00 \\\\"),
        "{latex}"
    );
    assert!(
        latex.contains("a & \\cellcolor{tab_third} 20.00 \\\\"),
        "{latex}"
    );
    assert!(!latex.contains("\\cellcolor{tab_second}"));
    let markdown = markdown::markdown(&table);
    assert!(
        markdown.contains("| c | **21.00** <sub>1</sub> |"),
        "{markdown}"
    );
}

#[test]
fn wide_runs_are_split_as_in_the_paper() {
    let records: Vec<Record> = ["a", "b", "c", "d", "e", "f"]
        .map(|dataset| record(dataset, "p", "m", 0.1, &[]))
        .into();
    let board = Board::new(&records, &[], &[]).unwrap();
    let keys = [
        MetricKey::DISTS,
        MetricKey::LPIPS,
        MetricKey::PSNR,
        MetricKey::SSIM,
    ];
    let tables = build::of_scores(&board, &keys.map(Metric::from));
    let names: Vec<_> = tables
        .iter()
        .map(|t| (t.name.as_str(), t.metrics.len()))
        .collect();
    assert_eq!(names, [("scores-perceptual", 2), ("scores-pixelwise", 2)]);
}

#[test]
fn latex_prints_labels_as_they_are() {
    let escaped = latex::escape(r"50%_a&b#{c}$d^~\");
    assert_eq!(
        escaped,
        r"50\%\_a\&b\#\{c\}\$d\textasciicircum{}\textasciitilde{}\textbackslash{}"
    );
    let table = psnr_table(&[record("data_set", "p", "100%", 0.1, &[("psnr", 1.0)])]);
    let latex = latex::latex(&table);
    assert!(
        latex.contains("{data\\_set ($n=1$)}") && latex.contains("\n100\\% & 1.00 \\\\\n"),
        "{latex}"
    );
    for brace in ['{', '}'] {
        let count = |c: char| {
            latex
                .replace("\\{", "")
                .replace("\\}", "")
                .matches(c)
                .count()
        };
        assert_eq!(count(brace), count('{'));
    }
}

#[test]
fn hostile_labels_stay_text_everywhere() {
    let evil = "<img src=x onerror=alert(1)>\"'|`*\n";
    let mut records = vec![record(evil, "p", evil, 0.1, &[("psnr", 1.0)])];
    records.push(failed(record(evil, "q", evil, 0.1, &[]), evil));
    let mut input = input(&records);
    input.title = evil.into();
    input.summary = evil.into();
    input.facts.push(FactGroup {
        title: evil.into(),
        facts: vec![(evil.into(), evil.into())],
    });
    let files = files(&input);
    assert!(files.len() > 5);
    for (name, bytes) in &files {
        if [".html", ".md", ".svg"]
            .iter()
            .any(|end| name.ends_with(end))
        {
            let text = String::from_utf8(bytes.clone()).unwrap();
            assert!(!text.contains("<img src=x"), "{name}");
        }
    }
    let table = markdown::markdown(&psnr_table(&records));
    let columns: Vec<usize> = table
        .lines()
        .take(3)
        .map(|line| line.replace("\\|", "").matches('|').count())
        .collect();
    assert_eq!(columns, [3, 3, 3], "{table}");
}

/// A picture that depends on the record.
struct Plain;

impl Pictures for Plain {
    fn source(&self, record: &Record) -> Result<RgbImage, String> {
        Ok(RgbImage::from_fn(64, 48, |x, y| {
            Rgb([x as u8, y as u8, (record.baseline_m * 100.0) as u8])
        }))
    }

    fn target(&self, record: &Record) -> Result<RgbImage, String> {
        self.source(record)
    }

    fn prediction(&self, record: &Record) -> Result<RgbImage, String> {
        match record.method.as_str() {
            "a" => self.source(record),
            _ => Err("not kept".into()),
        }
    }
}

#[test]
fn the_same_records_in_any_order_give_the_same_bytes() {
    let records = small_run();
    let mut reversed = records.clone();
    reversed.reverse();
    let (mut first, mut second) = (input(&records), input(&reversed));
    first.pictures = &Plain;
    second.pictures = &Plain;
    let (first, second) = (files(&first), files(&second));
    assert!(first.contains_key("index.html") && first.contains_key("plots/motion-psnr.png"));
    assert_eq!(
        first.keys().collect::<Vec<_>>(),
        second.keys().collect::<Vec<_>>()
    );
    for (name, bytes) in &first {
        assert!(bytes == &second[name], "{name} differs");
    }
    let html = String::from_utf8(first["index.html"].clone()).unwrap();
    // Two sources, two targets, predictions and errors of `a`; `b` says why it has none.
    assert_eq!(
        html.matches("<img src=\"data:image/jpeg;base64,").count(),
        2 + 2 + 4
    );
    assert!(html.contains("not kept") && html.contains("failed: p2.ply: truncated"));
}

#[test]
fn pictures_keep_to_the_bytes_allowed() {
    let records = small_run();
    let mut input = input(&records);
    input.pictures = &Plain;
    input.options.picture_bytes = 1;
    let files = files(&input);
    let html = String::from_utf8(files["index.html"].clone()).unwrap();
    assert!(!html.contains("data:image") && html.contains("No pair to show."));
}

#[test]
fn an_empty_run_still_gives_a_report() {
    let files = files(&input(&[]));
    assert!(files.contains_key("index.html") && files.contains_key("report.md"));
    let mut empty = input(&[]);
    empty.datasets.push(Dataset::named("d"));
    empty.methods.push(Method::named("m"));
    let text = text_tables(&empty).unwrap();
    assert!(
        text.contains("n/a") && text.contains("d has no pairs."),
        "{text}"
    );
}

#[test]
fn plots_exist_for_one_sample_for_none_and_for_infinity() {
    let psnr: Metric = MetricKey::PSNR.into();
    let figure = |records: &[Record]| {
        let board = Board::new(records, &[], &[]).unwrap();
        motion::figure(&board, &psnr, motion::Motion::Metres, None).unwrap()
    };
    assert_eq!(figure(&[]), None);
    assert_eq!(figure(&[record("d", "p", "m", 0.1, &[])]), None);
    let one = figure(&[record("d", "p", "m", 0.1, &[("psnr", 20.0)])]).unwrap();
    assert!(one.svg.contains(">\nPSNR (dB)\n</text>") && one.svg.contains(">\nm\n</text>"));
    assert!(
        one.svg
            .contains("font-family=\"Inter, &apos;Helvetica Neue&apos;")
    );
    assert!(!one.svg.contains("∞"));
    let all = figure(&[record("d", "p", "m", 0.0, &[("psnr", f64::INFINITY)])]).unwrap();
    assert!(all.svg.contains("∞"));
    let size = image::load_from_memory(&all.png).unwrap();
    assert!(size.width() > 1000 && size.height() > 500);
    let far = record("d", "p", "m", 1e300, &[("psnr", -1e300)]);
    assert!(figure(&[far, record("d", "q", "m", f64::NAN, &[("psnr", 1.0)])]).is_some());
    let board = Board::new(&[], &[], &[]).unwrap();
    assert_eq!(
        histogram::figure(&board, motion::Motion::Metres, None).unwrap(),
        None
    );
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

#[test]
fn reports_need_nothing_from_outside() {
    let records = small_run();
    let files = files(&input(&records));
    let html = String::from_utf8(files["index.html"].clone()).unwrap();
    for outside in ["http://", "https://", "<link", "@import", "url("] {
        let rest = html.replace("http://www.w3.org/2000/svg", "");
        assert!(!rest.contains(outside), "{outside}");
    }
}
