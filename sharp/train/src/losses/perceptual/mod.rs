//! The perceptual loss with its Gram term (paper, perceptual loss), based on features of a frozen network.
//!
//! [`Perceptual::compare`] also implements the paper's graph surgery: it takes a rendered picture detached from the
//! graph that produced it. It returns the loss's value and its gradient with respect to that picture. Intermediate
//! results are freed on return, so that memory does not grow with the number of views.
//!
//! # Contents
//! * [`Perceptual`], [`PerceptualOptions`]; `layers`: the layers of both networks.
//! * `vgg`, `resnet`: the two networks; `distance`: the two terms at one layer; `picture`: crop, mask and
//!   normalisation.

mod distance;
mod layers;
mod picture;
mod resnet;
#[cfg(test)]
mod tests;
mod vgg;

use super::Loss;
use candle_core::{Tensor, Var};
use distance::Terms;
use layers::Layer;
use picture::{Region, shrunk};
use serde::{Deserialize, Serialize};
use sharp::model::{Compute, pull};
use sharp_checkpoint::{CheckpointError, Incomplete};
use sharp_metrics::{Weights, WeightsError};
use std::path::PathBuf;

/// Views on which the loss is computed. The paper is ambiguous: its equation uses the novel view, but its remark on
/// memory mentions both views.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PerceptualViews {
    Novel,
    Both,
}

/// How the novel view's mask is applied.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum PerceptualMask {
    /// Both pictures are set to black outside the mask.
    Pictures,
    /// The features of both pictures are multiplied by the mask, averaged over the area of each feature pixel.
    Features,
}

/// Options of the comparison; the defaults of the loss's inner weights are the published values.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct PerceptualOptions {
    pub views: PerceptualViews,
    pub mask: PerceptualMask,
    /// Weight k of the feature term.
    pub features: f64,
    /// Weight j of the Gram term.
    pub gram: f64,
    /// True if Gram matrices are divided by the number of pixels of the feature map, which the paper leaves open.
    pub gram_per_pixel: bool,
    /// If set, a random square with this side in pixels is compared instead of the whole picture.
    pub crop: Option<usize>,
    /// Weights of LaMa's encoder, `ade20k-resnet50dilated-ppm_deepsup/encoder_epoch_20.pth`. `None` uses VGG16 with the
    /// published weights.
    pub resnet50dilated: Option<PathBuf>,
}

impl Default for PerceptualOptions {
    fn default() -> Self {
        Self {
            views: PerceptualViews::Novel,
            mask: PerceptualMask::Pictures,
            features: 1.0,
            gram: 10.0,
            gram_per_pixel: true,
            crop: None,
            resnet50dilated: None,
        }
    }
}

#[derive(Debug, thiserror::Error)]
pub enum PerceptualError {
    #[error(transparent)]
    Weights(#[from] WeightsError),
    #[error(
        "the weights of VGG16 are missing; they are distributed with the program (vgg16.safetensors)"
    )]
    NoWeights,
    #[error(transparent)]
    Checkpoint(#[from] CheckpointError),
    #[error("tensor operation: {0}")]
    Tensor(#[from] candle_core::Error),
    #[error("not the encoder resnet50dilated: {0}")]
    Incomplete(#[from] Incomplete),
    #[error("{}: {tensor} has a value that is not finite", path.display())]
    NotFinite { path: PathBuf, tensor: String },
    #[error(
        "{network} needs at least {smallest} pixels per side, but a picture has \
             {width}x{height}"
    )]
    TooSmall {
        network: &'static str,
        smallest: usize,
        width: usize,
        height: usize,
    },
}

/// A frozen network: layers in four groups; features are compared at the end of each group.
struct Network {
    name: &'static str,
    smallest: usize,
    groups: [Vec<Layer>; 4],
}

/// The perceptual loss, with the packed weights of its network.
pub struct Perceptual {
    options: PerceptualOptions,
    compute: Compute,
    network: Network,
}

impl Perceptual {
    /// Reads the weights selected by the options, for a network on `compute`.
    ///
    /// # Errors
    /// [`PerceptualError`], except `TooSmall`.
    pub fn new(options: PerceptualOptions, compute: Compute) -> Result<Self, PerceptualError> {
        let network = match &options.resnet50dilated {
            Some(file) => resnet::network(&compute, file)?,
            None => vgg::network(&compute, &Weights::at_hand())?,
        };
        Ok(Self {
            options,
            compute,
            network,
        })
    }

    /// Name of the network, its weights and the layers compared, for a log.
    pub fn network(&self) -> &'static str {
        self.network.name
    }

    /// Loss between two sRGB-encoded pictures in rows of `width`, and its gradient with respect to the first,
    /// restricted to `mask`.
    ///
    /// `seed` determines the position of the crop. Results are bit-identical for any number of threads.
    ///
    /// # Errors
    /// [`PerceptualError::TooSmall`] if the picture is smaller than the network accepts; also if the device fails.
    ///
    /// # Panics
    /// If lengths differ or are not a multiple of `width`.
    pub fn compare(
        &self,
        predicted: &[[f32; 3]],
        target: &[[f32; 3]],
        width: usize,
        mask: Option<&[bool]>,
        seed: u64,
    ) -> Result<Loss<[f32; 3]>, PerceptualError> {
        assert_eq!(predicted.len(), target.len(), "pixels of the target");
        assert!(
            mask.is_none_or(|mask| mask.len() == predicted.len()),
            "pixels of the mask"
        );
        assert!(
            width > 0 && predicted.len().is_multiple_of(width),
            "{} pixels in rows of {width}",
            predicted.len()
        );
        let region = Region::new([predicted.len() / width, width], self.options.crop, seed);
        let [height, width] = region.size;
        if height.min(width) < self.network.smallest {
            return Err(PerceptualError::TooSmall {
                network: self.network.name,
                smallest: self.network.smallest,
                width,
                height,
            });
        }
        let mask = mask.map(|mask| region.cut(mask));
        let (blackened, weight) = match self.options.mask {
            PerceptualMask::Pictures => (mask.as_deref(), None),
            PerceptualMask::Features => (None, mask.as_deref()),
        };
        let input = |pixels: &[[f32; 3]]| {
            let values = picture::normalized(&region.cut(pixels), blackened);
            Tensor::from_vec(values, (1, height, width, 3), self.compute.device())
        };
        let picture = Var::from_tensor(&input(predicted)?)?;
        let (mut x, mut y) = (picture.as_tensor().clone(), input(target)?);
        let mut value = 0.0;
        // For each group, the features at its end with the gradient with respect to them.
        let mut pulled = Vec::new();
        for layers in &self.network.groups {
            for layer in layers {
                x = layer.forward(&self.compute, &x)?;
                y = layer.forward(&self.compute, &y)?;
            }
            let (_, rows, columns, channels) = x.dims4()?;
            let weight = weight.map(|mask| shrunk(mask, region.size, [rows, columns]));
            let terms = Terms {
                features: self.options.features,
                gram: self.options.gram,
                gram_per_pixel: self.options.gram_per_pixel,
                weight: weight.as_deref(),
            };
            let [ours, theirs]: [Vec<f32>; 2] =
                [x.flatten_all()?.to_vec1()?, y.flatten_all()?.to_vec1()?];
            let (part, gradient) = terms.compare([&ours, &theirs], channels);
            value += part;
            let gradient = Tensor::from_vec(gradient, x.shape(), self.compute.device())?;
            pulled.push((x.clone(), gradient));
        }
        let found = pull(&self.compute, &pulled)?;
        let gradient = match found.as_ref().and_then(|found| found.get(&picture)) {
            Some(found) => {
                let found: Vec<f32> = found.flatten_all()?.to_vec1()?;
                region.paste(&picture::denormalized(&found, blackened))
            }
            None => vec![[0.0; 3]; predicted.len()],
        };
        Ok(Loss { value, gradient })
    }
}
