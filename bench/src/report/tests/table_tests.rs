//! Tests of the contents of tables. The snapshots of `paper` test every output format.

use crate::report::tables::latex;

use super::*;
use crate::evaluate::Aggregation;
use crate::evaluate::record::{ChosenScale, Crop};
use crate::scoring::Region;

#[test]
fn contradicting_records_are_refused() {
    let refused = |records: [Record; 2]| {
        let results = psnr(records.into());
        Board::of(&results).unwrap_err().to_string()
    };
    let of = |method: &str, baseline_m: f64| record("d", "p", method, baseline_m, &[]);
    let error = refused([of("m", 0.1), of("m", 0.1)]);
    assert_eq!(error, "pair 'd/p', method 'm': has two records");
    let error = refused([of("m", 0.1), of("n", 0.2)]);
    assert!(error.contains("baseline differs"), "{error}");
}

#[test]
fn coverage_is_shown_and_incomplete_rows_are_not_ranked() {
    let table = table(&[MetricKey::PSNR], &small_run());
    let [a, b] = [0, 1].map(|row: usize| &table.rows[row].cells[0]);
    assert_eq!((a.value, a.coverage), (Some(25.0), Some((2, 2))));
    assert_eq!((b.value, b.coverage), (Some(40.0), Some((1, 2))));
    // b has a better mean, but over other pairs, and a alone is not ranked.
    assert_eq!((a.rank, b.rank), (None, None));
    let note = &table.notes[b.notes[0]];
    assert!(
        note.contains("1 of 2 pairs") && note.contains("p2.ply: truncated (1×)"),
        "{note}"
    );
    let csv = String::from_utf8(table.csv()).unwrap();
    assert!(csv.contains("\nb,d,psnr,40,,1,2,1,0,,2,a,"), "{csv}");
}

#[test]
fn a_mean_with_an_infinity_is_infinite_and_says_of_how_many() {
    let table = table(
        &[MetricKey::PSNR],
        &[
            record("d", "p1", "a", 0.1, &[("psnr", f64::INFINITY)]),
            record("d", "p2", "a", 0.2, &[("psnr", 31.2)]),
        ],
    );
    let cell = &table.rows[0].cells[0];
    assert_eq!(
        (cell.value, cell.infinite, cell.std),
        (Some(f64::INFINITY), 1, None)
    );
    let note =
        "Infinite for 1 of 2 pairs, so the mean is infinite; the mean of the other pairs is 31.20.";
    assert_eq!(table.notes, [note]);
}

#[test]
fn a_column_without_numbers_says_how_to_get_them() {
    let mut records = small_run();
    for record in records
        .iter_mut()
        .filter(|record| record.status == Status::Ok)
    {
        let score = Score::Unavailable {
            unavailable: "run `weights fetch alex`".into(),
        };
        record.scores.insert(MetricKey::LPIPS.to_string(), score);
    }
    let table = table(&[MetricKey::LPIPS], &records);
    assert_eq!(
        table.notes,
        ["No LPIPS alex (`lpips[alex,v0.1]`): run `weights fetch alex`."]
    );
    let cells = table.rows.iter().map(|row| &row.cells[0]);
    assert!(
        cells
            .into_iter()
            .all(|cell| cell.value.is_none() && cell.notes == [0])
    );
    assert!(table.latex().contains("\\texttt{weights fetch alex}"));
}

#[test]
fn wide_runs_are_split_as_in_the_paper() {
    let records = ["a", "b", "c", "d", "e", "f"].map(|name| record(name, "p", "m", 0.1, &[]));
    let keys = [
        MetricKey::DISTS,
        MetricKey::LPIPS,
        MetricKey::PSNR,
        MetricKey::SSIM,
    ];
    let results = results(&keys, records.into());
    let tables = mean_tables(&results, None).unwrap();
    let names = tables.iter().map(|t| (t.name.as_str(), t.columns.len()));
    let names: Vec<_> = names.collect();
    assert_eq!(names, [("scores-perceptual", 2), ("scores-pixelwise", 2)]);
}

#[test]
fn latex_prints_labels_as_they_are() {
    let escaped = latex::escape(r"50%_a&b#{c}$d^~\");
    assert_eq!(
        escaped,
        r"50\%\_a\&b\#\{c\}\$d\textasciicircum{}\textasciitilde{}\textbackslash{}"
    );
    // OT1 has glyphs for neither. At the start of a row, `[` would be parsed as an option of the preceding rule.
    assert_eq!(latex::escape("[a]\"`é"), "{[}a]\\char34{}\\`{}é");
    assert_eq!(
        latex::escape("中✓e\u{301}ð\n"),
        "{[U+4E2D]}{[U+2713]}e{[U+0301]}{[U+00F0]}\\textbackslash{}u000a"
    );
    let odd = table(
        &[MetricKey::PSNR],
        &[record("d", "p", "中\n", 0.1, &[("psnr", 1.0)])],
    );
    let fragment = odd.latex();
    assert!(
        fragment.starts_with("% [U+...] stands for the character")
            && fragment.contains("\n{[U+4E2D]}\\textbackslash{}u000a & 1.00"),
        "{fragment}"
    );
    for shown in [odd.text(), odd.html("t").unwrap()] {
        assert!(shown.contains("中\\u000a"), "{shown}");
    }
    assert!(odd.markdown().contains("| 中\\\\u000a |"));
}

#[test]
fn reported_quantities_are_shown_for_those_who_report_them() {
    let mut records = small_run();
    records[0].extras.insert("mean_alpha".into(), 0.75);
    records[1].extras.insert("mean_alpha".into(), 0.25);
    let results = psnr(records);
    let board = Board::of(&results).unwrap();
    let table = build::of_extras(&board, &build::extras(&board)).unwrap();
    assert_eq!((table.columns.len(), table.rows.len()), (1, 1));
    let cell = &table.rows[0].cells[0];
    assert_eq!((cell.value, cell.rank), (Some(0.5), None));
    assert!(table.notes.is_empty());
    assert_eq!(build::of_extras(&board, &[]), None);
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
    let one = |pair: &str, method: &str| record("d", pair, method, 0.1, &[("psnr", 20.0)]);
    let scale = Some(ChosenScale {
        best: 1.0,
        tried: 3,
    });
    let records = vec![
        cropped(one("p1", "crops"), 0.5),
        cropped(one("p2", "crops"), 0.75),
        Record {
            resized_from: Some((32, 24)),
            ..one("p1", "small")
        },
        one("p2", "small"),
        Record {
            scale,
            ..one("p1", "sweeps")
        },
        Record {
            scale,
            ..one("p2", "sweeps")
        },
        one("p1", "plain"),
        one("p2", "plain"),
        Record {
            valid_share: Some(0.9),
            ..one("p1", "masked")
        },
        one("p2", "masked"),
    ];
    let mut results = psnr(records);
    for method in &mut results.manifest.methods {
        let resize = "bicubic [a = -0.75]".to_owned();
        method.identity.settings.insert("resize".into(), resize);
    }
    let table = mean_tables(&results, None).unwrap().remove(0);
    let notes = |label: &str| -> String {
        let row = table.rows.iter().find(|row| row.label == label);
        let notes = row.unwrap().cells[0].notes.iter();
        notes.map(|&n| table.notes[n].as_str()).collect()
    };
    assert!(notes("plain").is_empty());
    for (label, said) in [
        ("crops", "crops on d: cropped; 2 of 2 pairs"),
        ("crops", "62.5 %"),
        ("small", "1 of 2 predictions"),
        ("small", "were resized (`bicubic`) before"),
        ("sweeps", "best of 3 scales by DISTS"),
        ("masked", "cover part of 1 of 2 targets (on average 10.0 %"),
    ] {
        assert!(notes(label).contains(said), "{}", notes(label));
    }
    // A rank stays even if its cell has a footnote.
    assert!(table.rows.iter().all(|row| row.cells[0].rank == Some(1)));
    // A note on the common region names no method.
    results.manifest.common_region = true;
    let table = mean_tables(&results, None).unwrap().remove(0);
    let said = "d: 2 of 2 pairs scored only on part of the target (on average 62.5 % of the pixels), the common region of \
                all methods.";
    assert!(
        table.notes.iter().any(|note| note == said),
        "{:?}",
        table.notes
    );
}

#[test]
fn a_column_that_is_not_the_papers_is_marked_in_every_form() {
    let scored = |name: &str| record(name, "p1", "a", 0.1, &[("psnr", 20.0)]);
    let results = psnr(vec![scored("mine"), scored("scannetpp")]);
    let mut board = Board::of(&results).unwrap();
    for dataset in &mut board.datasets {
        dataset.dataset.proxies = vec!["split=nvs_sem_val".into(), "threshold=0.5".into()];
    }
    let table = build::of_scores(&board, &board.metrics).remove(0);
    // A dataset that is not in the paper cannot differ from it.
    assert_eq!(
        [0, 1].map(|at: usize| table.groups[at].note),
        [None, Some(0)]
    );
    assert_eq!(table.notes.len(), 1);
    assert!(table.notes[0].contains("`split=nvs_sem_val`, `threshold=0.5`"));
    let csv = String::from_utf8(table.csv()).unwrap();
    for (form, mark) in [
        (table.markdown(), "ScanNet++<sup>a</sup><br>PSNR"),
        (
            table.html("t").unwrap(),
            "ScanNet++<sup><a href=\"#t-a\">a</a></sup>",
        ),
        (table.latex(), "ScanNet++\\textsuperscript{a} ($n=1$)"),
        (table.text(), "ScanNet++ a) (n=1)"),
        (
            csv,
            "a,scannetpp,psnr,20,,1,1,0,0,,2,a,ScanNet++: a proxy of the paper's column",
        ),
    ] {
        let form = form.replace(",\"", ",");
        assert!(form.contains(mark), "{form}");
    }
}

#[test]
fn headings_state_region_and_every_variant_that_is_not_the_only_default() {
    let heads = |keys: &str| {
        let keys = sharp_metrics::Selection::parse(keys).unwrap();
        let columns: Vec<Column> = keys.keys().map(Column::from).collect();
        Column::heads(&columns).join(", ")
    };
    let table = "\
psnr,ssim-gauss11-valid@frustum | PSNR ↑, SSIM (frustum) ↑
ssim-gauss11-valid,ssim-gauss11-valid@frustum,psnr@frustum | SSIM ↑, SSIM (frustum) ↑, PSNR (frustum) ↑
ssim-uniform7-sample,lpips-vgg | SSIM uniform7 sample ↑, LPIPS vgg ↓
ssim-gauss11-valid@frustum,ssim-gauss11-zero,dists | SSIM gauss11 valid (frustum) ↑, SSIM gauss11 zero ↑, DISTS ↓";
    for [keys, expected] in sharp_tests::rows(table) {
        assert_eq!(heads(keys), expected);
    }
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
    let remarks = |records: &[Record]| table(&[MetricKey::PSNR, MetricKey::SSIM], records).remarks;
    assert_eq!(
        remarks(&records),
        [
            "d: a baseline has a better mean than every other method in PSNR (mean 16.00; good 12.00); a method is \
             ahead of all baselines in SSIM (holed 0.600; mean 0.500). holed leaves 20.9 % of a picture empty on average, and these holes are scored like any \
             other pixels; a baseline has a better mean in PSNR (mean 16.00; holed 10.00)."
        ]
    );
    // A baseline that is equal as displayed is not better. Without baselines there is no remark.
    let mut equal = records.clone();
    for record in &mut equal[2..] {
        record.scores.insert("psnr".into(), Score::Value(15.999));
    }
    assert!(remarks(&equal).is_empty());
    assert!(remarks(&records[2..]).is_empty());
}

#[test]
fn numbers_from_features_that_are_not_the_published_ones_are_marked() {
    let records = [record("d", "p", "m", 0.1, &[("dists", 0.5)])];
    assert!(table(&[MetricKey::DISTS], &records).notes.is_empty());
    let selection = sharp_metrics::Selection::parse("dists").unwrap();
    let weights = sharp_metrics::Weights::deterministic("x");
    let scorer = sharp_metrics::Scorer::new(&selection, &weights).unwrap();
    let mut results = results(&[MetricKey::DISTS], records.into());
    results.manifest.metrics[0].info = scorer.info().remove(0);
    let marked = mean_tables(&results, None).unwrap().remove(0).notes;
    assert!(
        marked[0].starts_with("DISTS (`dists`): computed on `vgg16="),
        "{marked:?}"
    );
}

#[test]
fn means_over_scenes_or_sources_are_said_to_be_so() {
    let of = |pair: &str, scene: &str, source: &str, value: f64| Record {
        scene: scene.into(),
        source: source.into(),
        ..record("d", pair, "a", 0.1, &[("psnr", value)])
    };
    let mut results = psnr(vec![
        of("1", "x", "0", 10.0),
        of("2", "x", "0", 20.0),
        of("3", "x", "1", 30.0),
        of("4", "y", "0", 40.0),
    ]);
    // By scene: (10 + 20 + 30) / 3 and 40. By source: 15, 30 and 40.
    for (aggregation, mean, said) in [
        (Aggregation::Pairs, 25.0, ""),
        (Aggregation::Scenes, 30.0, "mean of the scenes' means"),
        (
            Aggregation::Sources,
            85.0 / 3.0,
            "mean of the source views' means",
        ),
    ] {
        results.manifest.aggregation = aggregation;
        let table = mean_tables(&results, None).unwrap().remove(0);
        assert_eq!(table.rows[0].cells[0].value, Some(mean));
        assert_eq!(table.notes.is_empty(), said.is_empty());
        assert!(table.notes.concat().contains(said), "{:?}", table.notes);
    }
}

#[test]
fn uncertainty_is_that_over_scenes_in_every_form() {
    let scores = [
        ("p1", 1.0),
        ("p2", 3.0),
        ("p3", 5.0),
        ("p4", 7.0),
        ("p5", 9.0),
        ("p6", 11.0),
    ];
    let records = scores.iter().enumerate().map(|(i, (pair, score))| Record {
        cluster: (i / 2).to_string(),
        ..record("d", pair, "a", 0.1, &[("psnr", *score)])
    });
    let results = psnr(records.collect());
    let of = |uncertainty| mean_tables(&results, Some(uncertainty)).unwrap().remove(0);
    let spread = |uncertainty| {
        of(uncertainty).rows[0].cells[0]
            .spread
            .unwrap()
            .of(uncertainty)
    };
    // Scenes of two pairs each with means 2, 6 and 10: sd 4, se 4/√3, and t with two degrees of freedom.
    assert_eq!(spread(Uncertainty::Sd), 4.0);
    assert!((spread(Uncertainty::Se) - 4.0 / 3.0_f64.sqrt()).abs() < 1e-12);
    assert!((spread(Uncertainty::Ci95) - 9.936_55).abs() < 1e-4);
    let table = of(Uncertainty::Ci95);
    assert!(table.text().contains("6.00 ± 9.94"), "{}", table.text());
    assert!(table.markdown().contains("6.00 ± 9.94"));
    assert!(
        table.latex().contains("6.00\\,$\\pm$\\,9.94"),
        "{}",
        table.latex()
    );
    assert!(table.html("t").unwrap().contains("<small>± 9.94</small>"));
    let csv = String::from_utf8(table.csv()).unwrap();
    let mut lines = csv.lines();
    assert!(lines.next().unwrap().ends_with(",scenes,ci95"));
    assert!(lines.next().unwrap().contains(",3,9.936"), "{csv}");
    assert!(table.remarks[0].contains("95 % confidence interval"));
    let plain = mean_tables(&results, None).unwrap().remove(0);
    assert!(!plain.text().contains('±') && !plain.latex().contains("pm"));
    // On the page, one point per scene in addition to the legend's marker, and a cross for the mean
    // and its interval.
    let board = Board::of(&results).unwrap();
    let drawn = |board: &Board<'_>| plots::by_scene(board, &board.metrics[0]).unwrap();
    let svg = drawn(&board).unwrap().svg;
    assert_eq!(svg.matches("<circle").count(), 3 + 1, "{svg}");
    // The name is in the legend and below its points.
    let label = format!(">\n{}\n</text>", board.methods[0].label);
    assert_eq!(svg.matches(&label).count(), 2, "{svg}");
    // With a single scene there is no spread.
    let one = psnr(small_run());
    assert!(drawn(&Board::of(&one).unwrap()).is_none());
    let one = mean_tables(&one, Some(Uncertainty::Se)).unwrap().remove(0);
    assert!(!one.text().contains('±'), "{}", one.text());
}
