//! Options that decide the pixels of a rendering, shared by `run` and `render`.

use std::str::FromStr;

use clap::{Args, ValueEnum};
use sharp::color::{Quantization, linear_from_srgb};
use sharp::render::{Background, RenderView};

use crate::rendering::RenderSettings;

/// Options of rendering, for any backend.
#[derive(Debug, Clone, Copy, Args)]
pub(super) struct RenderingArgs {
    /// Low-pass added to both variances of a projected Gaussian: release (0), config (0.01), gsplat (0.3; also 3dgs),
    /// or square pixels
    #[arg(long, value_name = "X", default_value = "release", value_parser = eps2d)]
    eps2d: f32,
    /// Behind the Gaussians: black, white, #RRGGBB (sRGB), or R,G,B in linear light; blended in linear light
    /// [default: black]
    #[arg(long, value_name = "COLOUR", value_parser = background)]
    pub(super) background: Option<Background>,
    /// Renderings from 0..1 to 8 bit [default: round]
    #[arg(long, alias = "quantize", value_enum, value_name = "RULE")]
    pub(super) quantise: Option<Quantise>,
}

impl RenderingArgs {
    pub(super) fn settings(&self) -> RenderSettings {
        RenderSettings {
            eps2d: self.eps2d,
            background: self.background.unwrap_or_default(),
            quantization: self.quantise.map(Quantization::from).unwrap_or_default(),
        }
    }
}

/// How linear light becomes 8 bit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum Quantise {
    /// To the nearest level: what scoring does unless asked otherwise
    Round,
    /// Towards zero: what the release's video writer does
    Truncate,
}

impl From<Quantise> for Quantization {
    fn from(rule: Quantise) -> Self {
        match rule {
            Quantise::Round => Self::Round,
            Quantise::Truncate => Self::Truncate,
        }
    }
}

/// Low-pass added to both variances of a projected Gaussian: a preset or square pixels.
fn eps2d(text: &str) -> Result<f32, &'static str> {
    Ok(match text {
        "release" => RenderView::EPS2D_RELEASE,
        "config" => RenderView::EPS2D_CONFIG,
        "gsplat" | "3dgs" => RenderView::EPS2D_GSPLAT,
        number => number
            .parse()
            .ok()
            .filter(|value: &f32| *value >= 0.0 && value.is_finite())
            .ok_or("release (0), config (0.01), gsplat (0.3), or square pixels ≥ 0")?,
    })
}

fn background(text: &str) -> Result<Background, &'static str> {
    const FORMS: &str = "black, white, #RRGGBB (sRGB) or R,G,B (linear light, 0 to 1)";
    let color = match text {
        "black" => return Ok(Background::Black),
        "white" => return Ok(Background::White),
        _ => match text.strip_prefix('#') {
            Some(hex) => {
                let digits = hex.len() == 6 && hex.bytes().all(|b| b.is_ascii_hexdigit());
                let code = u32::from_str_radix(hex, 16).ok().filter(|_| digits);
                let [_, r, g, b] = code.ok_or(FORMS)?.to_be_bytes();
                [r, g, b].map(|level| linear_from_srgb(f32::from(level) / 255.0))
            }
            None => numbers(text)
                .filter(|rgb: &[f32; 3]| rgb.iter().all(|v| (0.0..=1.0).contains(v)))
                .ok_or(FORMS)?,
        },
    };
    Ok(Background::Color(color))
}

/// Numbers between commas.
pub(super) fn numbers<T: FromStr, const N: usize>(text: &str) -> Option<[T; N]> {
    let numbers: Option<Vec<T>> = text.split(',').map(|n| n.trim().parse().ok()).collect();
    numbers?.try_into().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn presets_and_numbers_of_eps2d() {
        let parse = eps2d;
        assert_eq!(parse("release"), Ok(0.0));
        assert_eq!(parse("config"), Ok(0.01));
        assert_eq!(parse("gsplat"), parse("3dgs"));
        assert_eq!(parse("gsplat"), Ok(0.3));
        assert_eq!(parse("0.25"), Ok(0.25));
        for bad in ["-1", "NaN", "inf", "sharp"] {
            assert!(parse(bad).unwrap_err().contains("release"), "{bad}");
        }
    }

    #[test]
    fn backgrounds_are_linear_light_and_hex_codes_are_srgb() {
        let parse = background;
        assert_eq!(parse("black"), Ok(Background::Black));
        assert_eq!(parse("white"), Ok(Background::White));
        assert_eq!(parse("0.5, 0,1"), Ok(Background::Color([0.5, 0.0, 1.0])));
        let Ok(Background::Color([r, g, b])) = parse("#0080ff") else {
            panic!();
        };
        // 128 / 255 = 0.50196 of sRGB is 0.21586 of linear light.
        assert!(r == 0.0 && (g - 0.215_86).abs() < 1e-5 && b == 1.0);
        for bad in [
            "grey", "#12345", "#+12345", "1,2,3", "0,0", "nan,0,0", "#ééé",
        ] {
            assert!(parse(bad).is_err(), "{bad}");
        }
    }
}
