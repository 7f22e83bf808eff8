//! Moved cameras: frames, offsets, movies.

use super::*;

/// `camera_from_world` of a frame as 16 numbers.
fn camera(path: &Path) -> Vec<f64> {
    let json: serde_json::Value = serde_json::from_str(&read(path)).unwrap();
    let numbers = json["camera_from_world"].as_array().unwrap();
    numbers.iter().map(|n| n.as_f64().unwrap()).collect()
}

/// A camera at `eye` that looks at `target`, computed like the release: front, front × up, front ×
/// right.
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
    // All Gaussians are at 3 m, so near and focus are 3. The largest shift sideways is 0.08 ·
    // sqrt((64/60)² + (48/60)²) · 3 = 0.08 · 4/3 · 3 = 0.32 m, and forward 0.15 · 3 = 0.45 m.
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
        let args = ["--trajectory", path, "--frames", "8"];
        let more = ["--write-cameras", "--out", path];
        render(dir, &[&args[..], &more].concat()).ends_with(0);
        for k in 0..8 {
            let found = camera(&dir.join(format!("{path}/frame-{k:05}.json")));
            // The stored scene is f32, but 3 m and the focal length are exact, so only f64 rounding
            // remains.
            for (found, expected) in found.iter().zip(looking(eye(path, k), [0.0, 0.0, 3.0])) {
                assert!(
                    (found - expected).abs() < 1e-12,
                    "{path} {k}: {found} {expected}"
                );
            }
        }
    }
}

#[test]
fn frames_go_into_a_folder_of_their_own() {
    let dir = folder();
    let dir = dir.path();
    let args = words("--trajectory rotate --frames 5 --depth --write-cameras --out frames --json");
    let first = render(dir, &args).ends_with(0).json();
    assert_eq!(first["views"], 5);
    let frame = |k: usize| dir.join(format!("frames/frame-{k:05}.png"));
    let before: Vec<Vec<u8>> = (0..5).map(|k| bytes(frame(k))).collect();
    // The path is closed: the last frame equals the first.
    assert_eq!(before[0], before[4]);
    assert_ne!(before[0], before[1]);
    for end in ["depth.png", "depth.exr", "json"] {
        assert!(frame(4).with_extension(end).is_file());
    }

    // A frame's written camera renders the same frame.
    render(
        dir,
        &["--camera", "frames/frame-00003.json", "--out", "alone.png"],
    )
    .ends_with(0);
    assert_eq!(bytes(dir.join("alone.png")), before[3]);

    // Frames of two renderings are never mixed in one folder.
    render(dir, &args).is_error_with(&["frames", "is not empty"]);
}

#[test]
fn offsets_move_the_camera_along_its_own_axes() {
    let dir = folder();
    let dir = dir.path();
    // A camera that looks along the world's x axis.
    let turned = r#"{"width":64,"height":48,"K":[60,0,32,0,60,24,0,0,1],
        "camera_from_world":[0,0,-1,0, 0,1,0,0, 1,0,0,0, 0,0,0,1]}"#;
    std::fs::write(dir.join("turned.json"), turned).unwrap();
    let args =
        words("--camera turned.json --offset-m -0.1,0.2,0.3 --write-cameras --out moved.png");
    render(dir, &args).ends_with(0);
    let found = camera(&dir.join("moved.json"));
    let expected = [
        0.0, 0.0, -1.0, 0.1, 0.0, 1.0, 0.0, -0.2, 1.0, 0.0, 0.0, -0.3, 0.0, 0.0, 0.0, 1.0,
    ];
    for (found, expected) in found.iter().zip(expected) {
        assert!((found - expected).abs() < 1e-15);
    }

    let several = words("--offset-m 0.1,0,0 --offset-m 0.2,0,0 --out one.png");
    render(dir, &several).is_error_with(&["one.png", "2"]);
}

#[test]
fn gifs_of_colour_depth_and_alpha_lie_side_by_side() {
    let dir = folder();
    let dir = dir.path();
    let args = words(
        "--trajectory swipe --frames 4 --fps 25 --depth --alpha --write-cameras --out swipe.gif \
         --json",
    );
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
    // No partial file remains.
    let partial = std::fs::read_dir(dir).unwrap().filter(|f| {
        f.as_ref()
            .unwrap()
            .file_name()
            .to_string_lossy()
            .starts_with(".partial")
    });
    assert_eq!(partial.count(), 0);
}
