//! Scenes of one Gaussian at and beyond each limit of the renderers.

use sharp::gaussians::{Gaussians, Harmonics};
use sharp::render::Dropped;

pub(crate) fn one(mean: [f32; 3], scale: [f32; 3], opacity: f32) -> Gaussians {
    Gaussians {
        means: vec![mean],
        quaternions: vec![[1.0, 0.0, 0.0, 0.0]],
        scales: vec![scale],
        opacities: vec![opacity],
        colors: vec![[0.2, 0.5, 0.8]],
        harmonics: Harmonics::default(),
    }
}

/// Scenes with the expected counts of dropped Gaussians. A Gaussian exactly at a limit is kept.
pub(crate) fn scenes() -> Vec<(Gaussians, Dropped)> {
    let mut all = Vec::new();
    let mut add = |dropped: Dropped, change: &dyn Fn(&mut Gaussians)| {
        let mut scene = one([0.0, 0.0, 2.0], [0.1; 3], 0.5);
        change(&mut scene);
        all.push((scene, dropped));
    };
    let next_down = |x: f32| f32::from_bits(x.to_bits() - 1);
    let next_up = |x: f32| f32::from_bits(x.to_bits() + 1);
    let none = Dropped::default();
    add(none, &|_| ());
    let not_finite = Dropped {
        not_finite: 1,
        ..none
    };
    for bad in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY] {
        for d in 0..3 {
            add(not_finite, &|s| s.means[0][d] = bad);
            add(not_finite, &|s| s.scales[0][d] = bad);
            add(not_finite, &|s| s.colors[0][d] = bad);
        }
        for d in 0..4 {
            add(not_finite, &|s| s.quaternions[0][d] = bad);
        }
        add(not_finite, &|s| s.opacities[0] = bad);
    }
    let zero_quaternion = Dropped {
        zero_quaternion: 1,
        ..none
    };
    add(zero_quaternion, &|s| s.quaternions[0] = [0.0; 4]);
    let near = Dropped { near: 1, ..none };
    add(none, &|s| s.means[0][2] = 0.01);
    add(near, &|s| s.means[0][2] = next_down(0.01));
    add(near, &|s| s.means[0][2] = 0.0);
    add(near, &|s| s.means[0][2] = -2.0);
    let at_depth = |s: &mut Gaussians, z: f32| {
        s.means[0][2] = z;
        s.scales[0] = [0.1 * z; 3];
    };
    add(none, &|s| at_depth(s, 1e10));
    add(Dropped { far: 1, ..none }, &|s| at_depth(s, next_up(1e10)));
    let degenerate = Dropped {
        degenerate: 1,
        ..none
    };
    add(degenerate, &|s| s.scales[0] = [0.0; 3]);
    // A rod without width is degenerate; a disc without thickness in depth is not.
    add(degenerate, &|s| s.scales[0] = [0.1, 0.0, 0.0]);
    add(none, &|s| s.scales[0] = [0.1, 0.1, 0.0]);
    let transparent = Dropped {
        transparent: 1,
        ..none
    };
    let threshold = 1.0 / 255.0;
    add(none, &|s| s.opacities[0] = 1.0);
    add(none, &|s| s.opacities[0] = threshold);
    add(transparent, &|s| s.opacities[0] = next_down(threshold));
    add(transparent, &|s| s.opacities[0] = 0.0);
    add(transparent, &|s| s.opacities[0] = -1.0);
    let outside = Dropped { outside: 1, ..none };
    add(outside, &|s| s.means[0][0] = 10.0);
    add(outside, &|s| s.means[0][1] = -10.0);
    all
}
