use std::fmt;
use std::str::FromStr;

use clap::{Args, ValueEnum};
use schemars::JsonSchema;
use serde::{Deserialize, Serialize};
use sharp::color::Quantization;
use sharp::render::{Backend, Background, RenderView};

use super::error::ConfigError;
use super::text;

use crate::rendering::RenderSettings;

/// Settings that decide a rendering's pixels on every backend.
#[derive(Debug, Clone, Default, PartialEq, Args, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case", default)]
pub struct RenderingConfig {
    /// Low-pass filter: variance added to both axes of each projected Gaussian. A number in square pixels, or release
    /// (0), config (0.01), gsplat or 3dgs (0.3). `run` ignores this option for Gaussians that have their own rendering
    /// rule [default: release]
    #[arg(long, value_name = "X")]
    #[serde(with = "text")]
    #[schemars(with = "Option<String>")]
    pub eps2d: Option<LowPass>,
    /// Background: black, white, #RRGGBB (sRGB), or R,G,B in the rendering rule's blending space (linear or encoded)
    /// [default: black]
    #[arg(long, value_name = "COLOUR")]
    #[serde(with = "text")]
    #[schemars(with = "Option<String>")]
    pub background: Option<Background>,
    /// How renderings are rounded to 8 bit [default: round]
    #[arg(long, alias = "quantize", value_enum, value_name = "RULE")]
    pub quantise: Option<Quantise>,
}

impl RenderingConfig {
    pub fn settings(&self) -> RenderSettings {
        RenderSettings {
            eps2d: self.eps2d.map_or(RenderView::EPS2D_RELEASE, |LowPass(x)| x),
            background: self.background.unwrap_or_default(),
            quantization: self.quantise.map(Quantization::from).unwrap_or_default(),
        }
    }
}

/// Rounding to 8 bit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum, Serialize, Deserialize, JsonSchema)]
#[serde(rename_all = "kebab-case")]
pub enum Quantise {
    /// To the nearest level, the default for scoring
    Round,
    /// Towards zero, as the release's video writer does
    Truncate,
}

impl From<Quantization> for Quantise {
    fn from(rule: Quantization) -> Self {
        match rule {
            Quantization::Round => Self::Round,
            Quantization::Truncate => Self::Truncate,
        }
    }
}

impl From<Quantise> for Quantization {
    fn from(rule: Quantise) -> Self {
        match rule {
            Quantise::Round => Self::Round,
            Quantise::Truncate => Self::Truncate,
        }
    }
}

/// Variance added to a projected Gaussian, square pixels.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct LowPass(pub f32);

impl FromStr for LowPass {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        Ok(Self(match text {
            "release" => RenderView::EPS2D_RELEASE,
            "config" => RenderView::EPS2D_CONFIG,
            "gsplat" | "3dgs" => RenderView::EPS2D_GSPLAT,
            number => number
                .parse()
                .ok()
                .filter(|value: &f32| *value >= 0.0 && value.is_finite())
                .ok_or("release (0), config (0.01), gsplat (0.3), or square pixels ≥ 0")?,
        }))
    }
}

impl fmt::Display for LowPass {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self.0.fmt(f)
    }
}

/// Combines `--backend` and `--adapter`; naming an adapter implies wgpu.
///
/// # Errors
/// If the two name different devices.
pub fn backend(backend: &Backend, adapter: Option<&str>) -> Result<Backend, ConfigError> {
    let usage = |reason: String| Err(ConfigError::Usage(reason));
    match (backend, adapter) {
        (backend, None) => Ok(backend.clone()),
        (Backend::Auto | Backend::Wgpu(None), Some(name)) => {
            Ok(Backend::Wgpu(Some(name.to_owned())))
        }
        (Backend::Cpu, Some(_)) => usage(
            "--adapter names a GPU, but --backend cpu uses none; use --backend wgpu".to_owned(),
        ),
        (Backend::Wgpu(Some(_)), Some(_)) => {
            usage(format!("--backend {backend} already names an adapter"))
        }
    }
}

/// Parses `N` comma-separated numbers.
pub(crate) fn numbers<T: FromStr, const N: usize>(text: &str) -> Option<[T; N]> {
    let numbers: Option<Vec<T>> = text.split(',').map(|n| n.trim().parse().ok()).collect();
    numbers?.try_into().ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn presets_and_numbers_of_eps2d() {
        let parse = LowPass::from_str;
        assert_eq!(parse("release"), Ok(LowPass(0.0)));
        assert_eq!(parse("config"), Ok(LowPass(0.01)));
        assert_eq!(parse("gsplat"), parse("3dgs"));
        assert_eq!(parse("gsplat"), Ok(LowPass(0.3)));
        assert_eq!(parse("0.25"), Ok(LowPass(0.25)));
        for bad in ["-1", "NaN", "inf", "sharp"] {
            assert!(parse(bad).unwrap_err().contains("release"), "{bad}");
        }
    }

    #[test]
    fn an_adapter_asks_for_wgpu() {
        let named = Backend::Wgpu(Some("A".to_owned()));
        for given in [Backend::Auto, Backend::Wgpu(None)] {
            assert_eq!(backend(&given, Some("A")).unwrap(), named);
            assert_eq!(backend(&given, None).unwrap(), given);
        }
        assert!(backend(&Backend::Cpu, Some("A")).is_err());
        assert!(backend(&named, Some("B")).is_err());
    }
}
