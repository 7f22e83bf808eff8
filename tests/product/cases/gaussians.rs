//! Cases of files of Gaussians and of checkpoints.

use std::path::Path;

use sharp_tests::holds;

use super::super::support::{Said, ascii_ply};
use super::{Case, case, empty, untried};

fn psnr(case: &Case, run: &str) -> f64 {
    case.scores(run, "psnr")[0].parse().unwrap()
}

/// Runs the case's pairs with the given settings for its Gaussians into the folder `again`, and
/// returns the PSNR.
fn with(case: &Case, settings: &str) -> f64 {
    let method = format!("gaussians:dir=g,color_space=srgb,{settings}");
    let said = run_method(case, &method, "again");
    ends(&said, 0);
    assert!(!said.err.contains("warning"), "{}", said.err);
    psnr(case, "again")
}

/// Like [`with`], but for settings that cause warnings; uses a separate folder.
fn with_any(case: &Case, settings: &str) -> f64 {
    let method = format!("gaussians:dir=g,color_space=srgb,{settings}");
    ends(&run_method(case, &method, "other"), 0);
    psnr(case, "other")
}

fn run_method(case: &Case, method: &str, out: &str) -> Said {
    case.run(&format!(
        "sharp-bench run -q --dataset synthetic=size=64x48,views=8 --pairs pairs.csv --method \"{method}\" \
         --metrics psnr --out {out}"
    ))
}

fn ends(said: &Said, code: i32) {
    assert_eq!(said.code, code, "{}{}", said.out, said.err);
}

fn close(found: f64, expected: f64) {
    assert!(
        (found - expected).abs() < 1e-3,
        "{found} instead of {expected}"
    );
}

/// Checks that the run failed at its only unit, and that the reason contains all parts.
fn refused(case: &Case, parts: &[&str]) {
    ends(&case.said[0], 4);
    let reason = &case.scores("r", "reason")[0];
    for part in parts {
        assert!(reason.contains(part), "{part}: {reason}");
        assert!(
            case.said[0].out.contains(part),
            "{part}: {}",
            case.said[0].out
        );
    }
}

#[test]
fn proper_files_are_scored_without_a_word() {
    for (name, expected) in [("00-good", 19.0306), ("A10-good", 20.9783)] {
        let case = case(name);
        ends(&case.said[0], 0);
        assert_eq!(case.said[0].err, "", "{name}");
        close(psnr(&case, "r"), expected);
        let manifest = std::fs::read_to_string(case.path("r").join("manifest.json")).unwrap();
        assert!(!manifest.contains("\"warnings\""), "{manifest}");
        let info = case.run("sharp-bench gaussians info g/synthetic/seed0/view_00.ply");
        assert!(!info.out.contains("reading "), "{}", info.out);
    }
}

/// The expected values are from another program's rasteriser, which blends in linear light like the
/// other files of the cases.
#[test]
fn files_that_state_their_rule_are_drawn_by_it_or_by_the_one_that_is_named() {
    for (name, stated, ways) in [
        (
            "A03-mip-comment",
            "gsplat-antialiased",
            [
                ("rendering='gsplat-antialiased,blending=linear'", 19.09),
                ("rendering=sharp", 19.03),
                ("marks=ignore", 19.03),
            ],
        ),
        (
            "X05-filter_3D",
            "mip-splatting",
            [
                ("rendering='mip-splatting,blending=linear'", 11.08),
                ("rendering=sharp", 11.06),
                ("marks=ignore", 13.30),
            ],
        ),
    ] {
        let case = case(name);
        ends(&case.said[0], 0);
        assert!(!case.said[0].err.contains("rule"), "{}", case.said[0].err);
        let manifest = std::fs::read_to_string(case.path("r/manifest.json")).unwrap();
        for text in [&manifest, &case.said[0].out] {
            assert!(text.contains(&format!("the rule {stated} (")), "{text}");
        }
        for (settings, expected) in ways {
            let found = with_any(&untried(name), settings);
            assert!(
                (found - expected).abs() < 0.02,
                "{name} {settings}: {found}"
            );
        }
    }
}

#[test]
fn rows_that_are_longer_than_declared_are_refused_and_bytes_at_the_end_named() {
    refused(
        &case("A05-row-pad3"),
        &["9216 bytes follow the last row", "3 for each of 3072"],
    );
    let trailing = case("A05-trailing");
    close(psnr(&trailing, "r"), 19.0306);
    trailing.is_said_everywhere("r", "10000 bytes follow the last row");
}

#[test]
fn opacities_without_the_logit_are_named_by_numbers_and_by_the_photograph() {
    let case = case("A09-opacity-activated");
    case.is_said_everywhere("r", "`opacity=linear` reads them as opacities");
    let info = &case.said[1].out;
    assert!(info.contains("opacity=linear"), "{info}");
    close(with(&case, "opacity=linear"), 20.9783);
}

#[test]
fn another_order_of_quaternions_is_found_by_the_photograph() {
    let case = case("A10-quat-xyzw");
    case.is_said_everywhere("r", "with `quaternions=xyzw`, they reach 27.35 dB");
    close(with(&case, "quaternions=xyzw"), 20.9783);
}

#[test]
fn scales_that_are_no_logarithms_are_named_by_numbers_and_by_the_photograph() {
    let case = case("A11-scales-linear");
    case.is_said_everywhere("r", "`scales=linear` reads them as standard deviations");
    case.is_said_everywhere("r", "with `scales=linear`, they reach 26.91 dB");
    holds(&case.said[1].out, &["scales=linear"]);
    close(with(&case, "scales=linear"), 20.9783);
}

#[test]
fn turned_and_world_space_files_are_named_with_the_setting_that_mends_them() {
    let turned = case("A13-rot180z");
    turned.is_said_everywhere("r", "with `axes=luf`, they reach 33.92 dB");
    close(with(&turned, "axes=luf"), 19.0306);
    let world = case("A14-world");
    world.is_said_everywhere("r", "with `space=world`, they reach 33.92 dB");
    close(with(&world, "space=world"), 19.0306);
    // One file per scene.
    let folder = world.path("g/synthetic");
    std::fs::rename(folder.join("seed0/view_00.ply"), folder.join("seed0.ply")).unwrap();
    close(with(&world, "space=world,label=scene"), 19.0306);
}

#[test]
fn harmonics_need_a_rule_or_are_dropped() {
    let case = case("A15-sh3");
    refused(&case, &["rendering=RULE", "probably gsplat-classic"]);
    // 3D Gaussian Splatting's layout stores them; the release's layout cannot.
    ends(&case.said[2], 0);
    let view = "g/synthetic/seed0/view_00.ply";
    let kept = case.run("sharp-bench gaussians info out.ply");
    holds(&kept.out, &["degree 3, depend on the view"]);
    let release = case.run(&format!(
        "sharp-bench gaussians convert {view} out.ply --to release --color-space srgb"
    ));
    ends(&release, 1);
    holds(&release.err, &["--read harmonics=drop"]);
    // Rendered with constant terms only, over the mean colour, they are closer to the photograph
    // than that colour alone.
    let method = "gaussians:dir=g,color_space=srgb,harmonics=drop";
    let said = run_method(&case, method, "again");
    ends(&said, 0);
    assert!(
        !said
            .err
            .contains("so the photograph is hardly recognisable"),
        "{}",
        said.err
    );
    let dropped = psnr(&case, "again");
    case.run("sharp-bench gaussians convert g/synthetic/seed0/view_00.ply out.ply --color-space srgb --read harmonics=drop")
        .ends_with(0);
    std::fs::rename(
        case.path("out.ply"),
        case.path("g/synthetic/seed0/view_00.ply"),
    )
    .unwrap();
    run_method(&case, "gaussians:dir=g", "converted").ends_with(0);
    close(psnr(&case, "converted"), dropped);
}

#[test]
fn other_forms_are_refused_by_name_with_what_helps() {
    for (name, parts) in [
        ("A24-2dgs-no-scale2", ["2D Gaussian Splatting", "imported"]),
        ("A25-uchar-rgb", ["rendering=RULE", "probably"]),
        ("A26-spz", ["`axes=rub`", "`axes=rdf`"]),
        ("X06-gz-as-ply", ["gzip", "unpack it"]),
    ] {
        let case = case(name);
        refused(&case, &parts);
    }
    let rgb = untried("A25-uchar-rgb");
    assert!(with(&rgb, "colors=rgb255") > 18.0);
}

#[test]
fn other_formats_are_scored_as_the_ply_they_were_made_of() {
    // The file is quantised, so the result is only close to the 20.9783 dB of A10-good.
    for (name, settings) in [
        ("A23-compressed-ply", "label=read"),
        ("A26-sog", "label=read"),
        ("A26-splat", "label=read"),
        ("A26-spz", "axes=rub"),
    ] {
        let found = with(&untried(name), settings);
        assert!((found - 20.9783).abs() < 0.1, "{name}: {found}");
    }
    // With wrong axes, something else is visible.
    assert!(with_any(&untried("A26-spz"), "axes=rdf") < 20.0);
}

#[test]
fn files_may_lie_elsewhere_and_the_layout_that_finds_them_is_named() {
    let case = untried("A10-good");
    std::fs::rename(
        case.path("g/synthetic/seed0/view_00.ply"),
        case.path("g/seed0.ply"),
    )
    .unwrap();
    close(with(&case, "file={scene}.ply"), 20.9783);
    let said = run_method(&case, "gaussians:dir=g,color_space=srgb", "none");
    assert_ne!(said.code, 0);
    holds(&said.err, &["with file={scene}.ply, 1 of 1 exist"]);
    assert!(!case.path("none").join("manifest.json").exists());
    // Moved by one matrix and back by another, as nerfstudio's normalisation requires.
    let turn = "[[0,-1,0,0],[1,0,0,0],[0,0,1,0],[0,0,0,1]]";
    std::fs::write(case.path("turn.json"), turn).unwrap();
    let turned = with_any(&case, "file={scene}.ply,transform=turn.json,label=turned");
    assert!((turned - 20.9783).abs() > 0.1, "{turned}");
}

#[test]
fn conversions_follow_the_name_and_tell_what_the_result_does_not_say() {
    let case = untried("A26-spz");
    let view = "g/synthetic/seed0/view_00.spz";
    let camera = r#"{"width": 64, "height": 48, "K": [60,0,32, 0,60,24, 0,0,1], "camera_from_world": [1,0,0,0, 0,1,0,0, 0,0,1,0, 0,0,0,1]}"#;
    std::fs::write(case.path("cam.json"), camera).unwrap();
    let render = format!("sharp-bench render {view} --color-space srgb --camera cam.json --out");
    let refused = case.run(&format!("{render} o.png"));
    ends(&refused, 1);
    assert!(refused.err.contains("--axes"), "{}", refused.err);
    ends(&case.run(&format!("{render} o.png --axes rub")), 0);
    // PLY and SPZ can state that they are antialiased, but not that they need Mip-Splatting's rule.
    let ply = "g/synthetic/seed0/view_00.ply";
    for (name, note) in [
        ("A03-mip-comment", ""),
        ("X05-filter_3D", "states the rule mip-splatting"),
    ] {
        let case = untried(name);
        for out in ["o.ply", "o.spz"] {
            let said = case.run(&format!("sharp-bench gaussians convert {ply} {out}"));
            ends(&said, 0);
            assert_eq!(said.err.is_empty(), note.is_empty(), "{name}: {}", said.err);
            assert!(said.err.contains(note), "{name}: {}", said.err);
        }
    }
    let mip = untried("A03-mip-comment");
    let other = mip.run(&format!("sharp-bench gaussians convert {ply} o.sog"));
    ends(&other, 1);
    assert!(other.err.contains(".compressed.ply"), "{}", other.err);
}

#[test]
fn extensions_may_have_any_case() {
    let case = case("X07-PLY-upper");
    assert_eq!(case.said[0].err, "");
    close(psnr(&case, "r"), 20.9783);
}

#[test]
fn files_under_the_names_of_their_neighbours_are_named() {
    let case = case("X15-gaussians-of-neighbour");
    case.is_said_everywhere("r", "photograph at 20.42 dB PSNR");
}

#[test]
fn every_setting_is_part_of_the_identity() {
    let case = untried("A10-good");
    run_method(&case, "gaussians:dir=g,color_space=srgb", "r").ends_with(0);
    let again = run_method(
        &case,
        "gaussians:dir=g,color_space=srgb,shift='0.5,0.5'",
        "r",
    );
    ends(&again, 0);
    assert!(
        again.err.contains("shift") || again.err.contains("was gaussians"),
        "{}",
        again.err
    );
    let said = run_method(
        &case,
        "gaussians:dir=g,color_space=srgb,quaternions=wzyx",
        "r",
    );
    ends(&said, 2);
    assert!(said.err.contains("wxyz or xyzw"), "{}", said.err);
}

#[test]
fn files_of_other_programs_are_read_in_silence_or_refused_by_name() {
    let samples = Path::new(env!("CARGO_MANIFEST_DIR")).join("../tests/fixtures/gaussian_formats");
    let case = untried("00-good");
    let info = |name: &str| {
        let path = samples.join(name);
        case.run(&format!("sharp-bench gaussians info '{}'", path.display()))
    };
    for proper in [
        "src_d1.ply",
        "ascii.ply",
        "big_endian.ply",
        "permuted_double_extra.ply",
    ] {
        let said = info(proper);
        ends(&said, 0);
        assert!(!said.out.contains("reading "), "{proper}: {}", said.out);
    }
    for (name, part) in [
        ("brush_mip.ply", "written by       brush"),
        ("postshot_aa.ply", "made to be drawn antialiased"),
        ("mip_filter_3D.ply", "filter_3D"),
        ("nerfstudio_rgb.ply", "nerfstudio"),
        ("d0_gsplat.splat", "Gaussians        400"),
        ("d0_twelve.compressed.ply", "Gaussians        400"),
        ("d1_niantic_v2_rub.spz", "axes=rub"),
        ("d4_niantic_v4_rub.spz", "degree 4"),
        ("d1_splat-transform_v2.sog", "splat-transform"),
    ] {
        let said = info(name);
        ends(&said, 0);
        assert!(said.out.contains(part), "{name}: {}", said.out);
    }
    for (name, part) in [
        ("two_scales.ply", "2D Gaussian Splatting"),
        ("d1_mkkellogg_level2.ksplat", "KSPLAT"),
    ] {
        let said = info(name);
        ends(&said, 1);
        assert!(said.err.contains(part), "{name}: {}", said.err);
    }
    for (name, part) in [
        ("wrong_f_dc_rgb01.ply", "colors=rgb01"),
        ("wrong_opacity_linear.ply", "opacity=linear"),
        ("wrong_rot_xyzw_identity.ply", "quaternions=xyzw"),
        ("wrong_scale_linear.ply", "scales=linear"),
    ] {
        let said = info(name);
        assert!(said.out.contains(part), "{name}: {}", said.out);
    }
}

#[test]
fn checkpoints_with_prefixes_or_foreign_classes_are_read_and_prefixes_said() {
    let case = case("A27-checkpoints");
    for (said, prefix) in case.said.iter().zip(["", "", "module.", "_orig_mod."]) {
        ends(said, 0);
        assert!(said.out.contains("18432 Gaussians"), "{}", said.out);
        match prefix {
            "" => assert_eq!(said.err, ""),
            prefix => {
                let note = format!("have the prefix `{prefix}`");
                assert!(said.err.contains(&note), "{}", said.err);
            }
        }
    }
    let ply = |name: &str| {
        let line = format!(
            "sharp-bench predict -q --checkpoint {name} --config tiny_config.json#tiny --focal-px 57 --out {name}.ply photo.png"
        );
        case.run(&line).ends_with(0);
        std::fs::read(case.path(&format!("{name}.ply"))).unwrap()
    };
    let plain = ply("plain.safetensors");
    for name in ["namespace.pt", "module.safetensors", "orig_mod.safetensors"] {
        assert!(ply(name) == plain, "{name}");
    }
}

#[test]
fn weights_that_are_not_finite_end_a_prediction() {
    let case = case("A27-checkpoints");
    let plain = std::fs::read(case.path("plain.safetensors")).unwrap();
    let length = u64::from_le_bytes(plain[..8].try_into().unwrap()) as usize;
    let header: serde_json::Value = serde_json::from_slice(&plain[8..8 + length]).unwrap();
    let parts = ["monodepth_model", "prediction_head"];
    for part in parts {
        let mut broken = plain.clone();
        for (name, tensor) in header.as_object().unwrap() {
            if name.starts_with(part) {
                let [start, end] = [0, 1].map(|i| tensor["data_offsets"][i].as_u64().unwrap());
                for value in broken[8 + length..][start as usize..end as usize].chunks_exact_mut(4)
                {
                    value.copy_from_slice(&f32::NAN.to_le_bytes());
                }
            }
        }
        std::fs::write(case.path("nan.safetensors"), broken).unwrap();
        let line = "sharp-bench predict -q --checkpoint nan.safetensors --config tiny_config.json#tiny --focal-px 57 \
                    --out nan.ply photo.png";
        let said = case.run(line);
        assert!(said.err.contains("not finite"), "{part}: {}", said.err);
        assert_ne!(said.code, 0);
        assert!(!case.path("nan.ply").exists());
    }
}

#[test]
fn sizes_beside_a_checkpoint_are_used_and_others_end_a_run_before_its_first_pair() {
    let case = untried("A27-checkpoints");
    let predict = |more: &str| {
        case.run(&format!(
            "sharp-bench predict -q --checkpoint plain.safetensors {more} --focal-px 57 --out o.ply photo.png"
        ))
    };
    let beside = predict("");
    ends(&beside, 0);
    holds(&beside.err, &["tiny_config.json#tiny next to the file"]);
    let other = predict("--config tiny_config.json#narrow");
    ends(&other, 1);
    assert!(other.err.contains("--config"), "{}", other.err);
    let run = |method: &str, out: &str| {
        case.run(&format!(
            "sharp-bench run -q --dataset synthetic=size=32x24,views=4 --limit 1 --method sharp:{method} --metrics psnr --out {out}"
        ))
    };
    let wrong = run(
        "checkpoint=plain.safetensors,config=tiny_config.json#narrow",
        "wrong",
    );
    assert!(wrong.code == 1 || wrong.code == 2, "{}", wrong.err);
    assert!(wrong.err.contains("config="), "{}", wrong.err);
    assert!(!case.path("wrong/scores.csv").exists());
    let prefixed = run("checkpoint=module.safetensors", "r");
    ends(&prefixed, 0);
    let said = "have the prefix `module.`";
    assert!(prefixed.out.contains(said), "{}", prefixed.out);
    let manifest = std::fs::read_to_string(case.path("r/manifest.json")).unwrap();
    assert!(manifest.contains(said), "{manifest}");
}

#[test]
fn a_network_that_predicts_poorly_stays_silent_and_its_files_misread_are_named() {
    let case = empty();
    let data = "synthetic=size=160x120,views=8";
    case.run(&format!(
        "sharp-bench cameras export -q --dataset {data} --out e && sharp-bench predict -q --checkpoint mini --focal-px 144 \
         --out g/synthetic/seed0 e/synthetic/seed0/view_0[0-7].png"
    ))
    .ends_with(0);
    // `predict` assumes that the principal point is the middle of the picture; it is at 81.28,
    // 58.68.
    let aside = "shift=-1.28:1.32";
    for (setting, mends) in [
        (aside, None),
        ("axes=opencv", Some("`shift=-1.5:1")),
        ("shift=-1.28:1.82", Some("`shift=-1.28:1.32`")),
        (
            "shift=-1.28:1.32,channels=bgr",
            Some("with `channels=rgb`, they"),
        ),
        ("shift=-1.28:1.32,focal=1.2", Some("`focal=")),
        ("shift=-1.28:1.32,colors=dc-uncentered", Some("`colors=dc`")),
    ] {
        let said = case.run(&format!(
            "sharp-bench run -q --dataset {data} --limit 1 --method gaussians:dir=g,{setting} --metrics psnr --out r"
        ));
        assert_eq!(said.code, 0, "{}", said.err);
        let warnings: Vec<&str> = said
            .err
            .lines()
            .filter(|line| line.contains("method 'gaussians'"))
            .collect();
        match mends {
            None => assert!(warnings.is_empty(), "{}", said.err),
            Some(mends) => assert!(
                warnings.iter().any(|line| line.contains(mends)),
                "{}",
                said.err
            ),
        }
        case.run("rm -r r").ends_with(0);
    }
}

#[test]
fn gaussians_that_would_take_minutes_to_draw_are_noticed_and_many_small_ones_are_not() {
    let case = empty();
    let write = |count: usize, scale: f32| {
        let row = |i: usize| {
            let x = (i % 100) as f32 / 50.0 - 1.0;
            let y = (i / 100 % 100) as f32 / 50.0 - 1.0;
            let opacity = -7.0 - x;
            [
                x, y, 3.0, 0.0, 0.0, 0.0, opacity, scale, scale, scale, 1.0, 0.0, 0.0, 0.0,
            ]
        };
        let text = ascii_ply(&(0..count).map(row).collect::<Vec<_>>());
        std::fs::create_dir_all(case.path("g/synthetic/seed0")).unwrap();
        for view in 0..8 {
            let file = format!("g/synthetic/seed0/view_0{view}.ply");
            std::fs::write(case.path(&file), &text).unwrap();
        }
    };
    let run = |out: &str| {
        case.run(&format!(
            "sharp-bench run -q --no-check --dataset synthetic=size=32x24,views=8 --scenes seed0 --limit 1 \
             --method gaussians:dir=g,color_space=srgb --metrics psnr --out {out}"
        ))
    };
    write(9000, 0.0);
    let said = run("wide");
    assert!(
        said.err.contains("of its Gaussians cover each pixel"),
        "{}{}",
        said.out,
        said.err
    );
    write(9000, -5.0);
    let said = run("small");
    assert!(!said.err.contains("cover each pixel"), "{}", said.err);
}

/// Two of eight sources have the file of another source; neither is the first, the middle or the
/// last of their dataset.
#[test]
fn wrong_files_among_right_ones_are_named_by_run_and_merge() {
    let case = empty();
    let data = "synthetic=size=96x72,views=8,scenes=1";
    case.run(&format!(
        "sharp-bench cameras export -q --dataset {data} --out e && sharp-bench predict -q --checkpoint mini --focal-px 86.4 \
         --out g/synthetic/seed0 e/synthetic/seed0/view_0[0-7].png"
    ))
    .ends_with(0);
    let options = format!(
        "--dataset {data} --pair-options sets=whole,threshold=0,at-threshold=in,limit=all --method gaussians:dir=g,shift=-0.77:0.79 --metrics psnr"
    );
    let run = |out: &str| {
        case.run(&format!("sharp-bench run -q {options} --out {out}"))
            .ends_with(0)
    };
    let said = run("right");
    assert!(!said.err.contains("method 'gaussians'"), "{}", said.err);
    let grey: Vec<[f32; 14]> = (0..900)
        .map(|i| {
            let (x, y) = ((i % 30) as f32 / 15.0 - 1.0, (i / 30) as f32 / 15.0 - 1.0);
            [
                x, y, 1.5, -1.7, -1.7, -1.7, 4.0, -3.0, -3.0, -3.0, 1.0, 0.0, 0.0, 0.0,
            ]
        })
        .collect();
    std::fs::write(case.path("grey.ply"), ascii_ply(&grey)).unwrap();
    for view in ["view_01", "view_05"] {
        case.run(&format!(
            "rm g/synthetic/seed0/{view}.ply && sharp-bench gaussians convert grey.ply g/synthetic/seed0/{view}.ply \
             --color-space linear"
        ))
        .ends_with(0);
    }
    let text = "the Gaussians of 2 of 8 sources";
    let said = vec![run("wrong")];
    assert_eq!(said[0].err.matches(text).count(), 1, "{}", said[0].err);
    let named = "(synthetic/seed0/view_01, synthetic/seed0/view_05) reproduce the source's photograph at only ";
    assert!(said[0].err.contains(named), "{}", said[0].err);
    let all = case.having(said);
    all.is_said_everywhere("wrong", text);
    // Shards give the same result once they are joined.
    all.run(&format!("sharp-bench run -q {options} --out p --plan-only"))
        .ends_with(0);
    for shard in ["1/2", "2/2"] {
        let said = all.run(&format!("sharp-bench run -q --plan p --shard {shard}"));
        assert!(!said.ends_with(0).err.contains(text));
    }
    let merged = all.run("sharp-bench merge p").ends_with(0);
    assert!(merged.err.contains(text), "{}", merged.err);
    let scores = |run: &str| std::fs::read(all.path(run).join("scores.csv")).unwrap();
    assert!(scores("p") == scores("wrong"));
}

/// A world whose first camera is at its origin, in millimetres, in feet and in an arbitrary unit:
/// only the unit is wrong.
#[test]
fn units_are_mended_by_scale() {
    for (name, settings) in [("00-good", ""), ("A14-world", ",space=world")] {
        for (unit, mends) in [(1000.0_f32, "scale=0.001"), (5.0, "scale=0.2")] {
            let case = untried(name);
            let path = case.path("g/synthetic/seed0/view_00.ply");
            let mut bytes = std::fs::read(&path).unwrap();
            let end = b"end_header\n";
            let start = bytes
                .windows(end.len())
                .position(|part| part == end)
                .unwrap();
            let rows = bytes[start + end.len()..].as_chunks_mut::<56>().0;
            for row in rows {
                for (at, value) in row.as_chunks_mut::<4>().0.iter_mut().enumerate() {
                    let stored = f32::from_le_bytes(*value);
                    let scaled = match at {
                        0..3 => stored * unit,
                        7..10 => stored + unit.ln(),
                        _ => stored,
                    };
                    *value = scaled.to_le_bytes();
                }
            }
            std::fs::write(&path, bytes).unwrap();
            let method = format!("gaussians:dir=g,color_space=srgb{settings}");
            let said = vec![run_method(&case, &method, "r")];
            ends(&said[0], 0);
            let wrong = ["scales=linear", "log-variance"];
            assert!(
                !wrong.iter().any(|part| said[0].err.contains(part)),
                "{}",
                said[0].err
            );
            let case = case.having(said);
            case.is_said_everywhere("r", &format!("use `{mends}`"));
            close(with(&case, &format!("{mends}{settings}")), 19.0306);
        }
    }
}
