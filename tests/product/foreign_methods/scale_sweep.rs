//! The best of several scales.

use super::*;

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
    run(dir, "r", &sweep).is_usage_error_with(&["--scale-sweep"]);
    let args = [&sweep[..], &["--scale-sweep"]].concat();
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
    let settings = &manifest["methods"][0]["identity"]["settings"];
    assert_eq!(settings["scales"], "0.5+1+2");
    let chooser = settings["chosen_by"].as_str().unwrap();
    assert!(chooser.starts_with("dists vgg16=2b36fb93"), "{chooser}");

    // The best of fewer scales would be another number.
    std::fs::remove_file(dir.join(format!("scales/1/{}.png", ids[0]))).unwrap();
    run(dir, "r", &args).ends_with(4);
    assert!(scores(dir, "r")["lvsm"][0]["reason"].contains("no picture"));
    let with = |scales: &str| {
        let method = format!("imported:dir=scales,scales={scales}");
        run(dir, "s", &["--method", &method, "--scale-sweep"])
    };
    for (scales, part) in [("1+1", "twice"), ("1+big", "positive")] {
        with(scales).is_usage_error_with(&[part]);
    }
    with("1+7").is_error_with(&["7"]);
}
