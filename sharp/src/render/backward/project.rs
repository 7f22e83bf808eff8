//! Backward of pass `project`, and the 2D covariance with its gradient; f64 throughout.

use super::super::view::ViewConstants;
use std::f64::consts::LOG2_E;

type Vec3 = [f64; 3];

/// Projection of one Gaussian to the screen, with all intermediate values that its derivatives need.
///
/// `u` and `v` are the rows of `J L R diag(s)`, so that the 2D covariance is
/// `[u·u + eps, u·v; u·v, v·v + eps]`.
#[derive(Debug, Clone, Copy)]
pub(super) struct Projection {
    /// Columns of the rotation matrix of the unit quaternion.
    rotation: [Vec3; 3],
    unit: [f64; 4],
    norm: f64,
    scales: Vec3,
    slope: [f64; 2],
    inverse_z: f64,
    /// Per axis, true if the Jacobian is evaluated at the centre's own slope, i.e. was not clamped.
    free: [bool; 2],
    /// Rows of `J L`.
    rows: [Vec3; 2],
    u: Vec3,
    v: Vec3,
    /// u × v, whose squared length is the determinant, without the cancellation of uu·vv − uv².
    normal: Vec3,
}

/// Gradients with respect to the outputs of the projection.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct ScreenGradient {
    /// Gradient with respect to the centre in pixels.
    pub(super) center: [f64; 2],
    /// Gradient with respect to p, q, r of the conic's Cholesky factor.
    pub(super) factor: Vec3,
    /// Gradient with respect to the entries uu, uv, vv of the 2D covariance without eps.
    pub(super) covariance: Vec3,
    /// Gradient with respect to the depth in the view.
    pub(super) z: f64,
}

/// Gradients with respect to a Gaussian's geometry.
#[derive(Debug, Clone, Copy, Default)]
pub(super) struct ShapeGradient {
    pub(super) mean: Vec3,
    pub(super) quaternion: [f64; 4],
    pub(super) scales: Vec3,
}

impl Projection {
    pub(super) fn new(k: &ViewConstants, mean: Vec3, quaternion: [f64; 4], scales: Vec3) -> Self {
        let [x, y, z] = [0, 1, 2].map(|row: usize| dot(k.linear[row], mean) + k.offset[row]);
        let inverse_z = 1.0 / z;
        let slope = [x * inverse_z, y * inverse_z];
        let at =
            [0, 1].map(|axis: usize| slope[axis].max(k.bounds[axis][0]).min(k.bounds[axis][1]));
        let rows = [0, 1].map(|axis: usize| {
            let j = k.focal[axis] * inverse_z;
            [0, 1, 2].map(|c| j * (k.linear[axis][c] - at[axis] * k.linear[2][c]))
        });
        let norm = quaternion.iter().map(|v| v * v).sum::<f64>().sqrt();
        let unit = quaternion.map(|v| v / norm);
        let rotation = columns_of_rotation(unit);
        let row = |axis: usize| [0, 1, 2].map(|c: usize| dot(rows[axis], rotation[c]) * scales[c]);
        let (u, v) = (row(0), row(1));
        Self {
            rotation,
            unit,
            norm,
            scales,
            slope,
            inverse_z,
            free: [0, 1].map(|axis: usize| at[axis] == slope[axis]),
            rows,
            u,
            v,
            normal: cross(u, v),
        }
    }

    /// Entries uu, uv, vv of the 2D covariance, in px², without eps.
    pub(super) fn covariance(&self) -> Vec3 {
        [
            dot(self.u, self.u),
            dot(self.u, self.v),
            dot(self.v, self.v),
        ]
    }

    /// Determinant of the 2D covariance with `eps` on its diagonal.
    pub(super) fn determinant(&self, eps: f64) -> f64 {
        let [uu, _, vv] = self.covariance();
        dot(self.normal, self.normal) + eps * (uu + vv) + eps * eps
    }

    /// Pulls the gradient of the conic's Cholesky factor back to uu, uv, vv and to the squared length of the normal.
    fn pull_factor(&self, eps: f64, of: Vec3) -> (Vec3, f64) {
        let [_, uv, vv] = self.covariance();
        let kappa = (0.5 * LOG2_E).sqrt();
        let (d, root) = ((vv + eps).sqrt(), self.determinant(eps).sqrt());
        let (p, q, r) = (kappa * d / root, -kappa * uv / (d * root), kappa / d);
        let of_root = -(p * of[0] + q * of[1]) / root;
        let of_d = kappa / root * of[0] - q / d * of[1] - r / d * of[2];
        let of_determinant = of_root / (2.0 * root);
        let of_covariance = [
            eps * of_determinant,
            -kappa / (d * root) * of[1],
            of_d / (2.0 * d) + eps * of_determinant,
        ];
        (of_covariance, of_determinant)
    }

    /// Applies the chain rule from the screen to mean, quaternion and scales.
    pub(super) fn pull(&self, k: &ViewConstants, of: &ScreenGradient) -> ShapeGradient {
        let (mut of_covariance, mut of_square) = ([0.0; 3], 0.0);
        // A Gaussian whose covariance has no area is not drawn, so its factor has no gradient.
        if of.factor != [0.0; 3] {
            (of_covariance, of_square) = self.pull_factor(k.eps2d, of.factor);
        }
        let [uu, uv, vv] = [0, 1, 2].map(|c| of_covariance[c] + of.covariance[c]);
        let of_normal = self.normal.map(|m| 2.0 * m * of_square);
        let (from_normal_u, from_normal_v) = (cross(self.v, of_normal), cross(of_normal, self.u));
        let of_u = [0, 1, 2].map(|c| 2.0 * uu * self.u[c] + uv * self.v[c] + from_normal_u[c]);
        let of_v = [0, 1, 2].map(|c| 2.0 * vv * self.v[c] + uv * self.u[c] + from_normal_v[c]);

        let mut out = ShapeGradient::default();
        let mut of_rows = [[0.0; 3]; 2];
        let mut of_rotation = [[0.0; 3]; 3];
        for c in 0..3 {
            let s = self.scales[c];
            for r in 0..3 {
                let of_column = of_u[c] * self.rows[0][r] + of_v[c] * self.rows[1][r];
                out.scales[c] += of_column * self.rotation[c][r];
                of_rotation[c][r] = of_column * s;
                of_rows[0][r] += of_u[c] * self.rotation[c][r] * s;
                of_rows[1][r] += of_v[c] * self.rotation[c][r] * s;
            }
        }
        out.quaternion = self.pull_rotation(&of_rotation);

        let mut of_camera = [0.0, 0.0, of.z];
        for axis in 0..2 {
            // row = focal / z · (L_axis − at · L_z)
            let mut of_slope = k.focal[axis] * of.center[axis];
            if self.free[axis] {
                of_slope -= k.focal[axis] * self.inverse_z * dot(of_rows[axis], k.linear[2]);
            }
            of_camera[2] -= self.inverse_z * dot(of_rows[axis], self.rows[axis]);
            of_camera[axis] += of_slope * self.inverse_z;
            of_camera[2] -= of_slope * self.slope[axis] * self.inverse_z;
        }
        out.mean =
            [0, 1, 2].map(|c: usize| (0..3).map(|row| k.linear[row][c] * of_camera[row]).sum());
        out
    }

    /// Pulls the gradient of the rotation's columns back to the quaternion, through its normalisation.
    fn pull_rotation(&self, of: &[Vec3; 3]) -> [f64; 4] {
        let [w, x, y, z] = self.unit;
        let [[m00, m10, m20], [m01, m11, m21], [m02, m12, m22]] = *of;
        let of_unit = [
            2.0 * (z * (m10 - m01) + y * (m02 - m20) + x * (m21 - m12)),
            2.0 * (y * (m10 + m01) + z * (m20 + m02) + w * (m21 - m12) - 2.0 * x * (m11 + m22)),
            2.0 * (x * (m10 + m01) + z * (m21 + m12) + w * (m02 - m20) - 2.0 * y * (m00 + m22)),
            2.0 * (x * (m20 + m02) + y * (m21 + m12) + w * (m10 - m01) - 2.0 * z * (m00 + m11)),
        ];
        let along: f64 = (0..4).map(|c| of_unit[c] * self.unit[c]).sum();
        [0, 1, 2, 3].map(|c: usize| (of_unit[c] - along * self.unit[c]) / self.norm)
    }
}

/// Columns of the rotation matrix of a unit quaternion (w, x, y, z).
fn columns_of_rotation([w, x, y, z]: [f64; 4]) -> [Vec3; 3] {
    [
        [
            1.0 - 2.0 * (y * y + z * z),
            2.0 * (x * y + w * z),
            2.0 * (x * z - w * y),
        ],
        [
            2.0 * (x * y - w * z),
            1.0 - 2.0 * (x * x + z * z),
            2.0 * (y * z + w * x),
        ],
        [
            2.0 * (x * z + w * y),
            2.0 * (y * z - w * x),
            1.0 - 2.0 * (x * x + y * y),
        ],
    ]
}

fn dot(a: Vec3, b: Vec3) -> f64 {
    a[0] * b[0] + a[1] * b[1] + a[2] * b[2]
}

fn cross(a: Vec3, b: Vec3) -> Vec3 {
    [
        a[1] * b[2] - a[2] * b[1],
        a[2] * b[0] - a[0] * b[2],
        a[0] * b[1] - a[1] * b[0],
    ]
}
