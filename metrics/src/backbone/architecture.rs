//! Layers of the three networks (torchvision's `features`, whose indices are part of the tensor names).

use sharp_checkpoint::Expected;

use crate::weights::Backbone;

/// A layer of a network; every convolution is followed by a ReLU.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(crate) enum LayerSpec {
    /// Square convolution with bias.
    Conv {
        /// torchvision's index of the convolution.
        index: usize,
        /// Output channels.
        out: usize,
        kernel: usize,
        stride: usize,
        padding: usize,
    },
    /// Max pooling of size `kernel`, stride 2, without padding.
    MaxPool {
        kernel: usize,
        /// True if a window that extends beyond the input is kept.
        ceil: bool,
    },
    /// SqueezeNet's module: a 1×1 convolution, followed by a 1×1 and a padded 3×3 convolution in parallel.
    Fire {
        /// torchvision's index of the module.
        index: usize,
        squeeze: usize,
        /// Output channels of each of the two parallel convolutions.
        expand: usize,
    },
    /// Not a layer: marks the output of the preceding layer as a tap, i.e. as features that are compared.
    Tap,
}

use LayerSpec::{Conv, Fire, MaxPool, Tap};

const fn conv3(index: usize, out: usize) -> LayerSpec {
    Conv {
        index,
        out,
        kernel: 3,
        stride: 1,
        padding: 1,
    }
}

const fn fire(index: usize, squeeze: usize, expand: usize) -> LayerSpec {
    Fire {
        index,
        squeeze,
        expand,
    }
}

const fn max_pool(kernel: usize, ceil: bool) -> LayerSpec {
    MaxPool { kernel, ceil }
}

const ALEXNET: &[LayerSpec] = &[
    Conv {
        index: 0,
        out: 64,
        kernel: 11,
        stride: 4,
        padding: 2,
    },
    Tap,
    max_pool(3, false),
    Conv {
        index: 3,
        out: 192,
        kernel: 5,
        stride: 1,
        padding: 2,
    },
    Tap,
    max_pool(3, false),
    conv3(6, 384),
    Tap,
    conv3(8, 256),
    Tap,
    conv3(10, 256),
    Tap,
];

const VGG16: &[LayerSpec] = &[
    conv3(0, 64),
    conv3(2, 64),
    Tap,
    max_pool(2, false),
    conv3(5, 128),
    conv3(7, 128),
    Tap,
    max_pool(2, false),
    conv3(10, 256),
    conv3(12, 256),
    conv3(14, 256),
    Tap,
    max_pool(2, false),
    conv3(17, 512),
    conv3(19, 512),
    conv3(21, 512),
    Tap,
    max_pool(2, false),
    conv3(24, 512),
    conv3(26, 512),
    conv3(28, 512),
    Tap,
];

const SQUEEZENET1_1: &[LayerSpec] = &[
    Conv {
        index: 0,
        out: 64,
        kernel: 3,
        stride: 2,
        padding: 0,
    },
    Tap,
    max_pool(3, true),
    fire(3, 16, 64),
    fire(4, 16, 64),
    Tap,
    max_pool(3, true),
    fire(6, 32, 128),
    fire(7, 32, 128),
    Tap,
    max_pool(3, true),
    fire(9, 48, 192),
    Tap,
    fire(10, 48, 192),
    Tap,
    fire(11, 64, 256),
    Tap,
    fire(12, 64, 256),
    Tap,
];

pub(crate) fn layer_specs(backbone: Backbone) -> &'static [LayerSpec] {
    match backbone {
        Backbone::AlexNet => ALEXNET,
        Backbone::Vgg16 => VGG16,
        Backbone::SqueezeNet1_1 => SQUEEZENET1_1,
    }
}

pub(crate) fn tap_channels(backbone: Backbone) -> Vec<usize> {
    let mut channels = 3;
    let mut taps = Vec::new();
    for step in layer_specs(backbone) {
        match *step {
            Conv { out, .. } => channels = out,
            Fire { expand, .. } => channels = 2 * expand,
            MaxPool { .. } => {}
            Tap => taps.push(channels),
        }
    }
    taps
}

/// Minimum side of a picture for which every pooling leaves a pixel.
pub(crate) fn smallest_side(backbone: Backbone) -> usize {
    match backbone {
        Backbone::AlexNet => 31,
        Backbone::Vgg16 => 16,
        Backbone::SqueezeNet1_1 => 17,
    }
}

/// All tensors of the features, in order.
pub(crate) fn tensors(backbone: Backbone) -> Vec<Expected> {
    let mut channels = 3;
    let mut tensors = Vec::new();
    let mut push = |name: String, shape: [usize; 4]| {
        tensors.push(Expected {
            name: format!("{name}.weight"),
            shape: shape.to_vec(),
        });
        tensors.push(Expected {
            name: format!("{name}.bias"),
            shape: vec![shape[0]],
        });
    };
    for step in layer_specs(backbone) {
        match *step {
            Conv {
                index, out, kernel, ..
            } => {
                push(index.to_string(), [out, channels, kernel, kernel]);
                channels = out;
            }
            Fire {
                index,
                squeeze,
                expand,
            } => {
                push(format!("{index}.squeeze"), [squeeze, channels, 1, 1]);
                push(format!("{index}.expand1x1"), [expand, squeeze, 1, 1]);
                push(format!("{index}.expand3x3"), [expand, squeeze, 3, 3]);
                channels = 2 * expand;
            }
            MaxPool { .. } | Tap => {}
        }
    }
    tensors
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn parameters_number_as_published() {
        // 2.47, 14.7 and 0.72 million.
        let count = |backbone| -> usize {
            let tensors = tensors(backbone);
            tensors
                .iter()
                .map(|t| t.shape.iter().product::<usize>())
                .sum()
        };
        assert_eq!(count(Backbone::AlexNet), 2_469_696);
        assert_eq!(count(Backbone::Vgg16), 14_714_688);
        assert_eq!(count(Backbone::SqueezeNet1_1), 722_496);
    }

    #[test]
    fn taps_have_the_channels_of_the_linear_weights() {
        assert_eq!(tap_channels(Backbone::AlexNet), [64, 192, 384, 256, 256]);
        assert_eq!(tap_channels(Backbone::Vgg16), [64, 128, 256, 512, 512]);
        assert_eq!(
            tap_channels(Backbone::SqueezeNet1_1),
            [64, 128, 256, 384, 384, 512, 512]
        );
    }
}
