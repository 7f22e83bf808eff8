//! Compares the results of every operation on our kernels and by candle with each other, and
//! gradients with central differences in f64.

use sharp_kernels::{Algorithm, Simd};

use candle_core::{DType, Device, Var};
use sharp_kernels::ConvSpec;

use super::*;
use crate::model::compute::Kernels;
use crate::random::SplitMix64;

type Operation<'a> = &'a dyn Fn(Option<Kernels>, &[Tensor]) -> Result<Tensor>;

fn noise(seed: u64, len: usize) -> Vec<f64> {
    let mut random = SplitMix64::new(seed);
    // Values that f32 represents exactly, so that both precisions have the same inputs.
    let mut value = || f64::from(random.between(-1.0, 1.0) as f32);
    (0..len).map(|_| value()).collect()
}

fn tensor(values: &[f64], shape: &[usize], dtype: DType) -> Tensor {
    let tensor = Tensor::from_slice(values, shape, &Device::Cpu).unwrap();
    tensor.to_dtype(dtype).unwrap()
}

fn values(tensor: &Tensor) -> Vec<f64> {
    let tensor = tensor.flatten_all().unwrap().to_dtype(DType::F64).unwrap();
    tensor.to_vec1().unwrap()
}

/// Relative error in the L2 norm.
fn error(found: &[f64], exact: &[f64]) -> f64 {
    assert_eq!(found.len(), exact.len());
    let square = |v: f64| v * v;
    let pairs = found.iter().zip(exact);
    let error: f64 = pairs.map(|(a, b)| square(a - b)).sum();
    (error / exact.iter().map(|v| square(*v)).sum::<f64>()).sqrt()
}

/// Candle's operations, and our kernels in training mode, with both algorithms on every instruction
/// set.
fn backends() -> Vec<Option<Kernels>> {
    let kernels = Simd::available().into_iter().flat_map(|simd| {
        [Algorithm::Direct, Algorithm::Winograd].map(|convolution| {
            Some(Kernels {
                simd,
                convolution,
                learning: true,
            })
        })
    });
    [None].into_iter().chain(kernels).collect()
}

/// Checks the result and the gradients of all inputs on every backend, and the result on backends
/// that do not train.
fn check(name: &str, shapes: &[&[usize]], operation: Operation<'_>) {
    let inputs: Vec<Vec<f64>> = (shapes.iter().enumerate())
        .map(|(k, shape)| noise(k as u64 + 1, shape.iter().product()))
        .collect();
    let all = |inputs: &[Vec<f64>], dtype| -> Vec<Tensor> {
        let pairs = inputs.iter().zip(shapes);
        pairs.map(|(v, shape)| tensor(v, shape, dtype)).collect()
    };
    let run = |inputs: &[Vec<f64>]| values(&operation(None, &all(inputs, DType::F64)).unwrap());
    let exact = run(&inputs);
    let upstream = noise(99, exact.len());
    let loss = |inputs: &[Vec<f64>]| -> f64 {
        let pairs = run(inputs).into_iter().zip(&upstream);
        pairs.map(|(y, g)| y * g).sum()
    };
    let slope = |input: usize, at: usize| {
        let step = 1e-6;
        let moved = |by: f64| {
            let mut inputs = inputs.clone();
            inputs[input][at] += by;
            loss(&inputs)
        };
        (moved(step) - moved(-step)) / (2.0 * step)
    };
    let slopes: Vec<Vec<f64>> = (0..inputs.len())
        .map(|input| {
            (0..inputs[input].len())
                .map(|at| slope(input, at))
                .collect()
        })
        .collect();
    for kernels in backends() {
        let variables: Vec<Tensor> = all(&inputs, DType::F32)
            .iter()
            .map(|input| Var::from_tensor(input).unwrap().into_inner())
            .collect();
        let y = operation(kernels, &variables).unwrap();
        let off = error(&values(&y), &exact);
        assert!(off < 3e-6, "{name} on {kernels:?}: {off}");
        let g = tensor(&upstream, y.dims(), DType::F32);
        let found = (y * g).unwrap().sum_all().unwrap().backward().unwrap();
        for (input, (variable, slopes)) in variables.iter().zip(&slopes).enumerate() {
            let found = found.get(variable).expect("a gradient of every input");
            assert_eq!(found.dims(), variable.dims());
            let off = error(&values(found), slopes);
            assert!(off < 1e-5, "{name}, input {input} on {kernels:?}: {off}");
        }
        let kernels = kernels.map(|kernels| Kernels {
            learning: false,
            ..kernels
        });
        let y = operation(kernels, &all(&inputs, DType::F32)).unwrap();
        let off = error(&values(&y), &exact);
        assert!(off < 3e-6, "{name}, not learning, on {kernels:?}: {off}");
    }
}

#[test]
fn convolutions_with_everything_fused() {
    for (name, [input, output, kernel, stride, padding]) in [
        ("3×3", [3, 5, 3, 1, 1]),
        ("Winograd's 3×3", [16, 4, 3, 1, 1]),
        ("1×1", [6, 5, 1, 1, 0]),
        ("blocks", [3, 4, 2, 2, 0]),
    ] {
        let spec = ConvSpec {
            in_channels: input,
            out_channels: output,
            kernel,
            stride,
            padding,
        };
        let x = &[1, 6, 4, input][..];
        let weight = &[output, input, kernel, kernel][..];
        let y = &[1, 6 / stride, 4 / stride, output][..];
        for (relu_input, relu) in [(false, false), (true, false), (true, true)] {
            let operation = Convolution {
                spec,
                relu_input,
                relu,
                packed: None,
            };
            check(name, &[x, weight], &|kernels, t| {
                operation.run(kernels, &t[0], &t[1], None, None)
            });
            check(name, &[x, weight, &[output]], &|kernels, t| {
                operation.run(kernels, &t[0], &t[1], Some(&t[2]), None)
            });
            check(name, &[x, weight, &[output], y], &|kernels, t| {
                operation.run(kernels, &t[0], &t[1], Some(&t[2]), Some(&t[3]))
            });
        }
    }
}

/// Compares deconvolutions whose kernel size equals their stride with candle's general
/// deconvolution.
#[test]
fn deconvolutions() {
    let (x, weight) = (&[1, 3, 4, 5][..], &[5, 2, 2, 2][..]);
    check("without bias", &[x, weight], &|kernels, t| {
        deconvolution(kernels, &t[0], &t[1], None)
    });
    check("with bias", &[x, weight, &[2]], &|kernels, t| {
        deconvolution(kernels, &t[0], &t[1], Some(&t[2]))
    });
    let [x, weight] = [(1, x), (2, weight)]
        .map(|(seed, shape)| tensor(&noise(seed, shape.iter().product()), shape, DType::F64));
    let planes = x.permute((0, 3, 1, 2)).unwrap().contiguous().unwrap();
    let general = planes.conv_transpose2d(&weight, 0, 0, 2, 1).unwrap();
    let general = general.permute((0, 2, 3, 1)).unwrap();
    let found = deconvolution(None, &x, &weight, None).unwrap();
    assert!(error(&values(&found), &values(&general)) < 1e-12);
}

#[test]
fn normalisations() {
    for relu in [false, true] {
        check("group norm", &[&[1, 5, 3, 8], &[8], &[8]], &|kernels, t| {
            group_norm(kernels, &t[0], [&t[1], &t[2]], (4, 1e-5, relu))
        });
    }
    check("layer norm", &[&[2, 3, 17], &[17], &[17]], &|kernels, t| {
        layer_norm(kernels, &t[0], [&t[1], &t[2]], 1e-6)
    });
}

#[test]
fn tokens() {
    check("attention", &[&[2, 5, 36]], &|kernels, t| {
        attention(kernels, &t[0], 3)
    });
    let (x, weight) = (&[2, 3, 6][..], &[5, 6][..]);
    let layer = |kernels, t: &[Tensor]| Linear::new(kernels, t[1].clone(), t[2].clone());
    check("linear", &[x, weight, &[5]], &|kernels, t| {
        layer(kernels, t)?.forward(&t[0])
    });
    check("linear and GELU", &[x, weight, &[5]], &|kernels, t| {
        layer(kernels, t)?.forward_gelu(&t[0])
    });
    check("residual", &[x, weight, &[5], &[2, 3, 5]], &|kernels, t| {
        layer(kernels, t)?.add_to(t[3].copy()?, &t[0])
    });
    let places = Tensor::new(&[4_u32, 1, 0, 4], &Device::Cpu).unwrap();
    check("gather", &[x], &|_, t| gather(&t[0], &places));
}

#[test]
fn images() {
    let x = &[1, 4, 6, 3][..];
    check("pooling", &[x], &|_, t| avg_pool(&t[0], 2));
    check("doubling", &[x], &|_, t| double_nearest(&t[0]));
    let planes: Vec<f32> = (0..24).map(|k| k as f32).collect();
    let image = from_planes(&planes, (2, 3, 4), &Device::Cpu).unwrap();
    assert_eq!(image.dims(), [1, 3, 4, 2]);
    assert_eq!(to_planes(&image).unwrap(), planes);
    assert_eq!(
        image.flatten_all().unwrap().to_vec1::<f32>().unwrap()[..2],
        [0.0, 12.0]
    );
}

#[test]
fn nothing_passes_a_rectification_at_zero_and_nan_is_not_lost() {
    let spec = ConvSpec {
        in_channels: 1,
        out_channels: 1,
        kernel: 1,
        stride: 1,
        padding: 0,
    };
    let operation = Convolution {
        spec,
        relu_input: true,
        relu: false,
        packed: None,
    };
    for kernels in backends() {
        let x = Var::new(&[[[[0.0_f32], [f32::NAN], [2.0]]]], &Device::Cpu).unwrap();
        let weight = Tensor::ones((1, 1, 1, 1), DType::F32, &Device::Cpu).unwrap();
        let y = operation
            .run(kernels, x.as_tensor(), &weight, None, None)
            .unwrap();
        assert!(values(&y)[1].is_nan());
        let found = y.sum_all().unwrap().backward().unwrap();
        let found = values(found.get(&x).unwrap());
        assert_eq!((found[0], found[2]), (0.0, 1.0), "{kernels:?}");
    }
}
