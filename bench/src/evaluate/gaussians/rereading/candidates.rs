//! The settings of the file reader that are tried.

use sharp::gaussians::Gaussians;
use sharp::ply::{
    ColorSpace, Harmonics, StoredChannels, StoredColors, StoredOpacity, StoredQuaternions,
    StoredScales,
};

use crate::methods::file_reading::{Axes, FileReading, FileSpace, Placement};

/// Axes to try: OpenGL's (a rotation about x), rotations about y and z, mirrored ones such as Unity's, and z up.
const AXES: [&str; 7] = ["rdf", "rub", "ldb", "luf", "ldf", "ruf", "rfu"];
/// Units to try for a world space, metres: powers of ten, feet and inches.
const UNITS_M: [f64; 8] = [0.001, 0.01, 0.1, 10.0, 100.0, 1000.0, 0.3048, 0.0254];

/// What the rendering of the Gaussians, as read, suggests about their file.
pub(in crate::evaluate) struct Hints {
    /// The rendering shows nothing of the photograph, so that all axes are tried.
    pub(in crate::evaluate) is_lost: bool,
    /// The rendering is a blurred version of the photograph.
    pub(in crate::evaluate) is_blurred: bool,
    /// Shift that may align the rendering with the photograph, in pixels.
    pub(in crate::evaluate) aside: [f64; 2],
    /// Pairs of horizontal and vertical factors that may align the rendering with the photograph.
    pub(in crate::evaluate) zooms: Vec<[f64; 2]>,
    /// Factors and shift that spread the Gaussians over the whole photograph ([`Trial::spread`](super::Trial::spread)).
    pub(in crate::evaluate) spread: Option<[[f64; 2]; 2]>,
}

/// Placements to try: other spaces and axes, a world in other units, the inverse of `transform=`, shifts, and other
/// focal lengths.
pub(super) fn placements(current: Placement, hints: &Hints) -> Vec<Placement> {
    let mut all = Vec::new();
    let axes: Vec<Axes> = if hints.is_lost {
        Axes::every().collect()
    } else {
        AXES.into_iter().filter_map(Axes::parse).collect()
    };
    for space in [FileSpace::Camera, FileSpace::World] {
        all.extend(axes.iter().map(|axes| Placement {
            space,
            axes: *axes,
            ..current
        }));
    }
    // Scaling a scene about the camera does not change what the camera sees, so units matter only
    // in world space.
    let units = UNITS_M.iter().filter(|_| current.space == FileSpace::World);
    all.extend(units.map(|unit| Placement {
        scale: current.scale * unit,
        ..current
    }));
    all.push(Placement {
        space: FileSpace::Normalized,
        axes: Axes::OPENCV,
        ..current
    });
    all.extend(current.transform.map(|map| Placement {
        transform: Some(map.inverse()),
        ..current
    }));
    let rounded = |value: f64| (value * 1000.0).round() / 1000.0;
    all.push(Placement {
        shift: [0, 1].map(|axis| rounded(current.shift[axis] + hints.aside[axis])),
        ..current
    });
    all.extend(hints.spread.map(|[zoom, aside]| Placement {
        focal: [0, 1].map(|axis| rounded(current.focal[axis] * zoom[axis])),
        shift: [0, 1].map(|axis| rounded(zoom[axis] * current.shift[axis] + aside[axis])),
        ..current
    }));
    all.extend(hints.zooms.iter().map(|zoom| Placement {
        focal: [0, 1].map(|axis| rounded(current.focal[axis] * zoom[axis])),
        ..current
    }));
    all.retain(|placement| *placement != current);
    all
}

/// Interpretations of the stored numbers to try. Base-10 logarithms are tried only if `is_wide`: read as natural
/// logarithms, they give Gaussians so wide that many cover each pixel. Narrower Gaussians would shrink to mere centres,
/// which may resemble the source by chance.
pub(super) fn numbers(
    current: &FileReading,
    stored: &Gaussians,
    is_wide: bool,
) -> Vec<FileReading> {
    let mut all = Vec::new();
    let mut add = |change: &dyn Fn(&mut FileReading)| {
        let mut other = *current;
        change(&mut other);
        if other != *current {
            all.push(other);
        }
    };
    for order in StoredQuaternions::ALL {
        add(&|other| other.stored.quaternions = Some(*order));
    }
    for space in ColorSpace::ALL {
        add(&|other| other.stored.color_space = Some(*space));
    }
    if stored.harmonics.degree > 0 {
        add(&|other| other.stored.harmonics = Some(Harmonics::Interleaved));
    }
    for channels in StoredChannels::ALL {
        add(&|other| other.stored.channels = Some(*channels));
    }
    // The tolerance is for rounding, because values were decoded and encoded again.
    let unit = -1e-4..=1.0001;
    let fits = |all: &[f32], most: f32| all.iter().all(|v| unit.contains(&(v / most)));
    if current.stored.opacity == Some(StoredOpacity::Logit) && fits(&stored.opacities, 1.0) {
        add(&|other| other.stored.opacity = Some(StoredOpacity::Linear));
    }
    if current.stored.opacity == Some(StoredOpacity::Logit)
        && stored.opacities.iter().all(|o| *o <= 1e-4)
    {
        add(&|other| other.stored.opacity = Some(StoredOpacity::Log));
    }
    let scales = stored.scales.as_flattened();
    use StoredScales::{Linear, Log, Log10, LogVariance, Variance};
    let is_log = current.stored.scales == Some(Log);
    if let Some(Log | LogVariance | Log10) = current.stored.scales {
        let forms = [Log, LogVariance, Log10].into_iter();
        for form in forms.filter(|form| *form != Log10 || is_wide) {
            add(&|other| other.stored.scales = Some(form));
        }
    }
    let is_linear = matches!(current.stored.scales, Some(Linear | Variance));
    if is_linear || is_log && scales.iter().all(|s| *s >= -1e-4) {
        for form in [Linear, Variance] {
            add(&|other| other.stored.scales = Some(form));
        }
    }
    let colors = stored.colors.as_flattened();
    let is_dc = matches!(
        current.stored.colors,
        Some(StoredColors::Dc | StoredColors::DcUncentered)
    );
    for (form, is_possible) in [
        (StoredColors::Dc, is_dc),
        (StoredColors::Logit, is_dc),
        (StoredColors::DcUncentered, is_dc),
        (StoredColors::Rgb01, is_dc && fits(colors, 1.0)),
        (
            StoredColors::RgbSigned,
            is_dc && colors.iter().all(|v| v.abs() <= 1.0001),
        ),
        (
            StoredColors::Rgb255,
            fits(colors, 255.0) && colors.iter().any(|v| *v > 1.0),
        ),
    ] {
        if is_possible {
            add(&|other| other.stored.colors = Some(form));
        }
    }
    all
}
