//! Value types of `render`'s options.

use std::str::FromStr;

use clap::ValueEnum;
use glam::DVec3;
use sharp::gaussians::Gaussians;
use sharp::trajectory::TrajectoryKind;

use crate::config::rendering::numbers;

/// Parses a camera offset: metres, x right, y down, z forward.
pub(super) fn offset(text: &str) -> Result<DVec3, &'static str> {
    numbers(text)
        .map(DVec3::from_array)
        .filter(|xyz| xyz.is_finite())
        .ok_or("expected three numbers: X,Y,Z in metres")
}

/// Parses the depths at the ends of the colour scale, in metres.
pub(super) fn depth_range(text: &str) -> Result<[f32; 2], &'static str> {
    numbers(text)
        .filter(|[near, far]: &[f32; 2]| *near > 0.0 && near < far && far.is_finite())
        .ok_or("expected two numbers: NEAR,FAR in metres, 0 < NEAR < FAR")
}

/// Which of SHARP's layers to render separately.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub(super) enum Layers {
    One(usize),
    All,
}

/// Number of SHARP's layers. A scene contains the Gaussians of the visible layer, then those of the hidden one.
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

    /// Layer number `layer`, from 0: one of `LAYERS` equal consecutive parts of the scene's Gaussians. `None` if their
    /// number is not divisible by `LAYERS`.
    pub(super) fn of(scene: &Gaussians, layer: usize) -> Option<Gaussians> {
        let size = scene.len() / LAYERS;
        scene
            .len()
            .is_multiple_of(LAYERS)
            .then(|| scene.filtered(|k| k / size.max(1) == layer))
    }
}

/// The camera paths of SHARP's release.
#[derive(Debug, Clone, Copy, PartialEq, Eq, ValueEnum)]
pub(super) enum PathArg {
    /// From left to right along a line
    Swipe,
    /// Left and right, then up and down
    Shake,
    /// A circle perpendicular to the viewing direction
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

#[cfg(test)]
mod tests {
    use super::*;

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
}
