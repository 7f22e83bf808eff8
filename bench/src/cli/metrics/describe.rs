//! Explains metric keys, without pictures.

use std::fmt::{self, Display, Formatter};

use serde::Serialize;
use sharp_metrics::weights::Published;
use sharp_metrics::{MetricInfo, Scorer};

use super::{Outcome, output};
use crate::report::Column;
use crate::report::metrics_text::MethodsText;

/// Prints each key's convention, and the public code that computes the same value.
pub(super) fn explain(scorer: &Scorer, json: bool) -> anyhow::Result<Outcome> {
    output::print(&Conventions(scorer.info()), json)?;
    Ok(Outcome::Done)
}

#[derive(Serialize)]
struct Conventions(Vec<MetricInfo>);

impl Display for Conventions {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        for info in &self.0 {
            let direction = Column::from(info).direction_words();
            let MetricInfo { key, alias, .. } = info;
            writeln!(f, "{key}  (--metrics {alias}; {direction})")?;
            writeln!(f, "    {}", info.convention)?;
            writeln!(
                f,
                "    Input range {}; resizing: {}; {}.",
                info.input_range, info.resize, info.precision
            )?;
            if let (Some(own), Some(backbone)) = (&info.own_weights, &info.backbone) {
                let network = match &backbone.features_sha256 {
                    None => format!(
                        "{} of torchvision, missing",
                        Published::of(backbone.name).file
                    ),
                    Some(_) if backbone.is_unpublished() => format!("{backbone}, unpublished"),
                    Some(_) => format!("{backbone}, torchvision's"),
                };
                writeln!(
                    f,
                    "    Weights: {network}; {} of {}, built in (sha256 {}).",
                    own.file, own.package, own.sha256
                )?;
            }
            writeln!(f)?;
        }
        Ok(())
    }
}

/// Prints a paragraph for a paper.
pub(in crate::cli) fn methods_text(text: &MethodsText, json: bool) -> anyhow::Result<Outcome> {
    for backbone in &text.missing {
        output::remark(format!(
            "note: the weights of {backbone} are missing, so the text has a gap in place of their hash; provide them \
             with `sharp-bench weights fetch {backbone}` or `--weights {backbone}=FILE`"
        ));
    }
    let paragraph = Paragraph {
        latex: &text.latex,
        bibtex: &text.bibtex,
    };
    output::print(&paragraph, json)?;
    Ok(Outcome::Done)
}

#[derive(Serialize)]
struct Paragraph<'a> {
    latex: &'a str,
    bibtex: &'a str,
}

impl Display for Paragraph<'_> {
    fn fmt(&self, f: &mut Formatter<'_>) -> fmt::Result {
        writeln!(f, "{}\n", self.latex)?;
        // As comments, so that all of it can be pasted into a document.
        let mut lines = self.bibtex.lines();
        lines.try_for_each(|line| writeln!(f, "{}", format!("% {line}").trim_end()))
    }
}
