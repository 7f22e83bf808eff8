//! Methods of others: programs, pictures that are smaller or cropped or of several scales.

use std::collections::BTreeMap;
use std::path::Path;

use image::imageops;
use image::{Rgb, RgbImage};

use crate::support::{Said, read, sharp_bench};

const DATASET: &str = "S:synthetic=size=96x72,views=12";

fn run(dir: &Path, out: &str, more: &[&str]) -> Said {
    let args = [
        "run",
        "--dataset",
        DATASET,
        "--metrics",
        "psnr",
        "--out",
        out,
    ];
    sharp_bench(dir, &[&args[..], more].concat())
}

/// Rows of scores.csv by method, then by pair, each by column.
type Scores = BTreeMap<String, Vec<BTreeMap<String, String>>>;

fn scores(dir: &Path, run: &str) -> Scores {
    let mut reader = csv::Reader::from_path(dir.join(run).join("scores.csv")).unwrap();
    let header = reader.headers().unwrap().clone();
    let mut scores = Scores::new();
    for row in reader.records() {
        let row = row.unwrap();
        let row: BTreeMap<String, String> = header
            .iter()
            .zip(&row)
            .map(|(k, v)| (k.to_owned(), v.to_owned()))
            .collect();
        scores.entry(row["method"].clone()).or_default().push(row);
    }
    scores
}

/// Predictions that are the targets themselves, to be spoiled: `DIR/truth/predictions/target`.
fn truth(dir: &Path, limit: &str) -> Vec<String> {
    run(dir, "truth", &["--method", "target", "--limit", limit]).ends_with(0);
    let rows = scores(dir, "truth");
    rows["target"]
        .iter()
        .map(|r| r["pair_id"].clone())
        .collect()
}

fn picture(dir: &Path, id: &str) -> RgbImage {
    let path = dir.join(format!("truth/predictions/target/{id}.png"));
    image::open(path).unwrap().to_rgb8()
}

fn save(dir: &Path, folder: &str, id: &str, image: &RgbImage) {
    let path = dir.join(folder).join(format!("{id}.png"));
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    image.save(path).unwrap();
}

/// A program in shell: the n-th pair that it is ever asked for decides what it does; it hands back the source.
#[cfg(unix)]
const PROGRAM: &str = r#"
echo "hello from $$" >&2
while IFS= read -r line; do
  field() { printf '%s' "$line" | sed "s/.*\"$1\":\"\([^\"]*\)\",\"$2\".*/\1/"; }
  id=$(field pair_id source_picture); source=$(field source_picture write_to); to=$(field write_to pair)
  n=$(($(cat count 2>/dev/null || echo 0) + 1)); echo $n > count
  case $n in
    2) echo "out of memory" >&2; exit 3 ;;
    3) echo "Loading checkpoint shards" ; continue ;;
    4) cp small.png "$to" ;;
    5) sleep 1000 ;;
    6) echo "{\"pair_id\":\"$id\",\"error\":\"no face found\"}"; continue ;;
    7) echo "{\"pair_id\":\"$id\"}"; continue ;;
    *) cp "$source" "$to" ;;
  esac
  echo "{\"pair_id\":\"$id\",\"extras\":{\"steps\":$n}}"
done
echo "input ended" >&2
"#;

#[cfg(unix)]
#[test]
fn a_program_is_asked_pair_by_pair_and_each_failure_is_its_own() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    std::fs::write(dir.join("my.sh"), PROGRAM).unwrap();
    RgbImage::new(5, 5).save(dir.join("small.png")).unwrap();
    let method = [
        "--method",
        "command:label=mine,run='sh my.sh',timeout=8",
        "--method",
        "copy",
        "--limit",
        "9",
    ];
    let said = run(dir, "r", &method).ends_with(4);
    assert!(said.err.contains("6 of 18 units failed"), "{}", said.err);
    let found = scores(dir, "r");
    let (mine, copy) = (&found["mine"], &found["copy"]);
    for (n, part) in [
        (2, "exit status: 3"),
        (2, "out of memory"),
        (3, "Loading checkpoint"),
        (4, "5x5"),
        (5, "no answer within 8 s"),
        (6, "no face found"),
        (7, "prediction.png"),
    ] {
        let row = &mine[n - 1];
        assert_eq!(row["status"], "failed", "{n}");
        assert!(row["reason"].contains(part), "{n}: {}", row["reason"]);
    }
    for n in [1, 8, 9] {
        assert_eq!(
            mine[n - 1]["status"],
            "ok",
            "{n}: {}",
            mine[n - 1]["reason"]
        );
        assert_eq!(mine[n - 1]["psnr"], copy[n - 1]["psnr"]);
        assert_eq!(mine[n - 1]["steps"], n.to_string());
    }
    // Started at first, then after the crash, the noise and the silence.
    let log = read(dir.join("r/logs/mine.log"));
    let count = |text: &str| log.lines().filter(|l| l.contains(text)).count();
    assert_eq!(count("== started: sh my.sh"), 4, "{log}");
    assert_eq!(count("hello from"), 4, "{log}");
    assert_eq!(count("input ended"), 1, "{log}");

    // Only what failed is asked again; a changed script is another method.
    let json = run(dir, "r", &[&method[..], &["--json"]].concat())
        .ends_with(0)
        .json();
    assert_eq!((&json["reused"], &json["failed"]), (&12.into(), &0.into()));
    std::fs::write(dir.join("my.sh"), format!("{PROGRAM}#\n")).unwrap();
    let json = run(dir, "r", &[&method[..], &["--json"]].concat())
        .ends_with(0)
        .json();
    assert_eq!(json["reused"], 9);
    let identity = json["manifest"]["methods"][0]["identity"].as_str().unwrap();
    assert_eq!(identity, "command(run=sh my.sh,version=)");
}

#[cfg(unix)]
#[test]
fn a_program_may_serve_one_pair_only() {
    let dir = tempfile::tempdir().unwrap();
    let script = PROGRAM.replace(
        "while IFS= read -r line; do",
        "IFS= read -r line; for x in 1; do",
    );
    std::fs::write(dir.path().join("one.sh"), script).unwrap();
    std::fs::write(dir.path().join("count"), "10").unwrap();
    let method = ["--method", "command:run='sh one.sh'", "--limit", "3"];
    run(dir.path(), "r", &method).ends_with(0);
    let log = read(dir.path().join("r/logs/command.log"));
    assert_eq!(log.matches("== started").count(), 3, "{log}");
}

#[test]
fn programs_that_are_not_there_fail_pair_by_pair() {
    let dir = tempfile::tempdir().unwrap();
    let method = [
        "--method",
        "command:run=no-such-program-here",
        "--limit",
        "2",
    ];
    run(dir.path(), "r", &method).ends_with(4);
    for row in &scores(dir.path(), "r")["command"] {
        assert!(
            row["reason"].contains("no-such-program-here"),
            "{}",
            row["reason"]
        );
    }
    for (method, part) in [
        ("command", "run="),
        ("command:run=x,timeout=never", "timeout=never"),
        ("command:run=x,speed=2", "speed"),
    ] {
        run(dir.path(), "s", &["--method", method]).is_error_with(&[part]);
    }
}

#[cfg(target_os = "linux")]
#[test]
fn a_program_dies_with_the_run() {
    use std::process::{Command, Stdio};
    use std::time::{Duration, Instant};
    let dir = tempfile::tempdir().unwrap();
    std::fs::write(
        dir.path().join("my.sh"),
        "echo $$ > pid.new; mv pid.new pid; exec sleep 1000",
    )
    .unwrap();
    let mut run = Command::new(env!("CARGO_BIN_EXE_sharp-bench"))
        .args([
            "run",
            "--dataset",
            DATASET,
            "--metrics",
            "psnr",
            "--out",
            "r",
        ])
        .args(["--method", "command:run='exec sh my.sh'"])
        .current_dir(dir.path())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let wait = |what: &str, done: &dyn Fn() -> bool| {
        let start = Instant::now();
        while !done() {
            assert!(start.elapsed() < Duration::from_secs(60), "{what}");
            std::thread::sleep(Duration::from_millis(20));
        }
    };
    wait("the program did not start", &|| {
        dir.path().join("pid").exists()
    });
    let pid = read(dir.path().join("pid"));
    let process = format!("/proc/{}/comm", pid.trim());
    assert!(Path::new(&process).exists());
    // SIGKILL: nothing of the run is left to end its program.
    run.kill().unwrap();
    run.wait().unwrap();
    wait("the program outlived the run", &|| {
        std::fs::read_to_string(&process).map_or(true, |name| name.trim() != "sleep")
    });
}

/// The README's Python program, with a model that copies.
#[cfg(unix)]
#[test]
#[ignore = "needs python3"]
fn the_python_program_of_the_readme_is_a_method() {
    let dir = tempfile::tempdir().unwrap();
    let model = r#"
import shutil

class Copy:
    def __init__(self, path):
        self.path = path

    def save(self, path):
        shutil.copy(self.path, path)

def predict(path, pair):
    assert len(pair["K_s"]) == 9 and len(pair["target_from_source"]) == 16
    return Copy(path)
"#;
    let readme = read(Path::new(env!("CARGO_MANIFEST_DIR")).join("../README.md"));
    let program = readme.split("```python").nth(1).unwrap();
    let program = program.split("```").next().unwrap();
    std::fs::write(dir.path().join("my.py"), format!("{model}{program}")).unwrap();
    let methods = [
        "--method",
        "command:label=mine,run='python3 my.py'",
        "--method",
        "copy",
        "--limit",
        "5",
    ];
    run(dir.path(), "r", &methods).ends_with(0);
    let found = scores(dir.path(), "r");
    assert_eq!(found["mine"].len(), 5);
    for (mine, copy) in found["mine"].iter().zip(&found["copy"]) {
        assert_eq!(mine["psnr"], copy["psnr"]);
        assert_eq!(mine["steps"], "50");
    }
}

#[test]
fn smaller_pictures_are_resized_up_by_a_named_kernel_only() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let ids = truth(dir, "3");
    for id in &ids {
        let small = imageops::thumbnail(&picture(dir, id), 48, 36);
        save(dir, "small", id, &small);
        save(dir, "square", id, &imageops::thumbnail(&small, 30, 30));
        save(dir, "large", id, &imageops::thumbnail(&small, 192, 144));
    }
    let methods = [
        "--limit",
        "3",
        "--method",
        "imported:label=cubic,dir=small,resize=bicubic",
        "--method",
        "imported:label=linear,dir=small,resize=bilinear",
        "--method",
        "imported:dir=small",
        "--method",
        "imported:label=square,dir=square,resize=bicubic",
        "--method",
        "imported:label=large,dir=large,resize=area",
    ];
    let said = run(dir, "r", &methods).ends_with(4);
    assert!(
        said.out.contains("resized up (`bicubic`) before scoring"),
        "{}",
        said.out
    );
    let found = scores(dir, "r");
    for (cubic, linear) in found["cubic"].iter().zip(&found["linear"]) {
        assert_eq!(cubic["predicted_width"], "48");
        assert_ne!(cubic["psnr"], linear["psnr"]);
    }
    for (method, part) in [
        ("imported", "48x36, the target 96x72: name the kernel"),
        ("square", "another aspect"),
        ("large", "never reduced"),
    ] {
        let reason = &found[method][0]["reason"];
        assert!(reason.contains(part), "{reason}");
    }
    let manifest: serde_json::Value =
        serde_json::from_str(&read(dir.join("r/manifest.json"))).unwrap();
    let identity = manifest["methods"][0]["identity"].as_str().unwrap();
    assert!(
        identity.contains("resize=bicubic") && identity.contains("PIL"),
        "{identity}"
    );
    assert!(
        manifest["scoring"]["resolution"]
            .as_str()
            .unwrap()
            .contains("resized up")
    );
    run(dir, "s", &["--method", "imported:dir=small,resize=cubic"])
        .is_error_with(&["cubic", "bicubic"]);
}

#[test]
fn cropped_pictures_are_scored_on_the_equally_cropped_truth() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let ids = truth(dir, "2");
    for id in &ids {
        let target = picture(dir, id);
        // The middle square, exact; the left half, every level one too high.
        save(
            dir,
            "square",
            id,
            &imageops::crop_imm(&target, 12, 0, 72, 72).to_image(),
        );
        let mut left = imageops::crop_imm(&target, 0, 0, 48, 72).to_image();
        for Rgb(levels) in left.pixels_mut() {
            *levels = levels.map(|v| if v < 255 { v + 1 } else { v - 1 });
        }
        save(dir, "left", id, &left);
        std::fs::write(
            dir.join(format!("left/{id}.json")),
            r#"{"crop": [0, 0, 48, 72]}"#,
        )
        .unwrap();
    }
    let square = "imported:label=square,dir=square,crop=center:1:1";
    let methods = [
        "--limit",
        "2",
        "--method",
        square,
        "--method",
        "imported:label=own,dir=square,crop=center",
        "--method",
        "imported:label=left,dir=left,crop=sidecar",
        "--method",
        "imported:label=fixed,dir=left,crop=0:0:48:72",
        "--method",
        "imported:label=shifted,dir=left,crop=1:0:48:72",
        "--method",
        "copy",
    ];
    let said = run(dir, "r", &methods).ends_with(0);
    assert!(
        said.out.contains("square on S: cropped; 2 of 2 pairs"),
        "{}",
        said.out
    );
    let found = scores(dir, "r");
    // Every level is off by one: 20 log10 255.
    let off_by_one = 20.0 * 255_f64.log10();
    for n in 0..2 {
        for label in ["square", "own"] {
            let row = &found[label][n];
            assert_eq!(
                (row["psnr"].as_str(), row["crop_x"].as_str()),
                ("inf", "12")
            );
            assert_eq!(row["scored_share"], "0.75");
        }
        for label in ["left", "fixed"] {
            let psnr: f64 = found[label][n]["psnr"].parse().unwrap();
            assert!((psnr - off_by_one).abs() < 1e-9, "{psnr}");
        }
        assert_ne!(found["shifted"][n]["psnr"], found["fixed"][n]["psnr"]);
        assert_eq!(found["copy"][n]["scored_share"], "");
    }
    let report = sharp_bench(dir, &["report", "r"]).ends_with(0);
    assert!(report.out.contains("index.html"));

    // All on what all of them show: columns 12 to 47.
    let common = [
        &methods[..6],
        &["--method", "imported:label=left,dir=left,crop=sidecar"],
    ]
    .concat();
    let common: Vec<&str> = common
        .into_iter()
        .filter(|a| *a != "imported:label=own,dir=square,crop=center")
        .collect();
    let mut args: Vec<&str> = common[..common.len() - 3].to_vec();
    args.extend([
        "--method",
        "imported:label=left,dir=left,crop=sidecar",
        "--method",
        "copy",
    ]);
    run(dir, "c", &[&args[..], &["--common-region"]].concat()).ends_with(0);
    let found = scores(dir, "c");
    for rows in found.values() {
        for row in rows {
            assert_eq!(
                (row["crop_x"].as_str(), row["crop_width"].as_str()),
                ("12", "36")
            );
        }
    }
    assert_eq!(found["square"][0]["psnr"], "inf");
    let psnr: f64 = found["left"][0]["psnr"].parse().unwrap();
    assert!((psnr - off_by_one).abs() < 1e-9, "{psnr}");
    let manifest = read(dir.join("c/manifest.json"));
    assert!(manifest.contains("--common-region"));

    // Crops that cannot be.
    std::fs::write(
        dir.join(format!("left/{}.json", ids[0])),
        r#"{"crop": [60, 0, 48, 72]}"#,
    )
    .unwrap();
    std::fs::write(
        dir.join(format!("left/{}.json", ids[1])),
        r#"{"corp": [0]}"#,
    )
    .unwrap();
    let left = [
        "--limit",
        "2",
        "--method",
        "imported:label=left,dir=left,crop=sidecar",
    ];
    run(dir, "b", &left).ends_with(4);
    let found = scores(dir, "b");
    assert!(found["left"][0]["reason"].contains("not inside the target, 96x72"));
    assert!(found["left"][1]["reason"].contains(".json"));
    run(dir, "s", &["--method", "imported:dir=left,crop=middle"])
        .is_error_with(&["crop=middle", "sidecar"]);
}

#[test]
fn the_best_of_several_scales_is_chosen_by_dists_and_said() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let ids = truth(dir, "2");
    for (id, best) in ids.iter().zip(["0.5", "2"]) {
        for scale in ["0.5", "1", "2"] {
            let mut image = picture(dir, id);
            if scale != best {
                image = imageops::blur(&image, 3.0);
            }
            save(dir, &format!("scales/{scale}"), id, &image);
        }
    }
    let sweep = [
        "--limit",
        "2",
        "--method",
        "imported:label=lvsm,dir=scales,scales=0.5+1+2",
    ];
    run(dir, "r", &sweep).is_error_with(&["--scale-sweep"]);
    // A run must not find weights of the machine it is tested on.
    let said = sharp_bench(
        dir,
        &[
            &["run", "--dataset", DATASET, "--out", "r", "--scale-sweep"],
            &sweep[..],
        ]
        .concat(),
    );
    said.is_error_with(&["DISTS", "--weights vgg16="]);

    let weights = format!("vgg16={}", vgg16(dir).display());
    let args = [&sweep[..], &["--scale-sweep", "--weights", &weights]].concat();
    let said = run(dir, "r", &args).ends_with(0);
    assert!(
        said.out.contains("best of 3 scales by DISTS"),
        "{}",
        said.out
    );
    let found = scores(dir, "r");
    let chosen: Vec<&str> = found["lvsm"]
        .iter()
        .map(|r| r["best_scale"].as_str())
        .collect();
    assert_eq!(chosen, ["0.5", "2"]);
    assert!(
        found["lvsm"]
            .iter()
            .all(|r| r["psnr"] == "inf" && r["scales_tried"] == "3")
    );
    let manifest: serde_json::Value =
        serde_json::from_str(&read(dir.join("r/manifest.json"))).unwrap();
    let identity = manifest["methods"][0]["identity"].as_str().unwrap();
    assert!(
        identity.contains("best of scales 0.5+1+2 by dists vgg16="),
        "{identity}"
    );

    // The best of fewer would be another number.
    std::fs::remove_file(dir.join(format!("scales/1/{}.png", ids[0]))).unwrap();
    run(dir, "r", &args).ends_with(4);
    assert!(scores(dir, "r")["lvsm"][0]["reason"].contains("no picture"));
    for (scales, part) in [("1+1", "twice"), ("1+big", "positive"), ("1+7", "7")] {
        let method = format!("imported:dir=scales,scales={scales}");
        run(
            dir,
            "s",
            &["--method", &method, "--scale-sweep", "--weights", &weights],
        )
        .is_error_with(&[part]);
    }
}

/// Deterministic weights in VGG16's shapes.
fn vgg16(dir: &Path) -> std::path::PathBuf {
    use safetensors::tensor::{Dtype, TensorView};
    let mut tensors: Vec<(String, Vec<usize>, Vec<u8>)> = Vec::new();
    let mut inputs = 3;
    for (index, outputs) in [
        (0, 64),
        (2, 64),
        (5, 128),
        (7, 128),
        (10, 256),
        (12, 256),
        (14, 256),
        (17, 512),
        (19, 512),
        (21, 512),
        (24, 512),
        (26, 512),
        (28, 512),
    ] {
        for (kind, shape) in [
            ("weight", vec![outputs, inputs, 3, 3]),
            ("bias", vec![outputs]),
        ] {
            let name = format!("features.{index}.{kind}");
            let values = sharp_checkpoint::deterministic::backbone_weights(
                "",
                &format!("vgg16.{name}"),
                &shape,
            );
            let bytes = values.iter().flat_map(|v| v.to_le_bytes()).collect();
            tensors.push((name, shape, bytes));
        }
        inputs = outputs;
    }
    let views = tensors.iter().map(|(name, shape, bytes)| {
        let view = TensorView::new(Dtype::F32, shape.clone(), bytes).unwrap();
        (name.as_str(), view)
    });
    let path = dir.join("vgg16.safetensors");
    std::fs::write(&path, safetensors::serialize(views, None).unwrap()).unwrap();
    path
}
