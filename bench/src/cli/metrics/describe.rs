//! Explains metric keys, without pictures.

use serde_json::json;
use sharp_metrics::weights::Published;
use sharp_metrics::{MetricInfo, Scorer};

use super::{Outcome, output};
use crate::report::Column;
use crate::report::metrics_text::MethodsText;

/// Prints each key's convention, and the public code that computes the same value.
pub(super) fn explain(scorer: &Scorer, json: bool) -> anyhow::Result<Outcome> {
    let infos = scorer.info();
    if json {
        output::json(&infos)?;
        return Ok(Outcome::Done);
    }
    for info in infos {
        let direction = Column::from(&info).direction_words();
        let MetricInfo { key, alias, .. } = &info;
        output::line(format!("{key}  (--metrics {alias}; {direction})"))?;
        output::line(format!("    {}", info.convention))?;
        output::line(format!(
            "    Input range {}; resizing: {}; {}.",
            info.input_range, info.resize, info.precision
        ))?;
        if let (Some(own), Some(backbone)) = (info.own_weights, info.backbone) {
            let network = match &backbone.features_sha256 {
                None => format!(
                    "{} of torchvision, missing",
                    Published::of(backbone.name).file
                ),
                Some(_) if backbone.is_unpublished() => format!("{backbone}, unpublished"),
                Some(_) => format!("{backbone}, torchvision's"),
            };
            output::line(format!(
                "    Weights: {network}; {} of {}, built in (sha256 {}).",
                own.file, own.package, own.sha256
            ))?;
        }
        output::line("")?;
    }
    Ok(Outcome::Done)
}

/// Prints a paragraph for a paper.
pub(in crate::cli) fn methods_text(text: &MethodsText, json: bool) -> anyhow::Result<Outcome> {
    for backbone in &text.missing {
        output::remark(format!(
            "note: the weights of {backbone} are missing, so the text has a gap in place of their hash; provide them \
             with `sharp-bench weights fetch {backbone}` or `--weights {backbone}=FILE`"
        ));
    }
    if json {
        output::json(&json!({"latex": text.latex, "bibtex": text.bibtex}))?;
    } else {
        output::line(&text.latex)?;
        output::line("")?;
        // Print as comments, so that all of it can be pasted into a document.
        for line in text.bibtex.lines() {
            output::line(format!("% {line}").trim_end())?;
        }
    }
    Ok(Outcome::Done)
}
