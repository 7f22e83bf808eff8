//! What the keys mean, without any picture.

use serde_json::json;
use sharp_metrics::weights::Published;
use sharp_metrics::{Direction, MetricInfo, MetricKey, Scorer, Selection};

use super::{Outcome, output};
use crate::pictures::methods_text::MethodsText;

/// Each key with its convention and the public code that computes the same.
pub(super) fn explain(selection: &Selection, json: bool) -> anyhow::Result<Outcome> {
    if json {
        let keys: Vec<_> = selection.keys().map(explanation).collect();
        output::json(&keys)?;
        return Ok(Outcome::Done);
    }
    for key in selection.keys() {
        let facts = MetricInfo::new(key, &[]);
        let direction = match facts.direction {
            Direction::Higher => "higher",
            Direction::Lower => "lower",
        };
        output::line(format!(
            "{key}  (--metrics {}; {direction} is better)",
            key.alias()
        ))?;
        output::line(format!("    {}", facts.convention))?;
        output::line(format!(
            "    Input range {}; resizing: {}; {}.",
            facts.input_range, facts.resize, facts.precision
        ))?;
        if let (Some(own), Some(backbone)) = (facts.own_weights, facts.backbone) {
            let published = Published::of(backbone.name);
            output::line(format!(
                "    Weights: {} of torchvision, to be fetched; {} of {}, built in (sha256 {}).",
                published.file, own.file, own.package, own.sha256
            ))?;
        }
        output::line("")?;
    }
    Ok(Outcome::Done)
}

fn explanation(key: MetricKey) -> serde_json::Value {
    let facts = MetricInfo::new(key, &[]);
    let mut value = json!({
        "key": key.to_string(),
        "alias": key.alias(),
        "explanation": facts.convention,
        "higher_is_better": facts.direction == Direction::Higher,
        "unit": facts.unit,
        "input_range": facts.input_range,
        "resize": facts.resize,
        "precision": facts.precision,
    });
    if let (Some(own), Some(backbone)) = (facts.own_weights, facts.backbone) {
        value["backbone"] =
            json!({"name": backbone.name, "file": Published::of(backbone.name).file});
        value["own_weights"] =
            json!({"package": own.package, "file": own.file, "sha256": own.sha256});
    }
    value
}

/// A paragraph for a paper.
pub(super) fn methods_text(scorer: &Scorer, json: bool) -> anyhow::Result<Outcome> {
    let text = MethodsText::new(scorer.keys(), scorer.weights());
    for backbone in &text.missing {
        output::remark(format!(
            "note: the weights of {backbone} are not at hand, so the text has a gap where their hash belongs; \
             `sharp-bench weights fetch {backbone}` or `--weights {backbone}=FILE` fills it"
        ));
    }
    if json {
        output::json(&json!({"latex": text.latex, "bibtex": text.bibtex}))?;
    } else {
        output::line(&text.latex)?;
        output::line("")?;
        // As comments, so that all of it can be pasted into a document.
        for line in text.bibtex.lines() {
            output::line(format!("% {line}").trim_end())?;
        }
    }
    Ok(Outcome::Done)
}
