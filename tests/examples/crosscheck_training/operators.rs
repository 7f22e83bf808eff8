//! Operators of the network with their derivatives, and parts of the network made of them: base
//! Gaussians, composer, alignment.
//!
//! `value` is the sum of the output times `upstream`.

use std::path::Path;

use sharp::composer::{self, compose};
use sharp::initializer::{self, BaseGaussians, Grid, InvalidDepth, NormalizedDepth};
use sharp::model::params::WeightSource;
use sharp::model::predictor::Planes;
use sharp::model::training::{TrainableNetwork, TrainingInput};
use sharp::model::{Algorithm, Compute, ModelConfig, ModelError};
use sharp::random::{SplitMix64, mix};
use sharp::render::GaussianGradient;
use sharp_kernels::activation::{gelu, gelu_gradient};
use sharp_kernels::conv::backward::{
    ConvInput, InputGradient, bias_gradient, keep_where_positive, weight_gradient,
};
use sharp_kernels::{Conv2d, ConvOptions, ConvSpec, GroupNorm, NormGradient, RowWindow, Simd};

use super::{Case, Done, Values};

pub(super) fn operators(values: &mut Values, folder: &Path) -> Done {
    convolutions(values, folder)?;
    norm(values, folder)?;
    activation(values, folder)?;
    gaussians(values, folder)?;
    alignment(values, folder)
}

fn dot(a: &[f32], b: &[f32]) -> f64 {
    let both = a.iter().zip(b);
    both.map(|(a, b)| f64::from(*a) * f64::from(*b)).sum()
}

/// Convolutions with everything fused into them: a rectified input, a residual, a rectified output.
fn convolutions(values: &mut Values, folder: &Path) -> Done {
    let simd = Simd::detect();
    let (height, width) = (20, 28);
    for (name, kernel, padding) in [("convolution 3x3", 3, 1), ("convolution 1x1", 1, 0)] {
        let spec = ConvSpec {
            in_channels: 16,
            out_channels: 24,
            kernel,
            stride: 1,
            padding,
        };
        for (number, algorithm) in [Algorithm::Direct, Algorithm::Winograd].iter().enumerate() {
            let (inputs, outputs) = ([height, width, 16], [height, width, 24]);
            let x = values.between(-1.0, 1.0, height * width * 16);
            let weight = values.between(-0.3, 0.3, spec.weight_len());
            let bias = values.between(-0.5, 0.5, 24);
            let residual = values.between(-1.0, 1.0, height * width * 24);
            let upstream = values.between(-1.0, 1.0, residual.len());
            let conv = Conv2d::new(simd, spec, &weight, Some(&bias), false, *algorithm);
            let options = ConvOptions {
                relu_input: true,
                residual: Some(&residual),
                relu: true,
            };
            let mut out = vec![0.0; residual.len()];
            let window = RowWindow::whole(&x, height, width, 16);
            conv.run_rows_with(&window, 0..height, &mut out, options);
            let mut g = upstream.clone();
            keep_where_positive(&mut g, &out);
            let input = ConvInput {
                data: &x,
                height,
                width,
                relu: true,
            };
            let back = InputGradient::new(simd, spec, &weight, *algorithm);
            let mut of_x = back.run(&g, height, width);
            keep_where_positive(&mut of_x, &x);
            let shape = [24, 16, kernel, kernel];
            Case::default()
                .f32("x", &inputs, &x)
                .f32("weight", &shape, &weight)
                .f32("bias", &[24], &bias)
                .f32("residual", &outputs, &residual)
                .f32("upstream", &outputs, &upstream)
                .f64("value", &[1], &[dot(&out, &upstream)])
                .f32("d x", &inputs, &of_x)
                .f32("d weight", &shape, &weight_gradient(simd, spec, input, &g))
                .f32("d bias", &[24], &bias_gradient(&g, 24))
                .f32("d residual", &outputs, &g)
                .write(folder, &format!("{name}.{number}"))?;
        }
    }
    Ok(())
}

fn norm(values: &mut Values, folder: &Path) -> Done {
    let simd = Simd::detect();
    let (rows, channels) = (300, 32);
    let x = values.between(-1.0, 3.0, rows * channels);
    let gamma = values.between(0.5, 1.5, channels);
    let beta = values.between(-0.5, 0.5, channels);
    let upstream = values.between(-1.0, 1.0, x.len());
    let mut out = vec![0.0; x.len()];
    let norm = GroupNorm::new(8, &gamma, &beta, 1e-5);
    norm.run(simd, &x, false, &mut out);
    let NormGradient {
        input,
        gamma: of_gamma,
        beta: of_beta,
    } = norm.backward(simd, &x, &upstream);
    Case::default()
        .f32("x", &[rows, channels], &x)
        .f32("gamma", &[channels], &gamma)
        .f32("beta", &[channels], &beta)
        .f32("upstream", &[rows, channels], &upstream)
        .f64("value", &[1], &[dot(&out, &upstream)])
        .f32("d x", &[rows, channels], &input)
        .f32("d gamma", &[channels], &of_gamma)
        .f32("d beta", &[channels], &of_beta)
        .write(folder, "group norm")
}

fn activation(values: &mut Values, folder: &Path) -> Done {
    let simd = Simd::detect();
    let x = values.between(-6.0, 6.0, 4000);
    let upstream = values.between(-1.0, 1.0, x.len());
    Case::default()
        .f32("x", &[4000], &x)
        .f32("upstream", &[4000], &upstream)
        .f64("value", &[1], &[dot(&gelu(simd, &x), &upstream)])
        .f32("d x", &[4000], &gelu_gradient(simd, &x, &upstream))
        .write(folder, "gelu")
}

/// From depth and deltas to Gaussians and to the decoder's input, in one step.
fn gaussians(values: &mut Values, folder: &Path) -> Done {
    let (height, width, stride) = (12, 20, 2);
    let grid = Grid {
        layers: 2,
        width,
        height,
        stride,
    };
    let blocks = grid.layers * grid.blocks();
    let image = values.between(0.0, 1.0, 3 * height * width);
    // The farthest depths are beyond the clamp at a hundred times the nearest.
    let mut depth = values.between(0.7, 20.0, 2 * height * width);
    (depth[5], depth[77]) = (300.0, 90.0);
    let deltas = values.between(-2.0, 2.0, composer::ATTRIBUTES * blocks);
    let normalized = NormalizedDepth::new(&depth, InvalidDepth::Refuse)?;
    let base = BaseGaussians::from_normalized(&image, &normalized, grid)?;
    let scene = compose(&base, Some(&deltas))?;
    let features = normalized.feature_input(&image);

    let of_gaussians = values.between(-1.0, 1.0, 14 * blocks);
    let upstream: Vec<GaussianGradient> = of_gaussians
        .chunks_exact(14)
        .map(|r| GaussianGradient {
            mean: [r[0], r[1], r[2]],
            scales: [r[3], r[4], r[5]],
            quaternion: [r[6], r[7], r[8], r[9]],
            color: [r[10], r[11], r[12]],
            opacity: r[13],
            view_depth: 0.0,
        })
        .collect();
    let of_features = values.between(-1.0, 1.0, 5 * height * width);
    let mut value = dot(&features, &of_features);
    for (k, u) in upstream.iter().enumerate() {
        value += dot(&scene.means[k], &u.mean)
            + dot(&scene.scales[k], &u.scales)
            + dot(&scene.quaternions[k], &u.quaternion)
            + dot(&scene.colors[k], &u.color)
            + dot(&[scene.opacities[k]], &[u.opacity]);
    }
    let composed = composer::backward(&base, &deltas, &upstream)?;
    let of_planes = &of_features[3 * height * width..];
    let of_depth = initializer::backward(&depth, &normalized, grid, &composed.base, of_planes)?;
    let attributes = [14, 2, grid.rows(), grid.columns()];
    let layers = [2, height, width];
    Case::default()
        .f32("image", &[3, height, width], &image)
        .f32("depth", &layers, &depth)
        .f32("deltas", &attributes, &deltas)
        .f32("of gaussians", &[blocks, 14], &of_gaussians)
        .f32("of features", &[5, height, width], &of_features)
        .f64("value", &[1], &[value])
        .f32("d depth", &layers, &of_depth)
        .f32("d deltas", &attributes, &composed.deltas)
        .write(folder, "gaussians")
}

/// Seeded weights. The depth head gives the same disparity everywhere.
#[derive(Clone, Copy)]
struct Seeded(u64);

/// The disparity given by the depth head.
const DISPARITY: f32 = 0.3;
/// Focal length divided by width.
const FACTOR: f32 = 0.75;

impl WeightSource for Seeded {
    fn values(&self, name: &str, shape: &[usize]) -> Result<Vec<f32>, ModelError> {
        let len: usize = shape.iter().product();
        if name.ends_with("monodepth_predictor.head.4.weight") {
            return Ok(vec![0.0; len]);
        }
        if name.ends_with("monodepth_predictor.head.4.bias") {
            return Ok(vec![DISPARITY; len]);
        }
        let seed = name
            .bytes()
            .fold(self.0, |seed, b| mix(seed ^ u64::from(b)));
        let mut random = SplitMix64::new(seed);
        let fan_in: usize = shape[1..].iter().product();
        let (low, high) = match (shape.len(), name.ends_with(".bias")) {
            (1, false) => (0.5, 1.5),
            (1, true) => (-0.3, 0.3),
            _ => {
                let reach = (3.0 / fan_in as f64).sqrt();
                (-reach, reach)
            }
        };
        Ok((0..len).map(|_| random.between(low, high) as f32).collect())
    }
}

/// The alignment network as the product runs it, including pooling, doubling, concatenation and
/// fused convolutions.
fn alignment(values: &mut Values, folder: &Path) -> Done {
    const SIDE: usize = 64;
    let mut config = ModelConfig::release();
    config.vit.embed_dim = 32;
    config.vit.num_heads = 2;
    config.vit.depth = 4;
    config.vit.img_size = SIDE / 4;
    config.hook_ids = [0, 1, 2, 3];
    config.encoder_dims = [8; 4];
    config.use_patch_overlap = false;
    config.monodepth_dims_decoder = [8; 5];
    config.gaussian_dims_decoder = [16; 5];
    config.gaussian_dim_out = 8;
    config.alignment_base_width = 8;
    config.alignment_steps = 2;
    config.internal_resolution = SIDE;
    let network = TrainableNetwork::new(&config, Compute::cpu(Algorithm::Winograd))?;
    let image = vec![0.5; 3 * SIDE * SIDE];
    // A case is left out if a unit is nearly 0.
    for number in 0..12 {
        let source = Seeded(values.0.next_u64());
        let known = values.between(1.0, 6.0, SIDE * SIDE);
        let input = TrainingInput {
            image: Planes {
                values: &image,
                width: SIDE,
                height: SIDE,
            },
            disparity_factor: FACTOR,
            known_depth: Some(&known),
            zeros_return: false,
            depth_only: false,
        };
        let trains = |name: &str| name.starts_with(ALIGNMENT);
        let pass = network.forward(source, trains, input)?;
        let upstream = values.between(-1.0, 1.0, SIDE * SIDE);
        let mut gradient = pass.zero_gradient();
        gradient.factors.clone_from(&upstream);
        let mut case = Case::default()
            .f32("known", &[SIDE, SIDE], &known)
            .f32("predicted", &[1], &[FACTOR / DISPARITY])
            .f32("upstream", &[SIDE, SIDE], &upstream)
            .f64("value", &[1], &[dot(&pass.factors, &upstream)]);
        let found = pass.backward(&gradient)?;
        for parameter in network.parameters() {
            let Some(name) = parameter.name.strip_prefix(ALIGNMENT) else {
                continue;
            };
            let shape = &parameter.shape;
            case = case
                .f32(name, shape, &source.values(&parameter.name, shape)?)
                .f32(&format!("d {name}"), shape, &found[&parameter.name]);
        }
        case.write(folder, &format!("alignment.{number}"))?;
    }
    Ok(())
}

const ALIGNMENT: &str = "depth_alignment.scale_map_estimator.";
