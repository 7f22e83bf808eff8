//! Every picture of `golden/render`, on every CPU instruction set this machine has.

#![allow(
    clippy::unwrap_used,
    clippy::panic,
    clippy::print_stdout,
    reason = "test code outside of #[test] functions"
)]

mod render_support;

use render_support::Golden;
use sharp::render::{CpuRenderer, Renderer, Simd};

fn check(name: &str, suffix: &str, eps2d: f32) {
    let golden = Golden::load(name, suffix, eps2d);
    let mut first = None;
    for level in Simd::available() {
        let mut renderer = CpuRenderer::with_simd(level);
        let found = renderer.render(&golden.scene, &golden.view).unwrap();
        let deviation = golden.deviation(&found);
        println!("{name}{suffix} {}: {deviation:?}", renderer.name());
        assert!(deviation.is_within_bars(), "{deviation:?}");
        // All instruction sets give the same bytes.
        assert!(*first.get_or_insert(found.clone()) == found);
    }
}

macro_rules! golden {
    ($($test:ident: $name:literal, $suffix:literal, $eps2d:literal, $drawn:literal;)*) => {
        $(
            #[test]
            fn $test() {
                check($name, $suffix, $eps2d);
                let golden = Golden::load($name, $suffix, $eps2d);
                let found = CpuRenderer::new().render(&golden.scene, &golden.view).unwrap();
                // The number of visible Gaussians according to the oracle.
                assert_eq!(found.drawn, $drawn);
                assert_eq!(found.drawn + found.dropped.total(), golden.scene.len() as u64);
            }
        )*

        /// The list of tests above equals the list of cases.
        #[test]
        fn every_case_has_its_test() {
            let tested = [$(($name, $suffix, $eps2d)),*];
            assert_eq!(tested, render_support::CASES);
        }
    };
}

golden! {
    s1_one_gaussian_eps_0: "s1_one", ".eps0", 0.0, 1;
    s1_one_gaussian_eps_001: "s1_one", ".eps0.01", 0.01, 1;
    s1_one_gaussian_eps_03: "s1_one", ".eps0.3", 0.3, 1;
    s2_two_gaussians_eps_0: "s2_two", ".eps0", 0.0, 2;
    s2_two_gaussians_eps_03: "s2_two", ".eps0.3", 0.3, 2;
    s3_ties_and_early_stop: "s3_five", "", 0.0, 5;
    s4_random_2k_eps_0: "s4_rand2k", ".eps0", 0.0, 1611;
    s4_random_2k_eps_001: "s4_rand2k", ".eps0.01", 0.01, 1615;
    s4_random_2k_eps_03: "s4_rand2k", ".eps0.3", 0.3, 1631;
    s5_degenerate_20k: "s5_degenerate20k", "", 0.0, 13096;
    s6_affine_view_eps_0: "s6_sharp_P", ".eps0", 0.0, 4513;
    s6_affine_view_eps_001: "s6_sharp_P", ".eps0.01", 0.01, 4513;
}
