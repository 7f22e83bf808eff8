//! Camera of one picture and the rule by which it is rendered.

use super::error::{MAX_SIDE, RenderError};
use super::rule::{Compensation, JacobianClamp, NearPlane, PrincipalPoint, Rule, Support};
use crate::camera::Intrinsics;
use glam::DAffine3;

/// Everything that defines a picture apart from the scene.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct RenderView {
    /// Maps the space of the Gaussians to camera space (OpenCV axes, metres). Any affine map: a rigid
    /// `camera_from_world`, or the paper's `E_t E_s⁻¹ K_s⁻¹` from the normalised space of a source photograph
    /// ([`crate::camera::target_camera_from_source_ndc`]).
    pub camera_from_scene: DAffine3,
    /// Intrinsics of the picture to render; the centre of the first pixel is at (0.5, 0.5).
    pub intrinsics: Intrinsics,
    pub rule: Rule,
}

/// Fields of `View` in `shaders/shared/view.wgsl` that depend on a rule.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ShaderConstants {
    /// Principal point in pixels.
    pub center: [f64; 2],
    /// Bounds on x/z and y/z, low and high, at which the Jacobian is evaluated.
    pub bounds: [[f64; 2]; 2],
    pub near: f32,
    pub compensation: u32,
    pub tiled: bool,
}

impl RenderView {
    /// Low-pass variance in px² of `sharp render` and `sharp predict`: 0, i.e. no filter. The default.
    pub const EPS2D_RELEASE: f32 = 0.0;
    /// `low_pass_filter_eps` in the SHARP release's predictor configuration, which the release's code does not use.
    pub const EPS2D_CONFIG: f32 = 0.01;
    /// Low-pass of gsplat by default and of every web viewer; gives a visibly different image.
    pub const EPS2D_GSPLAT: f32 = 0.3;
    /// Maximum width and height in pixels.
    pub const MAX_SIDE: u32 = MAX_SIDE;

    /// Creates a view with SHARP's rule.
    pub fn new(camera_from_scene: DAffine3, intrinsics: Intrinsics) -> Self {
        Self {
            camera_from_scene,
            intrinsics,
            rule: Rule::SHARP,
        }
    }

    /// Sets the low-pass, in px².
    #[must_use]
    pub fn with_low_pass(mut self, low_pass: f32) -> Self {
        self.rule.low_pass = low_pass;
        self
    }

    /// Values passed to the shaders in addition to the map, focal lengths and size.
    pub fn shader_constants(&self) -> ShaderConstants {
        let view = ViewConstants::new(self);
        ShaderConstants {
            center: view.center,
            bounds: view.bounds,
            near: view.near,
            compensation: view.compensation.code(),
            tiled: view.support == Support::Tiles,
        }
    }

    /// Checks the public fields; renderers rely on the checked values.
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
            return bad(format!(
                "intrinsics must be finite, and focal lengths positive, but fx is {fx}, fy {fy}, cx {cx}, cy {cy}"
            ));
        }
        if let Err(refused) = self.rule.check() {
            return bad(refused.to_string());
        }
        Ok(())
    }
}

/// Distance beyond the image's edge up to which the Jacobian is evaluated, as a multiple of half
/// the image's width or height.
const JACOBIAN_MARGIN: f64 = 0.3;

/// The view in the form used by the inner loops; f64 here, f32 on the GPU.
pub(super) struct ViewConstants {
    pub(super) linear: [[f64; 3]; 3],
    pub(super) offset: [f64; 3],
    pub(super) focal: [f64; 2],
    pub(super) center: [f64; 2],
    pub(super) size: [f64; 2],
    /// Bounds on x/z and y/z at which the Jacobian is evaluated, low and high.
    pub(super) bounds: [[f64; 2]; 2],
    pub(super) eps2d: f64,
    pub(super) compensation: Compensation,
    /// Minimum depth that is drawn.
    pub(super) near: f32,
    pub(super) far: f32,
    pub(super) support: Support,
}

impl ViewConstants {
    pub(super) fn new(view: &RenderView) -> Self {
        let k = view.intrinsics;
        let m = view.camera_from_scene.matrix3.transpose();
        let size = [f64::from(k.width), f64::from(k.height)];
        let rule = &view.rule;
        let center = match rule.principal_point {
            PrincipalPoint::Used => [k.cx, k.cy],
            PrincipalPoint::Ignored => size.map(|side| 0.5 * side),
        };
        let bounds = |focal: f64, center: f64, size: f64| {
            let margin = JACOBIAN_MARGIN * 0.5 * size / focal;
            let half = 0.5 * size / focal + margin;
            match rule.jacobian_clamp {
                JacobianClamp::Image => {
                    [-(center / focal + margin), (size - center) / focal + margin]
                }
                JacobianClamp::Symmetric => [-half, half],
                JacobianClamp::None => [f64::from(f32::MIN), f64::from(f32::MAX)],
            }
        };
        Self {
            linear: [m.x_axis, m.y_axis, m.z_axis].map(|row| row.to_array()),
            offset: view.camera_from_scene.translation.to_array(),
            focal: [k.fx, k.fy],
            center,
            size,
            bounds: [
                bounds(k.fx, center[0], size[0]),
                bounds(k.fy, center[1], size[1]),
            ],
            eps2d: f64::from(rule.low_pass),
            compensation: rule.compensation,
            near: match rule.near_plane {
                NearPlane::Included => rule.near,
                NearPlane::Excluded => rule.near.next_up(),
            },
            far: rule.far,
            support: rule.support,
        }
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
        assert!(good.with_low_pass(-1.0).check().is_err());
    }
}
