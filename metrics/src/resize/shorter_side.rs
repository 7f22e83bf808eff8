//! Reduction to a shorter side of 256 pixels, bit-identical to PIL's.

use std::borrow::Cow;

use image::{Rgb, RgbImage};

use super::kernel::buffer;
use super::{Size, pillow};
use crate::picture::Picture;

/// The side to which `dists[resize256]` reduces.
const SIDE: u32 = 256;

/// Reduces a picture to a shorter side of 256 pixels; the proportional longer side is rounded down. The result has 8
/// bits: floating-point pictures are first rounded, as PIL requires. A picture whose shorter side is at most 256 is
/// returned unchanged.
pub(crate) fn to_shorter_side_256(picture: &Picture) -> Cow<'_, Picture> {
    let (width, height) = picture.dimensions();
    if width.min(height) <= SIDE {
        return Cow::Borrowed(picture);
    }
    let longer =
        |long: u32, short: u32| (u64::from(SIDE) * u64::from(long) / u64::from(short)) as u32;
    let size = if width <= height {
        (SIDE, longer(height, width))
    } else {
        (longer(width, height), SIDE)
    };
    let reduce = |picture: &RgbImage| {
        let (from, to) = (Size::from((width, height)), Size::from(size));
        buffer(
            pillow::resize(picture.as_raw(), from, to, &pillow::BILINEAR),
            to,
        )
    };
    let resized = match picture {
        Picture::Rgb8(picture) => reduce(picture),
        Picture::RgbF32(picture) => {
            let levels = RgbImage::from_fn(width, height, |x, y| {
                Rgb(picture.get_pixel(x, y).0.map(|v| (v * 255.0).round() as u8))
            });
            reduce(&levels)
        }
    };
    Cow::Owned(resized.into())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn small_pictures_stay_as_they_are() {
        let small = Picture::from(RgbImage::new(300, 256));
        assert!(matches!(to_shorter_side_256(&small), Cow::Borrowed(_)));
    }

    #[test]
    fn sizes_follow_the_shorter_side() {
        for (size, expected) in [((1024, 768), (341, 256)), ((257, 600), (256, 597))] {
            let picture = Picture::from(RgbImage::new(size.0, size.1));
            assert_eq!(to_shorter_side_256(&picture).dimensions(), expected);
        }
    }

    #[test]
    fn the_same_bytes_as_pil() {
        let folder = concat!(
            env!("CARGO_MANIFEST_DIR"),
            "/../tests/golden/metrics/images/"
        );
        for which in ["ref", "dist"] {
            let open = |name: String| image::open(folder.to_owned() + &name).unwrap().to_rgb8();
            let full = open(format!("large1024x768_{which}.png"));
            let pil = open(format!("large1024x768_resize256_{which}.png"));
            assert!(*to_shorter_side_256(&full.into()) == Picture::from(pil));
        }
    }
}
