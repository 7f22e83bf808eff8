//! Where the camera goes.

use anyhow::{Context, ensure};
use clap::Args;
use glam::{DAffine3, DVec3};
use sharp::camera::{Intrinsics, RigidTransform};
use sharp::gaussians::Gaussians;
use sharp::render::trajectory::{DepthRange, Trajectory, TrajectoryKind, looking, shifted};

use super::args::{self, LookArg, PathArg};

/// Frames a path may have.
const MAX_FRAMES: i64 = 100_000;

/// Options that move the camera.
#[derive(Debug, Args)]
#[command(next_help_heading = "Paths")]
pub(super) struct PathArgs {
    /// Move the camera along one of the release's paths; as large as the scene's near depth allows
    #[arg(long, value_enum, value_name = "PATH", conflicts_with = "offset_m")]
    trajectory: Option<PathArg>,
    /// Frames of one round
    #[arg(long, value_name = "N", default_value_t = 60, requires = "trajectory",
          value_parser = clap::value_parser!(u32).range(1..=MAX_FRAMES))]
    frames: u32,
    /// Rounds
    #[arg(long, value_name = "N", default_value_t = 1, requires = "trajectory",
          value_parser = clap::value_parser!(u32).range(1..=MAX_FRAMES))]
    repeats: u32,
    /// Largest shift sideways, as a share of near depth times the picture's diagonal over the focal length
    #[arg(
        long,
        value_name = "X",
        default_value_t = 0.08,
        requires = "trajectory"
    )]
    max_disparity: f64,
    /// Largest shift forward, as a share of the near depth
    #[arg(
        long,
        value_name = "X",
        default_value_t = 0.15,
        requires = "trajectory"
    )]
    max_zoom: f64,
    /// Move the camera by this many metres along its own axes: right, down, forward; repeatable, a frame each
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = args::offset)]
    offset_m: Vec<DVec3>,
    /// Where the moved camera looks [default: point with --trajectory, ahead with --offset-m]
    #[arg(long, value_enum)]
    look_at: Option<LookArg>,
}

/// Poses of a path, from the photograph's camera to each frame's.
pub(super) struct Poses {
    /// One a frame; `None` without a path.
    pub(super) moved: Option<Vec<RigidTransform>>,
    pub(super) text: String,
}

impl PathArgs {
    /// The poses of a path through a scene that the photograph's camera sees by `camera_from_scene`.
    pub(super) fn poses(
        &self,
        scene: &Gaussians,
        photo: &Intrinsics,
        camera_from_scene: &DAffine3,
    ) -> anyhow::Result<Poses> {
        let depth = || {
            DepthRange::seen_from(scene, camera_from_scene)
                .context("no Gaussian lies in front of the camera, so that its path has no size")
        };
        if let Some(path) = self.trajectory {
            for (name, value) in [
                ("--max-disparity", self.max_disparity),
                ("--max-zoom", self.max_zoom),
            ] {
                ensure!(
                    value.is_finite() && value >= 0.0,
                    "{name} {value}: a number ≥ 0"
                );
            }
            ensure!(
                i64::from(self.frames) * i64::from(self.repeats) <= MAX_FRAMES,
                "{} rounds of {} frames: at most {MAX_FRAMES} frames",
                self.repeats,
                self.frames
            );
            let kind = TrajectoryKind::from(path);
            let look = self.look_at.unwrap_or(LookArg::Point);
            let trajectory = Trajectory {
                kind,
                look_at: look.into(),
                steps: self.frames as usize,
                repeats: self.repeats as usize,
                max_disparity: self.max_disparity,
                max_zoom: self.max_zoom,
            };
            return Ok(Poses {
                moved: Some(trajectory.poses(photo, &depth()?)),
                text: format!("{} {look:?}", kind.name()).to_lowercase(),
            });
        }
        if self.offset_m.is_empty() {
            ensure!(
                self.look_at.is_none(),
                "--look-at is for a moved camera: add --trajectory or --offset-m"
            );
            return Ok(Poses {
                moved: None,
                text: "none".to_owned(),
            });
        }
        let eyes = self.offset_m.iter().copied();
        let (moved, look) = match self.look_at.unwrap_or(LookArg::Ahead) {
            LookArg::Ahead => (eyes.map(shifted).collect(), "ahead"),
            LookArg::Point => {
                let focus = DVec3::new(0.0, 0.0, depth()?.focus);
                (eyes.map(|eye| looking(eye, focus)).collect(), "point")
            }
        };
        Ok(Poses {
            moved: Some(moved),
            text: format!("offsets {look}"),
        })
    }
}
