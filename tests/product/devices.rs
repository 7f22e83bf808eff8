//! Tests that need GPU adapters, ffmpeg or TeX. If the machine lacks one of these, its tests are
//! reported as ignored, by name.

#![allow(
    clippy::unwrap_used,
    clippy::panic,
    reason = "test code outside of #[test] functions"
)]

mod render_scene;
#[allow(dead_code, reason = "shared with the other tests of the binary")]
mod support;

use std::path::Path;
use std::process::{Command, ExitCode};

use libtest_mimic::{Arguments, Trial};
use render_scene::folder;
use support::{Said, sharp_bench, words};

fn main() -> ExitCode {
    let arguments = Arguments::from_args();
    let mut trials = vec![
        Trial::test(
            "an MP4 has its frames, even sides and its colours named",
            || {
                movies();
                Ok(())
            },
        )
        .with_ignored_flag(!has("ffmpeg") || !has("ffprobe")),
        Trial::test("what is written for a paper compiles in one", || {
            paper();
            Ok(())
        })
        .with_ignored_flag(!has("pdflatex") || !has("bibtex")),
    ];
    let adapters = adapters();
    for (title, test) in [
        ("a view on wgpu is the CPU's view", view as fn(&str)),
        ("a run on wgpu says so and stays on it", evaluate),
    ] {
        if adapters.is_empty() {
            trials.push(
                Trial::test(format!("{title} (no adapter)"), || Ok(())).with_ignored_flag(true),
            );
        }
        for adapter in adapters.clone() {
            trials.push(Trial::test(format!("{title}: {adapter}"), move || {
                test(&adapter);
                Ok(())
            }));
        }
    }
    libtest_mimic::run(&arguments, trials).exit_code()
}

fn has(program: &str) -> bool {
    Command::new(program).arg("-version").output().is_ok()
}

/// The adapters that `doctor` lists.
fn adapters() -> Vec<String> {
    let said = sharp_bench(Path::new("."), &["doctor", "--json"]).ends_with(0);
    let found = said.json();
    found
        .as_array()
        .unwrap()
        .iter()
        .filter(|finding| finding["what"] == "gpu adapter")
        .filter_map(|finding| finding["found"].as_str())
        .filter(|found| !found.starts_with("none"))
        .map(str::to_owned)
        .collect()
}

/// The name that an adapter's driver reports, without interface and version.
fn short(adapter: &str) -> &str {
    adapter.split(" (").next().unwrap()
}

fn render(dir: &Path, more: &[&str]) -> Said {
    sharp_bench(dir, &[&["render", "scene.ply"], more].concat()).ends_with(0)
}

fn view(adapter: &str) {
    let dir = folder();
    let dir = dir.path();
    let json = render(
        dir,
        &["--adapter", short(adapter), "--out", "gpu.png", "--json"],
    )
    .json();
    let backend = json["backend"].as_str().unwrap();
    assert!(
        backend.starts_with("wgpu:") && backend.contains(short(adapter)),
        "{backend}"
    );
    assert_eq!(
        backend.contains("[software]"),
        adapter.contains("[software]")
    );
    render(dir, &["--backend", "cpu", "--out", "cpu.png"]);
    let [gpu, cpu] = ["gpu.png", "cpu.png"].map(|name| {
        let bytes = std::fs::read(dir.join(name)).unwrap();
        image::load_from_memory(&bytes).unwrap().to_rgb8()
    });
    // If a threshold is decided differently, a pixel changes by at most 1/255 of linear light,
    // which is 13 levels of sRGB in dark areas; this may happen to a few pixels. Rounding changes a
    // pixel by one level.
    let levels = gpu
        .as_raw()
        .iter()
        .zip(cpu.as_raw())
        .map(|(a, b)| a.abs_diff(*b));
    let (mut far, mut most) = (0, 0);
    for off in levels {
        far += usize::from(off > 1);
        most = most.max(off);
    }
    assert!(
        most <= 13 && far <= gpu.as_raw().len() / 100,
        "{most} {far}"
    );
    // A path uploads the scene once; its first view equals the same view rendered alone.
    render(
        dir,
        &[
            "--adapter",
            short(adapter),
            "--trajectory",
            "swipe",
            "--frames",
            "3",
            "--out",
            "frames",
            "--write-cameras",
        ],
    );
    render(
        dir,
        &[
            "--adapter",
            short(adapter),
            "--camera",
            "frames/frame-00002.json",
            "--out",
            "last.png",
        ],
    );
    let [frame, alone] =
        ["frames/frame-00002.png", "last.png"].map(|name| std::fs::read(dir.join(name)).unwrap());
    assert_eq!(frame, alone);
}

fn evaluate(adapter: &str) {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let run = |out: &str, more: &[&str]| {
        let line = format!(
            "run --dataset S:synthetic=size=48x36,views=20 --method depth-splat:resolution=64 \
             --metrics psnr --limit 2 --json --out {out}",
        );
        let args = words(&line);
        sharp_bench(dir, &[&args[..], more].concat())
    };
    let wgpu = ["--backend", "wgpu", "--adapter", short(adapter)];
    let json = run("gpu", &wgpu).ends_with(0).json();
    let backend = json["manifest"]["renderer"]["backend"]
        .as_str()
        .unwrap()
        .to_owned();
    assert!(
        backend.starts_with("wgpu:") && backend.contains(short(adapter)),
        "{backend}"
    );
    assert_eq!(run("gpu", &wgpu).ends_with(0).json()["reused"], 2);
    // A run uses a single backend.
    run("gpu", &[]).is_error_with(&["gpu", &backend, "cpu-"]);

    run("cpu", &[]).ends_with(0);
    let psnr = |out: &str| -> Vec<f64> {
        let mut rows = csv::Reader::from_path(dir.join(out).join("scores.csv")).unwrap();
        let header = rows.headers().unwrap().clone();
        let psnr = header.iter().position(|name| name == "psnr").unwrap();
        rows.records()
            .map(|row| row.unwrap()[psnr].parse().unwrap())
            .collect()
    };
    let (gpu, cpu) = (psnr("gpu"), psnr("cpu"));
    assert_eq!((gpu.len(), cpu.len()), (2, 2));
    for (gpu, cpu) in gpu.into_iter().zip(cpu) {
        assert!((gpu - cpu).abs() < 0.05, "{gpu} {cpu}");
    }
}

fn paper() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let data = ["--dataset", "S_&_%:synthetic=size=48x36,views=20"];
    let method = ["--method", "depth-splat:resolution=64,label=a_%_b"];
    let run = [
        &["run"],
        &data[..],
        &method,
        &["--limit", "2", "--out", "r"],
    ]
    .concat();
    sharp_bench(dir, &run).ends_with(0);
    sharp_bench(dir, &["report", "r", "--methods-text", "--out", "."]).ends_with(0);
    let speed = [
        &["speed", "r"],
        &data[..],
        &method,
        &["--repeat", "1", "--out", "."],
    ]
    .concat();
    sharp_bench(dir, &speed).ends_with(0);
    let document = "\\documentclass{article}\\usepackage[T1]{fontenc}\\usepackage{booktabs,graphicx}\n\
        \\usepackage[table]{xcolor}\\begin{document}\\input{methods}\\input{speed}\n\
        \\bibliographystyle{plain}\\bibliography{methods}\\end{document}\n";
    std::fs::write(dir.join("paper.tex"), document).unwrap();
    for program in ["pdflatex", "bibtex", "pdflatex", "pdflatex"] {
        let mut command = Command::new(program);
        if program == "pdflatex" {
            command.args(["-halt-on-error", "-interaction=nonstopmode"]);
        }
        let output = command.arg("paper").current_dir(dir).output().unwrap();
        let said = String::from_utf8_lossy(&output.stdout);
        assert!(output.status.success(), "{program}: {said}");
    }
    let log = std::fs::read(dir.join("paper.log")).unwrap();
    let log = String::from_utf8_lossy(&log);
    assert!(!log.contains("undefined citations"), "{log}");

    // Each of the paper's tables is written with a complete document.
    let tables = |args: &[&str]| {
        let out = ["--out", "tables"];
        sharp_bench(dir, &[&["table"], args, &out[..]].concat())
    };
    // The row has no numbers for the paper's datasets, which is reported.
    tables(&["quantitative", "--row", "a_%_& ^~<b>#{$=r"]).ends_with(4);
    tables(&["ablation_loss"]).ends_with(0);
    tables(&["param-count"]).ends_with(0);
    for name in ["quantitative", "ablation_loss", "param-count"] {
        let mut command = Command::new("pdflatex");
        command.args(["-halt-on-error", "-interaction=nonstopmode"]);
        command.arg(format!("{name}-document.tex"));
        let output = command.current_dir(dir.join("tables")).output().unwrap();
        let said = String::from_utf8_lossy(&output.stdout);
        assert!(output.status.success(), "{name}: {said}");
    }
}

fn movies() {
    let dir = folder();
    let dir = dir.path();
    let odd = r#"{"width":63,"height":47,"K":[60,0,32,0,60,24,0,0,1],
        "camera_from_world":[1,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,0,1]}"#;
    std::fs::write(dir.join("odd.json"), odd).unwrap();
    render(
        dir,
        &words(
            "--backend cpu --camera odd.json --trajectory rotate --frames 7 --fps 10 --depth \
             --out odd.mp4",
        ),
    );
    for name in ["odd.mp4", "odd.depth.mp4"] {
        let probe = Command::new("ffprobe")
            .args(["-v", "error", "-count_frames", "-show_entries"])
            .arg("stream=width,height,nb_read_frames,color_space,color_transfer,r_frame_rate")
            .args(["-of", "json", name])
            .current_dir(dir)
            .output()
            .unwrap();
        let found: serde_json::Value = serde_json::from_slice(&probe.stdout).unwrap();
        let stream = &found["streams"][0];
        assert_eq!(
            (stream["width"].as_u64(), stream["height"].as_u64()),
            (Some(64), Some(48))
        );
        assert_eq!(stream["nb_read_frames"], "7", "{name}");
        assert_eq!(stream["r_frame_rate"], "10/1");
        assert_eq!(
            (
                stream["color_space"].as_str(),
                stream["color_transfer"].as_str()
            ),
            (Some("bt709"), Some("iec61966-2-1"))
        );
    }
}
