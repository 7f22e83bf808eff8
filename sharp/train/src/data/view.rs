//! A view at the picture size of the training data.

use image::{DynamicImage, ImageBuffer, Luma, RgbImage};
use sharp::camera::{Intrinsics, RigidTransform};
use sharp::resize::nearest;
use sharp_datasets::View;
use sharp_metrics::picture::Picture;
use sharp_metrics::{ResizeKernel, resize};

use super::DataError;

/// A posed picture with its depth; all arrays have the same size.
#[derive(Debug, Clone, PartialEq)]
pub struct TrainingView {
    /// Picture, sRGB-encoded.
    pub image: RgbImage,
    pub intrinsics: Intrinsics,
    pub camera_from_world: RigidTransform,
    /// z-depth in metres; 0 if unknown, +∞ in the sky.
    pub depth: ImageBuffer<Luma<f32>, Vec<f32>>,
    /// Pixels whose colours are used, row by row; `None` if all are.
    pub valid: Option<Vec<bool>>,
}

impl TrainingView {
    /// Reads a view and resizes it: pictures with OpenCV's area kernel, depth by the nearest pixel.
    /// The aspect ratio may change, as for the network's input. A resized pixel is excluded if it
    /// is computed from any excluded pixel.
    ///
    /// # Errors
    /// [`DataError::Dataset`] if the view cannot be read; [`DataError::NoDepth`] if the view has no
    /// depth; [`DataError::Picture`] for an empty size.
    pub(super) fn read(view: &View, size: (u32, u32)) -> Result<Self, DataError> {
        let file = view.content.image_file();
        let depth = view.content.depth()?;
        let mut depth = depth.ok_or_else(|| DataError::no_depth(file))?;
        // If a procedural camera sees no surface at a pixel, it sees the sky there.
        if file.is_none() {
            for z in depth.iter_mut().filter(|z| **z == 0.0) {
                *z = f32::INFINITY;
            }
        }
        let image = resized(view.content.image()?, size)?;
        let valid = view.content.valid_pixels()?.map(|mask| {
            let levels = resized(DynamicImage::ImageLuma8(mask).into_rgb8(), size)?;
            Ok::<_, DataError>(levels.pixels().map(|level| level.0[0] == 255).collect())
        });
        let (width, height) = (size.0 as usize, size.1 as usize);
        let from = (depth.width() as usize, depth.height() as usize);
        let depths = nearest(&depth, from, (width, height));
        let depth = ImageBuffer::from_fn(size.0, size.1, |x, y| {
            Luma([depths[y as usize * width + x as usize]])
        });
        Ok(Self {
            image,
            intrinsics: view.intrinsics.resized(size.0, size.1),
            camera_from_world: view.camera_from_world,
            depth,
            valid: valid.transpose()?,
        })
    }
}

/// Resizes an 8-bit picture: with OpenCV's area kernel, or bilinear with antialiasing if a side grows.
///
/// # Errors
/// [`DataError::Picture`] for an empty size.
pub(super) fn resized(image: RgbImage, (width, height): (u32, u32)) -> Result<RgbImage, DataError> {
    let kernel = if width > image.width() || height > image.height() {
        ResizeKernel::BilinearAntialias
    } else {
        ResizeKernel::Area
    };
    match resize(&Picture::Rgb8(image), width, height, kernel)? {
        Picture::Rgb8(image) => Ok(image),
        Picture::RgbF32(image) => Ok(image::DynamicImage::ImageRgb32F(image).into_rgb8()),
    }
}
