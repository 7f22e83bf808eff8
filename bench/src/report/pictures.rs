//! Pictures inside a page: reduced, encoded as JPEG, written into the address itself.

use image::codecs::jpeg::JpegEncoder;
use image::{ImageEncoder as _, RgbImage, imageops};

/// JPEG quality of everything in the page. It changes no score: scores come from the pictures themselves.
const QUALITY: u8 = 88;

/// A picture in the page.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Inlined {
    /// `data:image/jpeg;base64,…`.
    pub uri: String,
    /// Pixels.
    pub width: u32,
    /// Pixels.
    pub height: u32,
}

/// The size with the same shape whose longer side is at most `side`, never larger, at least one pixel.
pub fn fitted((width, height): (u32, u32), side: u32) -> (u32, u32) {
    let longest = width.max(height);
    if longest <= side || longest == 0 {
        return (width, height);
    }
    let scaled = |n: u32| {
        let exact = f64::from(n) * f64::from(side) / f64::from(longest);
        (exact.round() as u32).clamp(1, side.max(1))
    };
    (scaled(width), scaled(height))
}

/// The picture reduced to fit `side`.
///
/// # Errors
/// What the encoder said.
pub fn inlined(picture: &RgbImage, side: u32) -> Result<Inlined, String> {
    let (width, height) = fitted(picture.dimensions(), side);
    let small = if (width, height) == picture.dimensions() {
        picture.clone()
    } else {
        imageops::resize(picture, width, height, imageops::FilterType::Triangle)
    };
    let mut bytes = Vec::new();
    JpegEncoder::new_with_quality(&mut bytes, QUALITY)
        .write_image(&small, width, height, image::ExtendedColorType::Rgb8)
        .map_err(|e| format!("cannot be encoded: {e}"))?;
    Ok(Inlined {
        uri: format!("data:image/jpeg;base64,{}", base64(&bytes)),
        width,
        height,
    })
}

/// RFC 4648, with padding.
pub fn base64(bytes: &[u8]) -> String {
    const DIGITS: &[u8; 64] = b"ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
    let mut out = String::with_capacity(bytes.len().div_ceil(3) * 4);
    for chunk in bytes.chunks(3) {
        let word = chunk
            .iter()
            .enumerate()
            .fold(0_u32, |word, (i, b)| word | u32::from(*b) << (16 - 8 * i));
        for i in 0..4 {
            let digit = DIGITS[(word >> (18 - 6 * i) & 63) as usize];
            out.push(if i <= chunk.len() { digit.into() } else { '=' });
        }
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn base64_as_in_rfc_4648() {
        for (plain, coded) in [
            ("", ""),
            ("f", "Zg=="),
            ("fo", "Zm8="),
            ("foo", "Zm9v"),
            ("foob", "Zm9vYg=="),
            ("fooba", "Zm9vYmE="),
            ("foobar", "Zm9vYmFy"),
        ] {
            assert_eq!(base64(plain.as_bytes()), coded);
        }
        assert_eq!(base64(&[0xFB, 0xEF, 0xFF]), "++//");
    }

    #[test]
    fn pictures_shrink_and_never_grow() {
        assert_eq!(fitted((741, 497), 960), (741, 497));
        assert_eq!(fitted((1482, 994), 741), (741, 497));
        assert_eq!(fitted((4000, 3), 400), (400, 1));
        assert_eq!(fitted((0, 0), 400), (0, 0));
    }
}
