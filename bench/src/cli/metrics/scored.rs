//! Results of a pair.

use std::borrow::Cow;
use std::hash::{DefaultHasher, Hash, Hasher};
use std::path::{Path, PathBuf};

use anyhow::{Context, anyhow};
use image::RgbImage;
use sharp_metrics::{Examined, MetricKey, Picture, Scorer, Selection, Terms, resize};

use super::inputs::Input;
use super::{MetricsArgs, demand_explicit, output};
use crate::evaluate::picture_check::change::{is_unlike, likely_change, shrunk};
use crate::evaluate::picture_check::finding::PictureChange;
use crate::io::{masks, pictures};
use crate::methods::needs_kernel;
use crate::pictures::keyed_scores::KeyedScores;
use crate::pictures::maps::{ColourScale, LocalMap, MapFiles, write_map};
use crate::pictures::other_forms::{OtherForm, other_forms};

/// Results and metadata of one pair.
pub(super) struct Scored {
    /// Name of the pair.
    pub(super) name: String,
    pub(super) prediction: PathBuf,
    pub(super) target: PathBuf,
    pub(super) mask: Option<PathBuf>,
    /// Notes on how the pictures were read, one sentence each.
    pub(super) notes: Vec<String>,
    /// Share of the pixels that the mask includes; 1 without a mask.
    pub(super) left: f64,
    /// Share of the mask's pixels that are neither black nor white; `None` if all are black or white.
    pub(super) grey: Option<f64>,
    /// Whether the prediction is a JPEG file.
    pub(super) is_jpeg: bool,
    /// Hashes of the pixels of prediction and target.
    pub(super) pixels: [u64; 2],
    /// How the prediction was probably altered.
    pub(super) change: Option<PictureChange>,
    /// Prediction and target at a reduced size; `None` if the pair is not compared with other pairs.
    pub(super) small: Option<[RgbImage; 2]>,
    /// Width and height of the prediction before resizing; `None` if not resized.
    pub(super) resized_from: Option<(u32, u32)>,
    /// Depth of prediction and target as scored: `8 bit` or `f32`.
    pub(super) depths: [&'static str; 2],
    pub(super) scores: KeyedScores,
    /// Values of variants in other packages; computed only for `--find`.
    pub(super) others: Vec<OtherForm>,
    pub(super) terms: Vec<(MetricKey, Terms)>,
    /// Key, files and scale of each map.
    pub(super) maps: Vec<(String, MapFiles, ColourScale)>,
}

/// Reads and scores a pair, and writes its maps. If `compared`, keeps reduced pictures for comparison with other pairs.
pub(super) fn score(
    scorer: &Scorer,
    selection: &Selection,
    input: Input,
    args: &MetricsArgs,
    compared: bool,
) -> anyhow::Result<Scored> {
    let names = format!(
        "{} against {}",
        input.prediction.display(),
        input.target.display()
    );
    let mut notes = Vec::new();
    let mut read = |path: &Path| {
        let read = pictures::read_as(path, &args.reading())
            .map_err(|error| anyhow!(output::as_options(&error)))?;
        for note in &read.notes {
            let note = format!("{}: {}", path.display(), output::as_options(note));
            output::remark(format!("warning: {note}"));
            notes.push(note);
        }
        anyhow::Ok((read.picture, read.is_jpeg))
    };
    let (mut prediction, is_jpeg) = read(&input.prediction)?;
    let (target, _) = read(&input.target)?;
    let pixels = [&prediction, &target].map(hash_of);
    let resized_from = match args.resize_prediction {
        Some(kernel) if prediction.dimensions() != target.dimensions() => {
            let (from, (width, height)) = (prediction.dimensions(), target.dimensions());
            prediction =
                resize(&prediction, width, height, kernel).with_context(|| names.clone())?;
            warn_of_distortion(&input.prediction, from, (width, height));
            Some(from)
        }
        None if prediction.dimensions() != target.dimensions() => {
            let (from, to) = (prediction.dimensions(), target.dimensions());
            let reason = needs_kernel("the target", from, to, "--resize-prediction ");
            return Err(anyhow!(reason).context(names));
        }
        _ => None,
    };
    let mask = input.mask.as_deref().map(masks::read).transpose()?;
    let grey = mask.as_ref().filter(|found| found.between > 0);
    let grey = grey.map(|found| found.between as f64 / found.mask.values().len() as f64);
    let mask = mask.map(|found| found.mask);
    let examined = scorer
        .examine(&prediction, &target, mask.as_ref(), args.maps.is_some())
        .with_context(|| match &input.mask {
            Some(mask) => format!("{names} (mask {})", mask.display()),
            None => names,
        })?;
    let scores = examined.scores.iter();
    let scores = scores.map(|(key, s)| (*key, s.as_ref().copied().map_err(ToString::to_string)));
    let scores: KeyedScores = scores.collect();
    demand_explicit(selection, &scores, &input.prediction)?;
    let [shown, seen] = [&prediction, &target].map(eight_bit);
    let small = compared.then(|| [&*shown, &*seen].map(shrunk));
    let unlike = || is_unlike(&shrunk(&seen), &shown).then_some(PictureChange::Unlike);
    let change = likely_change(&seen, &shown).or_else(unlike);
    let maps = match &args.maps {
        Some(folder) => maps(&examined, [&prediction, &target], folder, &input.name)?,
        None => Vec::new(),
    };
    let others = match &args.find {
        Some(_) => other_forms(scorer, &prediction, &target, mask.as_ref()),
        None => Vec::new(),
    };
    let terms = examined.terms.into_iter();
    let left = mask.as_ref().map_or(1.0, |mask| {
        mask.count() as f64 / mask.values().len().max(1) as f64
    });
    Ok(Scored {
        left,
        grey,
        is_jpeg,
        pixels,
        change,
        small,
        resized_from,
        depths: [&prediction, &target].map(depth),
        scores,
        others,
        terms: terms
            .filter_map(|(key, terms)| Some((key, terms.ok()?)))
            .collect(),
        maps,
        name: input.name,
        prediction: input.prediction,
        target: input.target,
        mask: input.mask,
        notes,
    })
}

/// The picture rounded to 8 bit, in which the common mistakes of storing pictures are looked for.
fn eight_bit(picture: &Picture) -> Cow<'_, RgbImage> {
    match picture {
        Picture::Rgb8(image) => Cow::Borrowed(image),
        Picture::RgbF32(image) => Cow::Owned(pictures::to_rgb8(image)),
    }
}

fn hash_of(picture: &Picture) -> u64 {
    let mut hasher = DefaultHasher::new();
    picture.dimensions().hash(&mut hasher);
    match picture {
        Picture::Rgb8(image) => image.as_raw().hash(&mut hasher),
        Picture::RgbF32(image) => {
            let levels = image.as_raw().iter();
            levels.for_each(|level| level.to_bits().hash(&mut hasher));
        }
    }
    hasher.finish()
}

/// Warns if the aspect ratio differs from the target's by more than one pixel of rounding, which is
/// rarely intended.
fn warn_of_distortion(prediction: &Path, from: (u32, u32), to: (u32, u32)) {
    let [w, h, to_w, to_h] = [from.0, from.1, to.0, to.1].map(f64::from);
    let off = ((w * to_h / to_w - h).abs()).min((h * to_w / to_h - w).abs());
    if off > 1.0 {
        output::remark(format!(
            "warning: {}: resizing from {}x{} to {}x{} changes its aspect ratio",
            prediction.display(),
            from.0,
            from.1,
            to.0,
            to.1
        ));
    }
}

fn depth(picture: &Picture) -> &'static str {
    match picture {
        Picture::Rgb8(_) => "8 bit",
        Picture::RgbF32(_) => "f32",
    }
}

fn maps(
    examined: &Examined,
    [prediction, target]: [&Picture; 2],
    folder: &Path,
    name: &str,
) -> anyhow::Result<Vec<(String, MapFiles, ColourScale)>> {
    let size = target.dimensions();
    let mut maps = vec![LocalMap::difference(prediction, target)];
    for (key, map) in &examined.maps {
        // If a map is missing, the scores already state the reason.
        if let Ok(map) = map {
            maps.push(LocalMap::of_metric(*key, map, size));
        }
    }
    let write = |map: LocalMap| {
        let files = write_map(folder, name, &map)?;
        Ok((map.key, files, map.scale))
    };
    maps.into_iter().map(write).collect()
}
