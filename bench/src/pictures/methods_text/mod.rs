//! Which metrics these are, as a paper should say it.
//!
//! * `sentences`: one for each metric.
//! * `citations`: what they cite.

mod citations;
mod sentences;

use std::collections::BTreeSet;

use sharp_metrics::{Backbone, MetricKey, WeightsUsed};

use self::citations::Citation;

/// A paragraph and the references that it cites.
#[derive(Debug, Clone, PartialEq, Eq)]
pub struct MethodsText {
    /// One paragraph of LaTeX.
    pub latex: String,
    /// BibTeX entries of what it cites.
    pub bibtex: String,
    /// Networks whose weights were not at hand; the paragraph has a visible gap where their hashes belong.
    pub missing: Vec<Backbone>,
}

impl MethodsText {
    /// Describes metrics as computed with these weights.
    pub fn new(keys: &[MetricKey], used: &[WeightsUsed]) -> Self {
        let mut cited = BTreeSet::new();
        let mut sentences = vec![format!(
            "All metrics were computed per image with \\texttt{{sharp-bench}} {} on 8-bit sRGB images at the full \
             resolution of the ground truth and averaged over images; images are not resized unless said so.",
            env!("CARGO_PKG_VERSION")
        )];
        for &key in keys {
            let (sentence, cites) = sentences::sentence(key, used);
            sentences.push(sentence);
            cited.extend(cites);
        }
        let at_hand = |backbone: &Backbone| used.iter().any(|used| used.backbone == *backbone);
        let missing: BTreeSet<Backbone> = keys
            .iter()
            .filter_map(|key| Backbone::of(key.metric()))
            .filter(|backbone| !at_hand(backbone))
            .collect();
        let entries: Vec<&str> = cited
            .iter()
            .map(|citation: &Citation| citation.bibtex())
            .collect();
        Self {
            latex: sentences.join("\n"),
            bibtex: entries.join("\n"),
            missing: missing.into_iter().collect(),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use sharp_metrics::{MetricRegion, Scorer, Selection, Weights};

    fn text(list: &str, weights: &Weights) -> MethodsText {
        let scorer = Scorer::new(&Selection::parse(list).unwrap(), weights).unwrap();
        MethodsText::new(scorer.keys(), scorer.weights())
    }

    #[test]
    fn lpips_says_version_network_hashes_range_and_resize_rule() {
        let weights = Weights::deterministic("");
        let text = text("lpips-alex", &weights);
        for part in [
            "version 0.1",
            "AlexNet",
            "$[-1,1]$",
            "df73285e35b2",
            "without resizing",
            "\\texttt{lpips} 0.1.4",
            "\\cite{zhang2018unreasonable}",
        ] {
            assert!(text.latex.contains(part), "{part}: {}", text.latex);
        }
        let scorer = Scorer::new(&Selection::parse("lpips-alex").unwrap(), &weights).unwrap();
        let hash = &scorer.weights()[0].features_sha256[..12];
        assert!(text.latex.contains(hash), "{}", text.latex);
        assert!(text.missing.is_empty());
    }

    #[test]
    fn every_key_has_a_sentence_and_everything_cited_has_an_entry() {
        for key in MetricKey::all() {
            for key in MetricRegion::ALL
                .into_iter()
                .filter_map(|region| key.inside(region))
            {
                let text = MethodsText::new(&[key], &[]);
                let key = key.to_string();
                assert!(
                    text.latex.contains(&format!("\\texttt{{{key}}}")),
                    "{}",
                    text.latex
                );
                for cite in text.latex.split("\\cite{").skip(1) {
                    let name = cite.split('}').next().unwrap();
                    assert!(text.bibtex.contains(&format!("{{{name},")), "{name}");
                }
                let opened = text.latex.matches('{').count();
                assert_eq!(opened, text.latex.matches('}').count(), "{}", text.latex);
            }
        }
    }

    #[test]
    fn absent_weights_leave_a_visible_gap() {
        let text = text("dists,lpips-vgg", &Weights::none());
        assert_eq!(text.missing, [Backbone::Vgg16]);
        assert!(
            text.latex.contains("\\textbf{[hash of the weights]}"),
            "{}",
            text.latex
        );
    }
}
