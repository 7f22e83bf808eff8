//! How `run` and `report` treat folders that other programs changed, that a kill left incomplete,
//! or that contain hostile text.

use std::path::{Path, PathBuf};

use sharp_bench::evaluate::unit::Unit;
use sharp_bench::io::hash::file_sha256;
use sharp_tests::files_below;
use sharp_tests::mutants::bomb;

use crate::support::{Said, holds, read, sharp_bench, words};

fn run(dir: &Path, more: &[&str]) -> Said {
    let args =
        words("run --dataset S:synthetic=size=48x36,views=5 --metrics psnr --limit 6 --out r");
    sharp_bench(dir, &[&args[..], more].concat())
}

/// A folder with a finished run of `copy` in `r`.
fn finished() -> tempfile::TempDir {
    let dir = tempfile::tempdir().unwrap();
    run(dir.path(), &["--method", "copy"]).ends_with(0);
    dir
}

#[test]
fn a_report_writes_into_its_own_folder_alone() {
    let dir = finished();
    let dir = dir.path();
    let report = |out: &str| sharp_bench(dir, &["report", "r", "--out", out]);
    let foreign = [
        ("site/index.html", "<h1>mine</h1>"),
        // A list that names files for removal.
        ("list/files.txt", "index.html\nplots/thesis.png\n"),
        ("list/plots/thesis.png", "mine"),
        ("notes/thesis.tex", "mine"),
    ];
    for (name, text) in foreign {
        let path = dir.join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, text).unwrap();
    }
    for out in ["site", "list", "notes"] {
        report(out).is_error_with(&[out, "not a report of sharp-bench", "--out"]);
    }
    #[cfg(unix)]
    {
        std::os::unix::fs::symlink("site", dir.join("link")).unwrap();
        report("link").is_error_with(&["link", "not a report of sharp-bench"]);
        std::fs::create_dir_all(dir.join("half")).unwrap();
        std::os::unix::fs::symlink("../notes", dir.join("half/tables")).unwrap();
        report("half").is_error_with(&["half/tables", "link"]);
    }
    for (name, text) in foreign {
        assert_eq!(read(dir.join(name)), text, "{name}");
    }
    assert_eq!(files_below(&dir.join("notes")).unwrap().len(), 1);

    // The report's own folder: empty, unfinished, finished, and with a user's file next to its own.
    std::fs::create_dir(dir.join("own")).unwrap();
    report("own").ends_with(0);
    std::fs::write(dir.join("own/notes.txt"), "mine").unwrap();
    report("own").ends_with(0);
    std::fs::remove_file(dir.join("own/index.html")).unwrap();
    report("own").ends_with(0);
    assert!(dir.join("own/index.html").is_file());
    assert_eq!(read(dir.join("own/notes.txt")), "mine");
}

#[test]
fn score_tells_changed_pictures_from_those_that_were_not_kept() {
    let dir = finished();
    let dir = dir.path();
    let score = |metric: &str| sharp_bench(dir, &["score", "r", "--metrics", metric]);
    let kept = files_below(&dir.join("r/predictions")).unwrap();
    image::RgbImage::new(48, 36).save(&kept[0]).unwrap();
    let said = score("ssim-uniform7-sample").ends_with(4).err;
    assert!(said.contains("the kept pictures of 1 of"), "{said}");
    assert!(!said.contains("no kept picture"), "{said}");
    std::fs::remove_file(&kept[0]).unwrap();
    let said = score("ssim-uniform7-sample").ends_with(4).err;
    assert!(
        said.contains("1 of") && said.contains("no kept picture"),
        "{said}"
    );
    assert!(
        !said.contains("differ from those that were scored"),
        "{said}"
    );
}

#[test]
fn a_report_shows_the_pictures_that_were_scored() {
    let dir = finished();
    let dir = dir.path();
    let page = || read(dir.join("r/report/index.html"));
    sharp_bench(dir, &["report", "r"]).ends_with(0);
    let shown = page().matches("base64,").count();
    let kept = files_below(&dir.join("r/predictions")).unwrap();
    // Another picture of the same size replaces the scored one.
    let black = image::RgbImage::new(48, 36);
    black.save(&kept[0]).unwrap();
    let said = sharp_bench(dir, &["report", "r", "--json"]).ends_with(4);
    let name = kept[0].file_name().unwrap().to_str().unwrap();
    assert!(
        said.err.contains(name)
            && said
                .err
                .contains("differs from the picture that was scored"),
        "{}",
        said.err
    );
    assert_eq!(said.json()["not_scored"].as_array().unwrap().len(), 1);
    assert!(page().contains("not the one that was scored"));
    // The page shows neither the prediction nor its error, nor links to the file.
    assert_eq!(page().matches("base64,").count(), shown - 2);
    let stem = name.trim_end_matches(".png");
    assert!(!page().contains(&format!("{stem}.png\"")), "{stem}");

    run(dir, &["--method", "copy"]).ends_with(0);
    sharp_bench(dir, &["report", "r"]).ends_with(0);
    assert_eq!(page().matches("base64,").count(), shown);
}

#[test]
fn a_list_or_plan_that_lost_pairs_is_refused_until_the_run_writes_it_anew() {
    let dir = finished();
    let dir = dir.path();
    let list = dir.join("r/pairs.csv");
    let whole = read(&list);
    let lines: Vec<&str> = whole.split_inclusive('\n').collect();
    let refused = |part: &str| {
        for args in [&["report", "r"][..], &["merge", "r"]] {
            sharp_bench(dir, args).is_error_with(&["r: ", part, "manifest.json", "run"]);
        }
    };
    let mended = || {
        run(dir, &["--method", "copy"]).ends_with(0);
        sharp_bench(dir, &["report", "r"]).ends_with(0);
        assert_eq!(read(&list), whole);
    };
    // Truncated at the end of a line.
    std::fs::write(&list, lines[..4].concat()).unwrap();
    refused("pairs.csv has 3 of the");
    mended();
    // Changed by one digit of a baseline.
    let baseline = lines[1].split(',').nth(10).unwrap();
    let moved = lines[1].replace(&format!(",{baseline},"), &format!(",1{baseline},"));
    std::fs::write(&list, whole.replace(lines[1], &moved)).unwrap();
    refused("in pairs.csv differ from those of the run");
    mended();
    let plan = read(dir.join("r/plan.json"));
    let mut cut: serde_json::Value = serde_json::from_str(&plan).unwrap();
    cut["blocks"][0]["pairs"]
        .as_array_mut()
        .unwrap()
        .truncate(3);
    std::fs::write(dir.join("r/plan.json"), cut.to_string()).unwrap();
    refused("plan.json has 3 of the 6 pairs");
    mended();
    std::fs::remove_file(dir.join("r/plan.json")).unwrap();
    refused("plan.json has 0 of the 6 pairs");
    mended();
}

#[test]
fn a_unit_that_leads_out_of_the_folder_or_is_not_its_own_counts_for_nothing() {
    let dir = finished();
    let dir = dir.path();
    let report = |code: i32| {
        let said = sharp_bench(dir, &["report", "r"]).ends_with(code);
        (read(dir.join("r/report/tables/scores.csv")), said.err)
    };
    let (table, _) = report(0);
    image::RgbImage::new(48, 36)
        .save(dir.join("secret.png"))
        .unwrap();
    // Hostile units are planted in the first subfolder, so take a genuine one from the last.
    let unit = files_below(&dir.join("r/units")).unwrap().pop().unwrap();
    let honest: Unit = serde_json::from_str(&read(&unit)).unwrap();
    let plant = |unit: &Unit, name: &str| {
        let path = dir.join("r/units/00").join(format!("{name}.json"));
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(&path, serde_json::to_string(unit).unwrap()).unwrap();
        // The report detects the hostile unit by its name, its checksum or its pair, and says that it is damaged.
        let (shown, said) = report(4);
        assert_eq!(shown, table, "{}", unit.slot.pair_id);
        assert!(said.contains(name) && said.contains("damaged"), "{said}");
        std::fs::remove_file(path).unwrap();
    };
    for id in [
        "S/../../../secret",
        "../../../secret",
        "S/x/../../../../secret__y",
    ] {
        let mut hostile = honest.clone();
        id.clone_into(&mut hostile.slot.pair_id);
        id.clone_into(&mut hostile.record.pair_id);
        hostile.picture.as_mut().unwrap().file_sha256 =
            Some(file_sha256(&dir.join("secret.png")).unwrap());
        let hostile = hostile.sealed();
        plant(&hostile, &hostile.slot.file_stem());
    }
    // A record whose pair differs from its slot's, and a copy under another name.
    let mut other = honest.clone();
    other.record.source = "elsewhere".to_owned();
    let other = other.sealed();
    plant(&other, &other.slot.file_stem());
    plant(&honest, &"0".repeat(64));
}

#[cfg(unix)]
#[test]
fn what_a_killed_run_left_goes_at_the_next_start() {
    use std::process::{Command, Stdio};
    let dir = finished();
    let dir = dir.path();
    let root = dir.join("r");
    for name in [
        "units/ab/.partial-Xx1",
        "predictions/copy/S/.partial-Xx2",
        ".partial-Xx3",
        "notes/.partial-Xx4",
    ] {
        let path = root.join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, "half").unwrap();
    }
    std::fs::create_dir(dir.join("tmp")).unwrap();
    std::fs::write(dir.join("slow.sh"), "read line; touch asked; sleep 1000").unwrap();
    let mut killed = Command::new(env!("CARGO_BIN_EXE_sharp-bench"))
        .args("run --dataset S:synthetic=size=48x36,views=5 --metrics psnr".split(' '))
        .args(["--out", "r", "--method", "command:run='sh slow.sh'"])
        .env("TMPDIR", dir.join("tmp"))
        .current_dir(dir)
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let begin = std::time::Instant::now();
    while !dir.join("asked").exists() {
        assert!(begin.elapsed().as_secs() < 60, "the program was not asked");
        std::thread::sleep(std::time::Duration::from_millis(10));
    }
    killed.kill().unwrap();
    killed.wait().unwrap();
    let left = || {
        let entries = std::fs::read_dir(&root).unwrap().flatten();
        let names = entries.map(|entry| entry.file_name().into_string().unwrap());
        names.filter(|name| name.starts_with(".scratch-")).count()
    };
    // The scratch folder of the killed run is in the run's folder, where the next run finds it, and nowhere else.
    assert_eq!(
        (left(), std::fs::read_dir(dir.join("tmp")).unwrap().count()),
        (1, 0)
    );
    run(dir, &["--method", "copy"]).ends_with(0);
    assert_eq!(left(), 0);
    let half: Vec<PathBuf> = files_below(&root)
        .unwrap()
        .into_iter()
        .filter(|path| path.display().to_string().contains(".partial-"))
        .collect();
    assert_eq!(half, [root.join("notes/.partial-Xx4")]);
}

#[cfg(unix)]
#[test]
fn what_a_program_says_too_much_of_is_cut() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let script = r#"
echo first >&2
while IFS= read -r line; do
  id=$(printf '%s' "$line" | sed 's/.*"pair_id":"\([^"]*\)","source_picture".*/\1/')
  head -c 20000000 /dev/zero | tr '\0' '\n' >&2
  printf '{"pair_id":"%s","error":"begin ' "$id"; head -c 900000 /dev/zero | tr '\0' e; echo ' end"}'
done
echo last >&2
"#;
    std::fs::write(dir.join("my.sh"), script).unwrap();
    run(dir, &["--method", "command:label=mine,run='sh my.sh'"]).ends_with(4);
    let log = read(dir.join("r/logs/mine.log"));
    assert!(log.len() < 9 << 20, "{}", log.len());
    assert!(log.starts_with("== started: sh my.sh\nfirst\n") && log.ends_with("last\n"));
    assert!(log.contains("bytes left out here"));
    let scores = read(dir.join("r/scores.csv"));
    let first = scores.lines().nth(1).unwrap();
    holds(first, &["begin eee", "eee end", "characters left out"]);
    assert!(first.len() < 2000, "{}", first.len());
    sharp_bench(dir, &["report", "r"]).ends_with(0);
    let page = dir.join("r/report/index.html").metadata().unwrap().len();
    assert!(page < 1 << 20, "{page}");
}

#[test]
fn a_bomb_is_refused_before_it_is_decoded() {
    let dir = finished();
    let dir = dir.path();
    let path = "r/predictions/copy/S/seed0";
    let kept = files_below(&dir.join(path)).unwrap()[0].clone();
    std::fs::write(dir.join("bomb.png"), bomb()).unwrap();
    let kept = kept.display().to_string();
    for files in [["bomb.png", &kept], [&kept, "bomb.png"]] {
        let args = [&["metrics"], &files[..], &["--metrics", "psnr"]].concat();
        sharp_bench(dir, &args).is_error_with(&["bomb.png", "20000x20000", "exceeds the maximum"]);
    }
}

#[cfg(unix)]
#[test]
fn names_are_shown_and_not_obeyed() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let source = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/fuzz/datasets/middlebury/A");
    let hostile = [
        "=cmd|' /C calc'!A0",
        "-1+1",
        "\u{1b}[2J\u{9b}31m",
        "\u{202e}gnp.elif",
    ];
    for name in hostile {
        let scene = dir.join("data").join(name);
        std::fs::create_dir_all(&scene).unwrap();
        for file in ["calib.txt", "disp0.pfm", "im0.png", "im1.png"] {
            std::fs::copy(source.join(file), scene.join(file)).unwrap();
        }
    }
    let args = words("run --dataset D:middlebury=data --metrics psnr --method copy");
    let with = |more: &[&str]| sharp_bench(dir, &[&args[..], more].concat());
    let is_obeyed = |c: char| {
        (c.is_control() && c != '\n' && c != '\t') || matches!(c, '\u{202a}'..='\u{202e}')
    };
    let mut said = with(&["--out", "r"]).ends_with(0);
    for file in ["scores.csv", "pairs.csv", "report/tables/scores.csv"] {
        if file.starts_with("report") {
            said = sharp_bench(dir, &["report", "r"]).ends_with(0);
        }
        let mut rows = csv::Reader::from_path(dir.join("r").join(file)).unwrap();
        for cell in rows.records().flat_map(|row| {
            let row = row.unwrap();
            row.iter().map(str::to_owned).collect::<Vec<_>>()
        }) {
            let is_formula = cell.starts_with(['=', '+', '-', '@']);
            assert!(!is_formula || cell.parse::<f64>().is_ok(), "{file}: {cell}");
        }
        assert!(!said.out.contains(is_obeyed) && !said.err.contains(is_obeyed));
    }
    assert!(read(dir.join("r/scores.csv")).contains(",'=cmd|' /C calc'!A0,"));
    for file in ["index.html", "report.md"] {
        let text = read(dir.join("r/report").join(file));
        assert!(!text.contains(is_obeyed), "{file}");
        assert_eq!(
            text.contains("\\u202egnp.elif"),
            file == "index.html",
            "{file}"
        );
    }
    // The pair list of a run with hostile names, read again, refers to the same scenes.
    with(&["--pairs", "r/pairs.csv", "--out", "s"]).ends_with(0);
    assert_eq!(
        read(dir.join("r/scores.csv")),
        read(dir.join("s/scores.csv"))
    );

    // Errors show a file's name unchanged, with its control characters escaped.
    std::fs::write(dir.join("data").join(hostile[2]).join("calib.txt"), "cam0=").unwrap();
    let said = with(&["--out", "t"]);
    assert!(
        said.code != 0 && !said.err.contains(is_obeyed),
        "{}",
        said.err
    );
    assert!(said.err.contains("\\u001b[2J"), "{}", said.err);
}
