//! Compares Gaussians with the photograph that they were predicted from and, if they do not show it, tries other readings
//! of their file.
//!
//! A wrong frame, unit, encoding or colour space gives bad scores without an error. Renderings
//! from the source's own camera reveal it, except a scale about that camera, so the rendered depth is recorded too. Other
//! readings of foreign files are tried (`doubts_about`) for three sources of each dataset, chosen by the list of pairs
//! alone; this costs as much as some small pictures.

use std::collections::{BTreeMap, BTreeSet};

use image::imageops::crop_imm;
use image::{Luma, RgbImage};
use sharp::color::{Quantization, linear_from_srgb};
use sharp::render::{Background, RenderError};
use sharp_datasets::{DepthMap, Scene};
use sharp_metrics::{Picture, psnr};

use super::likeness::{Likeness, window};
use super::record::Record;
use super::render::{placed, surface_depth};
use super::rereading::{Seen, Trial};
use crate::methods::file_reading::{FileReading, FileSpace};
use crate::methods::{GaussianPrediction, Privilege, UNUSABLE};
use crate::pairs::PosedCamera;
use crate::pairs::depth::median_depth_m;
use crate::pairs::pair_list::ResolvedPair;
use crate::pairs::valid_depth::{is_valid_depth, median_of};
use crate::rendering::SharedRenderer;
use crate::scoring::Region;

/// The extra that holds the PSNR of the source's photograph and its rendering, dB; 100 at most, so that it is a number.
pub const SOURCE_PSNR: &str = "source_psnr";
/// The extra that holds the median depth of the rendering of the source, metres.
pub const SOURCE_DEPTH: &str = "source_depth_m";

/// Ratio of seen to true depth beyond which metres are doubted.
const UNLIKELY_SCALE: f64 = 10.0;
/// Factor of depth above which another unit is thinkable at all: predictions without a unit are off by less.
const LEAST_FACTOR: f64 = 1.5;
/// Least ratio of a factor to the spread of depth ratios, which a prediction's own errors cause.
const FACTOR_SIGNIFICANCE: f64 = 10.0;
/// Fewest sources of a scene or dataset among which outliers are sought: of fewer, other readings are tried for most anyway.
const FEWEST_SOURCES: usize = 4;
/// dB between wrong sources and the others: half of a photograph explained against an unrelated picture of its variance.
const LEAST_GAP: f64 = 6.0;
/// Least ratio of that gap to the distance from the worst to the middle of the others: normal values seldom leave such a gap.
const GAP_SIGNIFICANCE: f64 = 2.0;
/// Upper limit of an outlier where scenes differ, dB: the PSNR of the mean colour at a contrast of 45 levels.
const UNLIKE_ANY_SCENE: f64 = 15.0;
/// Outlying sources that are named.
const MOST_NAMED: usize = 8;

/// Boxes of Gaussians over a pixel beyond which rendering takes minutes: scenes of photographs have tens or hundreds.
const ABSURD_LAYERS: f64 = 5000.0;
/// The share of the picture that they cover one by one, then: millions of small ones over a small picture are proper.
const ABSURD_SHARE: f64 = 0.02;

/// A prediction rendered into its own source.
pub(super) struct SeenSource {
    /// [`SOURCE_PSNR`] and [`SOURCE_DEPTH`].
    pub(super) extras: BTreeMap<String, f64>,
    picture: RgbImage,
    depth: DepthMap,
    /// The picture where the photograph's mean colour lies behind the Gaussians: what is closer to it shows some of it.
    over_mean: RgbImage,
}

/// Renders a prediction into its own source.
///
/// # Errors
/// See [`RenderError`].
pub(super) fn see_source(
    prediction: &GaussianPrediction,
    source: &PosedCamera,
    photograph: &RgbImage,
    renderer: &SharedRenderer,
) -> Result<SeenSource, RenderError> {
    let mut extras = BTreeMap::new();
    let as_given = placed(prediction.space, source, source);
    let output = renderer.render(&prediction.gaussians, as_given, source.intrinsics)?;
    let depth = surface_depth(&output);
    if let Some(depth) = median_depth_m(&depth) {
        extras.insert(SOURCE_DEPTH.to_owned(), depth);
    }
    let picture = renderer.picture(&output);
    let whole = Region::whole(photograph.dimensions());
    let mean = Likeness::of(photograph, whole, photograph).mean_color();
    let mean = mean.map(|level| linear_from_srgb(level as f32 / 255.0));
    let over_mean = output.srgb8(Background::Color(mean), Quantization::Round);
    let likeness = psnr(
        &Picture::Rgb8(picture.clone()),
        &Picture::Rgb8(photograph.clone()),
        None,
    );
    let likeness = likeness.map_or(0.0, |psnr| psnr.min(100.0));
    extras.insert(SOURCE_PSNR.to_owned(), likeness);
    Ok(SeenSource {
        extras,
        picture,
        depth,
        over_mean,
    })
}

/// Names (`dataset/scene/source`) of the sources whose files are read otherwise, too: the first, the middle and the last of
/// each dataset. All pairs of the plan have to be given, so that shards choose alike.
pub(super) fn checked_sources(pairs: &[ResolvedPair<'_>]) -> BTreeSet<String> {
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

/// `dataset/scene/source` of a pair's id.
pub(super) fn source_of(pair_id: &str) -> &str {
    // Ids encode underscores that would form a second separator.
    pair_id.split("__").next().unwrap_or(pair_id)
}

/// Why rendering a prediction would take very long, before it is done.
pub(super) fn absurd_coverage(
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
        "{:.0} of its Gaussians cover a pixel on average (half of them are wider than {:.3}), which takes very long to render: \
         scales that are no logarithms (`scales=linear`), or another unit (`scale=`)? ({})",
        seen.layers,
        middle.unwrap_or_default(),
        source.id
    );
    Some(("coverage".to_owned(), text))
}

/// A source whose file is read otherwise.
pub(super) struct CheckedSource<'a> {
    pub(super) camera: &'a PosedCamera,
    pub(super) photograph: &'a RgbImage,
    /// True depth, where there is some and the method is not scaled to it.
    pub(super) depth: Option<&'a DepthMap>,
    pub(super) scene: &'a Scene,
}

/// Doubts about the reading of a prediction's file, by subject: another reading, or another view's photograph, fits the
/// source significantly better, another unit fits its depth, or nothing fits.
///
/// # Errors
/// See [`RenderError`].
pub(super) fn doubts_about(
    prediction: &GaussianPrediction,
    reading: &FileReading,
    seen: &SeenSource,
    source: &CheckedSource<'_>,
    renderer: &SharedRenderer,
) -> Result<BTreeMap<String, String>, RenderError> {
    let mut doubts = BTreeMap::new();
    let mut doubt = |about: &str, text: String| doubts.insert(about.to_owned(), text);
    let (camera, photograph) = (source.camera, source.photograph);
    let id = &camera.id;
    let trial = Trial {
        source: camera,
        photograph,
        region: window(photograph),
        renderer,
    };
    let region = trial.region;
    let part = crop_imm(
        &seen.picture,
        region.x,
        region.y,
        region.width,
        region.height,
    );
    let as_read = Likeness::of(photograph, region, &part.to_image());
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
            ..trial
        })
        .collect();
    let own = reading.placement.camera_from_file(camera);
    let compared = trial.fit(gaussians, own)?;
    let compared = compared.as_ref().unwrap_or(&as_read);
    let better = trial.best_reading(gaussians, reading, compared, &elsewhere)?;
    let other = other_view(prediction, reading, &elsewhere, compared)?;
    let is_other = |error: f64| other.as_ref().is_some_and(|(_, fit)| fit.error() < error);
    match (&better, &other) {
        (Some((other, fit)), _) if !is_other(fit.error()) => {
            let settings = other.changes_from(reading).into_iter();
            let settings: Vec<String> = settings.map(|(k, v)| format!("`{k}={v}`")).collect();
            let settings = settings.join(" and ");
            doubt(
                "reading",
                format!("{shown}; with {settings}: {:.2} dB", fit.psnr()),
            );
        }
        (_, Some((view, fit))) => {
            doubt(
                "view",
                format!(
                    "{shown}, and that of {} at {:.2} dB: files under the names of other views?",
                    view.id,
                    fit.psnr()
                ),
            );
        }
        _ if shows_nothing(photograph, &seen.over_mean) => {
            let text = format!(
                "{shown}, hardly anything of it, and no reading that was tried shows it better"
            );
            doubt("unrelated", text);
        }
        _ => {}
    }
    if better.is_none()
        && reading.placement.space != FileSpace::World
        && let Some(factor) = source.depth.and_then(|truth| unit(truth, &seen.depth))
    {
        let scale = rounded(reading.placement.scale * factor);
        doubt(
            "scale",
            format!(
                "its Gaussians lie {:.3} times as far away as the dataset's depth ({id}): `scale={scale}` fits, or \
                 `depth=privileged` scales each source",
                factor.recip()
            ),
        );
    }
    Ok(doubts)
}

/// True if Gaussians, rendered over the photograph's mean colour, are no closer to the photograph than that colour alone.
/// Blurred or sparse Gaussians that are right come closer.
fn shows_nothing(photograph: &RgbImage, over_mean: &RgbImage) -> bool {
    let whole = Region::whole(photograph.dimensions());
    Likeness::of(photograph, whole, over_mean).is_unrelated()
}

/// The neighbours of a view in its scene and the view as far from the scene's other end, with photographs of its size.
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
        // A photograph that cannot be read is its own pairs' failure.
        let photograph = view.content.image().ok()?;
        Some((PosedCamera::from(view), photograph))
    });
    read.filter(|(_, photograph)| photograph.dimensions() == size)
        .collect()
}

/// The view whose photograph the Gaussians explain significantly better than their own source's, if they are taken for its.
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

/// The factor that brings depth that is seen to the truth, where it is another unit rather than the prediction's error.
fn unit(truth: &DepthMap, seen: &DepthMap) -> Option<f64> {
    if truth.dimensions() != seen.dimensions() {
        return None;
    }
    // Some ten thousand pixels are enough.
    let step = (truth.as_raw().len() / 10_000).max(1);
    let both = truth.pixels().zip(seen.pixels()).step_by(step);
    let ratios: Vec<f64> = both
        .filter(|(Luma([t]), Luma([s]))| is_valid_depth(*t) && is_valid_depth(*s))
        .map(|(Luma([t]), Luma([s]))| (f64::from(*t) / f64::from(*s)).ln())
        .collect();
    if ratios.len() < 20 {
        return None;
    }
    let middle = median_of(ratios.clone())?;
    let spread = median_of(ratios.iter().map(|r| (r - middle).abs()).collect())?;
    let is_unit = middle.abs() > LEAST_FACTOR.ln().max(FACTOR_SIGNIFICANCE * 1.4826 * spread);
    is_unit.then(|| middle.exp())
}

/// Three significant digits.
fn rounded(value: f64) -> f64 {
    format!("{value:.2e}").parse().unwrap_or(value)
}

/// Warnings about the Gaussians behind a record, by topic.
pub fn doubts(record: &Record, privilege: Privilege) -> BTreeMap<&str, String> {
    let extra = |name: &str| record.extras.get(name).copied();
    let source = &record.source;
    let mut doubts: BTreeMap<&str, String> = BTreeMap::new();
    for (name, what) in UNUSABLE {
        if let Some(count) = extra(name) {
            let text = format!("{count} of its Gaussians {what} and are not drawn ({source})");
            doubts.insert(name, text);
        }
    }
    let depths = extra(SOURCE_DEPTH).zip(record.median_depth_m);
    if let Some(ratio) = depths.map(|(seen, true_depth)| seen / true_depth)
        && !(UNLIKELY_SCALE.recip()..=UNLIKELY_SCALE).contains(&ratio)
        && privilege == Privilege::None
    {
        doubts.insert(
            "scale",
            format!(
                "its Gaussians lie {ratio:.3} times as far away as the dataset's depth ({source}): metres are needed, or \
                 `depth=privileged` scales them"
            ),
        );
    }
    let told = record.warnings.iter();
    doubts.extend(told.map(|(about, text)| (about.as_str(), text.clone())));
    doubts
}

/// Sources of a method that are shown much worse than the others of their scene, or of their dataset where these also show
/// less than a plain colour would, as one sentence. Other readings are tried on three sources of a dataset alone, so wrong
/// files among the others show here.
pub(super) fn outlying_sources<'a>(
    records: impl Iterator<Item = &'a Record> + Clone,
    kind: &str,
) -> Option<String> {
    // These make their Gaussians of the photograph itself.
    if ["sharp", "depth-splat"].contains(&kind) {
        return None;
    }
    let scopes = [(true, f64::INFINITY), (false, UNLIKE_ANY_SCENE)];
    let found = scopes.into_iter().find_map(|(by_scene, most)| {
        let mut groups: BTreeMap<_, BTreeMap<&str, f64>> = BTreeMap::new();
        for record in records.clone() {
            if let Some(psnr) = record.extras.get(SOURCE_PSNR) {
                let scene = by_scene.then_some(&record.scene);
                let group = groups.entry((&record.dataset, scene)).or_default();
                group.insert(source_of(&record.pair_id), *psnr);
            }
        }
        let apart = groups.values().filter_map(|group| apart(group, most));
        apart.reduce(|all, more| [0, 1].map(|part| [&all[part][..], &more[part]].concat()))
    });
    let [mut worse, mut others] = found?;
    let count = worse.len() + others.len();
    let range = |part: &mut Vec<(&str, f64)>| {
        part.sort_by(|a, b| a.1.total_cmp(&b.1));
        format!("{:.1} to {:.1}", part[0].1, part[part.len() - 1].1)
    };
    let (of_worse, of_others) = (range(&mut worse), range(&mut others));
    let mut names: Vec<&str> = worse.iter().map(|(name, _)| *name).collect();
    names.sort_unstable();
    let more = match names.len().saturating_sub(MOST_NAMED) {
        0 => String::new(),
        more => format!(" and {more} more"),
    };
    names.truncate(MOST_NAMED);
    Some(format!(
        "{} of {count} sources show the photograph they were predicted from at {of_worse} dB, the others at {of_others}: \
         {}{more}; other Gaussians than theirs? (`gaussians info FILE` says what a file holds)",
        worse.len(),
        names.join(", ")
    ))
}

/// The values of a group that lie apart below the others and are at most `most`, half of them at most, and the others.
fn apart<'a>(group: &BTreeMap<&'a str, f64>, most: f64) -> Option<[Vec<(&'a str, f64)>; 2]> {
    let mut sources: Vec<(&str, f64)> = group.iter().map(|(name, v)| (*name, *v)).collect();
    sources.sort_by(|a, b| a.1.total_cmp(&b.1));
    let n = sources.len();
    let psnr = |at: usize| sources[at].1;
    let gap = |at: usize| psnr(at) - psnr(at - 1);
    let at = (1..=n / 2).max_by(|a, b| gap(*a).total_cmp(&gap(*b)))?;
    let below_middle = psnr(at + (n - at) / 2) - psnr(at);
    let is_apart = gap(at) >= LEAST_GAP.max(GAP_SIGNIFICANCE * below_middle);
    (n >= FEWEST_SOURCES && is_apart && psnr(at - 1) <= most).then(|| {
        let others = sources.split_off(at);
        [sources, others]
    })
}

/// Doubts about the Gaussians of a method's records: the first of each kind, and `outlying_sources`.
pub fn doubts_of<'a>(
    records: impl Iterator<Item = &'a Record> + Clone,
    kind: &str,
    privilege: Privilege,
) -> Vec<String> {
    let outliers = outlying_sources(records.clone(), kind);
    let mut first: BTreeMap<&str, String> = BTreeMap::new();
    for record in records {
        for (about, text) in doubts(record, privilege) {
            first.entry(about).or_insert(text);
        }
    }
    first.into_values().chain(outliers).collect()
}

#[cfg(test)]
mod tests {
    use glam::{DAffine3, DMat3, DVec3};
    use sharp::camera::{Intrinsics, RigidTransform};
    use sharp::color::srgb_from_linear;
    use sharp::gaussians::Gaussians;

    use super::*;
    use crate::methods::GaussianSpace;

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

    /// A wall of coloured Gaussians 2 m in front of the camera, one a pixel, in camera space, no two of them at one depth.
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

    /// The wall as the source's camera sees it.
    fn photograph() -> RgbImage {
        let (round, renderer) = (mapped(&wall(), DAffine3::IDENTITY), SharedRenderer::cpu());
        let truth = renderer.render(&round, DAffine3::IDENTITY, source().intrinsics);
        renderer.picture(&truth.unwrap())
    }

    fn doubt_about(gaussians: Gaussians) -> Option<String> {
        doubt_about_read(gaussians, FileReading::of_arrays())
    }

    fn doubt_about_read(gaussians: Gaussians, reading: FileReading) -> Option<String> {
        let (source, renderer) = (source(), SharedRenderer::cpu());
        let photograph = photograph();
        let prediction = GaussianPrediction {
            gaussians,
            space: GaussianSpace::CAMERA,
            first_layer: None,
            extras: BTreeMap::new(),
            reading: Some(reading),
            warnings: BTreeMap::new(),
        };
        let seen = see_source(&prediction, &source, &photograph, &renderer).unwrap();
        let depth = DepthMap::from_pixel(40, 32, Luma([2.0]));
        let scene = Scene {
            dataset: "m".to_owned(),
            id: "s".to_owned(),
            cluster: "s".to_owned(),
            views: Vec::new(),
            pairing: sharp_datasets::Pairing::MultiView,
            notes: Vec::new(),
            warnings: Vec::new(),
        };
        let checked = CheckedSource {
            camera: &source,
            photograph: &photograph,
            depth: Some(&depth),
            scene: &scene,
        };
        let mut record = super::super::record::tests::record();
        record.median_depth_m = Some(2.0);
        record.warnings = doubts_about(&prediction, &reading, &seen, &checked, &renderer).unwrap();
        record.extras = seen.extras;
        let found = doubts_of([&record].into_iter(), "gaussians", Privilege::None);
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
                "times as far away as the dataset's depth (s): `scale=0.001`",
            ),
            (in_feet, "`scale=0.3` fits"),
            (bgr, "with `channels=bgr`: "),
            (recolored(&round, |_| 0.9), "no reading that was tried"),
            // One doubt does not hide another.
            (recolored(&in_millimetres_too, |_| 0.9), "times as far away"),
        ] {
            let said = doubt_about(gaussians).unwrap_or_default();
            assert!(said.contains(words), "{words}: {said}");
        }
    }

    /// Colours stored in another form than coefficients, as a PLY that is read without a setting has them.
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
        ] {
            let said = read_as_dc(store);
            assert!(said.contains(words), "{words}: {said}");
        }
        assert_eq!(read_as_dc(|c| (c - 0.5) / 0.282_094_79), "");
    }

    #[test]
    fn few_or_blurred_gaussians_show_something_and_plain_ones_do_not() {
        let round = mapped(&wall(), DAffine3::IDENTITY);
        let said = |gaussians: Gaussians| doubt_about(gaussians).unwrap_or_default();
        let nothing = "hardly anything of it";
        // One in forty, the rest stays black.
        let few = round.filtered(|k| k % 41 == 0);
        assert!(!said(few.clone()).contains(nothing), "{}", said(few));
        let mut blurred = round.filtered(|k| k % 5 == 0);
        blurred.scales.fill([0.25; 3]);
        let text = said(blurred);
        assert!(!text.contains(nothing), "{text}");
        // A plain wall, in the photograph's own colour too, and Gaussians that are not seen.
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

    /// A record a source; names are `SCENE/VIEW`.
    fn shown(sources: &[(&str, f64)]) -> Option<String> {
        let records: Vec<Record> = sources
            .iter()
            .map(|(name, psnr)| {
                let mut record = super::super::record::tests::record();
                record.dataset = "d".to_owned();
                record.scene = name.split('/').next().unwrap_or_default().to_owned();
                record.pair_id = format!("d/{name}__t");
                record.extras = BTreeMap::from([(SOURCE_PSNR.to_owned(), *psnr)]);
                record
            })
            .collect();
        let found = outlying_sources(records.iter(), "gaussians");
        // Not where the program itself made them of the photograph, and in no order.
        assert_eq!(outlying_sources(records.iter(), "depth-splat"), None);
        assert_eq!(outlying_sources(records.iter().rev(), "gaussians"), found);
        found
    }

    #[test]
    fn sources_far_below_the_others_are_named() {
        let half = [
            ("s/view_00", 24.2),
            ("s/view_01", 31.0),
            ("s/view_02", 27.5),
            ("s/view_03", 9.13),
            ("s/view_04", 11.98),
            ("s/view_05", 26.0),
            ("s/view_06", 10.0),
            ("s/view_07", 11.0),
        ];
        let said = shown(&half).unwrap();
        let start = "4 of 8 sources show the photograph they were predicted from at 9.1 to 12.0 dB, the others at 24.2 to 31.0: \
                     d/s/view_03, d/s/view_04, d/s/view_06, d/s/view_07; ";
        assert!(said.starts_with(start), "{said}");
        assert!(said.contains("`gaussians info FILE`"), "{said}");
        // A neighbour's file.
        let one = [33.9, 33.1, 20.4, 34.0, 33.5];
        let names = ["s/a", "s/b", "s/c", "s/d", "s/e"];
        let one: Vec<(&str, f64)> = names.into_iter().zip(one).collect();
        let said = shown(&one).unwrap();
        assert!(
            said.starts_with("1 of 5") && said.contains(": d/s/c; "),
            "{said}"
        );
        // One source a scene: only what shows less than a plain colour.
        let mut scenes = [("a/v", 22.0), ("b/v", 24.0), ("c/v", 9.0), ("e/v", 27.0)];
        assert!(shown(&scenes).unwrap().contains(": d/c/v; "));
        scenes[2].1 = 15.5;
        assert_eq!(shown(&scenes), None);
        // In several scenes at once.
        let other = half.map(|(name, psnr)| (name.replace("s/", "t/"), psnr));
        let both = half
            .into_iter()
            .chain(other.iter().map(|(n, p)| (n.as_str(), *p)));
        let said = shown(&both.collect::<Vec<_>>()).unwrap();
        assert!(
            said.starts_with("8 of 16") && said.contains(": d/s/view_03, "),
            "{said}"
        );
        assert!(said.contains("d/t/view_07; "), "{said}");
    }

    /// Measured: the small network and `depth-splat` on the procedural scene, the network on held-out scenes, and what other
    /// right Gaussians may look like.
    #[test]
    fn sources_that_differ_by_nature_are_not() {
        let of = |values: &[f64]| {
            let names: Vec<String> = (0..values.len()).map(|i| format!("s/{i}")).collect();
            let named = names.iter().map(String::as_str).zip(values.iter().copied());
            shown(&named.collect::<Vec<_>>())
        };
        for values in [
            &[
                27.03, 27.06, 27.09, 27.23, 27.3, 27.42, 27.5, 27.54, 27.7, 27.85,
            ][..],
            &[
                10.13, 10.14, 10.58, 11.04, 11.24, 11.6, 12.4, 13.3, 13.5, 15.02,
            ],
            &[
                21.93, 22.49, 23.0, 24.1, 24.8, 25.9, 27.0, 28.1, 29.3, 31.21,
            ],
            // One flat view that is easy, and a gradual decline.
            &[24.0, 24.5, 25.0, 25.5, 40.0],
            &[8.0, 12.0, 16.0, 20.0, 24.0, 28.0],
            // Too few to tell.
            &[9.0, 25.0, 26.0],
            // Most of them lie below: what is right there?
            &[9.0, 9.5, 10.0, 25.0],
        ] {
            assert_eq!(of(values), None, "{values:?}");
        }
        // A scene of leaves beside one of walls.
        let names = ["a/0", "a/1", "a/2", "a/3", "b/0", "b/1", "b/2", "b/3"];
        let values = [31.0, 31.5, 32.0, 32.2, 22.0, 22.1, 22.6, 23.0];
        let two: Vec<(&str, f64)> = names.into_iter().zip(values).collect();
        assert_eq!(shown(&two), None);
    }

    #[test]
    fn privileged_methods_are_scaled_and_need_no_metres() {
        let mut record = super::super::record::tests::record();
        record.median_depth_m = Some(2.0);
        record.extras = BTreeMap::from([(SOURCE_DEPTH.to_owned(), 2000.0)]);
        assert!(doubts(&record, Privilege::None).contains_key("scale"));
        assert!(doubts(&record, Privilege::DepthScale).is_empty());
        record.median_depth_m = None;
        assert!(doubts(&record, Privilege::None).is_empty());
        record.extras.insert("zero_quaternions".to_owned(), 3.0);
        let said = &doubts(&record, Privilege::None)["zero_quaternions"];
        assert!(
            said.contains("3 of its Gaussians have a quaternion of zero"),
            "{said}"
        );
    }
}
