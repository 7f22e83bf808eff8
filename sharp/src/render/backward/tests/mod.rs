//! Compares the production code with central differences of an f64 oracle: the kernel in f64 to
//! 1e-5, in f32 to 1e-4 of the largest gradient of the same kind.

mod double;
mod oracle;
mod scenes;

use super::raster::{SplatSums, Steps, Upstream, block};
use super::*;
use crate::random::SplitMix64;
use crate::render::ranges::LocalSplat;
use crate::render::{Renderer, Rule, Simd};
use double::Double;
use glam::DVec2;
use oracle::{ATTRIBUTES, Attributes, OracleSplat, attributes, pixel, splat};
use scenes::{Gradient, golden, golden_with_mask};

/// A scene in f64, front to back: the Gaussians that the forward pass draws, with production's
/// projection and the oracle's splats.
struct Ordered {
    view: RenderView,
    indices: Vec<usize>,
    attributes: Vec<Attributes>,
    projections: Vec<Projection>,
    oracles: Vec<OracleSplat>,
    locals: Vec<LocalSplat<f64>>,
}

impl Ordered {
    fn new(scene: &Gaussians, view: &RenderView) -> Self {
        let mut projected = Projected::default();
        forward(Simd::detect(), scene, view, &mut projected);
        let drawn = |k: &usize| !projected.footprints[*k].is_empty();
        let mut indices: Vec<usize> = (0..scene.len()).filter(drawn).collect();
        let z = |k: usize| projected.footprints[k].z;
        indices.sort_by(|a, b| z(*a).total_cmp(&z(*b)).then(a.cmp(b)));
        let constants = ViewConstants::new(view);
        let attributes: Vec<Attributes> = indices.iter().map(|k| attributes(scene, *k)).collect();
        let oracles: Vec<OracleSplat> = attributes.iter().map(|a| splat(view, a)).collect();
        let projections: Vec<Projection> = indices
            .iter()
            .map(|k| projection(&constants, scene, *k))
            .collect();
        let locals = projections
            .iter()
            .zip(&oracles)
            .map(|(p, o)| local(p, o, constants.eps2d));
        Self {
            view: *view,
            locals: locals.collect(),
            indices,
            attributes,
            projections,
            oracles,
        }
    }

    fn seen(&self) -> Seen {
        let (width, height) = (self.view.intrinsics.width, self.view.intrinsics.height);
        let near = |i: u32| {
            let members = self.oracles.iter().enumerate();
            members
                .map(|(m, s)| (m, s.alpha(center(i as usize, width as usize))))
                .filter(|(_, alpha)| *alpha > 0.9 / 255.0)
                .collect()
        };
        let at: Vec<Vec<(usize, f64)>> = (0..width * height).into_par_iter().map(near).collect();
        let mut of = vec![Vec::new(); self.oracles.len()];
        for (i, members) in at.iter().enumerate() {
            members.iter().for_each(|(m, _)| of[*m].push(i));
        }
        Seen { at, of }
    }

    /// Gradients of the production kernel and chain rule in f64, by member.
    fn gradients(&self, gradient: &Gradient) -> Vec<(Attributes, f64)> {
        let (width, height) = (gradient.width, gradient.alpha.len() / gradient.width);
        let everyone: Vec<u32> = (0..self.locals.len() as u32).collect();
        let mut steps = Steps::default();
        let mut sums = vec![SplatSums::<f64>::default(); self.locals.len()];
        for y in (0..height).step_by(4) {
            for x in (0..width).step_by(4) {
                let upstream = gradient.view().block([x, y]);
                let upstream: Upstream<f64> = upstream.map(|lane| lane.map(f64::from));
                block::<Double>(
                    &self.locals,
                    &everyone,
                    (x, y),
                    &upstream,
                    &mut steps,
                    &mut sums,
                );
            }
        }
        let constants = ViewConstants::new(&self.view);
        let one = |(m, sums): (usize, &SplatSums<f64>)| {
            let l = &self.locals[m];
            let shape = self.projections[m].pull(&constants, &sums.on_screen([l.p, l.q, l.r]));
            let mut out = [0.0; ATTRIBUTES];
            out[..3].copy_from_slice(&shape.mean);
            out[3..7].copy_from_slice(&shape.quaternion);
            out[7..10].copy_from_slice(&shape.scales);
            out[10] = sums.opacity / l.opacity;
            out[11..].copy_from_slice(&sums.color);
            (out, sums.z)
        };
        sums.iter().enumerate().map(one).collect()
    }

    /// Central difference of the oracle's loss with respect to attribute `c` of member `m`; `None`
    /// if the change crosses a threshold at some pixel.
    fn difference(&self, seen: &Seen, gradient: &Gradient, m: usize, c: usize) -> Option<f64> {
        let s = &self.oracles[m];
        let thickness = s.thickness(self.view.rule.low_pass);
        let a = &self.attributes[m];
        let norm = a[3..7].iter().map(|v| v * v).sum::<f64>().sqrt();
        let largest = a[7..10].iter().fold(0.0, |l: f64, v| l.max(*v));
        // Steps are a thousandth of the change that moves an edge by roughly its own thickness.
        let unit = match c {
            0..3 => {
                thickness * s.z
                    / self.view.intrinsics.fx
                    / self.view.camera_from_scene.matrix3.x_axis.length()
            }
            3..7 => {
                norm * (thickness / s.covariance.x_axis.x.max(s.covariance.y_axis.y).sqrt())
                    .min(1.0)
            }
            7..10 => largest.min(a[c].max(1e-3 * largest)),
            _ => 1.0,
        };
        let at = |h: f64| -> Option<f64> {
            let moved = |h: f64| {
                let mut a = *a;
                a[c] += h;
                splat(&self.view, &a)
            };
            let (plus, minus) = (moved(h), moved(-h));
            let mut sum = 0.0;
            for i in &seen.of[m] {
                let g = gradient.pixel(*i);
                let with = |changed: &OracleSplat| {
                    let alpha = changed.alpha(center(*i, gradient.width));
                    let members = seen.at[*i].iter().map(|(k, unchanged)| {
                        if *k == m {
                            (alpha, changed)
                        } else {
                            (*unchanged, &self.oracles[*k])
                        }
                    });
                    pixel(members, &g)
                };
                let ((up, how), (down, other)) = (with(&plus), with(&minus));
                if how != other {
                    return None;
                }
                sum += up - down;
            }
            Some(sum / (2.0 * h))
        };
        let (coarse, fine) = (at(1e-3 * unit)?, at(5e-4 * unit)?);
        Some((4.0 * fine - coarse) / 3.0)
    }
}

/// Pixels at which a member's α is near 1/255.
struct Seen {
    /// For every pixel, its members and their α before the clamp, front to back.
    at: Vec<Vec<(usize, f64)>>,
    /// For every member, its pixels.
    of: Vec<Vec<usize>>,
}

fn center(pixel: usize, width: usize) -> DVec2 {
    DVec2::new((pixel % width) as f64 + 0.5, (pixel / width) as f64 + 0.5)
}

/// A splat for the kernel, made from production's projection.
fn local(p: &Projection, o: &OracleSplat, eps: f64) -> LocalSplat<f64> {
    let [_, uv, vv] = p.covariance();
    let root = p.determinant(eps).sqrt();
    let (d, kappa) = ((vv + eps).sqrt(), (0.5 * std::f64::consts::LOG2_E).sqrt());
    LocalSplat {
        mean: o.mean.to_array(),
        p: kappa * d / root,
        q: -kappa * uv / (d * root),
        r: kappa / d,
        opacity: o.opacity,
        z: o.z,
        color: o.color.to_array(),
        reach: [0, 63, 0, 63],
        cut: 0.0,
        slanted: false,
    }
}

/// Kinds of attributes; tolerances are relative to the largest gradient of a kind.
const KINDS: [std::ops::Range<usize>; 5] = [0..3, 3..7, 7..10, 10..11, 11..14];

/// The largest gradient of a kind. A ball's orientation has no effect, so gradients of quaternions
/// are compared with at least a thousandth of those of the scales.
fn largest(ordered: &Ordered, gradients: &[(Attributes, f64)], kind: usize) -> f64 {
    let values = gradients.iter().flat_map(|(g, _)| &g[KINDS[kind].clone()]);
    let of_kind = values.fold(0.0, |l: f64, v| l.max(v.abs()));
    let balls = gradients.iter().zip(&ordered.attributes);
    let of_scales = balls.map(|((g, _), a)| (7..10).map(|c| (g[c] * a[c]).abs()).sum());
    match kind {
        1 => of_scales.fold(of_kind, |l: f64, v: f64| l.max(1e-3 * v)),
        _ => of_kind,
    }
}

/// Compares `samples` attributes (or all, if there are fewer) with central differences.
fn check_f64(name: &str, eps2d: f32, samples: usize) {
    let (scene, view) = golden(name, eps2d);
    let ordered = Ordered::new(&scene, &view);
    let gradient = Gradient::random(&view, 5);
    let analytic = ordered.gradients(&gradient);
    let seen = ordered.seen();
    let mut all: Vec<(usize, usize)> = (0..ordered.indices.len())
        .flat_map(|m| (0..ATTRIBUTES).map(move |c| (m, c)))
        .collect();
    if all.len() > samples {
        SplitMix64::new(11).shuffle(&mut all);
        all.truncate(samples);
    }
    let scale = [0, 1, 2, 3, 4].map(|kind| largest(&ordered, &analytic, kind));
    let compared = all.par_iter().filter(|&&(m, c)| {
        let Some(numeric) = ordered.difference(&seen, &gradient, m, c) else {
            return false;
        };
        let found = analytic[m].0[c];
        let kind = KINDS.iter().position(|kind| kind.contains(&c)).unwrap();
        let bound = 1e-5 * found.abs().max(1e-3 * scale[kind]);
        assert!((found - numeric).abs() <= bound, "{name}: Gaussian {} attribute {c}: {found:e} against {numeric:e} (largest {:e}) of {:?} {:?}", ordered.indices[m], scale[kind], ordered.attributes[m], ordered.oracles[m]);
        true
    });
    // For the others, the difference crosses a threshold.
    let count = compared.count();
    assert!(
        4 * count >= 3 * all.len(),
        "{name}: only {count} of {}",
        all.len()
    );
}

#[test]
fn f64_kernel_is_the_derivative_of_the_oracle() {
    for (name, eps2d, samples) in [
        ("s1_one", 0.0, usize::MAX),
        ("s1_one", 0.3, usize::MAX),
        ("s2_two", 0.0, usize::MAX),
        ("s2_two", 0.3, usize::MAX),
        ("s3_five", 0.0, usize::MAX),
        ("s4_rand2k", 0.01, 300),
        ("s5_degenerate20k", 0.0, 300),
        ("s6_sharp_P", 0.01, usize::MAX),
    ] {
        check_f64(name, eps2d, samples);
    }
}

#[test]
fn f32_follows_f64() {
    for (name, eps2d) in [
        ("s1_one", 0.01),
        ("s2_two", 0.0),
        ("s3_five", 0.0),
        ("s4_rand2k", 0.0),
        ("s4_rand2k", 0.3),
        ("s5_degenerate20k", 0.0),
        ("s6_sharp_P", 0.0),
    ] {
        let (scene, view, fragile) = golden_with_mask(name, eps2d);
        let ordered = Ordered::new(&scene, &view);
        let gradient = Gradient::random(&view, 5).without(&fragile);
        let truth = ordered.gradients(&gradient);
        let found = CpuRenderer::new()
            .backward(&scene, &view, &gradient.view())
            .unwrap();
        let mut worst = [0.0_f64; 6];
        let scale = [0, 1, 2, 3, 4].map(|kind| largest(&ordered, &truth, kind));
        let depth = truth.iter().fold(0.0, |l: f64, (_, z)| l.max(z.abs()));
        for (m, (truth_of, z)) in truth.iter().enumerate() {
            // For a needle thinner than a hundredth of a pixel, rounding its position to f32 shifts
            // it by a ten-thousandth of its thickness or more.
            let needle = ordered.oracles[m].thickness(view.rule.low_pass) < 0.01;
            let allowed = if needle { 1e-3 } else { 1e-4 };
            let found = flat(&found[ordered.indices[m]]);
            for (kind, range) in KINDS.iter().enumerate() {
                for c in range.clone() {
                    let off = (f64::from(found[c]) - truth_of[c]).abs() / scale[kind] / allowed;
                    worst[kind] = worst[kind].max(off);
                }
            }
            let off = (f64::from(found[ATTRIBUTES]) - z).abs() / depth / allowed;
            worst[5] = worst[5].max(off);
        }
        assert!(
            worst.iter().all(|off| *off <= 1.0),
            "{name}: {worst:?} of what is allowed"
        );
    }
}

fn flat(g: &GaussianGradient) -> [f32; ATTRIBUTES + 1] {
    let mut out = [0.0; ATTRIBUTES + 1];
    out[..3].copy_from_slice(&g.mean);
    out[3..7].copy_from_slice(&g.quaternion);
    out[7..10].copy_from_slice(&g.scales);
    out[10] = g.opacity;
    out[11..14].copy_from_slice(&g.color);
    out[14] = g.view_depth;
    out
}

#[test]
fn bytes_do_not_depend_on_threads_or_instruction_sets() {
    let (scene, view) = golden("s5_degenerate20k", 0.0);
    let gradient = Gradient::random(&view, 1);
    let bits = |mut renderer: CpuRenderer, threads: usize| {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads)
            .build()
            .unwrap();
        let found = pool.install(|| renderer.backward(&scene, &view, &gradient.view()).unwrap());
        found
            .iter()
            .flat_map(|g| flat(g).map(f32::to_bits))
            .collect::<Vec<_>>()
    };
    let expected = bits(CpuRenderer::new(), 1);
    assert!(expected == bits(CpuRenderer::new(), 4));
    for simd in Simd::available() {
        assert!(expected == bits(CpuRenderer::with_simd(simd), 2));
    }
}

#[test]
fn hostile_scenes_have_finite_gradients() {
    let (scene, view) = golden("s5_degenerate20k", 0.0);
    let gradient = Gradient::random(&view, 2);
    let found = CpuRenderer::new()
        .backward(&scene, &view, &gradient.view())
        .unwrap();
    assert!(found.iter().all(|g| flat(g).iter().all(|v| v.is_finite())));
    assert!(found.iter().any(|g| g.mean != [0.0; 3]));
    let drawn = CpuRenderer::new().render(&scene, &view).unwrap().drawn as usize;
    let moved = found
        .iter()
        .filter(|g| **g != GaussianGradient::default())
        .count();
    assert!(moved <= drawn, "{moved} of {drawn}");
    let nothing = Gaussians::default();
    assert!(
        CpuRenderer::new()
            .backward(&nothing, &view, &gradient.view())
            .unwrap()
            .is_empty()
    );
}

#[test]
fn gradients_of_another_size_are_refused() {
    let (scene, view) = golden("s1_one", 0.0);
    let mut gradient = Gradient::random(&view, 3);
    gradient.alpha.pop();
    let refused = CpuRenderer::new().backward(&scene, &view, &gradient.view());
    assert!(refused.unwrap_err().to_string().contains("64x64"));
    let refused = backward_covariances(&scene, &view, &[], &mut []);
    assert!(refused.unwrap_err().to_string().contains("for 1 Gaussians"));
}

#[test]
fn covariances_and_their_gradients_are_the_oracles() {
    let (scene, view) = golden("s6_sharp_P", 0.0);
    let found = covariances(&scene, &view).unwrap();
    let mut random = SplitMix64::new(4);
    let of: Vec<[f64; 3]> = (0..scene.len())
        .map(|_| [0, 1, 2].map(|_| random.between(-1.0, 1.0)))
        .collect();
    let mut gradients = vec![GaussianGradient::default(); scene.len()];
    backward_covariances(&scene, &view, &of, &mut gradients).unwrap();
    let loss = |k: usize, a: &Attributes| {
        let [a, b, _, c] = splat(&view, a).covariance.to_cols_array();
        [a, b, c]
            .iter()
            .zip(&of[k])
            .map(|(v, g)| v * g)
            .sum::<f64>()
    };
    for k in (0..scene.len()).step_by(37) {
        let a = attributes(&scene, k);
        let [uu, uv, _, vv] = splat(&view, &a).covariance.to_cols_array();
        for (x, y) in found[k].iter().zip([uu, uv, vv]) {
            assert!((x - y).abs() <= 1e-9 * (uu + vv), "{k}");
        }
        let differences: Vec<f64> = (0..10)
            .map(|c| {
                let h = 1e-5 * a[c].abs().max(1e-3);
                let at = |h: f64| {
                    let mut a = a;
                    a[c] += h;
                    loss(k, &a)
                };
                (at(h) - at(-h)) / (2.0 * h)
            })
            .collect();
        let found = flat(&gradients[k]);
        for kind in &KINDS[..3] {
            let size = differences[kind.clone()]
                .iter()
                .fold(0.0, |l: f64, v| l.max(v.abs()));
            for c in kind.clone() {
                let off = (f64::from(found[c]) - differences[c]).abs();
                assert!(
                    off <= 1e-5 * size.max(1e-6),
                    "{k} {c}: {} against {}",
                    found[c],
                    differences[c]
                );
            }
        }
    }
}

#[test]
fn another_rule_than_sharps_has_no_derivative() {
    let (scene, mut view) = golden("s1_one", 0.01);
    assert!(covariances(&scene, &view).is_ok());
    view.rule = Rule::INRIA;
    let error = covariances(&scene, &view).unwrap_err().to_string();
    assert!(error.contains("\"inria\""), "{error}");
}
