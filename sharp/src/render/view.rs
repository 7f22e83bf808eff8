//! The camera of one picture and the knobs of the definition.

use super::RenderError;
use crate::camera::Intrinsics;
use glam::DAffine3;

/// Everything about a picture that is not the scene.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RenderView {
    /// From the space of the Gaussians to camera space (OpenCV axes, metres). Any affine map: a
    /// rigid `camera_from_world`, or the paper's `E_t E_s⁻¹ K_s⁻¹` out of the normalised space of
    /// a source photograph ([`crate::camera::target_camera_from_source_ndc`]).
    pub camera_from_scene: DAffine3,
    /// Of the picture to render; pixel centres lie at + 0.5.
    pub intrinsics: Intrinsics,
    /// Added to both diagonal entries of the 2D covariance, px²: one of the presets below or any
    /// value ≥ 0. There is no compensation of the opacity (gsplat's `classic` mode).
    pub eps2d: f32,
    /// Gaussians whose centre has z below this are dropped; metres, > 0. Equality survives.
    pub near: f32,
    /// Gaussians whose centre has z beyond this are dropped; metres. Equality survives.
    pub far: f32,
}

impl RenderView {
    /// `eps2d` of `sharp render` and `sharp predict`: no low-pass filter. The default.
    pub const EPS2D_RELEASE: f32 = 0.0;
    /// `low_pass_filter_eps` of the release's predictor configuration, which nothing passes on.
    pub const EPS2D_CONFIG: f32 = 0.01;
    /// The default of gsplat and of every web viewer; a visibly different image.
    pub const EPS2D_GSPLAT: f32 = 0.3;
    /// The release's near plane, metres.
    pub const NEAR: f32 = 0.01;
    /// The release's far plane, metres.
    pub const FAR: f32 = 1e10;
    /// Largest width and height, pixels.
    pub const MAX_SIDE: u32 = 65_535;

    /// A view with the release's `eps2d`, near and far.
    pub fn new(camera_from_scene: DAffine3, intrinsics: Intrinsics) -> Self {
        Self {
            camera_from_scene,
            intrinsics,
            eps2d: Self::EPS2D_RELEASE,
            near: Self::NEAR,
            far: Self::FAR,
        }
    }

    /// The fields are public; a renderer trusts them only after this.
    pub(super) fn check(&self) -> Result<(), RenderError> {
        let Intrinsics {
            fx,
            fy,
            cx,
            cy,
            width,
            height,
        } = self.intrinsics;
        if width == 0 || height == 0 || width > Self::MAX_SIDE || height > Self::MAX_SIDE {
            return Err(RenderError::Size { width, height });
        }
        let bad = |what: String| Err(RenderError::View(what));
        if !self.camera_from_scene.is_finite() {
            return bad("camera_from_scene is not finite".to_owned());
        }
        if ![fx, fy, cx, cy].iter().all(|v| v.is_finite()) || fx <= 0.0 || fy <= 0.0 {
            return bad(format!("intrinsics fx {fx}, fy {fy}, cx {cx}, cy {cy}"));
        }
        if !(self.eps2d >= 0.0 && self.eps2d.is_finite()) {
            return bad(format!("eps2d {}", self.eps2d));
        }
        if !(self.near > 0.0 && self.near <= self.far) {
            return bad(format!("near {}, far {}", self.near, self.far));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn impossible_views_are_refused() {
        let k = Intrinsics::new((100.0, 100.0), (4.0, 4.0), (8, 8)).unwrap();
        let good = RenderView::new(DAffine3::IDENTITY, k);
        assert_eq!(good.check(), Ok(()));
        let mut wide = good;
        wide.intrinsics.width = 70_000;
        assert!(matches!(wide.check(), Err(RenderError::Size { .. })));
        let mut empty = good;
        empty.intrinsics.height = 0;
        assert!(matches!(empty.check(), Err(RenderError::Size { .. })));
        let mut moved = good;
        moved.camera_from_scene.translation.x = f64::NAN;
        assert!(matches!(moved.check(), Err(RenderError::View(_))));
        for eps2d in [-1.0, f32::NAN] {
            assert!(RenderView { eps2d, ..good }.check().is_err());
        }
        assert!(RenderView { near: 0.0, ..good }.check().is_err());
        assert!(
            RenderView {
                near: 2.0,
                far: 1.0,
                ..good
            }
            .check()
            .is_err()
        );
    }
}
