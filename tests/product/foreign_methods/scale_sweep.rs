//! The best of several scales.

use sharp_tests::holds;

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
    let sweep = words("--limit 2 --method imported:label=lvsm,dir=scales,scales=0.5+1+2");
    run(dir, "r", &sweep).is_usage_error_with(&["--scale-sweep"]);
    let args = [&sweep[..], &["--scale-sweep"]].concat();
    let said = run(dir, "r", &args).ends_with(0);
    holds(&said.out, &["best of 3 scales by DISTS"]);
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

/// The program returns the true picture at one scale and a blurred one at the others.
#[cfg(unix)]
#[test]
fn a_program_is_asked_at_every_scale_and_the_best_is_chosen() {
    let dir = tempfile::tempdir().unwrap();
    let dir = dir.path();
    let ids = truth(dir, "2");
    for (id, best) in ids.iter().zip(["0.5", "2.0"]) {
        let image = picture(dir, id);
        save(dir, &format!("made/{best}"), id, &image);
        save(dir, "made/other", id, &imageops::blur(&image, 3.0));
    }
    let script = r#"
while IFS= read -r line; do
  id=$(printf '%s' "$line" | sed 's/.*"pair_id":"\([^"]*\)","source_picture".*/\1/')
  scale=$(printf '%s' "$line" | sed -n 's/.*"scale":\([0-9.]*\),"pair":.*/\1/p')
  case "$line" in *'"source_depth":"'*) told=1;; *) told=0;; esac
  picture="made/$scale/$id.png"
  [ -f "$picture" ] || picture="made/other/$id.png"
  echo "{\"pair_id\":\"$id\",\"picture\":\"$picture\",\"extras\":{\"told\":$told,\"at\":$scale}}"
done
"#;
    std::fs::write(dir.join("my.sh"), script).unwrap();
    let plain = "command:run='sh my.sh',scales=0.5+1+2";
    run(dir, "r", &["--method", plain]).is_usage_error_with(&["--scale-sweep"]);
    let told = "command:label=told,run='sh my.sh',scales=0.5+1+2,depth=privileged";
    let methods = ["--method", plain, "--method", told, "--limit", "2"];
    let said = run(dir, "r", &[&methods[..], &["--scale-sweep"]].concat()).ends_with(0);
    holds(&said.out, &["best of 3 scales by DISTS"]);
    let found = scores(dir, "r");
    for (method, told) in [("command", "0"), ("told", "1")] {
        for (row, best) in found[method].iter().zip(["0.5", "2"]) {
            // The extras are those of the chosen picture.
            let seen = ["best_scale", "at", "scales_tried", "told"].map(|name| &*row[name]);
            assert_eq!(seen, [best, best, "3", told]);
            assert_eq!(row["psnr"], "inf");
        }
    }
    let manifest: serde_json::Value =
        serde_json::from_str(&read(dir.join("r/manifest.json"))).unwrap();
    let identity = &manifest["methods"][0]["identity"];
    assert_eq!(identity["kind"], "command");
    assert_eq!(identity["settings"]["scales"], "0.5+1+2");
    assert!(identity["settings"]["chosen_by"].is_string());

    // Both rows have the privilege of the paper's rows: one by a scale sweep, one by depth.
    let table = |name: &str, row: &str| {
        let args = ["table", name, "--metrics", "psnr", "--row", row];
        sharp_bench(dir, &args).out
    };
    let mark = |text: &str| format!("[x] Every row uses {text}");
    let privileged = table("privileged-psnr-ssim", "mine=r:command");
    assert!(
        privileged.contains(&mark(
            "the scale of the true depth, or the best of several scales"
        )),
        "{privileged}"
    );
    assert!(!privileged.contains("changed or selected"), "{privileged}");
    let others = table("psnr-ssim", "mine=r:command");
    assert!(others.contains("the best of several scales"), "{others}");
}
