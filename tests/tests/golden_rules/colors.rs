//! The colour of a Gaussian in any direction, measured in a picture of that Gaussian alone.

use glam::{DAffine3, DQuat, DVec3};
use sharp::camera::Intrinsics;
use sharp::gaussians::Gaussians;
use sharp::render::{CpuRenderer, RenderView, Renderer, Rule};

/// Added to colours while rendering, so that none is clipped at 0.
const LIFT: f32 = 4.0;

/// The colours of all Gaussians in the given directions, in the axes of the means, before clipping.
pub(crate) fn in_directions(
    scene: &Gaussians,
    direction: impl Fn(usize) -> DVec3,
) -> Vec<[f32; 3]> {
    let intrinsics = Intrinsics::new((8.0, 8.0), (0.5, 0.5), (1, 1)).unwrap();
    let rule = Rule {
        degree: 4,
        ..Rule::SHARP
    };
    let mut renderer = CpuRenderer::new();
    let each = 0..scene.len();
    each.map(|k| {
        let ahead = direction(k).normalize();
        let mut one = scene.subset(&[k]);
        one.means[0] = ahead.as_vec3().to_array();
        one.scales[0] = [1.0; 3];
        one.quaternions[0] = [1.0, 0.0, 0.0, 0.0];
        one.opacities[0] = 0.5;
        one.colors[0] = one.colors[0].map(|v| v + LIFT);
        let turn = DQuat::from_rotation_arc(ahead, DVec3::Z);
        let view = RenderView {
            rule,
            ..RenderView::new(DAffine3::from_quat(turn), intrinsics)
        };
        let found = renderer.render(&one, &view).unwrap();
        found.rgb[0].map(|v| v / found.alpha[0] - LIFT)
    })
    .collect()
}

/// Position of the camera.
pub(crate) fn eye(view: &RenderView) -> DVec3 {
    view.camera_from_scene.inverse().translation
}

pub(crate) fn mean(scene: &Gaussians, k: usize) -> DVec3 {
    DVec3::from_array(scene.means[k].map(f64::from))
}

/// The scene with these colours, equal from all sides.
pub(crate) fn painted(scene: &Gaussians, colors: Vec<[f32; 3]>) -> Gaussians {
    let mut painted = Gaussians {
        colors,
        ..scene.clone()
    };
    painted.harmonics = sharp::gaussians::Harmonics::default();
    painted
}
