//! Wrong rules and wrong readings, as far as a rule or a scene can express them. Each must change
//! some picture by the amount that the oracle computed.

use super::colors::{eye, in_directions, mean, painted};
use super::golden::{Golden, SCENES, folder};
use glam::DVec3;
use serde_json::Value;
use sharp::color::linear_from_srgb;
use sharp::gaussians::Gaussians;
use sharp::ply::ColorSpace;
use sharp::render::{
    Background, Compensation, CpuRenderer, JacobianClamp, PrincipalPoint, RenderView, Renderer,
    Support,
};

type Mutation = fn(&mut Gaussians, &mut RenderView);

/// Mutations by their names in the manifest.
pub(crate) const ALL: [(&str, Mutation); 23] = [
    ("no_low_pass", |_, view| view.rule.low_pass = 0.0),
    ("compensation", |_, view| {
        view.rule.compensation = Compensation::FlooredRoot;
    }),
    ("no_compensation", |_, view| {
        view.rule.compensation = Compensation::None;
    }),
    ("alpha_max_0.99", |_, view| view.rule.alpha_max = 0.99),
    ("alpha_max_0.999", |_, view| view.rule.alpha_max = 0.999),
    ("near_0.01_for_0.2", |_, view| view.rule.near = 0.01),
    ("jacobian_not_clamped", |_, view| {
        view.rule.jacobian_clamp = JacobianClamp::None;
    }),
    ("jacobian_clamp_at_image", |_, view| {
        view.rule.jacobian_clamp = JacobianClamp::Image;
    }),
    ("jacobian_clamp_symmetric", |_, view| {
        view.rule.jacobian_clamp = JacobianClamp::Symmetric;
    }),
    ("principal_point_ignored", |_, view| {
        view.rule.principal_point = PrincipalPoint::Ignored;
    }),
    ("half_pixel", |_, view| {
        let k = &mut view.intrinsics;
        if view.rule.principal_point == PrincipalPoint::Ignored {
            (k.cx, k.cy) = (f64::from(k.width) / 2.0, f64::from(k.height) / 2.0);
            view.rule.principal_point = PrincipalPoint::Used;
        }
        k.cx -= 0.5;
        k.cy -= 0.5;
    }),
    ("exact_support", |_, view| {
        view.rule.support = Support::Exact
    }),
    ("dc_only", |_, view| view.rule.degree = 0),
    ("f_rest_interleaved", |scene, _| {
        let each = scene.harmonics.per_gaussian();
        for of_one in scene.harmonics.coefficients.chunks_mut(each) {
            let by_channel: Vec<f32> = (0..3)
                .flat_map(|c| of_one.iter().map(move |rgb| rgb[c]))
                .collect();
            of_one.copy_from_slice(by_channel.as_chunks().0);
        }
    }),
    ("quat_read_as_xyzw", |scene, _| {
        for quaternion in &mut scene.quaternions {
            quaternion.rotate_right(1);
        }
    }),
    ("no_half", |scene, _| {
        for color in &mut scene.colors {
            *color = color.map(|v| v - 0.5);
        }
    }),
    ("dir_negated", |scene, view| {
        let eye = eye(view);
        *scene = painted(scene, in_directions(scene, |k| eye - mean(scene, k)));
    }),
    ("dir_camera_space", |scene, view| {
        let camera = view.camera_from_scene;
        let seen = in_directions(scene, |k| camera.transform_point3(mean(scene, k)));
        *scene = painted(scene, seen);
    }),
    ("dir_forward_axis", |scene, view| {
        let forward = view.camera_from_scene.matrix3.transpose() * DVec3::Z;
        *scene = painted(scene, in_directions(scene, |_| forward));
    }),
    ("dir_without_camera", |scene, _| {
        *scene = painted(scene, in_directions(scene, |k| mean(scene, k)));
    }),
    ("no_clamp_at_0", |scene, view| {
        *scene = painted(scene, true_colors(scene, view));
        // The only colours that are not clipped.
        view.rule.blending = ColorSpace::Linear;
    }),
    (BLEND_LINEAR, |scene, view| {
        let seen = true_colors(scene, view).into_iter();
        let linear = seen.map(|rgb| rgb.map(|v| linear_from_srgb(v.max(0.0))));
        *scene = painted(scene, linear.collect());
        view.rule.blending = ColorSpace::Linear;
    }),
    ("clamp_at_1", |scene, view| {
        let seen = true_colors(scene, view).into_iter();
        *scene = painted(scene, seen.map(|rgb| rgb.map(|v| v.min(1.0))).collect());
    }),
];

/// A shifted principal point also shifts the bounds of the Jacobian, which the oracle does not
/// model.
const EXPECTED_WITHIN: f64 = 2e-3;

/// The only mutation for which colours are encoded after blending instead of before.
const BLEND_LINEAR: &str = "blend_linear";

fn true_colors(scene: &Gaussians, view: &RenderView) -> Vec<[f32; 3]> {
    let eye = eye(view);
    in_directions(scene, |k| mean(scene, k) - eye)
}

/// Renders every picture that the mutation changes according to the manifest.
pub(crate) fn shows(name: &str, mutation: Mutation) {
    let text = std::fs::read_to_string(folder().join("manifest.json")).unwrap();
    let manifest: Value = serde_json::from_str(&text).unwrap();
    let mut seen = 0;
    for (scene_name, tolerance, _) in SCENES {
        let golden = Golden::load(scene_name);
        for picture in &golden.pictures {
            let of_picture = &manifest["scenes"][scene_name]["images"][&picture.title];
            let Some(expected) = of_picture["mutations"][name][0].as_f64() else {
                continue;
            };
            let (mut scene, mut view) = (golden.scene.clone(), picture.view);
            mutation(&mut scene, &mut view);
            let found = CpuRenderer::new().render(&scene, &view).unwrap();
            let rgb = match name {
                BLEND_LINEAR => {
                    let behind = golden.background.in_space(ColorSpace::Srgb);
                    found.srgb(Background::Color(behind.map(linear_from_srgb)))
                }
                _ => found.composited(golden.background),
            };
            let deviation = golden.deviation_of(&picture.title, &found, rgb.as_raw());
            let story = format!("{scene_name} {}: {deviation:?}", picture.title);
            println!("{name} {story}, {expected}");
            assert!(deviation.firm > tolerance, "{story}");
            let off = f64::from(deviation.color) - expected;
            assert!(
                off.abs() < EXPECTED_WITHIN,
                "{name} {story}, not {expected}"
            );
            seen += 1;
        }
    }
    assert!(seen > 0);
}
