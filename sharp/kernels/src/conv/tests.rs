//! Compares convolutions with direct sums in f64, and whole images with strips of rows.

use super::*;
use crate::testing::{noise, relative_error, with_threads};

struct Case {
    spec: ConvSpec,
    height: usize,
    width: usize,
}

fn case(sizes: [usize; 2], channels: [usize; 2], window: [usize; 3]) -> Case {
    Case {
        spec: ConvSpec {
            in_channels: channels[0],
            out_channels: channels[1],
            kernel: window[0],
            stride: window[1],
            padding: window[2],
        },
        height: sizes[0],
        width: sizes[1],
    }
}

/// Convolutions as in the three backbones and the network, at odd sizes.
fn cases() -> Vec<Case> {
    vec![
        case([13, 17], [3, 64], [3, 1, 1]),
        case([9, 30], [64, 48], [3, 1, 1]),
        case([4, 4], [16, 16], [3, 1, 1]),
        case([1, 1], [16, 20], [3, 1, 1]),
        case([22, 7], [528, 33], [3, 1, 1]),
        case([31, 45], [3, 64], [11, 4, 2]),
        case([11, 8], [64, 40], [5, 1, 2]),
        case([17, 20], [3, 64], [3, 2, 0]),
        case([12, 10], [5, 24], [2, 2, 0]),
        case([7, 9], [48, 32], [1, 1, 0]),
        case([32, 48], [3, 40], [16, 16, 0]),
        case([2, 3], [4, 5], [7, 1, 3]),
    ]
}

impl Case {
    fn image(&self) -> Vec<f32> {
        noise(7, self.height * self.width * self.spec.in_channels)
    }

    fn weights(&self) -> (Vec<f32>, Vec<f32>) {
        let fan_in = (self.spec.weight_len() / self.spec.out_channels) as f32;
        let mut weight = noise(8, self.spec.weight_len());
        weight.iter_mut().for_each(|v| *v /= fan_in.sqrt());
        (weight, noise(9, self.spec.out_channels))
    }

    fn exact(&self, image: &[f32], weight: &[f32], bias: &[f32]) -> Vec<f64> {
        let ConvSpec {
            in_channels: c,
            kernel,
            stride,
            padding,
            ..
        } = self.spec;
        let (oh, ow) = (
            self.spec.out_side(self.height),
            self.spec.out_side(self.width),
        );
        let mut out = Vec::new();
        for (y, x) in (0..oh).flat_map(|y| (0..ow).map(move |x| (y, x))) {
            for (o, b) in bias.iter().enumerate() {
                let mut sum = f64::from(*b);
                for (ky, kx) in (0..kernel).flat_map(|ky| (0..kernel).map(move |kx| (ky, kx))) {
                    let (iy, ix) = (y * stride + ky, x * stride + kx);
                    if iy < padding || ix < padding {
                        continue;
                    }
                    let (iy, ix) = (iy - padding, ix - padding);
                    if iy >= self.height || ix >= self.width {
                        continue;
                    }
                    for i in 0..c {
                        let w = weight[((o * c + i) * kernel + ky) * kernel + kx];
                        let v = image[(iy * self.width + ix) * c + i];
                        sum += f64::from(w) * f64::from(v);
                    }
                }
                out.push(sum);
            }
        }
        out
    }
}

fn run_whole(op: &impl RowOp, input: &RowWindow<'_>, threads: usize) -> Vec<f32> {
    let (h, w) = op.out_size(input.height(), input.width());
    let mut out = vec![f32::NAN; h * w * op.out_channels(input.channels())];
    with_threads(threads, || {
        op.run_rows(input, 0..h, &mut out);
    });
    out
}

/// Runs `op` in strips of `strip` rows; each gets only the input rows that it requests.
fn run_strips(op: &impl RowOp, image: &[f32], shape: [usize; 3], strip: usize) -> Vec<f32> {
    let [height, width, channels] = shape;
    let (h, w) = op.out_size(height, width);
    let row = w * op.out_channels(channels);
    let mut out = vec![f32::NAN; h * row];
    for y in (0..h).step_by(strip) {
        let rows = y..h.min(y + strip);
        let needed = op.in_rows(rows.clone(), height);
        let data = &image[needed.start * width * channels..needed.end * width * channels];
        let window = RowWindow::new(data, needed, height, width, channels);
        let out = &mut out[rows.start * row..rows.end * row];
        op.run_rows(&window, rows, out);
    }
    out
}

#[test]
fn convolutions_match_exact_sums_at_every_level() {
    for case in cases() {
        let image = case.image();
        let (weight, bias) = case.weights();
        let exact = case.exact(&image, &weight, &bias);
        let Case {
            spec,
            height,
            width,
        } = case;
        let window = RowWindow::whole(&image, height, width, spec.in_channels);
        for simd in Simd::available() {
            for algorithm in [Algorithm::Direct, Algorithm::Winograd] {
                let conv = Conv2d::new(simd, spec, &weight, Some(&bias), false, algorithm);
                let found = run_whole(&conv, &window, 1);
                let limit = match conv.algorithm() {
                    Algorithm::Direct => 1e-6,
                    Algorithm::Winograd => 5e-6,
                };
                let error = relative_error(&found, &exact);
                assert!(error < limit, "{simd:?} {spec:?} {algorithm:?}: {error}");
            }
        }
    }
}

#[test]
fn strips_and_threads_change_no_bit() {
    for case in cases() {
        let image = case.image();
        let (weight, bias) = case.weights();
        let Case {
            spec,
            height,
            width,
        } = case;
        let window = RowWindow::whole(&image, height, width, spec.in_channels);
        for simd in Simd::available() {
            for algorithm in [Algorithm::Direct, Algorithm::Winograd] {
                let conv = Conv2d::new(simd, spec, &weight, Some(&bias), true, algorithm);
                let whole = run_whole(&conv, &window, 1);
                assert!(whole.iter().all(|&v| v >= 0.0));
                assert_eq!(
                    whole,
                    run_whole(&conv, &window, 3),
                    "{spec:?} {algorithm:?}"
                );
                for strip in [1, 3, 4, 7] {
                    let shape = [height, width, spec.in_channels];
                    let strips = run_strips(&conv, &image, shape, strip);
                    assert_eq!(whole, strips, "{simd:?} {spec:?} {algorithm:?} {strip}");
                }
            }
        }
    }
}

#[test]
fn options_are_fused_in_the_right_order() {
    let case = case([6, 9], [32, 24], [3, 1, 1]);
    let image = case.image();
    let (weight, bias) = case.weights();
    let rectified: Vec<f32> = image.iter().map(|v| v.max(0.0)).collect();
    let residual = noise(11, 6 * 9 * 24);
    let exact: Vec<f64> = case
        .exact(&rectified, &weight, &bias)
        .iter()
        .zip(&residual)
        .map(|(v, r)| (v + f64::from(*r)).max(0.0))
        .collect();
    let window = RowWindow::whole(&image, 6, 9, 32);
    for simd in Simd::available() {
        for algorithm in [Algorithm::Direct, Algorithm::Winograd] {
            let conv = Conv2d::new(simd, case.spec, &weight, Some(&bias), false, algorithm);
            let mut out = vec![f32::NAN; residual.len()];
            let options = ConvOptions {
                relu_input: true,
                residual: Some(&residual),
                relu: true,
            };
            conv.run_rows_with(&window, 0..6, &mut out, options);
            assert!(
                relative_error(&out, &exact) < 5e-6,
                "{simd:?} {algorithm:?}"
            );
        }
    }
}

#[test]
fn transposed_convolution_matches_its_definition_in_any_strips() {
    let (h, w, c, n) = (5, 7, 34, 19);
    let image = noise(1, h * w * c);
    let weight = noise(2, c * n * 4);
    let bias = noise(3, n);
    let mut exact = vec![0.0; 4 * h * w * n];
    for (i, exact) in exact.iter_mut().enumerate() {
        let (y, x, o) = (i / (2 * w * n), i / n % (2 * w), i % n);
        let sum: f64 = (0..c)
            .map(|k| {
                let v = image[(y / 2 * w + x / 2) * c + k];
                f64::from(v) * f64::from(weight[((k * n + o) * 2 + y % 2) * 2 + x % 2])
            })
            .sum();
        *exact = sum + f64::from(bias[o]);
    }
    for simd in Simd::available() {
        let op = TransposedConv2x2::new(simd, c, n, &weight, Some(&bias));
        let whole = run_whole(&op, &RowWindow::whole(&image, h, w, c), 2);
        assert!(relative_error(&whole, &exact) < 1e-6, "{simd:?}");
        for strip in [1, 2, 3, 10] {
            assert_eq!(whole, run_strips(&op, &image, [h, w, c], strip), "{strip}");
        }
    }
}

#[test]
fn winograd_keeps_the_precision_its_points_promise() {
    let case = case([24, 24], [256, 32], [3, 1, 1]);
    let image: Vec<f32> = case.image().iter().map(|v| v.max(0.0)).collect();
    let (weight, bias) = case.weights();
    let exact = case.exact(&image, &weight, &bias);
    let window = RowWindow::whole(&image, 24, 24, 256);
    let error = |algorithm| {
        let simd = Simd::detect();
        let conv = Conv2d::new(simd, case.spec, &weight, Some(&bias), false, algorithm);
        relative_error(&run_whole(&conv, &window, 1), &exact)
    };
    let (direct, winograd) = (error(Algorithm::Direct), error(Algorithm::Winograd));
    // Measured: 1.3e-7 and 6.3e-7. With the points 0, ±1, ±2, the error would exceed 1e-6.
    assert!(direct < 3e-7 && winograd < 8e-7, "{direct:e} {winograd:e}");
}

#[test]
fn too_small_images_have_no_output() {
    let case = case([2, 2], [3, 4], [11, 4, 2]);
    let (weight, bias) = case.weights();
    let conv = Conv2d::new(
        Simd::detect(),
        case.spec,
        &weight,
        Some(&bias),
        false,
        Algorithm::Direct,
    );
    assert_eq!(conv.out_size(6, 7), (0, 1));
}

#[test]
#[should_panic(expected = "are needed")]
fn missing_input_rows_are_refused() {
    let case = case([8, 8], [16, 16], [3, 1, 1]);
    let (weight, _) = case.weights();
    let conv = Conv2d::new(
        Simd::detect(),
        case.spec,
        &weight,
        None,
        false,
        Algorithm::Winograd,
    );
    let data = vec![0.0; 4 * 8 * 16];
    let window = RowWindow::new(&data, 0..4, 8, 8, 16);
    conv.run_rows(&window, 0..4, &mut [0.0; 4 * 8 * 16]);
}

#[test]
fn nan_is_not_rectified_away() {
    let case = case([6, 6], [16, 16], [3, 1, 1]);
    let mut image = case.image();
    image[0] = f32::NAN;
    let (weight, _) = case.weights();
    let window = RowWindow::whole(&image, 6, 6, 16);
    for simd in Simd::available() {
        for algorithm in [Algorithm::Direct, Algorithm::Winograd] {
            let conv = Conv2d::new(simd, case.spec, &weight, None, true, algorithm);
            let mut out = vec![0.0; 6 * 6 * 16];
            let options = ConvOptions {
                relu_input: true,
                relu: true,
                ..ConvOptions::default()
            };
            conv.run_rows_with(&window, 0..6, &mut out, options);
            assert!(out[0].is_nan(), "{simd:?} {algorithm:?}");
        }
    }
}
