//! `render`: views, layers, paths, movies, and what it refuses.

use std::f64::consts::TAU;
use std::path::Path;

use image::{DynamicImage, RgbImage};

use crate::render_scene::{SIZE, folder, gaussians, write};
use crate::support::{Said, read, sharp_bench};

/// `render scene.ply --backend cpu` and more.
fn render(dir: &Path, more: &[&str]) -> Said {
    sharp_bench(
        dir,
        &[&["render", "scene.ply", "--backend", "cpu"], more].concat(),
    )
}

fn bytes(path: impl AsRef<Path>) -> Vec<u8> {
    let path = path.as_ref();
    std::fs::read(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

fn picture(path: impl AsRef<Path>) -> RgbImage {
    match image::load_from_memory(&bytes(path)).unwrap() {
        DynamicImage::ImageRgb8(picture) => picture,
        other => panic!("{:?}", other.color()),
    }
}

/// A pixel that no Gaussian reaches.
fn corner(dir: &Path, name: &str, more: &[&str]) -> [u8; 3] {
    render(dir, &[&["--out", name], more].concat()).ends_with(0);
    picture(dir.join(name)).get_pixel(0, 0).0
}

#[test]
fn a_view_says_who_rendered_it_and_depth_and_alpha_lie_beside_it() {
    let dir = folder();
    let dir = dir.path();
    let out = [
        "--out",
        "view.png",
        "--depth",
        "--alpha",
        "--write-cameras",
        "--json",
    ];
    let json = render(dir, &out).ends_with(0).json();
    assert_eq!(
        (json["width"].as_u64(), json["height"].as_u64()),
        (Some(64), Some(48))
    );
    assert_eq!(json["gaussians"], 24);
    assert_eq!(json["dropped_not_finite"], 0);
    assert!(json["backend"].as_str().unwrap().starts_with("cpu-"));
    assert!(json["backend_reason"].is_null() && json["fallback"].is_null());
    // The 0.001 and 0.999 quantiles of twelve depths of 3 m and twelve of 4 m.
    assert_eq!(json["depth_range_m"], serde_json::json!([3.0, 4.0]));
    let files: Vec<&str> = json["files"]
        .as_array()
        .unwrap()
        .iter()
        .map(|f| f.as_str().unwrap())
        .collect();
    assert_eq!(
        files,
        [
            "view.png",
            "view.depth.exr",
            "view.depth.png",
            "view.alpha.png"
        ]
    );
    for file in files {
        assert!(dir.join(file).is_file(), "{file}");
    }
    assert_eq!(picture(dir.join("view.png")).dimensions(), SIZE);
    let DynamicImage::ImageLuma8(alpha) =
        image::load_from_memory(&bytes(dir.join("view.alpha.png"))).unwrap()
    else {
        panic!("alpha is not grey");
    };
    assert_eq!(alpha.get_pixel(0, 0).0, [0]);
    // The middle of a Gaussian of the first row, of opacity 0.45 and what lies behind it.
    assert!(alpha.get_pixel(27, 14).0[0] > 110);
    // Where nothing is drawn the depth colours are black; elsewhere they are not.
    let depth = picture(dir.join("view.depth.png"));
    assert_eq!(depth.get_pixel(0, 0).0, [0; 3]);
    assert_ne!(depth.get_pixel(27, 14).0, [0; 3]);

    // The camera that was written renders the same bytes again.
    render(dir, &["--camera", "view.json", "--out", "again.png"]).ends_with(0);
    assert_eq!(bytes(dir.join("view.png")), bytes(dir.join("again.png")));

    // Left open, the backend is explained; it is never a software adapter.
    let said =
        sharp_bench(dir, &["render", "scene.ply", "--out", "auto.png", "--json"]).ends_with(0);
    assert!(said.json()["backend_reason"].is_string());
    assert!(
        !said.json()["backend"]
            .as_str()
            .unwrap()
            .contains("[software]")
    );
}

#[test]
fn backgrounds_are_linear_light_and_eight_bit_has_two_rules() {
    let dir = folder();
    let dir = dir.path();
    let corner = |name: &str, more: &[&str]| corner(dir, name, more);
    assert_eq!(corner("black.png", &[]), [0; 3]);
    assert_eq!(corner("white.png", &["--background", "white"]), [255; 3]);
    assert_eq!(
        corner("hex.png", &["--background", "#804020"]),
        [128, 64, 32]
    );
    // Half the light is 0.735357 of sRGB, 187.52 levels.
    let half = ["--background", "0.5,0.5,0.5"];
    assert_eq!(corner("round.png", &half), [188; 3]);
    let truncated = [&half[..], &["--quantise", "truncate"]].concat();
    assert_eq!(corner("truncate.png", &truncated), [187; 3]);
    let refused = render(dir, &["--out", "x.exr", "--background", "white"]);
    refused.is_error_with(&["x.exr", "--background"]);
}

#[test]
fn low_pass_near_and_far_are_those_of_the_definition() {
    let dir = folder();
    let dir = dir.path();
    let view = |name: &str, more: &[&str]| {
        render(dir, &[&["--out", name], more].concat()).ends_with(0);
        bytes(dir.join(name))
    };
    let release = view("release.png", &[]);
    assert_eq!(release, view("zero.png", &["--eps2d", "0"]));
    let gsplat = view("gsplat.png", &["--eps2d", "gsplat"]);
    assert_eq!(gsplat, view("number.png", &["--eps2d", "0.3"]));
    assert_ne!(release, gsplat);
    assert_eq!(
        view("config.png", &["--eps2d", "config"]),
        view("hundredth.png", &["--eps2d", "0.01"])
    );
    // Everything beyond 3.5 m is the second layer.
    assert_eq!(
        view("near.png", &["--far", "3.5"]),
        view("layer.png", &["--layer", "0"])
    );
    assert_eq!(
        view("back.png", &["--near", "3.5"]),
        view("hidden.png", &["--layer", "1"])
    );
    view("nothing.png", &["--far", "1"]);
    assert!(
        picture(dir.join("nothing.png"))
            .pixels()
            .all(|p| p.0 == [0; 3])
    );
}

#[test]
fn layers_are_halves_by_index_each_alone() {
    let dir = folder();
    let dir = dir.path();
    let json = render(dir, &["--layer", "all", "--out", "view.png", "--json"])
        .ends_with(0)
        .json();
    assert_eq!(json["views"], 2);
    assert_eq!(
        json["files"],
        serde_json::json!(["view.layer0.png", "view.layer1.png"])
    );
    let all = gaussians();
    for layer in 0..2 {
        write(&dir.join("half.ply"), all.filtered(|k| k / 12 == layer));
        sharp_bench(
            dir,
            &[
                "render",
                "half.ply",
                "--backend",
                "cpu",
                "--out",
                "half.png",
            ],
        )
        .ends_with(0);
        assert_eq!(
            bytes(dir.join("half.png")),
            bytes(dir.join(format!("view.layer{layer}.png")))
        );
    }
    write(&dir.join("odd.ply"), all.filtered(|k| k > 0));
    let odd = sharp_bench(
        dir,
        &["render", "odd.ply", "--layer", "1", "--out", "odd.png"],
    );
    odd.is_error_with(&["odd.ply", "23", "layers"]);
}

/// `camera_from_world` of a frame as 16 numbers.
fn camera(path: &Path) -> Vec<f64> {
    let json: serde_json::Value = serde_json::from_str(&read(path)).unwrap();
    let numbers = json["camera_from_world"].as_array().unwrap();
    numbers.iter().map(|n| n.as_f64().unwrap()).collect()
}

/// A camera at `eye` that looks at `target`, by the release's recipe: front, front × up, front × right.
fn looking(eye: [f64; 3], target: [f64; 3]) -> Vec<f64> {
    let cross = |a: [f64; 3], b: [f64; 3]| {
        [
            a[1] * b[2] - a[2] * b[1],
            a[2] * b[0] - a[0] * b[2],
            a[0] * b[1] - a[1] * b[0],
        ]
    };
    let unit = |v: [f64; 3]| {
        let length = v.iter().map(|x| x * x).sum::<f64>().sqrt();
        v.map(|x| x / length)
    };
    let front = unit([0, 1, 2].map(|c| target[c] - eye[c]));
    let right = unit(cross(front, [0.0, -1.0, 0.0]));
    let down = cross(front, right);
    let mut matrix = Vec::new();
    for axis in [right, down, front] {
        matrix.extend(axis);
        matrix.push(-(0..3).map(|c| axis[c] * eye[c]).sum::<f64>());
    }
    matrix.extend([0.0, 0.0, 0.0, 1.0]);
    matrix
}

#[test]
fn the_four_paths_are_the_releases() {
    // Gaussians all at 3 m: near and focus are 3. The largest shift sideways is
    // 0.08 · sqrt((64/60)² + (48/60)²) · 3 = 0.08 · 4/3 · 3 = 0.32 m, forward 0.15 · 3 = 0.45 m.
    let (side, forward) = (0.32, 0.45);
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    write(&dir.join("scene.ply"), gaussians().filtered(|k| k < 12));
    let turn = |k: usize, frames: usize| TAU * k as f64 / (frames - 1) as f64;
    let eye = |path: &str, k: usize| match path {
        "rotate_forward" => [
            side * turn(k, 8).sin(),
            0.0,
            forward * (1.0 - turn(k, 8).cos()) / 2.0,
        ],
        "rotate" => [side * turn(k, 8).sin(), side * turn(k, 8).cos(), 0.0],
        "swipe" => [side * (2.0 * k as f64 / 7.0 - 1.0), 0.0, 0.0],
        _ if k < 4 => [side * turn(k, 4).sin(), 0.0, 0.0],
        _ => [0.0, side * turn(k - 4, 4).sin(), 0.0],
    };
    for path in ["rotate_forward", "rotate", "swipe", "shake"] {
        for look in ["point", "ahead"] {
            let out = format!("{path}-{look}");
            let args = [
                "--trajectory",
                path,
                "--look-at",
                look,
                "--frames",
                "8",
                "--write-cameras",
                "--out",
                &out,
            ];
            render(dir, &args).ends_with(0);
            for k in 0..8 {
                let eye = eye(path, k);
                let target = match look {
                    "point" => [0.0, 0.0, 3.0],
                    _ => [eye[0], eye[1], eye[2] + 3.0],
                };
                let found = camera(&dir.join(format!("{out}/frame-{k:05}.json")));
                // The stored scene is f32: 3 m and the focal length are exact, so that f64 rounding is left.
                for (found, expected) in found.iter().zip(looking(eye, target)) {
                    assert!(
                        (found - expected).abs() < 1e-12,
                        "{out} {k}: {found} {expected}"
                    );
                }
            }
        }
    }
}

#[test]
fn frames_can_be_stopped_and_go_on() {
    let dir = folder();
    let dir = dir.path();
    let args = [
        "--trajectory",
        "rotate",
        "--frames",
        "5",
        "--depth",
        "--write-cameras",
        "--out",
        "frames",
        "--json",
    ];
    let first = render(dir, &args).ends_with(0).json();
    assert_eq!(
        (first["views"].as_u64(), first["reused"].as_u64()),
        (Some(5), Some(0))
    );
    let frame = |k: usize| dir.join(format!("frames/frame-{k:05}.png"));
    let before: Vec<Vec<u8>> = (0..5).map(|k| bytes(frame(k))).collect();
    // A closed path: the last frame is the first again.
    assert_eq!(before[0], before[4]);
    assert_ne!(before[0], before[1]);
    for end in ["depth.png", "depth.exr", "json"] {
        assert!(frame(4).with_extension(end).is_file());
    }

    for k in [1, 3] {
        std::fs::remove_file(frame(k)).unwrap();
    }
    let second = render(dir, &args).ends_with(0).json();
    assert_eq!(second["reused"], 3);
    for (k, before) in before.iter().enumerate() {
        assert_eq!(*before, bytes(frame(k)), "{k}");
    }
    // A frame's camera renders the frame.
    render(
        dir,
        &["--camera", "frames/frame-00003.json", "--out", "alone.png"],
    )
    .ends_with(0);
    assert_eq!(bytes(dir.join("alone.png")), before[3]);

    let other = [&args[..], &["--eps2d", "gsplat"]].concat();
    render(dir, &other).is_error_with(&["frames", "another rendering"]);
    std::fs::create_dir(dir.join("mine")).unwrap();
    std::fs::write(dir.join("mine/notes.txt"), "x").unwrap();
    render(dir, &["--trajectory", "swipe", "--out", "mine"])
        .is_error_with(&["mine", "other files"]);
}

#[test]
fn offsets_move_the_camera_along_its_own_axes() {
    let dir = folder();
    let dir = dir.path();
    // A camera that looks along the world's x axis.
    let turned = r#"{"width":64,"height":48,"K":[60,0,32,0,60,24,0,0,1],
        "camera_from_world":[0,0,-1,0, 0,1,0,0, 1,0,0,0, 0,0,0,1]}"#;
    std::fs::write(dir.join("turned.json"), turned).unwrap();
    let args = [
        "--camera",
        "turned.json",
        "--offset-m",
        "-0.1,0.2,0.3",
        "--write-cameras",
        "--out",
        "moved.png",
    ];
    render(dir, &args).ends_with(0);
    let found = camera(&dir.join("moved.json"));
    let expected = [
        0.0, 0.0, -1.0, 0.1, 0.0, 1.0, 0.0, -0.2, 1.0, 0.0, 0.0, -0.3, 0.0, 0.0, 0.0, 1.0,
    ];
    for (found, expected) in found.iter().zip(expected) {
        assert!((found - expected).abs() < 1e-15);
    }

    // With look-at: the focus is the 0.1 quantile of depth, 3 m.
    let args = [
        "--offset-m",
        "0.1,0,0",
        "--offset-m",
        "0,-0.2,0.1",
        "--look-at",
        "point",
        "--write-cameras",
        "--out",
        "two",
    ];
    render(dir, &args).ends_with(0);
    for (k, eye) in [[0.1, 0.0, 0.0], [0.0, -0.2, 0.1]].into_iter().enumerate() {
        let found = camera(&dir.join(format!("two/frame-{k:05}.json")));
        for (found, expected) in found.iter().zip(looking(eye, [0.0, 0.0, 3.0])) {
            assert!((found - expected).abs() < 1e-12);
        }
    }
    let several = [
        "--offset-m",
        "0.1,0,0",
        "--offset-m",
        "0.2,0,0",
        "--out",
        "one.png",
    ];
    render(dir, &several).is_error_with(&["one.png", "2"]);
}

#[test]
fn gifs_of_colour_depth_and_alpha_lie_side_by_side() {
    let dir = folder();
    let dir = dir.path();
    let args = [
        "--trajectory",
        "swipe",
        "--frames",
        "4",
        "--fps",
        "25",
        "--depth",
        "--alpha",
        "--write-cameras",
        "--out",
        "swipe.gif",
        "--json",
    ];
    let json = render(dir, &args).ends_with(0).json();
    assert_eq!(
        json["files"],
        serde_json::json!(["swipe.gif", "swipe.depth.gif", "swipe.alpha.gif"])
    );
    for name in ["swipe.gif", "swipe.depth.gif", "swipe.alpha.gif"] {
        let file = std::fs::File::open(dir.join(name)).unwrap();
        let mut decoder = gif::DecodeOptions::new().read_info(file).unwrap();
        assert_eq!(
            (u32::from(decoder.width()), u32::from(decoder.height())),
            SIZE
        );
        let mut delays = Vec::new();
        while let Some(frame) = decoder.read_next_frame().unwrap() {
            delays.push(frame.delay);
        }
        assert_eq!(delays, [4; 4], "{name}");
    }
    assert!(dir.join("swipe.cameras/frame-00003.json").is_file());
    // Nothing half-made stays behind.
    let partial = std::fs::read_dir(dir).unwrap().filter(|f| {
        f.as_ref()
            .unwrap()
            .file_name()
            .to_string_lossy()
            .starts_with(".partial")
    });
    assert_eq!(partial.count(), 0);
}

#[test]
fn the_releases_screen_is_half_a_pixel_off_and_truncates() {
    let dir = folder();
    let dir = dir.path();
    let args = [
        "--release-screen",
        "--background",
        "0.5,0.5,0.5",
        "--write-cameras",
        "--out",
        "release.png",
    ];
    render(dir, &args).ends_with(0);
    let json: serde_json::Value = serde_json::from_str(&read(dir.join("release.json"))).unwrap();
    assert_eq!(
        (json["K"][2].as_f64(), json["K"][5].as_f64()),
        (Some(31.5), Some(23.5))
    );
    assert_eq!(picture(dir.join("release.png")).get_pixel(0, 0).0, [187; 3]);
}

#[test]
fn what_cannot_be_rendered_is_one_line() {
    let dir = folder();
    let dir = dir.path();
    let fails = |args: &[&str], parts: &[&str]| render(dir, args).is_error_with(parts);
    let usage = |args: &[&str], part: &str| {
        let said = render(dir, args).ends_with(2);
        assert!(said.err.contains(part), "{}", said.err);
    };
    // Cameras.
    for (name, text, part) in [
        (
            "nan.json",
            r#"{"width":4,"height":4,"K":[NaN,0,2,0,5,2,0,0,1],"camera_from_world":[1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1]}"#,
            "line 1",
        ),
        (
            "huge.json",
            r#"{"width":4,"height":4,"K":[5,0,2,0,5,2,0,0,1],"camera_from_world":[1e999,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1]}"#,
            "range",
        ),
        (
            "flat.json",
            r#"{"width":4,"height":4,"K":[0,0,2,0,5,2,0,0,1],"camera_from_world":[1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1]}"#,
            "fx 0",
        ),
        (
            "empty.json",
            r#"{"width":0,"height":4,"K":[5,0,2,0,5,2,0,0,1],"camera_from_world":[1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1]}"#,
            "0x4",
        ),
        (
            "wide.json",
            r#"{"width":70000,"height":4,"K":[5,0,2,0,5,2,0,0,1],"camera_from_world":[1,0,0,0,0,1,0,0,0,0,1,0,0,0,0,1]}"#,
            "70000",
        ),
    ] {
        std::fs::write(dir.join(name), text).unwrap();
        let file = if name == "wide.json" {
            "scene.ply"
        } else {
            name
        };
        fails(&["--camera", name, "--out", "x.png"], &[file, part]);
    }
    fails(
        &["--camera", "absent.json", "--out", "x.png"],
        &["absent.json"],
    );
    // Outputs.
    std::fs::write(dir.join("file"), "x").unwrap();
    fails(&["--out", "file/x.png"], &["file/x.png"]);
    fails(
        &["--trajectory", "swipe", "--out", "file/frames"],
        &["file/frames"],
    );
    fails(
        &["--trajectory", "swipe", "--out", "file/x.gif"],
        &["file/x.gif"],
    );
    fails(&["--out", "x.jpg"], &["x.jpg", ".png"]);
    fails(&["--out", "frames"], &["frames", "--trajectory"]);
    fails(&["--out", "x.gif"], &["x.gif", "--trajectory"]);
    fails(
        &["--trajectory", "swipe", "--out", "x.png"],
        &["x.png", "60"],
    );
    fails(&["--fps", "30", "--out", "x.png"], &["--fps"]);
    fails(
        &["--trajectory", "swipe", "--fps", "60", "--out", "x.gif"],
        &["x.gif", "50"],
    );
    fails(&["--look-at", "point", "--out", "x.png"], &["--look-at"]);
    fails(&["--near", "0", "--out", "x.png"], &["scene.ply", "near 0"]);
    fails(
        &["--trajectory", "swipe", "--max-zoom", "NaN", "--out", "f"],
        &["--max-zoom"],
    );
    // Values that no option takes.
    usage(&["--trajectory", "spiral", "--out", "f"], "rotate_forward");
    usage(
        &["--trajectory", "swipe", "--frames", "0", "--out", "f"],
        "--frames",
    );
    usage(&["--frames", "5", "--out", "f"], "--trajectory");
    usage(&["--offset-m", "1,2", "--out", "x.png"], "X,Y,Z");
    usage(&["--eps2d=-1", "--out", "x.png"], "eps2d");
    usage(&["--background", "grey", "--out", "x.png"], "#RRGGBB");
    usage(&["--layer", "2", "--out", "x.png"], "all");
    // Nothing in front of the camera: a path has no size, a view is empty.
    let behind = r#"{"width":8,"height":8,"K":[8,0,4,0,8,4,0,0,1],"camera_from_world":[1,0,0,0,0,1,0,0,0,0,1,-9,0,0,0,1]}"#;
    std::fs::write(dir.join("behind.json"), behind).unwrap();
    fails(
        &[
            "--camera",
            "behind.json",
            "--trajectory",
            "swipe",
            "--out",
            "f",
        ],
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
    render(dir, &["--adapter", "any", "--out", "x.png"]).is_error_with(&["--adapter", "cpu"]);
    let run = [
        "run",
        "--dataset",
        "S:synthetic=size=48x36,views=20",
        "--method",
        "copy",
        "--metrics",
        "psnr",
        "--out",
        "r",
    ];
    let auto = [&run[..], &["--backend", "auto"]].concat();
    sharp_bench(dir, &auto).is_usage_error_with(&["--backend auto", "cpu or wgpu"]);
    let nowhere = [&run[..], &["--backend", "wgpu", "--adapter", "no such GPU"]].concat();
    sharp_bench(dir, &nowhere).is_error_with(&["no such GPU"]);
    assert!(!dir.join("r").exists());

    let said = std::process::Command::new(env!("CARGO_BIN_EXE_sharp-bench"))
        .args([
            "render",
            "scene.ply",
            "--backend",
            "cpu",
            "--trajectory",
            "swipe",
            "--out",
            "x.mp4",
        ])
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
