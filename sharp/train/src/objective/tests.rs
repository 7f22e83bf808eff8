use sharp::composer::compose;
use sharp::initializer::{BaseGaussians, InvalidDepth};
use sharp::model::predictor::Planes;
use sharp::model::synth::Synth;
use sharp::model::training::{TrainableNetwork, TrainingInput};
use sharp::model::{Algorithm, Compute, ModelConfig};

use super::*;
use crate::data::{ProceduralSamples, Sample, Source, TrainingWorlds};

const SIDE: usize = 192;

fn objective(weights: LossWeights, options: LossOptions) -> Objective {
    Objective::new(weights, options, Compute::cpu(Algorithm::Winograd)).unwrap()
}

/// A pass of the tiny network with weights that make every attribute differ from its base, and the
/// picture's planes `[3, 192, 192]`.
fn pass() -> (TrainingPass, Sample, Vec<f32>) {
    let sample =
        ProceduralSamples::new(3, (SIDE as u32, SIDE as u32), TrainingWorlds::Varied).get(0);
    let sample = sample.unwrap();
    let config = concat!(
        env!("CARGO_MANIFEST_DIR"),
        "/../../tests/golden/model/tiny_config.json#tiny"
    );
    let compute = Compute::cpu(Algorithm::Winograd);
    let network = TrainableNetwork::new(&ModelConfig::load(config).unwrap(), compute).unwrap();
    let pixels = srgb(&sample.source.image);
    let plane = |c: usize| pixels.iter().map(move |pixel| pixel[c]);
    let planes: Vec<f32> = (0..3).flat_map(plane).collect();
    let input = TrainingInput {
        image: Planes {
            values: &planes,
            width: SIDE,
            height: SIDE,
        },
        disparity_factor: 0.8,
        known_depth: Some(&known_depth(&sample.source, SIDE)),
        zeros_return: false,
        depth_only: false,
    };
    let mut pass = network.forward(Synth::default(), |_| false, input).unwrap();
    // Exceeds the margin of the loss `delta`.
    pass.deltas[7] = -600.0;
    (pass, sample, planes)
}

/// Applies every loss to both views, if that is a choice, so that all outputs of a pass have a
/// gradient.
fn options() -> LossOptions {
    let mut options = LossOptions {
        grad_stops_at_depth: false,
        // No other loss has a gradient with respect to the pooled inverse depth.
        grad_at: GradAt::Grid,
        ..LossOptions::default()
    };
    options.percep.views = PerceptualViews::Both;
    options.percep.crop = Some(48);
    options
}

fn weights() -> LossWeights {
    LossWeights {
        percep: 0.003,
        ..LossWeights::default()
    }
}

/// Weights for a single loss.
fn only(term: usize) -> LossWeights {
    let all = weights();
    let one = |index: usize, weight: f64| if index == term { weight } else { 0.0 };
    LossWeights {
        color: one(0, all.color),
        alpha: one(1, all.alpha),
        percep: one(2, all.percep),
        depth: one(3, all.depth),
        tv: one(4, all.tv),
        grad: one(5, all.grad),
        delta: one(6, all.delta),
        splat: one(7, all.splat),
        scale: one(8, all.scale),
        scale_gradient: one(9, all.scale_gradient),
    }
}

/// A gradient's parts, each with its name.
fn parts(gradient: &PassGradient) -> Vec<(&'static str, Vec<f32>)> {
    let each = |of: fn(&GaussianGradient) -> &[f32]| {
        let values = gradient.gaussians.iter().flat_map(of);
        values.copied().collect::<Vec<f32>>()
    };
    vec![
        ("mean", each(|g| &g.mean)),
        ("quaternion", each(|g| &g.quaternion)),
        ("scales", each(|g| &g.scales)),
        ("opacity", each(|g| std::slice::from_ref(&g.opacity))),
        ("color", each(|g| &g.color)),
        ("inverse depth", gradient.inverse_depth.clone()),
        ("depth", gradient.depth.clone()),
        ("factors", gradient.factors.clone()),
        ("deltas", gradient.deltas.clone()),
    ]
}

/// Compares gradients of all losses of a view together with the sum of the gradients of each loss
/// alone.
#[test]
fn gradients_gathered_by_view_are_the_sum_of_every_losss_own() {
    let (pass, mut sample, _) = pass();
    sample.source.valid = Some((0..SIDE * SIDE).map(|k| k % 5 != 0).collect());
    let example = Example {
        source: &sample.source,
        target: &sample.target,
        seed: 1,
    };
    let cost = |weights| {
        let objective = objective(weights, options());
        objective.cost(&pass, &example).unwrap()
    };
    let whole = cost(weights());
    let mut sums: Vec<Vec<f64>> = Vec::new();
    let mut total = 0.0;
    for term in 0..TERMS.len() {
        let single = cost(only(term));
        assert!(single.terms[term] > 0.0, "{}", TERMS[term]);
        assert_eq!(single.terms[term], whole.terms[term]);
        total += single.total;
        let own = parts(&single.gradient);
        sums.resize(own.len(), Vec::new());
        for (sum, (_, own)) in sums.iter_mut().zip(own) {
            sum.resize(own.len(), 0.0);
            let both = sum.iter_mut().zip(own);
            both.for_each(|(sum, own)| *sum += f64::from(own));
        }
    }
    assert!((whole.total - total).abs() < 1e-12 * total);
    for ((name, found), sum) in parts(&whole.gradient).iter().zip(&sums) {
        let largest = sum.iter().fold(0.0_f64, |m, g| m.max(g.abs()));
        assert!(largest > 0.0, "no gradient of {name}");
        let both = found.iter().zip(sum);
        let deviation = both.fold(0.0_f64, |m, (a, b)| m.max((f64::from(*a) - b).abs()));
        assert!(deviation < 2e-6 * largest, "{name}: {deviation} {largest}");
    }
}

/// The slope of the total along the gradient's direction is the gradient's length.
#[test]
fn the_total_changes_as_its_gradient_says() {
    let (mut pass, sample, _) = pass();
    let example = Example {
        source: &sample.source,
        target: &sample.target,
        seed: 1,
    };
    let options = LossOptions {
        // If alpha is nearly 0, its logarithm is not linear over any step.
        alpha_floor: 0.05,
        ..options()
    };
    let objective = objective(weights(), options);
    let gradient = objective.cost(&pass, &example).unwrap().gradient;
    type Field = fn(&mut TrainingPass) -> &mut [f32];
    // Rendering skips alphas below 1/255. So the picture jumps where a Gaussian of opacity o
    // becomes visible, and differences, unlike the gradient, include the skipped share 1/(255 o) of
    // a change of opacity.
    let fields: [(&str, Field, f64, f64); 6] = [
        (
            "mean",
            |pass| pass.gaussians.means.as_flattened_mut(),
            0.01,
            0.02,
        ),
        (
            "scales",
            |pass| pass.gaussians.scales.as_flattened_mut(),
            0.001,
            0.02,
        ),
        ("opacity", |pass| &mut pass.gaussians.opacities, 0.01, 0.05),
        (
            "color",
            |pass| pass.gaussians.colors.as_flattened_mut(),
            0.01,
            0.02,
        ),
        ("depth", |pass| &mut pass.depth, 0.01, 0.02),
        ("factors", |pass| &mut pass.factors, 0.01, 0.02),
    ];
    for (name, field, step, tolerance) in fields {
        let all = parts(&gradient);
        let (_, gradient) = all.iter().find(|(part, _)| *part == name).unwrap();
        let square: f64 = gradient.iter().map(|g| f64::from(*g).powi(2)).sum();
        let before = field(&mut pass).to_vec();
        let mut at = |length: f64| {
            let moved = before.iter().zip(gradient);
            let moved = moved.map(|(v, g)| v + (length / square.sqrt() * f64::from(*g)) as f32);
            field(&mut pass).copy_from_slice(&moved.collect::<Vec<f32>>());
            let total = objective.cost(&pass, &example).unwrap().total;
            field(&mut pass).copy_from_slice(&before);
            total
        };
        let best = [step, step / 3.0, step / 10.0, step / 30.0].map(|step| {
            let slope = (at(step) - at(-step)) / (2.0 * step);
            (slope / square.sqrt() - 1.0).abs()
        });
        let best = best.into_iter().fold(f64::INFINITY, f64::min);
        assert!(best < tolerance, "{name}: {best}");
    }
}

#[test]
fn what_a_novel_camera_has_passed_has_no_size() {
    let (pass, sample, _) = pass();
    let mut options = options();
    options.splat_view = SplatView::Novel;
    let objective = objective(only(7), options);
    let cost = |ahead: f64| {
        let mut target = sample.target.clone();
        let mut moved = sample.source.camera_from_world;
        moved.translation.z -= ahead;
        target.camera_from_world = moved;
        let example = Example {
            source: &sample.source,
            target: &target,
            seed: 1,
        };
        objective.cost(&pass, &example).unwrap()
    };
    let mut depths: Vec<f32> = pass.gaussians.means.iter().map(|mean| mean[2]).collect();
    depths.sort_unstable_by(f32::total_cmp);
    let middle = f64::from(depths[depths.len() / 2]);
    let cost_there = cost(middle);
    for (mean, gradient) in pass
        .gaussians
        .means
        .iter()
        .zip(&cost_there.gradient.gaussians)
    {
        let is_behind = f64::from(mean[2]) < middle;
        assert!(!is_behind || gradient.scales == [0.0; 3]);
    }
    // A camera behind all Gaussians sees none.
    let beyond = cost(2.0 * f64::from(depths[depths.len() - 1]));
    assert_eq!((beyond.terms[7], cost_there.terms[7] > 0.0), (0.0, true));
}

/// The novel camera has the pose that the data states: true depth explains its picture.
#[test]
fn true_depth_costs_less_at_the_true_camera() {
    let (mut pass, mut sample, planes) = pass();
    sample.source.valid = Some(vec![false; SIDE * SIDE]);
    let depth = known_depth(&sample.source, SIDE).repeat(2);
    let base = BaseGaussians::new(&planes, &depth, pass.base.grid, InvalidDepth::Skip);
    pass.gaussians = compose(&base.unwrap(), None).unwrap();
    let objective = objective(only(0), options());
    let color = |camera| {
        let target = TrainingView {
            camera_from_world: camera,
            ..sample.target.clone()
        };
        let example = Example {
            source: &sample.source,
            target: &target,
            seed: 1,
        };
        objective.cost(&pass, &example).unwrap().terms[0]
    };
    let nowhere = TrainingView {
        valid: Some(vec![false; SIDE * SIDE]),
        ..sample.target.clone()
    };
    let example = Example {
        source: &sample.source,
        target: &nowhere,
        seed: 1,
    };
    assert_eq!(objective.cost(&pass, &example).unwrap().terms[0], 0.0);
    let there = color(sample.target.camera_from_world);
    let here = color(sample.source.camera_from_world);
    // Moved by the same distance in the opposite direction.
    let to_target = sample
        .target
        .camera_from_world
        .after(&sample.source.camera_from_world.inverse());
    let opposite = color(to_target.inverse().after(&sample.source.camera_from_world));
    assert!(
        there < 0.7 * here && there < 0.7 * opposite,
        "{there} {here} {opposite}"
    );
}
