//! Results that belong to other files, interrupted folders, and published numbers.

use std::fs;
use std::path::Path;

use super::{Case, empty, untried};

/// Three stereo scenes whose photographs each have a single colour.
fn stereo(root: &Path, level: u8) {
    for scene in ["s0", "s1", "s2"] {
        let folder = root.join(scene);
        fs::create_dir_all(&folder).unwrap();
        for (name, step) in [("left", 0), ("right", 40)] {
            let picture = image::RgbImage::from_fn(64, 48, |x, y| {
                image::Rgb([
                    level.wrapping_add(step),
                    (x * 3) as u8,
                    (y * 5) as u8 ^ level,
                ])
            });
            picture.save(folder.join(format!("{name}.png"))).unwrap();
        }
        let rig = "fx=60\ncx_left=32\ncx_right=32\ncy=24\nbaseline_m=0.1\n";
        fs::write(folder.join("rig.txt"), rig).unwrap();
    }
}

/// A run of `copy` whose dataset was then replaced by another one with the same names.
fn replaced() -> Case {
    let case = empty();
    stereo(&case.path("D"), 10);
    stereo(&case.path("N"), 90);
    case.run("sharp-bench run -q --dataset stereo=D --method copy --metrics psnr --out r")
        .ends_with(0);
    case.run("cp -r N/. D/").ends_with(0);
    case
}

#[test]
fn another_method_on_replaced_photographs_is_refused_beside_the_old_one() {
    let case = replaced();
    let mean = "sharp-bench run -q --dataset stereo=D --method mean --metrics psnr --out r";
    let before = fs::read(case.path("r/scores.csv")).unwrap();
    for part in ["", " --limit 1", " --scenes s1"] {
        let said = case.run(&format!("{mean}{part}"));
        said.is_error_with(&["'copy'", "photograph", "'left'", "in this command, too"]);
    }
    assert_eq!(fs::read(case.path("r/scores.csv")).unwrap(), before);
    case.run(&format!("{mean} --method copy")).ends_with(0);
    case.run("sharp-bench run -q --dataset stereo=N --method copy --metrics psnr --out new")
        .ends_with(0);
    let fresh = case.scores("new", "psnr");
    let of_copy: Vec<String> = case.scores("r", "psnr").into_iter().step_by(2).collect();
    assert_eq!(of_copy, fresh);
    // Repeat part of the run: the scenes left out still have the old files.
    case.run("cp -r N/. D/; cp D/s0/left.png D/s1/left.png")
        .ends_with(0);
    let said = case.run("sharp-bench run -q --dataset stereo=D --method copy --method mean --metrics psnr --out r --scenes s1");
    said.ends_with(0);
}

#[test]
fn old_predictions_are_not_scored_against_new_photographs() {
    let case = replaced();
    case.run("cp -r r r2").ends_with(0);
    for (run, metrics) in [("r", "psnr,ssim"), ("r2", "ssim")] {
        let said = case.run(&format!("sharp-bench score {run} --metrics {metrics}"));
        said.is_error_with(&["'copy'", "photograph", "`run` with the same options"]);
    }
    let line = "sharp-bench run -q --dataset stereo=D --method mean --metrics psnr --common-region --out r";
    case.run(line).is_error_with(&["'copy'", "photograph"]);
}

#[test]
fn cameras_and_photographs_of_two_folders_have_to_be_the_same() {
    let case = replaced();
    case.run(
        "sharp-bench run -q --dataset stereo=N --method copy --method mean --metrics psnr --out b",
    )
    .ends_with(0);
    for line in [
        "sharp-bench merge r b --out m",
        "sharp-bench report r b --out rep",
        "sharp-bench compare r b",
        "sharp-bench gate --baseline r --candidate b --fail-if 'psnr < -0.1'",
    ] {
        let said = case.run(line);
        assert_eq!(said.code, 1, "{line}: {}{}", said.out, said.err);
        assert!(said.err.contains("stereo/s0/left"), "{line}: {}", said.err);
    }
    // Comparing bundles detects the replaced photographs, too.
    case.run("sharp-bench bundle r --out r.zip && sharp-bench bundle b --out b.zip")
        .ends_with(0);
    let said = case.run("sharp-bench compare r.zip b.zip");
    assert!(
        said.code == 1 && said.err.contains("stereo/s0/left"),
        "{}",
        said.err
    );
    case.run("sed -i s/fx=60/fx=61/ N/s2/rig.txt").ends_with(0);
    case.run("sharp-bench run -q --dataset stereo=N --method copy --metrics psnr --out c")
        .ends_with(0);
    case.run("sharp-bench compare b c --method copy=copy")
        .is_error_with(&["stereo/s2/left"]);
}

#[test]
fn what_a_manifest_says_of_a_metric_has_to_be_so() {
    let case = replaced();
    case.run("sharp-bench bundle r --out r.zip").ends_with(0);
    for (from, to) in [
        ("\"direction\": \"higher\"", "\"direction\": \"lower\""),
        ("\"unit\": \"dB\"", "\"unit\": \"<img src=x>\""),
        ("\"decimals\": 2", "\"decimals\": 9999999999"),
        ("\"label\": \"PSNR\"", "\"label\": \"DISTS\""),
    ] {
        let manifest = fs::read_to_string(case.path("r/manifest.json")).unwrap();
        assert!(manifest.contains(from), "{from}");
        case.run("rm -rf f; cp -r r f").ends_with(0);
        fs::write(case.path("f/manifest.json"), manifest.replace(from, to)).unwrap();
        for line in [
            "sharp-bench report f",
            "sharp-bench bundle f --out f.zip",
            "sharp-bench gate --baseline f --candidate r.zip --fail-if 'psnr < -0.1'",
        ] {
            case.run(line)
                .is_error_with(&["manifest.json was changed", "psnr"]);
        }
    }
    // A bundle whose manifest was changed is refused, because the bundle's digest covers the manifest.
    let bytes = fs::read(case.path("r.zip")).unwrap();
    let mut archive = zip::ZipArchive::new(std::io::Cursor::new(bytes)).unwrap();
    let mut changed = zip::ZipWriter::new(std::io::Cursor::new(Vec::new()));
    for at in 0..archive.len() {
        let mut member = archive.by_index(at).unwrap();
        let name = member.name().unwrap().into_owned();
        let mut text = Vec::new();
        std::io::Read::read_to_end(&mut member, &mut text).unwrap();
        if name == "manifest.json" {
            let manifest = String::from_utf8(text).unwrap();
            let other = manifest.replace("\"copy\"", "\"mine\"");
            assert_ne!(manifest, other);
            text = other.into_bytes();
        }
        changed
            .start_file(name, zip::write::SimpleFileOptions::default())
            .unwrap();
        std::io::Write::write_all(&mut changed, &text).unwrap();
    }
    fs::write(
        case.path("changed.zip"),
        changed.finish().unwrap().into_inner(),
    )
    .unwrap();
    case.run("sharp-bench report changed.zip --out rep")
        .is_error_with(&["changed.zip", "differ from what was packed"]);
}

#[test]
fn a_folder_that_was_begun_is_ours_and_one_of_others_is_not() {
    let case = empty();
    let run = "sharp-bench run -q --no-cache --dataset synthetic=views=2,size=64x48 --method copy --metrics psnr --out r";
    case.run(run).ends_with(0);
    let scores = fs::read(case.path("r/scores.csv")).unwrap();
    // The state after a kill while the first files were written.
    for left in ["pairs.csv", "pairs.csv plan.json"] {
        case.run(&format!(
            "mkdir k; cd r; cp .lock {left} ../k; cd ..; touch k/.partial-abc; rm -rf r; mv k r"
        ))
        .ends_with(0);
        case.run(run).ends_with(0);
        assert_eq!(fs::read(case.path("r/scores.csv")).unwrap(), scores);
        assert!(!case.path("r/.partial-abc").exists());
    }
    case.run("mkdir mine; touch mine/pairs.csv").ends_with(0);
    case.run(&run.replace("--out r", "--out mine"))
        .is_error_with(&["mine", "it holds other files"]);
    // A folder that was left while pictures were copied, before the first unit was finished, can be merged into again.
    case.run("mkdir m; cp r/.lock m; cp -r r/predictions m")
        .ends_with(0);
    case.run("sharp-bench merge r --out m").ends_with(0);
}

#[test]
fn what_a_kill_left_beside_a_report_a_bundle_and_an_export_goes() {
    let case = empty();
    let data = "synthetic=views=2,size=64x48";
    case.run(&format!(
        "sharp-bench run -q --dataset {data} --method copy --metrics psnr --out a"
    ))
    .ends_with(0);
    for (folder, line) in [
        ("a/report", "sharp-bench report -q a".to_owned()),
        (".", "sharp-bench bundle a --out b.zip".to_owned()),
        (
            "e/synthetic/seed0",
            format!("sharp-bench cameras export --dataset {data} --out e"),
        ),
        (
            "h",
            "sharp-bench history add h a --label x --date 2026-01-01".to_owned(),
        ),
    ] {
        fs::create_dir_all(case.path(folder)).unwrap();
        let left = case.path(folder).join(".partial-left");
        fs::write(&left, "x").unwrap();
        case.run(&line).ends_with(0);
        assert!(!left.exists(), "{line}");
    }
}

#[test]
fn numbers_of_other_code_are_named() {
    let case = untried("A18-20-metrics-find");
    for (number, name, metrics) in [
        ("0.1438", "piq.DISTS", "dists"),
        ("0.8965", "piq.ssim", "ssim"),
        ("0.1329", "LPIPS v0.0 alex", "lpips-alex"),
        ("0.0750", "LPIPS v0.0 vgg", "lpips-vgg"),
        ("0.9482", "MS-SSIM of torchmetrics", "ssim"),
        ("26.3893", "PSNR of luma in 16..235", "psnr"),
        ("0.8503", "SSIM with data_range=2, 7x7 box", "ssim-all"),
    ] {
        let line = format!(
            "sharp-bench metrics pred.png target.png --metrics {metrics} --find {number} --json"
        );
        let found = case.run(&line).ends_with(0).json()["found"].clone();
        let found = found.as_array().unwrap();
        assert!(
            found.iter().any(|other| other == name),
            "{number}: {found:?}"
        );
        assert!(found.len() < 3, "{number}: {found:?}");
    }
    let said = case.run(
        "sharp-bench metrics pred.png target.png --metrics psnr,ssim,lpips-alex --find 0.3333",
    );
    let nearest = said.out.lines().filter(|line| line.contains("nearest"));
    assert_eq!(nearest.count(), 3, "{}", said.out);
    let mask = image::GrayImage::from_fn(390, 390, |x, _| {
        image::Luma([if x < 200 { 255 } else { 0 }])
    });
    mask.save(case.path("mask.png")).unwrap();
    let said = case.run(
        "sharp-bench metrics pred.png target.png --mask mask.png --metrics psnr --find 99 --json",
    );
    assert_eq!(said.ends_with(0).json()["found"], serde_json::json!([]));
}

#[cfg(unix)]
#[test]
fn weights_that_a_command_line_names_are_hashed_however_they_are_written() {
    let case = empty();
    stereo(&case.path("D"), 10);
    for (name, level) in [("dark", 20), ("light", 200)] {
        let picture = image::RgbImage::from_pixel(64, 48, image::Rgb([level; 3]));
        picture.save(case.path(&format!("{name}.png"))).unwrap();
    }
    let program = "\
while read -r line; do
  to=$(echo \"$line\" | sed 's/.*\"write_to\": *\"\\([^\"]*\\)\".*/\\1/')
  id=$(echo \"$line\" | sed 's/.*\"pair_id\": *\"\\([^\"]*\\)\".*/\\1/')
  cp \"$TOP/$(cat \"${1#*=}\").png\" \"$to\"
  echo \"{\\\"pair_id\\\":\\\"$id\\\"}\"
done
";
    fs::write(case.path("my.sh"), program).unwrap();
    case.run("mkdir 'a b' sub; cp my.sh 'a b'; cp my.sh sub")
        .ends_with(0);
    for line in [
        "sh my.sh w.txt",
        "sh my.sh --weights=w.txt",
        "cd sub && sh my.sh ../w.txt",
        "sh my.sh $TOP/w.txt",
        "sh my.sh \"a b/w.txt\"",
    ] {
        let psnr = |weights: &str| {
            fs::write(case.path("w.txt"), weights).unwrap();
            fs::write(case.path("a b/w.txt"), weights).unwrap();
            case.run(&format!(
                "TOP=$PWD; export TOP; sharp-bench run -q --dataset stereo=D --method \"command:label=m,run='{}'\" \
                 --metrics psnr --out r",
                line.replace('"', "\\\"").replace('$', "\\$")
            ))
            .ends_with(0);
            case.scores("r", "psnr")
        };
        let (dark, light) = (psnr("dark"), psnr("light"));
        assert_ne!(dark, light, "{line}");
        assert_eq!(psnr("dark"), dark, "{line}");
        case.run("rm -r r").ends_with(0);
    }
    // All scores of a table row must be from the same weights, within a folder and between folders.
    let run = |weights: &str, rest: &str| {
        fs::write(case.path("w.txt"), weights).unwrap();
        case.run(&format!(
            "TOP=$PWD; export TOP; sharp-bench run -q --dataset stereo=D --method \"command:label=m,run='sh my.sh w.txt'\" \
             --metrics psnr {rest}"
        ))
    };
    run("dark", "--out r").ends_with(0);
    let said = run("light", "--limit 1 --out r");
    assert!(said.err.contains("method 'm' was command("), "{}", said.err);
    assert_eq!(case.scores("r", "psnr").len(), 1);
    case.run("rm -r r").ends_with(0);
    run("dark", "--out a --scenes s0").ends_with(0);
    run("light", "--out b --scenes s1").ends_with(0);
    case.run("sharp-bench merge a b --out m")
        .is_error_with(&["method 'm'", "content="]);
    let said = case.run(
        "TOP=$PWD; export TOP; sharp-bench run -q --dataset stereo=D --method \"command:label=m,run='sh my.sh w.txt \
         --extra=gone.pt'\" --metrics psnr --out r",
    );
    case.having(vec![said]).is_said_everywhere(
        "r",
        "names gone.pt, which looks like a file but does not exist",
    );
}

#[test]
fn pictures_made_again_are_not_averaged_with_those_before() {
    let case = empty();
    stereo(&case.path("D"), 10);
    let make = |level: u8| {
        for scene in ["s0", "s1", "s2"] {
            let folder = case.path("p").join("stereo").join(scene);
            fs::create_dir_all(&folder).unwrap();
            let picture = image::RgbImage::from_pixel(64, 48, image::Rgb([level; 3]));
            picture.save(folder.join("left__right.png")).unwrap();
        }
    };
    let run = |rest: &str| {
        case.run(&format!(
            "sharp-bench run -q --dataset stereo=D --method imported:dir=p --metrics psnr --out r {rest}"
        ))
    };
    make(20);
    run("").ends_with(0);
    let before = case.scores("r", "psnr");
    make(200);
    let said = run("--limit 1");
    said.is_error_with(&[
        "'imported'",
        "an input file of the method has changed",
        "choose another folder",
    ]);
    assert_eq!(case.scores("r", "psnr"), before);
    run("").ends_with(0);
    assert_ne!(case.scores("r", "psnr"), before);
    // Unchanged pictures are accepted, and so is another folder with the same pictures.
    run("--limit 1").ends_with(0);
    case.run("mv p q; ln -s q p").ends_with(0);
    run("--scenes s2").ends_with(0);
}

#[test]
fn gaussians_of_one_source_are_one_file() {
    let case = super::case("00-good");
    case.run("sharp-bench pairs -q --dataset synthetic=size=64x48,views=8 --out all.csv")
        .ends_with(0);
    let file = "g/synthetic/seed0/view_00.ply";
    let run = |target: &str, out: &str| {
        case.run(&format!(
            "grep -e pair_id -e view_00__view_0{target} all.csv > {target}.csv; sharp-bench run -q --dataset \
             synthetic=size=64x48,views=8 --pairs {target}.csv --method gaussians:dir=g,color_space=srgb --metrics psnr \
             --out {out}"
        ))
    };
    run("1", "a").ends_with(0);
    run("2", "same").ends_with(0);
    case.run("sharp-bench merge a same --out m").ends_with(0);
    // A changed header is enough to make it another file.
    case.run(&format!(
        "sed -i '2a comment made again' {file}; head -c 60 {file} | head -4"
    ))
    .ends_with(0);
    run("2", "b").ends_with(0);
    case.run("sharp-bench merge a b --out m2").is_error_with(&[
        "'gaussians'",
        "view_00",
        "another version of the file",
    ]);
    run("2", "a").is_error_with(&["an input file of the method has changed"]);
}
