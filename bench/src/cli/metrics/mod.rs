//! `metrics PREDICTION TARGET`: scores two pictures, or two folders of pictures.
//!
//! * `inputs`: matches pictures and masks.
//! * `scored`: a pair's results, including maps.
//! * `show`: results as text, JSON and CSV.
//! * `find`: finds the convention that reproduces a published number.
//! * `describe`: explains metric keys.

pub(super) mod describe;
mod find;
mod inputs;
mod scored;
mod show;

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

use anyhow::{bail, ensure};
use clap::Args;
use sharp::image_file::{AlphaRule, ColorRule, ExrTransfer, OrientationRule, PictureRules};
use sharp_metrics::{
    Algorithm, InstructionSet, MetricRegion, ResizeKernel, Scorer, Selection, Simd,
};

use self::scored::Scored;
use super::outcome::UsageError;
use super::output::Terminal;
use super::{Outcome, output};
use crate::config::MetricConfig;
use crate::config::metrics::demand_weights;
use crate::evaluate::picture_check::agreement::{agreed_changes, repeated};
use crate::evaluate::picture_check::camera::misplaced;
use crate::evaluate::picture_check::finding::ShownTarget;
use crate::evaluate::picture_check::group::{PictureGroup, all_or_scenes, scene_of};
use crate::evaluate::picture_check::order::shown_target;
use crate::evaluate::picture_check::sample::compared_pictures;
use crate::io::atomic_files::{check_writable, folder_of, write_atomic};
use crate::io::counts::counted;
use crate::io::observer::Observer;
use crate::io::pictures::PictureReading;
use crate::methods::LOSSY;
use crate::pictures::keyed_scores::KeyedScores;
use crate::pictures::matching::MatchBy;
use crate::report::metrics_text::MethodsText;

/// Score a prediction against a target: two pictures, or two folders
///
/// Pictures are PNG, JPEG, WebP, TIFF or BMP, or floats [H,W,3] of sRGB values in 0..1 in .exr, .npy or .safetensors.
/// Sizes must agree unless --resize-prediction is given. Folders are searched recursively, and every picture must have
/// a counterpart in the other folder.
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  sharp-bench metrics prediction.png target.png
  sharp-bench metrics predictions/ targets/ --metrics psnr,ssim --csv scores.csv
  sharp-bench metrics a.png b.png --metrics all --weights alexnet=FILE --weights vgg16=FILE --json
  sharp-bench metrics a.png b.png --metrics all --find 0.652   # which convention gives 0.652?
  sharp-bench metrics predictions/ targets/ --mask masks/ --maps maps/
  sharp-bench metrics --explain --metrics all
  sharp-bench metrics --methods-text --metrics lpips-alex,dists

If a metric that is named explicitly cannot be computed, the command fails. A metric of `all` or `paper` that cannot be
computed is listed as unavailable, with the reason.")]
pub(super) struct MetricsArgs {
    /// The prediction: a picture or a folder
    #[arg(required_unless_present_any = ["explain", "methods_text"])]
    prediction: Option<PathBuf>,
    /// The target: a picture or a folder
    #[arg(required_unless_present_any = ["explain", "methods_text"])]
    target: Option<PathBuf>,
    #[command(flatten)]
    metrics: MetricConfig,
    /// How to pair the pictures of two folders
    #[arg(long = "match", value_enum, default_value_t = MatchBy::Stem)]
    match_by: MatchBy,
    /// Also score inside a mask, under keys ending in @mask: one mask for all pairs, or a folder with a mask for each
    /// pair
    ///
    /// Only white pixels (levels of 128 and more) are scored. PSNR uses the squared error of the pixels
    /// inside; SSIM is the mean of the SSIM map over the window centres inside; LPIPS is the mean of the
    /// LPIPS map over the pixels inside; DISTS has no masked form.
    #[arg(long, value_name = "FILE|DIR")]
    mask: Option<PathBuf>,
    /// Write maps of the difference, SSIM and LPIPS of each pair, as PNG and EXR. A PNG is dark where the pictures
    /// agree and bright where they differ (--json has the values of both extremes); an EXR has the values themselves
    #[arg(long, value_name = "DIR")]
    maps: Option<PathBuf>,
    /// Show the terms of LPIPS and DISTS, layer by layer
    #[arg(long)]
    terms: bool,
    /// Find which of the selected metrics, or of their variants in other packages, give this number. Values are rounded or
    /// truncated to its number of decimals
    #[arg(long, value_name = "NUMBER", allow_negative_numbers = true)]
    find: Option<find::Sought>,
    /// Resize each prediction to the size of its target first, with this kernel of torch, PIL or OpenCV; the results
    /// record the kernel
    ///
    /// bilinear and bilinear-antialias are those of torch's interpolate, bicubic and lanczos are PIL's; area is
    /// OpenCV's and can only downscale. Without this option, unequal sizes are an error.
    #[arg(long, value_name = "KERNEL")]
    resize_prediction: Option<ResizeKernel>,
    /// How to treat pictures that are not opaque: refuse, black or white (composite over this colour, in encoded
    /// values), or drop (use the colours as stored)
    #[arg(long, value_name = "RULE", default_value_t)]
    alpha: AlphaRule,
    /// How to treat pictures whose colour profile is not sRGB: convert (to sRGB) or as-stored
    #[arg(long, value_name = "RULE", default_value_t)]
    color: ColorRule,
    /// How to treat pictures with an EXIF orientation: upright or auto (turn upright), or stored (do not turn)
    #[arg(long, value_name = "RULE", default_value_t)]
    orientation: OrientationRule,
    /// Transfer function of EXR files that do not state one: linear (as most programs write) or srgb (encoded values)
    #[arg(long, value_name = "TRANSFER")]
    exr: Option<ExrTransfer>,
    /// Instruction set of the CPU kernels for the networks: avx512, avx2 or portable [default: the machine's fastest]
    #[arg(long, value_name = "SET")]
    simd: Option<InstructionSet>,
    /// Use direct convolution instead of Winograd convolution: slower, but with smaller rounding errors
    #[arg(long)]
    exact: bool,
    /// Write a CSV with a row per pair; unavailable scores are empty
    #[arg(long, value_name = "FILE")]
    csv: Option<PathBuf>,
    /// Print JSON
    #[arg(long)]
    json: bool,
    /// Print what each metric key means and which public implementation it reproduces
    #[arg(long)]
    explain: bool,
    /// Print a LaTeX paragraph that defines the selected metrics, with the BibTeX entries that it cites
    #[arg(long, conflicts_with = "explain")]
    methods_text: bool,
}

/// A mask that keeps less than this share of the pixels is probably inverted, because most masks exclude a person, a
/// sky or a logo.
const MIN_LEFT: f64 = 0.2;

pub(super) fn execute(args: &MetricsArgs) -> anyhow::Result<Outcome> {
    let selection = args.selection()?;
    if let Some(set) = args.simd {
        Simd::pin(set).map_err(|error| UsageError(format!("--simd {set}: {error}")))?;
    }
    let mut options = args.metrics.options()?;
    if args.exact {
        options.algorithm = Algorithm::Direct;
    }
    let scorer = Scorer::with_options(&selection, &args.metrics.weights()?, options)?;
    if args.explain {
        return describe::explain(&scorer, args.json);
    }
    if args.methods_text {
        let text = MethodsText::new(scorer.keys(), scorer.weights());
        return describe::methods_text(&text, args.json);
    }
    demand_weights(&selection, &scorer)?;
    let (Some(prediction), Some(target)) = (&args.prediction, &args.target) else {
        bail!("give PREDICTION and TARGET");
    };
    let inputs = inputs::pairs(prediction, target, args.mask.as_deref(), args.match_by)?;
    // Fail before hours of work if the outputs cannot be written.
    for folder in [args.maps.as_deref(), args.csv.as_deref().map(folder_of)] {
        folder.map_or(Ok(()), check_writable)?;
    }
    let terminal = Terminal::default();
    terminal.begin("scoring", inputs.len(), "pictures");
    let mut scored = Vec::with_capacity(inputs.len());
    let targets = inputs.iter().map(|of| [scene_of(&of.name), &*of.name]);
    let order = compared_pictures(&targets.collect::<Vec<_>>());
    let others = order.values().flatten().map(|(_, other)| *other);
    let compared: BTreeSet<usize> = order.keys().copied().chain(others).collect();
    for (at, input) in inputs.into_iter().enumerate() {
        terminal.progress(at, &input.name);
        let compared = compared.contains(&at);
        scored.push(scored::score(&scorer, &selection, input, args, compared)?);
    }
    terminal.end();
    let warnings = warnings(&scored, &order);
    for warning in &warnings {
        output::remark(format!("warning: {warning}"));
    }
    let results = show::ScoredPairs {
        scored: &scored,
        scorer: &scorer,
        terms: args.terms,
        sought: args.find.as_ref(),
        resize: args.resize_prediction,
        warnings,
    };
    output::print(args.json, || results.json(), || results.to_string())?;
    if let Some(path) = &args.csv {
        write_atomic(path, &results.csv())?;
    }
    Ok(Outcome::Done)
}

/// Warnings about all pairs together, one sentence each. `order` lists, for some predictions, further targets to
/// compare them with.
fn warnings(scored: &[Scored], order: &BTreeMap<usize, Vec<(ShownTarget, usize)>>) -> Vec<String> {
    let changed = |group: &PictureGroup<'_, usize>| {
        let pictures = group.pictures.iter().map(|at| &scored[*at]);
        let changes: Vec<_> = pictures
            .map(|pair| (pair.name.as_str(), pair.change))
            .collect();
        agreed_changes(&changes, "given as targets", group.extent)
    };
    let shown = |at: usize, others: &[(ShownTarget, usize)]| {
        let small = |at: usize| scored[at].small.as_ref();
        let others = others.iter();
        let others = others.filter_map(|(place, other)| Some((*place, small(*other)?[1].clone())));
        small(at).and_then(|[shown, seen]| shown_target(seen, shown, None, others))
    };
    let compared = order.iter();
    let compared: BTreeMap<usize, ShownTarget> = compared
        .filter_map(|(at, others)| Some((*at, shown(*at, others)?)))
        .collect();
    let misplaced = |group: &PictureGroup<'_, usize>| {
        let mut found = BTreeMap::new();
        for shown in group.pictures.iter().filter_map(|at| compared.get(at)) {
            *found.entry(*shown).or_insert(0) += 1;
        }
        let misplaced = misplaced(&found, "pictures", group.extent).map(|text| {
            text + " (or predictions merely repeat the previous or next picture, which looks the same)"
        });
        misplaced.into_iter().collect()
    };
    let scenes = scored.iter().map(|pair| scene_of(&pair.name).to_owned());
    let pictures: Vec<(String, usize)> = scenes.zip(0..).collect();
    let mut all = all_or_scenes("", &pictures, changed);
    all.extend(all_or_scenes("", &pictures, misplaced));
    let pixels: Vec<_> = scored
        .iter()
        .map(|pair| (pair.name.as_str(), pair.pixels))
        .collect();
    let equal = pixels
        .iter()
        .filter(|(_, [own, target])| own == target)
        .count();
    let equal = (scored.len() > 1 && equal == scored.len()).then(|| {
        format!(
            "all {equal} predictions have exactly the pixels of their targets; if this is not intended, check whether \
             both folders hold the targets"
        )
    });
    let lossy = scored.iter().filter(|pair| pair.is_jpeg).count();
    let lossy = (lossy > 0).then(|| {
        let all = counted(scored.len(), "prediction");
        format!("{lossy} of {all} are {LOSSY}")
    });
    let mean_left = scored.iter().map(|pair| pair.left).sum::<f64>() / scored.len().max(1) as f64;
    let inverted = (mean_left < MIN_LEFT).then(|| {
        format!(
            "--mask: on average only {:.1} % of the pixels are white and therefore scored; if white marks \
             the pixels to exclude, invert the masks",
            100.0 * mean_left
        )
    });
    let grey: Vec<f64> = scored.iter().filter_map(|pair| pair.grey).collect();
    let soft = (!grey.is_empty()).then(|| {
        format!(
            "--mask: {} of {} have pixels that are neither black nor white, {:.2} % on average (stored as JPEG, or \
             resized?); levels of 128 and more count as white",
            grey.len(),
            counted(scored.len(), "mask"),
            100.0 * grey.iter().sum::<f64>() / grey.len() as f64
        )
    });
    let others = [equal, repeated(&pixels), lossy, inverted, soft];
    all.extend(others.into_iter().flatten());
    all
}

/// Fails if an explicitly named metric is unavailable.
pub(super) fn demand_explicit(
    selection: &Selection,
    scores: &KeyedScores,
    file: &Path,
) -> anyhow::Result<()> {
    for (key, score) in scores {
        if let Err(reason) = score
            && selection.is_explicit(*key)
        {
            bail!("{}: {key} cannot be computed: {reason}", file.display());
        }
    }
    Ok(())
}

impl MetricsArgs {
    fn reading(&self) -> PictureReading {
        PictureReading {
            rules: PictureRules {
                alpha: self.alpha,
                color: self.color,
                orientation: self.orientation,
            },
            exr: self.exr,
        }
    }

    /// The requested metrics. With a mask, each metric is also computed inside it, unless the list
    /// names masked metrics itself.
    fn selection(&self) -> anyhow::Result<Selection> {
        let selection = self.metrics.selection()?;
        let has = |region| selection.keys().any(|key| key.region() == region);
        if self.mask.is_none() || has(MetricRegion::Given) {
            return Ok(selection);
        }
        ensure!(
            !has(MetricRegion::Frustum),
            "--mask: keys for your own masks end in @mask; @frustum is the mask that `run` makes from depth and poses"
        );
        let with_mask = selection.with_region(MetricRegion::Given);
        if selection
            .keys()
            .any(|key| key.inside(MetricRegion::Given).is_none())
        {
            output::remark("note: DISTS has no masked form; it is computed over the whole picture");
        }
        Ok(with_mask)
    }
}
