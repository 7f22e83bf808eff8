//! `predict`, `gaussians`, `render` and the methods that take Gaussians, on the tiny network.

use crate::support::{holds, sharp_bench as run, words};
use crate::tiny::{depth_pro, golden, recorded_input, tiny};

#[test]
fn a_photograph_becomes_gaussians_that_can_be_looked_at_and_rendered() {
    let dir = tempfile::tempdir().unwrap();
    let (image, _) = recorded_input();
    let tiny = tiny();
    let model: Vec<&str> = tiny.iter().map(String::as_str).collect();
    let predict = [
        "predict", &image, "--out", "p.ply", "--depth", "exr", "--json",
    ];
    let said = run(dir.path(), &[&predict[..], &model].concat()).ends_with(0);
    // The photograph has no EXIF tags, so the default focal length is reported.
    assert!(said.err.contains("30 mm"), "{}", said.err);
    let json = said.json();
    let count = json[0]["gaussians"].as_u64().unwrap();
    assert_eq!(count, 2 * 96 * 96);
    assert!(dir.path().join("p.depth.exr").is_file());

    let info = run(dir.path(), &["gaussians", "info", "p.ply", "--json"])
        .ends_with(0)
        .json();
    assert_eq!(info["gaussians"].as_u64(), Some(count));
    assert_eq!(info["per_layer"].as_u64(), Some(count / 2));
    assert_eq!(info["not_finite"], 0);

    let convert = words("gaussians convert p.ply q.ply --min-opacity 0.5");
    run(dir.path(), &convert).ends_with(0);
    let kept = run(dir.path(), &["gaussians", "info", "q.ply", "--json"])
        .ends_with(0)
        .json();
    assert!(kept["gaussians"].as_u64().unwrap() < count);
    assert!(kept["opacity"]["quantiles"][0].as_f64().unwrap() >= 0.5);
    assert!(kept["image_size"].is_null());

    let said = run(
        dir.path(),
        &["render", "p.ply", "--out", "view.png", "--json"],
    )
    .ends_with(0);
    assert!(said.json()["mean_alpha"].as_f64().unwrap() > 0.5);
    run(dir.path(), &["render", "q.ply", "--out", "view.png"])
        .is_error_with(&["q.ply", "--camera"]);
}

#[test]
fn predicted_and_imported_gaussians_are_evaluated_alike() {
    let dir = tempfile::tempdir().unwrap();
    let tiny = tiny();
    let sharp = format!("sharp:label=tiny,checkpoint={},config={}", tiny[1], tiny[3]);
    let privileged = format!("{sharp},depth=privileged").replace("label=tiny", "label=aligned");
    let fixed =
        "run --dataset S:synthetic=size=96x72,views=20 --limit 2 --metrics psnr --out r --json";
    let methods = ["--method", &sharp, "--method", &privileged];
    let args = [&words(fixed)[..], &methods].concat();
    let json = run(dir.path(), &args).ends_with(0).json();
    assert_eq!(json["units"], 4);
    let mut reader = csv::Reader::from_path(dir.path().join("r/scores.csv")).unwrap();
    let header = reader.headers().unwrap().clone();
    let scale = header.iter().position(|c| c == "median_scale").unwrap();
    let method = header.iter().position(|c| c == "method").unwrap();
    for row in reader.records().map(Result::unwrap) {
        assert_eq!(row[scale].is_empty(), &row[method] == "tiny");
    }

    // External Gaussians for the same source (here from the official writer), rendered in the
    // dataset's poses.
    let scores = std::fs::read_to_string(dir.path().join("r/scores.csv")).unwrap();
    let source = scores
        .lines()
        .nth(1)
        .unwrap()
        .split("__")
        .next()
        .unwrap()
        .to_owned();
    let file = dir.path().join("g").join(format!("{source}.ply"));
    std::fs::create_dir_all(file.parent().unwrap()).unwrap();
    std::fs::copy(golden("tiny_golden.ply"), &file).unwrap();
    let args = words(
        "run --dataset S:synthetic=size=96x72,views=20 --limit 1 --metrics psnr --out s \
         --method gaussians:label=theirs,dir=g --json",
    );
    assert_eq!(run(dir.path(), &args).ends_with(0).json()["failed"], 0);
}

#[test]
fn colours_that_a_file_does_not_explain_are_asked_for() {
    let dir = tempfile::tempdir().unwrap();
    let dataset = "S:synthetic=size=96x72,views=4";
    // Our own Gaussians as another program would write them, without stating the encoding of
    // colours.
    let tagged = dir.path().join("tagged.ply");
    crate::render_scene::write(&tagged, crate::render_scene::gaussians());
    run(
        dir.path(),
        &["gaussians", "convert", "tagged.ply", "plain.ply"],
    )
    .ends_with(0);
    let plain = std::fs::read(dir.path().join("plain.ply")).unwrap();
    let tag = b"comment color_space srgb\n";
    let at = plain.windows(tag.len()).position(|w| w == tag).unwrap();
    let untagged = [&plain[..at], &plain[at + tag.len()..]].concat();
    std::fs::write(dir.path().join("untagged.ply"), &untagged).unwrap();

    let info = run(dir.path(), &["gaussians", "info", "untagged.ply"]).ends_with(0);
    assert!(info.out.contains("not stated in the file"), "{}", info.out);
    assert!(
        info.out
            .contains("plausible as metres in the camera's space")
    );
    // `gaussians info` recognises OpenGL's axes and millimetres.
    for (scale, words) in [
        (-1.0, "the axes may be OpenGL's"),
        (1000.0, "median depth of 4"),
    ] {
        let mut moved = crate::render_scene::gaussians();
        moved.means.iter_mut().for_each(|mean| mean[2] *= scale);
        crate::render_scene::write(&dir.path().join("moved.ply"), moved);
        let info = run(dir.path(), &["gaussians", "info", "moved.ply"]).ends_with(0);
        assert!(info.out.contains(words), "{}", info.out);
    }
    let convert = ["gaussians", "convert", "untagged.ply", "x.ply"];
    run(dir.path(), &[&convert[..], &["--to", "release"]].concat())
        .is_error_with(&["color_space=linear", "color_space=srgb"]);
    run(
        dir.path(),
        &[&convert[..], &["--color-space", "srgb"]].concat(),
    )
    .ends_with(0);
    let colors = |name: &str| {
        let scene = sharp::gaussian_files::load(&dir.path().join(name), None).unwrap();
        scene.gaussians.colors.into_flattened()
    };
    for (back, before) in colors("x.ply").iter().zip(colors("plain.ply")) {
        assert!((back - before).abs() < 1e-5, "{back} {before}");
    }

    let evaluate = |more: &str| {
        let method = format!("gaussians:dir=g{more}");
        let fixed = format!("run --dataset {dataset} --metrics psnr --limit 1 --out r --json");
        run(
            dir.path(),
            &[&words(&fixed)[..], &["--method", &method]].concat(),
        )
    };
    std::fs::create_dir_all(dir.path().join("g/S/seed0")).unwrap();
    for view in 0..4 {
        let file = format!("g/S/seed0/view_{view:02}.ply");
        std::fs::write(dir.path().join(file), &untagged).unwrap();
    }
    assert_eq!(evaluate("").ends_with(4).json()["failed"], 1);
    assert_eq!(
        evaluate(",color_space=srgb").ends_with(0).json()["failed"],
        0
    );
    // If they are read as linear, the rendering of their own source reveals it.
    let wrong = evaluate(",color_space=linear").ends_with(0);
    holds(&wrong.err, &["their source's photograph"]);
    let report = run(dir.path(), &["report", "r"]).ends_with(0);
    let page = std::fs::read_to_string(dir.path().join("r/report/index.html")).unwrap();
    assert!(page.contains("hardly recognisable"), "{}", report.out);
    assert!(page.contains("Source PSNR"));
    // Dropped Gaussians are reported.
    let mut still = crate::render_scene::gaussians();
    still.quaternions[3] = [0.0; 4];
    for view in 0..4 {
        let file = dir.path().join(format!("g/S/seed0/view_{view:02}.ply"));
        crate::render_scene::write(&file, still.clone());
    }
    let dropped = evaluate("").ends_with(0);
    let words = "1 of its Gaussians have a quaternion of zero";
    assert!(dropped.err.contains(words), "{}", dropped.err);
    still.quaternions.fill([0.0; 4]);
    crate::render_scene::write(&dir.path().join("moved.ply"), still);
    let info = run(dir.path(), &["gaussians", "info", "moved.ply"]).ends_with(0);
    assert!(info.out.contains("no Gaussian is visible"), "{}", info.out);
    evaluate(",color_space=rec709").is_usage_error_with(&["rec709", "linear or srgb"]);
}

#[test]
fn depth_pro_writes_the_depth_of_a_photograph() {
    let dir = tempfile::tempdir().unwrap();
    let (image, focal_px) = recorded_input();
    let [checkpoint, config] = depth_pro(&dir.path().join("d.safetensors"));
    let model = ["--checkpoint", &checkpoint, "--config", &config];
    let predict = |model: &[&str], more: &[&str]| {
        let args = [&["predict", image.as_str(), "--depth-only"], model, more].concat();
        run(dir.path(), &args)
    };
    let map = |name: &str| sharp_datasets::format::read_map(&dir.path().join(name)).unwrap();
    let focal = ["--focal-px", focal_px.as_str()];
    let json = predict(
        &model,
        &[&focal[..], &["--out", "d.exr", "--json"]].concat(),
    );
    let json = json.ends_with(0).json();
    assert_eq!(
        (
            json[0]["focal_px"].as_f64(),
            json[0]["is_focal_estimated"].as_bool()
        ),
        (Some(500.0), Some(false))
    );
    let metres = map("d.exr");
    assert_eq!(metres.dimensions(), (640, 480));
    predict(
        &model,
        &[&focal[..], &["--out", "maps", "--depth", "png16"]].concat(),
    )
    .ends_with(0);
    let millimetres = map("maps/main_640x480.png");
    for (mm, m) in millimetres.iter().zip(metres.iter()) {
        assert_eq!(*mm, (1000.0 * m).round().min(65535.0));
    }
    // SHARP's depth by the same weights differs only in the conventions of resizing.
    let sharp = [
        "predict",
        &image,
        "--out",
        "p.ply",
        "--depth",
        "png16",
        "--focal-px",
        &focal_px,
    ];
    let tiny = tiny();
    let tiny: Vec<&str> = tiny.iter().map(String::as_str).collect();
    run(dir.path(), &[&sharp[..], &tiny].concat()).ends_with(0);
    let mean = |map: &sharp_datasets::format::FloatMap| map.iter().sum::<f32>() / map.len() as f32;
    let ratio = mean(&millimetres) / mean(&map("p.depth0.png"));
    assert!((ratio - 1.0).abs() < 0.02, "{ratio}");

    // `figure uncertainty`, which also predicts the mirrored picture, accepts this network.
    let figure = ["figure", "uncertainty", "--picture", &image, "--out", "u"];
    run(dir.path(), &[&figure[..], &model].concat()).ends_with(0);
    assert!(dir.path().join("u/uncertainty.png").is_file());

    predict(&model, &["--out", "d.exr"]).is_error_with(&["focal length must be given"]);
    predict(&model, &["--out", "d.ply"]).is_error_with(&["writes .exr or .png"]);
    predict(&model, &["--out", "d.exr", "--depth", "png16"])
        .is_error_with(&["contradicts --depth"]);
    let said = predict(&tiny, &["--out", "x.exr"]).ends_with(1);
    holds(
        &said.err,
        &["a checkpoint of SHARP, but one of Depth Pro is needed"],
    );
    assert_eq!(predict(&[], &["--out", "x.exr"]).code, 2);

    let narrow = golden("../depth_pro/narrow_model.pt");
    let config = golden("tiny_config.json#narrow");
    let narrow = ["--checkpoint", narrow.as_str(), "--config", config.as_str()];
    let said = predict(&narrow, &["--out", "e.exr"]).ends_with(0);
    holds(&said.out, &["focal length 729.86 px (estimated)"]);
    assert!(!said.err.contains("30 mm"), "{}", said.err);
}
