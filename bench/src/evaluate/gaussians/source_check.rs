//! Renders Gaussians into the view that they were predicted from. If the rendering does not match
//! the view's photograph, tries other readings of the Gaussians' file.
//!
//! A wrong frame, unit, encoding or colour space gives bad scores without an error. Rendering into the source's own
//! camera reveals all of these except a scale about that camera. Only depth reveals that scale, so the rendered depth
//! is recorded, too. For external files, `add_doubts` tries other readings on three sources of each dataset, chosen by
//! the list of pairs alone. This costs about as much as rendering a few small pictures.

use std::collections::{BTreeMap, BTreeSet};
use std::ops::RangeInclusive;

use image::RgbImage;
use sharp::color::{Quantization, linear_from_srgb};
use sharp::gaussians::Gaussians;
use sharp::ply::{ColorSpace, StoredForm, StoredScales, check_stored};
use sharp::random::mix;
use sharp::render::{Background, RenderError};
use sharp_datasets::{DepthMap, Scene};
use sharp_metrics::{Mask, Picture, psnr};

use super::depth_check::{depth_doubt, other_order_of_magnitude, rounded};
use super::footprint::{MIN_HOLES, hole_share, missing_share, other_background};
use super::likeness::{Likeness, between_pixels, blur, window};
use super::mismatch::Part;
use super::other_view::{OtherView, best_shown, other_view, other_views};
use super::registration::zoom;
use super::render::placed;
use super::rereading::{Hints, Seen, Trial};
use crate::methods::file_reading::{FileReading, FileSpace};
use crate::methods::{GaussianPrediction, GaussianSpace};
use crate::pairs::PosedCamera;
use crate::pairs::depth::median_depth_m;
use crate::pairs::pair_id::source_of;
use crate::pairs::pair_list::ResolvedPair;
use crate::pairs::valid_depth::median_of;
use crate::rendering::SharedRenderer;
use crate::rendering::shared::surface_depth;
use crate::scoring::Region;

/// Name of the recorded PSNR between the source's photograph and its rendering, in dB; at most 100, so that it is
/// finite.
pub const SOURCE_PSNR: &str = "source_psnr";
/// Name of the recorded median depth of the source's rendering, in metres.
pub const SOURCE_DEPTH: &str = "source_depth_m";

/// Name of the value recorded for a blurred rendering of the source: the share of the photograph's contrast that is
/// missing, 0..1.
pub const SOURCE_BLUR: &str = "source_blur";

/// Other readings of the file are tried only if at least this share of the photograph's pixels is valid.
const MIN_VALID: f64 = 0.95;
/// Other readings of the file are not tried if the source's rendering has at least this PSNR, in dB.
const RIGHT_DB: f64 = 38.0;
/// A setting that gains less than this, in dB, may only compensate for wrong standard deviations.
const WEAK_DB: f64 = 3.0;
/// Range of the contrast, relative to the photograph, if colour coefficients were multiplied by the constant harmonic
/// (0.282) instead of divided by it. This changes contrast by a factor of 0.282² = 0.08.
const SQUARED_CONSTANT: RangeInclusive<f64> = 0.06..=0.1;
/// Other readings of the file are tried only if the photograph has at least this many pixels; smaller photographs do
/// not show a Gaussian's shape.
const FEWEST_PIXELS: usize = 1200;
/// If less than this fraction of the covered area remains when the photograph is shifted by half a pixel, the Gaussians
/// are narrower than a pixel and lie at the pixels' centres. A rendering at these centres shows neither their shape nor
/// their size, so the shifted photograph is compared instead.
const MIN_COVERED_BETWEEN: f64 = 0.9;
/// Average number of Gaussians per pixel beyond which rendering takes minutes. Photographs need tens or hundreds per
/// pixel.
const ABSURD_LAYERS: f64 = 5000.0;
/// [`ABSURD_LAYERS`] causes a warning only if a Gaussian covers at least this share of the picture on average: millions of
/// small Gaussians on a small picture are fine.
const ABSURD_SHARE: f64 = 0.02;

pub(in crate::evaluate) struct CheckedSource<'a> {
    pub(in crate::evaluate) camera: &'a PosedCamera,
    pub(in crate::evaluate) photograph: &'a RgbImage,
    /// Pixels of the photograph to compare; `None` for all.
    pub(in crate::evaluate) valid: Option<&'a Mask>,
    /// True depth, if available; `None` also for a method whose Gaussians are scaled to it.
    pub(in crate::evaluate) depth: Option<&'a DepthMap>,
    pub(in crate::evaluate) scene: &'a Scene,
    /// Whether other settings of the file reader are tried for this source.
    pub(in crate::evaluate) is_chosen: bool,
    /// Whether the Gaussians were made from several views of the scene.
    pub(in crate::evaluate) of_several_views: bool,
}

/// Measured values and warnings about Gaussians rendered into their source.
pub(in crate::evaluate) struct SourceFacts {
    pub(in crate::evaluate) extras: BTreeMap<String, f64>,
    pub(in crate::evaluate) warnings: BTreeMap<String, String>,
}

/// A prediction rendered into its own source.
struct SeenSource {
    /// The rendering, moved by half a pixel if [`MIN_COVERED_BETWEEN`] applies.
    picture: RgbImage,
    depth: DepthMap,
    /// The rendering in front of the photograph's mean colour instead of the background.
    over_mean: RgbImage,
    /// Result of [`missing_share`].
    missing: Option<f64>,
    /// Share of the pixels of `picture` with alpha below [`HOLE_ALPHA`](crate::rendering::shared::HOLE_ALPHA).
    holes: f64,
    is_blurred: bool,
}

/// Renders a prediction into its own source and measures [`SOURCE_PSNR`], [`SOURCE_DEPTH`] and [`SOURCE_BLUR`]. For
/// chosen sources, also tries other readings of the file and warns if one matches better. Gaussians in world space that
/// were made from several views are examined in the view that they reproduce best. Drops the prediction's own warnings
/// about a setting if the rendering contradicts them.
///
/// # Errors
/// If rendering fails.
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
    let picture = renderer.picture(&output);
    let blurred = blur(photograph, &picture);
    let mean = Likeness::of(photograph, whole, photograph).mean_color();
    let mean = mean.map(|level| match output.blending {
        ColorSpace::Linear => linear_from_srgb(level as f32 / 255.0),
        ColorSpace::Srgb => level as f32 / 255.0,
    });
    let mut seen = SeenSource {
        picture,
        depth: surface_depth(&output),
        missing: missing_share(photograph, &output.alpha),
        holes: hole_share(&output.alpha),
        is_blurred: blurred.is_some(),
        over_mean: output.srgb8(Background::Color(mean), Quantization::Round),
    };
    let [as_seen, true_one] = [&seen.picture, photograph].map(|p| Picture::Rgb8(p.clone()));
    let likeness = psnr(&as_seen, &true_one, source.valid).map_or(0.0, |psnr| psnr.min(100.0));
    let measured = [
        (SOURCE_DEPTH, median_depth_m(&seen.depth)),
        (SOURCE_PSNR, Some(likeness)),
        (SOURCE_BLUR, blurred),
    ];
    let measured = measured.into_iter();
    let extras = measured.filter_map(|(name, value)| Some((name.to_owned(), value?)));
    let mut facts = SourceFacts {
        extras: extras.collect(),
        warnings: prediction.warnings.clone(),
    };
    let scale = prediction.reading.map(|reading| reading.placement.scale);
    let far = source
        .depth
        .and_then(|truth| other_order_of_magnitude(truth, &seen.depth, scale, &camera.id));
    facts
        .warnings
        .extend(far.map(|text| ("scale".to_owned(), text)));
    let counts = |mask: &Mask| mask.count() as f64 >= MIN_VALID * photograph.pixels().len() as f64;
    let Some(reading) = prediction
        .reading
        .filter(|_| source.valid.is_none_or(counts))
    else {
        return Ok(facts);
    };
    let is_tried = source.is_chosen && photograph.pixels().len() >= FEWEST_PIXELS;
    if !is_tried && prediction.warnings.is_empty() {
        return Ok(facts);
    }
    let mut trial = Trial {
        source: camera,
        photograph,
        region: window(photograph),
        moved: [0.0; 2],
        renderer,
        rule: prediction.rule,
        of_several_views: source.of_several_views,
    };
    if is_tried
        && source.of_several_views
        && reading.placement.space == FileSpace::World
        && let Some((camera, photograph)) = best_shown(
            &prediction.gaussians,
            prediction.space,
            &trial,
            source.scene,
        )?
    {
        // Depth is compared in that view, too, unless the method has the privilege to use it.
        let mut views = source.scene.views.iter();
        let view = views.find(|view| source.depth.is_some() && view.id == camera.id);
        let depth = view.and_then(|view| view.content.depth().ok().flatten());
        let best = CheckedSource {
            camera: &camera,
            photograph: &photograph,
            valid: None,
            depth: depth.as_ref(),
            ..*source
        };
        let seen_by = GaussianPrediction {
            space: GaussianSpace::Camera(placed(prediction.space, source.camera, &camera)),
            ..prediction.clone()
        };
        facts.warnings = check_source(&seen_by, &best, renderer)?.warnings;
        return Ok(facts);
    }
    let moved = Trial {
        moved: [0.5; 2],
        ..trial
    };
    let between;
    let prediction = &shuffled(prediction);
    let gaussians = &prediction.gaussians;
    if is_tried
        && moved.covered(gaussians, as_given)?
            < MIN_COVERED_BETWEEN * trial.covered(gaussians, as_given)?
        && let Some(output) = moved.whole().rendered(gaussians, as_given)?
    {
        between = between_pixels(photograph);
        trial = Trial {
            photograph: &between,
            ..moved
        };
        seen.picture = renderer.picture(&output);
        seen.holes = hole_share(&output.alpha);
    }
    for topic in prediction.warnings.keys() {
        let mut other = reading;
        if let Some((key, value)) = topic.split_once('=')
            && other.set(key, value).is_ok()
            && !trial.allows(&other, gaussians, &reading)?
        {
            facts.warnings.remove(topic);
        }
    }
    let background = renderer.settings().background;
    if is_tried && let Some(text) = other_background(photograph, &output.alpha, background) {
        let text = format!("{text} ({})", camera.id);
        facts.warnings.insert("background".to_owned(), text);
    } else if is_tried {
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

/// The prediction with its Gaussians in random order, for comparisons. At equal depth, earlier Gaussians cover later
/// ones. In the order of a file, this would shift the whole picture.
fn shuffled(prediction: &GaussianPrediction) -> GaussianPrediction {
    let mut order: Vec<usize> = (0..prediction.gaussians.len()).collect();
    order.sort_by_cached_key(|&k| mix(k as u64));
    GaussianPrediction {
        gaussians: prediction.gaussians.subset(&order),
        rule: prediction.rule,
        space: prediction.space,
        reading: prediction.reading,
        warnings: prediction.warnings.clone(),
        ..GaussianPrediction::default()
    }
}

/// Names (`dataset/scene/source`) of the sources for which other settings of the file reader are tried: the first,
/// middle and last of each dataset. `pairs` must be all pairs of the plan, so that all shards choose the same sources.
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

/// Topic and text of a warning if rendering will take very long.
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
    // Forms of the standard deviations, other than natural logarithms, that the numbers allow and that give less coverage.
    use StoredScales::{Linear, Log, Log10, Variance};
    let stored = prediction.reading.map(|reading| reading.stored);
    let stored = stored.filter(|stored| stored.scales == Some(Log));
    let forms = stored.into_iter().flat_map(|stored| {
        let forms = [Linear, Variance, Log10].into_iter();
        forms.filter(move |scales| {
            let other = StoredForm {
                scales: Some(*scales),
                ..stored
            };
            let mut recoded = prediction.gaussians.clone();
            stored.encode(&mut recoded);
            let is_possible = check_stored(&recoded, &other).is_ok();
            other.decode(&mut recoded);
            is_possible && Seen::of(&recoded, placed, &source.intrinsics).layers < ABSURD_LAYERS
        })
    });
    let forms: Vec<String> = forms.map(|form| format!("`scales={form}`")).collect();
    let cause = if forms.is_empty() {
        "in another unit (`scale=`)".to_owned()
    } else {
        format!("stored in another form ({})", forms.join(" or "))
    };
    let text = format!(
        "on average, {:.0} of its Gaussians cover each pixel (half of the Gaussians are wider than {:.3}), \
         so rendering takes very long ({}); perhaps the scales are {cause}",
        seen.layers,
        middle.unwrap_or_default(),
        source.id
    );
    Some(("coverage".to_owned(), text))
}

/// Comparisons of Gaussians with photographs, as their file was read and under other settings of the file reader.
struct Findings<'a> {
    /// Start of each sentence: how well the Gaussians, as read, reproduce the photograph.
    shown: String,
    as_read: Likeness,
    /// Like `as_read`, but only the compared part was rendered, as for all other readings.
    compared: Likeness,
    better: Option<(FileReading, Likeness)>,
    other: Option<OtherView<'a>>,
    /// Rotation of the quaternions, in degrees, that matches significantly better, and the comparison after it.
    turned: Option<(f64, Likeness)>,
    /// Like `turned`, for a rotation of means and quaternions without the harmonics.
    harmonics: Option<(f64, Likeness)>,
    /// Comparison of the Gaussians placed by the inverse of the source's pose, if it is significantly better than
    /// `as_read`.
    inverse: Option<Likeness>,
    missing: Option<f64>,
    holes: f64,
    is_lost: bool,
    /// Id of the source's view.
    id: String,
}

impl<'a> Findings<'a> {
    /// Compares a prediction with its source under several readings; `elsewhere` are other views of the scene.
    fn of(
        prediction: &GaussianPrediction,
        reading: &FileReading,
        seen: &SeenSource,
        trial: &Trial<'_>,
        elsewhere: &[Trial<'a>],
    ) -> Result<Self, RenderError> {
        let (photograph, region, gaussians) =
            (trial.photograph, trial.region, &prediction.gaussians);
        let shown = region.part_of(&seen.picture);
        let as_read = Likeness::of(photograph, region, &shown);
        let is_right = as_read.psnr() >= RIGHT_DB;
        let is_lost = shows_nothing(photograph, &seen.over_mean);
        let own = reading.placement.camera_from_file(trial.source);
        let compared = trial.fit(gaussians, own)?;
        let compared = compared.unwrap_or_else(|| as_read.clone());
        let mut better = None;
        if !is_right {
            let zoom = |along| zoom(photograph, &seen.picture, trial.principal_point(), along);
            let zooms = [[1, 1], [0, 1], [1, 0]].into_iter().filter_map(zoom);
            let hints = Hints {
                is_lost,
                is_blurred: seen.is_blurred,
                aside: trial.flat_shift(gaussians, own)?,
                zooms: zooms.collect(),
                spread: trial.spread(gaussians, own),
            };
            let best = trial.best_reading(gaussians, reading, &compared, elsewhere, &hints)?;
            if let Some((other, _)) = &best
                && is_confirmed(trial, gaussians, reading, other)?
            {
                better = best;
            }
        }
        let other = other_view(prediction, reading, trial, elsewhere, &compared, &shown)?;
        let turned = |part| trial.other_turn(gaussians, part, reading, &compared, elsewhere);
        let (turned, harmonics, inverse) = if is_right {
            (None, None, None)
        } else {
            (
                turned(Part::Quaternions)?,
                turned(Part::Harmonics)?,
                trial.fit_with_inverse_pose(gaussians, reading, &compared)?,
            )
        };
        let missing = match seen.missing.filter(|_| better.is_none() && other.is_none()) {
            Some(_) if trial.is_whole_elsewhere(gaussians, reading, elsewhere)? => None,
            missing => missing,
        };
        let of_part = if (region.width, region.height) == photograph.dimensions() {
            String::new()
        } else {
            format!("{}x{} pixels of ", region.width, region.height)
        };
        let between = if trial.moved == [0.0; 2] {
            ""
        } else {
            " between the centres of its pixels"
        };
        let shown = format!(
            "its Gaussians show {of_part}their source's photograph at {:.2} dB PSNR{between} ({})",
            as_read.psnr(),
            trial.source.id
        );
        let mut found = Self {
            shown,
            as_read,
            compared,
            better,
            other,
            turned: None,
            harmonics: None,
            inverse: None,
            missing,
            holes: seen.holes,
            is_lost,
            id: trial.source.id.clone(),
        };
        found.turned = turned.filter(|(_, fit)| found.is_best(fit));
        found.harmonics = harmonics.filter(|(_, fit)| found.is_best(fit));
        found.inverse = inverse.filter(|fit| found.is_best(fit));
        Ok(found)
    }

    /// Whether a comparison has a smaller error than those with another reading, another view, turned quaternions or turned
    /// harmonics.
    fn is_best(&self, fit: &Likeness) -> bool {
        let better = self.better.iter().map(|(_, fit)| fit);
        let turned = self.turned.iter().chain(&self.harmonics);
        let turned = turned.map(|(_, fit)| fit);
        let other = self.other.iter().map(|other| &other.fit);
        let mut known = better.chain(turned).chain(other);
        known.all(|known| fit.error() < known.error())
    }

    /// Topic and text of a warning if another reading or view matches significantly better, or if nothing matches.
    fn cause(
        &self,
        prediction: &GaussianPrediction,
        reading: &FileReading,
    ) -> Option<(String, String)> {
        let shown = &self.shown;
        let (topic, text) = match (&self.better, &self.other) {
            _ if let Some(fit) = &self.inverse => (
                "pose",
                format!(
                    "{shown}; with the inverse of the source's pose, they reach {:.2} dB, so they were moved to world \
                     space with world-to-camera extrinsics; no setting corrects this; write them with camera-to-world \
                     extrinsics",
                    fit.psnr()
                ),
            ),
            _ if let Some((degrees, fit)) = &self.harmonics => (
                "harmonics",
                format!(
                    "{shown}; with their harmonics turned by {degrees:.0}°, they reach {:.2} dB, so means and quaternions \
                     were turned without the harmonics; no setting corrects this; turn the coefficients, too, when \
                     writing the file (`harmonics=drop` draws only their constant colour)",
                    fit.psnr()
                ),
            ),
            _ if let Some((degrees, fit)) = &self.turned => (
                "rotations",
                format!(
                    "{shown}; with their quaternions turned by {degrees:.0}°, they reach {:.2} dB, so their means were \
                     turned without their quaternions; no setting corrects this; turn both when writing the file",
                    fit.psnr()
                ),
            ),
            (Some((better, fit)), other)
                if other
                    .as_ref()
                    .is_none_or(|other| fit.error() <= other.fit.error()) =>
            {
                let changes = better.changes_from(reading);
                let settings = changes.iter().map(|(key, value)| format!("{key}={value}"));
                let settings: Vec<String> = settings.collect();
                let named = changes
                    .iter()
                    .zip(&settings)
                    .map(|((key, _), setting)| match *key {
                        "transform" => "the inverse of `transform=`".to_owned(),
                        _ => format!("`{setting}`"),
                    });
                let named = named.collect::<Vec<_>>().join(" and ");
                // The prediction may already have a warning about a setting that fixes only half of the problem. Report
                // that setting once, together with the other half.
                let half = settings
                    .iter()
                    .find(|s| prediction.warnings.contains_key(*s));
                let half = half.filter(|_| settings.len() > 1);
                // Holes may be the cause instead: another order of quaternions turns Gaussians at random, which fills
                // holes.
                let may_cover = matches!(changes[..], [("quaternions", _)])
                    && fit.psnr() < self.compared.psnr() + WEAK_DB;
                let holes = if may_cover && self.holes >= MIN_HOLES {
                    format!(
                        " and leave {:.0} % of its pixels empty (perhaps Gaussians were removed)",
                        100.0 * self.holes
                    )
                } else {
                    String::new()
                };
                let mended = if fit.gain_over(&self.compared) > 0.0 {
                    format!("with {named}, they reach {:.2} dB", fit.psnr())
                } else {
                    format!(
                        "{named} fits better where surfaces face the camera; on slanted surfaces, nearer Gaussians \
                         hide the improvement"
                    )
                };
                let text = format!("{shown}{holes}; {mended}");
                return Some((half.map_or("reading", String::as_str).to_owned(), text));
            }
            (_, Some(other)) => ("view", other.sentence(shown)),
            _ if let Some(missing) = self.missing
                && !self.is_lost =>
            {
                let text = format!(
                    "its Gaussians leave {:.0} % of their source's photograph empty, including large parts full of \
                     detail ({}); perhaps a part of the file is missing; if the file is meant to show only an object \
                     or a crop, give the dataset masks of that part",
                    100.0 * missing,
                    self.id
                );
                ("missing", text)
            }
            _ if self.is_lost => (
                "unrelated",
                format!(
                    "{shown}, so the photograph is hardly recognisable; no other setting that was tried is better"
                ),
            ),
            // Holes also lower the contrast.
            _ if self.holes < MIN_HOLES
                && let Some((contrast, fitted)) = self.as_read.contrast() =>
            {
                let cause = if SQUARED_CONSTANT.contains(&contrast) {
                    "perhaps `f_dc` was multiplied by 0.282 instead of divided"
                } else {
                    "perhaps colours were stored in another form"
                };
                let text = format!(
                    "{shown}, with {} times the photograph's contrast; with brightness and contrast corrected, they show \
                     it at {fitted:.2} dB; {cause}",
                    rounded(contrast)
                );
                ("contrast", text)
            }
            _ => return None,
        };
        Some((topic.to_owned(), text))
    }
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
    let gaussians = &prediction.gaussians;
    let mut others = other_views(source.camera, source.scene, trial.photograph.dimensions());
    if trial.moved != [0.0; 2] {
        others
            .iter_mut()
            .for_each(|(_, photograph)| *photograph = between_pixels(photograph));
    }
    let elsewhere = others.iter().map(|(source, photograph)| Trial {
        source,
        photograph,
        ..*trial
    });
    let elsewhere: Vec<Trial<'_>> = elsewhere.collect();
    let found = Findings::of(prediction, reading, seen, trial, &elsewhere)?;
    let with_widths = |factor: f64, fit: &Likeness| {
        format!(
            "{}, and at {:.2} dB with standard deviations {} times as wide",
            found.shown,
            fit.psnr(),
            rounded(factor)
        )
    };
    let other_widths = || -> Result<Option<String>, RenderError> {
        let is_explained = found.missing.is_some()
            || found.turned.is_some()
            || found.harmonics.is_some()
            || found.inverse.is_some();
        if found.as_read.psnr() >= RIGHT_DB || is_explained {
            return Ok(None);
        }
        let is_blurred = seen.is_blurred;
        let widths =
            trial.other_widths(gaussians, reading, &found.compared, is_blurred, &elsewhere)?;
        Ok(widths.filter(|(_, fit)| found.is_best(fit)).map(|(factor, fit)| {
            format!(
                "{}; perhaps the means were scaled without the standard deviations, or the standard deviations were \
                 written in another form; no setting corrects this, so write both in the same unit",
                with_widths(factor, &fit)
            )
        }))
    };
    // A setting that gains little, or another form of scales, may only compensate for wrong standard deviations.
    let is_weak = |(better, fit): &(FileReading, Likeness)| {
        fit.psnr() < found.compared.psnr() + WEAK_DB
            || matches!(better.changes_from(reading)[..], [("scales", _)])
    };
    if found.better.as_ref().is_some_and(is_weak)
        && let Some(text) = other_widths()?
    {
        warnings.insert("widths".to_owned(), text);
        return Ok(());
    }
    // A form of the scales that the numbers suggested gives way to the one that fits the photograph.
    let form = found.better.as_ref().map(|(other, _)| other.stored.scales);
    if let Some(Some(form)) = form.filter(|form| *form != reading.stored.scales) {
        let fits = format!("scales={form}");
        warnings.retain(|topic, _| !topic.starts_with("scales=") || *topic == fits);
    }
    warnings.extend(found.cause(prediction, reading));
    // If means are in another view's camera space, their depths say nothing about the unit.
    let is_placed_elsewhere = found.other.as_ref().is_some_and(|other| other.is_frame);
    if found.better.is_some() || is_placed_elsewhere {
        warnings.remove("scale");
        return Ok(());
    }
    let (as_read, compared) = (&found.as_read, &found.compared);
    let may_be_scaled = reading.placement.space != FileSpace::World || as_read.explains();
    let depth = source.depth.filter(|_| may_be_scaled);
    let doubt = depth.and_then(|truth| {
        let id = &source.camera.id;
        let k = source.camera.intrinsics;
        depth_doubt(truth, &seen.depth, k, reading.placement.scale, id)
    });
    if let Some((factor, mut text)) = doubt {
        if let Some(factor) = factor
            && let Some(fit) = trial.fit_with_widths(gaussians, factor, reading, compared)?
        {
            text += &format!(
                "; but only their means have that unit, because {}; `scale=` multiplies means and standard deviations, so \
                 write the file with both in one unit",
                with_widths(factor, &fit)
            );
        }
        warnings.insert("scale".to_owned(), text);
    } else if let Some(text) = other_widths()? {
        warnings.insert("widths".to_owned(), text);
    }
    Ok(())
}

/// Whether another reading, found on a part of the photograph, is also better on the whole of it.
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

/// Whether Gaussians in front of the photograph's mean colour are no closer to the photograph than that colour alone.
/// Correct Gaussians are closer, even if blurred or sparse.
fn shows_nothing(photograph: &RgbImage, over_mean: &RgbImage) -> bool {
    let whole = Region::whole(photograph.dimensions());
    Likeness::of(photograph, whole, over_mean).is_unrelated()
}

#[cfg(test)]
mod tests;
