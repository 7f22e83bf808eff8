//! Named rendering conventions: the choices in which renderers of 3D Gaussians differ.
//!
//! Everything else in the definition is common to all conventions (see [`super`]). No choice is
//! needed for a compensated opacity below 1/255: the picture is the same whether such a Gaussian is
//! dropped early or skipped at every pixel.

use crate::gaussians::Harmonics;
use crate::ply::{ColorSpace, setting};
use std::fmt;
use std::str::FromStr;

setting!(
    /// Opacity factor that compensates for the widening by the low-pass, computed from the determinants of the 2D
    /// covariance without (d0) and with it (d1).
    Compensation, "compensation":
    /// Factor 1: opacities are not compensated.
    None = "none",
    /// √(d0/d1).
    Root = "root",
    /// √max(0.005², d0/d1).
    FlooredRoot = "floored-root",
    /// √(d0/(d1 + 1e-6) + 1e-6), and 0 if d0 or d1 is at most 1e-6.
    MipSplatting = "mip-splatting",
);

impl Compensation {
    /// Integer by which the shaders identify the value.
    pub(super) fn code(self) -> u32 {
        match self {
            Self::None => 0,
            Self::Root => 1,
            Self::FlooredRoot => 2,
            Self::MipSplatting => 3,
        }
    }
}

setting!(
    /// Treatment of a centre exactly on the near plane.
    NearPlane, "near-plane":
    /// The Gaussian is drawn.
    Included = "included",
    /// The Gaussian is dropped.
    Excluded = "excluded",
);
setting!(
    /// Bounds on x/z and y/z at which the Jacobian is evaluated.
    JacobianClamp, "jacobian-clamp":
    /// The picture's edges, moved outwards by 0.15 of its width or height.
    Image = "image",
    /// 1.3 times half the field of view to either side of the axis, regardless of the principal point.
    Symmetric = "symmetric",
    /// No bounds.
    None = "none",
);
setting!(
    /// Use of the camera's principal point.
    PrincipalPoint, "principal-point":
    Used = "used",
    /// The picture's centre is used instead of the principal point.
    Ignored = "ignored",
);
setting!(
    /// Pixels that a Gaussian may cover.
    Support, "support":
    /// All pixels where the Gaussian's alpha reaches 1/255.
    Exact = "exact",
    /// As in Inria's rasteriser, only pixels in tiles of 16×16 pixels that overlap a square around the Gaussian's
    /// centre. The square extends by ⌈3σ⌉ pixels to each side, where σ is the larger standard deviation.
    Tiles = "tiles",
);

/// Defines the struct of the choices, and reads and writes its fields by key.
macro_rules! record {
    ($(#[$about:meta])* $name:ident { $($(#[$of:meta])* $field:ident: $kind:ty = $key:literal,)+ }) => {
        $(#[$about])*
        #[derive(Debug, Clone, Copy, PartialEq)]
        pub struct $name { $($(#[$of])* pub $field: $kind),+ }

        impl $name {
            /// Keys of the choices, in the order in which they are written.
            pub const KEYS: &[&str] = &[$($key),+];

            /// Values of the choices as text, in the order of [`Self::KEYS`].
            fn values(&self) -> Vec<String> {
                vec![$(self.$field.to_string()),+]
            }

            fn set(&mut self, key: &str, text: &str) -> Result<(), RuleError> {
                let value = |reason: String| RuleError::Value {
                    key: key.to_owned(),
                    text: text.to_owned(),
                    reason,
                };
                match key {
                    $($key => self.$field = text.parse::<$kind>().map_err(|e| value(e.to_string()))?,)+
                    _ => return Err(RuleError::Key(key.to_owned())),
                }
                Ok(())
            }
        }
    };
}

record! {
    /// A rendering convention. Written `NAME`, or `NAME,key=value,…` with the choices that differ
    /// from the named rule.
    Rule {
        /// Added to both diagonal entries of the 2D covariance, px², ≥ 0.
        low_pass: f32 = "low-pass",
        compensation: Compensation = "compensation",
        /// Maximum alpha of one Gaussian in a pixel, 0..1.
        alpha_max: f32 = "alpha-max",
        /// Gaussians whose centre has z below this are dropped; > 0, in the unit of the scene.
        near: f32 = "near",
        near_plane: NearPlane = "near-plane",
        /// Gaussians whose centre has z above this are dropped; a centre exactly on the far plane
        /// is kept.
        far: f32 = "far",
        jacobian_clamp: JacobianClamp = "jacobian-clamp",
        principal_point: PrincipalPoint = "principal-point",
        support: Support = "support",
        /// Colour space in which colours and background are blended. Linear light is encoded after blending. Encoded
        /// values are clamped below at 0 before blending, and the blended result is the picture.
        blending: ColorSpace = "blending",
        /// Maximum degree of harmonics drawn; higher coefficients are ignored.
        degree: usize = "degree",
    }
}

#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
pub enum RuleError {
    #[error("unknown rendering rule \"{0}\": {known}", known = Rule::names().join(", "))]
    Name(String),
    #[error("unknown choice \"{0}\" of a rendering rule: {known}", known = Rule::KEYS.join(", "))]
    Key(String),
    #[error("invalid value \"{text}\" of {key} in a rendering rule: {reason}")]
    Value {
        key: String,
        text: String,
        reason: String,
    },
    #[error("invalid rendering rule: {0}")]
    Impossible(String),
}

impl Rule {
    /// SHARP's release: gsplat 1.5.3's classic mode without its low-pass, in linear light, with view-independent
    /// colours.
    pub const SHARP: Self = Self {
        low_pass: 0.0,
        compensation: Compensation::None,
        alpha_max: 0.999,
        near: 0.01,
        near_plane: NearPlane::Included,
        far: 1e10,
        jacobian_clamp: JacobianClamp::Image,
        principal_point: PrincipalPoint::Used,
        support: Support::Exact,
        blending: ColorSpace::Linear,
        degree: 0,
    };
    /// Inria's main rasteriser, which ignores the principal point.
    pub const INRIA: Self = Self {
        low_pass: 0.3,
        alpha_max: 0.99,
        near: 0.2,
        near_plane: NearPlane::Excluded,
        far: f32::INFINITY,
        jacobian_clamp: JacobianClamp::Symmetric,
        principal_point: PrincipalPoint::Ignored,
        support: Support::Tiles,
        blending: ColorSpace::Srgb,
        degree: 3,
        ..Self::SHARP
    };
    /// Forks of Inria's rasteriser that use the principal point.
    pub const INRIA_GENERAL: Self = Self {
        principal_point: PrincipalPoint::Used,
        ..Self::INRIA
    };
    /// gsplat 1.5.3, `rasterize_mode="classic"`.
    pub const GSPLAT_1_5_3_CLASSIC: Self = Self {
        low_pass: 0.3,
        blending: ColorSpace::Srgb,
        degree: Harmonics::MAX_DEGREE,
        ..Self::SHARP
    };
    /// gsplat 1.6.0.
    pub const GSPLAT_CLASSIC: Self = Self {
        alpha_max: 0.99,
        ..Self::GSPLAT_1_5_3_CLASSIC
    };

    /// gsplat 1.6.0 with antialiasing.
    pub const GSPLAT_ANTIALIASED: Self = Self {
        compensation: Compensation::FlooredRoot,
        ..Self::GSPLAT_CLASSIC
    };
    /// Mip-Splatting without its 3D filter, which is part of the scene.
    pub const MIP_SPLATTING: Self = Self {
        low_pass: 0.1,
        compensation: Compensation::MipSplatting,
        ..Self::INRIA_GENERAL
    };
    /// The mip mode of brush.
    pub const BRUSH_MIP: Self = Self {
        low_pass: 0.1,
        compensation: Compensation::Root,
        far: f32::INFINITY,
        ..Self::GSPLAT_1_5_3_CLASSIC
    };

    pub const NAMED: [(&str, Self); 10] = [
        ("sharp", Self::SHARP),
        ("inria", Self::INRIA),
        ("inria-general", Self::INRIA_GENERAL),
        // The branch dr_aa of Inria's rasteriser, with antialiasing.
        (
            "inria-aa",
            Self {
                compensation: Compensation::FlooredRoot,
                ..Self::INRIA_GENERAL
            },
        ),
        ("mip-splatting", Self::MIP_SPLATTING),
        ("gsplat-classic", Self::GSPLAT_CLASSIC),
        ("gsplat-antialiased", Self::GSPLAT_ANTIALIASED),
        ("gsplat-1.5.3-classic", Self::GSPLAT_1_5_3_CLASSIC),
        (
            "gsplat-1.5.3-antialiased",
            Self {
                compensation: Compensation::Root,
                ..Self::GSPLAT_1_5_3_CLASSIC
            },
        ),
        ("brush-mip", Self::BRUSH_MIP),
    ];

    pub fn names() -> Vec<&'static str> {
        Self::NAMED.map(|(name, _)| name).to_vec()
    }

    /// True if the rule equals SHARP's except for low-pass and planes, as the derivative and the browser viewer
    /// require.
    pub fn is_like_sharp(&self) -> bool {
        let Self {
            low_pass,
            near,
            far,
            ..
        } = *self;
        *self
            == Self {
                low_pass,
                near,
                far,
                ..Self::SHARP
            }
    }

    /// Checks that every choice is in its range.
    ///
    /// # Errors
    /// [`RuleError::Impossible`] with the choice that is out of range.
    pub fn check(&self) -> Result<(), RuleError> {
        let Self {
            low_pass,
            alpha_max,
            near,
            far,
            degree,
            ..
        } = self;
        let refused = if !(*low_pass >= 0.0 && low_pass.is_finite()) {
            format!("low-pass {low_pass} is negative or not finite")
        } else if !(*alpha_max > 0.0 && *alpha_max <= 1.0) {
            format!("alpha-max {alpha_max} must be above 0 and at most 1")
        } else if !(*near > 0.0 && near <= far) {
            format!("near {near} and far {far} must satisfy 0 < near ≤ far")
        } else if *degree > Harmonics::MAX_DEGREE {
            format!("degree {degree} is above {}", Harmonics::MAX_DEGREE)
        } else {
            return Ok(());
        };
        Err(RuleError::Impossible(refused))
    }
}

impl Default for Rule {
    fn default() -> Self {
        Self::SHARP
    }
}

/// Written relative to the named rule with the fewest differing choices, the first if several tie.
impl fmt::Display for Rule {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let values = self.values();
        let changes = |named: &Self| -> Vec<String> {
            let choices = Self::KEYS.iter().zip(&values).zip(named.values());
            choices
                .filter(|((_, value), of_named)| *value != of_named)
                .map(|((key, value), _)| format!(",{key}={value}"))
                .collect()
        };
        let by_name = Self::NAMED.map(|(name, rule)| (name, changes(&rule)));
        let nearest = by_name.iter().min_by_key(|(_, changes)| changes.len());
        let (name, changes) = nearest.ok_or(fmt::Error)?;
        write!(f, "{name}{}", changes.concat())
    }
}

impl FromStr for Rule {
    type Err = RuleError;

    fn from_str(text: &str) -> Result<Self, RuleError> {
        let mut parts = text.split(',').map(str::trim);
        let name = parts.next().unwrap_or_default();
        let named = Self::NAMED.iter().find(|(known, _)| *known == name);
        let (_, mut rule) = *named.ok_or_else(|| RuleError::Name(name.to_owned()))?;
        for part in parts {
            let (key, value) = part
                .split_once('=')
                .ok_or_else(|| RuleError::Key(part.to_owned()))?;
            rule.set(key.trim(), value.trim())?;
        }
        rule.check()?;
        Ok(rule)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn rules_are_read_as_they_are_written() {
        for (name, rule) in Rule::NAMED {
            assert_eq!(rule.to_string(), name);
            assert_eq!(name.parse(), Ok(rule));
        }
        for text in [
            "sharp,low-pass=0.01",
            "inria,near=0.01,degree=0",
            "inria-general,support=exact",
            "gsplat-classic,jacobian-clamp=symmetric,blending=linear",
            "brush-mip,far=100",
        ] {
            assert_eq!(text.parse::<Rule>().unwrap().to_string(), text);
        }
        // This rule differs from two named rules by one choice each; the text uses the first of them.
        let other: Rule = "gsplat-classic, compensation = root".parse().unwrap();
        assert_eq!(other.compensation, Compensation::Root);
        assert_eq!(other.to_string().parse(), Ok(other));
        assert_eq!(Rule::default().to_string(), "sharp");
    }

    /// Sets every choice of every rule in every named rule.
    #[test]
    fn each_choice_can_be_set_alone() {
        for (name, rule) in Rule::NAMED {
            for (_, other) in Rule::NAMED {
                for (key, value) in Rule::KEYS.iter().zip(other.values()) {
                    let set: Rule = format!("{name},{key}={value}").parse().unwrap();
                    assert_eq!(set.to_string().parse(), Ok(set), "{name} {key} {value}");
                    let values = set.values().into_iter().zip(rule.values());
                    assert!(values.filter(|(a, b)| a != b).count() <= 1);
                }
            }
        }
    }

    #[test]
    fn what_no_rule_has_is_refused() {
        for (text, word) in [
            ("", "unknown rendering rule"),
            ("graphdeco", "gsplat-1.5.3-classic"),
            ("inria,blur=1", "low-pass"),
            ("inria,near", "near-plane"),
            ("inria,near=x", "near"),
            ("inria,low-pass=-1", "low-pass -1"),
            ("inria,low-pass=nan", "low-pass NaN"),
            ("inria,alpha-max=1.5", "alpha-max 1.5"),
            ("inria,near=0", "near 0"),
            ("inria,far=0.1", "far 0.1"),
            ("inria,degree=5", "degree 5"),
            ("inria,support=ellipse", "exact or tiles"),
            ("inria,blending=hsv", "linear"),
        ] {
            let error = text.parse::<Rule>().unwrap_err().to_string();
            assert!(error.contains(word), "{text}: {error}");
        }
    }
}
