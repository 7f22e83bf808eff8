//! VGG16 with the published weights (torchvision's, as the metrics bundle them).

use super::layers::Layer;
use super::{Network, PerceptualError};
use sharp::model::{Compute, FrozenConvolution};
use sharp_metrics::{Backbone, Weights};

/// torchvision's indices of the convolutions up to each compared layer: relu1_2, relu2_2, relu3_3, relu4_3. Every group
/// except the first starts with 2×2 max pooling.
const GROUPS: [&[usize]; 4] = [&[0, 2], &[5, 7], &[10, 12, 14], &[17, 19, 21]];

pub(super) fn network(compute: &Compute, weights: &Weights) -> Result<Network, PerceptualError> {
    let tensors = weights
        .convolutions(Backbone::Vgg16)?
        .ok_or(PerceptualError::NoWeights)?;
    let conv = |index: &usize| -> Result<Layer, PerceptualError> {
        let [(shape, weight), (_, bias)] =
            ["weight", "bias"].map(|kind| &tensors[&format!("{index}.{kind}")]);
        let shape = [shape[0], shape[1], shape[2]];
        let conv = FrozenConvolution::new(compute, shape, [weight, bias], [1, 1])?;
        Ok(Layer::Convolution(conv))
    };
    let mut groups = GROUPS.map(|_| Vec::new());
    for (group, indices) in groups.iter_mut().zip(GROUPS) {
        if indices[0] != 0 {
            group.push(Layer::MaxPool(2, 0));
        }
        for index in indices {
            group.push(conv(index)?);
        }
    }
    Ok(Network {
        name: "VGG16 with the published weights (relu1_2, relu2_2, relu3_3, relu4_3)",
        smallest: 8,
        groups,
    })
}
