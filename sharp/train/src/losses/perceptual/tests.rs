//! Layers against their definitions, gradients as adjoints and by differences along directions.

use super::super::testing::{check_to, noise, pixels};
use super::conv::{FeatureMap, FrozenConv};
use super::distance::Terms;
use super::layers::{Bottleneck, Layer};
use super::pool::MaxPool;
use super::*;
use sharp::random::SplitMix64;
use std::sync::OnceLock;

fn signed(seed: u64, count: usize) -> Vec<f32> {
    let mut random = SplitMix64::new(seed);
    (0..count)
        .map(|_| random.between(-1.0, 1.0) as f32)
        .collect()
}

fn map(seed: u64, [height, width]: [usize; 2], channels: usize) -> FeatureMap {
    FeatureMap {
        height,
        width,
        channels,
        data: signed(seed, height * width * channels),
    }
}

fn dot(a: &[f32], b: &[f32]) -> f64 {
    assert_eq!(a.len(), b.len());
    a.iter()
        .zip(b)
        .map(|(a, b)| f64::from(*a) * f64::from(*b))
        .sum()
}

/// Weights that keep the size of their input's values.
fn weights(seed: u64, [out, inputs]: [usize; 2], kernel: usize) -> (Vec<f32>, Vec<f32>) {
    let fan = inputs * kernel * kernel;
    let bound = (6.0 / fan as f32).sqrt();
    let weight = signed(seed, out * fan).into_iter().map(|w| w * bound);
    (weight.collect(), signed(seed + 1, out))
}

fn frozen(
    seed: u64,
    channels: [usize; 2],
    kernel: usize,
    stride: usize,
    dilation: usize,
) -> FrozenConv {
    let (weight, bias) = weights(seed, channels, kernel);
    let [out, inputs] = channels;
    let shape = [out, inputs, kernel];
    FrozenConv::new(Simd::detect(), shape, [&weight, &bias], [stride, dilation])
}

#[test]
fn convolutions_match_their_definition_and_pull_back_by_the_adjoint() {
    for (kernel, stride, dilation) in [
        (3, 1, 1),
        (3, 2, 1),
        (1, 1, 1),
        (1, 2, 1),
        (3, 1, 2),
        (3, 1, 4),
    ] {
        let (size, channels) = ([7, 10], [19, 16]);
        let conv = frozen(1, channels, kernel, stride, dilation);
        let (weight, bias) = weights(1, channels, kernel);
        let x = map(3, size, channels[1]);
        let out = conv.run(&x, None, false);
        assert_eq!(out.size(), size.map(|side| side.div_ceil(stride)));
        let reach = kernel / 2 * dilation;
        for (i, found) in out.data.iter().enumerate() {
            let (o, p) = (i % channels[0], i / channels[0]);
            let (y, x0) = (p / out.width * stride, p % out.width * stride);
            let mut sum = f64::from(bias[o]);
            for (tap, c) in (0..kernel * kernel).flat_map(|t| (0..16).map(move |c| (t, c))) {
                let (iy, ix) = (y + tap / kernel * dilation, x0 + tap % kernel * dilation);
                if (reach..7 + reach).contains(&iy) && (reach..10 + reach).contains(&ix) {
                    let v = x.data[((iy - reach) * 10 + ix - reach) * 16 + c];
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
        let g = map(5, out.size(), channels[0]);
        let back = conv.pull(&g, size, None);
        let of_bias: f64 = g.data.chunks(19).map(|g| dot(g, &bias)).sum();
        let (left, right) = (dot(&out.data, &g.data), dot(&x.data, &back.data) + of_bias);
        assert!(
            (left - right).abs() < 1e-3,
            "{kernel} {stride} {dilation}: {left} {right}"
        );
    }
}

#[test]
fn maxima_are_found_and_their_gradient_goes_where_they_were() {
    for (side, padding, out_size) in [(2, 0, [3, 5]), (3, 1, [4, 5])] {
        let pool = MaxPool { side, padding };
        let x = FeatureMap {
            data: noise(1, 7 * 10 * 5),
            ..map(1, [7, 10], 5)
        };
        let (out, pull) = pool.trace(&x);
        assert_eq!(out.size(), out_size);
        let g = map(2, out.size(), 5);
        let found = pull(g.clone());
        let mut expected = vec![0.0; x.data.len()];
        for (i, max) in out.data.iter().enumerate() {
            let (c, ox, oy) = (i % 5, i / 5 % out.width, i / 5 / out.width);
            let reach = |o: usize, limit: usize| {
                (2 * o).saturating_sub(padding)..(2 * o + side - padding).min(limit)
            };
            let columns = reach(ox, 10);
            let window =
                reach(oy, 7).flat_map(|y| columns.clone().map(move |x| (y * 10 + x) * 5 + c));
            let best = window
                .reduce(|a, b| if x.data[b] > x.data[a] { b } else { a })
                .unwrap();
            assert_eq!(*max, x.data[best]);
            expected[best] += g.data[i];
        }
        assert_eq!(found.data, expected);
    }
}

#[test]
fn the_gradient_of_a_block_is_its_difference_along_a_direction() {
    for (stride, dilation, shortcut) in [(2, 1, true), (1, 2, true), (1, 1, false)] {
        let inputs = if shortcut { 24 } else { 32 };
        let block = Bottleneck {
            narrow: frozen(1, [16, inputs], 1, 1, 1),
            middle: frozen(3, [16, 16], 3, stride, dilation),
            widen: frozen(5, [32, 16], 1, 1, 1),
            shortcut: shortcut.then(|| frozen(7, [32, inputs], 1, stride, 1)),
        };
        let x = map(9, [6, 7], inputs);
        let (out, pull) = block.trace(&x);
        let g = map(11, out.size(), 32);
        // Along itself, where a kink met on the way counts little.
        let direction = pull(g.clone());
        let slope = dot(&direction.data, &direction.data);
        let at = |h: f32| {
            let mut moved = x.clone();
            let pairs = moved.data.iter_mut().zip(&direction.data);
            pairs.for_each(|(x, d)| *x += h * d);
            dot(&block.trace(&moved).0.data, &g.data)
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
    let one = |data: [f32; 2]| FeatureMap {
        height: 1,
        width: 1,
        channels: 2,
        data: data.to_vec(),
    };
    let terms = |features, gram| Terms {
        features,
        gram,
        weight: None,
    };
    let compare = |terms: Terms<'_>| terms.compare(&one([1.0, 2.0]), &one([1.0, 0.0]));
    // M̂ − M = [0 2; 2 4].
    let (value, gradient) = compare(terms(1.0, 0.0));
    assert_eq!((value, gradient.data), (2.0, vec![0.0, 2.0]));
    let (value, gradient) = compare(terms(1.0, 10.0));
    assert_eq!((value, gradient.data), (62.0, vec![40.0, 102.0]));
}

#[test]
fn the_gradient_of_both_terms_is_that_of_the_definition() {
    const D: usize = 20;
    const P: usize = 15;
    let map = |seed| FeatureMap {
        height: 3,
        width: 5,
        channels: D,
        data: noise(seed, P * D),
    };
    let (x, y, weight) = (map(1), map(2), noise(3, P));
    let terms = Terms {
        features: 1.0,
        gram: 10.0,
        weight: Some(&weight),
    };
    let (value, gradient) = terms.compare(&x, &y);
    let weighted = |f: &dyn Fn(usize) -> f64| -> Vec<f64> {
        (0..P * D)
            .map(|i| f(i) * f64::from(weight[i / D]))
            .collect()
    };
    let target = weighted(&|i| f64::from(y.data[i]));
    check_to([1e-5, 1e-4], &x.data, value, &gradient.data, |x| {
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

/// VGG16 with other options; its weights are packed once for all tests.
fn with<T>(options: PerceptualOptions, then: impl FnOnce(&Perceptual) -> T) -> T {
    static SHARED: OnceLock<std::sync::Mutex<Perceptual>> = OnceLock::new();
    let new = || {
        Perceptual::new(PerceptualOptions::default())
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
        // As if both were black there.
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
        assert!(error.to_string().contains("8 pixels a side"), "{error}");
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
    let error = Perceptual::new(options).unwrap_err().to_string();
    assert!(
        error.contains("resnet50dilated") && error.contains("missing: bn1.bias"),
        "{error}"
    );
}
