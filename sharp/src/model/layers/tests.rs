use std::cell::RefCell;

use candle_core::{Device, Tensor};
use sharp_checkpoint::deterministic::model_weights;
use sharp_kernels::Algorithm;

use super::*;
use crate::model::engine::{Engine, Runtime};
use crate::model::map::Map;
use crate::model::params::Params;
use crate::model::synth::Synth;

fn runtimes() -> [Runtime; 3] {
    [
        Engine::Tensors(Device::Cpu),
        Engine::cpu(Algorithm::Direct),
        Engine::cpu(Algorithm::Winograd),
    ]
    .map(|engine| Runtime::new(engine, Box::new(Synth::default())))
}

/// Runs a layer on every engine; the planes must agree with the first's.
fn agree(shape: (usize, usize, usize), layer: impl Fn(&Runtime, &Map) -> Map) -> Vec<f32> {
    let (c, h, w) = shape;
    let planes = model_weights("", "x.weight", &[c, h, w, 1]);
    let mut reference = Vec::new();
    for rt in runtimes() {
        let x = Map::from_planes(&rt.engine, &planes, shape).unwrap();
        let found = layer(&rt, &x).to_planes().unwrap();
        if reference.is_empty() {
            reference = found;
            continue;
        }
        let exact = matches!(&rt.engine, Engine::Kernels(k) if k.convolution == Algorithm::Direct);
        let tolerance = if exact { 2e-6 } else { 1e-5 };
        assert_eq!(found.len(), reference.len());
        for (a, b) in found.iter().zip(&reference) {
            assert!((a - b).abs() < tolerance, "{a} against {b}");
        }
    }
    reference
}

fn declare<T>(build: impl FnOnce(&Params<'_>) -> T) -> T {
    build(&Params::new(&RefCell::default()))
}

#[test]
fn convolutions_agree_with_everything_fused() {
    let convs = [
        declare(|p| Conv::spatial(p, 16, 16, true)),
        declare(|p| Conv::point(p, 16, 16, false)),
    ];
    for conv in convs {
        for (relu_input, relu, with_residual) in [
            (false, false, false),
            (true, false, true),
            (false, true, true),
        ] {
            agree((16, 9, 7), |rt, x| {
                let fused = Fused {
                    relu_input,
                    residual: with_residual.then_some(x),
                    relu,
                };
                conv.forward(rt, x, fused).unwrap()
            });
        }
    }
    let blocks = declare(|p| Conv::blocks(p, 5, 6, 2));
    agree((5, 8, 6), |rt, x| {
        blocks.forward(rt, x, Fused::default()).unwrap()
    });
}

#[test]
fn blocks_are_the_general_convolution() {
    let blocks = declare(|p| Conv::blocks(p, 3, 4, 2));
    let found = agree((3, 4, 6), |rt, x| {
        blocks.forward(rt, x, Fused::default()).unwrap()
    });
    let tensor = |name: &str, shape: &[usize]| {
        Tensor::from_vec(model_weights("", name, shape), shape, &Device::Cpu).unwrap()
    };
    let x = model_weights("", "x.weight", &[3, 4, 6, 1]);
    let x = Tensor::from_vec(x, (1, 3, 4, 6), &Device::Cpu).unwrap();
    let general = x
        .conv2d(&tensor("weight", &[4, 3, 2, 2]), 0, 2, 1, 1)
        .unwrap();
    let bias = tensor("bias", &[4]).reshape((1, 4, 1, 1)).unwrap();
    let general = general.broadcast_add(&bias).unwrap().flatten_all().unwrap();
    for (a, b) in found.iter().zip(general.to_vec1::<f32>().unwrap()) {
        assert!((a - b).abs() < 2e-6, "{a} against {b}");
    }
}

#[test]
fn deconvolutions_agree_with_the_general_one() {
    let deconv = declare(|p| Deconv::new(p, 3, 2, false));
    let found = agree((3, 4, 5), |rt, x| deconv.forward(rt, x).unwrap());
    let with_bias = declare(|p| Deconv::new(p, 8, 6, true));
    agree((8, 3, 5), |rt, x| with_bias.forward(rt, x).unwrap());
    let weight = model_weights("", "weight", &[3, 2, 2, 2]);
    let weight = Tensor::from_vec(weight, (3, 2, 2, 2), &Device::Cpu).unwrap();
    let x = model_weights("", "x.weight", &[3, 4, 5, 1]);
    let x = Tensor::from_vec(x, (1, 3, 4, 5), &Device::Cpu).unwrap();
    let general = x.conv_transpose2d(&weight, 0, 0, 2, 1).unwrap();
    let general = general.flatten_all().unwrap().to_vec1::<f32>().unwrap();
    for (a, b) in found.iter().zip(general) {
        assert!((a - b).abs() < 2e-6, "{a} against {b}");
    }
}

#[test]
fn group_norms_agree() {
    let norm = declare(|p| GroupNormLayer::new(p, 8, 4));
    agree((8, 16, 12), |rt, x| norm.forward(rt, x).unwrap());
}
