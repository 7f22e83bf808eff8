//! Compares layers with their definitions; tests gradients as adjoints, and by differences along
//! directions.

use super::super::testing::{check_to, noise, pixels};
use super::distance::Terms;
use super::layers::Layer;
use super::*;
use candle_core::Device;
use sharp::model::{Algorithm, FrozenConvolution, max_pool};
use sharp::random::SplitMix64;
use std::sync::OnceLock;

fn signed(seed: u64, count: usize) -> Vec<f32> {
    let mut random = SplitMix64::new(seed);
    (0..count)
        .map(|_| random.between(-1.0, 1.0) as f32)
        .collect()
}

fn cpu() -> Compute {
    Compute::cpu(Algorithm::Winograd)
}

/// Our kernels, candle's operations, and if the build and the machine have an NVIDIA GPU, candle's
/// operations on it.
fn computes() -> Vec<Compute> {
    let candle = [Ok(Device::Cpu), Device::new_cuda(0)].into_iter().flatten();
    [cpu()]
        .into_iter()
        .chain(candle.map(Compute::candle))
        .collect()
}

fn map(compute: &Compute, values: &[f32], [height, width]: [usize; 2]) -> Var {
    let shape = (1, height, width, values.len() / (height * width));
    Var::from_tensor(&Tensor::from_slice(values, shape, compute.device()).unwrap()).unwrap()
}

fn values(tensor: &Tensor) -> Vec<f32> {
    tensor.flatten_all().unwrap().to_vec1().unwrap()
}

/// The gradient of ⟨y, g⟩ with respect to x.
fn pulled(y: &Tensor, g: &[f32], x: &Var) -> Vec<f32> {
    let g = Tensor::from_slice(g, y.shape(), y.device()).unwrap();
    let found = (y * g).unwrap().sum_all().unwrap().backward().unwrap();
    values(found.get(x).unwrap())
}

fn dot(a: &[f32], b: &[f32]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter()
        .zip(b)
        .map(|(a, b)| f64::from(*a) * f64::from(*b))
        .sum()
}

/// Weights that preserve the magnitude of their input.
fn weights(seed: u64, [out, inputs]: [usize; 2], kernel: usize) -> (Vec<f32>, Vec<f32>) {
    let fan = inputs * kernel * kernel;
    let bound = (6.0 / fan as f32).sqrt();
    let weight = signed(seed, out * fan).into_iter().map(|w| w * bound);
    (weight.collect(), signed(seed + 1, out))
}

fn frozen(
    compute: &Compute,
    seed: u64,
    channels: [usize; 2],
    kernel: usize,
    steps: [usize; 2],
) -> FrozenConvolution {
    let (weight, bias) = weights(seed, channels, kernel);
    let [out, inputs] = channels;
    FrozenConvolution::new(compute, [out, inputs, kernel], [&weight, &bias], steps).unwrap()
}

#[test]
fn convolutions_match_their_definition_and_pull_back_by_the_adjoint() {
    for compute in computes() {
        for (kernel, stride, dilation) in [
            (3, 1, 1),
            (3, 2, 1),
            (1, 1, 1),
            (1, 2, 1),
            (3, 1, 2),
            (3, 1, 4),
        ] {
            let (size, channels) = ([7, 10], [19, 16]);
            let conv = frozen(&compute, 1, channels, kernel, [stride, dilation]);
            let (weight, bias) = weights(1, channels, kernel);
            let data = signed(3, 7 * 10 * 16);
            let x = map(&compute, &data, size);
            let out = conv.forward(&x, None, false).unwrap();
            let [rows, columns] = size.map(|side| side.div_ceil(stride));
            assert_eq!(out.dims(), [1, rows, columns, channels[0]]);
            let reach = kernel / 2 * dilation;
            let found = values(&out);
            for (i, found) in found.iter().enumerate() {
                let (o, p) = (i % channels[0], i / channels[0]);
                let (y, x0) = (p / columns * stride, p % columns * stride);
                let mut sum = f64::from(bias[o]);
                for (tap, c) in (0..kernel * kernel).flat_map(|t| (0..16).map(move |c| (t, c))) {
                    let (iy, ix) = (y + tap / kernel * dilation, x0 + tap % kernel * dilation);
                    if (reach..7 + reach).contains(&iy) && (reach..10 + reach).contains(&ix) {
                        let v = data[((iy - reach) * 10 + ix - reach) * 16 + c];
                        let w = weight[(o * 16 + c) * kernel * kernel + tap];
                        sum += f64::from(v) * f64::from(w);
                    }
                }
                assert!(
                    (sum - f64::from(*found)).abs() < 1e-4,
                    "{kernel} {stride} {dilation}: {sum} {found}"
                );
            }
            // ⟨K x + b, g⟩ = ⟨x, Kᵀ g⟩ + ⟨b, g⟩
            let g = signed(5, found.len());
            let back = pulled(&out, &g, &x);
            let of_bias: f64 = g.chunks(19).map(|g| dot(g, &bias)).sum();
            let (left, right) = (dot(&found, &g), dot(&data, &back) + of_bias);
            assert!(
                (left - right).abs() < 1e-3,
                "{kernel} {stride} {dilation}: {left} {right}"
            );
        }
    }
}

#[test]
fn maxima_are_found_and_their_gradient_goes_to_the_first_of_them() {
    for compute in computes() {
        for (side, padding, out_size) in [(2, 0, [3, 5]), (3, 1, [4, 5])] {
            // Use few levels, so that some values are equal.
            let data: Vec<f32> = noise(1, 7 * 10 * 5)
                .iter()
                .map(|v| (v * 6.0).ceil())
                .collect();
            let x = map(&compute, &data, [7, 10]);
            let out = max_pool(&compute, &x, side, padding).unwrap();
            let [rows, columns] = out_size;
            assert_eq!(out.dims(), [1, rows, columns, 5]);
            let g = signed(2, rows * columns * 5);
            let mut expected = vec![0.0; data.len()];
            for (i, max) in values(&out).iter().enumerate() {
                let (c, ox, oy) = (i % 5, i / 5 % columns, i / 5 / columns);
                let reach = |o: usize, limit: usize| {
                    (2 * o).saturating_sub(padding)..(2 * o + side - padding).min(limit)
                };
                let columns = reach(ox, 10);
                let window =
                    reach(oy, 7).flat_map(|y| columns.clone().map(move |x| (y * 10 + x) * 5 + c));
                let best = window
                    .reduce(|a, b| if data[b] > data[a] { b } else { a })
                    .unwrap();
                assert_eq!(*max, data[best]);
                expected[best] += g[i];
            }
            let found = pulled(&out, &g, &x);
            let pairs = found.iter().zip(&expected);
            assert!(pairs.map(|(a, b)| (a - b).abs()).fold(0.0, f32::max) < 1e-6);
        }
    }
}

#[test]
fn the_gradient_of_a_block_is_its_difference_along_a_direction() {
    let compute = cpu();
    for (stride, dilation, shortcut) in [(2, 1, true), (1, 2, true), (1, 1, false)] {
        let inputs = if shortcut { 24 } else { 32 };
        let block = Layer::Bottleneck {
            convs: Box::new([
                frozen(&compute, 1, [16, inputs], 1, [1, 1]),
                frozen(&compute, 3, [16, 16], 3, [stride, dilation]),
                frozen(&compute, 5, [32, 16], 1, [1, 1]),
            ]),
            shortcut: shortcut.then(|| frozen(&compute, 7, [32, inputs], 1, [stride, 1])),
        };
        let data = signed(9, 6 * 7 * inputs);
        let x = map(&compute, &data, [6, 7]);
        let out = block.forward(&compute, &x).unwrap();
        let g = signed(11, out.elem_count());
        // Move along the gradient itself, because crossing a kink then has little effect.
        let direction = pulled(&out, &g, &x);
        let slope = dot(&direction, &direction);
        let at = |h: f32| {
            let moved: Vec<f32> = data
                .iter()
                .zip(&direction)
                .map(|(x, d)| x + h * d)
                .collect();
            let out = block
                .forward(&compute, &map(&compute, &moved, [6, 7]))
                .unwrap();
            dot(&values(&out), &g)
        };
        let difference = (at(1e-3) - at(-1e-3)) / 2e-3;
        let deviation = (difference - slope).abs();
        assert!(
            deviation < 0.01 * slope,
            "{stride} {dilation}: {difference} {slope}"
        );
    }
}

#[test]
fn hand_case_of_both_terms() {
    let terms = |features, gram| Terms {
        features,
        gram,
        gram_per_pixel: true,
        weight: None,
    };
    let compare = |terms: Terms<'_>| terms.compare([&[1.0, 2.0], &[1.0, 0.0]], 2);
    // M̂ − M = [0 2; 2 4].
    let (value, gradient) = compare(terms(1.0, 0.0));
    assert_eq!((value, gradient), (2.0, vec![0.0, 2.0]));
    let (value, gradient) = compare(terms(1.0, 10.0));
    assert_eq!((value, gradient), (62.0, vec![40.0, 102.0]));
}

#[test]
fn the_gradient_of_both_terms_is_that_of_the_definition() {
    const D: usize = 20;
    const P: usize = 15;
    let (x, y, weight) = (noise(1, P * D), noise(2, P * D), noise(3, P));
    let terms = Terms {
        features: 1.0,
        gram: 10.0,
        gram_per_pixel: true,
        weight: Some(&weight),
    };
    let (value, gradient) = terms.compare([&x, &y], D);
    let weighted = |f: &dyn Fn(usize) -> f64| -> Vec<f64> {
        (0..P * D)
            .map(|i| f(i) * f64::from(weight[i / D]))
            .collect()
    };
    let target = weighted(&|i| f64::from(y[i]));
    check_to([1e-5, 1e-4], &x, value, &gradient, |x| {
        let x = weighted(&|i| x[i]);
        let each = x.iter().zip(&target);
        let features = each.map(|(a, b)| (a - b) * (a - b)).sum::<f64>() / (P * D) as f64;
        let gram = |f: &[f64], i: usize, j: usize| {
            (0..P).map(|p| f[p * D + i] * f[p * D + j]).sum::<f64>() / P as f64
        };
        let mut sum = 0.0;
        for (i, j) in (0..D).flat_map(|i| (0..D).map(move |j| (i, j))) {
            sum += (gram(&x, i, j) - gram(&target, i, j)).powi(2);
        }
        features + 10.0 * sum / (D * D) as f64
    });
}

/// VGG16 with other options; all tests share the packed weights.
fn with<T>(options: PerceptualOptions, then: impl FnOnce(&Perceptual) -> T) -> T {
    static SHARED: OnceLock<std::sync::Mutex<Perceptual>> = OnceLock::new();
    let new = || {
        Perceptual::new(PerceptualOptions::default(), cpu())
            .unwrap()
            .into()
    };
    let mut shared = SHARED.get_or_init(new).lock().unwrap();
    shared.options = options;
    then(&shared)
}

#[test]
fn the_gradient_through_vgg16_is_the_difference_along_directions() {
    let (width, count) = (32, 24 * 32);
    let (x, y) = (noise(1, 3 * count), noise(2, 3 * count));
    let mask: Vec<bool> = noise(3, count).iter().map(|v| *v > 0.2).collect();
    for at in [PerceptualMask::Pictures, PerceptualMask::Features] {
        let options = PerceptualOptions {
            mask: at,
            ..PerceptualOptions::default()
        };
        with(options, |loss| {
            let compare = |x: &[f32]| {
                let (x, y) = (pixels(x), pixels(&y));
                loss.compare(&x, &y, width, Some(&mask), 0).unwrap()
            };
            let found = compare(&x);
            let gradient = found.gradient.as_flattened();
            let norm = dot(gradient, gradient).sqrt() as f32;
            let steepest: Vec<f32> = gradient.iter().map(|g| g / norm).collect();
            for (direction, tolerance) in [(steepest, 0.01), (signed(4, 3 * count), 0.03)] {
                let slope = dot(gradient, &direction);
                let value = |h: f32| {
                    let moved = x.iter().zip(&direction).map(|(x, d)| x + h * d);
                    compare(&moved.collect::<Vec<_>>()).value
                };
                let difference = (value(1e-3) - value(-1e-3)) / 2e-3;
                let scale = f64::from(norm) * dot(&direction, &direction).sqrt();
                let deviation = (difference - slope).abs() / slope.abs().max(0.1 * scale);
                assert!(deviation < tolerance, "{at:?}: {difference} {slope}");
            }
        });
    }
}

#[test]
fn equal_pictures_cost_nothing_and_what_is_masked_neither() {
    let (width, count) = (20, 16 * 20);
    let (x, y) = (pixels(&noise(1, 3 * count)), pixels(&noise(2, 3 * count)));
    let mask: Vec<bool> = (0..count).map(|p| p % 20 < 12).collect();
    with(PerceptualOptions::default(), |loss| {
        let same = loss.compare(&x, &x, width, None, 0).unwrap();
        assert_eq!((same.value, same.gradient), (0.0, vec![[0.0; 3]; count]));
        let masked = loss.compare(&x, &y, width, Some(&mask), 0).unwrap();
        let outside = |p: &usize| !mask[*p];
        assert!(masked.value > 0.0);
        assert!(
            (0..count)
                .filter(outside)
                .all(|p| masked.gradient[p] == [0.0; 3])
        );
        // Equivalent to two pictures that are black outside the mask.
        let black = |picture: &[[f32; 3]]| {
            let mut picture = picture.to_vec();
            (0..count)
                .filter(outside)
                .for_each(|p| picture[p] = [0.0; 3]);
            picture
        };
        let drawn = loss
            .compare(&black(&x), &black(&y), width, None, 0)
            .unwrap();
        assert_eq!(drawn.value, masked.value);
    });
}

#[test]
fn a_crop_is_the_loss_of_its_pixels_wherever_it_lies_and_bytes_do_not_depend_on_threads() {
    let (width, height) = (30, 25);
    let (x, y) = (pixels(&noise(1, 3 * 750)), pixels(&noise(2, 3 * 750)));
    let options = PerceptualOptions {
        crop: Some(16),
        ..PerceptualOptions::default()
    };
    with(options, |loss| {
        let mut places = std::collections::BTreeSet::new();
        for seed in 0..4 {
            let run = |threads| {
                let pool = rayon::ThreadPoolBuilder::new().num_threads(threads).build();
                pool.unwrap()
                    .install(|| loss.compare(&x, &y, width, None, seed).unwrap())
            };
            let found = run(1);
            assert_eq!(found, run(3));
            let inside = |p: &usize| found.gradient[*p] != [0.0; 3];
            let touched: Vec<usize> = (0..width * height).filter(inside).collect();
            assert_eq!(touched.len(), 256);
            places.insert(touched[0]);
            let cut = |from: &[[f32; 3]]| touched.iter().map(|p| from[*p]).collect::<Vec<_>>();
            let alone = loss.compare(&cut(&x), &cut(&y), 16, None, 9).unwrap();
            assert_eq!(
                (alone.value, alone.gradient),
                (found.value, cut(&found.gradient))
            );
        }
        assert!(places.len() > 1, "{places:?}");
        let error = loss.compare(&x[..70], &y[..70], 10, None, 0).unwrap_err();
        assert!(error.to_string().contains("8 pixels per side"), "{error}");
    });
}

#[test]
fn a_file_of_another_network_is_refused_by_what_it_lacks() {
    let options = PerceptualOptions {
        resnet50dilated: Some(
            concat!(
                env!("CARGO_MANIFEST_DIR"),
                "/../../metrics/weights/alexnet.safetensors"
            )
            .into(),
        ),
        ..PerceptualOptions::default()
    };
    let error = Perceptual::new(options, cpu()).err().unwrap().to_string();
    assert!(
        error.contains("resnet50dilated") && error.contains("missing: bn1.bias"),
        "{error}"
    );
}
