//! Properties that hold for any scene, and scenes that are meant to break the renderer.

#![allow(
    clippy::unwrap_used,
    clippy::panic,
    reason = "test code outside of #[test] functions"
)]

mod render_support;

use glam::{DAffine3, DMat3, DVec3};
use render_support::drops::{self, one};
use render_support::random::{Random, Recipe, make_extreme, movement, scene, view};
use render_support::reference;
use sharp::camera::{Intrinsics, RigidTransform, target_camera_from_source_ndc};
use sharp::gaussians::Gaussians;
use sharp::render::{CpuRenderer, RenderError, RenderOutput, RenderView, Renderer};

const COMMON: Recipe = Recipe {
    count: 300,
    scales: (0.004, 0.2),
    opacities: (0.0, 1.0),
};

fn joined(a: &Gaussians, b: &Gaussians) -> Gaussians {
    let mut all = a.clone();
    all.means.extend(&b.means);
    all.quaternions.extend(&b.quaternions);
    all.scales.extend(&b.scales);
    all.opacities.extend(&b.opacities);
    all.colors.extend(&b.colors);
    all
}

fn largest_difference(a: &RenderOutput, b: &RenderOutput) -> f32 {
    let flat = |o: &RenderOutput| -> Vec<f32> {
        let colors = o.rgb.iter().flatten().copied();
        colors.chain(o.alpha.iter().copied()).collect()
    };
    let (a, b) = (flat(a), flat(b));
    assert_eq!(a.len(), b.len());
    a.iter()
        .zip(&b)
        .fold(0.0, |worst, (a, b)| worst.max((a - b).abs()))
}

fn render_cpu(scene: &Gaussians, view: &RenderView) -> Result<RenderOutput, RenderError> {
    CpuRenderer::new().render(scene, view)
}

#[test]
fn random_scenes_equal_the_reference() {
    for seed in 0..24 {
        let mut random = Random(seed);
        let scene = scene(&mut random, COMMON);
        let size = [(33, 27), (64, 64), (65, 40), (7, 90)][seed as usize % 4];
        let eps2d = [0.0, 0.01, 0.3][seed as usize % 3];
        let mut view = view(size.0, size.1);
        view.rule.low_pass = eps2d;
        view.camera_from_scene = movement(&mut random);
        let truth = reference::render(&scene, &view);
        truth.assert_close(&render_cpu(&scene, &view).unwrap(), &format!("seed {seed}"));
        assert!(truth.fragile_share() < 0.2, "{}", truth.fragile_share());
    }
}

#[test]
fn needles_and_discs_equal_the_reference() {
    for seed in 100..124 {
        let mut random = Random(seed);
        // Elongations of up to 5000; most Gaussians are far thinner than a pixel.
        let recipe = Recipe {
            count: 400,
            scales: (0.0002, 1.0),
            opacities: (0.3, 1.0),
        };
        let scene = scene(&mut random, recipe);
        let mut view = view(81, 61);
        view.camera_from_scene = movement(&mut random);
        let truth = reference::render(&scene, &view);
        truth.assert_close(&render_cpu(&scene, &view).unwrap(), &format!("seed {seed}"));
        assert!(truth.fragile_share() < 0.5, "{}", truth.fragile_share());
    }
}

#[test]
fn the_affine_form_equals_the_reference_and_the_rigid_form() {
    for seed in 200..206 {
        let mut random = Random(seed);
        let source = Intrinsics::new((50.0, 52.0), (30.0, 28.5), (64, 60)).unwrap();
        let target = view(49, 55);
        let moved = movement(&mut random);
        let target_from_source = RigidTransform::new(moved.matrix3, moved.translation).unwrap();
        let mut placed = target;
        placed.camera_from_scene = target_camera_from_source_ndc(&source, &target_from_source);
        let scene = scene(&mut random, COMMON);
        let truth = reference::render(&scene, &placed);
        let found = render_cpu(&scene, &placed).unwrap();
        truth.assert_close(&found, &format!("seed {seed}"));

        // Round Gaussians under a uniform scale can be moved into metric space without loss.
        let mut balls = scene.clone();
        for scale in &mut balls.scales {
            *scale = [scale[0]; 3];
        }
        let half = DAffine3::from_scale(DVec3::splat(0.5));
        let mut shrunk = balls.clone();
        for mean in &mut shrunk.means {
            *mean = mean.map(|v| v * 0.5);
        }
        for scale in &mut shrunk.scales {
            *scale = scale.map(|v| v * 0.5);
        }
        let rigid = render_cpu(&shrunk, &target).unwrap();
        let affine = RenderView {
            camera_from_scene: target.camera_from_scene * half,
            ..target
        };
        assert_eq!(rigid, render_cpu(&balls, &affine).unwrap());
    }
}

#[test]
fn invisible_gaussians_change_nothing() {
    let mut random = Random(1);
    let visible = scene(&mut random, COMMON);
    let mut clear = scene(&mut random, COMMON);
    clear.opacities.fill(0.0);
    let mut behind = scene(&mut random, COMMON);
    for mean in &mut behind.means {
        mean[2] = -mean[2];
    }
    let view = view(50, 40);
    let expected = render_cpu(&visible, &view).unwrap();
    let found = render_cpu(&joined(&visible, &joined(&clear, &behind)), &view).unwrap();
    assert_eq!(found.rgb, expected.rgb);
    assert_eq!(found.depth_acc, expected.depth_acc);
    assert_eq!(
        found.dropped.transparent,
        expected.dropped.transparent + 300
    );
    assert_eq!(found.dropped.near, 300);
}

#[test]
fn what_lies_behind_an_opaque_wall_changes_nothing() {
    let wall = joined(
        &one([0.0, 0.0, 1.0], [50.0; 3], 0.9999),
        &one([0.0, 0.0, 1.1], [50.0; 3], 0.9999),
    );
    let view = view(20, 20);
    let alone = render_cpu(&wall, &view).unwrap();
    // 0.999 twice would leave 1e-6; the second one stops the pixel and is not added.
    assert!(alone.alpha.iter().all(|a| (a - 0.999).abs() < 1e-6));
    let mut random = Random(2);
    let mut far = scene(&mut random, COMMON);
    for mean in &mut far.means {
        mean[2] += 2.0;
    }
    let found = render_cpu(&joined(&far, &wall), &view).unwrap();
    assert_eq!(found.rgb, alone.rgb);
}

#[test]
fn depth_slices_composite_to_the_whole() {
    let mut random = Random(3);
    // The Gaussians are so faint that blending stops early at no pixel.
    let faint = Recipe {
        opacities: (0.0, 0.1),
        count: 120,
        ..COMMON
    };
    let all = scene(&mut random, faint);
    let near = all.filtered(|k| all.means[k][2] < 2.2);
    let far = all.filtered(|k| all.means[k][2] >= 2.2);
    let view = view(60, 44);
    let [whole, near, far] = [all, near, far].map(|s| render_cpu(&s, &view).unwrap());
    for i in 0..whole.alpha.len() {
        let through = 1.0 - near.alpha[i];
        for channel in 0..3 {
            let by_hand = near.rgb[i][channel] + through * far.rgb[i][channel];
            assert!((whole.rgb[i][channel] - by_hand).abs() < 2e-6);
        }
        let depth = near.depth_acc[i] + through * far.depth_acc[i];
        assert!((whole.depth_acc[i] - depth).abs() < 1e-5);
        assert!((whole.alpha[i] - (near.alpha[i] + through * far.alpha[i])).abs() < 2e-6);
    }
}

#[test]
fn a_mirrored_world_gives_the_mirrored_picture() {
    let mut random = Random(4);
    let scene = scene(&mut random, COMMON);
    let straight = view(45, 38);
    let mut mirrored = straight;
    mirrored.camera_from_scene = DAffine3::from_scale(DVec3::new(-1.0, 1.0, 1.0));
    mirrored.intrinsics.cx = 45.0 - straight.intrinsics.cx;
    let a = render_cpu(&scene, &straight).unwrap();
    let mut b = render_cpu(&scene, &mirrored).unwrap();
    for y in 0..38 {
        b.rgb[y * 45..(y + 1) * 45].reverse();
        b.alpha[y * 45..(y + 1) * 45].reverse();
    }
    assert!(largest_difference(&a, &b) < 2e-5);
}

#[test]
fn a_crop_is_a_window_of_the_whole() {
    let mut random = Random(5);
    let mut scene = scene(&mut random, COMMON);
    // All means are within the crop's field of view, because the Jacobian's clamp depends on the
    // picture's size.
    for mean in &mut scene.means {
        mean[0] *= 0.3;
        mean[1] *= 0.3;
    }
    let whole = view(160, 150);
    let (x0, y0, w, h) = (37, 29, 90, 94);
    let mut part = whole;
    part.intrinsics.cx -= f64::from(x0);
    part.intrinsics.cy -= f64::from(y0);
    (part.intrinsics.width, part.intrinsics.height) = (w, h);
    let a = render_cpu(&scene, &whole).unwrap();
    let b = render_cpu(&scene, &part).unwrap();
    let mut worst = 0.0_f32;
    for y in 0..h as usize {
        for x in 0..w as usize {
            let i = (y + y0 as usize) * 160 + x + x0 as usize;
            worst = worst.max((a.alpha[i] - b.alpha[y * w as usize + x]).abs());
        }
    }
    assert!(worst < 2e-5, "{worst:e}");
}

#[test]
fn one_colour_stays_one_colour_and_alpha_stays_below_one() {
    let mut random = Random(6);
    let mut wall = scene(
        &mut random,
        Recipe {
            count: 2000,
            opacities: (0.5, 1.0),
            ..COMMON
        },
    );
    wall.colors.fill([0.25, 0.5, 1.0]);
    for mean in &mut wall.means {
        // Moves the mean to a plane at 2 m.
        *mean = [mean[0] * 2.0 / mean[2], mean[1] * 2.0 / mean[2], 2.0];
    }
    let found = render_cpu(&wall, &view(96, 72)).unwrap();
    for i in 0..found.alpha.len() {
        let alpha = found.alpha[i];
        assert!((0.0..=0.9999).contains(&alpha), "{alpha}");
        let expected = [0.25, 0.5, 1.0].map(|c| c * alpha);
        for channel in 0..3 {
            assert!((found.rgb[i][channel] - expected[channel]).abs() < 1e-6);
        }
        assert!((found.depth_acc[i] - 2.0 * alpha).abs() < 2e-6);
        if alpha > 0.0 {
            let z = found.expected_depth().as_raw()[i];
            assert!((z - 2.0).abs() < 1e-3, "{z}");
        }
    }
}

#[test]
fn every_reason_to_drop_is_counted_under_its_name() {
    for (scene, dropped) in drops::scenes() {
        let found = render_cpu(&scene, &view(16, 16)).unwrap();
        assert_eq!(found.dropped, dropped, "{scene:?}");
        assert_eq!(found.drawn + dropped.total(), 1);
        if dropped.total() == 1 {
            assert!(found.alpha.iter().all(|a| *a == 0.0));
            assert!(found.rgb.iter().flatten().all(|c| *c == 0.0));
        }
    }
}

#[test]
fn pictures_of_every_shape_equal_the_reference() {
    let mut random = Random(7);
    let all = scene(
        &mut random,
        Recipe {
            count: 60,
            ..COMMON
        },
    );
    for (width, height) in [(1, 1), (1, 9), (9, 1), (3, 5), (63, 2), (129, 3), (67, 66)] {
        let view = view(width, height);
        let truth = reference::render(&all, &view);
        let found = render_cpu(&all, &view).unwrap();
        assert_eq!((found.width, found.height), (width, height));
        truth.assert_close(&found, &format!("{width}x{height}"));
    }
}

#[test]
fn a_picture_16384_wide_equals_the_reference() {
    let mut random = Random(8);
    let recipe = Recipe {
        count: 40,
        scales: (0.0005, 0.02),
        opacities: (0.3, 1.0),
    };
    let mut scene = scene(&mut random, recipe);
    let mut view = view(16_384, 3);
    for mean in &mut scene.means {
        mean[1] *= 1e-4;
    }
    view.intrinsics.cy = 1.3;
    let truth = reference::render(&scene, &view);
    truth.assert_close(&render_cpu(&scene, &view).unwrap(), "16384x3");
    assert!(truth.alpha.iter().any(|a| *a > 0.1));
}

#[test]
fn nothing_to_draw_gives_an_empty_picture() {
    let view = view(17, 13);
    let empty = render_cpu(&Gaussians::default(), &view).unwrap();
    assert_eq!((empty.drawn, empty.dropped.total()), (0, 0));
    assert_eq!(empty.alpha, vec![0.0; 17 * 13]);
    let mut behind = scene(&mut Random(9), COMMON);
    for mean in &mut behind.means {
        mean[2] = -mean[2];
    }
    let found = render_cpu(&behind, &view).unwrap();
    assert_eq!(found.dropped.near, 300);
    assert_eq!(found.rgb, vec![[0.0; 3]; 17 * 13]);
}

#[test]
fn extreme_numbers_neither_panic_nor_spread() {
    let mut random = Random(10);
    let mut scene = scene(
        &mut random,
        Recipe {
            count: 4000,
            ..COMMON
        },
    );
    make_extreme(&mut scene);
    let found = render_cpu(&scene, &view(70, 50)).unwrap();
    assert!(found.rgb.iter().flatten().all(|v| v.is_finite()));
    assert!(found.alpha.iter().all(|v| (0.0..=0.9999).contains(v)));
    assert!(found.depth_acc.iter().all(|v| v.is_finite()));
    assert_eq!(found.drawn + found.dropped.total(), 4000);
}

#[test]
fn bad_views_and_scenes_are_errors() {
    let scene = one([0.0, 0.0, 2.0], [0.1; 3], 0.5);
    let good = view(8, 8);
    let mut broken = scene.clone();
    broken.opacities.clear();
    assert!(matches!(
        render_cpu(&broken, &good),
        Err(RenderError::Scene(_))
    ));
    let mut nowhere = good;
    nowhere.camera_from_scene.matrix3 = DMat3::from_diagonal(DVec3::NAN);
    assert!(matches!(
        render_cpu(&scene, &nowhere),
        Err(RenderError::View(_))
    ));
    let mut empty = good;
    empty.intrinsics.width = 0;
    assert!(matches!(
        render_cpu(&scene, &empty),
        Err(RenderError::Size { .. })
    ));
}
