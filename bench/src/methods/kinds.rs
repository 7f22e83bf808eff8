//! From specs on the command line to method instances.

use std::collections::BTreeSet;
use std::sync::Arc;

use super::command::Command;
use super::depth_splat::DepthSplat;
use super::gaussians::GaussianFiles;
use super::imported::Imported;
use super::method::Method;
use super::scale_sweep::ScaleSweep;
use super::sharp::Sharp;
use super::spec::{MethodSpec, SpecError};
use super::trivial::{Copy, Mean, Target};
use crate::scoring::ScaleChooser;

/// A kind of method, for `--help` and error messages.
#[derive(Debug, Clone, Copy)]
pub struct MethodKind {
    pub name: &'static str,
    /// Options besides `label`.
    pub options: &'static [&'static str],
    pub summary: &'static str,
}

pub const KINDS: [MethodKind; 8] = [
    MethodKind {
        name: "target",
        options: &[],
        summary: "the ground truth; perfect under every metric (self-test)",
    },
    MethodKind {
        name: "copy",
        options: &[],
        summary: "the source photograph, unmoved",
    },
    MethodKind {
        name: "mean",
        options: &[],
        summary: "the mean colour of the source everywhere",
    },
    MethodKind {
        name: "depth-splat",
        options: &["resolution"],
        summary: "the dataset's depth through SHARP's initializer, composer and renderer; holes stay \
                  black (resolution=1536)",
    },
    MethodKind {
        name: "sharp",
        options: &Sharp::OPTIONS,
        summary: "the SHARP network (checkpoint=FILE, config=FILE#NAME, depth=none|privileged, device=cpu, \
                  allow_unused=PREFIX,…)",
    },
    MethodKind {
        name: "gaussians",
        options: &["dir"],
        summary: "Gaussians made elsewhere, DIR/<dataset>/<scene>/<source>.ply|safetensors, rendered by us (dir=DIR)",
    },
    MethodKind {
        name: "imported",
        options: &Imported::OPTIONS,
        summary: "pictures made elsewhere, DIR/<pair_id>.png|jpg|exr (dir=DIR); smaller ones with resize=bilinear|\
                  bilinear-antialias|bicubic|lanczos|area, cropped ones with crop=x:y:w:h|center:W:H|center|sidecar; \
                  scales=0.5+1+2 for DIR/<scale>/<pair_id>.png with --scale-sweep",
    },
    MethodKind {
        name: "command",
        options: &Command::OPTIONS,
        summary: "someone's program, one line of JSON a pair (run='python my.py', timeout=600, version=TEXT, resize=, \
                  crop=x:y:w:h|center:W:H)",
    },
];

/// Builds the instances; labels must be unique. `chooser` chooses among the scales of those that have several.
///
/// # Errors
/// Names the instance and what is wrong with it.
pub fn build(
    specs: &[MethodSpec],
    chooser: Option<&Arc<ScaleChooser>>,
) -> Result<Vec<Box<dyn Method>>, SpecError> {
    let mut labels = BTreeSet::new();
    specs
        .iter()
        .map(|spec| {
            if !labels.insert(spec.label.as_str()) {
                return Err(spec.error(format!(
                    "the label '{}' is taken; give this one label=NAME",
                    spec.label
                )));
            }
            build_one(spec, chooser)
        })
        .collect()
}

fn build_one(
    spec: &MethodSpec,
    chooser: Option<&Arc<ScaleChooser>>,
) -> Result<Box<dyn Method>, SpecError> {
    let Some(kind) = KINDS.iter().find(|kind| kind.name == spec.kind) else {
        let known: Vec<&str> = KINDS.iter().map(|kind| kind.name).collect();
        return Err(spec.error(format!("unknown kind; known: {}", known.join(", "))));
    };
    spec.expect_options(kind.options)?;
    let label = spec.label.clone();
    Ok(match spec.kind.as_str() {
        "target" => Box::new(Target { label }),
        "copy" => Box::new(Copy { label }),
        "mean" => Box::new(Mean { label }),
        "depth-splat" => Box::new(DepthSplat::from_spec(spec)?),
        "sharp" => Box::new(Sharp::from_spec(spec)?),
        "gaussians" => Box::new(GaussianFiles::new(label, spec.folder()?)),
        "command" => Box::new(Command::from_spec(spec)?),
        _ if spec.options.contains_key("scales") => {
            let Some(chooser) = chooser else {
                return Err(spec.error("several scales: --scale-sweep scores the best of them"));
            };
            Box::new(ScaleSweep::from_spec(spec, Arc::clone(chooser))?)
        }
        _ => Box::new(Imported::from_spec(spec)?),
    })
}
