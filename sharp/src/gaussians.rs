//! The container of 3D Gaussians shared by predictor, files and renderer.

/// The arrays of a Gaussian container differ in length.
#[derive(Debug, Clone, PartialEq, Eq, thiserror::Error)]
#[error(
    "Gaussian attributes differ in length: {means} means, {quaternions} quaternions, \
     {scales} scales, {opacities} opacities, {colors} colours, harmonics of {harmonics}"
)]
pub struct LengthMismatch {
    pub means: usize,
    pub quaternions: usize,
    pub scales: usize,
    pub opacities: usize,
    pub colors: usize,
    /// Number of Gaussians that have coefficients of view-dependent colour; if colours do not
    /// depend on the view, the number of means.
    pub harmonics: usize,
}

/// View-dependent colour: the spherical harmonics without the constant term, which is stored in [`Gaussians::colors`].
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Harmonics {
    /// 0 to [`Self::MAX_DEGREE`]; 0 if colours do not depend on the view.
    pub degree: usize,
    /// `[N, (degree + 1)² − 1, 3]`: RGB coefficients of the harmonics with index `k = l² + l + m`,
    /// `k` ≥ 1, in the coordinate system of the means.
    pub coefficients: Vec<[f32; 3]>,
}

impl Harmonics {
    pub const MAX_DEGREE: usize = 4;

    /// Number of coefficients per Gaussian at a degree, without the constant one.
    pub fn coefficients_of(degree: usize) -> usize {
        (degree + 1).pow(2) - 1
    }

    /// Number of coefficients per Gaussian, without the constant one.
    pub fn per_gaussian(&self) -> usize {
        Self::coefficients_of(self.degree)
    }

    /// Coefficients of Gaussian `k`.
    ///
    /// # Panics
    /// If `k` is out of bounds.
    pub fn of(&self, k: usize) -> &[[f32; 3]] {
        let each = self.per_gaussian();
        &self.coefficients[k * each..(k + 1) * each]
    }
}

/// N Gaussians as one array per attribute; index k is the same Gaussian in every array.
///
/// The space of means and scales depends on the producer: SHARP's normalised space after the
/// composer, metric camera space after unprojection.
#[derive(Debug, Clone, PartialEq, Default)]
pub struct Gaussians {
    /// Centres `[N, 3]`.
    pub means: Vec<[f32; 3]>,
    /// Rotations `[N, 4]` as (w, x, y, z), not necessarily of unit length.
    pub quaternions: Vec<[f32; 4]>,
    /// Standard deviations along the rotated axes `[N, 3]`, ≥ 0, in the unit of the means.
    pub scales: Vec<[f32; 3]>,
    /// Opacities `[N]` in 0..1.
    pub opacities: Vec<f32>,
    /// RGB `[N, 3]`, nominally 0..1, in the blending colour space (linear light for SHARP). If colours depend on the
    /// view, this is the constant term.
    pub colors: Vec<[f32; 3]>,
    pub harmonics: Harmonics,
}

impl Gaussians {
    /// Creates a container after checking that all attributes have the same length.
    ///
    /// # Errors
    /// [`LengthMismatch`] with every length.
    pub fn new(
        means: Vec<[f32; 3]>,
        quaternions: Vec<[f32; 4]>,
        scales: Vec<[f32; 3]>,
        opacities: Vec<f32>,
        colors: Vec<[f32; 3]>,
    ) -> Result<Self, LengthMismatch> {
        let new = Self {
            means,
            quaternions,
            scales,
            opacities,
            colors,
            harmonics: Harmonics::default(),
        };
        new.check_lengths()?;
        Ok(new)
    }

    /// Checks that all attributes have the same length, for containers built field by field.
    ///
    /// # Errors
    /// [`LengthMismatch`] with every length.
    pub fn check_lengths(&self) -> Result<(), LengthMismatch> {
        let lengths = LengthMismatch {
            means: self.means.len(),
            quaternions: self.quaternions.len(),
            scales: self.scales.len(),
            opacities: self.opacities.len(),
            colors: self.colors.len(),
            harmonics: match self.harmonics.per_gaussian() {
                0 => self.means.len(),
                each => self.harmonics.coefficients.len() / each,
            },
        };
        let LengthMismatch {
            means,
            quaternions,
            scales,
            opacities,
            colors,
            harmonics,
        } = lengths;
        if [quaternions, scales, opacities, colors, harmonics] == [means; 5] {
            Ok(())
        } else {
            Err(lengths)
        }
    }

    pub fn len(&self) -> usize {
        self.means.len()
    }

    pub fn is_empty(&self) -> bool {
        self.means.is_empty()
    }

    /// True if every attribute of Gaussian `k` is finite. The renderer drops Gaussians that are
    /// not.
    ///
    /// # Panics
    /// If `k` is not below [`Self::len`].
    pub fn is_finite(&self, k: usize) -> bool {
        self.means[k].iter().all(|v| v.is_finite())
            && self.quaternions[k].iter().all(|v| v.is_finite())
            && self.scales[k].iter().all(|v| v.is_finite())
            && self.opacities[k].is_finite()
            && self.colors[k].iter().all(|v| v.is_finite())
            && self.harmonics.of(k).iter().flatten().all(|v| v.is_finite())
    }

    /// Negates the axes for which `signs` is −1. The scene is mirrored if the product of the signs is −1.
    pub fn flipped(mut self, signs: [f32; 3]) -> Self {
        let [x, y, z] = signs;
        for mean in &mut self.means {
            *mean = [0, 1, 2].map(|axis| mean[axis] * signs[axis]);
        }
        for quaternion in &mut self.quaternions {
            let [qw, qx, qy, qz] = *quaternion;
            *quaternion = [qw, qx * y * z, qy * x * z, qz * x * y];
        }
        // Factor ±1 of each harmonic after the flip: one row per degree, starting with degree 1.
        let parity = [
            [y, z, x].as_slice(),
            &[x * y, y * z, 1.0, x * z, 1.0],
            &[y, x * y * z, y, z, x, z, x],
            &[x * y, y * z, x * y, y * z, 1.0, x * z, 1.0, x * z, 1.0],
        ]
        .concat();
        let each = self.harmonics.per_gaussian().max(1);
        for row in self.harmonics.coefficients.chunks_mut(each) {
            for (coefficient, sign) in row.iter_mut().zip(&parity) {
                *coefficient = coefficient.map(|v| v * sign);
            }
        }
        self
    }

    /// Keeps the Gaussians for which `keep(k)` holds, in order.
    pub fn filtered(&self, mut keep: impl FnMut(usize) -> bool) -> Self {
        let kept: Vec<usize> = (0..self.len()).filter(|&k| keep(k)).collect();
        self.subset(&kept)
    }

    /// The Gaussians at the indices `places`, in that order.
    pub fn subset(&self, places: &[usize]) -> Self {
        Self {
            means: places.iter().map(|&k| self.means[k]).collect(),
            quaternions: places.iter().map(|&k| self.quaternions[k]).collect(),
            scales: places.iter().map(|&k| self.scales[k]).collect(),
            opacities: places.iter().map(|&k| self.opacities[k]).collect(),
            colors: places.iter().map(|&k| self.colors[k]).collect(),
            harmonics: Harmonics {
                degree: self.harmonics.degree,
                coefficients: places
                    .iter()
                    .flat_map(|&k| self.harmonics.of(k).iter().copied())
                    .collect(),
            },
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn two() -> Gaussians {
        Gaussians::new(
            vec![[0.0; 3], [1.0, 2.0, 3.0]],
            vec![[1.0, 0.0, 0.0, 0.0]; 2],
            vec![[0.1; 3]; 2],
            vec![0.5, f32::NAN],
            vec![[0.2; 3]; 2],
        )
        .unwrap()
    }

    #[test]
    fn unequal_lengths_are_an_error() {
        let found = Gaussians::new(vec![[0.0; 3]], vec![], vec![], vec![], vec![]);
        assert_eq!(found.unwrap_err().means, 1);
    }

    #[test]
    fn harmonics_of_another_number_of_gaussians_are_an_error() {
        let mut scene = two();
        scene.harmonics = Harmonics {
            degree: 1,
            coefficients: vec![[0.5; 3]; 6],
        };
        scene.check_lengths().unwrap();
        assert_eq!(scene.subset(&[1]).harmonics.coefficients.len(), 3);
        scene.harmonics.degree = 2;
        assert_eq!(scene.check_lengths().unwrap_err().harmonics, 0);
    }

    #[test]
    fn filtering_keeps_order_and_finiteness_covers_every_attribute() {
        let scene = two();
        assert!(scene.is_finite(0));
        assert!(!scene.is_finite(1));
        let kept = scene.filtered(|k| scene.is_finite(k));
        assert_eq!(kept.len(), 1);
        assert_eq!(kept.means, vec![[0.0; 3]]);
    }
}
