//! What a report leaves on disk.

use crate::report::plots::baselines;
use crate::report::tables::markdown;

use super::*;

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
    empty.datasets.push(ReportDataset::named("d"));
    empty.methods.push(ReportMethod::named("m"));
    let text = text_tables(&empty).unwrap();
    assert!(
        text.contains("n/a") && text.contains("d has no pairs."),
        "{text}"
    );
    empty.metrics.clear();
    assert_eq!(text_tables(&empty).unwrap(), "");
    assert!(super::files(&empty).contains_key("index.html"));
}

#[test]
fn plots_exist_for_one_sample_for_none_and_for_infinity() {
    let psnr: Column = MetricKey::PSNR.into();
    let figure = |records: &[Record]| {
        let board = Board::new(records, &[], &[]).unwrap();
        baselines::against_metric(&board, &psnr).unwrap()
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
    assert_eq!(baselines::histogram(&board).unwrap(), None);
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

#[test]
fn control_characters_leave_a_plot_readable() {
    let record = record("a\u{7}b", "p", "m", 0.1, &[("psnr", 20.0)]);
    let records = [record];
    let board = Board::new(&records, &[], &[]).unwrap();
    let mut psnr: Column = MetricKey::PSNR.into();
    psnr.label = "<\u{7}>".into();
    let figure = baselines::against_metric(&board, &psnr).unwrap().unwrap();
    assert!(
        figure
            .svg
            .contains("aria-label=\"&#60;\u{FFFD}&#62; against")
    );
}
