//! Detection of wrong encodings from the stored numbers alone.
//!
//! The thresholds are empirical: none fires on real files of seven programs, and each fires on incorrectly written
//! files. Columns with a single value are ignored as fresh initialisations, and files with fewer than [`MIN_GAUSSIANS`]
//! Gaussians are not judged. The component order of quaternions cannot be detected from numbers: in files of real
//! scenes, any of the four components may be the largest.

use super::reading::{
    StoredColors, StoredForm, StoredOpacity, StoredQuaternions, StoredScales, logistic,
};
use crate::gaussians::Gaussians;
use crate::random::mix;

/// Files with fewer Gaussians are not judged.
const MIN_GAUSSIANS: usize = 20;
/// Repetitions are reported if at least this share of the different Gaussians occurs more than once.
const MIN_REPEATED: f64 = 0.05;

/// A doubt about the encoding of a file.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct Suspicion {
    /// Topic, e.g. `overflow`, or the setting that would fix the reading, e.g. `opacity=linear`. Only one doubt per
    /// topic is reported.
    pub about: &'static str,
    /// Reason for the doubt, and the setting that would fix the reading.
    pub text: String,
}

impl Suspicion {
    pub fn new(about: &'static str, text: impl Into<String>) -> Self {
        Self {
            about,
            text: text.into(),
        }
    }
}

/// Doubts about stored numbers, for settings that were not given. `format` has all encodings: the
/// given settings, completed by the format's own.
pub fn suspicions(stored: &Gaussians, given: &StoredForm, format: &StoredForm) -> Vec<Suspicion> {
    let finite: Vec<usize> = (0..stored.len()).filter(|&k| stored.is_finite(k)).collect();
    if finite.len() < MIN_GAUSSIANS {
        return Vec::new();
    }
    let of = |values: &[[f32; 3]]| -> Vec<f32> {
        let rows = finite.iter().flat_map(|&k| values[k]);
        rows.collect()
    };
    let opacities = Range::of(finite.iter().map(|&k| stored.opacities[k]).collect());
    let colors = Range::of(of(&stored.colors));
    let scales = Range::of(of(&stored.scales));
    let extent = extent(stored, &finite);
    let mut found = Vec::new();
    if given.opacity.is_none() && format.opacity == Some(StoredOpacity::Logit) {
        if opacities.is_activated() {
            found.push(Suspicion::new(
                "opacity=linear",
                format!(
                    "its opacities may have been stored without the logit (all stored values are in {:.3}..{:.3}, so \
                     every opacity is in {:.3}..{:.3}; only a comparison with a photograph can decide); \
                     `opacity=linear` reads them as opacities",
                    opacities.least,
                    opacities.most,
                    logistic(opacities.least),
                    logistic(opacities.most)
                ),
            ));
        } else if opacities.is_logarithm() {
            found.push(Suspicion::new(
                "opacity=log",
                format!(
                    "its opacities may have been stored as logarithms (all stored values are in {:.3}..{:.3}, so as \
                     logits none would exceed {:.3}; only a comparison with a photograph can decide); `opacity=log` \
                     reads them as logarithms",
                    opacities.least,
                    opacities.most,
                    logistic(opacities.most)
                ),
            ));
        } else {
            found.extend(opacities.as_bytes("opacities", "opacity=byte"));
        }
    }
    if given.scales.is_none()
        && format.scales == Some(StoredScales::Log)
        && scales.least >= 0.0
        && scales.median.exp() > 0.05 * extent
        // In a scene measured in millimetres, logarithms have this magnitude.
        && (scales.median < 1.0 || scales.median.exp() > extent)
    {
        found.push(Suspicion::new(
            "scales=linear",
            format!(
                "its scales do not look like logarithms (none is negative; as logarithms, half of \
                 the standard deviations would exceed {:.3} in a scene {extent:.1} across); `scales=linear` reads them as standard \
                 deviations, `scales=variance` as variances",
                scales.median.exp()
            ),
        ));
    }
    if given.colors.is_none() {
        let is_dc = format.colors == Some(StoredColors::Dc);
        if is_dc && colors.is_unit() {
            found.push(Suspicion::new(
                "colors=rgb01",
                format!(
                    "its colours may be 0..1 instead of coefficients (all stored values are in {:.3}..{:.3}, as in a \
                     pastel scene; only a comparison with a photograph can decide); `colors=rgb01` reads them as 0..1",
                    colors.least, colors.most
                ),
            ));
        } else if is_dc && colors.is_signed() {
            found.push(Suspicion::new(
                "colors=rgb-signed",
                format!(
                    "its colours may be −1..1 instead of coefficients (all stored values are in {:.3}..{:.3} and fill \
                     that range; only a comparison with a photograph can decide); `colors=rgb-signed` reads them as \
                     −1..1",
                    colors.least, colors.most
                ),
            ));
        } else if format.colors != Some(StoredColors::Rgb255) {
            found.extend(colors.as_bytes("colours", "colors=rgb255"));
        }
    }
    let lost = |k: &&usize| matches!(stored.quaternions[**k], [0.0, 0.0, 0.0, w] if w != 0.0);
    if given.quaternions.is_none()
        && format.quaternions == Some(StoredQuaternions::Wxyz)
        && finite.iter().filter(lost).count() * 100 > finite.len() * 99
        && finite
            .iter()
            .filter(|k| is_stretched(stored.scales[**k], format))
            .count()
            * 2
            > finite.len()
    {
        found.push(Suspicion::new(
            StoredQuaternions::KEY,
            "its rotations seem to be missing, because every quaternion is (0, 0, 0, 1), the identity in the order \
             x, y, z, \
             w; fix the program that wrote it, or read that order with `quaternions=xyzw`",
        ));
    }
    if is_viewer_normalised(stored, &finite) {
        found.push(Suspicion::new(
            "space",
            "its coordinates look normalised for a viewer (median 0, 95 % within 1), as the \
             exports of pixelSplat and Flash3D write them: scale and camera are lost; use the \
             Gaussians from before the export",
        ));
    }
    found.extend(repetition(stored, &finite));
    found
}

/// A suspicion if many different Gaussians occur more than once. A Gaussian that occurs often, for
/// instance for all invalid pixels, counts once.
fn repetition(stored: &Gaussians, finite: &[usize]) -> Option<Suspicion> {
    let hash = |&k: &usize| {
        let rows = [stored.means[k], stored.scales[k], stored.colors[k]];
        let values = rows.as_flattened().iter().chain(&stored.quaternions[k]);
        let values = values.chain([&stored.opacities[k]]);
        values.fold(0, |hash, value| mix(hash ^ u64::from(value.to_bits())))
    };
    let mut hashes: Vec<u64> = finite.iter().map(hash).collect();
    hashes.sort_unstable();
    let groups = hashes.chunk_by(|a, b| a == b);
    let (different, repeated) = groups.fold((0, 0), |(all, repeated), group| {
        (all + 1, repeated + usize::from(group.len() > 1))
    });
    (repeated >= MIN_GAUSSIANS && repeated as f64 >= MIN_REPEATED * different as f64).then(|| {
        let share = 100.0 * (1.0 - different as f64 / finite.len() as f64);
        let text = format!(
            "{share:.0} % of its Gaussians repeat another one exactly, which makes them more opaque; perhaps the \
             file was appended to when it was written again"
        );
        Suspicion::new("repetition", text)
    })
}

/// Minimum, median and maximum of some values.
struct Range {
    least: f32,
    median: f32,
    most: f32,
    /// Difference between the 1 % and the 99 % quantile.
    spread: f32,
    /// The 95 % quantile.
    high: f32,
}

impl Range {
    /// Measures the range of `values`, which must not be empty.
    fn of(mut values: Vec<f32>) -> Self {
        values.sort_unstable_by(f32::total_cmp);
        let at = |q: f64| values[((values.len() - 1) as f64 * q).round() as usize];
        Self {
            least: at(0.0),
            median: at(0.5),
            most: at(1.0),
            spread: at(0.99) - at(0.01),
            high: at(0.95),
        }
    }

    /// True if all values are in 0..1 and vary as widely as colours. If they vary less, they may be coefficients, all
    /// of a single shade.
    fn is_unit(&self) -> bool {
        self.least >= 0.0 && self.most <= 1.0 && self.spread >= 0.5
    }

    /// True if all values are in −1..1 and fill this range as the colours of a photograph do.
    fn is_signed(&self) -> bool {
        self.least >= -1.0 && self.most <= 1.0 && self.spread >= 1.7
    }

    /// A suspicion, if all values are at least 0 and some are far above 1.
    fn as_bytes(&self, what: &str, about: &'static str) -> Option<Suspicion> {
        let Self { least, most, .. } = self;
        (*least >= 0.0 && *most > 20.0).then(|| {
            let text = format!(
                "its {what} look like 0..255 (stored values {least}..{most}); `{about}` reads them as 0..255"
            );
            Suspicion::new(about, text)
        })
    }

    /// True if the values look like opacities without the logit: all are in 0..1. If all values are equal, the value
    /// must also be a round number, and its logistic must not be a round number.
    fn is_activated(&self) -> bool {
        let inside = self.least >= 0.0 && self.most <= 1.0;
        inside
            && (self.least < self.most || (is_round(self.least) && !is_round(logistic(self.least))))
    }

    /// True if the values look like logarithms of opacities: none is positive, and many are close to 0. If all values
    /// are equal, the exponential must be a round number, and the logistic must not be a round number.
    fn is_logarithm(&self) -> bool {
        let is_constant = self.least == self.most;
        self.most <= 0.0
            && if is_constant {
                is_round(self.most.exp()) && !is_round(logistic(self.most))
            } else {
                self.high > NEARLY_OPAQUE && self.median > MOSTLY_OPAQUE
            }
    }
}

/// Logarithm of an opacity that at least one in twenty Gaussians of a real scene exceeds.
const NEARLY_OPAQUE: f32 = -0.25;
/// Logarithm of an opacity that at least half of the Gaussians of a real scene exceed.
const MOSTLY_OPAQUE: f32 = -0.4;

fn is_round(value: f32) -> bool {
    (value * 1000.0 - (value * 1000.0).round()).abs() < 1e-3
}

/// The scene's largest standard deviation if it exceeds a million, or else the median one if it
/// exceeds the extent of the scene; `None` if neither does.
pub fn enormous_scale(gaussians: &Gaussians) -> Option<f32> {
    let finite: Vec<usize> = (0..gaussians.len())
        .filter(|&k| gaussians.is_finite(k))
        .collect();
    let mut scales: Vec<f32> = finite.iter().flat_map(|&k| gaussians.scales[k]).collect();
    scales.sort_unstable_by(f32::total_cmp);
    let most = scales.last().copied()?;
    let median = scales[scales.len() / 2];
    let extent = extent(gaussians, &finite);
    let is_wide = finite.len() >= MIN_GAUSSIANS && extent > 0.0 && median > extent;
    match (most > 1e6, is_wide) {
        (true, _) => Some(most),
        (false, true) => Some(median),
        (false, false) => None,
    }
}

/// True if a rotation would be visible, i.e. the standard deviations differ by more than a twentieth.
fn is_stretched(stored: [f32; 3], format: &StoredForm) -> bool {
    let [x, y, z] = match format.scales {
        Some(StoredScales::Log) => stored.map(f32::exp),
        _ => stored,
    };
    x.max(y).max(z) > 1.05 * x.min(y).min(z)
}

/// Diagonal of the box that contains the middle 90 % of the centres along each axis.
fn extent(stored: &Gaussians, finite: &[usize]) -> f32 {
    let axes = [0, 1, 2].map(|axis| {
        let mut along: Vec<f32> = finite.iter().map(|&k| stored.means[k][axis]).collect();
        along.sort_unstable_by(f32::total_cmp);
        let at = |q: f64| along[((along.len() - 1) as f64 * q).round() as usize];
        at(0.95) - at(0.05)
    });
    axes.iter().map(|side| side * side).sum::<f32>().sqrt()
}

fn is_viewer_normalised(stored: &Gaussians, finite: &[usize]) -> bool {
    let mut largest = 0.0_f32;
    for axis in 0..3 {
        let mut along: Vec<f32> = finite.iter().map(|&k| stored.means[k][axis]).collect();
        along.sort_unstable_by(f32::total_cmp);
        if along[along.len() / 2].abs() >= 1e-5 {
            return false;
        }
        let mut away: Vec<f32> = along.iter().map(|v| v.abs()).collect();
        away.sort_unstable_by(f32::total_cmp);
        largest = largest.max(away[((away.len() - 1) as f64 * 0.95).round() as usize]);
    }
    (largest - 1.0).abs() <= 1e-3
}
