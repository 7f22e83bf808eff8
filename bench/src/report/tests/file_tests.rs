//! What a report leaves on disk.

use std::collections::BTreeSet;

use crate::evaluate::record::Crop;
use crate::report::error_map::colour;
use crate::report::figures::qualitative;
use crate::report::gallery::{Gallery, PictureKind, Pictures};
use crate::report::plots::baselines;
use crate::report::tables::markdown;
use crate::scoring::Region;

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
    assert_eq!(html.matches("\"data:image/jpeg;base64,").count(), 2 + 2 + 4);
    assert!(html.contains("not kept") && html.contains("failed: p2.ply: truncated"));
}

#[test]
fn pictures_keep_to_the_bytes_allowed() {
    let records = small_run();
    let mut input = input(&records);
    input.pictures = &Plain;
    input.options.pictures = Some(PictureBudget {
        bytes: 1,
        side: 960,
    });
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
    assert_eq!(baselines::histogram(&board, None).unwrap(), None);
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

#[test]
fn a_metric_without_any_number_is_named_once_and_shown_nowhere() {
    let mut records = small_run();
    for record in &mut records {
        let score = Score::Unavailable {
            unavailable: "no weights of a network".into(),
        };
        record.scores.insert(MetricKey::LPIPS.to_string(), score);
    }
    let mut input = input(&records);
    input.metrics = vec![MetricKey::LPIPS.into(), MetricKey::PSNR.into()];
    input.pictures = &Plain;
    let files = files(&input);
    for (name, bytes) in &files {
        let text = String::from_utf8_lossy(bytes);
        let times = match name.as_str() {
            "index.html" | "report.md" | "tables/scores.md" | "tables/scores.tex" => 1,
            _ => 0,
        };
        assert_eq!(text.matches("LPIPS").count(), times, "{name}");
        assert_eq!(
            text.matches("no weights of a network").count(),
            times,
            "{name}"
        );
    }
    // The lead, the tiles and the table count the same.
    let html = String::from_utf8(files["index.html"].clone()).unwrap();
    assert!(
        html.contains("1 dataset, 1 scene, 2 pairs, 2 methods, 1 metric, 1 failure. Two methods.")
    );
    for tile in [
        "<dt>metric</dt><dd>1</dd>",
        "class=\"bad\"><dt>failure</dt><dd>1</dd>",
        "<small>2 pairs</small>",
    ] {
        assert!(html.contains(tile), "{tile}");
    }
    let text = text_tables(&input).unwrap();
    assert!(
        text.contains("not shown: LPIPS alex (`lpips[alex,v0.1]`): no weights"),
        "{text}"
    );
}

/// What the score leaves out, the error picture does not show as an error.
#[test]
fn error_pictures_show_what_is_not_scored_as_such() {
    let mut cropped = record("d", "p1", "crops", 0.1, &[("psnr", 0.0)]);
    let region = Region {
        x: 0,
        y: 24,
        width: 64,
        height: 24,
    };
    cropped.crop = Some(Crop { region, share: 0.5 });
    let records = [record("d", "p1", "all", 0.1, &[("psnr", 0.0)]), cropped];
    let board = Board::new(&records, &[], &[]).unwrap();
    let pictures = HalfMasked(PathBuf::new());
    let masked = ReportInput {
        pictures: &pictures,
        ..input(&records)
    };
    let gallery = Gallery::new(&board, &[], &masked, &pictures);
    let decoded = |pictures: &Pictures, kind: PictureKind| {
        let jpeg = &pictures[&kind].as_ref().unwrap().jpeg;
        image::load_from_memory(jpeg).unwrap().to_rgb8()
    };
    let error = |method: usize| {
        let shown = gallery.pairs[0].methods[method].as_ref().unwrap();
        decoded(&shown.pictures, PictureKind::Error)
    };
    let is_grey = |picture: &RgbImage, x, y| {
        let [r, g, b] = picture.get_pixel(x, y).0;
        r.abs_diff(g) < 12 && g.abs_diff(b) < 12 && (80..180).contains(&g)
    };
    let is_bright = |picture: &RgbImage, x, y| {
        let pixels = picture.get_pixel(x, y).0.into_iter().zip(colour(1.0).0);
        pixels.map(|(a, b)| a.abs_diff(b)).all(|d| d < 12)
    };
    let mask = decoded(&gallery.pairs[0].views, PictureKind::Mask);
    assert!(is_grey(&mask, 8, 4) && mask.get_pixel(56, 4).0.iter().all(|level| *level > 240));
    let (all, crops) = (error(0), error(1));
    for y in [4, 20, 28, 44] {
        assert!(is_grey(&all, 8, y) && is_bright(&all, 56, y), "{y}");
        let inside = y >= 24;
        assert!(
            is_grey(&crops, 8, y) && is_grey(&crops, 56, y) != inside,
            "{y}"
        );
        assert_eq!(is_bright(&crops, 56, y), inside, "{y}");
    }
}

#[test]
fn kept_pictures_are_linked_where_they_lie_beside_the_report() {
    let records = [record("d", "p 1", "a", 0.1, &[("psnr", 20.0)])];
    let mut input = input(&records);
    let beside = HalfMasked(std::env::temp_dir().join("run"));
    input.pictures = &beside;
    let page =
        |input: &ReportInput<'_>| String::from_utf8(files(input)["index.html"].clone()).unwrap();
    let html = page(&input);
    assert!(html.contains("\"full\":\"../run/a%201.png\"") && html.contains("\"id\":\"d/p 1\""));
    assert!(html.contains("\"full\":{\"source\":null,\"target\":\"../run/im%201.png\"}"));
    let elsewhere = HalfMasked(PathBuf::from("/elsewhere"));
    input.pictures = &elsewhere;
    assert!(!page(&input).contains("%201.png"));
}

#[test]
fn many_pairs_have_their_pictures_beside_the_page_and_what_is_gone_is_removed() {
    let pair = |at: usize| record("d", &format!("p{at:02}"), "a", 0.1, &[("psnr", 20.0)]);
    let records: Vec<Record> = (0..25).map(pair).collect();
    let dir = tempfile::tempdir().unwrap();
    let report = |records: &[Record], layout: Option<Layout>| {
        let mut input = input(records);
        input.pictures = &Plain;
        input.options.layout = layout;
        let written = write_report(&input, dir.path()).unwrap();
        let html = std::fs::read_to_string(&written.html).unwrap();
        let thumbs = std::fs::read_dir(dir.path().join("thumbs"));
        (written, html, thumbs.map_or(0, Iterator::count))
    };
    // Source, target, prediction and error of each; equal ones are one file.
    let (written, html, thumbs) = report(&records, None);
    let shown: Vec<&str> = html.split("\"thumbs/").skip(1).collect();
    let names: BTreeSet<&str> = shown.iter().map(|rest| &rest[..20]).collect();
    assert_eq!((written.layout, shown.len()), (Layout::Folder, 25 * 4));
    assert!(thumbs == names.len() && thumbs < 25 * 4);
    for (name, rest) in names.iter().zip(&shown) {
        assert!(dir.path().join("thumbs").join(name).is_file());
        assert!(rest[20..].starts_with("\",64,48]"), "{rest}");
    }
    assert!(!html.contains("base64,"));
    assert!(written.all.iter().all(|path| path.is_file()));
    assert!(html.contains("All pairs of the run."));
    // One pair less is few enough for one file.
    let (written, html, thumbs) = report(&records[1..], None);
    assert_eq!((written.layout, thumbs), (Layout::File, 0));
    assert_eq!(html.matches("base64,").count(), 24 * 4);
    let (_, html, _) = report(&records, Some(Layout::File));
    assert!(html.contains("24 of 25 pairs"));
    assert!((1..=4).contains(&report(&records[..1], Some(Layout::Folder)).2));
}

#[test]
fn pictures_shrink_until_all_pairs_fit() {
    let pair = |at: usize| record("d", &format!("p{at:02}"), "noise", 0.1, &[("psnr", 20.0)]);
    let records: Vec<Record> = (0..30).map(pair).collect();
    let side = |bytes: usize| {
        let mut input = input(&records);
        input.pictures = &Noise;
        input.options.pictures = Some(PictureBudget { bytes, side: 480 });
        let files = files(&input);
        let thumbs = files.iter().filter(|(name, _)| name.ends_with(".jpg"));
        let used: usize = thumbs.clone().map(|(_, bytes)| bytes.len()).sum();
        let first = image::load_from_memory(thumbs.clone().next().unwrap().1).unwrap();
        assert_eq!(thumbs.count(), 30);
        (first.width(), used)
    };
    // Noise, the worst that a picture can be.
    let (all, used) = side(100 << 20);
    assert_eq!(all, 480);
    let (fewer, fits) = side(used / 2);
    assert!(fewer < 480 && fits <= used / 2, "{fewer} {fits} of {used}");
}

#[test]
fn a_public_report_leaves_out_what_terms_forbid_and_names_it() {
    let run = std::env::temp_dir().join("run");
    let lost = format!("{}/b.png: is gone", run.display());
    let records = [
        record("middlebury", "p", "a", 0.1, &[("psnr", 20.0)]),
        record("booster", "p", "a", 0.1, &[("psnr", 20.0)]),
        record("anyone's", "p", "a", 0.1, &[("psnr", 20.0)]),
        failed(record("middlebury", "p", "b", 0.1, &[]), &lost),
    ];
    let page = |public: bool| {
        let mut input = input(&records);
        let kept = HalfMasked(run.clone());
        input.pictures = &kept;
        input.options.public = public;
        input.methods = vec![ReportMethod {
            description: format!("imported(dir={})", run.display()),
            ..ReportMethod::named("a")
        }];
        String::from_utf8(files(&input)["index.html"].clone()).unwrap()
    };
    // Target, mask, prediction and error of a pair, and links to predictions (here also to that of the failed one) and targets.
    let count = |html: &str| {
        [
            html.matches("base64,").count(),
            html.matches("%201.png").count(),
        ]
    };
    let (all, public) = (page(false), page(true));
    assert_eq!((count(&all), count(&public)), ([12, 7], [4, 0]));
    assert!(!all.contains("class=\"withheld\""));
    assert!(public.contains("Terms of the pictures shown: middlebury: free to use and publish"));
    let notice = "the pictures of anyone&#39;s (terms unknown), booster (research use; do not redistribute).";
    assert!(public.contains(notice), "{public}");
    // Nothing is said to lack a prediction that is withheld, and no folder of this machine is named.
    let folder = run.display().to_string();
    assert!(
        all.contains(&folder) && !public.contains(&folder),
        "{public}"
    );
    assert!(public.contains("…/b.png: is gone") && public.contains("(dir=…/run)"));
    assert_eq!(public.matches("\"no target\"").count(), 0, "{public}");
    let withheld = "terms do not let it be published";
    // Of two datasets: source, target and the depth of both; prediction, error and alpha.
    assert_eq!(public.matches(withheld).count(), 14, "{public}");
}

#[test]
fn the_qualitative_figure_has_all_datasets_and_whole_captions() {
    let records: Vec<Record> = ["a", "b", "c", "d", "e", "f"]
        .map(|dataset| {
            record(
                dataset,
                "p",
                "a",
                0.1,
                &[("psnr", 20.0), ("ssim[gauss11,valid]", 0.5)],
            )
        })
        .into();
    let height = |records: &[Record], metrics: &[Column]| {
        let board = Board::new(records, &[], &[]).unwrap();
        let png = qualitative::figure(&board, metrics, &Plain)
            .unwrap()
            .unwrap();
        image::load_from_memory(&png).unwrap().height()
    };
    let all: Vec<Column> = MetricKey::all().into_iter().map(Column::from).collect();
    let rows: Vec<u32> = (1..=6).map(|n| height(&records[..n], &all[..2])).collect();
    assert!(
        rows.windows(2)
            .all(|two| two[1] - two[0] == rows[1] - rows[0]),
        "{rows:?}"
    );
    let mut many = records[..1].to_vec();
    many[0].scores = all
        .iter()
        .map(|m| (m.key.clone(), Score::Value(0.5)))
        .collect();
    assert!(height(&many, &all) > rows[0] + 100);
}
