//! The list of figures.

use serde::Serialize;

/// A figure of the paper and the command that makes it.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
pub struct FigureEntry {
    pub name: &'static str,
    /// The paper's label without `fig:`; empty where it has none.
    pub paper: &'static str,
    pub shows: &'static str,
    pub needs: &'static str,
    pub command: &'static str,
}

/// In the order of the paper.
pub const FIGURES: [FigureEntry; 10] = [
    FigureEntry {
        name: "fidelity-time",
        paper: "speed_quality",
        shows: "each method's mean score against its median seconds a pair, on a logarithmic axis",
        needs: "run folders (bundles hold no times)",
        command: "figure fidelity-time RUN… --out DIR",
    },
    FigureEntry {
        name: "translation",
        paper: "translation_comparison",
        shows: "a picture, the same moved a little and its mean colour, with their scores",
        needs: "a picture",
        command: "analyze translation PICTURE --out DIR",
    },
    FigureEntry {
        name: "uncertainty",
        paper: "depth_uncertainty",
        shows: "depth, that of the mirrored picture mirrored back, and their relative absolute difference",
        needs: "a picture with both depth maps, or a SHARP checkpoint for its two layers",
        command: "figure uncertainty --picture FILE --depth FILE --mirrored FILE --out DIR",
    },
    FigureEntry {
        name: "baselines",
        paper: "baseline_histogram",
        shows: "how many pairs have which camera baseline, by dataset",
        needs: "runs or bundles",
        command: "figure baselines RUN… --out DIR",
    },
    FigureEntry {
        name: "motion",
        paper: "baseline-vs-metrics (a)",
        shows: "DISTS against the camera baseline, methods without the source's true depth",
        needs: "runs or bundles",
        command: "figure motion RUN… --out DIR",
    },
    FigureEntry {
        name: "motion-privileged",
        paper: "baseline-vs-metrics (b)",
        shows: "the same for methods that know the source's true depth or its scale",
        needs: "runs or bundles",
        command: "figure motion-privileged RUN… --out DIR",
    },
    FigureEntry {
        name: "failure",
        paper: "failure_case",
        shows: "input, predicted view and inverse depth of the worst or of named pairs",
        needs: "run folders with renderings kept as floats (run --keep float; bundles hold none) and their datasets, or depth maps",
        command: "figure failure RUN… --method METHOD --out DIR",
    },
    FigureEntry {
        name: "ablation",
        paper: "ablation_loss, ablation_adjustment, ablation_ssl, ablation_unfreeze, ablation_stride",
        shows: "the same pairs as columns, methods or labelled runs as rows, with parts enlarged",
        needs: "run folders with kept pictures (bundles hold none) and their datasets",
        command: "figure ablation LABEL=RUN… --pair ID --crop X,Y,W,H --out DIR",
    },
    FigureEntry {
        name: "extended-motion",
        paper: "ablation_overlap",
        shows: "one source and its targets at growing baselines as columns, methods as rows, scored where there is truth",
        needs: "run folders with kept pictures (bundles hold none) and their datasets",
        command: "figure extended-motion RUN… --out DIR",
    },
    FigureEntry {
        name: "qualitative",
        paper: "qualitative_*",
        shows: "input, predictions and truth of chosen, worst, median or best pairs of each dataset",
        needs: "run folders with kept pictures (bundles hold none) and their datasets",
        command: "figure qualitative RUN… --choose worst --out DIR",
    },
];
