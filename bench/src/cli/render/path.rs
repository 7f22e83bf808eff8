//! Camera paths.

use anyhow::Context;
use clap::Args;
use glam::{DAffine3, DVec3};
use sharp::camera::{Intrinsics, RigidTransform};
use sharp::gaussians::Gaussians;
use sharp::trajectory::{DepthRange, Trajectory, shifted};

use super::args::{self, PathArg};

/// Maximum number of frames in a path.
const MAX_FRAMES: i64 = 100_000;

/// Options that move the camera.
#[derive(Debug, Args)]
#[command(next_help_heading = "Paths")]
pub(super) struct PathArgs {
    /// Move the camera along one of the release's paths, looking at a point on the photograph's
    /// axis; the scene's near depth determines the size of the path
    #[arg(long, value_enum, value_name = "PATH", conflicts_with = "offset_m")]
    trajectory: Option<PathArg>,
    /// Number of frames of one round along the path
    #[arg(long, value_name = "N", default_value_t = 60, requires = "trajectory",
          value_parser = clap::value_parser!(u32).range(1..=MAX_FRAMES))]
    frames: u32,
    /// Move the camera by X,Y,Z metres to the right, down and forward, without turning it; repeatable,
    /// one frame each
    #[arg(long, value_name = "X,Y,Z", allow_hyphen_values = true, value_parser = args::offset)]
    offset_m: Vec<DVec3>,
}

impl PathArgs {
    /// For each frame, the transform from the photograph's camera to the frame's camera; `None` if no path is
    /// requested. `camera_from_scene` maps the scene to the photograph's camera.
    pub(super) fn poses(
        &self,
        scene: &Gaussians,
        photo: &Intrinsics,
        camera_from_scene: &DAffine3,
    ) -> anyhow::Result<Option<Vec<RigidTransform>>> {
        if let Some(path) = self.trajectory {
            let trajectory = Trajectory {
                kind: path.into(),
                steps: self.frames as usize,
            };
            let depth = DepthRange::seen_from(scene, camera_from_scene).context(
                "no Gaussian is in front of the camera, so the size of the path cannot be \
                          determined",
            )?;
            return Ok(Some(trajectory.poses(photo, &depth)));
        }
        let eyes = self.offset_m.iter().copied();
        Ok((!self.offset_m.is_empty()).then(|| eyes.map(shifted).collect()))
    }
}
