//! Resizing kernels by name.

use image::{ImageBuffer, Rgb};

use super::{Size, area, pillow, torch};
use crate::picture::{Picture, PictureError};

/// A resizing function of a library.
///
/// Pixel centres are at half integers in all functions (`align_corners=False`). Each channel is
/// resized separately, in its given encoding (sRGB, not linear light).
#[derive(Debug, Clone, Copy, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum ResizeKernel {
    /// `torch.nn.functional.interpolate(mode="bilinear", align_corners=False)`: four neighbours, without a filter when
    /// reducing. 8-bit pictures are first divided by 255 and stay floats.
    Bilinear,
    /// [`Self::Bilinear`] with `antialias=True`: a triangle filter as wide as the reduction. When
    /// enlarging, results equal [`Self::Bilinear`]'s up to rounding.
    BilinearAntialias,
    /// PIL's `Image.resize` with `BICUBIC` (a = −0.5, antialiased).
    Bicubic,
    /// PIL's `Image.resize` with `LANCZOS` (three lobes, antialiased).
    Lanczos,
    /// OpenCV's `resize` with `INTER_AREA`: means over pixel areas. Enlarging, for which OpenCV uses a variant of
    /// bilinear, is not supported.
    Area,
}

impl ResizeKernel {
    /// Every kernel, in the order of the documentation.
    pub const ALL: [Self; 5] = [
        Self::Bilinear,
        Self::BilinearAntialias,
        Self::Bicubic,
        Self::Lanczos,
        Self::Area,
    ];

    /// Name on command lines and in reports.
    pub const fn name(self) -> &'static str {
        match self {
            Self::Bilinear => "bilinear",
            Self::BilinearAntialias => "bilinear-antialias",
            Self::Bicubic => "bicubic",
            Self::Lanczos => "lanczos",
            Self::Area => "area",
        }
    }

    /// The equivalent library call and its arithmetic, for reports.
    pub const fn describe(self) -> &'static str {
        match self {
            Self::Bilinear => {
                "torch F.interpolate(mode='bilinear', align_corners=False) of float32 in 0..1; \
                 8-bit pictures are divided by 255 and not rounded back"
            }
            Self::BilinearAntialias => {
                "torch F.interpolate(mode='bilinear', align_corners=False, antialias=True) of \
                 float32 in 0..1; 8-bit pictures are divided by 255 and not rounded back"
            }
            Self::Bicubic => {
                "PIL Image.resize(BICUBIC); 8-bit pictures in its fixed point, rounded to 8 bits \
                 after each pass; float pictures as mode F, clamped to 0..1"
            }
            Self::Lanczos => {
                "PIL Image.resize(LANCZOS); 8-bit pictures in its fixed point, rounded to 8 bits \
                 after each pass; float pictures as mode F, clamped to 0..1"
            }
            Self::Area => {
                "cv2.resize(interpolation=INTER_AREA); 8-bit pictures are rounded to 8 bits, float \
                 pictures stay float32"
            }
        }
    }
}

by_name!(ResizeKernel, ResizeKernelError);

/// Error: no kernel has the given name.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "unknown resize kernel {0:?}: expected bilinear, bilinear-antialias, bicubic, lanczos or \
         area"
)]
pub struct ResizeKernelError(String);

/// Resizes the picture to `width` × `height` pixels, exactly as the kernel's library does.
///
/// * torch's kernels return floats (f32 in 0..1), even for 8-bit pictures;
/// * PIL's and OpenCV's keep the type of the picture: 8 bits (bit-identical to the library) or f32.
///
/// Floats agree with the library up to its own rounding (1e-6). Values outside 0..1, which bicubic
/// and Lanczos can produce, are clamped. A picture that already has the requested size is returned
/// unchanged. Results are bit-identical for any number of threads.
///
/// # Errors
/// [`PictureError`] if the picture is empty or has a value outside 0..1, if `width` or `height` is
/// 0, or if [`ResizeKernel::Area`] would have to enlarge a side.
pub fn resize(
    picture: &Picture,
    width: u32,
    height: u32,
    kernel: ResizeKernel,
) -> Result<Picture, PictureError> {
    picture.check()?;
    if width == 0 || height == 0 {
        return Err(PictureError::Empty { width, height });
    }
    let (from, to) = (picture.dimensions(), (width, height));
    if from == to {
        return Ok(picture.clone());
    }
    let (from, to) = (Size::from(from), Size::from(to));
    Ok(match kernel {
        ResizeKernel::Bilinear => {
            Picture::RgbF32(unit_range(torch::bilinear(&floats(picture), from, to), to))
        }
        ResizeKernel::BilinearAntialias => Picture::RgbF32(unit_range(
            torch::bilinear_antialias(&floats(picture), from, to),
            to,
        )),
        ResizeKernel::Bicubic => with_pillow(picture, from, to, &pillow::BICUBIC),
        ResizeKernel::Lanczos => with_pillow(picture, from, to, &pillow::LANCZOS),
        ResizeKernel::Area if to.width > from.width || to.height > from.height => {
            return Err(PictureError::AreaEnlarges);
        }
        ResizeKernel::Area => match picture {
            Picture::Rgb8(picture) => {
                Picture::Rgb8(buffer(area::shrink(picture.as_raw(), from, to), to))
            }
            Picture::RgbF32(picture) => {
                Picture::RgbF32(unit_range(area::shrink(picture.as_raw(), from, to), to))
            }
        },
    })
}

fn with_pillow(picture: &Picture, from: Size, to: Size, filter: &pillow::Filter) -> Picture {
    match picture {
        Picture::Rgb8(picture) => Picture::Rgb8(buffer(
            pillow::resize(picture.as_raw(), from, to, filter),
            to,
        )),
        Picture::RgbF32(picture) => Picture::RgbF32(unit_range(
            pillow::resize(picture.as_raw(), from, to, filter),
            to,
        )),
    }
}

/// Interleaved f32 in 0..1, as returned by `torchvision`'s `to_tensor`.
fn floats(picture: &Picture) -> Vec<f32> {
    match picture {
        Picture::Rgb8(picture) => {
            let levels = picture.as_raw().iter();
            levels.map(|&level| f32::from(level) / 255.0).collect()
        }
        Picture::RgbF32(picture) => picture.as_raw().clone(),
    }
}

/// Clamps to 0..1. Values may exceed this range by an ulp because weights are rounded, and by more if weights are
/// negative.
fn unit_range(mut values: Vec<f32>, size: Size) -> ImageBuffer<Rgb<f32>, Vec<f32>> {
    for value in &mut values {
        *value = value.clamp(0.0, 1.0);
    }
    buffer(values, size)
}

/// Wraps exactly `3 × width × height` interleaved values as a picture.
pub(super) fn buffer<T>(values: Vec<T>, size: Size) -> ImageBuffer<Rgb<T>, Vec<T>>
where
    T: image::Primitive,
    Rgb<T>: image::Pixel<Subpixel = T>,
{
    let mut made = ImageBuffer::new(size.width as u32, size.height as u32);
    made.copy_from_slice(&values);
    made
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::{Rgb32FImage, RgbImage};

    fn both(width: u32, height: u32) -> [Picture; 2] {
        let level = |x: u32, y: u32, c: u32| ((x * 37 + y * 91 + c * 53) % 256) as u8;
        let bytes = RgbImage::from_fn(width, height, |x, y| {
            Rgb([level(x, y, 0), level(x, y, 1), level(x, y, 2)])
        });
        let floats = Rgb32FImage::from_fn(width, height, |x, y| {
            Rgb(bytes.get_pixel(x, y).0.map(|v| f32::from(v) / 255.0))
        });
        [bytes.into(), floats.into()]
    }

    #[test]
    fn names_return_to_their_kernels() {
        for kernel in ResizeKernel::ALL {
            assert_eq!(kernel.to_string().parse(), Ok(kernel));
        }
        let error = "cubic".parse::<ResizeKernel>().unwrap_err().to_string();
        for kernel in ResizeKernel::ALL {
            assert!(error.contains(kernel.name()), "{error}");
        }
    }

    #[test]
    fn sizes_come_out_and_the_same_size_changes_nothing() {
        for picture in both(17, 11) {
            for kernel in ResizeKernel::ALL {
                for size in [(1, 1), (5, 30), (34, 22), (40, 3), (17, 22), (8, 11)] {
                    let out = resize(&picture, size.0, size.1, kernel);
                    if kernel == ResizeKernel::Area && (size.0 > 17 || size.1 > 11) {
                        assert_eq!(out, Err(PictureError::AreaEnlarges));
                        continue;
                    }
                    let out = out.unwrap();
                    assert_eq!(out.dimensions(), size, "{kernel}");
                    assert_eq!(out.check(), Ok(()), "{kernel} {size:?}");
                }
                assert_eq!(resize(&picture, 17, 11, kernel).as_ref(), Ok(&picture));
            }
        }
    }

    #[test]
    fn flat_pictures_stay_flat() {
        let flat = Picture::from(RgbImage::from_pixel(13, 9, Rgb([0, 200, 255])));
        for kernel in ResizeKernel::ALL {
            let sizes = [(5, 4), (12, 2), (29, 31), (13, 18), (6, 20)];
            let count = if kernel == ResizeKernel::Area { 2 } else { 5 };
            for size in &sizes[..count] {
                let out = resize(&flat, size.0, size.1, kernel).unwrap();
                for (x, y) in [(0, 0), (size.0 - 1, size.1 - 1), (size.0 / 2, size.1 / 2)] {
                    for (channel, level) in [(0, 0.0), (1, 200.0), (2, 255.0)] {
                        let value = out.value(x, y, channel);
                        assert!((value - level / 255.0).abs() < 1e-6, "{kernel} {value}");
                    }
                }
            }
        }
    }

    #[test]
    fn what_cannot_be_resized_is_an_error() {
        let [picture, _] = both(4, 4);
        let empty = resize(&picture, 0, 3, ResizeKernel::Area);
        assert!(matches!(empty, Err(PictureError::Empty { width: 0, .. })));
        let nan = Picture::from(Rgb32FImage::from_pixel(2, 2, Rgb([f32::NAN; 3])));
        assert!(resize(&nan, 4, 4, ResizeKernel::Bicubic).is_err());
    }

    #[test]
    fn the_same_on_one_thread() {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(1)
            .build()
            .unwrap();
        for picture in both(97, 61) {
            for kernel in ResizeKernel::ALL {
                for (width, height) in [(40, 33), (150, 200)] {
                    let many = resize(&picture, width, height, kernel);
                    let one = pool.install(|| resize(&picture, width, height, kernel));
                    assert_eq!(many, one);
                }
            }
        }
    }
}
