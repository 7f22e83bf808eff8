//! The kinds of methods; builds methods from specs.

use std::collections::BTreeSet;
use std::sync::Arc;

use sharp::ply::StoredForm;
use sharp_datasets::error::nearest_of;

use super::command::Command;
use super::crop_and_resize::FitRules;
use super::depth_splat::DepthSplat;
use super::file_reading::FileReading;
use super::gaussians::GaussianFiles;
use super::imported::Imported;
use super::method::Method;
use super::scale_sweep::ScaleSweep;
use super::sharp::Sharp;
use super::spec::{MethodSpec, SpecError};
use super::trivial::{self, Target};
use crate::scoring::ScaleChooser;

#[derive(Debug, Clone, Copy)]
pub struct MethodKind {
    pub name: &'static str,
    /// Groups of options; `label` is implied.
    pub options: &'static [&'static [&'static str]],
    /// What the method predicts.
    pub summary: &'static str,
    /// Description of its options.
    pub settings: &'static str,
    build: fn(&MethodSpec, Option<&Arc<ScaleChooser>>) -> Built,
}

pub const KINDS: [MethodKind; 8] = [
    MethodKind {
        name: "target",
        options: &[],
        summary: "the ground truth; perfect under every metric (self-test)",
        settings: "",
        build: |spec, _| {
            Ok(Box::new(Target {
                label: spec.label.clone(),
            }))
        },
    },
    MethodKind {
        name: "copy",
        options: &[],
        summary: "the source photograph, unmoved",
        settings: "",
        build: |spec, _| Ok(trivial::copy(spec)),
    },
    MethodKind {
        name: "mean",
        options: &[],
        summary: "the mean colour of the source everywhere",
        settings: "",
        build: |spec, _| Ok(trivial::mean(spec)),
    },
    MethodKind {
        name: "depth-splat",
        options: &[&["resolution"]],
        summary: "the dataset's depth through SHARP's initializer, composer and renderer; holes stay \
                  black",
        settings: "resolution=1536",
        build: |spec, _| Ok(Box::new(DepthSplat::from_spec(spec)?)),
    },
    MethodKind {
        name: "sharp",
        options: &[&Sharp::OPTIONS],
        summary: "the SHARP network",
        settings: "checkpoint=FILE, or mini for the small one that comes with the program, config=FILE#NAME, \
                  depth=none|privileged, device=cpu, allow_unused=PREFIX,…",
        build: |spec, _| Ok(Box::new(Sharp::from_spec(spec)?)),
    },
    MethodKind {
        name: "gaussians",
        options: &[
            &["dir", "file", "depth", "train", "align"],
            &StoredForm::KEYS,
            &FileReading::PLACEMENT_KEYS,
            &[FileReading::RULE_KEY],
        ],
        summary: "Gaussians made elsewhere, \
                  DIR/<dataset>/<scene>/<source>.ply|safetensors|spz|sog|splat, rendered by \
                  sharp-bench",
        settings: "dir=DIR, file={scene}.ply for another layout, rendering=inria|gsplat-classic|mip-splatting|… for the rule they were made for, \
                  depth=none, or privileged: scaled by the median of true over rendered depth, color_space=linear|srgb for PLYs \
                  that do not state it; if the numbers are stored in another form: opacity=linear|byte|log, \
                  scales=linear|log-variance|log10, \
                  quaternions=xyzw, colors=rgb01|rgb255|rgb-signed|logit|dc-uncentered, channels=bgr, harmonics=drop|interleaved, marks=ignore; if they are in another place: space=world|target|normalized, \
                  axes=rub|luf, scale=S, transform=dataparser_transforms.json, shift=X:Y, focal=F|X:Y; train=LIST.txt|GLOB for scenes trained on several views; align=pose moves the target's \
                  camera to fit its photograph",
        build: |spec, _| Ok(Box::new(GaussianFiles::from_spec(spec)?)),
    },
    MethodKind {
        name: "imported",
        options: &[&["dir", "file", "scales"], &FitRules::OPTIONS],
        summary: "pictures made elsewhere, DIR/<pair_id>.png|jpg|exr",
        settings: "dir=DIR, file={scene}.png for another layout; other sizes with resize=bilinear|\
                  bilinear-antialias|bicubic|lanczos|area, cropped ones with crop=x:y:w:h|center:W:H|center|sidecar; \
                  scales=0.5+1+2 for DIR/<scale>/<pair_id>.png with --scale-sweep",
        build: imported,
    },
    MethodKind {
        name: "command",
        options: &[
            &["run", "timeout", "version", "files", "depth", "cwd"],
            &FitRules::OPTIONS,
        ],
        summary: "an external program that gets one line of JSON per pair",
        settings: "run='python my.py', timeout=600, version=TEXT, resize=, \
                  crop=x:y:w:h|center:W:H, depth=none, or privileged: the program gets the source's true depth; cwd=DIR, the folder it starts in",
        build: |spec, _| Ok(Box::new(Command::from_spec(spec)?)),
    },
];

/// A method with its spec; `None` for a method passed in as code.
pub type BuiltMethod = (Option<MethodSpec>, Box<dyn Method>);

/// Builds the methods; labels must be unique. An aligned score means little alone, so each method
/// that aligns targets is accompanied by the same method without alignment, added if it is not
/// listed. `chooser` picks the scale for methods that predict several.
pub fn build(
    specs: &[MethodSpec],
    chooser: Option<&Arc<ScaleChooser>>,
) -> Result<Vec<BuiltMethod>, SpecError> {
    let mut labels = BTreeSet::new();
    let mut all: Vec<MethodSpec> = specs.to_vec();
    for spec in specs
        .iter()
        .filter(|spec| spec.option("align") == Some("pose"))
    {
        let unaligned = spec.unaligned();
        let is_there = |other: &MethodSpec| {
            (&other.kind, &other.options) == (&unaligned.kind, &unaligned.options)
        };
        if !all.iter().any(is_there) {
            let at = all
                .iter()
                .position(|other| other == spec)
                .unwrap_or_default();
            all.insert(at + 1, unaligned);
        }
    }
    all.iter()
        .map(|spec| {
            if !labels.insert(spec.label.as_str()) {
                return Err(spec.error(format!(
                    "the label '{}' is taken; give this one label=NAME",
                    spec.label
                )));
            }
            let kind = kind_of(spec)?;
            spec.expect_options(&kind.options.concat())?;
            Ok((Some(spec.clone()), (kind.build)(spec, chooser)?))
        })
        .collect()
}

fn kind_of(spec: &MethodSpec) -> Result<&'static MethodKind, SpecError> {
    let kind = KINDS.iter().find(|kind| kind.name == spec.kind);
    kind.ok_or_else(|| SpecError::UnknownKind {
        spec: spec.to_string(),
        known: nearest_of(&spec.kind, &KINDS.each_ref().map(|kind| kind.name)),
    })
}

type Built = Result<Box<dyn Method>, SpecError>;

fn imported(spec: &MethodSpec, chooser: Option<&Arc<ScaleChooser>>) -> Built {
    Ok(match (spec.option("scales"), chooser) {
        (None, _) => Box::new(Imported::from_spec(spec)?),
        (Some(_), Some(chooser)) => Box::new(ScaleSweep::from_spec(spec, Arc::clone(chooser))?),
        (Some(_), None) => {
            return Err(spec.error("several scales: --scale-sweep scores the best of them"));
        }
    })
}
