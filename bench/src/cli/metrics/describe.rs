//! Explains metric keys, without pictures.

use serde_json::json;
use sharp_metrics::weights::Published;
use sharp_metrics::{MetricInfo, Scorer};

use super::{Outcome, output};
use crate::report::Column;
use crate::report::metrics_text::MethodsText;

/// Prints the convention of each metric key, and the public code that computes the same value.
pub(super) fn explain(scorer: &Scorer, json: bool) -> anyhow::Result<Outcome> {
    output::print(json, || scorer.info(), || conventions(&scorer.info()))?;
    Ok(Outcome::Done)
}

fn conventions(all: &[MetricInfo]) -> String {
    let mut text = String::new();
    for info in all {
        let direction = Column::from(info).direction_words();
        let MetricInfo { key, alias, .. } = info;
        text += &format!("{key}  (--metrics {alias}; {direction})\n");
        text += &format!("    {}\n", info.convention);
        text += &format!(
            "    Input range {}; resizing: {}; {}.\n",
            info.input_range, info.resize, info.precision
        );
        if let (Some(own), Some(backbone)) = (&info.own_weights, &info.backbone) {
            let network = match &backbone.features_sha256 {
                None => format!(
                    "torchvision's {}, a file that is missing",
                    Published::of(backbone.name).file
                ),
                Some(_) if backbone.is_unpublished() => format!("{backbone}, unpublished"),
                Some(_) => format!("{backbone}, torchvision's"),
            };
            text += &format!(
                "    Weights: {network}; {} of {}, built in (sha256 {}).\n",
                own.file, own.package, own.sha256
            );
        }
        text += "\n";
    }
    text
}

/// Prints a paragraph for a paper.
pub(in crate::cli) fn methods_text(text: &MethodsText, json: bool) -> anyhow::Result<Outcome> {
    for backbone in &text.missing {
        output::remark(format!(
            "note: the weights of {backbone} are missing, so the text has a gap in place of their hash; provide them \
             with `sharp-bench weights fetch {backbone}` or `--weights {backbone}=FILE`"
        ));
    }
    let MethodsText { latex, bibtex, .. } = text;
    output::print(
        json,
        || json!({"latex": latex, "bibtex": bibtex}),
        || {
            // Print BibTeX as comments, so that the whole output can be pasted into a LaTeX
            // document.
            let lines = bibtex
                .lines()
                .map(|line| format!("% {line}").trim_end().to_owned() + "\n");
            format!("{latex}\n\n{}", lines.collect::<String>())
        },
    )?;
    Ok(Outcome::Done)
}
