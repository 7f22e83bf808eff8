//! Whether Gaussians show the photograph that they were predicted from, and if not, what their file may mean instead.
//!
//! A wrong frame, unit or colour space gives bad scores without an error. Rendered from the source's own camera, such
//! Gaussians give themselves away; a scale about that camera does not, so the depth that is seen is recorded too.

use std::collections::BTreeMap;

use glam::{DAffine3, DMat3};
use image::RgbImage;
use sharp::color::{linear_from_srgb, srgb_from_linear};
use sharp::gaussians::Gaussians;
use sharp::render::RenderError;
use sharp_metrics::{Picture, psnr};

use super::record::Record;
use super::render::{placed, surface_depth};
use crate::methods::{GaussianPrediction, GaussianSpace, Privilege, UNUSABLE};
use crate::pairs::PosedCamera;
use crate::pairs::depth::median_depth_m;
use crate::rendering::SharedRenderer;

/// The extra that holds the PSNR of the source's photograph and its rendering, dB; 100 at most, so that it is a number.
pub const SOURCE_PSNR: &str = "source_psnr";
/// The extra that holds the median depth of the rendering of the source, metres.
pub const SOURCE_DEPTH: &str = "source_depth_m";

/// Below this PSNR of the source, dB, other readings of the Gaussians are tried. Methods that predict their own input
/// well are far above it.
const UNLIKE: f64 = 25.0;
/// Below this, dB, a source that no reading explains is worth a warning: a photograph against its mean colour has about
/// as much.
const UNRELATED: f64 = 15.0;
/// What another reading must gain to be believed, dB: half the squared error.
const GAIN: f64 = 3.0;
/// Ratio of seen to true depth beyond which metres are doubted.
const UNLIKELY_SCALE: f64 = 10.0;

/// Another reading of Gaussians in camera space.
struct Reading {
    /// The extra that holds its PSNR.
    extra: &'static str,
    meaning: &'static str,
}

const FRAMES: [Reading; 3] = [
    Reading {
        extra: "source_psnr_if_opengl",
        meaning: "taken as OpenGL axes (y up, z backward)",
    },
    Reading {
        extra: "source_psnr_if_world",
        meaning: "taken as the dataset's world space",
    },
    Reading {
        extra: "source_psnr_if_normalized",
        meaning: "taken as SHARP's normalised space",
    },
];

const COLORS: [Reading; 2] = [
    Reading {
        extra: "source_psnr_if_srgb",
        meaning: "with colours read as sRGB (`color_space=srgb`)",
    },
    Reading {
        extra: "source_psnr_if_linear",
        meaning: "with colours read as linear (`color_space=linear`)",
    },
];

/// Renders a prediction into its own source. Gives the extras [`SOURCE_PSNR`], [`SOURCE_DEPTH`], and where the PSNR is
/// low and the method chose the space itself, that of every other reading: frames with the colours as they are, then
/// colours in the best of the frames.
///
/// # Errors
/// See [`RenderError`].
pub(super) fn check_source(
    prediction: &GaussianPrediction,
    source: &PosedCamera,
    photograph: &RgbImage,
    renderer: &SharedRenderer,
) -> Result<BTreeMap<String, f64>, RenderError> {
    let photograph = Picture::Rgb8(photograph.clone());
    let mut extras = BTreeMap::new();
    let as_given = placed(prediction.space, source, source);
    let output = renderer.render(&prediction.gaussians, as_given, source.intrinsics)?;
    if let Some(depth) = median_depth_m(&surface_depth(&output)) {
        extras.insert(SOURCE_DEPTH.to_owned(), depth);
    }
    let likeness = |picture: RgbImage| {
        let psnr = psnr(&Picture::Rgb8(picture), &photograph, None);
        psnr.map_or(0.0, |psnr| psnr.min(100.0))
    };
    let psnr = likeness(renderer.picture(&output));
    extras.insert(SOURCE_PSNR.to_owned(), psnr);
    if !(psnr < UNLIKE && prediction.space == GaussianSpace::Camera) {
        return Ok(extras);
    }
    let mut read_as = |extra: &str, gaussians: &Gaussians, placed| -> Result<f64, RenderError> {
        let output = renderer.render(gaussians, placed, source.intrinsics)?;
        let psnr = likeness(renderer.picture(&output));
        extras.insert(extra.to_owned(), psnr);
        Ok(psnr)
    };
    let frames = [
        DAffine3::from_mat3(DMat3::from_diagonal(glam::DVec3::new(1.0, -1.0, -1.0))),
        source.camera_from_world.to_affine(),
        self::placed(GaussianSpace::Normalized, source, source),
    ];
    let mut best = (psnr, as_given);
    for (Reading { extra, .. }, frame) in FRAMES.iter().zip(frames) {
        let psnr = read_as(extra, &prediction.gaussians, frame)?;
        if psnr > best.0 {
            best = (psnr, frame);
        }
    }
    for (Reading { extra, .. }, convert) in COLORS.iter().zip([linear_from_srgb, srgb_from_linear])
    {
        let colors = prediction.gaussians.colors.iter();
        let recolored = Gaussians {
            colors: colors.map(|color| color.map(convert)).collect(),
            ..prediction.gaussians.clone()
        };
        read_as(extra, &recolored, best.1)?;
    }
    Ok(extras)
}

/// What is odd about the Gaussians behind a record, in one line, with the reading that fits best.
pub fn doubt(record: &Record, privilege: Privilege) -> Option<String> {
    let extra = |name: &str| record.extras.get(name).copied();
    let mut doubts = Vec::new();
    for (name, what) in UNUSABLE {
        if let Some(count) = extra(name) {
            let source = &record.source;
            doubts.push(format!(
                "{count} of its Gaussians {what} and are not drawn ({source})"
            ));
        }
    }
    let psnr = extra(SOURCE_PSNR);
    let best_of = |readings: &'static [Reading]| {
        let found = readings.iter().filter_map(|r| Some((extra(r.extra)?, r)));
        found.max_by(|a, b| a.0.total_cmp(&b.0))
    };
    let tried = best_of(&FRAMES).zip(best_of(&COLORS));
    if let Some((psnr, ((of_frame, frame), (of_color, color)))) = psnr.zip(tried) {
        let mut readings = Vec::new();
        let mut best = psnr;
        if of_frame >= best + GAIN {
            readings.push(frame.meaning);
            best = of_frame;
        }
        if of_color >= best + GAIN {
            readings.push(color.meaning);
            best = of_color;
        }
        let shown = format!(
            "its Gaussians show the photograph they were predicted from at {psnr:.2} dB PSNR ({})",
            record.source
        );
        if !readings.is_empty() {
            doubts.push(format!("{shown}; {}: {best:.2} dB", readings.join(" and ")));
        } else if psnr < UNRELATED {
            doubts.push(format!(
                "{shown}, and no other frame or colour space that was tried shows it better"
            ));
        }
    }
    let depths = extra(SOURCE_DEPTH).zip(record.median_depth_m);
    if let Some(ratio) = depths.map(|(seen, true_depth)| seen / true_depth)
        && !(UNLIKELY_SCALE.recip()..=UNLIKELY_SCALE).contains(&ratio)
        && privilege == Privilege::None
    {
        doubts.push(format!(
            "its Gaussians lie {ratio:.3} times as far away as the dataset's depth ({}): metres are needed, or \
             `depth=privileged` scales them",
            record.source
        ));
    }
    (!doubts.is_empty()).then(|| doubts.join("; "))
}

#[cfg(test)]
mod tests {
    use sharp::camera::{Intrinsics, RigidTransform};

    use super::*;

    fn source() -> PosedCamera {
        // Turned about the vertical and moved: world and camera space differ.
        let (sin, cos) = 0.4_f64.sin_cos();
        PosedCamera {
            id: "s".to_owned(),
            intrinsics: Intrinsics::new((40.0, 40.0), (20.0, 16.0), (40, 32)).unwrap(),
            camera_from_world: RigidTransform::from_row_major(&[
                cos, 0.0, sin, 0.3, 0.0, 1.0, 0.0, -0.2, -sin, 0.0, cos, 0.5, 0.0, 0.0, 0.0, 1.0,
            ])
            .unwrap(),
        }
    }

    /// A wall of coloured Gaussians 2 m in front of the camera, one a pixel, in camera space.
    fn wall() -> Gaussians {
        let k = source().intrinsics;
        let mut wall = Gaussians::default();
        for y in 0..k.height {
            for x in 0..k.width {
                let at = |p: u32, c: f64, f: f64| (2.0 * (f64::from(p) + 0.5 - c) / f) as f32;
                wall.means.push([at(x, k.cx, k.fx), at(y, k.cy, k.fy), 2.0]);
                wall.quaternions.push([1.0, 0.0, 0.0, 0.0]);
                wall.scales.push([0.03, 0.03, 1e-3]);
                wall.opacities.push(0.95);
                wall.colors.push([
                    0.2 + 0.6 * (x / 8 % 2) as f32,
                    0.1 + 0.02 * y as f32,
                    0.3 + 0.4 * ((x + y) / 16 % 2) as f32,
                ]);
            }
        }
        wall
    }

    fn mapped(gaussians: &Gaussians, map: DAffine3) -> Gaussians {
        let point = |m: &[f32; 3]| map.transform_point3(glam::DVec3::from(m.map(f64::from)));
        Gaussians {
            means: gaussians
                .means
                .iter()
                .map(|m| point(m).as_vec3().to_array())
                .collect(),
            // Round, so that a rotation leaves them as they are.
            scales: vec![[0.03; 3]; gaussians.len()],
            ..gaussians.clone()
        }
    }

    fn recolored(gaussians: &Gaussians, convert: fn(f32) -> f32) -> Gaussians {
        let colors = gaussians.colors.iter().map(|color| color.map(convert));
        Gaussians {
            colors: colors.collect(),
            ..gaussians.clone()
        }
    }

    fn doubt_about(gaussians: Gaussians) -> Option<String> {
        let (source, renderer) = (source(), SharedRenderer::cpu());
        let round = mapped(&wall(), DAffine3::IDENTITY);
        let truth = renderer.render(&round, DAffine3::IDENTITY, source.intrinsics);
        let photograph = renderer.picture(&truth.unwrap());
        let prediction = GaussianPrediction {
            gaussians,
            space: GaussianSpace::Camera,
            first_layer: None,
            extras: BTreeMap::new(),
        };
        let mut record = super::super::record::tests::record();
        record.median_depth_m = Some(2.0);
        record.extras = check_source(&prediction, &source, &photograph, &renderer).unwrap();
        doubt(&record, Privilege::None)
    }

    #[test]
    fn a_wrong_frame_colour_space_or_unit_is_named_and_a_right_one_is_not() {
        let round = mapped(&wall(), DAffine3::IDENTITY);
        assert_eq!(doubt_about(round.clone()), None);
        let gl = DAffine3::from_mat3(DMat3::from_diagonal(glam::DVec3::new(1.0, -1.0, -1.0)));
        let world = source().camera_from_world.to_affine().inverse();
        let normalized = placed(GaussianSpace::Normalized, &source(), &source()).inverse();
        let millimetres = DAffine3::from_scale(glam::DVec3::splat(1000.0));
        let in_millimetres = Gaussians {
            scales: vec![[30.0; 3]; round.len()],
            ..mapped(&round, millimetres)
        };
        let in_millimetres_too = in_millimetres.clone();
        let in_normalized = Gaussians {
            scales: vec![[0.06, 0.075, 0.03]; round.len()],
            ..mapped(&round, normalized)
        };
        for (gaussians, words) in [
            (mapped(&round, gl), "OpenGL"),
            (mapped(&round, world), "world space"),
            (in_normalized, "normalised space"),
            (recolored(&round, srgb_from_linear), "color_space=srgb"),
            (recolored(&round, linear_from_srgb), "color_space=linear"),
            (
                recolored(&mapped(&round, gl), srgb_from_linear),
                "z backward) and with colours read as sRGB",
            ),
            (in_millimetres, "1000.000 times as far"),
            (recolored(&round, |_| 0.9), "no other frame"),
            // One doubt does not hide another.
            (
                recolored(&in_millimetres_too, |_| 0.9),
                "shows it better; its Gaussians lie 1000.000 times",
            ),
        ] {
            let said = doubt_about(gaussians).unwrap_or_default();
            assert!(said.contains(words), "{words}: {said}");
        }
    }

    #[test]
    fn privileged_methods_are_scaled_and_need_no_metres() {
        let mut record = super::super::record::tests::record();
        record.median_depth_m = Some(2.0);
        record.extras = BTreeMap::from([(SOURCE_DEPTH.to_owned(), 2000.0)]);
        assert!(doubt(&record, Privilege::None).is_some());
        assert_eq!(doubt(&record, Privilege::DepthScale), None);
        record.median_depth_m = None;
        assert_eq!(doubt(&record, Privilege::None), None);
        record.extras.insert("zero_quaternions".to_owned(), 3.0);
        let said = doubt(&record, Privilege::None).unwrap();
        assert!(
            said.contains("3 of its Gaussians have a quaternion of zero"),
            "{said}"
        );
    }
}
