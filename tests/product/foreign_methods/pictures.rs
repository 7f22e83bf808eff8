//! Resized and cropped pictures.

use sharp_tests::holds;

use super::*;

#[test]
fn pictures_of_another_size_are_resized_by_a_named_kernel_only() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let ids = truth(dir, "3");
    for id in &ids {
        let small = imageops::thumbnail(&picture(dir, id), 48, 36);
        save(dir, "small", id, &small);
        save(dir, "square", id, &imageops::thumbnail(&small, 30, 30));
        save(dir, "large", id, &imageops::thumbnail(&small, 192, 144));
    }
    let methods = words(
        "--limit 3 --method imported:label=cubic,dir=small,resize=bicubic \
         --method imported:label=linear,dir=small,resize=bilinear --method imported:dir=small \
         --method imported:label=square,dir=square,resize=bicubic \
         --method imported:label=large,dir=large,resize=lanczos",
    );
    let said = run(dir, "r", &methods).ends_with(4);
    holds(&said.out, &["were resized (`bicubic`) before scoring"]);
    let found = scores(dir, "r");
    for (cubic, linear) in found["cubic"].iter().zip(&found["linear"]) {
        assert_eq!(cubic["predicted_width"], "48");
        assert_ne!(cubic["psnr"], linear["psnr"]);
    }
    assert_eq!(found["large"][0]["predicted_width"], "192");
    for (method, part) in [
        ("imported", "48x36, but the target is 96x72; set a kernel"),
        ("square", "another aspect"),
    ] {
        let reason = &found[method][0]["reason"];
        assert!(reason.contains(part), "{reason}");
    }
    let manifest: serde_json::Value =
        serde_json::from_str(&read(dir.join("r/manifest.json"))).unwrap();
    let resize = &manifest["methods"][0]["identity"]["settings"]["resize"];
    let resize = resize.as_str().unwrap();
    assert!(
        resize.starts_with("bicubic") && resize.contains("PIL"),
        "{resize}"
    );
    assert!(
        manifest["scoring"]["resolution"]
            .as_str()
            .unwrap()
            .contains("predictions are resized up or cropped only where")
    );
    run(dir, "s", &["--method", "imported:dir=small,resize=cubic"])
        .is_usage_error_with(&["cubic", "bicubic"]);
}

#[test]
fn cropped_pictures_are_scored_on_the_equally_cropped_truth() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let ids = truth(dir, "2");
    for id in &ids {
        let target = picture(dir, id);
        // The middle square is exact; in the left half, every level is one too high.
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
    let methods = words(
        "--limit 2 --method imported:label=square,dir=square,crop=center:1:1 \
         --method imported:label=own,dir=square,crop=center --method imported:label=left,dir=left,crop=sidecar \
         --method imported:label=fixed,dir=left,crop=0:0:48:72 \
         --method imported:label=shifted,dir=left,crop=1:0:48:72 --method copy",
    );
    let said = run(dir, "r", &methods).ends_with(0);
    holds(&said.out, &["square on S: cropped; 2 of 2 pairs"]);
    let found = scores(dir, "r");
    // Every level is off by one, so PSNR is 20 log10 255.
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

    // All methods are scored on the part that all of them show: columns 12 to 47.
    let methods = words(
        "--limit 2 --method imported:label=square,dir=square,crop=center:1:1 \
         --method imported:label=left,dir=left,crop=sidecar --method copy --common-region",
    );
    run(dir, "c", &methods).ends_with(0);
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
    let manifest: serde_json::Value =
        serde_json::from_str(&read(dir.join("c/manifest.json"))).unwrap();
    assert_eq!(manifest["common_region"], true);

    // Invalid crops.
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
    let left = words("--limit 2 --method imported:label=left,dir=left,crop=sidecar");
    run(dir, "b", &left).ends_with(4);
    let found = scores(dir, "b");
    assert!(found["left"][0]["reason"].contains("not inside the target, 96x72"));
    assert!(found["left"][1]["reason"].contains(".json"));
    run(dir, "s", &["--method", "imported:dir=left,crop=middle"])
        .is_usage_error_with(&["crop=middle", "sidecar"]);
}
