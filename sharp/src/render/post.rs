//! After rasterisation: background, sRGB encoding, 8 bit, expected depth.

use super::RenderOutput;
use crate::color::{Quantization, linear_from_srgb, quantize, srgb_from_linear};
use crate::ply::ColorSpace;
use image::{ImageBuffer, Luma, Rgb, RgbImage};
use rayon::prelude::*;

/// Colour behind the Gaussians.
#[derive(Debug, Clone, Copy, PartialEq, Default)]
pub enum Background {
    /// Adds nothing. The default of the SHARP release and of scoring.
    #[default]
    Black,
    /// Adds `1 − alpha` to each channel.
    White,
    /// Adds `(1 − alpha) · colour`; RGB in the blending colour space.
    Color([f32; 3]),
    /// A colour given by its sRGB levels, regardless of the blending colour space.
    Levels([u8; 3]),
}

impl Background {
    /// RGB in the given blending colour space.
    pub fn in_space(self, space: ColorSpace) -> [f32; 3] {
        match self {
            Self::Black => [0.0; 3],
            Self::White => [1.0; 3],
            Self::Color(color) => color,
            Self::Levels(levels) => levels.map(|level| match space {
                ColorSpace::Linear => linear_from_srgb(f32::from(level) / 255.0),
                ColorSpace::Srgb => f32::from(level) / 255.0,
            }),
        }
    }
}

/// Writes the notation that parsing accepts, which records also use.
impl std::fmt::Display for Background {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Black => f.write_str("black"),
            Self::White => f.write_str("white"),
            Self::Color([r, g, b]) => write!(f, "{r},{g},{b}"),
            Self::Levels([r, g, b]) => write!(f, "#{r:02x}{g:02x}{b:02x}"),
        }
    }
}

/// `black`, `white`, `#RRGGBB` in sRGB, or `R,G,B` in the blending colour space.
impl std::str::FromStr for Background {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        const FORMS: &str = "black, white, #RRGGBB (sRGB) or R,G,B (0 to 1, linear light unless the rule blends encoded values)";
        let color = match text {
            "black" => return Ok(Self::Black),
            "white" => return Ok(Self::White),
            _ => match text.strip_prefix('#') {
                Some(hex) => {
                    let digits = hex.len() == 6 && hex.bytes().all(|b| b.is_ascii_hexdigit());
                    let code = u32::from_str_radix(hex, 16).ok().filter(|_| digits);
                    let [_, r, g, b] = code.ok_or(FORMS)?.to_be_bytes();
                    return Ok(Self::Levels([r, g, b]));
                }
                None => {
                    let levels = text.split(',').map(|level| level.trim().parse().ok());
                    let levels: Option<Vec<f32>> = levels.collect();
                    levels
                        .and_then(|levels| levels.try_into().ok())
                        .filter(|rgb: &[f32; 3]| rgb.iter().all(|v| (0.0..=1.0).contains(v)))
                        .ok_or(FORMS)?
                }
            },
        };
        Ok(Self::Color(color))
    }
}

/// Minimum alpha by which an accumulated depth is divided (as in the SHARP release).
const ALPHA_FLOOR: f32 = 1e-8;

impl RenderOutput {
    /// RGB over a background, in the blending colour space; not clamped.
    pub fn composited(&self, background: Background) -> ImageBuffer<Rgb<f32>, Vec<f32>> {
        self.picture(background, |x| x)
    }

    /// sRGB picture over a background. Linear light is encoded after compositing and not clamped; values that are
    /// already encoded are clamped to 0..1.
    pub fn srgb(&self, background: Background) -> ImageBuffer<Rgb<f32>, Vec<f32>> {
        self.picture(background, self.encoding())
    }

    fn encoding(&self) -> fn(f32) -> f32 {
        match self.blending {
            ColorSpace::Linear => srgb_from_linear,
            ColorSpace::Srgb => |x| x.clamp(0.0, 1.0),
        }
    }

    /// Like [`Self::srgb`], quantised to 8 bit. Scoring uses [`Quantization::Round`], the SHARP release's
    /// video writer [`Quantization::Truncate`].
    pub fn srgb8(&self, background: Background, rule: Quantization) -> RgbImage {
        let encode = self.encoding();
        self.picture(background, |x| quantize(encode(x), rule))
    }

    /// Expected z-depth `Σ w z / max(alpha, 1e-8)` in metres; 0 where nothing was drawn.
    pub fn expected_depth(&self) -> ImageBuffer<Luma<f32>, Vec<f32>> {
        let depth = self
            .depth_acc
            .par_iter()
            .zip(&self.alpha)
            .map(|(depth, alpha)| depth / alpha.max(ALPHA_FLOOR))
            .collect();
        in_shape(self.width, self.height, depth)
    }

    fn picture<T>(
        &self,
        background: Background,
        encode: impl Fn(f32) -> T + Sync,
    ) -> ImageBuffer<Rgb<T>, Vec<T>>
    where
        T: image::Primitive + Send,
        Rgb<T>: image::Pixel<Subpixel = T>,
    {
        let behind = background.in_space(self.blending);
        let mut samples = vec![T::DEFAULT_MIN_VALUE; self.rgb.len() * 3];
        samples
            .par_chunks_exact_mut(3)
            .with_min_len(4096)
            .zip(&self.rgb)
            .zip(&self.alpha)
            .for_each(|((out, rgb), alpha)| {
                for channel in 0..3 {
                    out[channel] = encode(rgb[channel] + (1.0 - alpha) * behind[channel]);
                }
            });
        in_shape(self.width, self.height, samples)
    }
}

/// Wraps samples as a picture; an empty picture if the number of samples does not match the size.
fn in_shape<P: image::Pixel>(
    width: u32,
    height: u32,
    samples: Vec<P::Subpixel>,
) -> ImageBuffer<P, Vec<P::Subpixel>> {
    ImageBuffer::from_vec(width, height, samples).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::super::Dropped;
    use super::*;

    fn one(rgb: [f32; 3], alpha: f32, depth: f32) -> RenderOutput {
        RenderOutput {
            width: 1,
            height: 1,
            blending: ColorSpace::Linear,
            rgb: vec![rgb],
            alpha: vec![alpha],
            depth_acc: vec![depth],
            drawn: 1,
            dropped: Dropped::default(),
        }
    }

    #[test]
    fn backgrounds_are_added_in_linear_light() {
        let half = one([0.25, 0.1, 0.0], 0.5, 1.0);
        assert_eq!(
            half.composited(Background::Black).as_raw(),
            &[0.25, 0.1, 0.0]
        );
        assert_eq!(
            half.composited(Background::White).as_raw(),
            &[0.75, 0.6, 0.5]
        );
        let tinted = half.composited(Background::Color([1.0, 0.0, 0.5]));
        assert_eq!(tinted.as_raw(), &[0.75, 0.1, 0.25]);
        // Encoded after compositing: srgb(0.75), not srgb(0.25) + 0.5.
        let encoded = half.srgb(Background::White).as_raw()[0];
        assert!((encoded - 0.880_825).abs() < 1e-5, "{encoded}");
    }

    /// Encoded values are the picture itself, clamped to 0..1, over a background in their colour space.
    #[test]
    fn encoded_values_are_not_encoded_again() {
        let blended = RenderOutput {
            blending: ColorSpace::Srgb,
            ..one([0.25, 1.5, -0.1], 0.5, 1.0)
        };
        let behind = Background::Color([0.5, 0.0, 0.0]);
        assert_eq!(blended.composited(behind).as_raw(), &[0.5, 1.5, -0.1]);
        assert_eq!(blended.srgb(behind).as_raw(), &[0.5, 1.0, 0.0]);
        let levels = blended.srgb8(behind, Quantization::Round);
        assert_eq!(levels.as_raw(), &[128, 255, 0]);
    }

    #[test]
    fn eight_bit_has_two_rules() {
        let x = one([0.5, 2.0, -1.0], 1.0, 1.0);
        let rounded = x.srgb8(Background::Black, Quantization::Round);
        let cut = x.srgb8(Background::Black, Quantization::Truncate);
        // srgb(0.5) · 255 = 187.516
        assert_eq!(rounded.as_raw(), &[188, 255, 0]);
        assert_eq!(cut.as_raw(), &[187, 255, 0]);
    }

    #[test]
    fn expected_depth_divides_by_a_bounded_alpha() {
        assert_eq!(one([0.0; 3], 0.5, 2.0).expected_depth().as_raw(), &[4.0]);
        assert_eq!(one([0.0; 3], 0.0, 0.0).expected_depth().as_raw(), &[0.0]);
        let faint = one([0.0; 3], 1e-9, 1e-9).expected_depth().as_raw()[0];
        assert!((faint - 0.1).abs() < 1e-6);
    }

    #[test]
    fn backgrounds_are_linear_light_and_hex_codes_are_srgb() {
        let parse = str::parse::<Background>;
        assert_eq!(parse("black"), Ok(Background::Black));
        assert_eq!(parse("white"), Ok(Background::White));
        assert_eq!(parse("0.5, 0,1"), Ok(Background::Color([0.5, 0.0, 1.0])));
        let hex = parse("#0080ff").unwrap();
        assert_eq!(hex.to_string(), "#0080ff");
        assert_eq!(hex.in_space(ColorSpace::Srgb)[1], 128.0 / 255.0);
        let [r, g, b] = hex.in_space(ColorSpace::Linear);
        // 128 / 255 = 0.50196 of sRGB is 0.21586 of linear light.
        assert!(r == 0.0 && (g - 0.215_86).abs() < 1e-5 && b == 1.0);
        for bad in [
            "grey", "#12345", "#+12345", "1,2,3", "0,0", "nan,0,0", "#ééé",
        ] {
            assert!(parse(bad).is_err(), "{bad}");
        }
    }
}
