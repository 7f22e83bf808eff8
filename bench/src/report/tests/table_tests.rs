//! What tables say, in each form.

use crate::report::tables::{csv, html as html_table, latex, markdown, text};

use super::*;
use crate::evaluate::Aggregation;
use crate::evaluate::record::{ChosenScale, Crop};
use crate::scoring::Region;

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
    let tables = build::of_scores(&board, &keys.map(Column::from));
    let names: Vec<_> = tables
        .iter()
        .map(|t| (t.name.as_str(), t.columns.len()))
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
    // OT1 has neither glyph; a row must not begin with an option of the rule before it.
    assert_eq!(latex::escape("[a]\"`é"), "{[}a]\\char34{}\\`{}é");
    assert_eq!(
        latex::escape("中✓e\u{301}ð\n"),
        "{[U+4E2D]}{[U+2713]}e{[U+0301]}{[U+00F0]}\\textbackslash{}u000a"
    );
    let odd = psnr_table(&[record("d", "p", "中\n", 0.1, &[("psnr", 1.0)])]);
    let fragment = latex::latex(&odd);
    assert!(
        fragment.starts_with("% [U+...] stands for the character")
            && fragment.contains("\n{[U+4E2D]}\\textbackslash{}u000a & 1.00"),
        "{fragment}"
    );
    for shown in [text::text(&odd), html_table::html(&odd, "t").unwrap()] {
        assert!(shown.contains("中\\u000a"), "{shown}");
    }
    assert!(markdown::markdown(&odd).contains("| 中\\\\u000a |"));
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
fn reported_quantities_are_shown_for_those_who_report_them() {
    let mut records = small_run();
    records[0].extras.insert("mean_alpha".into(), 0.75);
    records[1].extras.insert("mean_alpha".into(), 0.25);
    let board = Board::new(&records, &[], &[]).unwrap();
    let alpha = Column::reported("mean_alpha", "mean alpha", 3, "");
    let holes = Column::reported("hole_share", "holes", 3, "");
    let table = build::of_extras(&board, &[holes.clone(), alpha]).unwrap();
    assert_eq!((table.columns.len(), table.rows.len()), (1, 1));
    assert_eq!(
        (table.rows[0].cells[0].value, table.rows[0].cells[0].rank),
        (Some(0.5), None)
    );
    assert!(table.notes.is_empty());
    assert_eq!(build::of_extras(&board, &[holes]), None);
}

fn cropped(record: Record, share: f64) -> Record {
    let region = Region::whole((8, 6));
    Record {
        crop: Some(Crop { region, share }),
        ..record
    }
}

#[test]
fn cropped_resized_and_chosen_predictions_are_marked() {
    let swept = |record: Record| Record {
        scale: Some(ChosenScale {
            best: 1.0,
            tried: 3,
        }),
        ..record
    };
    let one = |pair: &str, method: &str| record("d", pair, method, 0.1, &[("psnr", 20.0)]);
    let records = [
        cropped(one("p1", "crops"), 0.5),
        cropped(one("p2", "crops"), 0.75),
        Record {
            resized_from: Some((32, 24)),
            ..one("p1", "small")
        },
        one("p2", "small"),
        swept(one("p1", "sweeps")),
        swept(one("p2", "sweeps")),
        one("p1", "plain"),
        one("p2", "plain"),
        Record {
            valid_share: Some(0.9),
            ..one("p1", "masked")
        },
        one("p2", "masked"),
    ];
    let small = ReportMethod {
        resize_kernel: Some("bicubic".to_owned()),
        ..ReportMethod::named("small")
    };
    let board = Board::new(&records, &[], &[small]).unwrap();
    let tables = build::of_scores(&board, &[MetricKey::PSNR.into()]);
    let notes = |label: &str| -> Vec<&str> {
        let row = tables[0].rows.iter().find(|row| row.label == label);
        let notes = row.unwrap().cells[0].notes.iter();
        notes.map(|&n| tables[0].notes[n].as_str()).collect()
    };
    assert!(notes("plain").is_empty());
    assert!(
        notes("crops")[0].contains("crops on d: cropped; 2 of 2 pairs")
            && notes("crops")[0].contains("62.5 %")
    );
    assert!(notes("small")[0].contains("1 of 2 predictions"));
    assert!(notes("small")[0].contains("resized up (`bicubic`) before"));
    assert!(notes("sweeps")[0].contains("best of 3 scales by DISTS"));
    assert!(notes("masked")[0].contains("exclude pixels of 1 of 2 targets, on average 10.0 %"));
    // A mark costs nobody a rank.
    assert!(
        tables[0]
            .rows
            .iter()
            .all(|row| row.cells[0].rank == Some(1))
    );
}

#[test]
fn a_common_region_is_no_methods_crop() {
    let with = |method: &str| {
        let record = record("d", "p1", method, 0.1, &[("psnr", 20.0)]);
        cropped(record, 0.5)
    };
    let records = [with("copy"), with("crops")];
    let dataset = ReportDataset {
        common_region: true,
        ..ReportDataset::named("d")
    };
    let board = Board::new(&records, &[dataset], &[]).unwrap();
    let tables = build::of_scores(&board, &[MetricKey::PSNR.into()]);
    assert_eq!(
        tables[0].notes,
        [
            "d: 1 of 1 pairs scored on a part of the target only, on average 50.0 % of its pixels, the common region of \
             all methods."
        ]
    );
}

#[test]
fn a_column_that_is_not_the_papers_is_marked_in_every_form() {
    let records = [
        record("mine", "p1", "a", 0.1, &[("psnr", 20.0)]),
        record("scannetpp", "p1", "a", 0.1, &[("psnr", 20.0)]),
    ];
    let with = |name: &str| ReportDataset {
        proxies: vec!["split=nvs_sem_val".to_owned(), "threshold=0.5".to_owned()],
        ..ReportDataset::named(name)
    };
    // A dataset that the paper does not have is nobody's proxy.
    let datasets = [with("mine"), with("scannetpp")];
    let board = Board::new(&records, &datasets, &[]).unwrap();
    let tables = build::of_scores(&board, &[MetricKey::PSNR.into()]);
    let table = &tables[0];
    assert_eq!(table.groups[0].note, None);
    assert_eq!(table.groups[1].note, Some(0));
    assert_eq!(table.notes.len(), 1);
    assert!(table.notes[0].contains("`split=nvs_sem_val`, `threshold=0.5`"));

    let markdown = markdown::markdown(table);
    assert!(
        markdown.contains("scannetpp<sup>a</sup><br>PSNR"),
        "{markdown}"
    );
    assert!(markdown.contains("mine<br>PSNR"), "{markdown}");
    let html = html_table::html(table, "t").unwrap();
    assert!(
        html.contains("scannetpp<sup><a href=\"#t-a\">a</a></sup>"),
        "{html}"
    );
    let latex = latex::latex(table);
    assert!(
        latex.contains("scannetpp\\textsuperscript{a} ($n=1$)"),
        "{latex}"
    );
    let text = text::text(table);
    assert!(text.contains("scannetpp a) (n=1)"), "{text}");
    let csv = csv::csv(table);
    let mut reader = ::csv::Reader::from_reader(csv.as_bytes());
    let rows: Vec<::csv::StringRecord> = reader.records().map(Result::unwrap).collect();
    assert_eq!((&rows[0][1], &rows[0][11]), ("mine", ""));
    assert_eq!((&rows[1][1], &rows[1][11]), ("scannetpp", "a"));
    assert!(rows[1][12].contains("proxy of the paper's column"));
}

#[test]
fn headings_state_region_and_every_variant_that_is_not_the_only_default() {
    let heads = |keys: &str| {
        let keys = sharp_metrics::Selection::parse(keys).unwrap();
        let columns: Vec<Column> = keys.keys().map(Column::from).collect();
        Column::heads(&columns)
    };
    assert_eq!(
        heads("psnr,ssim-gauss11-valid@frustum"),
        ["PSNR ↑", "SSIM (frustum) ↑"]
    );
    assert_eq!(
        heads("ssim-gauss11-valid,ssim-gauss11-valid@frustum,psnr@frustum"),
        ["SSIM ↑", "SSIM (frustum) ↑", "PSNR (frustum) ↑"]
    );
    assert_eq!(
        heads("ssim-uniform7-sample,lpips-vgg"),
        ["SSIM uniform7 sample ↑", "LPIPS vgg ↓"]
    );
    assert_eq!(
        heads("ssim-gauss11-valid@frustum,ssim-gauss11-zero,dists"),
        [
            "SSIM gauss11 valid (frustum) ↑",
            "SSIM gauss11 zero ↑",
            "DISTS ↓"
        ]
    );
    let key: MetricKey = "ssim-gauss11-valid@frustum".parse().unwrap();
    let frustum = Column::from(key);
    let record = record("d", "p", "m", 0.1, &[(&frustum.key, 0.5)]);
    let records = [record];
    let board = Board::new(&records, &[], &[]).unwrap();
    let table = build::of_scores(&board, &[frustum]).remove(0);
    assert!(
        latex::latex(&table).contains("SSIM (frustum)$\\uparrow$"),
        "{}",
        latex::latex(&table)
    );
    assert!(markdown::markdown(&table).contains("d<br>SSIM (frustum) ↑"));
    assert!(text::text(&table).contains("SSIM (frustum) ↑"));
    assert!(
        html_table::html(&table, "t")
            .unwrap()
            .contains(">SSIM (frustum) ↑<code>")
    );
    let psnr: Column = "psnr@frustum".parse::<MetricKey>().unwrap().into();
    assert_eq!(psnr.axis_label(), "PSNR (frustum, dB)");
}

#[test]
fn baselines_that_methods_do_not_surpass_are_remarked_upon() {
    let mut records = Vec::new();
    for (method, psnr, ssim) in [
        ("mean", 16.0, 0.5),
        ("copy", 15.0, 0.4),
        ("holed", 10.0, 0.6),
        ("good", 12.0, 0.45),
    ] {
        let scores = [("psnr", psnr), ("ssim[gauss11,valid]", ssim)];
        let mut record = record("d", "p", method, 0.1, &scores);
        if method == "holed" {
            record.extras.insert("hole_share".into(), 0.209);
        }
        records.push(record);
    }
    let baseline = |label: &str| ReportMethod {
        is_baseline: true,
        ..ReportMethod::named(label)
    };
    let remarks = |records: &[Record]| {
        let methods = [baseline("mean"), baseline("copy")];
        let board = Board::new(records, &[], &methods).unwrap();
        let metrics = [MetricKey::PSNR.into(), MetricKey::SSIM.into()];
        build::of_scores(&board, &metrics).remove(0)
    };
    let table = remarks(&records);
    assert_eq!(
        table.remarks,
        [
            "d: a baseline beats every other method in PSNR (mean 16.00; good 12.00). holed leaves on \
          average 20.9 % of a picture empty, and these holes are scored like any other pixel; a baseline is better in \
          PSNR (mean 16.00; holed 10.00)."
        ]
    );
    for form in [
        markdown::markdown(&table),
        text::text(&table),
        latex::latex(&table).replace("\\%", "%"),
        html_table::html(&table, "t").unwrap(),
    ] {
        assert!(form.contains(&table.remarks[0]), "{form}");
    }
    // Equal as shown is not better; without baselines there is nothing to say.
    let mut equal = records.clone();
    for record in &mut equal[2..] {
        record.scores.insert("psnr".into(), Score::Value(15.999));
    }
    assert!(remarks(&equal).remarks.is_empty());
    assert!(remarks(&records[2..]).remarks.is_empty());
}

#[test]
fn numbers_from_features_that_are_not_the_published_ones_are_marked() {
    let selection = sharp_metrics::Selection::parse("dists").unwrap();
    let weights = sharp_metrics::Weights::deterministic("x");
    let infos = sharp_metrics::Scorer::new(&selection, &weights)
        .unwrap()
        .info();
    let records = [record("d", "p", "m", 0.1, &[("dists", 0.5)])];
    let board = Board::new(&records, &[], &[]).unwrap();
    let notes = |column: Column| build::of_scores(&board, &[column]).remove(0).notes;
    let marked = notes((&infos[0]).into());
    assert!(
        marked[0].starts_with("DISTS (`dists`): computed on `vgg16="),
        "{marked:?}"
    );
    assert!(notes(MetricKey::DISTS.into()).is_empty());
}

#[test]
fn means_over_scenes_or_sources_are_said_to_be_so() {
    let of = |pair: &str, scene: &str, source: &str, value: f64| Record {
        scene: scene.into(),
        source: source.into(),
        ..record("d", pair, "a", 0.1, &[("psnr", value)])
    };
    let records = [
        of("1", "x", "0", 10.0),
        of("2", "x", "0", 20.0),
        of("3", "x", "1", 30.0),
        of("4", "y", "0", 40.0),
    ];
    let table = |aggregation: Aggregation| {
        let dataset = ReportDataset {
            aggregation,
            ..ReportDataset::named("d")
        };
        let board = Board::new(&records, &[dataset], &[]).unwrap();
        build::of_scores(&board, &[MetricKey::PSNR.into()]).remove(0)
    };
    // (10 + 20 + 30) / 3 and 40; 15, 30 and 40.
    for (aggregation, mean, said) in [
        (Aggregation::Pairs, 25.0, None),
        (
            Aggregation::Scenes,
            30.0,
            Some("mean over scenes of means over pairs"),
        ),
        (
            Aggregation::Sources,
            85.0 / 3.0,
            Some("mean over source views of means over targets"),
        ),
    ] {
        let table = table(aggregation);
        assert_eq!(table.rows[0].cells[0].value, Some(mean));
        let csv = csv::csv(&table);
        match said {
            None => assert!(table.notes.is_empty(), "{:?}", table.notes),
            Some(said) => {
                assert!(markdown::markdown(&table).contains(said));
                assert!(csv.contains(said), "{csv}");
            }
        }
    }
}
