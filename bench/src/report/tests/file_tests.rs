//! Tests of the files that a report writes.

use std::collections::BTreeSet;

use crate::evaluate::record::Crop;
use crate::report::error_map::colour;
use crate::report::figures::qualitative;
use crate::report::gallery::{Gallery, PictureKind, Pictures};
use crate::report::plots;
use crate::scoring::Region;

use super::*;

fn plain_options() -> ReportOptions {
    ReportOptions::default()
}

#[test]
fn hostile_labels_stay_text_everywhere() {
    let evil = "<img src=x onerror=alert(1)>\"'|`*\u{7}\n";
    let mut records = vec![record(evil, "p", evil, 0.1, &[("psnr", 1.0)])];
    records.push(failed(record(evil, "q", evil, 0.1, &[]), evil));
    let mut results = psnr(records);
    let scoring = &mut results.manifest.scoring;
    scoring.insert(evil.into(), evil.into());
    let files = files(&results, &[], &plain_options());
    assert!(files.len() > 5);
    for (name, bytes) in &files {
        if name.ends_with(".png") {
            continue;
        }
        let text = String::from_utf8(bytes.clone()).unwrap();
        assert!(!text.contains('\u{7}'), "{name}");
        if !name.ends_with(".csv") && !name.ends_with(".tex") {
            assert!(!text.contains("<img src=x"), "{name}");
        }
    }
    let markdown = String::from_utf8(files["tables/scores.md"].clone()).unwrap();
    let columns: Vec<usize> = markdown
        .lines()
        .take(3)
        .map(|line| line.replace("\\|", "").matches('|').count())
        .collect();
    assert_eq!(columns, [3, 3, 3], "{markdown}");
}

#[test]
fn the_same_records_in_any_order_give_the_same_bytes_and_load_nothing() {
    let dir = tempfile::tempdir().unwrap();
    let written = |records: Vec<Record>| {
        let scenes = scenes(&records, plain);
        let mut results = psnr(records);
        keep(&mut results, dir.path(), |record| {
            (record.method == "a").then(|| plain(&record.source).image)
        });
        files(&results, &scenes, &plain_options())
    };
    let mut reversed = small_run();
    reversed.reverse();
    let (first, second) = (written(small_run()), written(reversed));
    assert!(first.contains_key("plots/motion-psnr.png"));
    assert!(first == second);
    let html = String::from_utf8(first["index.html"].clone()).unwrap();
    // Two sources, two targets, and the predictions and errors of `a`; for `b`, the reasons why they are missing.
    assert_eq!(html.matches("\"data:image/jpeg;base64,").count(), 2 + 2 + 4);
    assert!(html.contains("not kept") && html.contains("failed: p2.ply: truncated"));
    for outside in ["http://", "https://", "<link", "@import", "url("] {
        let rest = html.replace("http://www.w3.org/2000/svg", "");
        assert!(!rest.contains(outside), "{outside}");
    }
    // The tiles, the table and the Markdown contain the same counts.
    let markdown = String::from_utf8(first["report.md"].clone()).unwrap();
    assert!(markdown.contains("1 dataset, 1 scene, 2 pairs, 2 methods, 1 metric, 1 failure. "));
    for tile in [
        "<dt>metric</dt><dd>1</dd>",
        "class=\"bad\"><dt>failure</dt><dd>1</dd>",
        "<small>2 pairs</small>",
    ] {
        assert!(html.contains(tile), "{tile}");
    }
}

#[test]
fn an_empty_run_still_gives_a_report() {
    let html = page(&psnr(Vec::new()), &[], &plain_options());
    assert!(html.contains("No pair to show."));
    let mut results = psnr(small_run());
    results.records.clear();
    let text = mean_tables(&results, None).unwrap().remove(0).text();
    assert!(
        text.contains("n/a") && text.contains("d has no pairs."),
        "{text}"
    );
    results.manifest.metrics.clear();
    assert!(mean_tables(&results, None).unwrap().is_empty());
}

#[test]
fn plots_exist_for_one_sample_for_none_and_for_infinity() {
    let figure = |records: &[Record]| {
        let results = psnr(records.to_vec());
        let board = Board::of(&results).unwrap();
        plots::against_metric(&board, &board.metrics[0]).unwrap()
    };
    assert_eq!(figure(&[]), None);
    assert_eq!(figure(&[record("d", "p", "m", 0.1, &[])]), None);
    let one = figure(&[record("d", "p", "m\u{7}<", 0.1, &[("psnr", 20.0)])]).unwrap();
    assert!(one.svg.contains(">\nPSNR (dB)\n</text>") && !one.svg.contains("m\u{7}<"));
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
    let empty = psnr(Vec::new());
    let board = Board::of(&empty).unwrap();
    assert_eq!(plots::histogram(&board, None).unwrap(), None);
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
    let results = results(&[MetricKey::LPIPS, MetricKey::PSNR], records);
    for (name, bytes) in files(&results, &[], &plain_options()) {
        let text = String::from_utf8_lossy(&bytes);
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
}

/// The page must not show errors at pixels that are not scored.
#[test]
fn error_pictures_show_what_is_not_scored_as_such() {
    let region = Region {
        x: 0,
        y: 24,
        width: 64,
        height: 24,
    };
    let cropped = Record {
        crop: Some(Crop { region, share: 0.5 }),
        ..record("d", "p1", "crops", 0.1, &[("psnr", 0.0)])
    };
    let records = vec![record("d", "p1", "all", 0.1, &[("psnr", 0.0)]), cropped];
    let scenes = scenes(&records, half_masked);
    let mut results = psnr(records);
    let dir = tempfile::tempdir().unwrap();
    keep(&mut results, dir.path(), |record| {
        Some(RgbImage::new(
            64,
            if record.crop.is_some() { 24 } else { 48 },
        ))
    });
    let board = Board::of(&results).unwrap();
    let pictures = ReportPictures::new(&results, &scenes);
    let gallery = Gallery::new(&board, &[], &plain_options(), &pictures);
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
fn many_pairs_have_their_pictures_beside_the_page_and_what_is_gone_is_removed() {
    let pair = |at: usize| record("d", &format!("p{at:02}"), "a", 0.1, &[("psnr", 20.0)]);
    let records: Vec<Record> = (0..25).map(pair).collect();
    let scenes = scenes(&records, plain);
    let (run, dir) = (tempfile::tempdir().unwrap(), tempfile::tempdir().unwrap());
    let write = |records: &[Record], layout: Option<Layout>| {
        let mut results = psnr(records.to_vec());
        keep(&mut results, run.path(), |record| {
            Some(plain(&record.source).image)
        });
        let options = ReportOptions {
            layout,
            ..plain_options()
        };
        let written = report(&results, &scenes, dir.path(), &options).unwrap();
        let html = std::fs::read_to_string(&written.html).unwrap();
        let thumbs = std::fs::read_dir(dir.path().join("thumbs"));
        (written, html, thumbs.map_or(0, Iterator::count))
    };
    // Each pair has source, target, prediction and error; equal pictures share one file.
    let (written, html, thumbs) = write(&records, None);
    let shown: Vec<&str> = html.split("\"thumbs/").skip(1).collect();
    let names: BTreeSet<&str> = shown.iter().map(|rest| &rest[..20]).collect();
    assert_eq!((written.layout, shown.len()), (Layout::Folder, 25 * 4));
    assert!(thumbs == names.len() && thumbs < 25 * 4);
    for (name, rest) in names.iter().zip(&shown) {
        assert!(dir.path().join("thumbs").join(name).is_file());
        assert!(rest[20..].starts_with("\",64,48]"), "{rest}");
    }
    assert!(!html.contains("base64,") && html.contains("All pairs of the run."));
    assert!(written.all.iter().all(|path| path.is_file()));
    // With one pair fewer, all fit into one file.
    let (written, html, thumbs) = write(&records[1..], None);
    assert_eq!((written.layout, thumbs), (Layout::File, 0));
    assert_eq!(html.matches("base64,").count(), 24 * 4);
    let (_, html, _) = write(&records, Some(Layout::File));
    assert!(html.contains("24 of 25 pairs"));
    assert!((1..=4).contains(&write(&records[..1], Some(Layout::Folder)).2));
}

#[test]
fn pictures_shrink_until_all_pairs_fit() {
    let pair = |at: usize| record("d", &format!("p{at:02}"), "noise", 0.1, &[("psnr", 20.0)]);
    let mut results = psnr((0..30).map(pair).collect());
    let run = tempfile::tempdir().unwrap();
    // Noise compresses worse than any other picture.
    keep(&mut results, run.path(), |record| {
        let bytes = record.pair_id.bytes();
        let mut state = bytes.fold(1_u32, |a, b| a * 31 + u32::from(b));
        Some(RgbImage::from_fn(640, 480, |_, _| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            Rgb([(state >> 24) as u8, (state >> 16) as u8, (state >> 8) as u8])
        }))
    });
    let shown = |bytes: usize, layout: Option<Layout>| {
        let pictures = Some(PictureBudget { bytes, side: 480 });
        let options = ReportOptions {
            pictures,
            layout,
            ..plain_options()
        };
        files(&results, &[], &options)
    };
    let side = |bytes: usize| {
        let files = shown(bytes, None);
        let thumbs = files.iter().filter(|(name, _)| name.ends_with(".jpg"));
        let used: usize = thumbs.clone().map(|(_, bytes)| bytes.len()).sum();
        let first = image::load_from_memory(thumbs.clone().next().unwrap().1).unwrap();
        assert_eq!(thumbs.count(), 30);
        (first.width(), used)
    };
    let (all, used) = side(100 << 20);
    assert_eq!(all, 480);
    let (fewer, fits) = side(used / 2);
    assert!(fewer < 480 && fits <= used / 2, "{fewer} {fits} of {used}");
    // A single-file page has a minimum size of pictures, so it omits pairs instead.
    let html = String::from_utf8(shown(1, Some(Layout::File))["index.html"].clone()).unwrap();
    assert!(!html.contains("data:image") && html.contains("No pair to show."));
}

#[test]
fn pictures_are_linked_but_to_the_public_which_sees_what_terms_allow() {
    let dir = tempfile::tempdir().unwrap();
    let (run, out) = (dir.path().join("run 1"), dir.path().join("out"));
    let lost = format!("{}/b.png: is gone", run.display());
    let records = vec![
        record("middlebury", "p", "a", 0.1, &[("psnr", 20.0)]),
        record("booster", "p", "a", 0.1, &[("psnr", 20.0)]),
        record("anyone's", "p", "a", 0.1, &[("psnr", 20.0)]),
        failed(record("middlebury", "p", "b", 0.1, &[]), &lost),
    ];
    let scenes = scenes(&records, |view| Photograph {
        file: view.ends_with("target").then(|| run.join("im 1.png")),
        ..half_masked(view)
    });
    let mut results = psnr(records);
    keep(&mut results, &run, |record| {
        (record.method == "a").then(|| RgbImage::new(64, 48))
    });
    let settings = &mut results.manifest.methods[0].identity.settings;
    settings.insert("dir".into(), run.display().to_string());
    let page = |public: bool| {
        let options = ReportOptions {
            public,
            ..plain_options()
        };
        let written = report(&results, &scenes, &out, &options).unwrap();
        std::fs::read_to_string(written.html).unwrap()
    };
    // Source, target, mask, prediction and error of a pair, and links to predictions and targets.
    let count = |html: &str| {
        [
            html.matches("base64,").count(),
            html.matches("../run%201/").count(),
        ]
    };
    let (all, public) = (page(false), page(true));
    assert_eq!((count(&all), count(&public)), ([15, 6], [5, 0]));
    assert!(all.contains("\"full\":\"../run%201/predictions/a/"));
    assert!(all.contains("\"full\":{\"source\":null,\"target\":\"../run%201/im%201.png\"}"));
    assert!(!all.contains("class=\"withheld\""));
    assert!(public.contains("Terms of the pictures shown: Middlebury: free to use and publish"));
    let notice = "the pictures of anyone&#39;s (terms unknown), Booster (research use; do not redistribute).";
    assert!(public.contains(notice), "{public}");
    // No folder on this machine is mentioned.
    let folder = run.display().to_string();
    assert!(
        all.contains(&folder) && !public.contains(&folder),
        "{public}"
    );
    assert!(public.contains("…/run 1/b.png: is gone") && public.contains("dir=…/run 1"));
    assert_eq!(public.matches("\"no target\"").count(), 0, "{public}");
    let withheld = "terms do not allow it to be published";
    // For each of two datasets: source, target and the depth of both; prediction, error and alpha.
    assert_eq!(public.matches(withheld).count(), 14, "{public}");
}

#[test]
fn the_qualitative_figure_has_all_datasets_and_whole_captions() {
    let scores = [("psnr", 20.0), ("ssim[gauss11,valid]", 0.5)];
    let records = ["a", "b", "c", "d", "e", "f"].map(|name| record(name, "p", "a", 0.1, &scores));
    let height = |records: &[Record], keys: &[MetricKey]| {
        let scenes = scenes(records, plain);
        let results = results(keys, records.to_vec());
        let board = Board::of(&results).unwrap();
        let pictures = ReportPictures::new(&results, &scenes);
        let png = qualitative::figure(&board, &board.metrics, &pictures).unwrap();
        image::load_from_memory(&png.unwrap()).unwrap().height()
    };
    let all: Vec<MetricKey> = MetricKey::all().into_iter().collect();
    let rows: Vec<u32> = (1..=6).map(|n| height(&records[..n], &all[..2])).collect();
    let steps: Vec<u32> = rows.windows(2).map(|two| two[1] - two[0]).collect();
    assert!(steps.iter().all(|step| *step == steps[0]), "{rows:?}");
    let mut many = records[..1].to_vec();
    let scores = all.iter().map(|key| (key.to_string(), Score::Value(0.5)));
    many[0].scores = scores.collect();
    let run = tempfile::tempdir().unwrap();
    let scenes = scenes(&many, plain);
    let mut results = results(&all, many);
    keep(&mut results, run.path(), |_| Some(RgbImage::new(64, 48)));
    let board = Board::of(&results).unwrap();
    let pictures = ReportPictures::new(&results, &scenes);
    let png = qualitative::figure(&board, &board.metrics, &pictures).unwrap();
    let whole = image::load_from_memory(&png.unwrap()).unwrap().height();
    assert!(whole > rows[0] + 100);
}
