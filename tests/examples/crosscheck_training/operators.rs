//! Operators of the network with what they are differentiated by, and the network's parts that are
//! made of them: base Gaussians, composer, alignment.
//!
//! `value` is the output times `upstream`, summed.

use std::path::Path;

use sharp::composer::{self, compose};
use sharp::initializer::{self, BaseGaussians, Grid, InvalidDepth, NormalizedDepth};
use sharp::model::params::WeightSource;
use sharp::model::predictor::Planes;
use sharp::model::training::{TrainableNetwork, TrainingInput};
use sharp::model::{ModelConfig, ModelError};
use sharp::random::{SplitMix64, mix};
use sharp::render::GaussianGradient;
use sharp_kernels::activation::{gelu, gelu_gradient};
use sharp_kernels::conv::backward::{
    ConvInput, InputGradient, bias_gradient, keep_where_positive, weight_gradient,
};
use sharp_kernels::{
    Algorithm, AttentionShape, Conv2d, ConvOptions, ConvSpec, GroupNorm, NormGradient, RowOp,
    RowWindow, Simd, TransposedConv2x2, Workspace, attention, attention_gradient, layer_norm,
    layer_norm_gradient,
};

use super::{Case, Done, Values};

pub(super) fn operators(values: &mut Values, folder: &Path) -> Done {
    convolutions(values, folder)?;
    transposed(values, folder)?;
    norms(values, folder)?;
    tokens(values, folder)?;
    gaussians(values, folder)?;
    alignment(values, folder)
}

fn dot(a: &[f32], b: &[f32]) -> f64 {
    let both = a.iter().zip(b);
    both.map(|(a, b)| f64::from(*a) * f64::from(*b)).sum()
}

/// With everything that is fused into one: a rectified input, a residual, a rectified output.
fn convolutions(values: &mut Values, folder: &Path) -> Done {
    let simd = Simd::detect();
    let (height, width) = (20, 28);
    for (name, kernel, stride, padding) in [
        ("convolution 3x3", 3, 1, 1),
        ("convolution 1x1", 1, 1, 0),
        ("convolution of blocks", 4, 4, 0),
    ] {
        let spec = ConvSpec {
            in_channels: 16,
            out_channels: 24,
            kernel,
            stride,
            padding,
        };
        for (number, algorithm) in [Algorithm::Direct, Algorithm::Winograd].iter().enumerate() {
            let (rows, columns) = (height / stride, width / stride);
            let (inputs, outputs) = ([height, width, 16], [rows, columns, 24]);
            let x = values.between(-1.0, 1.0, height * width * 16);
            let weight = values.between(-0.3, 0.3, spec.weight_len());
            let bias = values.between(-0.5, 0.5, 24);
            let residual = values.between(-1.0, 1.0, rows * columns * 24);
            let upstream = values.between(-1.0, 1.0, residual.len());
            let conv = Conv2d::new(simd, spec, &weight, Some(&bias), false, *algorithm);
            let options = ConvOptions {
                relu_input: true,
                residual: Some(&residual),
                relu: true,
            };
            let mut out = vec![0.0; residual.len()];
            let workspace = &mut Workspace::new();
            let window = RowWindow::whole(&x, height, width, 16);
            conv.run_rows_with(&window, 0..rows, &mut out, options, workspace);
            let mut g = upstream.clone();
            keep_where_positive(&mut g, &out);
            let input = ConvInput {
                data: &x,
                height,
                width,
                relu: true,
            };
            let back = InputGradient::new(simd, spec, &weight, *algorithm);
            let shape = [24, 16, kernel, kernel];
            Case::default()
                .f32("x", &inputs, &x)
                .f32("weight", &shape, &weight)
                .f32("bias", &[24], &bias)
                .f32("residual", &outputs, &residual)
                .f32("upstream", &outputs, &upstream)
                .f64("value", &[1], &[dot(&out, &upstream)])
                .f32("d x", &inputs, &back.run(input, &g, workspace))
                .f32("d weight", &shape, &weight_gradient(simd, spec, input, &g))
                .f32("d bias", &[24], &bias_gradient(&g, 24))
                .f32("d residual", &outputs, &g)
                .write(folder, &format!("{name}.{number}"))?;
        }
    }
    Ok(())
}

/// Its gradients are those of the convolution of blocks that it transposes.
fn transposed(values: &mut Values, folder: &Path) -> Done {
    let simd = Simd::detect();
    let (height, width, inputs, outputs) = (9, 13, 20, 12);
    let x = values.between(-1.0, 1.0, height * width * inputs);
    let weight = values.between(-0.3, 0.3, inputs * outputs * 4);
    let bias = values.between(-0.5, 0.5, outputs);
    let upstream = values.between(-1.0, 1.0, 4 * height * width * outputs);
    let deconv = TransposedConv2x2::new(simd, inputs, outputs, &weight, Some(&bias));
    let mut out = vec![0.0; upstream.len()];
    let workspace = &mut Workspace::new();
    let window = RowWindow::whole(&x, height, width, inputs);
    deconv.run_rows(&window, 0..2 * height, &mut out, workspace);
    let spec = ConvSpec {
        in_channels: outputs,
        out_channels: inputs,
        kernel: 2,
        stride: 2,
        padding: 0,
    };
    let blocks = ConvInput {
        data: &upstream,
        height: 2 * height,
        width: 2 * width,
        relu: false,
    };
    let back = Conv2d::new(simd, spec, &weight, None, false, Algorithm::Direct);
    let mut of_x = vec![0.0; x.len()];
    let window = RowWindow::whole(&upstream, 2 * height, 2 * width, outputs);
    back.run_rows(&window, 0..height, &mut of_x, workspace);
    let shape = [inputs, outputs, 2, 2];
    let large = [2 * height, 2 * width, outputs];
    let of_weight = weight_gradient(simd, spec, blocks, &x);
    Case::default()
        .f32("x", &[height, width, inputs], &x)
        .f32("weight", &shape, &weight)
        .f32("bias", &[outputs], &bias)
        .f32("upstream", &large, &upstream)
        .f64("value", &[1], &[dot(&out, &upstream)])
        .f32("d x", &[height, width, inputs], &of_x)
        .f32("d weight", &shape, &of_weight)
        .f32("d bias", &[outputs], &bias_gradient(&upstream, outputs))
        .write(folder, "transposed convolution")
}

fn norms(values: &mut Values, folder: &Path) -> Done {
    let simd = Simd::detect();
    let (rows, channels) = (300, 32);
    for (name, eps) in [("group norm", 1e-5), ("layer norm", 1e-6)] {
        let x = values.between(-1.0, 3.0, rows * channels);
        let gamma = values.between(0.5, 1.5, channels);
        let beta = values.between(-0.5, 0.5, channels);
        let upstream = values.between(-1.0, 1.0, x.len());
        let mut out = vec![0.0; x.len()];
        let found = if name == "group norm" {
            let norm = GroupNorm::new(8, &gamma, &beta, eps);
            norm.run(simd, &x, false, &mut out);
            norm.backward(simd, &x, &upstream)
        } else {
            layer_norm(simd, &x, &gamma, &beta, eps, &mut out);
            layer_norm_gradient(&x, &gamma, eps, &upstream)
        };
        let NormGradient {
            input,
            gamma: of_gamma,
            beta: of_beta,
        } = found;
        Case::default()
            .f32("x", &[rows, channels], &x)
            .f32("gamma", &[channels], &gamma)
            .f32("beta", &[channels], &beta)
            .f32("upstream", &[rows, channels], &upstream)
            .f64("value", &[1], &[dot(&out, &upstream)])
            .f32("d x", &[rows, channels], &input)
            .f32("d gamma", &[channels], &of_gamma)
            .f32("d beta", &[channels], &of_beta)
            .write(folder, name)?;
    }
    Ok(())
}

/// What else a transformer has.
fn tokens(values: &mut Values, folder: &Path) -> Done {
    let simd = Simd::detect();
    let shape = AttentionShape {
        batch: 3,
        tokens: 17,
        heads: 2,
        head_dim: 24,
    };
    let scale = 24.0_f32.powf(-0.5);
    let qkv = values.between(-2.0, 2.0, 3 * 17 * 3 * 48);
    let upstream = values.between(-1.0, 1.0, 3 * 17 * 48);
    let mut out = vec![0.0; upstream.len()];
    attention(simd, &qkv, &mut out, shape, scale, &mut Workspace::new());
    let found = attention_gradient(&qkv, &upstream, shape, scale);
    Case::default()
        .f32("qkv", &[3, 17, 3, 2, 24], &qkv)
        .f32("upstream", &[3, 17, 2, 24], &upstream)
        .f64("value", &[1], &[dot(&out, &upstream)])
        .f32("d qkv", &[3, 17, 3, 2, 24], &found)
        .write(folder, "attention")?;

    let x = values.between(-6.0, 6.0, 4000);
    let upstream = values.between(-1.0, 1.0, x.len());
    Case::default()
        .f32("x", &[4000], &x)
        .f32("upstream", &[4000], &upstream)
        .f64("value", &[1], &[dot(&gelu(simd, &x), &upstream)])
        .f32("d x", &[4000], &gelu_gradient(simd, &x, &upstream))
        .write(folder, "gelu")
}

/// Depth and deltas to Gaussians and to the decoder's input, in one.
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
    // The farthest are beyond the clamp at a hundred times the nearest.
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

/// Weights from a seed. The depth head gives one disparity everywhere.
#[derive(Clone, Copy)]
struct Seeded(u64);

/// That disparity.
const DISPARITY: f32 = 0.3;
/// Focal length over width.
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

/// The alignment network as the product runs it: pooling, doubling, concatenation and fused
/// convolutions in their places.
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
    let network = TrainableNetwork::new(&config)?;
    let image = vec![0.5; 3 * SIDE * SIDE];
    // A unit that is nearly 0 leaves a case out.
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
