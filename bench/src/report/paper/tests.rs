use std::path::Path;

use super::grid::with_rows;
use super::rows::OwnRows;
use crate::evaluate::Results;
use crate::evaluate::manifest::{ListOrigin, ListRecord};
use crate::evaluate::record::{Record, Score, Status};
use crate::evaluate::test_records::{manifest, record};
use crate::report::tables::csv::csv_of;
use crate::report::tables::{Condition, Table};

use super::*;

#[test]
fn datasets_are_recognised_by_format_or_display_name() {
    let at = |name: &str| column(&ReportDataset::of(name, ""));
    assert_eq!(at("middlebury"), Some("Middlebury"));
    assert_eq!(at("scannetpp"), Some("ScanNet++"));
    assert_eq!(at("ScanNet++"), Some("ScanNet++"));
    assert_eq!(at("tanks-and-temples"), Some("Tanks and Temples"));
    assert_eq!(at("synthetic"), None);
    let mut eth3d = ReportDataset::of("my-eth", "eth3d");
    assert_eq!((column(&eth3d), eth3d.title()), (Some("ETH3D"), "my-eth"));
    eth3d.name = "eth3d".into();
    assert_eq!(eth3d.title(), "ETH3D");
}

#[test]
fn the_paper_has_the_datasets_that_we_say_it_has() {
    assert_eq!(
        published("quantitative").map(|t| t.datasets.clone()),
        Some(columns())
    );
}

/// Methods `a_&<b>` and `b`: six pairs of Middlebury, one of which failed for `b`, and one pair of
/// ETH3D.
fn results() -> Results {
    let mut manifest = manifest("psnr,ssim");
    let (mut dataset, mut method) = (manifest.datasets[0].clone(), manifest.methods[0].clone());
    let named = [("M", "middlebury"), ("eth3d", "eth3d"), ("own", "colmap")];
    manifest.datasets = named
        .map(|(name, format)| {
            (dataset.name, dataset.format) = (name.to_owned(), format.to_owned());
            dataset.clone()
        })
        .into();
    manifest.methods = ["a_&<b>", "b"]
        .map(|label| {
            method.label = label.to_owned();
            method.clone()
        })
        .into();
    let scored = |dataset: &str, number: usize, method: &str, psnr: f64, ssim: f64| Record {
        method: method.to_owned(),
        scores: [("psnr", psnr), ("ssim[gauss11,valid]", ssim)]
            .map(|(key, value)| (key.to_owned(), Score::Value(value)))
            .into(),
        ..record(dataset, number, number)
    };
    let mut records = Vec::new();
    for number in 0..6 {
        // SSIM is tied at three decimals.
        records.push(scored("M", number, "a_&<b>", 20.0 + number as f64, 0.7001));
        records.push(scored("M", number, "b", 21.0, 0.6999));
    }
    records[11].status = Status::Failed {
        reason: "out of memory".to_owned(),
    };
    records[11].scores.clear();
    // A single pair, identical pictures, and a method without a record for the pair.
    records.push(scored("eth3d", 0, "a_&<b>", f64::INFINITY, 1.0));
    records.push(scored("own", 0, "b", 30.0, 0.9));
    records.sort_by(|a, b| a.pair_id.cmp(&b.pair_id));
    Results {
        manifest,
        records,
        missing: std::collections::BTreeSet::new(),
        pictures: Vec::new(),
        damaged: Vec::new(),
        methods_listed: false,
    }
}

fn mixed() -> Table {
    let rows = OwnRows::Scores(Box::new(results()));
    let beside = Beside {
        only_measured: true,
        ..Beside::default()
    };
    with_rows(published("psnr-ssim").unwrap(), rows, &beside).unwrap()
}

#[test]
fn datasets_are_shown_by_name() {
    let groups = |datasets: &[&str], rows: Option<OwnRows>| {
        let beside = Beside {
            datasets: datasets.iter().map(|name| (*name).to_owned()).collect(),
            ..Beside::default()
        };
        let paper = published("quantitative").unwrap();
        let table = match rows {
            Some(rows) => with_rows(paper, rows, &beside).unwrap(),
            None => paper_table(paper, &beside).unwrap(),
        };
        let cells = table.groups.len() * table.columns.len();
        assert!(table.rows.iter().all(|row| row.cells.len() == cells));
        let names = table.groups.into_iter().map(|group| group.title);
        names.collect::<Vec<_>>()
    };
    assert_eq!(groups(&["eth3d", "Middlebury"], None).len(), 2);
    let own = || Some(OwnRows::Scores(Box::new(results())));
    let (some, all) = (groups(&["middlebury"], own()), groups(&[], own()));
    assert!(
        some.len() < all.len() && all.iter().any(|title| some.contains(title)),
        "{some:?} {all:?}"
    );
}

#[test]
fn equal_numbers_as_shown_share_a_rank_and_each_list_is_named() {
    let mut complete = results();
    complete
        .records
        .retain(|r| r.status == Status::Ok && r.pair_id != "M/5/s__5");
    // Two runs of the same list; one evaluated fewer pairs.
    complete.manifest.pairs.lists = [7, 6]
        .map(|evaluated| ListRecord {
            sha256: "0123456789abcdef".to_owned(),
            listed: 7,
            evaluated,
            limit: None,
            origin: ListOrigin::Given,
            choices: std::collections::BTreeMap::new(),
        })
        .into();
    let rows = OwnRows::Scores(Box::new(complete));
    let table = with_rows(published("psnr-ssim").unwrap(), rows, &Beside::default()).unwrap();
    let hash = |c: &&Condition| c.text.contains("(list sha256 0123456789ab…)");
    assert_eq!(table.checklist.iter().filter(hash).count(), 2);
    let ranks: Vec<_> = table.rows[7..]
        .iter()
        .map(|r| (r.cells[0].rank, r.cells[1].rank))
        .collect();
    assert_eq!(ranks, [(Some(1), Some(1)), (Some(2), Some(1))]);
}

/// The table has ties, gaps, infinities, incomplete rows and a user's dataset. `SHARP_BENCH_BLESS=1` rewrites the
/// expected files.
#[test]
fn every_form_is_as_it_was() {
    let (table, paper) = (mixed(), published("psnr-ssim").unwrap());
    let folder = Path::new(env!("CARGO_MANIFEST_DIR")).join("src/report/paper/snapshots");
    let csv = String::from_utf8(csv_of(numbers(paper, &table)).unwrap()).unwrap();
    for (name, form) in [
        ("mixed.txt", table.text()),
        ("mixed.md", table.markdown()),
        ("mixed.csv", csv),
        ("mixed.tex", table.latex()),
        ("mixed.html", table.html("mixed").unwrap()),
    ] {
        let path = folder.join(name);
        if std::env::var_os("SHARP_BENCH_BLESS").is_some() {
            std::fs::write(&path, &form).unwrap();
        }
        assert_eq!(
            form,
            std::fs::read_to_string(&path).unwrap_or_default(),
            "{name}"
        );
    }
}
