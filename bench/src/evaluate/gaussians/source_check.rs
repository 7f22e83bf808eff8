//! Renders Gaussians into the view that they were predicted from. If the rendering does not match
//! the view's photograph, tries other readings of the Gaussians' file.
//!
//! A wrong frame, unit, encoding or colour space gives bad scores without an error. Rendering into
//! the source's own camera reveals all of these except a scale about that camera, so the rendered
//! depth is recorded too. For external files, other readings are tried (`add_doubts`) for three
//! sources of each dataset, which depend only on the list of pairs; this costs as much as some
//! small pictures.

use std::collections::{BTreeMap, BTreeSet};

use image::imageops::crop_imm;
use image::{Luma, RgbImage};
use sharp::color::{Quantization, linear_from_srgb};
use sharp::gaussians::Gaussians;
use sharp::ply::ColorSpace;
use sharp::render::{Background, RenderError};
use sharp_datasets::{DepthMap, Scene};
use sharp_metrics::{Mask, Picture, psnr};

use super::likeness::{Likeness, blur, window};
use super::registration::{shift, zoom};
use super::render::placed;
use super::rereading::{Moves, Seen, Trial};
use crate::methods::GaussianPrediction;
use crate::methods::file_reading::{FileReading, FileSpace};
use crate::pairs::PosedCamera;
use crate::pairs::depth::median_depth_m;
use crate::pairs::pair_id::source_of;
use crate::pairs::pair_list::ResolvedPair;
use crate::pairs::valid_depth::{is_valid_depth, median_of};
use crate::rendering::SharedRenderer;
use crate::rendering::shared::surface_depth;
use crate::scoring::Region;

/// Extra with the PSNR between the source's photograph and its rendering, dB; at most 100, so that it is finite.
pub const SOURCE_PSNR: &str = "source_psnr";
/// Extra with the median depth of the source's rendering, metres.
pub const SOURCE_DEPTH: &str = "source_depth_m";

/// Extra of renderings that blur the source: the share of the photograph's contrast that is
/// missing, 0..1.
pub const SOURCE_BLUR: &str = "source_blur";

/// Other readings are tried only if at least this share of the photograph is valid; the excluded
/// part does not show the scene.
const LEAST_VALID: f64 = 0.95;
/// PSNR of the source's rendering above which no other reading is tried, dB.
const RIGHT_DB: f64 = 38.0;
/// Other readings are tried only on photographs with at least this many pixels; smaller ones do not
/// show a Gaussian's shape.
const FEWEST_PIXELS: usize = 1200;
/// Rendered depth counts as inverse depth if the ratio of true to rendered depth varies this many
/// times as much as their product.
const INVERSE_SIGNIFICANCE: f64 = 2.5;
/// A depth factor may indicate another unit only from this value on; predictions without a unit are
/// off by less.
const LEAST_FACTOR: f64 = 1.5;
/// The factor's logarithm must be at least this many times the spread of depth ratios, which
/// prediction errors cause.
const FACTOR_SIGNIFICANCE: f64 = 10.0;
/// With more Gaussians per pixel on average, rendering takes minutes. Photographs need tens or
/// hundreds.
const ABSURD_LAYERS: f64 = 5000.0;
/// A warning is given only if each Gaussian covers at least this share of the picture on average:
/// millions of small Gaussians on a small picture are fine.
const ABSURD_SHARE: f64 = 0.02;

pub(in crate::evaluate) struct CheckedSource<'a> {
    pub(in crate::evaluate) camera: &'a PosedCamera,
    pub(in crate::evaluate) photograph: &'a RgbImage,
    /// Pixels of the photograph that count; `None` for all.
    pub(in crate::evaluate) valid: Option<&'a Mask>,
    /// True depth, if available; `None` for a method that is scaled to it.
    pub(in crate::evaluate) depth: Option<&'a DepthMap>,
    pub(in crate::evaluate) scene: &'a Scene,
    /// Whether to try other readings.
    pub(in crate::evaluate) is_chosen: bool,
}

/// Measured values and warnings.
pub(in crate::evaluate) struct SourceFacts {
    pub(in crate::evaluate) extras: BTreeMap<String, f64>,
    pub(in crate::evaluate) warnings: BTreeMap<String, String>,
}

/// A prediction rendered into its own source.
struct SeenSource {
    picture: RgbImage,
    depth: DepthMap,
    /// The rendering over the photograph's mean colour, in place of the background.
    over_mean: RgbImage,
}

/// Renders a prediction into its own source. Measures [`SOURCE_PSNR`], [`SOURCE_DEPTH`] and
/// [`SOURCE_BLUR`], and warns if they contradict the reading of its file. For chosen sources, also
/// tries other readings. If only the numbers suggest a setting, and the photograph is explained
/// without it, the suggestion is dropped.
///
/// # Errors
/// See [`RenderError`].
pub(in crate::evaluate) fn check_source(
    prediction: &GaussianPrediction,
    source: &CheckedSource<'_>,
    renderer: &SharedRenderer,
) -> Result<SourceFacts, RenderError> {
    let (camera, photograph) = (source.camera, source.photograph);
    let as_given = placed(prediction.space, camera, camera);
    let output = renderer.render(
        &prediction.gaussians,
        as_given,
        camera.intrinsics,
        prediction.rule,
    )?;
    let whole = Region::whole(photograph.dimensions());
    let mean = Likeness::of(photograph, whole, photograph).mean_color();
    let mean = mean.map(|level| match output.blending {
        ColorSpace::Linear => linear_from_srgb(level as f32 / 255.0),
        ColorSpace::Srgb => level as f32 / 255.0,
    });
    let seen = SeenSource {
        picture: renderer.picture(&output),
        depth: surface_depth(&output),
        over_mean: output.srgb8(Background::Color(mean), Quantization::Round),
    };
    let [as_seen, true_one] = [&seen.picture, photograph].map(|p| Picture::Rgb8(p.clone()));
    let likeness = psnr(&as_seen, &true_one, source.valid).map_or(0.0, |psnr| psnr.min(100.0));
    let measured = [
        (SOURCE_DEPTH, median_depth_m(&seen.depth)),
        (SOURCE_PSNR, Some(likeness)),
        (SOURCE_BLUR, blur(photograph, &seen.picture)),
    ];
    let measured = measured.into_iter();
    let extras = measured.filter_map(|(name, value)| Some((name.to_owned(), value?)));
    let mut facts = SourceFacts {
        extras: extras.collect(),
        warnings: prediction.warnings.clone(),
    };
    let counts =
        |mask: &Mask| mask.count() as f64 >= LEAST_VALID * photograph.pixels().len() as f64;
    let Some(reading) = prediction
        .reading
        .filter(|_| source.valid.is_none_or(counts))
    else {
        return Ok(facts);
    };
    let trial = Trial {
        source: camera,
        photograph,
        region: window(photograph),
        renderer,
        rule: prediction.rule,
    };
    for topic in prediction.warnings.keys() {
        let mut other = reading;
        if let Some((key, value)) = topic.split_once('=')
            && other.set(key, value).is_ok()
            && !trial.allows(&other, &prediction.gaussians, &reading)?
        {
            facts.warnings.remove(topic);
        }
    }
    if source.is_chosen && photograph.pixels().len() >= FEWEST_PIXELS {
        add_doubts(
            &mut facts.warnings,
            prediction,
            &reading,
            &seen,
            source,
            &trial,
        )?;
    }
    Ok(facts)
}

/// Names (`dataset/scene/source`) of the sources for which other readings are tried: the first,
/// middle and last of each dataset. `pairs` must be all pairs of the plan, so that all shards
/// choose the same sources.
pub(in crate::evaluate) fn checked_sources(pairs: &[ResolvedPair<'_>]) -> BTreeSet<String> {
    let mut sources: BTreeMap<&str, BTreeSet<&str>> = BTreeMap::new();
    for ResolvedPair { pair, scene, .. } in pairs {
        let name = source_of(&pair.pair_id);
        sources.entry(&scene.dataset).or_default().insert(name);
    }
    let chosen = sources.into_values().flat_map(|names| {
        let names: Vec<&str> = names.into_iter().collect();
        [0, names.len() / 2, names.len() - 1].map(|at| names[at].to_owned())
    });
    chosen.collect()
}

/// A warning that rendering will take very long.
pub(in crate::evaluate) fn absurd_coverage(
    prediction: &GaussianPrediction,
    source: &PosedCamera,
) -> Option<(String, String)> {
    let placed = placed(prediction.space, source, source);
    let seen = Seen::of(&prediction.gaussians, placed, &source.intrinsics);
    let share = seen.layers / seen.members.len().max(1) as f64;
    if prediction.reading.is_none() || seen.layers < ABSURD_LAYERS || share < ABSURD_SHARE {
        return None;
    }
    let scales = &prediction.gaussians.scales;
    let widest = |&k: &usize| f64::from(scales[k].into_iter().fold(0.0, f32::max));
    let middle = median_of(seen.members.iter().map(widest).collect());
    let text = format!(
        "{:.0} of its Gaussians cover a pixel on average (half of them are wider than {:.3}), \
         which takes very long to render; are the scales linear (`scales=linear`) or in another \
         unit (`scale=`)? ({})",
        seen.layers,
        middle.unwrap_or_default(),
        source.id
    );
    Some(("coverage".to_owned(), text))
}

/// Warns if another reading or another view's photograph matches significantly better, if another unit matches the
/// depth, or if nothing matches.
fn add_doubts(
    warnings: &mut BTreeMap<String, String>,
    prediction: &GaussianPrediction,
    reading: &FileReading,
    seen: &SeenSource,
    source: &CheckedSource<'_>,
    trial: &Trial<'_>,
) -> Result<(), RenderError> {
    let (camera, photograph) = (source.camera, source.photograph);
    let id = &camera.id;
    let region = trial.region;
    let [shown, part] = [&seen.picture, photograph]
        .map(|whole| crop_imm(whole, region.x, region.y, region.width, region.height).to_image());
    let as_read = Likeness::of(photograph, region, &shown);
    let center = trial.principal_point();
    let zoom = |along| zoom(photograph, &seen.picture, center, along);
    let moves = Moves {
        aside: shift(&part, &shown),
        zooms: [[1, 1], [0, 1], [1, 0]]
            .into_iter()
            .filter_map(zoom)
            .collect(),
    };
    let is_lost = shows_nothing(photograph, &seen.over_mean);
    let of_part = match (region.width, region.height) == photograph.dimensions() {
        true => String::new(),
        false => format!("{}x{} pixels of ", region.width, region.height),
    };
    let shown = format!(
        "its Gaussians show {of_part}the photograph they were predicted from at {:.2} dB PSNR ({id})",
        as_read.psnr()
    );
    let gaussians = &prediction.gaussians;
    let others = other_views(camera, source.scene, photograph.dimensions());
    let elsewhere: Vec<Trial<'_>> = others
        .iter()
        .map(|(source, photograph)| Trial {
            source,
            photograph,
            ..*trial
        })
        .collect();
    let own = reading.placement.camera_from_file(camera);
    let compared = trial.fit(gaussians, own)?;
    let compared = compared.as_ref().unwrap_or(&as_read);
    let better = match as_read.psnr() < RIGHT_DB {
        true => trial.best_reading(gaussians, reading, compared, &elsewhere, &moves, is_lost)?,
        false => None,
    };
    let better = match better {
        Some((other, fit)) if is_confirmed(trial, gaussians, reading, &other)? => {
            Some((other, fit))
        }
        _ => None,
    };
    let other = other_view(prediction, reading, &elsewhere, compared)?;
    let is_other = |error: f64| other.as_ref().is_some_and(|(_, fit)| fit.error() < error);
    match (&better, &other) {
        (Some((other, fit)), _) if !is_other(fit.error()) => {
            let settings = other.changes_from(reading).into_iter();
            let settings: Vec<String> = settings.map(|(k, v)| format!("{k}={v}")).collect();
            let named = format!("`{}`", settings.join("` and `"));
            let text = format!("{shown}; with {named}: {:.2} dB", fit.psnr());
            // If a setting fixes only half of the problem, report it once, together with the other
            // half.
            let half = settings
                .iter()
                .find(|s| prediction.warnings.contains_key(*s));
            let half = half.filter(|_| settings.len() > 1);
            let about = half.map_or("reading", String::as_str).to_owned();
            warnings.insert(about, text);
        }
        (_, Some((view, fit))) => {
            let text = format!(
                "{shown}, and that of {} at {:.2} dB: do the files have the names of other views?",
                view.id,
                fit.psnr()
            );
            warnings.insert("view".to_owned(), text);
        }
        _ if is_lost => {
            let text = format!(
                "{shown}, so it is hardly recognisable, and no other reading that was tried is \
                 better"
            );
            warnings.insert("unrelated".to_owned(), text);
        }
        _ => {}
    }
    if better.is_none()
        && (reading.placement.space != FileSpace::World || as_read.explains())
        && let Some(truth) = source.depth
        && let Some((factor, mut text)) =
            depth_doubt(truth, &seen.depth, reading.placement.scale, id)
    {
        if let Some(factor) = factor
            && let Some(fit) = trial.fit_with_widths(gaussians, factor, reading, compared)?
        {
            text += &format!(
                "; but only their means have that unit: {shown}, and with standard deviations {} times as wide: {:.2} dB; \
                 `scale=` multiplies both, so write the file with both in one unit",
                rounded(factor),
                fit.psnr()
            );
        }
        warnings.insert("scale".to_owned(), text);
    }
    Ok(())
}

/// Whether another reading, found on a part of the photograph, is better on the whole.
fn is_confirmed(
    trial: &Trial<'_>,
    gaussians: &Gaussians,
    reading: &FileReading,
    other: &FileReading,
) -> Result<bool, RenderError> {
    let whole = trial.whole();
    let [as_read, other] = [reading, other].map(|to| whole.fit_read(gaussians, reading, to));
    let (Some(as_read), Some(other)) = (as_read?, other?) else {
        return Ok(true);
    };
    Ok(other.error() < as_read.error())
}

/// Whether Gaussians over the photograph's mean colour are no closer to the photograph than the
/// colour alone. Correct Gaussians are closer, even if blurred or sparse.
fn shows_nothing(photograph: &RgbImage, over_mean: &RgbImage) -> bool {
    let whole = Region::whole(photograph.dimensions());
    Likeness::of(photograph, whole, over_mean).is_unrelated()
}

/// Other views of the scene whose photographs have the same size: the neighbours of a view, and the
/// one at the mirrored position in the scene's order.
fn other_views(
    source: &PosedCamera,
    scene: &Scene,
    size: (u32, u32),
) -> Vec<(PosedCamera, RgbImage)> {
    let Some(at) = scene.views.iter().position(|view| view.id == source.id) else {
        return Vec::new();
    };
    let mirrored = scene.views.len() - 1 - at;
    let others = [at.checked_sub(1), Some(at + 1), Some(mirrored)];
    let others: BTreeSet<usize> = others.into_iter().flatten().filter(|&k| k != at).collect();
    let views = others.into_iter().filter_map(|k| scene.views.get(k));
    let read = views.filter_map(|view| {
        // If a photograph is unreadable, its own pairs report it.
        let photograph = view.content.image().ok()?;
        Some((PosedCamera::from(view), photograph))
    });
    read.filter(|(_, photograph)| photograph.dimensions() == size)
        .collect()
}

/// The view whose photograph the Gaussians explain significantly better than the photograph of
/// their own source.
fn other_view<'a>(
    prediction: &GaussianPrediction,
    reading: &FileReading,
    others: &[Trial<'a>],
    as_read: &Likeness,
) -> Result<Option<(&'a PosedCamera, Likeness)>, RenderError> {
    let mut best: Option<(&PosedCamera, Likeness)> = None;
    if reading.placement.space == FileSpace::World {
        return Ok(best);
    }
    for trial in others {
        let placed = reading.placement.camera_from_file(trial.source);
        if let Some(fit) = trial.fit(&prediction.gaussians, placed)?
            && fit.is_better_than(as_read)
            && best
                .as_ref()
                .is_none_or(|(_, known)| fit.error() < known.error())
        {
            best = Some((trial.source, fit));
        }
    }
    Ok(best)
}

/// Warns if rendered depth has another unit than true depth, or is its inverse, and prediction errors do not explain
/// this. Of another unit, also how many times the true depth is seen.
fn depth_doubt(
    truth: &DepthMap,
    seen: &DepthMap,
    scale: f64,
    id: &str,
) -> Option<(Option<f64>, String)> {
    if truth.dimensions() != seen.dimensions() {
        return None;
    }
    // About ten thousand pixels are enough.
    let step = (truth.as_raw().len() / 10_000).max(1);
    let both = truth.pixels().zip(seen.pixels()).step_by(step);
    let both: Vec<[f64; 2]> = both
        .filter(|(Luma([t]), Luma([s]))| is_valid_depth(*t) && is_valid_depth(*s))
        .map(|(Luma([t]), Luma([s]))| [f64::from(*t).ln(), f64::from(*s).ln()])
        .collect();
    if both.len() < 20 {
        return None;
    }
    let middle_and_spread = |power: f64| {
        let ratios: Vec<f64> = both.iter().map(|[t, s]| t - power * s).collect();
        let middle = median_of(ratios.clone())?;
        let spread = median_of(ratios.iter().map(|r| (r - middle).abs()).collect())?;
        Some((middle, spread))
    };
    let ((middle, spread), (_, of_inverse)) = (middle_and_spread(1.0)?, middle_and_spread(-1.0)?);
    if of_inverse * INVERSE_SIGNIFICANCE < spread {
        let text = format!(
            "its Gaussians are far where the dataset's depth is near, and near where it is far \
             ({id}): inverse depth was probably mistaken for depth, which no setting corrects"
        );
        return Some((None, text));
    }
    let is_unit = middle.abs() > LEAST_FACTOR.ln().max(FACTOR_SIGNIFICANCE * 1.4826 * spread);
    is_unit.then(|| {
        let factor = (-middle).exp();
        let text = format!(
            "its Gaussians are {factor:.3} times as far away as the dataset's depth ({id}): use `scale={}`, or \
             `depth=privileged` if each source has its own unit",
            rounded(scale / factor)
        );
        (Some(factor), text)
    })
}

fn rounded(value: f64) -> f64 {
    format!("{value:.2e}").parse().unwrap_or(value)
}

#[cfg(test)]
mod tests {
    use glam::{DAffine3, DMat3, DVec3};
    use sharp::camera::{Intrinsics, RigidTransform};
    use sharp::color::srgb_from_linear;
    use sharp::gaussians::Gaussians;

    use super::*;
    use crate::evaluate::doubts::doubts_of;
    use crate::methods::{GaussianSpace, TrueDepth};

    fn source() -> PosedCamera {
        // Turned about the vertical axis and moved, so that world space and camera space differ.
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

    /// A wall of coloured Gaussians in camera space, 2 m in front of the camera: one per pixel, all
    /// at different depths.
    fn wall() -> Gaussians {
        let k = source().intrinsics;
        let mut wall = Gaussians::default();
        for y in 0..k.height {
            for x in 0..k.width {
                let at = |p: u32, c: f64, f: f64| (2.0 * (f64::from(p) + 0.5 - c) / f) as f32;
                let place = sharp::random::mix(u64::from(y * k.width + x)) % 4096;
                let z = 2.0 + (place as f32 - 2048.0) * 2.5e-7;
                wall.means.push([at(x, k.cx, k.fx), at(y, k.cy, k.fy), z]);
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
        let point = |m: &[f32; 3]| map.transform_point3(DVec3::from(m.map(f64::from)));
        Gaussians {
            means: gaussians
                .means
                .iter()
                .map(|m| point(m).as_vec3().to_array())
                .collect(),
            // Gaussians are spherical, so rotations do not change them.
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

    /// The wall as seen by the source's camera.
    fn photograph() -> RgbImage {
        let (round, renderer) = (mapped(&wall(), DAffine3::IDENTITY), SharedRenderer::cpu());
        let truth = renderer.render(&round, DAffine3::IDENTITY, source().intrinsics, None);
        renderer.picture(&truth.unwrap())
    }

    fn doubt_about(gaussians: Gaussians) -> Option<String> {
        doubt_about_read(gaussians, FileReading::of_arrays())
    }

    /// Like [`doubt_about_read`], for Gaussians in world space.
    fn doubt_about_world(gaussians: Gaussians, reading: FileReading) -> Option<String> {
        let map = reading.placement.camera_from_file(&source());
        doubt_of(
            &source(),
            GaussianSpace::Camera(map),
            &photograph(),
            gaussians,
            reading,
            None,
        )
    }

    fn doubt_about_read(gaussians: Gaussians, reading: FileReading) -> Option<String> {
        doubt_beside(&photograph(), gaussians, reading, None)
    }

    /// `suggested` is a setting that the numbers suggest.
    fn doubt_beside(
        photograph: &RgbImage,
        gaussians: Gaussians,
        reading: FileReading,
        suggested: Option<&str>,
    ) -> Option<String> {
        doubt_of(
            &source(),
            GaussianSpace::CAMERA,
            photograph,
            gaussians,
            reading,
            suggested,
        )
    }

    fn doubt_of(
        source: &PosedCamera,
        space: GaussianSpace,
        photograph: &RgbImage,
        gaussians: Gaussians,
        reading: FileReading,
        suggested: Option<&str>,
    ) -> Option<String> {
        let renderer = SharedRenderer::cpu();
        let prediction = GaussianPrediction {
            rule: reading.rule,
            rule_note: None,
            gaussians,
            space,
            first_layer: None,
            extras: BTreeMap::new(),
            reading: Some(reading),
            warnings: suggested
                .map(|setting| (setting.to_owned(), format!("suggested: {setting}")))
                .into_iter()
                .collect(),
        };
        let depth = DepthMap::from_pixel(40, 32, Luma([2.0]));
        let pairing = sharp_datasets::Pairing::MultiView;
        let scene = Scene::new("m", "s", Vec::new(), pairing);
        let checked = CheckedSource {
            camera: source,
            photograph,
            valid: None,
            depth: Some(&depth),
            scene: &scene,
            is_chosen: true,
        };
        let mut record = crate::evaluate::record::tests::record();
        record.median_depth_m = Some(2.0);
        let facts = check_source(&prediction, &checked, &renderer).unwrap();
        (record.warnings, record.extras) = (facts.warnings, facts.extras);
        let found = doubts_of([&record].into_iter(), "gaussians", TrueDepth::None);
        (!found.is_empty()).then(|| found.join("; "))
    }

    #[test]
    fn a_wrong_frame_colour_space_or_unit_is_named_and_a_right_one_is_not() {
        let round = mapped(&wall(), DAffine3::IDENTITY);
        assert_eq!(doubt_about(round.clone()), None);
        let gl = DAffine3::from_mat3(DMat3::from_diagonal(DVec3::new(1.0, -1.0, -1.0)));
        let world = source().camera_from_world.to_affine().inverse();
        let normalized = placed(GaussianSpace::Normalized, &source(), &source()).inverse();
        let millimetres = DAffine3::from_scale(DVec3::splat(1000.0));
        let in_millimetres = Gaussians {
            scales: vec![[30.0; 3]; round.len()],
            ..mapped(&round, millimetres)
        };
        let in_millimetres_too = in_millimetres.clone();
        let in_feet = Gaussians {
            scales: vec![[0.1; 3]; round.len()],
            ..mapped(&round, DAffine3::from_scale(DVec3::splat(1.0 / 0.3)))
        };
        let mut bgr = round.clone();
        bgr.colors.iter_mut().for_each(|color| color.reverse());
        let in_normalized = Gaussians {
            scales: vec![[0.06, 0.075, 0.03]; round.len()],
            ..mapped(&round, normalized)
        };
        for (gaussians, words) in [
            (mapped(&round, gl), "with `axes=rub`: "),
            (mapped(&round, world), "with `space=world`: "),
            (in_normalized, "with `space=normalized`: "),
            (
                recolored(&round, srgb_from_linear),
                "with `color_space=srgb`: ",
            ),
            (
                recolored(&mapped(&round, gl), srgb_from_linear),
                "with `color_space=srgb` and `axes=rub`: ",
            ),
            (
                in_millimetres,
                "times as far away as the dataset's depth (s): use `scale=0.001`",
            ),
            (in_feet, "use `scale=0.3`"),
            (bgr, "with `channels=bgr`: "),
            (
                recolored(&round, |_| 0.9),
                "no other reading that was tried",
            ),
            // Reporting one doubt does not hide another.
            (recolored(&in_millimetres_too, |_| 0.9), "times as far away"),
        ] {
            let said = doubt_about(gaussians).unwrap_or_default();
            assert!(said.contains(words), "{words}: {said}");
        }
    }

    /// Colours stored in another form than as coefficients, as in a PLY read without a setting.
    #[test]
    fn colours_of_another_form_are_named() {
        let mut reading = FileReading::of_arrays();
        reading.stored.colors = Some(sharp::ply::StoredColors::Dc);
        let read_as_dc = |store: fn(f32) -> f32| {
            let mut stored = recolored(&mapped(&wall(), DAffine3::IDENTITY), store);
            reading.stored.decode(&mut stored);
            doubt_about_read(stored, reading).unwrap_or_default()
        };
        for (store, words) in [
            ((|c| c * 255.0) as fn(f32) -> f32, "with `colors=rgb255`: "),
            (|c| c, "with `colors=rgb01`: "),
            (|c| c / 0.282_094_79, "with `colors=dc-uncentered`: "),
        ] {
            let said = read_as_dc(store);
            assert!(said.contains(words), "{words}: {said}");
        }
        assert_eq!(read_as_dc(|c| (c - 0.5) / 0.282_094_79), "");
    }

    #[test]
    fn what_numbers_suggest_is_told_where_the_photograph_does_not_refute_it() {
        let round = mapped(&wall(), DAffine3::IDENTITY);
        let mut dc = FileReading::of_arrays();
        dc.stored.colors = Some(sharp::ply::StoredColors::Dc);
        let rgb01 = Some("colors=rgb01");
        // A pastel wall, whose coefficients are all in 0..1.
        let pastel = recolored(&round, |c| 0.5 + 0.28 * c);
        let seen = SharedRenderer::cpu();
        let shown = seen.render(&pastel, DAffine3::IDENTITY, source().intrinsics, None);
        let shown = seen.picture(&shown.unwrap());
        assert_eq!(doubt_beside(&shown, pastel, dc, rgb01), None);
        let mut misread = round.clone();
        dc.stored.decode(&mut misread);
        let said = doubt_beside(&photograph(), misread, dc, rgb01).unwrap();
        assert!(
            said.contains("suggested: ") && said.contains("with `colors=rgb01`: "),
            "{said}"
        );
        // If two settings are needed, one sentence has both.
        let bytes = recolored(&round, |c| 255.0 * srgb_from_linear(c));
        let arrays = FileReading::of_arrays();
        let said = doubt_beside(&photograph(), bytes, arrays, Some("colors=rgb255")).unwrap();
        assert!(
            said.contains("with `color_space=srgb` and `colors=rgb255`: "),
            "{said}"
        );
        assert!(!said.contains("suggested"), "{said}");
    }

    #[test]
    fn variances_and_another_focal_length_are_named() {
        let round = mapped(&wall(), DAffine3::IDENTITY);
        let mut logs = FileReading::of_arrays();
        logs.stored.scales = Some(sharp::ply::StoredScales::Log);
        assert_eq!(doubt_about_read(round.clone(), logs), None);
        let mut squared = round.clone();
        squared.scales.fill([0.03 * 0.03; 3]);
        let said = doubt_about_read(squared, logs).unwrap_or_default();
        assert!(said.contains("with `scales=log-variance`: "), "{said}");
        let narrow = DAffine3::from_scale(DVec3::new(0.8, 0.8, 1.0));
        let said = doubt_about(mapped(&round, narrow)).unwrap_or_default();
        assert!(said.contains("with `focal=1.2"), "{said}");
        let low = DAffine3::from_scale(DVec3::new(1.0, 0.8, 1.0));
        let said = doubt_about(mapped(&round, low)).unwrap_or_default();
        assert!(said.contains("with `focal=1:1.2"), "{said}");
    }

    #[test]
    fn means_rescaled_without_their_deviations_are_named() {
        let mut near = mapped(&wall(), DAffine3::from_scale(DVec3::splat(0.25)));
        let said = doubt_about(near.clone()).unwrap_or_default();
        assert!(said.contains("only their means have that unit"), "{said}");
        near.scales.fill([0.0075; 3]);
        let said = doubt_about(near).unwrap_or_default();
        assert!(
            said.contains("use `scale=4`") && !said.contains("only their means"),
            "{said}"
        );
    }

    /// An odd principal point, under a rule that ignores it; and Gaussians that are too wide, which other rotations
    /// would narrow.
    #[test]
    fn an_ignored_principal_point_is_named_and_wide_gaussians_are_not_called_turned() {
        for off in [[6.0, 0.0], [2.0, -2.0]] {
            ignored_and_wide(off);
        }
    }

    fn ignored_and_wide([x, y]: [f64; 2]) {
        let mut aside = source();
        aside.intrinsics.cx += x;
        aside.intrinsics.cy += y;
        let mut wide = Gaussians::default();
        let (k, base) = (aside.intrinsics, wall());
        for (at, color) in base.colors.iter().enumerate() {
            let (x, y) = (at as u32 % k.width, at as u32 / k.width);
            let place = |p: u32, c: f64, f: f64| (2.0 * (f64::from(p) + 0.5 - c) / f) as f32;
            wide.means.push([
                place(x, k.cx, k.fx),
                place(y, k.cy, k.fy),
                base.means[at][2],
            ]);
            // Discs that face the camera, rolled about its axis.
            let roll = at as f32;
            wide.quaternions.push([roll.cos(), 0.0, 0.0, roll.sin()]);
            wide.scales.push([0.09, 0.06, 1e-3]);
            wide.opacities.push(0.6);
            wide.colors.push(color.map(srgb_from_linear));
        }
        let mut reading = FileReading::of_arrays();
        reading.stored.blending = ColorSpace::Srgb;
        reading.rule = Some(sharp::render::Rule::INRIA_GENERAL);
        let round = {
            let mut round = wide.clone();
            round.scales.fill([0.03; 3]);
            round.opacities.fill(0.95);
            round
        };
        let renderer = SharedRenderer::cpu();
        let shown = renderer
            .render(&round, DAffine3::IDENTITY, k, reading.rule)
            .unwrap();
        let shown = renderer.picture(&shown);
        let said = |gaussians: &Gaussians, reading: FileReading| {
            doubt_of(
                &aside,
                GaussianSpace::CAMERA,
                &shown,
                gaussians.clone(),
                reading,
                None,
            )
        };
        assert_eq!(said(&round, reading), None);
        let about_wide = said(&wide, reading).unwrap_or_default();
        assert!(!about_wide.contains("quaternions="), "{about_wide}");
        reading.rule = Some(sharp::render::Rule::INRIA);
        let text = said(&round, reading).unwrap_or_default();
        assert!(text.contains("with `rendering=inria-general`: "), "{text}");
    }

    /// Axes of no known program: x forward, y right, z down.
    #[test]
    fn unusual_axes_and_units_of_a_world_are_named() {
        let round = mapped(&wall(), DAffine3::IDENTITY);
        let turned = DMat3::from_cols(DVec3::Y, DVec3::Z, DVec3::X);
        let said = doubt_about(mapped(&round, DAffine3::from_mat3(turned))).unwrap_or_default();
        assert!(said.contains("with `axes=frd`: "), "{said}");
        let world_from_camera = source().camera_from_world.inverse().to_affine();
        let millimetres = DAffine3::from_scale(DVec3::splat(1000.0)) * world_from_camera;
        let mut world = mapped(&round, millimetres);
        world.scales.fill([30.0; 3]);
        let mut reading = FileReading::of_arrays();
        reading.placement.space = FileSpace::World;
        let said = doubt_about_world(world, reading).unwrap_or_default();
        assert!(said.contains("with `scale=0.001`: "), "{said}");
    }

    #[test]
    fn inverse_depth_is_told_and_errors_of_depth_are_not() {
        let map =
            |of: fn(f32) -> f32| DepthMap::from_fn(40, 32, |x, y| Luma([of((x * 32 + y) as f32)]));
        let truth = map(|at| 1.0 + at / 100.0);
        let said =
            |seen: fn(f32) -> f32| depth_doubt(&truth, &map(seen), 1.0, "s").map(|found| found.1);
        let text = said(|at| 3.0 / (1.0 + at / 100.0)).unwrap_or_default();
        assert!(text.contains("inverse depth"), "{text}");
        for proper in [
            (|at| 1.0 + at / 100.0) as fn(f32) -> f32,
            |at| 1.2 + at / 150.0 + 0.5 * (at * 7.0).sin(),
            |_| 3.0,
            |at| 4.0 + (at * 7.0).sin(),
        ] {
            assert_eq!(said(proper), None);
        }
    }

    #[test]
    fn few_or_blurred_gaussians_show_something_and_plain_ones_do_not() {
        let round = mapped(&wall(), DAffine3::IDENTITY);
        let said = |gaussians: Gaussians| doubt_about(gaussians).unwrap_or_default();
        let nothing = "so it is hardly recognisable";
        // One Gaussian in forty; the rest of the picture stays black.
        let few = round.filtered(|k| k % 41 == 0);
        assert!(
            !said(few.clone()).contains(nothing),
            "{}",
            said(few.clone())
        );
        let mut blurred = round.filtered(|k| k % 5 == 0);
        blurred.scales.fill([0.25; 3]);
        let text = said(blurred);
        assert!(!text.contains(nothing), "{text}");
        // The same with encoded colours.
        let mut encoded = FileReading::of_arrays();
        encoded.stored.blending = ColorSpace::Srgb;
        encoded.rule = Some(sharp::render::Rule::GSPLAT_1_5_3_CLASSIC);
        let text = doubt_about_read(recolored(&few, srgb_from_linear), encoded);
        let text = text.unwrap_or_default();
        assert!(!text.contains(nothing), "{text}");
        // A uniform wall, which may have the photograph's own colour, and Gaussians that are not
        // visible.
        let (seen, whole) = (photograph(), Region::whole((40, 32)));
        let own = Likeness::of(&seen, whole, &seen).mean_color();
        let own = own.map(|v| linear_from_srgb(v as f32 / 255.0));
        let mut plain = round.clone();
        plain.colors.fill(own);
        assert!(said(plain).contains(nothing));
        assert!(said(recolored(&round, |_| 0.2)).contains(nothing));
        let mut aside = round.clone();
        aside.means.iter_mut().for_each(|mean| mean[1] += 50.0);
        assert!(said(aside).contains(nothing));
    }
}
