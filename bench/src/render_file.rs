//! Renderings as files: PNG for eyes, EXR and safetensors for numbers.

use std::path::Path;

use exr::prelude::{
    AnyChannel, AnyChannels, Encoding, FlatSamples, Image, Layer, LayerAttributes, WritableImage,
};
use image::{ExtendedColorType, GrayImage, ImageEncoder, RgbImage, codecs::png::PngEncoder};
use safetensors::tensor::{Dtype, TensorView};
use sharp::render::RenderOutput;

use crate::durable::{FileError, write_atomic};

/// A PNG in memory.
///
/// # Errors
/// The encoder's, naming `path`, which nothing is written to.
pub fn encode_png(image: &RgbImage, path: &Path) -> Result<Vec<u8>, FileError> {
    let mut bytes = Vec::new();
    PngEncoder::new(&mut bytes)
        .write_image(
            image.as_raw(),
            image.width(),
            image.height(),
            ExtendedColorType::Rgb8,
        )
        .map_err(|error| FileError::new(path, "encode")(std::io::Error::other(error)))?;
    Ok(bytes)
}

/// Writes an 8-bit PNG.
///
/// # Errors
/// Names the file and the reason.
pub fn write_png(path: &Path, image: &RgbImage) -> Result<(), FileError> {
    write_atomic(path, &encode_png(image, path)?)
}

/// Writes 8-bit grey levels as PNG.
///
/// # Errors
/// Names the file and the reason.
pub fn write_gray_png(path: &Path, image: &GrayImage) -> Result<(), FileError> {
    let mut bytes = Vec::new();
    PngEncoder::new(&mut bytes)
        .write_image(
            image.as_raw(),
            image.width(),
            image.height(),
            ExtendedColorType::L8,
        )
        .map_err(|error| FileError::new(path, "encode")(std::io::Error::other(error)))?;
    write_atomic(path, &bytes)
}

/// Writes linear RGB (`R`, `G`, `B`, premultiplied over black), alpha (`A`) and accumulated depth (`Z`: Σ w z, metres;
/// divide by alpha for the expected depth) as f32, without loss.
///
/// # Errors
/// Names the file and the reason.
pub fn write_exr(path: &Path, rendered: &RenderOutput) -> Result<(), FileError> {
    let [r, g, b] = [0, 1, 2].map(|channel| {
        let values = rendered.rgb_linear.iter().map(|rgb| rgb[channel]);
        values.collect::<Vec<f32>>()
    });
    let size = (rendered.width as usize, rendered.height as usize);
    let channels = [
        ("R".to_owned(), r.as_slice()),
        ("G".to_owned(), &g),
        ("B".to_owned(), &b),
        ("A".to_owned(), &rendered.alpha),
        ("Z".to_owned(), &rendered.depth_acc),
    ];
    write_exr_channels(path, size, &channels)
}

/// Writes planes `[height, width]` as named f32 channels, without loss.
///
/// # Errors
/// Names the file and the reason.
pub fn write_exr_channels(
    path: &Path,
    (width, height): (usize, usize),
    channels: &[(String, &[f32])],
) -> Result<(), FileError> {
    let channels = channels
        .iter()
        .map(|(name, values)| AnyChannel::new(name.as_str(), FlatSamples::F32(values.to_vec())));
    let layer = Layer::new(
        (width, height),
        LayerAttributes::default(),
        Encoding::FAST_LOSSLESS,
        AnyChannels::sort(channels.collect()),
    );
    let mut bytes = std::io::Cursor::new(Vec::new());
    Image::from_layer(layer)
        .write()
        .to_buffered(&mut bytes)
        .map_err(|error| FileError::new(path, "encode")(std::io::Error::other(error)))?;
    write_atomic(path, bytes.get_ref())
}

/// Writes `rgb_linear` [H, W, 3], `alpha` [H, W] and `depth_acc` [H, W], f32.
///
/// # Errors
/// Names the file and the reason.
pub fn write_safetensors(path: &Path, rendered: &RenderOutput) -> Result<(), FileError> {
    let encode = |error: safetensors::SafeTensorError| {
        FileError::new(path, "encode")(std::io::Error::other(error))
    };
    let (width, height) = (rendered.width as usize, rendered.height as usize);
    let rgb = bytes_of(rendered.rgb_linear.as_flattened());
    let (alpha, depth) = (bytes_of(&rendered.alpha), bytes_of(&rendered.depth_acc));
    let view = |shape: Vec<usize>, bytes| TensorView::new(Dtype::F32, shape, bytes);
    let tensors = [
        (
            "rgb_linear",
            view(vec![height, width, 3], &rgb).map_err(encode)?,
        ),
        ("alpha", view(vec![height, width], &alpha).map_err(encode)?),
        (
            "depth_acc",
            view(vec![height, width], &depth).map_err(encode)?,
        ),
    ];
    let bytes = safetensors::serialize(tensors, None).map_err(encode)?;
    write_atomic(path, &bytes)
}

/// safetensors stores little endian on every machine.
fn bytes_of(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|v| v.to_le_bytes()).collect()
}
