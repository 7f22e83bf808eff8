//! Input that cannot be rendered.

use super::*;

#[test]
fn what_cannot_be_rendered_is_one_line() {
    let dir = folder();
    let dir = dir.path();
    let fails = |line: &str, parts: &[&str]| render(dir, &words(line)).is_error_with(parts);
    let usage = |line: &str, part: &str| {
        let said = render(dir, &words(line)).ends_with(2);
        assert!(said.err.contains(part), "{}", said.err);
    };
    // Cameras.
    let table = "\
nan.json | 4x4 | NaN | 1 | line 1
huge.json | 4x4 | 5 | 1e999 | range
flat.json | 4x4 | 0 | 1 | fx 0
empty.json | 0x4 | 5 | 1 | 0x4
vast.json | 60000x20000 | 5 | 1 | 60000x20000 exceeds the maximum of 268435456 pixels
wide.json | 70000x4 | 5 | 1 | 70000";
    for [name, size, fx, turn, part] in sharp_tests::rows(table) {
        let (width, height) = size.split_once('x').unwrap();
        let text = format!(
            r#"{{"width":{width},"height":{height},"K":[{fx},0,2,0,5,2,0,0,1],
                "camera_from_world":[{turn},0,0,0,0,1,0,0,0,0,1,0,0,0,0,1]}}"#
        );
        std::fs::write(dir.join(name), text).unwrap();
        let file = if name == "wide.json" {
            "scene.ply"
        } else {
            name
        };
        fails(&format!("--camera {name} --out x.png"), &[file, part]);
    }
    fails("--camera absent.json --out x.png", &["absent.json"]);
    // Outputs.
    std::fs::write(dir.join("file"), "x").unwrap();
    fails("--out file/x.png", &["file/x.png"]);
    fails("--trajectory swipe --out file/frames", &["file/frames"]);
    fails("--trajectory swipe --out file/x.gif", &["file/x.gif"]);
    fails("--out x.jpg", &["x.jpg", ".png"]);
    fails("--out frames", &["frames", "--trajectory"]);
    fails("--out x.gif", &["x.gif", "--trajectory"]);
    fails("--trajectory swipe --out x.png", &["x.png", "60"]);
    fails("--fps 30 --out x.png", &["--fps"]);
    fails("--trajectory swipe --fps 60 --out x.gif", &["x.gif", "50"]);
    fails("--near 0 --out x.png", &["scene.ply", "near 0"]);
    // Values that the options do not accept.
    usage("--trajectory spiral --out f", "rotate_forward");
    usage("--trajectory swipe --frames 0 --out f", "--frames");
    usage("--frames 5 --out f", "--trajectory");
    usage("--offset-m 1,2 --out x.png", "X,Y,Z");
    usage("--eps2d=-1 --out x.png", "eps2d");
    usage("--background grey --out x.png", "#RRGGBB");
    usage("--layer 2 --out x.png", "all");
    // Without a Gaussian in front of the camera, the size of a path is undefined, and a view is
    // empty.
    let behind = r#"{"width":8,"height":8,"K":[8,0,4,0,8,4,0,0,1],"camera_from_world":[1,0,0,0,0,1,0,0,0,0,1,-9,0,0,0,1]}"#;
    std::fs::write(dir.join("behind.json"), behind).unwrap();
    fails(
        "--camera behind.json --trajectory swipe --out f",
        &["scene.ply", "in front"],
    );
    render(
        dir,
        &["--camera", "behind.json", "--depth", "--out", "behind.png"],
    )
    .ends_with(0);
    let leftovers: Vec<_> = std::fs::read_dir(dir)
        .unwrap()
        .map(|f| f.unwrap().file_name())
        .filter(|f| f.to_string_lossy().starts_with('x') || *f == "f")
        .collect();
    assert!(leftovers.is_empty(), "{leftovers:?}");
}

#[test]
fn adapters_that_are_not_there_and_a_missing_ffmpeg_are_said() {
    let dir = folder();
    let dir = dir.path();
    let absent = [
        "render",
        "scene.ply",
        "--adapter",
        "no such GPU",
        "--out",
        "x.png",
    ];
    sharp_bench(dir, &absent).is_error_with(&["no such GPU", "found:"]);
    render(dir, &["--adapter", "any", "--out", "x.png"]).is_usage_error_with(&["--adapter", "cpu"]);
    let run =
        words("run --dataset S:synthetic=size=48x36,views=20 --method copy --metrics psnr --out r");
    let auto = [&run[..], &["--backend", "auto"]].concat();
    sharp_bench(dir, &auto).is_usage_error_with(&["--backend auto", "cpu or wgpu"]);
    let nowhere = [&run[..], &["--backend", "wgpu", "--adapter", "no such GPU"]].concat();
    sharp_bench(dir, &nowhere).is_error_with(&["no such GPU"]);
    assert!(!dir.join("r").exists());

    let said = std::process::Command::new(env!("CARGO_BIN_EXE_sharp-bench"))
        .args("render scene.ply --backend cpu --trajectory swipe --out x.mp4".split(' '))
        .current_dir(dir)
        .env("PATH", "")
        .output()
        .unwrap();
    let error = String::from_utf8(said.stderr).unwrap();
    assert_eq!(said.status.code(), Some(1), "{error}");
    assert!(
        error.contains("x.mp4") && error.contains("ffmpeg") && error.contains(".gif"),
        "{error}"
    );
    assert_eq!(error.lines().count(), 1, "{error}");
    assert!(!dir.join("x.mp4").exists() && !dir.join("x.png").exists());
}
