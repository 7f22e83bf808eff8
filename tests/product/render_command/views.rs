//! A single view: colours, layers, depth, the release's screen.

use super::*;

#[test]
fn a_view_says_who_rendered_it_and_depth_and_alpha_lie_beside_it() {
    let dir = folder();
    let dir = dir.path();
    let out = words("--out view.png --depth --alpha --write-cameras --json");
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
    // The centre of a Gaussian in the first row, with opacity 0.45, over the Gaussians behind it.
    assert!(alpha.get_pixel(27, 14).0[0] > 110);
    // The depth colours are black where nothing is rendered, and not black elsewhere.
    let depth = picture(dir.join("view.depth.png"));
    assert_eq!(depth.get_pixel(0, 0).0, [0; 3]);
    assert_ne!(depth.get_pixel(27, 14).0, [0; 3]);

    // The written camera renders the same bytes again.
    render(dir, &["--camera", "view.json", "--out", "again.png"]).ends_with(0);
    assert_eq!(bytes(dir.join("view.png")), bytes(dir.join("again.png")));

    // If no backend is requested, the choice is explained; it is never a software adapter.
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
    // Half of the light is 0.735357 in sRGB, 187.52 levels.
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
    // The second layer is everything beyond 3.5 m.
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
        sharp_bench(dir, &words("render half.ply --backend cpu --out half.png")).ends_with(0);
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

#[test]
fn the_releases_screen_is_half_a_pixel_off_and_truncates() {
    let dir = folder();
    let dir = dir.path();
    let args = words("--release-screen --background 0.5,0.5,0.5 --write-cameras --out release.png");
    render(dir, &args).ends_with(0);
    let json: serde_json::Value = serde_json::from_str(&read(dir.join("release.json"))).unwrap();
    assert_eq!(
        (json["K"][2].as_f64(), json["K"][5].as_f64()),
        (Some(31.5), Some(23.5))
    );
    assert_eq!(picture(dir.join("release.png")).get_pixel(0, 0).0, [187; 3]);
}
