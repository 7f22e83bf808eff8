//! Conversion from the predictor's normalised space to metric camera space. Rotations and scales are recovered from the
//! stretched covariances, as in the SHARP release's PLY files.
//!
//! The harness itself places Gaussians with
//! [`target_camera_from_source_ndc`](crate::camera::target_camera_from_source_ndc), which needs no decomposition.

use glam::{DMat3, DVec3, Mat3, Quat, Vec3};

use crate::camera::{CameraError, Intrinsics};
use crate::gaussians::Gaussians;

/// Intrinsics that the SHARP release assumes for a photograph: one focal length and a principal point exactly in the
/// centre, whatever the camera's calibration.
///
/// # Errors
/// [`CameraError`] if the focal length is NaN, infinite, zero or negative, or the image is empty.
pub fn release_intrinsics(
    focal_px: f64,
    width: u32,
    height: u32,
) -> Result<Intrinsics, CameraError> {
    let center = (f64::from(width) / 2.0, f64::from(height) / 2.0);
    Intrinsics::new((focal_px, focal_px), center, (width, height))
}

/// Converts Gaussians from normalised space to the metric space of the camera with `intrinsics`.
///
/// Means and covariances are transformed in f32, as in the SHARP release. Each covariance is decomposed in f64 into a
/// rotation and standard deviations in **descending** order, so an axis may change its index. Colours and opacities are
/// unchanged. The signs of the axes are ambiguous, so compare covariances, not quaternions. Non-finite Gaussians stay
/// non-finite.
pub fn unproject(gaussians: &Gaussians, intrinsics: &Intrinsics) -> Gaussians {
    let camera_from_ndc = intrinsics.ndc_from_camera().inverse().as_mat3();
    let mut out = gaussians.clone();
    for mean in &mut out.means {
        *mean = (camera_from_ndc * Vec3::from(*mean)).to_array();
    }
    for (quaternion, scales) in out.quaternions.iter_mut().zip(&mut out.scales) {
        let local = covariance(*quaternion, *scales);
        let moved = camera_from_ndc * local * camera_from_ndc.transpose();
        (*quaternion, *scales) = rotation_and_scales(moved.as_dmat3());
    }
    out
}

/// Σ = R diag(s²) Rᵀ, with R from the normalised quaternion (w, x, y, z).
pub fn covariance(quaternion: [f32; 4], scales: [f32; 3]) -> Mat3 {
    let [w, x, y, z] = quaternion;
    let rotation = Mat3::from_quat(Quat::from_xyzw(x, y, z, w).normalize());
    let scales = Vec3::from(scales);
    rotation * Mat3::from_diagonal(scales * scales) * rotation.transpose()
}

/// A quaternion (w, x, y, z) and descending standard deviations with the given covariance.
fn rotation_and_scales(covariance: DMat3) -> ([f32; 4], [f32; 3]) {
    let (values, vectors) = eigen_descending(covariance);
    let [w, x, y, z] = quaternion(vectors);
    (
        [w, x, y, z].map(|v| v as f32),
        // Rounding can make the smallest eigenvalue of a flat Gaussian slightly negative, hence the absolute value.
        values.to_array().map(|v| v.abs().sqrt() as f32),
    )
}

/// The eigenvalues of a symmetric matrix by descending magnitude, and a proper rotation whose columns are the
/// eigenvectors in the same order, by cyclic Jacobi rotations.
fn eigen_descending(symmetric: DMat3) -> (DVec3, DMat3) {
    let mut a = symmetric.to_cols_array_2d();
    let mut v = DMat3::IDENTITY.to_cols_array_2d();
    // Converges quadratically: five sweeps reach f64 precision. A matrix with NaN also terminates.
    for _ in 0..16 {
        let off_diagonal = a[0][1].abs() + a[0][2].abs() + a[1][2].abs();
        let diagonal = a[0][0].abs() + a[1][1].abs() + a[2][2].abs();
        if off_diagonal <= 1e-17 * diagonal {
            break;
        }
        for (p, q) in [(0, 1), (0, 2), (1, 2)] {
            rotate_away(&mut a, &mut v, p, q);
        }
    }
    let mut order = [0, 1, 2];
    order.sort_by(|&i, &j| a[j][j].abs().total_cmp(&a[i][i].abs()));
    let columns = order.map(|i| DVec3::from_array(v[i]));
    let mut vectors = DMat3::from_cols(columns[0], columns[1], columns[2]);
    if vectors.determinant() < 0.0 {
        vectors.z_axis = -vectors.z_axis;
    }
    (DVec3::from_array(order.map(|i| a[i][i])), vectors)
}

/// Applies the Jacobi rotation that zeroes entry (p, q) of `a`; the columns of `v` accumulate eigenvectors.
fn rotate_away(a: &mut [[f64; 3]; 3], v: &mut [[f64; 3]; 3], p: usize, q: usize) {
    if a[p][q] == 0.0 {
        return;
    }
    let theta = (a[q][q] - a[p][p]) / (2.0 * a[p][q]);
    let t = theta.signum() / (theta.abs() + theta.hypot(1.0));
    let c = 1.0 / t.hypot(1.0);
    let s = t * c;
    for k in 0..3 {
        (a[p][k], a[q][k]) = (c * a[p][k] - s * a[q][k], s * a[p][k] + c * a[q][k]);
    }
    for k in 0..3 {
        (a[k][p], a[k][q]) = (c * a[k][p] - s * a[k][q], s * a[k][p] + c * a[k][q]);
        (v[p][k], v[q][k]) = (c * v[p][k] - s * v[q][k], s * v[p][k] + c * v[q][k]);
    }
    a[p][q] = 0.0;
    a[q][p] = 0.0;
}

/// Quaternion (w, x, y, z) of a rotation, computed from its largest component; w may be negative only if another
/// component is larger.
fn quaternion(rotation: DMat3) -> [f64; 4] {
    let m = |row: usize, column: usize| rotation.col(column)[row];
    let trace = m(0, 0) + m(1, 1) + m(2, 2);
    let choices = [trace, m(0, 0), m(1, 1), m(2, 2)];
    let largest = (1..4).fold(
        0,
        |best, k| {
            if choices[k] > choices[best] { k } else { best }
        },
    );
    let raw = if largest == 0 {
        [
            1.0 + trace,
            m(2, 1) - m(1, 2),
            m(0, 2) - m(2, 0),
            m(1, 0) - m(0, 1),
        ]
    } else {
        let i = largest - 1;
        let (j, k) = ((i + 1) % 3, (i + 2) % 3);
        let mut q = [m(k, j) - m(j, k), 0.0, 0.0, 0.0];
        q[1 + i] = 1.0 - trace + 2.0 * m(i, i);
        q[1 + j] = m(j, i) + m(i, j);
        q[1 + k] = m(k, i) + m(i, k);
        q
    };
    let norm = raw.iter().map(|v| v * v).sum::<f64>().sqrt();
    raw.map(|v| v / norm)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn assert_close(a: Mat3, b: Mat3, tolerance: f32) {
        let largest = b
            .to_cols_array()
            .into_iter()
            .fold(0.0, |m: f32, v| m.max(v.abs()));
        let off = (a - b)
            .to_cols_array()
            .into_iter()
            .fold(0.0, |m: f32, v| m.max(v.abs()));
        assert!(off <= tolerance * largest, "{a} against {b}");
    }

    #[test]
    fn covariances_survive_the_decomposition() {
        let quaternions = [
            [1.0, 0.0, 0.0, 0.0],
            [0.3, -0.5, 0.7, 2.0],
            [-0.1, 3.0, 0.2, 0.1],
            [0.0, 0.1, 3.0, -0.2],
        ];
        let scales = [
            [1.0, 1.0, 1.0],
            [2.0, 0.5, 1e-3],
            [0.0, 3.0, 3.0],
            [1e-4, 1e-5, 1e-6],
        ];
        for q in quaternions {
            for s in scales {
                let sigma = covariance(q, s);
                let (q2, s2) = rotation_and_scales(sigma.as_dmat3());
                assert_close(covariance(q2, s2), sigma, 2e-6);
                assert!(s2[0] >= s2[1] && s2[1] >= s2[2]);
                let norm: f32 = q2.iter().map(|v| v * v).sum();
                assert!((norm - 1.0).abs() < 1e-6);
            }
        }
    }

    #[test]
    fn unprojection_stretches_means_and_covariances_alike() {
        let intrinsics = release_intrinsics(500.0, 640, 480).unwrap();
        let one = Gaussians::new(
            vec![[0.5, -1.0, 2.0]],
            vec![[0.9, 0.1, 0.2, -0.3]],
            vec![[0.1, 0.02, 0.3]],
            vec![0.7],
            vec![[0.1, 0.2, 0.3]],
        )
        .unwrap();
        let out = unproject(&one, &intrinsics);
        let stretch = Vec3::new(640.0 / 1000.0, 480.0 / 1000.0, 1.0);
        let mean = Vec3::from(one.means[0]) * stretch;
        assert!((Vec3::from(out.means[0]) - mean).length() < 1e-6);
        let t = Mat3::from_diagonal(stretch);
        let expected = t * covariance(one.quaternions[0], one.scales[0]) * t;
        assert_close(
            covariance(out.quaternions[0], out.scales[0]),
            expected,
            2e-6,
        );
        assert_eq!((out.opacities, out.colors), (one.opacities, one.colors));
    }

    #[test]
    fn values_that_are_not_finite_neither_hang_nor_turn_finite() {
        let (q, s) = rotation_and_scales(DMat3::from_diagonal(DVec3::splat(f64::NAN)));
        assert!(s.iter().all(|v| v.is_nan()), "{q:?} {s:?}");
    }

    #[test]
    fn impossible_cameras_are_refused() {
        assert!(release_intrinsics(0.0, 640, 480).is_err());
        assert!(release_intrinsics(f64::NAN, 640, 480).is_err());
        assert!(release_intrinsics(500.0, 0, 480).is_err());
    }
}
