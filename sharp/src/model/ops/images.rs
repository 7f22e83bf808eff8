//! Sizes and layouts of images.

use candle_core::{Device, Result, Tensor};

/// Square image made of tokens `[images, tokens, channels]`. Each pixel is the token at the index in `places`, counted
/// over the tokens of all images.
pub(in crate::model) fn gather(tokens: &Tensor, places: &Tensor) -> Result<Tensor> {
    let side = places.elem_count().isqrt();
    let channels = tokens.dim(2)?;
    let pixels = tokens.flatten_to(1)?.index_select(places, 0)?;
    pixels.reshape((1, side, side, channels))
}

/// Average pooling over `size × size` blocks.
pub(in crate::model) fn avg_pool(x: &Tensor, size: usize) -> Result<Tensor> {
    let pooled = x.permute((0, 3, 1, 2))?.contiguous()?.avg_pool2d(size)?;
    pooled.permute((0, 2, 3, 1))?.contiguous()
}

/// Nearest-neighbour upsampling by 2: every pixel is repeated four times.
pub(in crate::model) fn double_nearest(x: &Tensor) -> Result<Tensor> {
    let (_, h, w, c) = x.dims4()?;
    let row = Tensor::cat(&[x, x], 3)?.reshape((h, 2 * w * c))?;
    Tensor::cat(&[&row, &row], 1)?.reshape((1, 2 * h, 2 * w, c))
}

/// An image from planes `[channels, height, width]`.
pub(in crate::model) fn from_planes(
    planes: &[f32],
    (channels, height, width): (usize, usize, usize),
    device: &Device,
) -> Result<Tensor> {
    let planes = Tensor::from_slice(planes, (1, channels, height, width), device)?;
    planes.permute((0, 2, 3, 1))?.contiguous()
}

/// The planes `[channels, height, width]` of an image.
pub(in crate::model) fn to_planes(image: &Tensor) -> Result<Vec<f32>> {
    image.permute((0, 3, 1, 2))?.flatten_all()?.to_vec1()
}
