//! Output of a renderer.

use super::RenderView;
use crate::ply::ColorSpace;

/// One rendered view, before background, encoding and quantisation.
///
/// Arrays are row-major, `height × width`.
#[derive(Debug, Clone, PartialEq)]
pub struct RenderOutput {
    pub width: u32,
    pub height: u32,
    /// Colour space of `rgb`, set by the rule.
    pub blending: ColorSpace,
    /// RGB, premultiplied by alpha: `Σ w c`.
    pub rgb: Vec<[f32; 3]>,
    /// Coverage `1 − T`, in 0..0.9999.
    pub alpha: Vec<f32>,
    /// Accumulated z-depth `Σ w z` in metres; see [`Self::expected_depth`].
    pub depth_acc: Vec<f32>,
    /// Number of Gaussians that passed every test of the projection.
    pub drawn: u64,
    /// Number of Gaussians that were not drawn, by reason.
    pub dropped: Dropped,
}

impl RenderOutput {
    /// Output of a view without Gaussians.
    pub(super) fn empty(view: &RenderView) -> Self {
        let (width, height) = (view.intrinsics.width, view.intrinsics.height);
        let pixels = width as usize * height as usize;
        Self {
            width,
            height,
            blending: view.rule.blending,
            rgb: vec![[0.0; 3]; pixels],
            alpha: vec![0.0; pixels],
            depth_acc: vec![0.0; pixels],
            drawn: 0,
            dropped: Dropped::default(),
        }
    }
}

/// Gaussians that were not drawn, each counted under the first of these reasons that applies.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Default)]
pub struct Dropped {
    /// An attribute is NaN or infinite.
    pub not_finite: u64,
    /// The quaternion is zero and so defines no rotation.
    pub zero_quaternion: u64,
    /// The centre is nearer than the near plane, or behind the camera.
    pub near: u64,
    /// The centre is beyond the far plane.
    pub far: u64,
    /// The 2D covariance has no positive determinant (a flat Gaussian seen edge-on, a zero scale), or exceeds the range
    /// of floating point.
    pub degenerate: u64,
    /// The opacity is below 1/255.
    pub transparent: u64,
    /// No pixel at which alpha could reach 1/255 lies inside the image.
    pub outside: u64,
}

impl Dropped {
    pub fn total(&self) -> u64 {
        self.not_finite
            + self.zero_quaternion
            + self.near
            + self.far
            + self.degenerate
            + self.transparent
            + self.outside
    }

    /// Number of Gaussians dropped because of invalid attributes rather than the camera's position.
    pub fn invalid(&self) -> u64 {
        self.not_finite + self.zero_quaternion
    }
}

impl std::ops::AddAssign for Dropped {
    fn add_assign(&mut self, other: Self) {
        self.not_finite += other.not_finite;
        self.zero_quaternion += other.zero_quaternion;
        self.near += other.near;
        self.far += other.far;
        self.degenerate += other.degenerate;
        self.transparent += other.transparent;
        self.outside += other.outside;
    }
}
