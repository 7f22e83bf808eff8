//! The encoder of LaMa's loss: ResNet-50 trained for segmentation on ADE20K (`resnet50dilated` of
//! CSAIL's semantic-segmentation-pytorch), in evaluation mode.
//!
//! Three 3×3 convolutions, the first with stride 2, replace the 7×7 one. Max pooling follows, then
//! stages of 3, 4, 6 and 3 blocks with 256 to 2048 channels. The last two stages preserve
//! resolution: in the third, the first 3×3 convolution has dilation 1 and the others 2; in the
//! fourth, 2 and 4. Features are compared after each stage.

use super::layers::Layer;
use super::{Network, PerceptualError};
use sharp::model::{Compute, FrozenConvolution};
use sharp_checkpoint::{Checkpoint, Expected};
use std::path::Path;

/// Added to the variance in batch normalisation (PyTorch's default).
const EPSILON: f64 = 1e-5;

/// A convolution in the file, with the batch normalisation that follows it.
#[derive(Debug, Clone)]
struct Spec {
    conv: String,
    norm: String,
    /// Output and input channels.
    channels: [usize; 2],
    kernel: usize,
    stride: usize,
    dilation: usize,
}

impl Spec {
    fn new(conv: String, norm: String, channels: [usize; 2], kernel: usize) -> Self {
        Self {
            conv,
            norm,
            channels,
            kernel,
            stride: 1,
            dilation: 1,
        }
    }
}

/// A block: three convolutions, and the convolution of the shortcut.
struct BlockSpec {
    convs: [Spec; 3],
    shortcut: Option<Spec>,
}

fn stem() -> [Spec; 3] {
    let conv = |index: usize, out, inputs| {
        Spec::new(
            format!("conv{index}"),
            format!("bn{index}"),
            [out, inputs],
            3,
        )
    };
    let first = Spec {
        stride: 2,
        ..conv(1, 64, 3)
    };
    [first, conv(2, 64, 64), conv(3, 128, 64)]
}

/// Blocks of the given stage, 0 to 3.
fn stage(stage: usize) -> Vec<BlockSpec> {
    let (narrow, before) = (64 << stage, if stage == 0 { 128 } else { 128 << stage });
    let wide = 4 * narrow;
    let block = |index: usize| {
        let inputs = if index == 0 { before } else { wide };
        let conv = |number: usize, channels, kernel| {
            let name = format!("layer{}.{index}", stage + 1);
            let (conv, norm) = (format!("{name}.conv{number}"), format!("{name}.bn{number}"));
            Spec::new(conv, norm, channels, kernel)
        };
        let stride = if index == 0 && stage == 1 { 2 } else { 1 };
        let middle = Spec {
            stride,
            dilation: match (stage, index) {
                (0 | 1, _) | (2, 0) => 1,
                (2, _) | (_, 0) => 2,
                _ => 4,
            },
            ..conv(2, [narrow, narrow], 3)
        };
        let shortcut = || {
            let name = format!("layer{}.0.downsample", stage + 1);
            let (conv, norm) = (format!("{name}.0"), format!("{name}.1"));
            Spec {
                stride,
                ..Spec::new(conv, norm, [wide, inputs], 1)
            }
        };
        BlockSpec {
            convs: [
                conv(1, [narrow, inputs], 1),
                middle,
                conv(3, [wide, narrow], 1),
            ],
            shortcut: (index == 0).then(shortcut),
        }
    };
    (0..[3, 4, 6, 3][stage]).map(block).collect()
}

const NORM: [&str; 4] = ["weight", "bias", "running_mean", "running_var"];

pub(super) fn network(compute: &Compute, file: &Path) -> Result<Network, PerceptualError> {
    let file = Checkpoint::open(file)?;
    let stages = [0, 1, 2, 3].map(stage);
    let (mut expected, mut unused) = (Vec::new(), Vec::new());
    let blocks = stages.iter().flatten();
    let in_blocks = blocks.flat_map(|block| block.convs.iter().chain(&block.shortcut));
    for spec in stem().iter().chain(in_blocks) {
        let [out, inputs] = spec.channels;
        expected.push(Expected {
            name: format!("{}.weight", spec.conv),
            shape: vec![out, inputs, spec.kernel, spec.kernel],
        });
        expected.extend(NORM.map(|part| Expected {
            name: format!("{}.{part}", spec.norm),
            shape: vec![out],
        }));
        unused.push(format!("{}.num_batches_tracked", spec.norm));
    }
    file.check(&expected, &unused)?;

    let conv = |spec: &Spec| conv(compute, &file, spec);
    let mut groups = [const { Vec::new() }; 4];
    for spec in &stem() {
        groups[0].push(Layer::Convolution(conv(spec)?));
    }
    groups[0].push(Layer::MaxPool(3, 1));
    for (group, blocks) in groups.iter_mut().zip(&stages) {
        for BlockSpec { convs, shortcut } in blocks {
            let [narrow, middle, widen] = convs;
            group.push(Layer::Bottleneck {
                convs: Box::new([conv(narrow)?, conv(middle)?, conv(widen)?]),
                shortcut: shortcut.as_ref().map(conv).transpose()?,
            });
        }
    }
    Ok(Network {
        name: "the given ResNet-50, dilated (stages 1 to 4)",
        smallest: 1,
        groups,
    })
}

/// Loads a convolution, with its batch normalisation folded in.
fn conv(
    compute: &Compute,
    file: &Checkpoint,
    spec: &Spec,
) -> Result<FrozenConvolution, PerceptualError> {
    let read = |tensor: String| {
        let values = file.tensor_f32(&tensor)?;
        if values.iter().all(|v| v.is_finite()) {
            return Ok(values);
        }
        let path = file.path().to_owned();
        Err(PerceptualError::NotFinite { path, tensor })
    };
    let mut weight = read(format!("{}.weight", spec.conv))?;
    let [gamma, beta, mean, variance] = NORM.map(|part| read(format!("{}.{part}", spec.norm)));
    let (gamma, beta, mean, variance) = (gamma?, beta?, mean?, variance?);
    let mut bias = Vec::with_capacity(beta.len());
    for (o, weights) in weight
        .chunks_exact_mut(spec.channels[1] * spec.kernel.pow(2))
        .enumerate()
    {
        let factor = f64::from(gamma[o]) / (f64::from(variance[o]) + EPSILON).sqrt();
        weights
            .iter_mut()
            .for_each(|w| *w = (f64::from(*w) * factor) as f32);
        bias.push((f64::from(beta[o]) - f64::from(mean[o]) * factor) as f32);
    }
    let [out, inputs] = spec.channels;
    let steps = [spec.stride, spec.dilation];
    let shape = [out, inputs, spec.kernel];
    Ok(FrozenConvolution::new(
        compute,
        shape,
        [&weight, &bias],
        steps,
    )?)
}
