//! sRGB ↔ linear light (IEC 61966-2-1, computed as in the SHARP release) and 8-bit quantisation.

/// Linear light of an sRGB-encoded value: `x / 12.92` up to 0.04045, else `((x + 0.055) /
/// 1.055)^2.4`. Both branches extend to values outside 0..1.
pub fn linear_from_srgb(x: f32) -> f32 {
    if x <= 0.040_45 {
        x / 12.92
    } else {
        ((x + 0.055) / 1.055).powf(2.4)
    }
}

/// Derivative of [`linear_from_srgb`]; nearly continuous where the branches meet.
#[cfg(feature = "render")]
pub(crate) fn linear_from_srgb_slope(x: f64) -> f64 {
    if x <= 0.040_45 {
        1.0 / 12.92
    } else {
        2.4 / 1.055 * ((x + 0.055) / 1.055).powf(1.4)
    }
}

/// sRGB encoding of linear light: `12.92 x` up to 0.0031308, else `1.055 x^(1/2.4) − 0.055`. Both
/// branches extend to values outside 0..1.
pub fn srgb_from_linear(x: f32) -> f32 {
    if x <= 0.003_130_8 {
        12.92 * x
    } else {
        1.055 * x.powf(1.0 / 2.4) - 0.055
    }
}

/// Rule for quantising a value in 0..1 to one of 256 levels.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub enum Quantization {
    /// To the nearest level, as in scoring.
    #[default]
    Round,
    /// Towards zero, as in the SHARP release's video writer.
    Truncate,
}

impl std::fmt::Display for Quantization {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Round => "round",
            Self::Truncate => "truncate",
        })
    }
}

/// The 8-bit level of a value, which is first clamped to 0..1; NaN becomes 0.
pub fn quantize(x: f32, rule: Quantization) -> u8 {
    let level = x.clamp(0.0, 1.0) * 255.0;
    // `as` saturates and maps NaN to 0.
    match rule {
        Quantization::Round => level.round() as u8,
        Quantization::Truncate => level as u8,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn encoding_inverts_decoding_on_every_level() {
        for level in 0..=255_u8 {
            let x = f32::from(level) / 255.0;
            assert_eq!(
                quantize(srgb_from_linear(linear_from_srgb(x)), Quantization::Round),
                level
            );
        }
    }

    #[test]
    fn branches_meet() {
        assert!((srgb_from_linear(0.003_130_8) - srgb_from_linear(0.003_131)).abs() < 1e-5);
        assert!((linear_from_srgb(0.040_45) - linear_from_srgb(0.040_451)).abs() < 1e-6);
        // Values computed in f64 from the standard's definition, independently of this code.
        assert!((linear_from_srgb(0.5) - 0.214_041_14).abs() < 1e-7);
        assert!((srgb_from_linear(0.5) - 0.735_357).abs() < 1e-6);
    }

    #[test]
    fn quantisation_clamps_and_knows_its_two_rules() {
        assert_eq!(quantize(-0.5, Quantization::Round), 0);
        assert_eq!(quantize(1.5, Quantization::Round), 255);
        assert_eq!(quantize(f32::NAN, Quantization::Round), 0);
        assert_eq!(quantize(0.999, Quantization::Round), 255);
        assert_eq!(quantize(0.999, Quantization::Truncate), 254);
    }
}
