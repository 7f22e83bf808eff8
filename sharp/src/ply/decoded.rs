//! Values stored in a file of any format, and their conversion to a scene.

use super::marks::FileMarks;
use super::reading::{Harmonics, Marks, StoredForm, StoredOpacity, StoredScales};
use super::suspicions::{Suspicion, suspicions};
use super::{ColorSpace, GaussianScene, PlyReason};
use crate::camera::Intrinsics;
use crate::gaussians::Gaussians;

/// Numbers of a file in any format, before decoding.
#[derive(Debug, Clone, Default)]
pub(crate) struct Decoded {
    /// Stored values, encoded as `form` describes; harmonics are not encoded.
    pub(crate) stored: Gaussians,
    /// Encodings of the stored values, as the format defines them.
    pub(crate) form: StoredForm,
    pub(crate) marks: FileMarks,
    /// Mip-Splatting's filter of each Gaussian; empty if absent.
    pub(crate) filter_3d: Vec<f32>,
    /// Colour encoding stated by the file.
    pub(crate) stated: Option<ColorSpace>,
    pub(crate) intrinsics: Option<Intrinsics>,
    pub(crate) extrinsics: Option<[f32; 16]>,
    pub(crate) version: Option<[u8; 3]>,
    /// Number of `f_rest_*` properties or, in other formats, of the equivalent values per Gaussian.
    pub(crate) color_coefficients: usize,
    pub(crate) is_view_dependent: bool,
    pub(crate) doubts: Vec<Suspicion>,
}

impl Decoded {
    /// Decodes the scene, with `given` overriding the format's encodings.
    ///
    /// # Errors
    /// [`PlyReason`] if the values are invalid in these encodings, or if they were made for another rendering rule.
    pub(crate) fn scene(mut self, given: &StoredForm) -> Result<GaussianScene, PlyReason> {
        if given.marks != Some(Marks::Ignore) {
            self.marks.check_rule(given)?;
        }
        let color_space = match (self.stated, given.color_space) {
            (Some(stated), Some(given)) if stated != given => {
                return Err(PlyReason::ColorSpaceContradicted { stated, given });
            }
            (stated, given) => stated.or(given),
        };
        let blends_encoded = given.blending == ColorSpace::Srgb;
        let reading = StoredForm {
            color_space: color_space.or(blends_encoded.then_some(ColorSpace::Srgb)),
            ..*given
        }
        .or_of(&self.form);
        self.doubts
            .extend(suspicions(&self.stored, given, &reading));
        check_stored(&self.stored, &reading)?;
        if reading.color_space.is_none() {
            return Err(PlyReason::ColorSpaceUnknown);
        }
        if !self.is_view_dependent || given.harmonics == Some(Harmonics::Drop) || !blends_encoded {
            self.stored.harmonics = Default::default();
        } else if given.harmonics == Some(Harmonics::Refuse) {
            return Err(PlyReason::ViewDependent(self.color_coefficients));
        } else if reading.color_space == Some(ColorSpace::Linear) {
            return Err(PlyReason::LinearHarmonics);
        }
        reading.decode(&mut self.stored);
        if given.takes_other_rules() && given.marks != Some(Marks::Ignore) {
            fold_filter(&mut self.stored, &self.filter_3d);
        }
        Ok(GaussianScene {
            gaussians: self.stored,
            intrinsics: self.intrinsics,
            extrinsics: self.extrinsics,
            color_space: self.stated,
            version: self.version,
            color_coefficients: self.color_coefficients,
            is_view_dependent: self.is_view_dependent,
            marks: self.marks,
            reading,
            doubts: self.doubts,
        })
    }
}

/// Widens each Gaussian by Mip-Splatting's 3-D filter (a standard deviation) and lowers its opacity to preserve its
/// total contribution. Gaussians beyond the end of `filter` are unchanged.
fn fold_filter(gaussians: &mut Gaussians, filter: &[f32]) {
    let rows = gaussians.scales.iter_mut().zip(&mut gaussians.opacities);
    for ((scales, opacity), &filter) in rows.zip(filter) {
        let filter = f64::from(filter);
        let widened = scales.map(|s| f64::from(s).hypot(filter));
        let shares = scales.iter().zip(widened);
        // Avoids division by zero for a zero width.
        let share: f64 = shares
            .map(|(s, w)| if w > 0.0 { f64::from(*s) / w } else { 1.0 })
            .product();
        *opacity = (f64::from(*opacity) * share) as f32;
        *scales = widened.map(|w| w as f32);
    }
}

/// Rejects stored values that are impossible in an explicitly requested encoding.
///
/// # Errors
/// [`PlyReason::Impossible`] names the first such value and the encoding that allows it.
pub fn check_stored(stored: &Gaussians, reading: &StoredForm) -> Result<(), PlyReason> {
    let impossible = |what, value: f32, advice| PlyReason::Impossible {
        what,
        value,
        advice,
    };
    let mut opacities = stored.opacities.iter().copied();
    let range = match reading.opacity {
        Some(StoredOpacity::Linear) => Some(("an opacity", -1e-4..=1.0001)),
        Some(StoredOpacity::Log) => Some(("the logarithm of an opacity", f32::NEG_INFINITY..=1e-4)),
        _ => None,
    };
    if let Some((what, range)) = range
        && let Some(value) = opacities.find(|o| !range.contains(o) && !o.is_nan())
    {
        return Err(impossible(what, value, "`opacity=logit` reads logits"));
    }
    let mut scales = stored.scales.as_flattened().iter().copied();
    if let Some(StoredScales::Linear | StoredScales::Variance) = reading.scales
        && let Some(value) = scales.find(|s| *s < 0.0)
    {
        let advice = "`scales=log` reads logarithms";
        return Err(impossible("a standard deviation", value, advice));
    }
    Ok(())
}

/// Degree of the spherical harmonics that have `coefficients` coefficients besides the constant ones.
pub(crate) fn degree_of(coefficients: usize) -> Option<usize> {
    (0..=crate::gaussians::Harmonics::MAX_DEGREE)
        .find(|degree| 3 * ((degree + 1).pow(2) - 1) == coefficients)
}
