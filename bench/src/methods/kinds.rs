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
use super::scale_sweep::{PredictAtScale, ScaleSweep};
use super::sharp::Sharp;
use super::spec::{MethodSpec, SpecError};
use super::trivial::{self, Target};
use crate::scoring::ScaleChooser;

#[derive(Debug, Clone, Copy)]
pub struct MethodKind {
    pub name: &'static str,
    /// Names of the options, in groups shared by several kinds. All kinds also have `label`.
    pub options: &'static [&'static [&'static str]],
    /// What the method predicts.
    pub summary: &'static str,
    /// Options as `key=values`, each with its meaning.
    pub settings: &'static [(&'static str, &'static str)],
    build: fn(&MethodSpec, Option<&Arc<ScaleChooser>>) -> Built,
}

pub const KINDS: [MethodKind; 8] = [
    MethodKind {
        name: "target",
        options: &[],
        summary: "the ground truth; perfect under every metric (self-test)",
        settings: &[],
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
        settings: &[],
        build: |spec, _| Ok(trivial::copy(spec)),
    },
    MethodKind {
        name: "mean",
        options: &[],
        summary: "a picture filled with the mean colour of the source",
        settings: &[],
        build: |spec, _| Ok(trivial::mean(spec)),
    },
    MethodKind {
        name: "depth-splat",
        options: &[&["resolution"]],
        summary: "Gaussians that SHARP's initializer and composer make from the dataset's depth, rendered; holes stay \
                  black",
        settings: &[(
            "resolution=1536",
            "side in pixels of the square working picture, an even number from 2 to 8192; the default is SHARP's",
        )],
        build: |spec, _| Ok(Box::new(DepthSplat::from_spec(spec)?)),
    },
    MethodKind {
        name: "sharp",
        options: &[&Sharp::OPTIONS],
        summary: "the SHARP network",
        settings: &[
            (
                "checkpoint=FILE",
                "weights, or mini for the bundled small network; by default the weights of SHARP's release",
            ),
            (
                "config=FILE#NAME",
                "architecture of the checkpoint; by default a fitting .json next to the checkpoint, or SHARP's release",
            ),
            (
                "depth=none|privileged",
                "privileged: scale the prediction by the median ratio of true to predicted depth",
            ),
            (
                "device=cpu|candle-cpu|cuda|metal|auto",
                "device of the network, cpu by default; cuda and metal only if built in",
            ),
            (
                "allow_unused=PREFIX,…",
                "ignore unknown tensors whose names have one of these prefixes",
            ),
        ],
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
        settings: &[
            ("dir=DIR", "the folder"),
            (
                "file={scene}.ply",
                "path of the files in the folder, a template with {dataset} {scene} {source} {target} {pair}",
            ),
            (
                "rendering=inria|gsplat-classic|mip-splatting|…",
                "rendering rule that the Gaussians were made for; by default the one that the file states",
            ),
            (
                "depth=none|privileged",
                "privileged: scale the Gaussians by the median ratio of true to rendered depth",
            ),
            (
                "color_space=linear|srgb",
                "encoding of the colours, for a PLY that does not state it",
            ),
            (
                "opacity=linear|byte|log",
                "form of the stored opacities (default: logit, as in a PLY)",
            ),
            (
                "scales=linear|variance|log-variance|log10",
                "form of the stored scales (default: log, as in a PLY)",
            ),
            (
                "quaternions=xyzw|wxyz-inverse|xyzw-inverse",
                "form of the stored quaternions (default: wxyz)",
            ),
            (
                "colors=rgb01|rgb255|rgb-signed|logit|dc-uncentered",
                "form of the stored colours (default: dc, as in a PLY)",
            ),
            (
                "channels=bgr",
                "order of the colour channels (default: rgb)",
            ),
            (
                "harmonics=drop|interleaved",
                "view-dependent colour: draw only the constant term, or read interleaved coefficients",
            ),
            (
                "marks=ignore",
                "accept files that state another rendering rule, and ignore that statement",
            ),
            (
                "space=world|target|normalized",
                "space of the positions (default: the source camera's)",
            ),
            (
                "axes=rub|luf|…",
                "directions of x, y and z (default: rdf, which is right, down, forward)",
            ),
            ("scale=S", "unit of the file in metres"),
            (
                "transform=FILE.json",
                "nerfstudio's dataparser_transforms.json, to be undone, or a matrix of 4 rows that maps the file's \
                 coordinates to space=",
            ),
            (
                "shift=X:Y",
                "shift of the scene in pixels, to the right and down as seen by the source's camera",
            ),
            (
                "focal=F|X:Y",
                "focal length used to unproject the points, as a multiple of the dataset's",
            ),
            (
                "train=source|LIST.txt|GLOB",
                "views that a scene's Gaussians were trained on: the pair's source, a list, or a pattern",
            ),
            (
                "align=pose",
                "before scoring, move the target's camera so that the rendering fits the photograph",
            ),
        ],
        build: |spec, _| Ok(Box::new(GaussianFiles::from_spec(spec)?)),
    },
    MethodKind {
        name: "imported",
        options: &[&["dir", "file", "scales"], &FitRules::OPTIONS],
        summary: "pictures made elsewhere, DIR/<pair_id>.png|jpg|exr",
        settings: &[
            ("dir=DIR", "the folder"),
            (
                "file={scene}.png",
                "path of the files in the folder, a template with {dataset} {scene} {source} {target} {pair}",
            ),
            (
                "resize=bilinear|bilinear-antialias|bicubic|lanczos|area",
                "kernel for resizing pictures whose size differs from the target's; without resize=, they are an error",
            ),
            (
                "crop=x:y:w:h|center:W:H|center|sidecar",
                "part of the target that the pictures show; sidecar: DIR/<pair_id>.json states it",
            ),
            (
                "alpha=…, color=…, orientation=…, exr=…",
                "how to read the pictures, as with the options of `metrics`",
            ),
            (
                "scales=0.5+1+2",
                "read DIR/<scale>/<pair_id>.png for each scale; needs --scale-sweep",
            ),
        ],
        build: |spec, chooser| swept(spec, chooser, Imported::from_spec(spec)?),
    },
    MethodKind {
        name: "command",
        options: &[
            &[
                "run", "timeout", "version", "files", "depth", "scales", "cwd",
            ],
            &FitRules::OPTIONS,
        ],
        summary: "an external program that gets one line of JSON per pair",
        settings: &[
            ("run='python my.py'", "command line of the program"),
            ("timeout=600", "maximum time for a pair, in seconds"),
            (
                "version=TEXT",
                "anything else that determines the predictions, such as the version of the weights",
            ),
            (
                "files=PATTERN",
                "files that affect the predictions but are not named in the command line; they are hashed",
            ),
            ("cwd=DIR", "working directory of the program"),
            (
                "depth=none|privileged",
                "privileged: the program gets the source's true depth",
            ),
            (
                "scales=0.5+1+2",
                "request each pair once per scale, with the scale in the request; needs --scale-sweep",
            ),
            (
                "resize=…, crop=x:y:w:h|center:W:H, alpha=…, color=…, orientation=…, exr=…",
                "as for the kind imported",
            ),
        ],
        build: |spec, chooser| swept(spec, chooser, Command::from_spec(spec)?),
    },
];

/// A method with its spec; `None` for a method passed in as code.
pub type BuiltMethod = (Option<MethodSpec>, Box<dyn Method>);

/// Builds the methods; their labels must be unique. `chooser` selects among the predictions of methods with `scales=`,
/// which require it.
///
/// For each method with `align=pose`, also builds the method without this setting, for comparison.
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
                    "the label '{}' is taken; give this method another one with label=NAME",
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

/// The method itself, or with `scales=` its [`ScaleSweep`] over these scales.
fn swept<M: PredictAtScale + 'static>(
    spec: &MethodSpec,
    chooser: Option<&Arc<ScaleChooser>>,
    method: M,
) -> Built {
    Ok(match (spec.option("scales"), chooser) {
        (None, _) => Box::new(method),
        (Some(_), Some(chooser)) => {
            Box::new(ScaleSweep::from_spec(spec, method, Arc::clone(chooser))?)
        }
        (Some(_), None) => {
            return Err(
                spec.error("several scales need --scale-sweep, which scores the best of them")
            );
        }
    })
}
