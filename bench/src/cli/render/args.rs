//! Values that options of `render` take.

use std::str::FromStr;

use clap::ValueEnum;
use glam::DVec3;
use sharp::color::{Quantization, linear_from_srgb};
use sharp::gaussians::Gaussians;
use sharp::render::trajectory::{LookAt, TrajectoryKind};
use sharp::render::{Background, RenderView};

/// Low-pass added to both variances of a projected Gaussian: a preset or square pixels.
pub(super) fn eps2d(text: &str) -> Result<f32, &'static str> {
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

pub(super) fn background(text: &str) -> Result<Background, &'static str> {
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

/// A background as text for records: linear RGB.
pub(super) fn background_text(background: Background) -> String {
    match background {
        Background::Black => "black".to_owned(),
        Background::White => "white".to_owned(),
        Background::Color([r, g, b]) => format!("{r},{g},{b}"),
    }
}

/// How far the camera moves, metres, x right, y down, z forward.
pub(super) fn offset(text: &str) -> Result<DVec3, &'static str> {
    numbers(text)
        .map(DVec3::from_array)
        .filter(|xyz| xyz.is_finite())
        .ok_or("three numbers are needed: X,Y,Z in metres")
}

/// The ends of the depth colours, metres.
pub(super) fn depth_range(text: &str) -> Result<[f32; 2], &'static str> {
    numbers(text)
        .filter(|[near, far]: &[f32; 2]| *near > 0.0 && near < far && far.is_finite())
        .ok_or("two numbers are needed: NEAR,FAR in metres, 0 < NEAR < FAR")
}

fn numbers<T: FromStr, const N: usize>(text: &str) -> Option<[T; N]> {
    let numbers: Option<Vec<T>> = text.split(',').map(|n| n.trim().parse().ok()).collect();
    numbers?.try_into().ok()
}

/// Which of SHARP's layers are rendered, each alone.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Layers {
    One(usize),
    All,
}

/// SHARP predicts two Gaussians a pixel: first all of the visible layer, then all of the hidden one.
const LAYERS: usize = 2;

impl FromStr for Layers {
    type Err = &'static str;

    fn from_str(text: &str) -> Result<Self, Self::Err> {
        match (text, text.parse()) {
            ("all", _) => Ok(Self::All),
            (_, Ok(layer)) if layer < LAYERS => Ok(Self::One(layer)),
            _ => Err("0, 1 or all"),
        }
    }
}

impl Layers {
    pub(super) fn indices(self) -> Vec<usize> {
        match self {
            Self::One(layer) => vec![layer],
            Self::All => (0..LAYERS).collect(),
        }
    }

    /// One layer of a scene: an equal share of its Gaussians, by index. `None` when they cannot be shared equally.
    pub(super) fn of(scene: &Gaussians, layer: usize) -> Option<Gaussians> {
        let size = scene.len() / LAYERS;
        scene
            .len()
            .is_multiple_of(LAYERS)
            .then(|| scene.filtered(|k| k / size.max(1) == layer))
    }
}

/// The release's paths.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum PathArg {
    /// From left to right along a line
    Swipe,
    /// Left and right, then up and down
    Shake,
    /// A circle across the viewing direction
    Rotate,
    /// Sideways, and forward and back; the release's default
    #[value(name = "rotate_forward", alias = "rotate-forward")]
    RotateForward,
}

impl From<PathArg> for TrajectoryKind {
    fn from(path: PathArg) -> Self {
        match path {
            PathArg::Swipe => Self::Swipe,
            PathArg::Shake => Self::Shake,
            PathArg::Rotate => Self::Rotate,
            PathArg::RotateForward => Self::RotateForward,
        }
    }
}

/// Where a moved camera looks.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum LookArg {
    /// At a point on the photograph's axis: the 0.1 quantile of depth, at least 2 m away
    Point,
    /// The way the photograph's camera does
    Ahead,
}

impl From<LookArg> for LookAt {
    fn from(look: LookArg) -> Self {
        match look {
            LookArg::Point => Self::Point,
            LookArg::Ahead => Self::Ahead,
        }
    }
}

/// How linear light becomes 8 bit.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum Quantise {
    /// To the nearest level: what scoring does
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

    #[test]
    fn offsets_ranges_and_layers() {
        assert_eq!(offset("-0.1,0,2e-1"), Ok(DVec3::new(-0.1, 0.0, 0.2)));
        for bad in ["1,2", "a,b,c", "1,2,inf", ""] {
            assert!(offset(bad).is_err(), "{bad}");
        }
        assert_eq!(depth_range("0.5,20"), Ok([0.5, 20.0]));
        for bad in ["0,1", "2,1", "1,inf", "1"] {
            assert!(depth_range(bad).is_err(), "{bad}");
        }
        assert_eq!("all".parse(), Ok(Layers::All));
        assert_eq!("1".parse(), Ok(Layers::One(1)));
        assert!("2".parse::<Layers>().is_err());
    }

    #[test]
    fn layers_are_the_halves_of_a_scene() {
        let mut scene = Gaussians::default();
        for k in 0..6_u8 {
            scene.means.push([f32::from(k); 3]);
            scene.quaternions.push([1.0, 0.0, 0.0, 0.0]);
            scene.scales.push([0.1; 3]);
            scene.opacities.push(0.5);
            scene.colors.push([0.5; 3]);
        }
        let first = Layers::of(&scene, 0).unwrap();
        let second = Layers::of(&scene, 1).unwrap();
        assert_eq!(
            [first.means.as_slice(), &second.means].concat(),
            scene.means
        );
        assert_eq!((first.len(), second.len()), (3, 3));
        let odd = scene.filtered(|k| k > 0);
        assert_eq!(Layers::of(&odd, 0), None);
        assert_eq!(Layers::of(&Gaussians::default(), 1).unwrap().len(), 0);
    }
}
