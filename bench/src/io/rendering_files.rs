//! Renderings as files: PNG for viewing, EXR and safetensors for numbers.

use std::path::Path;

use exr::prelude::{
    AnyChannel, AnyChannels, AttributeValue, Encoding, FlatSamples, Image, Layer, LayerAttributes,
    LineOrder, WritableImage,
};
use image::{ExtendedColorType, GrayImage, RgbImage};
use sharp::image_file;
use sharp::render::{Background, RenderOutput};

use crate::io::atomic_files::{FileError, write_atomic};
use crate::io::gaussian_files::{Array, write_arrays};

pub fn encode_png(image: &RgbImage, path: &Path) -> Result<Vec<u8>, FileError> {
    png(
        path,
        image.as_raw(),
        image.dimensions(),
        ExtendedColorType::Rgb8,
    )
}

pub fn write_png(path: &Path, image: &RgbImage) -> Result<(), FileError> {
    write_atomic(path, &encode_png(image, path)?)
}

pub fn write_gray_png(path: &Path, image: &GrayImage) -> Result<(), FileError> {
    let bytes = png(
        path,
        image.as_raw(),
        image.dimensions(),
        ExtendedColorType::L8,
    )?;
    write_atomic(path, &bytes)
}

/// Writes depth in metres, [height, width], as a 16-bit PNG in millimetres; depths beyond 65.534 m become 65535.
pub fn write_millimetres_png(
    path: &Path,
    size: (u32, u32),
    depth: &[f32],
) -> Result<(), FileError> {
    // The encoder takes native-endian bytes. `as` saturates.
    let bytes: Vec<u8> = depth
        .iter()
        .flat_map(|&metres| ((metres * 1000.0).round() as u16).to_ne_bytes())
        .collect();
    write_atomic(path, &png(path, &bytes, size, ExtendedColorType::L16)?)
}

fn png(
    path: &Path,
    samples: &[u8],
    size: (u32, u32),
    color: ExtendedColorType,
) -> Result<Vec<u8>, FileError> {
    image_file::encode_png(samples, size, color)
        .map_err(|error| FileError::new(path, "encode")(std::io::Error::other(error)))
}

/// Name of the EXR layer attribute with the colours' transfer function. Other programs do not write
/// this attribute, so users must state the transfer function of their files.
pub(crate) const TRANSFER: &str = "sharpBenchTransfer";

/// Writes RGB as blended (`R`, `G`, `B`, premultiplied over black), alpha (`A`) and accumulated depth (`Z`: Σ w z,
/// metres; divide by alpha for the expected depth) as lossless f32. The file states whether RGB is linear light. If so,
/// reading the file as a picture encodes it as sRGB.
pub fn write_exr(path: &Path, rendered: &RenderOutput) -> Result<(), FileError> {
    let [r, g, b] = [0, 1, 2].map(|channel| {
        let values = rendered.rgb.iter().map(|rgb| rgb[channel]);
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
    attributes.other.insert(
        TRANSFER.into(),
        AttributeValue::Text(rendered.blending.name().into()),
    );
    write_layer(path, size, attributes, &channels)
}

/// Writes planes `[height, width]` as named, lossless f32 channels.
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
    // Store blocks in a fixed order, independent of which thread finishes first, so that equal pixels give equal bytes.
    let encoding = Encoding {
        line_order: LineOrder::Increasing,
        ..Encoding::FAST_LOSSLESS
    };
    let layer = Layer::new(
        size,
        attributes,
        encoding,
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
    write_pixels(path, rendered, "rgb_linear", rendered.rgb.as_flattened())
}

/// Like [`write_safetensors`], but writes `rgb`: in blending space, over the background, not
/// clamped.
pub fn write_blended(
    path: &Path,
    rendered: &RenderOutput,
    background: Background,
) -> Result<(), FileError> {
    let rgb = rendered.composited(background);
    write_pixels(path, rendered, "rgb", rgb.as_raw())
}

fn write_pixels(
    path: &Path,
    rendered: &RenderOutput,
    name: &'static str,
    rgb: &[f32],
) -> Result<(), FileError> {
    let (width, height) = (rendered.width as usize, rendered.height as usize);
    let arrays = [
        Array::new(name, &[height, width, 3], rgb),
        Array::new("alpha", &[height, width], &rendered.alpha),
        Array::new("depth_acc", &[height, width], &rendered.depth_acc),
    ];
    write_arrays(path, &arrays, None)
}

#[cfg(test)]
mod tests {
    use sharp::color::Quantization;
    use sharp::ply::ColorSpace;
    use sharp::render::Dropped;

    use super::*;
    use crate::io::pictures;

    #[test]
    fn the_same_planes_are_the_same_bytes() {
        let dir = tempfile::tempdir().unwrap();
        let size = (300, 200);
        let plane: Vec<f32> = (0..size.0 * size.1)
            .map(|i| (i as f32 * 0.37).sin() * (i % 97) as f32)
            .collect();
        let channels = [("Z".to_owned(), plane.as_slice()), ("A".to_owned(), &plane)];
        let written = |name: String| {
            let path = dir.path().join(name);
            write_exr_channels(&path, size, &channels).unwrap();
            std::fs::read(path).unwrap()
        };
        let first = written("first.exr".to_owned());
        for again in 0..20 {
            assert!(written(format!("{again}.exr")) == first, "written again");
        }
    }

    /// An EXR of another program with a row of grey pixels.
    #[test]
    fn light_beyond_white_is_named_and_what_is_no_light_refused() {
        use sharp::image_file::ExrTransfer;

        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("p.exr");
        let linear = pictures::PictureReading {
            exr: Some(ExrTransfer::Linear),
            ..Default::default()
        };
        let read = |values: [f32; 8]| {
            let picture = ::exr::prelude::SpecificChannels::rgb(|at: ::exr::math::Vec2<usize>| {
                let value = values[at.x()];
                (value, value, value)
            });
            let image = ::exr::prelude::Image::from_channels((8, 1), picture);
            ::exr::prelude::WritableImage::write(&image)
                .to_file(&path)
                .unwrap();
            pictures::read_as(&path, &linear)
        };
        // Values above 1 within the precision of half floats, or too little to change the 8-bit value.
        let within = read([0.0, 0.1, 0.2, 0.5, 0.9, 1.0, 1.004, -0.01]).unwrap();
        assert_eq!(within.notes, Vec::<String>::new());
        let bright = read([0.0, 0.1, 0.2, 0.5, 0.9, 1.0, 1.1, 30.0]).unwrap();
        assert_eq!(bright.notes.len(), 1);
        let start = "25.00 % of its pixels are brighter than 1 and are clipped to 1 (exr=linear)";
        assert!(bright.notes[0].starts_with(start), "{:?}", bright.notes);
        assert!((0.9999..=1.0).contains(&bright.picture.value(7, 0, 0)));
        for odd in [f32::INFINITY, f32::NEG_INFINITY, f32::NAN] {
            let error = read([0.0, 0.1, 0.2, 0.5, 0.9, 1.0, 0.3, odd]).unwrap_err();
            let error = error.to_string();
            assert!(
                error.contains("p.exr: ") && error.contains("x 7, y 0"),
                "{error}"
            );
        }
    }

    #[test]
    fn a_rendering_is_the_same_picture_from_exr_and_png() {
        let dir = tempfile::tempdir().unwrap();
        for blending in [ColorSpace::Linear, ColorSpace::Srgb] {
            let rendered = RenderOutput {
                width: 3,
                height: 2,
                blending,
                rgb: (0..6).map(|i| [0.2 * i as f32, 0.01, 0.5]).collect(),
                alpha: vec![1.0; 6],
                depth_acc: vec![2.0; 6],
                drawn: 6,
                dropped: Dropped::default(),
            };
            let (exr, png) = (dir.path().join("view.exr"), dir.path().join("view.png"));
            write_exr(&exr, &rendered).unwrap();
            let encoded = rendered.srgb8(Background::Black, Quantization::Round);
            write_png(&png, &encoded).unwrap();
            let found = pictures::read_rgb8(&exr).unwrap();
            assert_eq!(found, pictures::read_rgb8(&png).unwrap(), "{blending}");
        }
    }
}
