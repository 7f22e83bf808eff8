//! Layers of the frozen networks.

use candle_core::{Result, Tensor};
use sharp::model::{Compute, FrozenConvolution, max_pool};

pub(super) enum Layer {
    /// A convolution, followed by ReLU.
    Convolution(FrozenConvolution),
    /// Max pooling: side of the windows, and width of the padding, in pixels.
    MaxPool(usize, usize),
    /// ResNet's block: 1×1, 3×3 and 1×1 convolutions, added to the input, which is projected by a 1×1 convolution if
    /// its shape changes. ReLU after each convolution and at the end (He et al. 2016, figure 5).
    Bottleneck {
        convs: Box<[FrozenConvolution; 3]>,
        shortcut: Option<FrozenConvolution>,
    },
}

impl Layer {
    /// Applies the layer to an image `[1, height, width, channels]`.
    pub(super) fn forward(&self, compute: &Compute, x: &Tensor) -> Result<Tensor> {
        match self {
            Self::Convolution(conv) => conv.forward(x, None, true),
            Self::MaxPool(side, padding) => max_pool(compute, x, *side, *padding),
            Self::Bottleneck { convs, shortcut } => {
                let [narrow, middle, widen] = &**convs;
                let y = middle.forward(&narrow.forward(x, None, true)?, None, true)?;
                let fitted = shortcut
                    .as_ref()
                    .map(|shortcut| shortcut.forward(x, None, false));
                widen.forward(&y, Some(&fitted.unwrap_or_else(|| Ok(x.clone()))?), true)
            }
        }
    }
}
