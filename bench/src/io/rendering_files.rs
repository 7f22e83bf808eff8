//! Renderings as files: PNG for eyes, EXR and safetensors for numbers.

use std::path::Path;

use exr::prelude::{
    AnyChannel, AnyChannels, AttributeValue, Encoding, FlatSamples, Image, Layer, LayerAttributes,
    WritableImage,
};
use image::{ExtendedColorType, GrayImage, ImageEncoder, RgbImage, codecs::png::PngEncoder};
use safetensors::tensor::{Dtype, TensorView};
use sharp::render::RenderOutput;

use crate::io::atomic_files::{FileError, write_atomic};

/// A PNG in memory.
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
pub fn write_png(path: &Path, image: &RgbImage) -> Result<(), FileError> {
    write_atomic(path, &encode_png(image, path)?)
}

/// Writes 8-bit grey levels as PNG.
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

/// The attribute of an EXR's layer that says how its colours are encoded, and its value for linear light. EXR files
/// of others, which lack it, hold sRGB values when they are handed in as pictures.
pub(crate) const TRANSFER: &str = "sharpBenchTransfer";
pub(crate) const LINEAR: &str = "linear";

/// Writes linear RGB (`R`, `G`, `B`, premultiplied over black), alpha (`A`) and accumulated depth (`Z`: Σ w z, metres;
/// divide by alpha for the expected depth) as f32, without loss. The file says that it is linear, so that it is encoded
/// when it is read as a picture.
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
    let mut attributes = LayerAttributes::default();
    attributes
        .other
        .insert(TRANSFER.into(), AttributeValue::Text(LINEAR.into()));
    write_layer(path, size, attributes, &channels)
}

/// Writes planes `[height, width]` as named f32 channels, without loss.
pub fn write_exr_channels(
    path: &Path,
    size: (usize, usize),
    channels: &[(String, &[f32])],
) -> Result<(), FileError> {
    write_layer(path, size, LayerAttributes::default(), channels)
}

fn write_layer(
    path: &Path,
    size: (usize, usize),
    attributes: LayerAttributes,
    channels: &[(String, &[f32])],
) -> Result<(), FileError> {
    let channels = channels
        .iter()
        .map(|(name, values)| AnyChannel::new(name.as_str(), FlatSamples::F32(values.to_vec())));
    let layer = Layer::new(
        size,
        attributes,
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

#[cfg(test)]
mod tests {
    use sharp::color::Quantization;
    use sharp::render::{Background, Dropped};

    use super::*;
    use crate::io::pictures;

    #[test]
    fn a_rendering_is_the_same_picture_from_exr_and_png() {
        let dir = tempfile::tempdir().unwrap();
        let rendered = RenderOutput {
            width: 3,
            height: 2,
            rgb_linear: (0..6).map(|i| [0.2 * i as f32, 0.01, 0.5]).collect(),
            alpha: vec![1.0; 6],
            depth_acc: vec![2.0; 6],
            drawn: 6,
            dropped: Dropped::default(),
        };
        let (exr, png) = (dir.path().join("view.exr"), dir.path().join("view.png"));
        write_exr(&exr, &rendered).unwrap();
        write_png(
            &png,
            &rendered.srgb8(Background::Black, Quantization::Round),
        )
        .unwrap();
        let found = pictures::read_rgb8(&exr).unwrap();
        assert_eq!(found, pictures::read_rgb8(&png).unwrap());
    }
}
