//! Gaussians as other programs store them: layouts and spaces, views used for training, cameras
//! that the programs do not support.

use std::path::Path;

use glam::{DAffine3, DMat3, DQuat, DVec3, EulerRot};
use sharp::camera::Intrinsics;
use sharp::gaussian_files::load;
use sharp::ply::{ColorSpace, GaussianScene, PlyForm, StoredForm, to_bytes};
use sharp_datasets::View;
use sharp_datasets::synthetic::{SyntheticOptions, SyntheticScene};

use super::{Case, case, empty, untried};

const PAIR: &str = "synthetic/seed0/view_00__view_01";

/// Runs the single pair with the given methods, which must not cause warnings, and returns a column
/// of the scores.
fn column(case: &Case, methods: &[&str], column: &str) -> Vec<f64> {
    let methods: Vec<String> = methods
        .iter()
        .map(|method| format!("--method \"gaussians:{method}\""))
        .collect();
    let said = case.run(&format!(
        "rm -rf out; sharp-bench run -q --dataset synthetic=size=64x48,views=8 --pairs pairs.csv {} --metrics psnr --out out",
        methods.join(" ")
    ));
    assert_eq!(said.code, 0, "{}{}", said.out, said.err);
    assert!(!said.err.contains("warning"), "{}", said.err);
    let scores = case.scores("out", column);
    scores
        .iter()
        .map(|value| value.parse().unwrap_or(f64::NAN))
        .collect()
}

fn psnr(case: &Case, method: &str) -> f64 {
    column(case, &[method], "psnr")[0]
}

fn near(found: f64, expected: f64, within: f64) {
    assert!(
        (found - expected).abs() < within,
        "{found} instead of {expected}"
    );
}

/// The Gaussians of a case, in the file's own space.
fn scene(case: &Case) -> GaussianScene {
    let reading = StoredForm {
        blending: ColorSpace::Srgb,
        ..StoredForm::from(Some(ColorSpace::Srgb))
    };
    load(&case.path("g/synthetic/seed0/view_00.ply"), reading).unwrap()
}

/// Applies a rotation, a uniform scale and a shift.
fn moved(mut scene: GaussianScene, map: DAffine3) -> GaussianScene {
    let (scale, rotation, _) = map.to_scale_rotation_translation();
    for mean in &mut scene.gaussians.means {
        *mean = map
            .transform_point3(DVec3::from(mean.map(f64::from)))
            .as_vec3()
            .to_array();
    }
    for scales in &mut scene.gaussians.scales {
        *scales = scales.map(|s| s * scale.x as f32);
    }
    for [w, x, y, z] in &mut scene.gaussians.quaternions {
        let own = DQuat::from_xyzw((*x).into(), (*y).into(), (*z).into(), (*w).into());
        let [a, b, c, d] = (rotation * own).to_array();
        [*w, *x, *y, *z] = [d, a, b, c].map(|v| v as f32);
    }
    scene
}

/// Stores opacities from 0 to 1 in their column.
fn with_plain_opacities(mut scene: GaussianScene) -> GaussianScene {
    for opacity in &mut scene.gaussians.opacities {
        // The writer stores the logit of this value.
        *opacity = 1.0 / (1.0 + (-*opacity).exp());
    }
    scene
}

fn write(case: &Case, file: &str, scene: &GaussianScene, comment: &str) {
    let path = case.path(file);
    std::fs::create_dir_all(path.parent().unwrap()).unwrap();
    let bytes = to_bytes(scene, PlyForm::Plain);
    let at = bytes.windows(7).position(|w| w == b"element").unwrap();
    let whole = [&bytes[..at], comment.as_bytes(), &bytes[at..]].concat();
    std::fs::write(path, whole).unwrap();
}

/// A view of the dataset of these cases.
fn view(id: &str) -> View {
    let options = SyntheticOptions {
        width: 64,
        height: 48,
        views: 8,
        ..SyntheticOptions::default()
    };
    let scene = SyntheticScene::new(options).unwrap();
    let found = scene.views().iter().find(|view| view.id == id);
    found.unwrap().clone()
}

/// The settings of `bench/docs/recipes.md`, with files in the layouts of these programs.
#[test]
fn files_of_other_programs_are_evaluated_by_the_settings_of_the_docs() {
    let docs = Path::new(env!("CARGO_MANIFEST_DIR")).join("docs/recipes.md");
    let docs = std::fs::read_to_string(docs).unwrap();
    let (own, world) = (untried("00-good"), untried("A14-world"));
    let of_rule = |case: &Case, settings: &str| {
        psnr(
            case,
            &format!("dir=g,color_space=srgb,train=source,{settings}"),
        )
    };
    let classic = of_rule(&world, "space=world,rendering=gsplat-classic");
    let first = view("view_00");
    let (camera, in_world) = (|| scene(&own), || scene(&world));
    let turn = DAffine3::from_scale_rotation_translation(
        DVec3::splat(0.4),
        DQuat::from_euler(EulerRot::XYZ, 0.3, -1.2, 2.0),
        DVec3::new(0.5, -0.2, 0.1),
    );
    let rotation = DAffine3::from_mat3(DMat3::from_quat(
        first
            .camera_from_world
            .to_affine()
            .to_scale_rotation_translation()
            .1,
    ));
    let rows = |map: DAffine3| {
        let m = map.matrix3.transpose();
        let t = map.translation;
        [(m.x_axis, t.x), (m.y_axis, t.y), (m.z_axis, t.z)].map(|(row, t)| [row.x, row.y, row.z, t])
    };
    let similarity = DAffine3::from_mat3_translation(turn.matrix3 / 0.4, turn.translation / 0.4);
    let parser = serde_json::json!({ "transform": rows(similarity), "scale": 0.4 });
    let [a, b, c] = rows(rotation.inverse());
    let back = serde_json::json!([a, b, c, [0.0, 0.0, 0.0, 1.0]]);
    let half_turn = DAffine3::from_rotation_z(std::f64::consts::PI);
    let table = "\
3DGS | seed0/point_cloud/iteration_30000/point_cloud.ply | space=world,rendering=inria-general,file={scene}/point_cloud/iteration_30000/point_cloud.ply
gsplat | seed0.ply | space=world,rendering=gsplat-classic,file={scene}.ply
nerfstudio | seed0/splat.ply | space=world,rendering=gsplat-classic,file={scene}/splat.ply,transform={scene}/dataparser_transforms.json
brush | seed0/export_30000.ply | space=world,file={scene}/export_30000.ply
SuperSplat | seed0.ply | space=world,rendering=gsplat-classic,file={scene}.ply,axes=luf
DepthSplat | seed0.ply | space=world,rendering=gsplat-classic,file={scene}.ply,transform=first_camera.json
ffgs | seed0.ply | space=world,rendering=gsplat-classic,file={scene}.ply
NoPoSplat | synthetic/seed0/view_00__view_01.ply | opacity=linear,rendering=gsplat-classic,file={pair}.ply
AnySplat | seed0.ply | opacity=linear,rendering=gsplat-classic,file={scene}.ply,depth=privileged,align=pose";
    for [program, file, settings] in sharp_tests::rows(table) {
        let in_world_by = |rule: &str| of_rule(&world, &format!("space=world,rendering={rule}"));
        let (made, expected) = match program {
            "3DGS" => (in_world(), in_world_by("inria-general")),
            "nerfstudio" => (moved(in_world(), turn), classic),
            "brush" => (in_world(), in_world_by("brush-mip")),
            "SuperSplat" => (moved(in_world(), half_turn), classic),
            "DepthSplat" => (moved(in_world(), rotation), classic),
            "NoPoSplat" => {
                let expected = of_rule(&own, "rendering=gsplat-classic");
                (with_plain_opacities(camera()), expected)
            }
            "AnySplat" => {
                let larger = moved(camera(), DAffine3::from_scale(DVec3::splat(2.5)));
                let rule = "rendering=gsplat-classic,depth=privileged,align=pose";
                (with_plain_opacities(larger), of_rule(&own, rule))
            }
            _ => (in_world(), classic),
        };
        assert!(
            docs.contains(&format!("`{settings}`")),
            "{program}: {settings} is not in recipes.md"
        );
        let case = empty();
        std::fs::copy(own.path("pairs.csv"), case.path("pairs.csv")).unwrap();
        std::fs::write(case.path("first_camera.json"), back.to_string()).unwrap();
        let comment = match program {
            "brush" => "comment Exported from Brush\ncomment SplatRenderMode: mip\n",
            _ => "",
        };
        write(&case, &format!("p/{file}"), &made, comment);
        if program == "nerfstudio" {
            std::fs::write(
                case.path("p/seed0/dataparser_transforms.json"),
                parser.to_string(),
            )
            .unwrap();
        }
        let found = psnr(&case, &format!("dir=p,{settings}"));
        assert!(
            (found - expected).abs() < 0.02,
            "{program}: {found} instead of {expected}"
        );
    }
}

#[test]
fn gaussians_in_the_targets_space_are_one_file_a_pair() {
    let case = untried("00-good");
    let [first, second] = ["view_00", "view_01"].map(|id| view(id).camera_from_world.to_affine());
    let target = moved(scene(&case), second * first.inverse());
    write(&case, &format!("t/{PAIR}.ply"), &target, "");
    let found = psnr(&case, "dir=t,color_space=srgb,space=target");
    near(found, 19.0306, 1e-3);
}

#[test]
fn a_principal_point_that_only_the_file_has_is_named() {
    let case = untried("00-good");
    let own = view("view_00").intrinsics;
    let mut made = scene(&case);
    made.intrinsics = Some(Intrinsics {
        cx: own.cx + 5.0,
        cy: own.cy - 2.5,
        ..own
    });
    let file = case.path("g/synthetic/seed0/view_00.ply");
    std::fs::write(&file, to_bytes(&made, PlyForm::Release)).unwrap();
    let run = |settings: &str| {
        case.run(&format!(
            "rm -rf r; sharp-bench run -q --dataset synthetic=size=64x48,views=8 --pairs pairs.csv --metrics psnr --out r \
             --method gaussians:dir=g{settings}"
        ))
    };
    let said = run("");
    assert!(
        said.out.contains("`shift=5:-2.5` corrects this"),
        "{}{}",
        said.out,
        said.err
    );
    made.intrinsics = Some(own);
    std::fs::write(&file, to_bytes(&made, PlyForm::Release)).unwrap();
    let said = run("");
    assert!(!(said.out + &said.err).contains("shift="));
}

#[test]
fn a_scene_moved_by_three_pixels_comes_back_with_align() {
    let case = case("A10-good");
    let unmoved = psnr(&case, "dir=g,color_space=srgb");
    near(unmoved, 20.9783, 1e-3);
    let aligned = psnr(&case, "dir=g,color_space=srgb,align=pose");
    assert!(aligned >= unmoved, "{aligned}");
    let k = view("view_01").intrinsics;
    let three_pixels = (3.0 / k.fx).atan();
    let turned = moved(scene(&case), DAffine3::from_rotation_y(three_pixels));
    let aside = moved(
        scene(&case),
        DAffine3::from_translation(DVec3::new(0.0, 3.0 * 4.65 / k.fy, 0.0)),
    );
    for (folder, scene) in [("turned", turned), ("aside", aside)] {
        write(
            &case,
            &format!("{folder}/synthetic/seed0/view_00.ply"),
            &scene,
            "",
        );
        let said = case.run(&format!(
            "rm -rf out; sharp-bench run -q --dataset synthetic=size=64x48,views=8 --pairs pairs.csv --metrics psnr --out out \
             --method gaussians:label=mine,dir={folder},color_space=srgb,align=pose"
        ));
        assert_eq!(said.code, 0, "{}", said.err);
        // The unaligned method is in the table too.
        assert_eq!(case.scores("out", "method"), ["mine", "mine-unaligned"]);
        let found: Vec<f64> = case
            .scores("out", "psnr")
            .iter()
            .map(|v| v.parse().unwrap())
            .collect();
        assert!(found[1] < unmoved - 3.0, "{found:?}");
        near(found[0], aligned, 0.1);
        let moved: Vec<String> = case.scores("out", "pose_rotation_deg");
        assert!(
            moved[0].parse::<f64>().is_ok() && moved[1].is_empty(),
            "{moved:?}"
        );
    }
    case.run("sharp-bench report -q out").ends_with(0);
    let report = std::fs::read_to_string(case.path("out/report/report.md")).unwrap();
    let said = "the target's camera moved to fit its photograph";
    assert_eq!(report.matches(said).count(), 1, "{report}");
}

#[test]
fn scenes_of_several_views_say_so_and_name_targets_they_were_trained_on() {
    let case = untried("A14-world");
    let folder = case.path("g/synthetic");
    std::fs::rename(folder.join("seed0/view_00.ply"), folder.join("seed0.ply")).unwrap();
    std::fs::write(
        case.path("train.txt"),
        "seed0/view_00.png\nseed0/view_0[1]\nseed0/view_01.png\n",
    )
    .unwrap();
    let line = |more: &str| {
        format!(
            "rm -rf r; sharp-bench run -q --dataset synthetic=size=64x48,views=8 --pairs pairs.csv --metrics psnr --out r \
             --method gaussians:dir=g,color_space=srgb,space=world{more}"
        )
    };
    let manifest = |more: &str| {
        let said = case.run(&line(more));
        assert_eq!(said.code, 0, "{}", said.err);
        (
            said.err,
            std::fs::read_to_string(case.path("r/manifest.json")).unwrap(),
        )
    };
    let (said, several) = manifest("");
    assert!(several.contains("\"several_views\": true"), "{several}");
    assert!(!said.contains("trained"), "{said}");
    assert!(!manifest(",train=source").1.contains("several_views"));
    assert!(!manifest(",train='view_00'").1.contains("trained on"));
    for train in ["train.txt", "view_0?", "seed0/*"] {
        let said = case.run(&line(&format!(",train='{train}'")));
        let text = "1 of 1 targets are views that the method was trained on";
        let named = format!("{text} (view_01)");
        assert!(
            (said.out.clone() + &said.err).contains(&named),
            "{train}: {}",
            said.err
        );
        let manifest = std::fs::read_to_string(case.path("r/manifest.json")).unwrap();
        assert!(manifest.contains(&named), "{manifest}");
        case.run("sharp-bench report -q r").ends_with(0);
        let report = std::fs::read_to_string(case.path("r/report/report.md")).unwrap();
        assert!(
            report.contains(text) && report.contains("sees several views"),
            "{report}"
        );
    }
}
